// RUN: yasps-opt -p differentiate,infer-indices %s | filecheck %s
// Placement indices: a target's own, none for a constant, the branch's for a union, gathered by a JOIN.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.a in @m size 2 : i64
  rel.primitive @m.b in @m size 3 : i64
  rel.primitive_union @m.u in @m of [@m.a, @m.b]
  rel.primitive @m.p in @m dynamic
  rel.connectivity @m.p.ends from @m.p to @m.u arity 2 : i64
  rel.storage @m.a.x on @m.a : tensor<3x1xf64>
  rel.storage @m.b.x on @m.b : tensor<3x1xf64> constant
  rel.attribute @m.u.x on @m.u : tensor<3x1xf64> {
    %x = rel.union [@m.a.x, @m.b.x] : tensor<3x1xf64>
    rel.yield %x : tensor<3x1xf64>
  }
  rel.attribute @m.p.e on @m.p : tensor<1x1xf64> {
    %x = rel.join @m.u.x through @m.p.ends : tensor<2x3xf64>
    %e = mat.dot %x, %x : (tensor<2x3xf64>, tensor<2x3xf64>) -> tensor<1x1xf64>
    rel.yield %e : tensor<1x1xf64>
  }
  rel.energy @m.p.e projection "none" dynamic
  rel.target @m.a.x
}

// CHECK:       rel.derivative @m.p.e.derivative of @m.p.e on @m.p projection "none" dynamic indices @m.p.e.kappa {
// CHECK:       rel.attribute @m.a.x.kappa on @m.a : tensor<1x1xi32> {
// CHECK-NEXT:    [[A:%.+]] = rel.target_index @m.a.x : tensor<1x1xi32>
// CHECK:       rel.attribute @m.b.x.kappa on @m.b : tensor<1x1xi32> {
// CHECK-NEXT:    [[B:%.+]] = mat.constant {value = dense<0> : tensor<1x1xi32>}
// CHECK:       rel.attribute @m.u.x.kappa on @m.u : tensor<1x1xi32> {
// CHECK-NEXT:    [[U:%.+]] = rel.union [@m.a.x.kappa, @m.b.x.kappa] : tensor<1x1xi32>
// CHECK:       rel.attribute @m.p.e.kappa on @m.p : tensor<1x2xi32> {
// CHECK-NEXT:    [[J:%.+]] = rel.join @m.u.x.kappa through @m.p.ends : tensor<2x1xi32>
// CHECK-NEXT:    [[R:%.+]] = mat.reshape [[J]] {shape = array<i64: 1, 2>} : (tensor<2x1xi32>) -> tensor<1x2xi32>
// CHECK-NEXT:    rel.yield [[R]] : tensor<1x2xi32>
