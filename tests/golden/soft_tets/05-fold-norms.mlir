builtin.module {
  rel.scene @soft_tets {
    rel.mesh @m in @soft_tets
    rel.primitive @m.t in @m size 1 : i64
    rel.primitive @m.v in @m size 4 : i64
    rel.connectivity @m.t.corners from @m.t to @m.v arity 4 : i64
    rel.storage @m.v.x on @m.v : tensor<3x1xf64>
    rel.storage @m.v.mass on @m.v : tensor<1x1xf64> constant
    rel.storage @m.t.swell.numbers on @soft_tets : tensor<1x1xf64> constant numbers dense<3.000000e+00> : tensor<1x1xf64>
    rel.storage @m.v.gravity.numbers on @soft_tets : tensor<1x1xf64> constant numbers dense<9.800000e+00> : tensor<1x1xf64>
    rel.attribute @m.t.swell on @m.t : tensor<1x1xf64> {
      %0 = rel.data @m.t.swell.numbers : tensor<1x1xf64>
      %1 = rel.join @m.v.x through @m.t.corners : tensor<4x3xf64>
      %2 = mat.block %1 {block = array<i64: 0, 0, 1, 3>} : (tensor<4x3xf64>) -> tensor<1x3xf64>
      %3 = mat.block %1 {block = array<i64: 3, 0, 1, 3>} : (tensor<4x3xf64>) -> tensor<1x3xf64>
      %4 = mat.sub %3, %2 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %5 = mat.block %1 {block = array<i64: 2, 0, 1, 3>} : (tensor<4x3xf64>) -> tensor<1x3xf64>
      %6 = mat.sub %5, %2 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %7 = mat.block %1 {block = array<i64: 1, 0, 1, 3>} : (tensor<4x3xf64>) -> tensor<1x3xf64>
      %8 = mat.sub %7, %2 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %9 = mat.concat_rows %8, %6, %4 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %10 = mat.det %9 : (tensor<3x3xf64>) -> tensor<1x1xf64>
      %11 = mat.constant {value = dense<5.000000e-01> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %12 = mat.sub %10, %11 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %13 = mat.scale %0, %12 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %14 = mat.scale %13, %12 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      rel.yield %14 : tensor<1x1xf64>
    }
    rel.attribute @m.v.gravity on @m.v : tensor<1x1xf64> {
      %0 = rel.data @m.v.gravity.numbers : tensor<1x1xf64>
      %x = rel.data @m.v.x : tensor<3x1xf64>
      %1 = mat.block %x {block = array<i64: 1, 0, 1, 1>} : (tensor<3x1xf64>) -> tensor<1x1xf64>
      %mass = rel.data @m.v.mass : tensor<1x1xf64>
      %2 = mat.scale %0, %mass : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %3 = mat.scale %2, %1 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      rel.yield %3 : tensor<1x1xf64>
    }
    rel.energy @m.t.swell projection "clamp"
    rel.energy @m.v.gravity projection "clamp"
    rel.target @m.v.x
  }
}
