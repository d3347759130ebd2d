builtin.module {
  rel.scene @lever {
    rel.mesh @m in @lever
    rel.primitive @m.springs in @m size 1
    rel.primitive @m.tips in @m size 2
    rel.primitive @m.arms in @m size 2
    rel.connectivity @m.tips.arm from @m.tips to @m.arms arity 1
    rel.connectivity @m.springs.ends from @m.springs to @m.tips arity 2
    rel.storage @m.arms.angle on @m.arms : 1x1
    rel.storage @m.tips.length on @m.tips : 1x1 constant
    rel.attribute @m.tips.x on @m.tips : 2x1 {
      %angle = rel.join @m.arms.angle through @m.tips.arm : 1x1
      %sin_angle = mat.sin %angle : 1x1
      %length = rel.data @m.tips.length : 1x1
      %0 = mat.scale %length, %sin_angle : 1x1
      %cos_angle = mat.cos %angle : 1x1
      %1 = mat.scale %length, %cos_angle : 1x1
      %x = mat.concat_rows %1, %0 : 2x1
      rel.yield %x
    }
    rel.attribute @m.springs.stretch on @m.springs : 1x1 {
      %pair = rel.join @m.tips.x through @m.springs.ends : 2x2
      %pair_row0 = mat.block %pair[0, 0] : 1x2
      %pair_row1 = mat.block %pair[1, 0] : 1x2
      %0 = mat.sub %pair_row1, %pair_row0 : 1x2
      %1 = mat.dot %0, %0 : 1x1
      %half = mat.constant 0.5 : 1x1
      %stretch = mat.scale %half, %1 : 1x1
      rel.yield %stretch
    }
    rel.energy @m.springs.stretch projection "clamp"
    rel.target @m.arms.angle
  }
}
