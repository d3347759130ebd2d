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
    rel.attribute @stiff.v.x on @stiff.v : tensor<3x1xf64> {
      %0 = rel.join @stiff.body.t through @stiff.v.owner : tensor<1x3xf64>
      %rest = rel.data @stiff.v.rest : tensor<3x1xf64>
      %1 = rel.join @stiff.body.A through @stiff.v.owner : tensor<1x9xf64>
      %2 = rel.apply @stiff.v.x.value(%0, %rest, %1) : (tensor<1x3xf64>, tensor<3x1xf64>, tensor<1x9xf64>) -> tensor<3x1xf64>
      rel.yield %2 : tensor<3x1xf64>
    }
    rel.attribute @both.v.x on @both.v : tensor<3x1xf64> {
      %0 = rel.union [@soft.v.x, @stiff.v.x, @still.v.x] : tensor<3x1xf64>
      rel.yield %0 : tensor<3x1xf64>
    }
    rel.attribute @both.pp.barrier on @both.pp : tensor<1x1xf64> {
      %0 = rel.join @both.v.x through @both.pp.ends : tensor<2x3xf64>
      %1 = rel.apply @both.pp.barrier.value(%0) : (tensor<2x3xf64>) -> tensor<1x1xf64>
      rel.yield %1 : tensor<1x1xf64>
    }
    rel.energy @both.pp.barrier projection "clamp" dynamic
    rel.target @soft.v.x
    rel.target @stiff.body.A
    rel.target @stiff.body.t
    rel.jacobian @stiff.v.x.jacobian of @stiff.v.x on @stiff.v indices @stiff.v.x.kappa {
    ^bb0(%0: tensor<3x1xf64>):
      %1 = rel.join @stiff.body.t through @stiff.v.owner : tensor<1x3xf64>
      %rest = rel.data @stiff.v.rest : tensor<3x1xf64>
      %2 = rel.join @stiff.body.A through @stiff.v.owner : tensor<1x9xf64>
      %3 = rel.apply @stiff.v.x.pull_back(%rest, %0) : (tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<12x1xf64>
      rel.yield_jacobian %3 : tensor<12x1xf64> wrt %1, %2 : tensor<1x3xf64>, tensor<1x9xf64>
    }
    rel.derivative @both.pp.barrier.derivative of @both.pp.barrier on @both.pp projection "clamp" dynamic indices @both.pp.barrier.kappa projects "3x3 of 6x6: the energy reads its inputs through a linear cut" {
      %0 = rel.join @both.v.x through @both.pp.ends : tensor<2x3xf64>
      %1, %2 = rel.apply @both.pp.barrier.derive(%0) : (tensor<2x3xf64>) -> (tensor<6x1xf64>, tensor<6x1xf64>)
      %3 = rel.project %2 width 3 : i64 mode "clamp" : tensor<6x1xf64> -> tensor<6x1xf64>
      %4 = rel.apply @both.pp.barrier.pull_back(%3) : (tensor<6x1xf64>) -> tensor<21x1xf64>
      rel.yield_derivative gradient %1 : tensor<6x1xf64> hessian %4 : tensor<21x1xf64> wrt %0 : tensor<2x3xf64>
    }
    rel.attribute @soft.v.x.kappa on @soft.v : tensor<1x1xi32> {
      %0 = rel.target_index @soft.v.x : tensor<1x1xi32>
      rel.yield %0 : tensor<1x1xi32>
    }
    rel.attribute @stiff.body.t.kappa on @stiff.body : tensor<1x1xi32> {
      %0 = rel.target_index @stiff.body.t : tensor<1x1xi32>
      rel.yield %0 : tensor<1x1xi32>
    }
    rel.attribute @stiff.body.A.kappa on @stiff.body : tensor<1x1xi32> {
      %0 = rel.target_index @stiff.body.A : tensor<1x1xi32>
      rel.yield %0 : tensor<1x1xi32>
    }
    rel.attribute @stiff.v.x.kappa on @stiff.v : tensor<1x2xi32> {
      %0 = rel.join @stiff.body.t.kappa through @stiff.v.owner : tensor<1x1xi32>
      %1 = rel.join @stiff.body.A.kappa through @stiff.v.owner : tensor<1x1xi32>
      %2 = rel.apply @stiff.v.x.kappa.value(%0, %1) : (tensor<1x1xi32>, tensor<1x1xi32>) -> tensor<1x2xi32>
      rel.yield %2 : tensor<1x2xi32>
    }
    rel.attribute @still.v.x.kappa on @still.v : tensor<1x1xi32> {
      %0 = rel.apply @still.v.x.kappa.value() : () -> tensor<1x1xi32>
      rel.yield %0 : tensor<1x1xi32>
    }
    rel.attribute @both.v.x.kappa on @both.v : tensor<1x2xi32> {
      %0 = rel.union [@soft.v.x.kappa, @stiff.v.x.kappa, @still.v.x.kappa] : tensor<1x2xi32>
      rel.yield %0 : tensor<1x2xi32>
    }
    rel.attribute @both.pp.barrier.kappa on @both.pp : tensor<1x4xi32> {
      %0 = rel.join @both.v.x.kappa through @both.pp.ends : tensor<2x2xi32>
      %1 = rel.apply @both.pp.barrier.kappa.value(%0) : (tensor<2x2xi32>) -> tensor<1x4xi32>
      rel.yield %1 : tensor<1x4xi32>
    }
    func.func @stiff.v.x.value(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64, %6: f64, %7: f64, %8: f64, %9: f64, %10: f64, %11: f64, %12: f64, %13: f64, %14: f64) -> (f64, f64, f64) {
      %15 = arith.mulf %3, %6 : f64
      %16 = arith.mulf %4, %7 : f64
      %17 = arith.mulf %5, %8 : f64
      %18 = arith.addf %15, %16 : f64
      %19 = arith.addf %17, %18 : f64
      %20 = arith.mulf %3, %9 : f64
      %21 = arith.mulf %4, %10 : f64
      %22 = arith.mulf %5, %11 : f64
      %23 = arith.addf %20, %21 : f64
      %24 = arith.addf %22, %23 : f64
      %25 = arith.mulf %3, %12 : f64
      %26 = arith.mulf %4, %13 : f64
      %27 = arith.mulf %5, %14 : f64
      %28 = arith.addf %25, %26 : f64
      %29 = arith.addf %27, %28 : f64
      %30 = arith.addf %0, %19 : f64
      %31 = arith.addf %1, %24 : f64
      %32 = arith.addf %2, %29 : f64
      func.return %30, %31, %32 : f64, f64, f64
    }
    func.func @both.pp.barrier.value(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64) -> f64 {
      %6 = arith.constant 2.500000e+00 : f64
      %7 = arith.subf %0, %3 : f64
      %8 = arith.subf %1, %4 : f64
      %9 = arith.subf %2, %5 : f64
      %10 = arith.mulf %7, %7 : f64
      %11 = arith.mulf %8, %8 : f64
      %12 = arith.mulf %9, %9 : f64
      %13 = arith.addf %10, %11 : f64
      %14 = arith.addf %12, %13 : f64
      %15 = arith.divf %14, %6 : f64
      %16 = math.log %15 : f64
      %17 = arith.subf %6, %14 : f64
      %18 = arith.mulf %17, %17 : f64
      %19 = arith.mulf %16, %18 : f64
      %20 = arith.mulf %16, %19 : f64
      func.return %20 : f64
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
    func.func @both.pp.barrier.derive(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64) -> (f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64) {
      %6 = arith.constant 1.000000e+00 : f64
      %7 = arith.subf %0, %3 : f64
      %8 = arith.subf %1, %4 : f64
      %9 = arith.subf %2, %5 : f64
      %10 = arith.constant 2.500000e+00 : f64
      %11 = arith.mulf %7, %7 : f64
      %12 = arith.mulf %8, %8 : f64
      %13 = arith.mulf %9, %9 : f64
      %14 = arith.addf %11, %12 : f64
      %15 = arith.addf %13, %14 : f64
      %16 = arith.divf %15, %10 : f64
      %17 = math.log %16 : f64
      %18 = arith.subf %10, %15 : f64
      %19 = arith.mulf %18, %18 : f64
      %20 = arith.mulf %17, %19 : f64
      %21 = arith.addf %20, %20 : f64
      %22 = arith.divf %6, %16 : f64
      %23 = arith.mulf %21, %22 : f64
      %24 = arith.divf %23, %10 : f64
      %25 = arith.mulf %17, %17 : f64
      %26 = arith.mulf %18, %25 : f64
      %27 = arith.addf %26, %26 : f64
      %28 = arith.subf %24, %27 : f64
      %29 = arith.constant 2.000000e+00 : f64
      %30 = arith.mulf %29, %28 : f64
      %31 = arith.mulf %7, %30 : f64
      %32 = arith.negf %31 : f64
      %33 = arith.mulf %8, %30 : f64
      %34 = arith.negf %33 : f64
      %35 = arith.mulf %9, %30 : f64
      %36 = arith.negf %35 : f64
      %37 = arith.mulf %29, %9 : f64
      %38 = arith.divf %37, %10 : f64
      %39 = arith.mulf %22, %38 : f64
      %40 = arith.mulf %19, %39 : f64
      %41 = arith.mulf %18, %37 : f64
      %42 = arith.addf %41, %41 : f64
      %43 = arith.mulf %17, %42 : f64
      %44 = arith.subf %40, %43 : f64
      %45 = arith.addf %44, %44 : f64
      %46 = arith.mulf %22, %45 : f64
      %47 = arith.mulf %16, %16 : f64
      %48 = arith.divf %6, %47 : f64
      %49 = arith.mulf %38, %48 : f64
      %50 = arith.mulf %21, %49 : f64
      %51 = arith.subf %46, %50 : f64
      %52 = arith.divf %51, %10 : f64
      %53 = arith.mulf %25, %37 : f64
      %54 = arith.mulf %17, %39 : f64
      %55 = arith.addf %54, %54 : f64
      %56 = arith.mulf %18, %55 : f64
      %57 = arith.subf %53, %56 : f64
      %58 = arith.addf %57, %57 : f64
      %59 = arith.addf %52, %58 : f64
      %60 = arith.mulf %29, %59 : f64
      %61 = arith.mulf %7, %60 : f64
      %62 = arith.mulf %8, %60 : f64
      %63 = arith.mulf %9, %60 : f64
      %64 = arith.addf %30, %63 : f64
      %65 = arith.mulf %29, %8 : f64
      %66 = arith.divf %65, %10 : f64
      %67 = arith.mulf %22, %66 : f64
      %68 = arith.mulf %19, %67 : f64
      %69 = arith.mulf %18, %65 : f64
      %70 = arith.addf %69, %69 : f64
      %71 = arith.mulf %17, %70 : f64
      %72 = arith.subf %68, %71 : f64
      %73 = arith.addf %72, %72 : f64
      %74 = arith.mulf %22, %73 : f64
      %75 = arith.mulf %48, %66 : f64
      %76 = arith.mulf %21, %75 : f64
      %77 = arith.subf %74, %76 : f64
      %78 = arith.divf %77, %10 : f64
      %79 = arith.mulf %25, %65 : f64
      %80 = arith.mulf %17, %67 : f64
      %81 = arith.addf %80, %80 : f64
      %82 = arith.mulf %18, %81 : f64
      %83 = arith.subf %79, %82 : f64
      %84 = arith.addf %83, %83 : f64
      %85 = arith.addf %78, %84 : f64
      %86 = arith.mulf %29, %85 : f64
      %87 = arith.mulf %7, %86 : f64
      %88 = arith.mulf %8, %86 : f64
      %89 = arith.addf %30, %88 : f64
      %90 = arith.mulf %29, %7 : f64
      %91 = arith.divf %90, %10 : f64
      %92 = arith.mulf %22, %91 : f64
      %93 = arith.mulf %19, %92 : f64
      %94 = arith.mulf %18, %90 : f64
      %95 = arith.addf %94, %94 : f64
      %96 = arith.mulf %17, %95 : f64
      %97 = arith.subf %93, %96 : f64
      %98 = arith.addf %97, %97 : f64
      %99 = arith.mulf %22, %98 : f64
      %100 = arith.mulf %48, %91 : f64
      %101 = arith.mulf %21, %100 : f64
      %102 = arith.subf %99, %101 : f64
      %103 = arith.divf %102, %10 : f64
      %104 = arith.mulf %25, %90 : f64
      %105 = arith.mulf %17, %92 : f64
      %106 = arith.addf %105, %105 : f64
      %107 = arith.mulf %18, %106 : f64
      %108 = arith.subf %104, %107 : f64
      %109 = arith.addf %108, %108 : f64
      %110 = arith.addf %103, %109 : f64
      %111 = arith.mulf %29, %110 : f64
      %112 = arith.mulf %7, %111 : f64
      %113 = arith.addf %30, %112 : f64
      func.return %31, %33, %35, %32, %34, %36, %113, %87, %61, %89, %62, %64 : f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64
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
    func.func @stiff.v.x.kappa.value(%0: i32, %1: i32) -> (i32, i32) {
      func.return %0, %1 : i32, i32
    }
    func.func @still.v.x.kappa.value() -> i32 {
      %0 = arith.constant 0 : i32
      func.return %0 : i32
    }
    func.func @both.pp.barrier.kappa.value(%0: i32, %1: i32, %2: i32, %3: i32) -> (i32, i32, i32, i32) {
      func.return %0, %1, %2, %3 : i32, i32, i32, i32
    }
  }
}
