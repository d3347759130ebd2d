// RUN: yasps-opt -p inline-references %s | filecheck %s
// A reference becomes what it refers to; what nobody needs any more goes.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 2
  rel.storage @m.v.x on @m.v : 3x1
  rel.attribute @m.v.square on @m.v : 1x1 {
    %x = rel.data @m.v.x : 3x1
    %d = mat.dot %x, %x : 1x1
    rel.yield %d
  }
  rel.attribute @m.v.e on @m.v : 1x1 {
    %s = rel.ref @m.v.square : 1x1
    %x = rel.data @m.v.x : 3x1
    %d = mat.dot %x, %x : 1x1
    %r = mat.scale %s, %d : 1x1
    rel.yield %r
  }
  rel.energy @m.v.e projection "clamp"
}

// CHECK-NOT:   @m.v.square
// CHECK:       rel.attribute @m.v.e on @m.v : 1x1 {
// CHECK-NEXT:    [[X:%.+]] = rel.data @m.v.x : 3x1
// CHECK-NEXT:    [[D:%.+]] = mat.dot [[X]], [[X]]
// CHECK-NEXT:    [[R:%.+]] = mat.scale [[D]], [[D]]
// CHECK-NEXT:    rel.yield [[R]]
