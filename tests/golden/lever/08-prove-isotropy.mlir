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
    rel.jacobian @m.tips.x.jacobian of @m.tips.x on @m.tips {
      %0 = rel.join @m.arms.angle through @m.tips.arm : tensor<1x1xf64>
      %1 = mat.sin %0 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %length = rel.data @m.tips.length : tensor<1x1xf64>
      %2 = mat.scale %length, %1 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %3 = mat.cos %0 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %4 = mat.scale %length, %3 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %5 = mat.concat_rows %4, %2 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<2x1xf64>
      %6 = mat.constant {value = dense<1.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %7 = mat.neg %1 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %8 = mat.scale %length, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %9 = mat.concat_rows %8, %4 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<2x1xf64>
      rel.yield_jacobian %9 : tensor<2x1xf64> wrt %0 : tensor<1x1xf64>
    }
    rel.curvature @m.tips.x.curvature of @m.tips.x on @m.tips {
    ^bb0(%0: tensor<2x1xf64>):
      %1 = rel.join @m.arms.angle through @m.tips.arm : tensor<1x1xf64>
      %2 = mat.sin %1 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %length = rel.data @m.tips.length : tensor<1x1xf64>
      %3 = mat.scale %length, %2 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %4 = mat.cos %1 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %5 = mat.scale %length, %4 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %6 = mat.concat_rows %5, %3 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<2x1xf64>
      %7 = mat.block %0 {block = array<i64: 0, 0, 1, 1>} : (tensor<2x1xf64>) -> tensor<1x1xf64>
      %8 = mat.block %0 {block = array<i64: 1, 0, 1, 1>} : (tensor<2x1xf64>) -> tensor<1x1xf64>
      %9 = mat.scale %7, %4 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %10 = mat.scale %length, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %11 = mat.neg %2 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %12 = mat.scale %11, %10 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %13 = mat.scale %8, %2 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %14 = mat.scale %length, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %15 = mat.scale %4, %14 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %16 = mat.add %12, %15 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %17 = mat.constant {value = dense<0.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %18 = mat.constant {value = dense<1.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %19 = mat.scale %11, %14 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %20 = mat.neg %4 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %21 = mat.scale %20, %10 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %22 = mat.add %21, %19 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      rel.yield_curvature %22 : tensor<1x1xf64> wrt %1 : tensor<1x1xf64>
    }
    rel.derivative @m.springs.stretch.derivative of @m.springs.stretch on @m.springs projection "clamp" curved projects "the whole local Hessian, expanded to the targets: an input is nonlinear in them" {
      %0 = rel.join @m.tips.x through @m.springs.ends : tensor<2x2xf64>
      %1 = mat.block %0 {block = array<i64: 0, 0, 1, 2>} : (tensor<2x2xf64>) -> tensor<1x2xf64>
      %2 = mat.block %0 {block = array<i64: 1, 0, 1, 2>} : (tensor<2x2xf64>) -> tensor<1x2xf64>
      %3 = mat.sub %2, %1 : (tensor<1x2xf64>, tensor<1x2xf64>) -> tensor<1x2xf64>
      %4 = mat.dot %3, %3 : (tensor<1x2xf64>, tensor<1x2xf64>) -> tensor<1x1xf64>
      %5 = mat.constant {value = dense<5.000000e-01> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %6 = mat.scale %5, %4 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %7 = mat.constant {value = dense<1.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %8 = mat.constant {value = dense<2.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %9 = mat.constant {value = dense<0.000000e+00> : tensor<1x2xf64>} : () -> tensor<1x2xf64>
      %10 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00]]> : tensor<1x2xf64>} : () -> tensor<1x2xf64>
      %11 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00]]> : tensor<1x2xf64>} : () -> tensor<1x2xf64>
      %12 = mat.constant {value = dense<[[1.000000e+00], [0.000000e+00]]> : tensor<2x1xf64>} : () -> tensor<2x1xf64>
      %13 = mat.constant {value = dense<[[0.000000e+00], [1.000000e+00]]> : tensor<2x1xf64>} : () -> tensor<2x1xf64>
      %14 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00]]> : tensor<2x2xf64>} : () -> tensor<2x2xf64>
      %15 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00]]> : tensor<2x2xf64>} : () -> tensor<2x2xf64>
      %16 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00]]> : tensor<2x2xf64>} : () -> tensor<2x2xf64>
      %17 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00]]> : tensor<2x2xf64>} : () -> tensor<2x2xf64>
      %18 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00]]> : tensor<2x2xf64>} : () -> tensor<2x2xf64>
      %19 = mat.constant {value = dense<[[-1.000000e+00, 0.000000e+00]]> : tensor<1x2xf64>} : () -> tensor<1x2xf64>
      %20 = mat.constant {value = dense<[[-1.000000e+00], [0.000000e+00]]> : tensor<2x1xf64>} : () -> tensor<2x1xf64>
      %21 = mat.constant {value = dense<[[0.000000e+00, -1.000000e+00]]> : tensor<1x2xf64>} : () -> tensor<1x2xf64>
      %22 = mat.constant {value = dense<[[0.000000e+00], [-1.000000e+00]]> : tensor<2x1xf64>} : () -> tensor<2x1xf64>
      %23 = mat.constant {value = dense<[[-1.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, -1.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<2x4xf64>} : () -> tensor<2x4xf64>
      %24 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, -1.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00, -1.000000e+00], [-1.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, -1.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<4x4xf64>} : () -> tensor<4x4xf64>
      %25 = mat.neg %3 : (tensor<1x2xf64>) -> tensor<1x2xf64>
      %26 = mat.embed %3 {place = array<i64: 1, 0, 2, 2>} : (tensor<1x2xf64>) -> tensor<2x2xf64>
      %27 = mat.embed %25 {place = array<i64: 0, 0, 2, 2>} : (tensor<1x2xf64>) -> tensor<2x2xf64>
      %28 = mat.add %26, %27 : (tensor<2x2xf64>, tensor<2x2xf64>) -> tensor<2x2xf64>
      %29 = mat.reshape %28 {shape = array<i64: 4, 1>} : (tensor<2x2xf64>) -> tensor<4x1xf64>
      rel.yield_derivative %6 : tensor<1x1xf64> gradient %29 : tensor<4x1xf64> hessian %24 : tensor<4x4xf64> wrt %0 : tensor<2x2xf64>
    }
  }
}
