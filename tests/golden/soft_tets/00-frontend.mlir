builtin.module {
  rel.scene @soft_tets {
    rel.mesh @m in @soft_tets
    rel.primitive @m.t in @m size 1
    rel.primitive @m.v in @m size 4
    rel.connectivity @m.t.corners from @m.t to @m.v arity 4
    rel.storage @m.v.x on @m.v : 3x1
    rel.storage @m.v.mass on @m.v : 1x1 constant
    rel.attribute @m.t.x on @m.t : 4x3 {
      %0 = rel.join @m.v.x through @m.t.corners : 4x3
      rel.yield %0
    }
    rel.attribute @m.t.swell on @m.t : 1x1 {
      %0 = mat.constant 0.5 : 1x1
      %x = rel.ref @m.t.x : 4x3
      %1 = mat.block %x[0, 0] : 1x3
      %2 = mat.block %x[3, 0] : 1x3
      %3 = mat.sub %2, %1 : 1x3
      %4 = mat.block %x[2, 0] : 1x3
      %5 = mat.sub %4, %1 : 1x3
      %6 = mat.block %x[1, 0] : 1x3
      %7 = mat.sub %6, %1 : 1x3
      %8 = mat.concat_rows %7, %5, %3 : 3x3
      %9 = mat.det %8 : 1x1
      %10 = mat.sub %9, %0 : 1x1
      %11 = mat.constant 3.0 : 1x1
      %12 = mat.scale %11, %10 : 1x1
      %13 = mat.scale %12, %10 : 1x1
      rel.yield %13
    }
    rel.attribute @m.v.gravity on @m.v : 1x1 {
      %x = rel.data @m.v.x : 3x1
      %0 = mat.block %x[1, 0] : 1x1
      %mass = rel.data @m.v.mass : 1x1
      %1 = mat.constant 9.8 : 1x1
      %2 = mat.scale %1, %mass : 1x1
      %3 = mat.scale %2, %0 : 1x1
      rel.yield %3
    }
    rel.energy @m.t.swell projection "clamp"
    rel.energy @m.v.gravity projection "clamp"
    rel.target @m.v.x
  }
}
