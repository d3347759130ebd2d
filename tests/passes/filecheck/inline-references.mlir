// RUN: yasps-opt -p inline-references %s | filecheck %s
// A reference becomes what it refers to; what nobody needs any more goes.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 2 : i64
  rel.storage @m.v.x on @m.v : tensor<3x1xf64>
  rel.attribute @m.v.square on @m.v : tensor<1x1xf64> {
    %x = rel.data @m.v.x : tensor<3x1xf64>
    %d = mat.dot %x, %x : (tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<1x1xf64>
    rel.yield %d : tensor<1x1xf64>
  }
  rel.attribute @m.v.e on @m.v : tensor<1x1xf64> {
    %s = rel.ref @m.v.square : tensor<1x1xf64>
    %x = rel.data @m.v.x : tensor<3x1xf64>
    %d = mat.dot %x, %x : (tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<1x1xf64>
    %r = mat.scale %s, %d : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
    rel.yield %r : tensor<1x1xf64>
  }
  rel.energy @m.v.e projection "clamp"
}

// CHECK-NOT:   @m.v.square
// CHECK:       rel.attribute @m.v.e on @m.v : tensor<1x1xf64> {
// CHECK-NEXT:    [[X:%.+]] = rel.data @m.v.x : tensor<3x1xf64>
// CHECK-NEXT:    [[D:%.+]] = mat.dot [[X]], [[X]]
// CHECK-NEXT:    [[R:%.+]] = mat.scale [[D]], [[D]]
// CHECK-NEXT:    rel.yield [[R]]
