// RUN: yasps-opt -p project-psd %s | filecheck %s
// The innermost S of L^T S L is projected, on the Hessian's way alone; the gradient stays. "none" and affine stay whole.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 2
  rel.storage @m.v.x on @m.v : 3x1
  rel.attribute @m.v.e on @m.v : 1x1
  rel.attribute @m.v.f on @m.v : 1x1
  rel.attribute @m.v.g on @m.v : 1x1
  rel.target @m.v.x
  rel.derivative @m.v.e.derivative of @m.v.e on @m.v projection "abs" {
    %x = rel.data @m.v.x : 3x1
    %l = mat.constant [[1.0, 2.0, 3.0], [0.0, 1.0, 0.0]] : 2x3
    %k = mat.constant [[1.0, 2.0], [2.0, 1.0]] : 2x2
    %n = mat.norm %x : 1x1
    %s = mat.scale %n, %k : 2x2
    %h = mat.congruence %s, %l : 3x3
    %y = mat.matmul %h, %x : 3x1
    rel.yield_derivative %n gradient %y hessian %h wrt %x
  }
  rel.derivative @m.v.f.derivative of @m.v.f on @m.v projection "none" {
    %x = rel.data @m.v.x : 3x1
    %t = mat.transpose %x : 1x3
    %h = mat.matmul %x, %t : 3x3
    %n = mat.norm %x : 1x1
    rel.yield_derivative %n gradient %x hessian %h wrt %x
  }
  rel.derivative @m.v.g.derivative of @m.v.g on @m.v projection "clamp" {
    %x = rel.data @m.v.x : 3x1
    %y = mat.constant [[1.0], [2.0], [3.0]] : 3x1
    %n = mat.dot %x, %y : 1x1
    rel.yield_derivative %n gradient %y wrt %x
  }
}

// CHECK:       rel.derivative @m.v.e.derivative {{.*}} projection "abs" projects "2x2 of 3x3: the energy reads its
// CHECK:         [[L:%.+]] = mat.constant {{.*}} : 2x3
// CHECK:         [[N:%.+]] = mat.norm
// CHECK-NEXT:    [[S:%.+]] = mat.scale
// CHECK-NEXT:    [[H:%.+]] = mat.congruence [[S]], [[L]]
// CHECK-NEXT:    [[G:%.+]] = mat.matmul [[H]], %x
// CHECK-NEXT:    [[P:%.+]] = mat.project_psd [[S]] mode "abs" : 2x2
// CHECK-NEXT:    [[Q:%.+]] = mat.congruence [[P]], [[L]] : 3x3
// CHECK-NEXT:    rel.yield_derivative [[N]] gradient [[G]] hessian [[Q]]
// CHECK:       rel.derivative @m.v.f.derivative {{.*}} projects "nowhere: switched off" {
// CHECK-NOT:     mat.project_psd
// CHECK:       rel.derivative @m.v.g.derivative {{.*}} projects "nowhere: the energy is affine, its Hessian is zero" {
// CHECK-NOT:     mat.project_psd
