// RUN: yasps-opt -p differentiate %s | filecheck %s
// An attribute between an energy and its target gets a Jacobian; an affine energy has no Hessian.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.b in @m size 1
  rel.primitive @m.v in @m size 4
  rel.primitive @m.e in @m size 2
  rel.connectivity @m.v.owner from @m.v to @m.b arity 1
  rel.connectivity @m.e.ends from @m.e to @m.v arity 2
  rel.storage @m.b.t on @m.b : 2x1
  rel.attribute @m.v.x on @m.v : 2x1 {
    %t = rel.join @m.b.t through @m.v.owner : 1x2
    %x = mat.transpose %t : 2x1
    rel.yield %x
  }
  rel.attribute @m.e.sum on @m.e : 1x1 {
    %x = rel.join @m.v.x through @m.e.ends : 2x2
    %s = mat.sum %x : 1x1
    rel.yield %s
  }
  rel.energy @m.e.sum projection "clamp"
  rel.target @m.b.t
}

// CHECK:       rel.jacobian @m.v.x.jacobian of @m.v.x on @m.v {
// CHECK:         [[T:%.+]] = rel.join @m.b.t through @m.v.owner : 1x2
// CHECK:         [[J:%.+]] = mat.constant {{\[\[}}1.0, 0.0], [0.0, 1.0]]
// CHECK:         rel.yield_jacobian [[J]] wrt [[T]]
// CHECK:       rel.derivative @m.e.sum.derivative
// CHECK:         rel.yield_derivative [[E:%.+]] gradient [[G:%.+]] wrt [[X:%.+]]
