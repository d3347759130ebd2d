// RUN: yasps-opt -p differentiate,project-psd,prove-isotropy,infer-indices,lower-to-scalar %s | filecheck %s
// f is isotropic in the 3x3 matrix it reads, whose projection is told so; g reads an entry of it besides.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 3 : i64
  rel.storage @m.v.a on @m.v : tensor<3x3xf64>
  rel.attribute @m.v.f on @m.v : tensor<1x1xf64> {
    %a = rel.data @m.v.a : tensor<3x3xf64>
    %d = mat.det %a : (tensor<3x3xf64>) -> tensor<1x1xf64>
    %n = mat.norm %a : (tensor<3x3xf64>) -> tensor<1x1xf64>
    %e = mat.scale %d, %n : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
    rel.yield %e : tensor<1x1xf64>
  }
  rel.attribute @m.v.g on @m.v : tensor<1x1xf64> {
    %a = rel.data @m.v.a : tensor<3x3xf64>
    %d = mat.det %a : (tensor<3x3xf64>) -> tensor<1x1xf64>
    %b = mat.block %a {block = array<i64: 0, 0, 1, 1>} : (tensor<3x3xf64>) -> tensor<1x1xf64>
    %e = mat.scale %d, %b : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
    rel.yield %e : tensor<1x1xf64>
  }
  rel.energy @m.v.f projection "abs"
  rel.energy @m.v.g projection "clamp"
  rel.target @m.v.a
}

// CHECK:       rel.derivative @m.v.f.derivative {{.*}} projects "9x9 of 9x9: no narrower linear cut; by singular values: isotropic in this 3x3 matrix"
// CHECK:         [[A:%.+]] = rel.data @m.v.a : tensor<3x3xf64>
// CHECK:         [[G:%.+]], [[S:%.+]], [[F:%.+]] = rel.apply @m.v.f.derive([[A]])
// CHECK-NEXT:    rel.project [[S]] width 9 : i64 mode "abs" isotropic in [[F]] : tensor<9x1xf64> : tensor<45x1xf64>
// CHECK:       rel.derivative @m.v.g.derivative {{.*}} projects "9x9 of 9x9: no narrower linear cut" {
// CHECK:         [[G:%.+]], [[S:%.+]] = rel.apply @m.v.g.derive
// CHECK-NEXT:    rel.project [[S]] width 9 : i64 mode "clamp" : tensor<45x1xf64>
