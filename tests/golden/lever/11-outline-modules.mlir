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
    rel.attribute @m.tips.x on @m.tips : 2x1
    rel.attribute @m.springs.stretch on @m.springs : 1x1
    rel.energy @m.springs.stretch projection "clamp"
    rel.target @m.arms.angle
    rel.attribute @m.arms.angle.kappa on @m.arms : 1x1xi32
    rel.attribute @m.tips.x.kappa on @m.tips : 1x1xi32
    rel.attribute @m.springs.stretch.kappa on @m.springs : 1x2xi32
  }
  rel.object @m.tips.x.object entries ["call"] {
    rel.attribute @m.tips.x on @m.tips : 2x1 {
      %angle = rel.join @m.arms.angle through @m.tips.arm : 1x1
      %length = rel.data @m.tips.length : 1x1
      %0 = rel.apply @m.tips.x.value(%angle, %length) : 2x1
      rel.yield %0
    }
    func.func @m.tips.x.value(%0: f64, %1: f64) -> (f64, f64) {
      %2 = math.sin %0 : f64
      %3 = arith.mulf %1, %2 : f64
      %4 = math.cos %0 : f64
      %5 = arith.mulf %1, %4 : f64
      func.return %5, %3 : f64, f64
    }
  }
  rel.object @m.springs.stretch.object entries ["batch"] {
    rel.attribute @m.springs.stretch on @m.springs : 1x1 {
      %pair = rel.join @m.tips.x through @m.springs.ends : 2x2
      %0 = rel.apply @m.springs.stretch.value(%pair) : 1x1
      rel.yield %0
    }
    func.func @m.springs.stretch.value(%0: f64, %1: f64, %2: f64, %3: f64) -> f64 {
      %4 = arith.subf %0, %2 : f64
      %5 = arith.subf %1, %3 : f64
      %6 = arith.mulf %4, %4 : f64
      %7 = arith.mulf %5, %5 : f64
      %8 = arith.addf %6, %7 : f64
      %9 = arith.constant 5.000000e-01 : f64
      %10 = arith.mulf %9, %8 : f64
      func.return %10 : f64
    }
  }
  rel.object @m.tips.x.jacobian.object entries ["call"] {
    rel.jacobian @m.tips.x.jacobian of @m.tips.x on @m.tips indices @m.tips.x.kappa {
    ^bb0(%cotangent: tensor<2x1xf64>):
      %angle = rel.join @m.arms.angle through @m.tips.arm : 1x1
      %length = rel.data @m.tips.length : 1x1
      %0 = rel.apply @m.tips.x.pull_back(%angle, %length, %cotangent) : 1x1
      rel.yield_pullback %0 wrt %angle
    }
    func.func @m.tips.x.pull_back(%0: f64, %1: f64, %2: f64, %3: f64) -> f64 {
      %4 = math.cos %0 : f64
      %5 = arith.mulf %1, %4 : f64
      %6 = math.sin %0 : f64
      %7 = arith.mulf %1, %6 : f64
      %8 = arith.mulf %2, %7 : f64
      %9 = arith.mulf %3, %5 : f64
      %10 = arith.subf %9, %8 : f64
      func.return %10 : f64
    }
  }
  rel.object @m.tips.x.curvature.object entries ["call"] {
    rel.curvature @m.tips.x.curvature of @m.tips.x on @m.tips {
    ^bb0(%cotangent: tensor<2x1xf64>):
      %angle = rel.join @m.arms.angle through @m.tips.arm : 1x1
      %length = rel.data @m.tips.length : 1x1
      %0 = rel.apply @m.tips.x.second(%angle, %length, %cotangent) : 1x1
      rel.yield_curvature %0 wrt %angle
    }
    func.func @m.tips.x.second(%0: f64, %1: f64, %2: f64, %3: f64) -> f64 {
      %4 = arith.mulf %1, %3 : f64
      %5 = math.sin %0 : f64
      %6 = arith.mulf %4, %5 : f64
      %7 = arith.mulf %1, %2 : f64
      %8 = math.cos %0 : f64
      %9 = arith.mulf %7, %8 : f64
      %10 = arith.addf %6, %9 : f64
      %11 = arith.negf %10 : f64
      func.return %11 : f64
    }
  }
  rel.object @m.springs.stretch.derivative.object entries ["batch"] {
    // energy @m.springs.stretch of pair 2x2; projection clamp the whole local Hessian, expanded to the targets; operations: derive 8
    rel.derivative @m.springs.stretch.derivative of @m.springs.stretch on @m.springs projection "clamp" curved indices @m.springs.stretch.kappa projects "the whole local Hessian, expanded to the targets: an input is nonlinear in them" {
      %pair = rel.join @m.tips.x through @m.springs.ends : 2x2
      %energy, %gradient, %hessian = rel.apply @m.springs.stretch.derive(%pair) : 1x1, 4x1, 10x1
      rel.yield_derivative %energy gradient %gradient hessian %hessian wrt %pair
    }
    func.func @m.springs.stretch.derive(%0: f64, %1: f64, %2: f64, %3: f64) -> (f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64) {
      %4 = arith.constant 0.000000e+00 : f64
      %5 = arith.constant 1.000000e+00 : f64
      %6 = arith.subf %0, %2 : f64
      %7 = arith.subf %1, %3 : f64
      %8 = arith.constant -1.000000e+00 : f64
      %9 = arith.mulf %6, %6 : f64
      %10 = arith.mulf %7, %7 : f64
      %11 = arith.addf %9, %10 : f64
      %12 = arith.constant 5.000000e-01 : f64
      %13 = arith.mulf %12, %11 : f64
      %14 = arith.negf %6 : f64
      %15 = arith.negf %7 : f64
      func.return %13, %6, %7, %14, %15, %5, %4, %8, %4, %5, %4, %8, %5, %4, %5 : f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64
    }
  }
  rel.object @m.arms.angle.kappa.object entries ["call"] {
    rel.attribute @m.arms.angle.kappa on @m.arms : 1x1xi32 {
      %index_of_angle = rel.target_index @m.arms.angle : 1x1xi32
      rel.yield %index_of_angle
    }
  }
  rel.object @m.tips.x.kappa.object entries ["call"] {
    rel.attribute @m.tips.x.kappa on @m.tips : 1x1xi32 {
      %angle_kappa_at_arm = rel.join_indices @m.arms.angle.kappa through @m.tips.arm : 1x1xi32
      rel.yield %angle_kappa_at_arm
    }
  }
  rel.object @m.springs.stretch.kappa.object entries ["batch"] {
    rel.attribute @m.springs.stretch.kappa on @m.springs : 1x2xi32 {
      %x_kappa_at_ends = rel.join_indices @m.tips.x.kappa through @m.springs.ends : 2x1xi32
      %0 = rel.apply @m.springs.stretch.kappa.value(%x_kappa_at_ends) : 1x2xi32
      rel.yield %0
    }
    func.func @m.springs.stretch.kappa.value(%0: i32, %1: i32) -> (i32, i32) {
      func.return %0, %1 : i32, i32
    }
  }
}
