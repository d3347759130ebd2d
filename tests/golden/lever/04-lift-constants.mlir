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
      %0 = rel.join @m.arms.angle through @m.tips.arm : 1x1
      %1 = mat.sin %0 : 1x1
      %length = rel.data @m.tips.length : 1x1
      %2 = mat.scale %length, %1 : 1x1
      %3 = mat.cos %0 : 1x1
      %4 = mat.scale %length, %3 : 1x1
      %5 = mat.concat_rows %4, %2 : 2x1
      rel.yield %5
    }
    rel.attribute @m.springs.stretch on @m.springs : 1x1 {
      %0 = rel.join @m.tips.x through @m.springs.ends : 2x2
      %1 = mat.block %0[0, 0] : 1x2
      %2 = mat.block %0[1, 0] : 1x2
      %3 = mat.sub %2, %1 : 1x2
      %4 = mat.dot %3, %3 : 1x1
      %5 = mat.constant 0.5 : 1x1
      %6 = mat.scale %5, %4 : 1x1
      rel.yield %6
    }
    rel.energy @m.springs.stretch projection "clamp"
    rel.target @m.arms.angle
  }
}
