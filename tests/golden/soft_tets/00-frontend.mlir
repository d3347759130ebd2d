builtin.module {
  rel.scene @soft_tets {
    rel.mesh @m in @soft_tets
    rel.primitive @m.t in @m size 1
    rel.primitive @m.v in @m size 4
    rel.connectivity @m.t.corners from @m.t to @m.v arity 4
    rel.storage @m.v.x on @m.v : 3x1
    rel.storage @m.v.mass on @m.v : 1x1 constant
    rel.attribute @m.t.x on @m.t : 4x3 {
      %x = rel.join @m.v.x through @m.t.corners : 4x3
      rel.yield %x
    }
    rel.attribute @m.t.swell on @m.t : 1x1 {
      %half = mat.constant 0.5 : 1x1
      %x = rel.ref @m.t.x : 4x3
      %x_row0 = mat.block %x[0, 0] : 1x3
      %x_row3 = mat.block %x[3, 0] : 1x3
      %0 = mat.sub %x_row3, %x_row0 : 1x3
      %x_row2 = mat.block %x[2, 0] : 1x3
      %1 = mat.sub %x_row2, %x_row0 : 1x3
      %x_row1 = mat.block %x[1, 0] : 1x3
      %2 = mat.sub %x_row1, %x_row0 : 1x3
      %3 = mat.concat_rows %2, %1, %0 : 3x3
      %4 = mat.det %3 : 1x1
      %5 = mat.sub %4, %half : 1x1
      %c3 = mat.constant 3.0 : 1x1
      %6 = mat.scale %c3, %5 : 1x1
      %swell = mat.scale %6, %5 : 1x1
      rel.yield %swell
    }
    rel.attribute @m.v.gravity on @m.v : 1x1 {
      %x = rel.data @m.v.x : 3x1
      %x_row1 = mat.block %x[1, 0] : 1x1
      %mass = rel.data @m.v.mass : 1x1
      %0 = mat.constant 9.8 : 1x1
      %1 = mat.scale %0, %mass : 1x1
      %gravity = mat.scale %1, %x_row1 : 1x1
      rel.yield %gravity
    }
    rel.energy @m.t.swell projection "clamp"
    rel.energy @m.v.gravity projection "clamp"
    rel.target @m.v.x
  }
}
