// RUN: yasps-opt -p differentiate,project-psd,prove-isotropy,infer-indices,lower-to-scalar %s | filecheck %s
// f is isotropic in the 3x3 matrix it reads, whose projection is told so; g reads an entry of it besides.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 3
  rel.storage @m.v.a on @m.v : 3x3
  rel.attribute @m.v.f on @m.v : 1x1 {
    %a = rel.data @m.v.a : 3x3
    %d = mat.det %a : 1x1
    %n = mat.norm %a : 1x1
    %e = mat.scale %d, %n : 1x1
    rel.yield %e
  }
  rel.attribute @m.v.g on @m.v : 1x1 {
    %a = rel.data @m.v.a : 3x3
    %d = mat.det %a : 1x1
    %b = mat.block %a[0, 0] : 1x1
    %e = mat.scale %d, %b : 1x1
    rel.yield %e
  }
  rel.energy @m.v.f projection "abs"
  rel.energy @m.v.g projection "clamp"
  rel.target @m.v.a
}

// CHECK:       rel.derivative @m.v.f.derivative {{.*}} projects "9x9 of 9x9: no narrower linear cut; by singular values: isotropic in this 3x3 matrix"
// CHECK:         [[A:%.+]] = rel.data @m.v.a : 3x3
// CHECK:         [[G:%.+]], [[S:%.+]], [[F:%.+]] = rel.apply @m.v.f.derive([[A]])
// CHECK-NEXT:    rel.project [[S]] width 9 mode "abs" isotropic in [[F]] : 45x1
// CHECK:       rel.derivative @m.v.g.derivative {{.*}} projects "9x9 of 9x9: no narrower linear cut" {
// CHECK:         [[G:%.+]], [[S:%.+]] = rel.apply @m.v.g.derive
// CHECK-NEXT:    rel.project [[S]] width 9 mode "clamp" : 45x1
