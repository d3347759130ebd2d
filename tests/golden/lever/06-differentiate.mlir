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
    rel.jacobian @m.tips.x.jacobian of @m.tips.x on @m.tips {
      %0 = rel.join @m.arms.angle through @m.tips.arm : 1x1
      %1 = mat.sin %0 : 1x1
      %length = rel.data @m.tips.length : 1x1
      %2 = mat.scale %length, %1 : 1x1
      %3 = mat.cos %0 : 1x1
      %4 = mat.scale %length, %3 : 1x1
      %5 = mat.concat_rows %4, %2 : 2x1
      %6 = mat.constant 1.0 : 1x1
      %7 = mat.neg %1 : 1x1
      %8 = mat.scale %length, %7 : 1x1
      %9 = mat.concat_rows %8, %4 : 2x1
      rel.yield_jacobian %9 wrt %0
    }
    rel.curvature @m.tips.x.curvature of @m.tips.x on @m.tips {
    ^bb0(%0: tensor<2x1xf64>):
      %1 = rel.join @m.arms.angle through @m.tips.arm : 1x1
      %2 = mat.sin %1 : 1x1
      %length = rel.data @m.tips.length : 1x1
      %3 = mat.scale %length, %2 : 1x1
      %4 = mat.cos %1 : 1x1
      %5 = mat.scale %length, %4 : 1x1
      %6 = mat.concat_rows %5, %3 : 2x1
      %7 = mat.block %0[0, 0] : 1x1
      %8 = mat.block %0[1, 0] : 1x1
      %9 = mat.scale %7, %4 : 1x1
      %10 = mat.scale %length, %7 : 1x1
      %11 = mat.neg %2 : 1x1
      %12 = mat.scale %11, %10 : 1x1
      %13 = mat.scale %8, %2 : 1x1
      %14 = mat.scale %length, %8 : 1x1
      %15 = mat.scale %4, %14 : 1x1
      %16 = mat.add %12, %15 : 1x1
      %17 = mat.constant 0.0 : 1x1
      %18 = mat.constant 1.0 : 1x1
      %19 = mat.scale %11, %14 : 1x1
      %20 = mat.neg %4 : 1x1
      %21 = mat.scale %20, %10 : 1x1
      %22 = mat.add %21, %19 : 1x1
      rel.yield_curvature %22 wrt %1
    }
    rel.derivative @m.springs.stretch.derivative of @m.springs.stretch on @m.springs projection "clamp" curved {
      %0 = rel.join @m.tips.x through @m.springs.ends : 2x2
      %1 = mat.block %0[0, 0] : 1x2
      %2 = mat.block %0[1, 0] : 1x2
      %3 = mat.sub %2, %1 : 1x2
      %4 = mat.dot %3, %3 : 1x1
      %5 = mat.constant 0.5 : 1x1
      %6 = mat.scale %5, %4 : 1x1
      %7 = mat.constant 1.0 : 1x1
      %8 = mat.constant 2.0 : 1x1
      %9 = mat.constant 0.0 : 1x2
      %10 = mat.constant [[1.0, 0.0]] : 1x2
      %11 = mat.constant [[0.0, 1.0]] : 1x2
      %12 = mat.constant [[1.0], [0.0]] : 2x1
      %13 = mat.constant [[0.0], [1.0]] : 2x1
      %14 = mat.constant [[1.0, 0.0], [0.0, 1.0]] : 2x2
      %15 = mat.constant [[1.0, 0.0], [0.0, 0.0]] : 2x2
      %16 = mat.constant [[0.0, 1.0], [0.0, 0.0]] : 2x2
      %17 = mat.constant [[0.0, 0.0], [1.0, 0.0]] : 2x2
      %18 = mat.constant [[0.0, 0.0], [0.0, 1.0]] : 2x2
      %19 = mat.constant [[-1.0, 0.0]] : 1x2
      %20 = mat.constant [[-1.0], [0.0]] : 2x1
      %21 = mat.constant [[0.0, -1.0]] : 1x2
      %22 = mat.constant [[0.0], [-1.0]] : 2x1
      %23 = mat.constant [[-1.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0]] : 2x4
      %24 = mat.constant [[1.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0], [-1.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0]] : 4x4
      %25 = mat.neg %3 : 1x2
      %26 = mat.embed %3[1, 0] : 2x2
      %27 = mat.embed %25[0, 0] : 2x2
      %28 = mat.add %26, %27 : 2x2
      %29 = mat.reshape %28 : 4x1
      rel.yield_derivative %6 gradient %29 hessian %24 cut %3 wrt %0
    }
  }
}
