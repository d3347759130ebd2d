// RUN: yasps-opt -p cse %s | filecheck %s
// Equal operations of a body are one; reads are pure, so equal reads are too. Bodies share nothing.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 2 : i64
  rel.storage @m.v.x on @m.v : tensor<3x1xf64>
  rel.attribute @m.v.a on @m.v : tensor<1x1xf64> {
    %x = rel.data @m.v.x : tensor<3x1xf64>
    %y = rel.data @m.v.x : tensor<3x1xf64>
    %d = mat.dot %x, %x : (tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<1x1xf64>
    %e = mat.dot %y, %y : (tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<1x1xf64>
    %r = mat.add %d, %e : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
    rel.yield %r : tensor<1x1xf64>
  }
  rel.attribute @m.v.b on @m.v : tensor<1x1xf64> {
    %x = rel.data @m.v.x : tensor<3x1xf64>
    %d = mat.dot %x, %x : (tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<1x1xf64>
    rel.yield %d : tensor<1x1xf64>
  }
}

// CHECK:       rel.attribute @m.v.a on @m.v : tensor<1x1xf64> {
// CHECK-NEXT:    [[X:%.+]] = rel.data @m.v.x : tensor<3x1xf64>
// CHECK-NEXT:    [[D:%.+]] = mat.dot [[X]], [[X]]
// CHECK-NEXT:    [[R:%.+]] = mat.add [[D]], [[D]]
// CHECK-NEXT:    rel.yield [[R]]
// CHECK:       rel.attribute @m.v.b on @m.v : tensor<1x1xf64> {
// CHECK-NEXT:    [[X:%.+]] = rel.data @m.v.x : tensor<3x1xf64>
// CHECK-NEXT:    [[D:%.+]] = mat.dot [[X]], [[X]]
// CHECK-NEXT:    rel.yield [[D]]
