builtin.module {
  rel.scene @mixed_union {
    rel.mesh @both in @mixed_union
    rel.mesh @soft in @mixed_union
    rel.mesh @stiff in @mixed_union
    rel.mesh @still in @mixed_union
    rel.primitive @both.pp in @both dynamic
    rel.primitive @soft.v in @soft size 1
    rel.primitive @stiff.v in @stiff size 2
    rel.primitive @still.v in @still size 1
    rel.primitive_union @both.v in @both of [@soft.v, @stiff.v, @still.v]
    rel.primitive @stiff.body in @stiff size 1
    rel.connectivity @stiff.v.owner from @stiff.v to @stiff.body arity 1
    rel.connectivity @both.pp.ends from @both.pp to @both.v arity 2
    rel.storage @soft.v.x on @soft.v : 3x1
    rel.storage @stiff.body.t on @stiff.body : 3x1
    rel.storage @stiff.v.rest on @stiff.v : 3x1 constant
    rel.storage @stiff.body.A on @stiff.body : 3x3
    rel.storage @still.v.x on @still.v : 3x1 constant
    rel.attribute @stiff.v.t on @stiff.v : 1x3 {
      %t = rel.join @stiff.body.t through @stiff.v.owner : 1x3
      rel.yield %t
    }
    rel.attribute @stiff.v.A on @stiff.v : 1x9 {
      %A = rel.join @stiff.body.A through @stiff.v.owner : 1x9
      rel.yield %A
    }
    rel.attribute @stiff.v.x on @stiff.v : 3x1 {
      %t = rel.ref @stiff.v.t : 1x3
      %t_flat = mat.reshape %t : 3x1
      %rest = rel.data @stiff.v.rest : 3x1
      %A = rel.ref @stiff.v.A : 1x9
      %0 = mat.reshape %A : 3x3
      %1 = mat.matmul %0, %rest : 3x1
      %x = mat.add %1, %t_flat : 3x1
      rel.yield %x
    }
    rel.attribute @both.v.x on @both.v : 3x1 {
      %x = rel.union [@soft.v.x, @stiff.v.x, @still.v.x] : 3x1
      rel.yield %x
    }
    rel.attribute @both.pp.pair on @both.pp : 2x3 {
      %pair = rel.join @both.v.x through @both.pp.ends : 2x3
      rel.yield %pair
    }
    rel.attribute @both.pp.barrier on @both.pp : 1x1 {
      %0 = mat.constant 2.5 : 1x1
      %pair = rel.ref @both.pp.pair : 2x3
      %pair_row0 = mat.block %pair[0, 0] : 1x3
      %pair_row1 = mat.block %pair[1, 0] : 1x3
      %1 = mat.sub %pair_row1, %pair_row0 : 1x3
      %2 = mat.dot %1, %1 : 1x1
      %3 = mat.divide %2, %0 : 1x1
      %4 = mat.log %3 : 1x1
      %5 = mat.sub %2, %0 : 1x1
      %6 = mat.scale %5, %5 : 1x1
      %7 = mat.scale %6, %4 : 1x1
      %barrier = mat.scale %7, %4 : 1x1
      rel.yield %barrier
    }
    rel.energy @both.pp.barrier projection "clamp" dynamic
    rel.target @soft.v.x
    rel.target @stiff.body.A
    rel.target @stiff.body.t
  }
}
