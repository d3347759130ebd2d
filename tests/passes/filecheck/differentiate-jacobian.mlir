// RUN: yasps-opt -p differentiate %s | filecheck %s
// An attribute between an energy and its target gets a Jacobian; an affine energy has no Hessian.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.b in @m size 1 : i64
  rel.primitive @m.v in @m size 4 : i64
  rel.primitive @m.e in @m size 2 : i64
  rel.connectivity @m.v.owner from @m.v to @m.b arity 1 : i64
  rel.connectivity @m.e.ends from @m.e to @m.v arity 2 : i64
  rel.storage @m.b.t on @m.b : tensor<2x1xf64>
  rel.attribute @m.v.x on @m.v : tensor<2x1xf64> {
    %t = rel.join @m.b.t through @m.v.owner : tensor<1x2xf64>
    %x = mat.transpose %t : (tensor<1x2xf64>) -> tensor<2x1xf64>
    rel.yield %x : tensor<2x1xf64>
  }
  rel.attribute @m.e.sum on @m.e : tensor<1x1xf64> {
    %x = rel.join @m.v.x through @m.e.ends : tensor<2x2xf64>
    %s = mat.sum %x : (tensor<2x2xf64>) -> tensor<1x1xf64>
    rel.yield %s : tensor<1x1xf64>
  }
  rel.energy @m.e.sum projection "clamp"
  rel.target @m.b.t
}

// CHECK:       rel.jacobian @m.v.x.jacobian of @m.v.x on @m.v {
// CHECK:         [[T:%.+]] = rel.join @m.b.t through @m.v.owner : tensor<1x2xf64>
// CHECK:         [[J:%.+]] = mat.constant {value = dense<{{\[\[}}1.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00]]>
// CHECK:         rel.yield_jacobian [[J]] : tensor<2x2xf64> wrt [[T]] : tensor<1x2xf64>
// CHECK:       rel.derivative @m.e.sum.derivative
// CHECK:         rel.yield_derivative [[E:%.+]] : tensor<1x1xf64> gradient [[G:%.+]] : tensor<4x1xf64> wrt [[X:%.+]] : tensor<2x2xf64>
