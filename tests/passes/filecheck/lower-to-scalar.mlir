// RUN: yasps-opt -p differentiate,project-psd,lower-to-scalar %s | filecheck %s
// k |x|^2 of a 2-vector: value, gradient and the three entries of its Hessian's upper triangle; the value is checked, too.
// What is made of k alone is the same for all instances.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 3
  rel.storage @m.k on @m : 1x1 constant
  rel.storage @m.v.x on @m.v : 2x1
  rel.attribute @m.v.e on @m.v : 1x1 {
    %k = rel.data @m.k : 1x1
    %x = rel.data @m.v.x : 2x1
    %d = mat.dot %x, %x : 1x1
    %e = mat.scale %k, %d : 1x1
    rel.yield %e
  }
  rel.energy @m.v.e projection "clamp"
  rel.target @m.v.x
}

// CHECK:       rel.attribute @m.v.e on @m.v : 1x1 {
// CHECK:         [[U:%.+]] = rel.apply @m.v.e.value_uniforms(%k) uniform : 1x1
// CHECK-NEXT:    rel.apply @m.v.e.value(%x, [[U]]) : 1x1
// CHECK:       rel.derivative @m.v.e.derivative {{.*}} projects "2x2 of 2x2: no narrower linear cut" {
// CHECK:         [[E:%.+]], [[G:%.+]], [[S:%.+]] = rel.apply @m.v.e.derive({{.*}}) : 1x1, 2x1, 3x1
// CHECK-NEXT:    [[H:%.+]] = rel.project [[S]] width 2 mode "clamp" : 3x1
// CHECK-NEXT:    rel.yield_derivative [[E]] gradient [[G]] hessian [[H]] wrt
// CHECK:       func.func @m.v.e.value([[X:%.+]]: f64, [[Y:%.+]]: f64, [[K:%.+]]: f64) -> f64 {
// CHECK-NEXT:    [[XX:%.+]] = arith.mulf [[X]], [[X]] : f64
// CHECK-NEXT:    [[YY:%.+]] = arith.mulf [[Y]], [[Y]] : f64
// CHECK-NEXT:    [[D:%.+]] = arith.addf [[XX]], [[YY]] : f64
// CHECK-NEXT:    [[E:%.+]] = arith.mulf [[K]], [[D]] : f64
// CHECK-NEXT:    func.return [[E]] : f64
// CHECK:       func.func @m.v.e.derive_uniforms([[A:%.+]]: f64) -> (f64, f64) {
// CHECK-NEXT:    [[TWO:%.+]] = arith.constant 2.000000e+00 : f64
// CHECK-NEXT:    [[B:%.+]] = arith.mulf [[TWO]], [[A]] : f64
// CHECK-NEXT:    func.return [[A]], [[B]] : f64, f64
// CHECK:       func.func @m.v.e.derive(
// CHECK:         [[ZERO:%.+]] = arith.constant 0.000000e+00 : f64
// CHECK:         func.return {{.*}}, {{.*}}, {{.*}}, [[C:%.+]], [[ZERO]], [[C]] : f64, f64, f64, f64, f64, f64
