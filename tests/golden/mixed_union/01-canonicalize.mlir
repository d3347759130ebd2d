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
      %0 = rel.join @stiff.body.t through @stiff.v.owner : 1x3
      rel.yield %0
    }
    rel.attribute @stiff.v.A on @stiff.v : 1x9 {
      %0 = rel.join @stiff.body.A through @stiff.v.owner : 1x9
      rel.yield %0
    }
    rel.attribute @stiff.v.x on @stiff.v : 3x1 {
      %t = rel.ref @stiff.v.t : 1x3
      %0 = mat.reshape %t : 3x1
      %rest = rel.data @stiff.v.rest : 3x1
      %A = rel.ref @stiff.v.A : 1x9
      %1 = mat.reshape %A : 3x3
      %2 = mat.matmul %1, %rest : 3x1
      %3 = mat.add %2, %0 : 3x1
      rel.yield %3
    }
    rel.attribute @both.v.x on @both.v : 3x1 {
      %0 = rel.union [@soft.v.x, @stiff.v.x, @still.v.x] : 3x1
      rel.yield %0
    }
    rel.attribute @both.pp.pair on @both.pp : 2x3 {
      %0 = rel.join @both.v.x through @both.pp.ends : 2x3
      rel.yield %0
    }
    rel.attribute @both.pp.barrier on @both.pp : 1x1 {
      %0 = mat.constant 2.5 : 1x1
      %pair = rel.ref @both.pp.pair : 2x3
      %1 = mat.block %pair[0, 0] : 1x3
      %2 = mat.block %pair[1, 0] : 1x3
      %3 = mat.sub %2, %1 : 1x3
      %4 = mat.dot %3, %3 : 1x1
      %5 = mat.divide %4, %0 : 1x1
      %6 = mat.log %5 : 1x1
      %7 = mat.sub %4, %0 : 1x1
      %8 = mat.scale %7, %7 : 1x1
      %9 = mat.scale %8, %6 : 1x1
      %10 = mat.scale %9, %6 : 1x1
      rel.yield %10
    }
    rel.energy @both.pp.barrier projection "clamp" dynamic
    rel.target @soft.v.x
    rel.target @stiff.body.A
    rel.target @stiff.body.t
  }
}
