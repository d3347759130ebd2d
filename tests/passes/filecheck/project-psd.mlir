// RUN: yasps-opt -p project-psd %s | filecheck %s
// The innermost S of L^T S L is projected, on the Hessian's way alone; the gradient stays. "none" and affine stay whole.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 2 : i64
  rel.storage @m.v.x on @m.v : tensor<3x1xf64>
  rel.attribute @m.v.e on @m.v : tensor<1x1xf64>
  rel.attribute @m.v.f on @m.v : tensor<1x1xf64>
  rel.attribute @m.v.g on @m.v : tensor<1x1xf64>
  rel.target @m.v.x
  rel.derivative @m.v.e.derivative of @m.v.e on @m.v projection "abs" {
    %x = rel.data @m.v.x : tensor<3x1xf64>
    %l = mat.constant {value = dense<[[1.0, 2.0, 3.0], [0.0, 1.0, 0.0]]> : tensor<2x3xf64>} : () -> tensor<2x3xf64>
    %k = mat.constant {value = dense<[[1.0, 2.0], [2.0, 1.0]]> : tensor<2x2xf64>} : () -> tensor<2x2xf64>
    %n = mat.norm %x : (tensor<3x1xf64>) -> tensor<1x1xf64>
    %s = mat.scale %n, %k : (tensor<1x1xf64>, tensor<2x2xf64>) -> tensor<2x2xf64>
    %h = mat.congruence %s, %l : (tensor<2x2xf64>, tensor<2x3xf64>) -> tensor<3x3xf64>
    %y = mat.matmul %h, %x : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
    rel.yield_derivative %n : tensor<1x1xf64> gradient %y : tensor<3x1xf64> hessian %h : tensor<3x3xf64> wrt %x : tensor<3x1xf64>
  }
  rel.derivative @m.v.f.derivative of @m.v.f on @m.v projection "none" {
    %x = rel.data @m.v.x : tensor<3x1xf64>
    %t = mat.transpose %x : (tensor<3x1xf64>) -> tensor<1x3xf64>
    %h = mat.matmul %x, %t : (tensor<3x1xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
    %n = mat.norm %x : (tensor<3x1xf64>) -> tensor<1x1xf64>
    rel.yield_derivative %n : tensor<1x1xf64> gradient %x : tensor<3x1xf64> hessian %h : tensor<3x3xf64> wrt %x : tensor<3x1xf64>
  }
  rel.derivative @m.v.g.derivative of @m.v.g on @m.v projection "clamp" {
    %x = rel.data @m.v.x : tensor<3x1xf64>
    %y = mat.constant {value = dense<[[1.0], [2.0], [3.0]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
    %n = mat.dot %x, %y : (tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<1x1xf64>
    rel.yield_derivative %n : tensor<1x1xf64> gradient %y : tensor<3x1xf64> wrt %x : tensor<3x1xf64>
  }
}

// CHECK:       rel.derivative @m.v.e.derivative {{.*}} projection "abs" projects "2x2 of 3x3: the energy reads its
// CHECK:         [[L:%.+]] = mat.constant {{.*}} -> tensor<2x3xf64>
// CHECK:         [[N:%.+]] = mat.norm
// CHECK-NEXT:    [[S:%.+]] = mat.scale
// CHECK-NEXT:    [[H:%.+]] = mat.congruence [[S]], [[L]]
// CHECK-NEXT:    [[G:%.+]] = mat.matmul [[H]], %x
// CHECK-NEXT:    [[P:%.+]] = mat.project_psd [[S]] {mode = "abs"} : (tensor<2x2xf64>) -> tensor<2x2xf64>
// CHECK-NEXT:    [[Q:%.+]] = mat.congruence [[P]], [[L]] : (tensor<2x2xf64>, tensor<2x3xf64>) -> tensor<3x3xf64>
// CHECK-NEXT:    rel.yield_derivative [[N]] : tensor<1x1xf64> gradient [[G]] : tensor<3x1xf64> hessian [[Q]] : tensor<3x3xf64>
// CHECK:       rel.derivative @m.v.f.derivative {{.*}} projects "nowhere: switched off" {
// CHECK-NOT:     mat.project_psd
// CHECK:       rel.derivative @m.v.g.derivative {{.*}} projects "nowhere: the energy is affine, its Hessian is zero" {
// CHECK-NOT:     mat.project_psd
