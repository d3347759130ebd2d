// RUN: yasps-opt -p differentiate,infer-indices %s | filecheck %s
// Placement indices: a target's own, none for a constant, the branch's for a union, gathered by a JOIN.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.a in @m size 2
  rel.primitive @m.b in @m size 3
  rel.primitive_union @m.u in @m of [@m.a, @m.b]
  rel.primitive @m.p in @m dynamic
  rel.connectivity @m.p.ends from @m.p to @m.u arity 2
  rel.storage @m.a.x on @m.a : 3x1
  rel.storage @m.b.x on @m.b : 3x1 constant
  rel.attribute @m.u.x on @m.u : 3x1 {
    %x = rel.union [@m.a.x, @m.b.x] : 3x1
    rel.yield %x
  }
  rel.attribute @m.p.e on @m.p : 1x1 {
    %x = rel.join @m.u.x through @m.p.ends : 2x3
    %e = mat.dot %x, %x : 1x1
    rel.yield %e
  }
  rel.energy @m.p.e projection "none" dynamic
  rel.target @m.a.x
}

// CHECK:       rel.derivative @m.p.e.derivative of @m.p.e on @m.p projection "none" dynamic indices @m.p.e.kappa {
// CHECK:       rel.attribute @m.a.x.kappa on @m.a : 1x1xi32 {
// CHECK-NEXT:    [[A:%.+]] = rel.target_index @m.a.x : 1x1xi32
// CHECK:       rel.attribute @m.b.x.kappa on @m.b : 1x1xi32 {
// CHECK-NEXT:    [[B:%.+]] = mat.constant 0 : 1x1xi32
// CHECK:       rel.attribute @m.u.x.kappa on @m.u : 1x1xi32 {
// CHECK-NEXT:    [[U:%.+]] = rel.union_indices [@m.a.x.kappa, @m.b.x.kappa] : 1x1xi32
// CHECK:       rel.attribute @m.p.e.kappa on @m.p : 1x2xi32 {
// CHECK-NEXT:    [[J:%.+]] = rel.join_indices @m.u.x.kappa through @m.p.ends : 2x1xi32
// CHECK-NEXT:    [[R:%.+]] = mat.reshape [[J]] : 1x2xi32
// CHECK-NEXT:    rel.yield [[R]]
