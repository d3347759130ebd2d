builtin.module {
  rel.scene @soft_tets {
    rel.mesh @m in @soft_tets
    rel.primitive @m.t in @m size 1
    rel.primitive @m.v in @m size 4
    rel.connectivity @m.t.corners from @m.t to @m.v arity 4
    rel.storage @m.v.x on @m.v : 3x1
    rel.storage @m.v.mass on @m.v : 1x1 constant
    rel.storage @m.t.swell.numbers on @soft_tets : 1x1 constant numbers 3.0
    rel.storage @m.v.gravity.numbers on @soft_tets : 1x1 constant numbers 9.8
    rel.attribute @m.t.swell on @m.t : 1x1 {
      %0 = rel.data @m.t.swell.numbers : 1x1
      %1 = rel.join @m.v.x through @m.t.corners : 4x3
      %2 = mat.block %1[0, 0] : 1x3
      %3 = mat.block %1[3, 0] : 1x3
      %4 = mat.sub %3, %2 : 1x3
      %5 = mat.block %1[2, 0] : 1x3
      %6 = mat.sub %5, %2 : 1x3
      %7 = mat.block %1[1, 0] : 1x3
      %8 = mat.sub %7, %2 : 1x3
      %9 = mat.concat_rows %8, %6, %4 : 3x3
      %10 = mat.det %9 : 1x1
      %11 = mat.constant 0.5 : 1x1
      %12 = mat.sub %10, %11 : 1x1
      %13 = mat.scale %0, %12 : 1x1
      %14 = mat.scale %13, %12 : 1x1
      rel.yield %14
    }
    rel.attribute @m.v.gravity on @m.v : 1x1 {
      %0 = rel.data @m.v.gravity.numbers : 1x1
      %x = rel.data @m.v.x : 3x1
      %1 = mat.block %x[1, 0] : 1x1
      %mass = rel.data @m.v.mass : 1x1
      %2 = mat.scale %0, %mass : 1x1
      %3 = mat.scale %2, %1 : 1x1
      rel.yield %3
    }
    rel.energy @m.t.swell projection "clamp"
    rel.energy @m.v.gravity projection "clamp"
    rel.target @m.v.x
  }
}
