// RUN: yasps-opt -p differentiate,project-psd %s | filecheck %s
// phi(x1 - x0) of two points is differentiated, and projected, with respect to the 3 entries of the difference.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 3
  rel.primitive @m.p in @m dynamic
  rel.connectivity @m.p.ends from @m.p to @m.v arity 2
  rel.storage @m.v.x on @m.v : 3x1
  rel.attribute @m.p.e on @m.p : 1x1 {
    %x = rel.join @m.v.x through @m.p.ends : 2x3
    %a = mat.block %x[0, 0] : 1x3
    %b = mat.block %x[1, 0] : 1x3
    %d = mat.sub %b, %a : 1x3
    %n = mat.norm %d : 1x1
    rel.yield %n
  }
  rel.energy @m.p.e projection "abs" dynamic
  rel.target @m.v.x
}

// CHECK:       rel.derivative @m.p.e.derivative of @m.p.e on @m.p projection "abs" dynamic projects "3x3 of 6x6
// CHECK:         [[X:%.+]] = rel.join @m.v.x through @m.p.ends : 2x3
// CHECK:         [[L:%.+]] = mat.constant {{.*}} : 3x6
// CHECK:         [[P:%.+]] = mat.project_psd [[S:%.+]] mode "abs" : 3x3
// CHECK-NEXT:    [[H:%.+]] = mat.congruence [[P]], [[L]] : 6x6
// CHECK-NEXT:    rel.yield_derivative [[E:%.+]] gradient [[G:%.+]] hessian [[H]] cut [[D:%.+]] wrt [[X]]
// CHECK-NOT:   rel.jacobian
