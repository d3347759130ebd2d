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
      %angle = rel.join @m.arms.angle through @m.tips.arm : 1x1
      %sin_angle = mat.sin %angle : 1x1
      %length = rel.data @m.tips.length : 1x1
      %0 = mat.scale %length, %sin_angle : 1x1
      %cos_angle = mat.cos %angle : 1x1
      %1 = mat.scale %length, %cos_angle : 1x1
      %x = mat.concat_rows %1, %0 : 2x1
      rel.yield %x
    }
    rel.attribute @m.springs.stretch on @m.springs : 1x1 {
      %pair = rel.join @m.tips.x through @m.springs.ends : 2x2
      %pair_row0 = mat.block %pair[0, 0] : 1x2
      %pair_row1 = mat.block %pair[1, 0] : 1x2
      %0 = mat.sub %pair_row1, %pair_row0 : 1x2
      %1 = mat.dot %0, %0 : 1x1
      %half = mat.constant 0.5 : 1x1
      %stretch = mat.scale %half, %1 : 1x1
      rel.yield %stretch
    }
    rel.energy @m.springs.stretch projection "clamp"
    rel.target @m.arms.angle
    rel.jacobian @m.tips.x.jacobian of @m.tips.x on @m.tips {
      %angle = rel.join @m.arms.angle through @m.tips.arm : 1x1
      %sin_angle = mat.sin %angle : 1x1
      %length = rel.data @m.tips.length : 1x1
      %0 = mat.scale %length, %sin_angle : 1x1
      %cos_angle = mat.cos %angle : 1x1
      %1 = mat.scale %length, %cos_angle : 1x1
      %x = mat.concat_rows %1, %0 : 2x1
      %c1 = mat.constant 1.0 : 1x1
      %minus_sin_angle = mat.neg %sin_angle : 1x1
      %2 = mat.scale %length, %minus_sin_angle : 1x1
      %3 = mat.concat_rows %2, %1 : 2x1
      rel.yield_jacobian %3 wrt %angle
    }
    rel.curvature @m.tips.x.curvature of @m.tips.x on @m.tips {
    ^bb0(%cotangent: tensor<2x1xf64>):
      %angle = rel.join @m.arms.angle through @m.tips.arm : 1x1
      %sin_angle = mat.sin %angle : 1x1
      %length = rel.data @m.tips.length : 1x1
      %0 = mat.scale %length, %sin_angle : 1x1
      %cos_angle = mat.cos %angle : 1x1
      %1 = mat.scale %length, %cos_angle : 1x1
      %x = mat.concat_rows %1, %0 : 2x1
      %cotangent_row0 = mat.block %cotangent[0, 0] : 1x1
      %cotangent_row1 = mat.block %cotangent[1, 0] : 1x1
      %2 = mat.scale %cotangent_row0, %cos_angle : 1x1
      %3 = mat.scale %length, %cotangent_row0 : 1x1
      %minus_sin_angle = mat.neg %sin_angle : 1x1
      %4 = mat.scale %minus_sin_angle, %3 : 1x1
      %5 = mat.scale %cotangent_row1, %sin_angle : 1x1
      %6 = mat.scale %length, %cotangent_row1 : 1x1
      %7 = mat.scale %cos_angle, %6 : 1x1
      %8 = mat.add %4, %7 : 1x1
      %c0 = mat.constant 0.0 : 1x1
      %c1 = mat.constant 1.0 : 1x1
      %9 = mat.scale %minus_sin_angle, %6 : 1x1
      %minus_cos_angle = mat.neg %cos_angle : 1x1
      %10 = mat.scale %minus_cos_angle, %3 : 1x1
      %11 = mat.add %10, %9 : 1x1
      rel.yield_curvature %11 wrt %angle
    }
    // energy @m.springs.stretch of pair 2x2; cut cut 1x2; projection clamp; operations: on matrices 10
    rel.derivative @m.springs.stretch.derivative of @m.springs.stretch on @m.springs projection "clamp" curved {
      %pair = rel.join @m.tips.x through @m.springs.ends : 2x2
      %pair_row0 = mat.block %pair[0, 0] : 1x2
      %pair_row1 = mat.block %pair[1, 0] : 1x2
      %cut = mat.sub %pair_row1, %pair_row0 : 1x2
      %0 = mat.dot %cut, %cut : 1x1
      %half = mat.constant 0.5 : 1x1
      %stretch = mat.scale %half, %0 : 1x1
      %c1 = mat.constant 1.0 : 1x1
      %c2 = mat.constant 2.0 : 1x1
      %zero = mat.constant 0.0 : 1x2
      %1 = mat.constant [[1.0, 0.0]] : 1x2
      %2 = mat.constant [[0.0, 1.0]] : 1x2
      %3 = mat.constant [[1.0], [0.0]] : 2x1
      %4 = mat.constant [[0.0], [1.0]] : 2x1
      %hessian_of_cut = mat.constant [[1.0, 0.0], [0.0, 1.0]] : 2x2
      %5 = mat.constant [[1.0, 0.0], [0.0, 0.0]] : 2x2
      %6 = mat.constant [[0.0, 1.0], [0.0, 0.0]] : 2x2
      %7 = mat.constant [[0.0, 0.0], [1.0, 0.0]] : 2x2
      %8 = mat.constant [[0.0, 0.0], [0.0, 1.0]] : 2x2
      %9 = mat.constant [[-1.0, -0.0]] : 1x2
      %10 = mat.constant [[-1.0], [-0.0]] : 2x1
      %11 = mat.constant [[-0.0, -1.0]] : 1x2
      %12 = mat.constant [[-0.0], [-1.0]] : 2x1
      %13 = mat.constant [[-1.0, -0.0, 1.0, 0.0], [-0.0, -1.0, 0.0, 1.0]] : 2x4
      %hessian = mat.constant [[1.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0], [-1.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0]] : 4x4
      %minus_cut = mat.neg %cut : 1x2
      %14 = mat.embed %cut[1, 0] : 2x2
      %15 = mat.embed %minus_cut[0, 0] : 2x2
      %16 = mat.add %14, %15 : 2x2
      %gradient = mat.reshape %16 : 4x1
      rel.yield_derivative %stretch gradient %gradient hessian %hessian cut %cut wrt %pair
    }
  }
}
