builtin.module {
  rel.scene @lever {
    rel.mesh @m in @lever
    rel.primitive @m.springs in @m size 1 : i64
    rel.primitive @m.tips in @m size 2 : i64
    rel.primitive @m.arms in @m size 2 : i64
    rel.connectivity @m.tips.arm from @m.tips to @m.arms arity 1 : i64
    rel.connectivity @m.springs.ends from @m.springs to @m.tips arity 2 : i64
    rel.storage @m.arms.angle on @m.arms : tensor<1x1xf64>
    rel.storage @m.tips.length on @m.tips : tensor<1x1xf64> constant
    rel.attribute @m.tips.x on @m.tips : tensor<2x1xf64> {
      %0 = rel.join @m.arms.angle through @m.tips.arm : tensor<1x1xf64>
      %1 = mat.sin %0 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %length = rel.data @m.tips.length : tensor<1x1xf64>
      %2 = mat.scale %length, %1 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %3 = mat.cos %0 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %4 = mat.scale %length, %3 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %5 = mat.concat_rows %4, %2 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<2x1xf64>
      rel.yield %5 : tensor<2x1xf64>
    }
    rel.attribute @m.springs.stretch on @m.springs : tensor<1x1xf64> {
      %0 = rel.join @m.tips.x through @m.springs.ends : tensor<2x2xf64>
      %1 = mat.block %0 {block = array<i64: 0, 0, 1, 2>} : (tensor<2x2xf64>) -> tensor<1x2xf64>
      %2 = mat.block %0 {block = array<i64: 1, 0, 1, 2>} : (tensor<2x2xf64>) -> tensor<1x2xf64>
      %3 = mat.sub %2, %1 : (tensor<1x2xf64>, tensor<1x2xf64>) -> tensor<1x2xf64>
      %4 = mat.dot %3, %3 : (tensor<1x2xf64>, tensor<1x2xf64>) -> tensor<1x1xf64>
      %5 = mat.constant {value = dense<5.000000e-01> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %6 = mat.scale %5, %4 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      rel.yield %6 : tensor<1x1xf64>
    }
    rel.energy @m.springs.stretch projection "clamp"
    rel.target @m.arms.angle
  }
}
