// RUN: yasps-opt -p canonicalize %s | filecheck %s
// Upstream's canonicalisation folds with the rules of `mat`.

rel.scene @s {
  rel.storage @x on @s : tensor<2x2xf64>
  rel.attribute @a on @s : tensor<2x2xf64> {
    %x = rel.data @x : tensor<2x2xf64>
    %i = mat.identity {size = array<i64: 2>} : () -> tensor<2x2xf64>
    %p = mat.matmul %x, %i : (tensor<2x2xf64>, tensor<2x2xf64>) -> tensor<2x2xf64>
    %n = mat.neg %p : (tensor<2x2xf64>) -> tensor<2x2xf64>
    %m = mat.neg %n : (tensor<2x2xf64>) -> tensor<2x2xf64>
    %t = mat.transpose %m : (tensor<2x2xf64>) -> tensor<2x2xf64>
    %two = mat.constant {value = dense<2.0> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
    %root = mat.sqrt %two : (tensor<1x1xf64>) -> tensor<1x1xf64>
    %s = mat.scale %root, %t : (tensor<1x1xf64>, tensor<2x2xf64>) -> tensor<2x2xf64>
    rel.yield %s : tensor<2x2xf64>
  }
}

// CHECK:       rel.attribute @a on @s : tensor<2x2xf64> {
// CHECK-DAG:     [[X:%.+]] = rel.data @x : tensor<2x2xf64>
// CHECK-DAG:     [[T:%.+]] = mat.transpose [[X]]
// CHECK-DAG:     [[R:%.+]] = mat.constant {value = dense<1.41421{{.*}}> : tensor<1x1xf64>}
// CHECK:         [[S:%.+]] = mat.scale [[R]], [[T]]
// CHECK-NEXT:    rel.yield [[S]]
