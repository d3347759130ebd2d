// RUN: yasps-opt --verify-diagnostics -p inline-references,differentiate %s | filecheck %s
// What has no derivative rule is refused, with the pass, the attribute and the line that made it.

rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 2
  rel.storage @m.v.x on @m.v : 2x2
  rel.attribute @m.v.e on @m.v : 1x1 {
    %x = rel.data @m.v.x : 2x2
    %p = mat.project_psd %x mode "clamp" : 2x2
    %d = mat.det %p : 1x1
    rel.yield %d
  } loc("bridge.py":12:0)
  rel.energy @m.v.e projection "clamp"
  rel.target @m.v.x
}

// CHECK:     pass differentiate: @m.v.e (made at bridge.py:12): mat.project_psd has no derivative rule
// CHECK-NOT: rel.scene
