// RUN: yasps-opt -p differentiate,project-psd %s | filecheck %s
// Behind a JOIN, a nonlinear attribute h gets the Hessian of <v, h> too, and its energy is projected as a whole.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.a in @m size 1
  rel.primitive @m.p in @m size 2
  rel.connectivity @m.p.arm from @m.p to @m.a arity 1
  rel.storage @m.a.angle on @m.a : 1x1
  rel.attribute @m.a.tip on @m.a : 1x1 {
    %x = rel.data @m.a.angle : 1x1
    %s = mat.sin %x : 1x1
    rel.yield %s
  }
  rel.attribute @m.p.e on @m.p : 1x1 {
    %x = rel.join @m.a.tip through @m.p.arm : 1x1
    rel.yield %x
  }
  rel.energy @m.p.e projection "clamp"
  rel.target @m.a.angle
}

// CHECK:       rel.jacobian @m.a.tip.jacobian of @m.a.tip on @m.a {
// CHECK:         [[C:%.+]] = mat.cos %x
// CHECK:         rel.yield_jacobian [[C]] wrt %x
// CHECK:       rel.curvature @m.a.tip.curvature of @m.a.tip on @m.a {
// CHECK-NEXT:    ^{{.+}}([[V:%.+]]: tensor<1x1xf64>):
// CHECK:         [[S:%.+]] = mat.sin %x
// CHECK:         [[N:%.+]] = mat.neg [[S]]
// CHECK-NEXT:    [[H:%.+]] = mat.scale [[N]], [[V]]
// CHECK-NEXT:    rel.yield_curvature [[H]] wrt %x
// CHECK:       rel.derivative @m.p.e.derivative {{.*}} curved projects "the whole local Hessian, expanded
// CHECK-NEXT:    [[X:%.+]] = rel.join @m.a.tip through @m.p.arm
// CHECK-NOT:     hessian
