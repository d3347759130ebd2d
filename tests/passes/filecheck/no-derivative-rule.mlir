// RUN: yasps-opt --verify-diagnostics -p inline-references,differentiate %s | filecheck %s
// What has no derivative rule is refused, with the pass, the attribute and the line that made it.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 2 : i64
  rel.storage @m.v.x on @m.v : tensor<2x2xf64>
  rel.attribute @m.v.e on @m.v : tensor<1x1xf64> {
    %x = rel.data @m.v.x : tensor<2x2xf64>
    %p = mat.project_psd %x {mode = "clamp"} : (tensor<2x2xf64>) -> tensor<2x2xf64>
    %d = mat.det %p : (tensor<2x2xf64>) -> tensor<1x1xf64>
    rel.yield %d : tensor<1x1xf64>
  } loc("bridge.py":12:0)
  rel.energy @m.v.e projection "clamp"
  rel.target @m.v.x
}

// CHECK:     pass differentiate: @m.v.e (made at bridge.py:12): mat.project_psd has no derivative rule
// CHECK-NOT: rel.scene
