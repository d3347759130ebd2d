// RUN: yasps-opt -p cse %s | filecheck %s
// Equal operations of a body are one; reads are pure, so equal reads are too. Bodies share nothing.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 2
  rel.storage @m.v.x on @m.v : 3x1
  rel.attribute @m.v.a on @m.v : 1x1 {
    %x = rel.data @m.v.x : 3x1
    %y = rel.data @m.v.x : 3x1
    %d = mat.dot %x, %x : 1x1
    %e = mat.dot %y, %y : 1x1
    %r = mat.add %d, %e : 1x1
    rel.yield %r
  }
  rel.attribute @m.v.b on @m.v : 1x1 {
    %x = rel.data @m.v.x : 3x1
    %d = mat.dot %x, %x : 1x1
    rel.yield %d
  }
}

// CHECK:       rel.attribute @m.v.a on @m.v : 1x1 {
// CHECK-NEXT:    [[X:%.+]] = rel.data @m.v.x : 3x1
// CHECK-NEXT:    [[D:%.+]] = mat.dot [[X]], [[X]]
// CHECK-NEXT:    [[R:%.+]] = mat.add [[D]], [[D]]
// CHECK-NEXT:    rel.yield [[R]]
// CHECK:       rel.attribute @m.v.b on @m.v : 1x1 {
// CHECK-NEXT:    [[X:%.+]] = rel.data @m.v.x : 3x1
// CHECK-NEXT:    [[D:%.+]] = mat.dot [[X]], [[X]]
// CHECK-NEXT:    rel.yield [[D]]
