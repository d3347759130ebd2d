// RUN: yasps-opt -p lift-constants %s | filecheck %s
// Numbers become entries of a storage of the scene, one for every use; 2 and -0.5 stay, and what is structure in a matrix.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 3 : i64
  rel.storage @m.v.x on @m.v : tensor<2x1xf64>
  rel.attribute @m.v.e on @m.v : tensor<1x1xf64> {
    %x = rel.data @m.v.x : tensor<2x1xf64>
    %a = mat.constant {value = dense<[[3.0], [1.0]]> : tensor<2x1xf64>} : () -> tensor<2x1xf64>
    %k = mat.constant {value = dense<7.0> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
    %two = mat.constant {value = dense<2.0> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
    %d = mat.sub %x, %a : (tensor<2x1xf64>, tensor<2x1xf64>) -> tensor<2x1xf64>
    %n = mat.dot %d, %d : (tensor<2x1xf64>, tensor<2x1xf64>) -> tensor<1x1xf64>
    %t = mat.scale %two, %n : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
    %p = mat.add %t, %k : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
    %e = mat.scale %k, %p : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
    rel.yield %e : tensor<1x1xf64>
  }
  rel.energy @m.v.e projection "clamp"
  rel.target @m.v.x
}

// CHECK:       rel.storage @m.v.x on @m.v : tensor<2x1xf64>
// CHECK-NEXT:  rel.storage @m.v.e.numbers on @s : tensor<4x1xf64> constant numbers dense<[[3.000000e+00], [0.000000e+00], [7.000000e+00], [7.000000e+00]]> : tensor<4x1xf64>
// CHECK-NEXT:  rel.attribute @m.v.e on @m.v : tensor<1x1xf64> {
// CHECK-NEXT:    [[N:%.+]] = rel.data @m.v.e.numbers : tensor<4x1xf64>
// CHECK:         [[A:%.+]] = mat.block [[N]] {block = array<i64: 0, 0, 2, 1>}
// CHECK-NEXT:    [[MASK:%.+]] = mat.constant {value = dense<[[1.000000e+00], [0.000000e+00]]> : tensor<2x1xf64>}
// CHECK-NEXT:    [[FREE:%.+]] = mat.hadamard [[MASK]], [[A]]
// CHECK-NEXT:    [[KNOWN:%.+]] = mat.constant {value = dense<[[0.000000e+00], [1.000000e+00]]> : tensor<2x1xf64>}
// CHECK-NEXT:    mat.add [[FREE]], [[KNOWN]]
// CHECK:         mat.constant {value = dense<2.000000e+00> : tensor<1x1xf64>}
// CHECK:         [[SHIFT:%.+]] = mat.block [[N]] {block = array<i64: 2, 0, 1, 1>}
// CHECK-NEXT:    [[P:%.+]] = mat.add {{.*}}, [[SHIFT]]
// CHECK-NEXT:    [[K:%.+]] = mat.block [[N]] {block = array<i64: 3, 0, 1, 1>}
// CHECK-NEXT:    mat.scale [[K]], [[P]]
