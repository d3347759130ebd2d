// RUN: yasps-opt -p canonicalize %s | filecheck %s
// Upstream's canonicalisation folds with the rules of `mat`.

rel.scene @s {
  rel.storage @x on @s : 2x2
  rel.attribute @a on @s : 2x2 {
    %x = rel.data @x : 2x2
    %i = mat.identity : 2x2
    %p = mat.matmul %x, %i : 2x2
    %n = mat.neg %p : 2x2
    %m = mat.neg %n : 2x2
    %t = mat.transpose %m : 2x2
    %two = mat.constant 2.0 : 1x1
    %root = mat.sqrt %two : 1x1
    %s = mat.scale %root, %t : 2x2
    rel.yield %s
  }
}

// CHECK:       rel.attribute @a on @s : 2x2 {
// CHECK-DAG:     [[X:%.+]] = rel.data @x : 2x2
// CHECK-DAG:     [[T:%.+]] = mat.transpose [[X]]
// CHECK-DAG:     [[R:%.+]] = mat.constant 1.41421{{.*}} : 1x1
// CHECK:         [[S:%.+]] = mat.scale [[R]], [[T]]
// CHECK-NEXT:    rel.yield [[S]]
