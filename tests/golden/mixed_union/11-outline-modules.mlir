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
    rel.attribute @stiff.v.x on @stiff.v : 3x1
    rel.attribute @both.v.x on @both.v : 3x1
    rel.attribute @both.pp.barrier on @both.pp : 1x1
    rel.energy @both.pp.barrier projection "clamp" dynamic
    rel.target @soft.v.x
    rel.target @stiff.body.A
    rel.target @stiff.body.t
    rel.attribute @soft.v.x.kappa on @soft.v : 1x1xi32
    rel.attribute @stiff.body.t.kappa on @stiff.body : 1x1xi32
    rel.attribute @stiff.body.A.kappa on @stiff.body : 1x1xi32
    rel.attribute @stiff.v.x.kappa on @stiff.v : 1x2xi32
    rel.attribute @still.v.x.kappa on @still.v : 1x1xi32
    rel.attribute @both.v.x.kappa on @both.v : 1x2xi32
    rel.attribute @both.pp.barrier.kappa on @both.pp : 1x4xi32
  }
  rel.object @stiff.v.x.object entries ["call"] {
    rel.attribute @stiff.v.x on @stiff.v : 3x1 {
      %t = rel.join @stiff.body.t through @stiff.v.owner : 1x3
      %rest = rel.data @stiff.v.rest : 3x1
      %A = rel.join @stiff.body.A through @stiff.v.owner : 1x9
      %0 = rel.apply @stiff.v.x.value(%t, %rest, %A) : 3x1
      rel.yield %0
    }
    func.func @stiff.v.x.value(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64, %6: f64, %7: f64, %8: f64, %9: f64, %10: f64, %11: f64, %12: f64, %13: f64, %14: f64) -> (f64, f64, f64) {
      %15 = arith.mulf %3, %6 : f64
      %16 = arith.mulf %4, %7 : f64
      %17 = arith.mulf %5, %8 : f64
      %18 = arith.mulf %3, %9 : f64
      %19 = arith.mulf %4, %10 : f64
      %20 = arith.mulf %5, %11 : f64
      %21 = arith.mulf %3, %12 : f64
      %22 = arith.mulf %4, %13 : f64
      %23 = arith.mulf %5, %14 : f64
      %24 = arith.addf %0, %17 : f64
      %25 = arith.addf %15, %24 : f64
      %26 = arith.addf %16, %25 : f64
      %27 = arith.addf %1, %20 : f64
      %28 = arith.addf %18, %27 : f64
      %29 = arith.addf %19, %28 : f64
      %30 = arith.addf %2, %23 : f64
      %31 = arith.addf %21, %30 : f64
      %32 = arith.addf %22, %31 : f64
      func.return %26, %29, %32 : f64, f64, f64
    }
  }
  rel.object @both.v.x.object entries ["call"] {
    rel.attribute @both.v.x on @both.v : 3x1 {
      %x = rel.union [@soft.v.x, @stiff.v.x, @still.v.x] : 3x1
      rel.yield %x
    }
  }
  rel.object @both.pp.barrier.object entries ["batch"] {
    rel.attribute @both.pp.barrier on @both.pp : 1x1 {
      %barrier_numbers = rel.data @both.pp.barrier.numbers : 2x1
      %pair = rel.join @both.v.x through @both.pp.ends : 2x3
      %uniforms = rel.apply @both.pp.barrier.value_uniforms(%barrier_numbers) uniform : 2x1
      %0 = rel.apply @both.pp.barrier.value(%pair, %uniforms) : 1x1
      rel.yield %0
    }
    func.func @both.pp.barrier.value_uniforms(%0: f64, %1: f64) -> (f64, f64) {
      %2 = arith.constant 1.000000e+00 : f64
      %3 = arith.divf %2, %0 : f64
      func.return %1, %3 : f64, f64
    }
    func.func @both.pp.barrier.value(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64, %6: f64, %7: f64) -> f64 {
      %8 = arith.subf %0, %3 : f64
      %9 = arith.subf %1, %4 : f64
      %10 = arith.subf %2, %5 : f64
      %11 = arith.mulf %8, %8 : f64
      %12 = arith.mulf %9, %9 : f64
      %13 = arith.mulf %10, %10 : f64
      %14 = arith.addf %11, %13 : f64
      %15 = arith.addf %12, %14 : f64
      %16 = arith.mulf %7, %15 : f64
      %17 = math.log %16 : f64
      %18 = arith.subf %6, %15 : f64
      %19 = arith.mulf %18, %18 : f64
      %20 = arith.mulf %17, %19 : f64
      %21 = arith.mulf %17, %20 : f64
      func.return %21 : f64
    }
  }
  rel.object @stiff.v.x.jacobian.object entries ["call"] {
    rel.jacobian @stiff.v.x.jacobian of @stiff.v.x on @stiff.v indices @stiff.v.x.kappa {
    ^bb0(%cotangent: tensor<3x1xf64>):
      %t = rel.join @stiff.body.t through @stiff.v.owner : 1x3
      %rest = rel.data @stiff.v.rest : 3x1
      %A = rel.join @stiff.body.A through @stiff.v.owner : 1x9
      %0 = rel.apply @stiff.v.x.pull_back(%rest, %cotangent) : 12x1
      rel.yield_pullback %0 wrt %t, %A
    }
    func.func @stiff.v.x.pull_back(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64) -> (f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64) {
      %6 = arith.mulf %0, %3 : f64
      %7 = arith.mulf %1, %3 : f64
      %8 = arith.mulf %2, %3 : f64
      %9 = arith.mulf %0, %4 : f64
      %10 = arith.mulf %1, %4 : f64
      %11 = arith.mulf %2, %4 : f64
      %12 = arith.mulf %0, %5 : f64
      %13 = arith.mulf %1, %5 : f64
      %14 = arith.mulf %2, %5 : f64
      func.return %3, %4, %5, %6, %7, %8, %9, %10, %11, %12, %13, %14 : f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64
    }
  }
  rel.object @both.pp.barrier.derivative.object entries ["batch"] {
    // energy @both.pp.barrier of pair 2x3; projection clamp 3x3 of 6x6; operations: derive_uniforms 1, derive 63, pull_back 6
    rel.derivative @both.pp.barrier.derivative of @both.pp.barrier on @both.pp projection "clamp" dynamic indices @both.pp.barrier.kappa projects "3x3 of 6x6: the energy reads its inputs through a linear cut" {
      %barrier_numbers = rel.data @both.pp.barrier.numbers : 2x1
      %pair = rel.join @both.v.x through @both.pp.ends : 2x3
      %uniforms = rel.apply @both.pp.barrier.derive_uniforms(%barrier_numbers) uniform : 2x1
      %energy, %gradient, %hessian = rel.apply @both.pp.barrier.derive(%pair, %uniforms) : 1x1, 6x1, 6x1
      %projected = rel.project %hessian width 3 mode "clamp" : 6x1
      %0 = rel.apply @both.pp.barrier.pull_back(%projected) : 21x1
      rel.yield_derivative %energy gradient %gradient hessian %0 wrt %pair
    }
    func.func @both.pp.barrier.derive_uniforms(%0: f64, %1: f64) -> (f64, f64) {
      %2 = arith.constant 1.000000e+00 : f64
      %3 = arith.divf %2, %0 : f64
      func.return %1, %3 : f64, f64
    }
    func.func @both.pp.barrier.derive(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64, %6: f64, %7: f64) -> (f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64) {
      %8 = arith.constant 1.000000e+00 : f64
      %9 = arith.subf %0, %3 : f64
      %10 = arith.subf %1, %4 : f64
      %11 = arith.subf %2, %5 : f64
      %12 = arith.mulf %9, %9 : f64
      %13 = arith.mulf %10, %10 : f64
      %14 = arith.mulf %11, %11 : f64
      %15 = arith.addf %12, %14 : f64
      %16 = arith.addf %13, %15 : f64
      %17 = arith.mulf %7, %16 : f64
      %18 = math.log %17 : f64
      %19 = arith.subf %6, %16 : f64
      %20 = arith.mulf %19, %19 : f64
      %21 = arith.mulf %18, %20 : f64
      %22 = arith.constant 2.000000e+00 : f64
      %23 = arith.mulf %22, %21 : f64
      %24 = arith.divf %8, %17 : f64
      %25 = arith.mulf %23, %24 : f64
      %26 = arith.mulf %7, %25 : f64
      %27 = arith.mulf %18, %18 : f64
      %28 = arith.mulf %19, %27 : f64
      %29 = arith.mulf %22, %28 : f64
      %30 = arith.subf %26, %29 : f64
      %31 = arith.mulf %22, %30 : f64
      %32 = arith.mulf %9, %31 : f64
      %33 = arith.mulf %10, %31 : f64
      %34 = arith.mulf %11, %31 : f64
      %35 = arith.mulf %7, %24 : f64
      %36 = arith.mulf %20, %35 : f64
      %37 = arith.mulf %18, %19 : f64
      %38 = arith.mulf %22, %37 : f64
      %39 = arith.subf %36, %38 : f64
      %40 = arith.mulf %24, %39 : f64
      %41 = arith.mulf %22, %40 : f64
      %42 = arith.mulf %24, %24 : f64
      %43 = arith.mulf %23, %42 : f64
      %44 = arith.mulf %7, %43 : f64
      %45 = arith.subf %41, %44 : f64
      %46 = arith.mulf %7, %45 : f64
      %47 = arith.mulf %18, %35 : f64
      %48 = arith.mulf %19, %47 : f64
      %49 = arith.mulf %22, %48 : f64
      %50 = arith.subf %27, %49 : f64
      %51 = arith.mulf %22, %50 : f64
      %52 = arith.addf %46, %51 : f64
      %53 = arith.mulf %22, %52 : f64
      %54 = arith.mulf %11, %53 : f64
      %55 = arith.mulf %22, %54 : f64
      %56 = arith.mulf %9, %55 : f64
      %57 = arith.mulf %10, %55 : f64
      %58 = arith.mulf %11, %55 : f64
      %59 = arith.addf %31, %58 : f64
      %60 = arith.mulf %10, %53 : f64
      %61 = arith.mulf %22, %60 : f64
      %62 = arith.mulf %9, %61 : f64
      %63 = arith.mulf %10, %61 : f64
      %64 = arith.addf %31, %63 : f64
      %65 = arith.mulf %9, %53 : f64
      %66 = arith.mulf %9, %65 : f64
      %67 = arith.mulf %22, %66 : f64
      %68 = arith.addf %31, %67 : f64
      %69 = arith.mulf %18, %21 : f64
      %70 = arith.negf %32 : f64
      %71 = arith.negf %33 : f64
      %72 = arith.negf %34 : f64
      func.return %69, %32, %33, %34, %70, %71, %72, %68, %62, %56, %64, %57, %59 : f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64
    }
    func.func @both.pp.barrier.pull_back(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64) -> (f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64) {
      %6 = arith.negf %0 : f64
      %7 = arith.negf %1 : f64
      %8 = arith.negf %2 : f64
      %9 = arith.negf %3 : f64
      %10 = arith.negf %4 : f64
      %11 = arith.negf %5 : f64
      func.return %0, %1, %2, %6, %7, %8, %3, %4, %7, %9, %10, %5, %8, %10, %11, %0, %1, %2, %3, %4, %5 : f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64
    }
  }
  rel.object @soft.v.x.kappa.object entries ["call"] {
    rel.attribute @soft.v.x.kappa on @soft.v : 1x1xi32 {
      %index_of_x = rel.target_index @soft.v.x : 1x1xi32
      rel.yield %index_of_x
    }
  }
  rel.object @stiff.body.t.kappa.object entries ["call"] {
    rel.attribute @stiff.body.t.kappa on @stiff.body : 1x1xi32 {
      %index_of_t = rel.target_index @stiff.body.t : 1x1xi32
      rel.yield %index_of_t
    }
  }
  rel.object @stiff.body.A.kappa.object entries ["call"] {
    rel.attribute @stiff.body.A.kappa on @stiff.body : 1x1xi32 {
      %index_of_A = rel.target_index @stiff.body.A : 1x1xi32
      rel.yield %index_of_A
    }
  }
  rel.object @stiff.v.x.kappa.object entries ["call"] {
    rel.attribute @stiff.v.x.kappa on @stiff.v : 1x2xi32 {
      %t_kappa_at_owner = rel.join_indices @stiff.body.t.kappa through @stiff.v.owner : 1x1xi32
      %A_kappa_at_owner = rel.join_indices @stiff.body.A.kappa through @stiff.v.owner : 1x1xi32
      %0 = rel.apply @stiff.v.x.kappa.value(%t_kappa_at_owner, %A_kappa_at_owner) : 1x2xi32
      rel.yield %0
    }
    func.func @stiff.v.x.kappa.value(%0: i32, %1: i32) -> (i32, i32) {
      func.return %0, %1 : i32, i32
    }
  }
  rel.object @still.v.x.kappa.object entries ["call"] {
    rel.attribute @still.v.x.kappa on @still.v : 1x1xi32 {
      %0 = rel.apply @still.v.x.kappa.value() : 1x1xi32
      rel.yield %0
    }
    func.func @still.v.x.kappa.value() -> i32 {
      %0 = arith.constant 0 : i32
      func.return %0 : i32
    }
  }
  rel.object @both.v.x.kappa.object entries ["call"] {
    rel.attribute @both.v.x.kappa on @both.v : 1x2xi32 {
      %x_kappa = rel.union_indices [@soft.v.x.kappa, @stiff.v.x.kappa, @still.v.x.kappa] : 1x2xi32
      rel.yield %x_kappa
    }
  }
  rel.object @both.pp.barrier.kappa.object entries ["batch"] {
    rel.attribute @both.pp.barrier.kappa on @both.pp : 1x4xi32 {
      %x_kappa_at_ends = rel.join_indices @both.v.x.kappa through @both.pp.ends : 2x2xi32
      %0 = rel.apply @both.pp.barrier.kappa.value(%x_kappa_at_ends) : 1x4xi32
      rel.yield %0
    }
    func.func @both.pp.barrier.kappa.value(%0: i32, %1: i32, %2: i32, %3: i32) -> (i32, i32, i32, i32) {
      func.return %0, %1, %2, %3 : i32, i32, i32, i32
    }
  }
}
