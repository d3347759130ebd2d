// RUN: yasps-opt -p lift-constants %s | filecheck %s
// Numbers become entries of a storage of the scene, one for every use; 2 and -0.5 stay, and what is structure in a matrix.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 3
  rel.storage @m.v.x on @m.v : 2x1
  rel.attribute @m.v.e on @m.v : 1x1 {
    %x = rel.data @m.v.x : 2x1
    %a = mat.constant [[3.0], [1.0]] : 2x1
    %k = mat.constant 7.0 : 1x1
    %two = mat.constant 2.0 : 1x1
    %d = mat.sub %x, %a : 2x1
    %n = mat.dot %d, %d : 1x1
    %t = mat.scale %two, %n : 1x1
    %p = mat.add %t, %k : 1x1
    %e = mat.scale %k, %p : 1x1
    rel.yield %e
  }
  rel.energy @m.v.e projection "clamp"
  rel.target @m.v.x
}

// CHECK:       rel.storage @m.v.x on @m.v : 2x1
// CHECK-NEXT:  rel.storage @m.v.e.numbers on @s : 4x1 constant numbers {{\[\[}}3.0], [0.0], [7.0], [7.0]]
// CHECK-NEXT:  rel.attribute @m.v.e on @m.v : 1x1 {
// CHECK-NEXT:    [[N:%.+]] = rel.data @m.v.e.numbers : 4x1
// CHECK:         [[A:%.+]] = mat.block [[N]][0, 0]
// CHECK-NEXT:    [[MASK:%.+]] = mat.constant {{\[\[}}1.0], [0.0]] : 2x1
// CHECK-NEXT:    [[FREE:%.+]] = mat.hadamard [[MASK]], [[A]]
// CHECK-NEXT:    [[KNOWN:%.+]] = mat.constant {{\[\[}}0.0], [1.0]] : 2x1
// CHECK-NEXT:    mat.add [[FREE]], [[KNOWN]]
// CHECK:         mat.constant 2.0 : 1x1
// CHECK:         [[SHIFT:%.+]] = mat.block [[N]][2, 0]
// CHECK-NEXT:    [[P:%.+]] = mat.add {{.*}}, [[SHIFT]]
// CHECK-NEXT:    [[K:%.+]] = mat.block [[N]][3, 0]
// CHECK-NEXT:    mat.scale [[K]], [[P]]
