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
    rel.attribute @m.tips.angle on @m.tips : tensor<1x1xf64> {
      %0 = rel.join @m.arms.angle through @m.tips.arm : tensor<1x1xf64>
      rel.yield %0 : tensor<1x1xf64>
    }
    rel.attribute @m.tips.x on @m.tips : tensor<2x1xf64> {
      %angle = rel.ref @m.tips.angle : tensor<1x1xf64>
      %0 = mat.sin %angle : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %length = rel.data @m.tips.length : tensor<1x1xf64>
      %1 = mat.scale %length, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %2 = mat.cos %angle : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %3 = mat.scale %length, %2 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %4 = mat.concat_rows %3, %1 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<2x1xf64>
      rel.yield %4 : tensor<2x1xf64>
    }
    rel.attribute @m.springs.pair on @m.springs : tensor<2x2xf64> {
      %0 = rel.join @m.tips.x through @m.springs.ends : tensor<2x2xf64>
      rel.yield %0 : tensor<2x2xf64>
    }
    rel.attribute @m.springs.stretch on @m.springs : tensor<1x1xf64> {
      %pair = rel.ref @m.springs.pair : tensor<2x2xf64>
      %0 = mat.block %pair {block = array<i64: 0, 0, 1, 2>} : (tensor<2x2xf64>) -> tensor<1x2xf64>
      %1 = mat.block %pair {block = array<i64: 1, 0, 1, 2>} : (tensor<2x2xf64>) -> tensor<1x2xf64>
      %2 = mat.sub %1, %0 : (tensor<1x2xf64>, tensor<1x2xf64>) -> tensor<1x2xf64>
      %3 = mat.dot %2, %2 : (tensor<1x2xf64>, tensor<1x2xf64>) -> tensor<1x1xf64>
      %4 = mat.constant {value = dense<5.000000e-01> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %5 = mat.scale %4, %3 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      rel.yield %5 : tensor<1x1xf64>
    }
    rel.energy @m.springs.stretch projection "clamp"
    rel.target @m.arms.angle
  }
}
