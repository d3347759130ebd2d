builtin.module {
  rel.scene @mixed_union {
    rel.mesh @both in @mixed_union
    rel.mesh @soft in @mixed_union
    rel.mesh @stiff in @mixed_union
    rel.mesh @still in @mixed_union
    rel.primitive @both.pp in @both dynamic
    rel.primitive @soft.v in @soft size 1 : i64
    rel.primitive @stiff.v in @stiff size 2 : i64
    rel.primitive @still.v in @still size 1 : i64
    rel.primitive_union @both.v in @both of [@soft.v, @stiff.v, @still.v]
    rel.primitive @stiff.body in @stiff size 1 : i64
    rel.connectivity @stiff.v.owner from @stiff.v to @stiff.body arity 1 : i64
    rel.connectivity @both.pp.ends from @both.pp to @both.v arity 2 : i64
    rel.storage @soft.v.x on @soft.v : tensor<3x1xf64>
    rel.storage @stiff.body.t on @stiff.body : tensor<3x1xf64>
    rel.storage @stiff.v.rest on @stiff.v : tensor<3x1xf64> constant
    rel.storage @stiff.body.A on @stiff.body : tensor<3x3xf64>
    rel.storage @still.v.x on @still.v : tensor<3x1xf64> constant
    rel.storage @both.pp.barrier.numbers on @mixed_union : tensor<2x1xf64> constant numbers dense<2.500000e+00> : tensor<2x1xf64>
    rel.attribute @stiff.v.x on @stiff.v : tensor<3x1xf64> {
      %0 = rel.join @stiff.body.t through @stiff.v.owner : tensor<1x3xf64>
      %1 = mat.reshape %0 {shape = array<i64: 3, 1>} : (tensor<1x3xf64>) -> tensor<3x1xf64>
      %rest = rel.data @stiff.v.rest : tensor<3x1xf64>
      %2 = rel.join @stiff.body.A through @stiff.v.owner : tensor<1x9xf64>
      %3 = mat.reshape %2 {shape = array<i64: 3, 3>} : (tensor<1x9xf64>) -> tensor<3x3xf64>
      %4 = mat.matmul %3, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %5 = mat.add %4, %1 : (tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      rel.yield %5 : tensor<3x1xf64>
    }
    rel.attribute @both.v.x on @both.v : tensor<3x1xf64> {
      %0 = rel.union [@soft.v.x, @stiff.v.x, @still.v.x] : tensor<3x1xf64>
      rel.yield %0 : tensor<3x1xf64>
    }
    rel.attribute @both.pp.barrier on @both.pp : tensor<1x1xf64> {
      %0 = rel.data @both.pp.barrier.numbers : tensor<2x1xf64>
      %1 = rel.join @both.v.x through @both.pp.ends : tensor<2x3xf64>
      %2 = mat.block %1 {block = array<i64: 0, 0, 1, 3>} : (tensor<2x3xf64>) -> tensor<1x3xf64>
      %3 = mat.block %1 {block = array<i64: 1, 0, 1, 3>} : (tensor<2x3xf64>) -> tensor<1x3xf64>
      %4 = mat.sub %3, %2 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %5 = mat.dot %4, %4 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x1xf64>
      %6 = mat.block %0 {block = array<i64: 0, 0, 1, 1>} : (tensor<2x1xf64>) -> tensor<1x1xf64>
      %7 = mat.divide %5, %6 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %8 = mat.log %7 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %9 = mat.block %0 {block = array<i64: 1, 0, 1, 1>} : (tensor<2x1xf64>) -> tensor<1x1xf64>
      %10 = mat.sub %5, %9 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %11 = mat.scale %10, %10 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %12 = mat.scale %11, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %13 = mat.scale %12, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      rel.yield %13 : tensor<1x1xf64>
    }
    rel.energy @both.pp.barrier projection "clamp" dynamic
    rel.target @soft.v.x
    rel.target @stiff.body.A
    rel.target @stiff.body.t
  }
}
