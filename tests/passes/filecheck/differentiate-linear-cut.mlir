// RUN: yasps-opt -p differentiate,project-psd %s | filecheck %s
// phi(x1 - x0) of two points is differentiated, and projected, with respect to the 3 entries of the difference.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 3 : i64
  rel.primitive @m.p in @m dynamic
  rel.connectivity @m.p.ends from @m.p to @m.v arity 2 : i64
  rel.storage @m.v.x on @m.v : tensor<3x1xf64>
  rel.attribute @m.p.e on @m.p : tensor<1x1xf64> {
    %x = rel.join @m.v.x through @m.p.ends : tensor<2x3xf64>
    %a = mat.block %x {block = array<i64: 0, 0, 1, 3>} : (tensor<2x3xf64>) -> tensor<1x3xf64>
    %b = mat.block %x {block = array<i64: 1, 0, 1, 3>} : (tensor<2x3xf64>) -> tensor<1x3xf64>
    %d = mat.sub %b, %a : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
    %n = mat.norm %d : (tensor<1x3xf64>) -> tensor<1x1xf64>
    rel.yield %n : tensor<1x1xf64>
  }
  rel.energy @m.p.e projection "abs" dynamic
  rel.target @m.v.x
}

// CHECK:       rel.derivative @m.p.e.derivative of @m.p.e on @m.p projection "abs" dynamic projects "3x3 of 6x6
// CHECK:         [[X:%.+]] = rel.join @m.v.x through @m.p.ends : tensor<2x3xf64>
// CHECK:         [[L:%.+]] = mat.constant {{.*}} -> tensor<3x6xf64>
// CHECK:         [[P:%.+]] = mat.project_psd [[S:%.+]] {mode = "abs"} : (tensor<3x3xf64>) -> tensor<3x3xf64>
// CHECK-NEXT:    [[H:%.+]] = mat.congruence [[P]], [[L]] : (tensor<3x3xf64>, tensor<3x6xf64>) -> tensor<6x6xf64>
// CHECK-NEXT:    rel.yield_derivative [[E:%.+]] : tensor<1x1xf64> gradient [[G:%.+]] : tensor<6x1xf64> hessian [[H]] : tensor<6x6xf64> wrt [[X]]
// CHECK-NOT:   rel.jacobian
