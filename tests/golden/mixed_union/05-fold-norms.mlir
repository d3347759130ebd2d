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
    rel.storage @both.pp.barrier.numbers on @mixed_union : 2x1 constant numbers 2.5
    rel.attribute @stiff.v.x on @stiff.v : 3x1 {
      %0 = rel.join @stiff.body.t through @stiff.v.owner : 1x3
      %1 = mat.reshape %0 : 3x1
      %rest = rel.data @stiff.v.rest : 3x1
      %2 = rel.join @stiff.body.A through @stiff.v.owner : 1x9
      %3 = mat.reshape %2 : 3x3
      %4 = mat.matmul %3, %rest : 3x1
      %5 = mat.add %4, %1 : 3x1
      rel.yield %5
    }
    rel.attribute @both.v.x on @both.v : 3x1 {
      %0 = rel.union [@soft.v.x, @stiff.v.x, @still.v.x] : 3x1
      rel.yield %0
    }
    rel.attribute @both.pp.barrier on @both.pp : 1x1 {
      %0 = rel.data @both.pp.barrier.numbers : 2x1
      %1 = rel.join @both.v.x through @both.pp.ends : 2x3
      %2 = mat.block %1[0, 0] : 1x3
      %3 = mat.block %1[1, 0] : 1x3
      %4 = mat.sub %3, %2 : 1x3
      %5 = mat.dot %4, %4 : 1x1
      %6 = mat.block %0[0, 0] : 1x1
      %7 = mat.divide %5, %6 : 1x1
      %8 = mat.log %7 : 1x1
      %9 = mat.block %0[1, 0] : 1x1
      %10 = mat.sub %5, %9 : 1x1
      %11 = mat.scale %10, %10 : 1x1
      %12 = mat.scale %11, %8 : 1x1
      %13 = mat.scale %12, %8 : 1x1
      rel.yield %13
    }
    rel.energy @both.pp.barrier projection "clamp" dynamic
    rel.target @soft.v.x
    rel.target @stiff.body.A
    rel.target @stiff.body.t
  }
}
