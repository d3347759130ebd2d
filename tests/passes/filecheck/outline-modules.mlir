// RUN: yasps-opt -p lower-to-scalar,outline-modules %s | filecheck %s
// A definition moves into an object with the function it calls; the scene keeps the declaration.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 2
  rel.storage @m.v.x on @m.v : 1x1
  rel.attribute @m.v.e on @m.v : 1x1 {
    %x = rel.data @m.v.x : 1x1
    %y = mat.exp %x : 1x1
    rel.yield %y
  }
  rel.energy @m.v.e projection "clamp"
}

// CHECK:       rel.scene @s {
// CHECK:         rel.attribute @m.v.e on @m.v : 1x1
// CHECK-NEXT:    rel.energy @m.v.e
// CHECK-NEXT:  }
// CHECK-NEXT:  rel.object @m.v.e.object entries ["batch"] {
// CHECK-NEXT:    rel.attribute @m.v.e on @m.v : 1x1 {
// CHECK-NEXT:      [[X:%.+]] = rel.data @m.v.x : 1x1
// CHECK-NEXT:      [[Y:%.+]] = rel.apply @m.v.e.value([[X]]) : 1x1
// CHECK-NEXT:      rel.yield [[Y]]
// CHECK-NEXT:    }
// CHECK-NEXT:    func.func @m.v.e.value([[A:%.+]]: f64) -> f64 {
// CHECK-NEXT:      [[R:%.+]] = math.exp [[A]] : f64
// CHECK-NEXT:      func.return [[R]] : f64
