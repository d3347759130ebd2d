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
    rel.jacobian @stiff.v.x.jacobian of @stiff.v.x on @stiff.v indices @stiff.v.x.kappa {
      %0 = rel.join @stiff.body.t through @stiff.v.owner : tensor<1x3xf64>
      %1 = mat.reshape %0 {shape = array<i64: 3, 1>} : (tensor<1x3xf64>) -> tensor<3x1xf64>
      %rest = rel.data @stiff.v.rest : tensor<3x1xf64>
      %2 = rel.join @stiff.body.A through @stiff.v.owner : tensor<1x9xf64>
      %3 = mat.reshape %2 {shape = array<i64: 3, 3>} : (tensor<1x9xf64>) -> tensor<3x3xf64>
      %4 = mat.matmul %3, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %5 = mat.add %4, %1 : (tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %6 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %7 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %8 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %9 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %10 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %11 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %12 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %13 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %14 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %15 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %16 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %17 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %18 = mat.constant {value = dense<[[1.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %19 = mat.constant {value = dense<[[0.000000e+00], [1.000000e+00], [0.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %20 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [1.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %21 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %22 = mat.matmul %21, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %23 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %24 = mat.matmul %23, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %25 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %26 = mat.matmul %25, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %27 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %28 = mat.matmul %27, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %29 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %30 = mat.matmul %29, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %31 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %32 = mat.matmul %31, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %33 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %34 = mat.matmul %33, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %35 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %36 = mat.matmul %35, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %37 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %38 = mat.matmul %37, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %39 = mat.concat_cols %18, %19, %20, %22, %24, %26, %28, %30, %32, %34, %36, %38 : (tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<3x12xf64>
      rel.yield_jacobian %39 : tensor<3x12xf64> wrt %0, %2 : tensor<1x3xf64>, tensor<1x9xf64>
    }
    rel.derivative @both.pp.barrier.derivative of @both.pp.barrier on @both.pp projection "clamp" dynamic indices @both.pp.barrier.kappa projects "3x3 of 6x6: the energy reads its inputs through a linear cut" {
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
      %14 = mat.constant {value = dense<1.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %15 = mat.scale %8, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %16 = mat.scale %15, %10 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %17 = mat.add %16, %16 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %18 = mat.neg %17 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %19 = mat.add %12, %12 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %20 = mat.pow %7 {exponent = -1.000000e+00 : f64} : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %21 = mat.scale %20, %19 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %22 = mat.divide %21, %6 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %23 = mat.scale %22, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %24 = mat.neg %23 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %25 = mat.add %17, %22 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %26 = mat.constant {value = dense<2.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %27 = mat.scale %26, %25 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %28 = mat.scale %27, %4 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %29 = mat.constant {value = dense<0.000000e+00> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %30 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %31 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %32 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %33 = mat.divide %14, %6 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %34 = mat.scale %20, %33 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %35 = mat.add %10, %10 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %36 = mat.scale %35, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %37 = mat.scale %11, %34 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %38 = mat.add %36, %37 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %39 = mat.add %38, %38 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %40 = mat.pow %20 {exponent = 2.000000e+00 : f64} : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %41 = mat.neg %40 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %42 = mat.scale %41, %33 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %43 = mat.scale %42, %19 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %44 = mat.scale %20, %39 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %45 = mat.add %43, %44 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %46 = mat.divide %45, %6 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %47 = mat.scale %34, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %48 = mat.add %47, %47 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %49 = mat.scale %48, %10 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %50 = mat.add %49, %15 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %51 = mat.add %50, %50 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %52 = mat.add %51, %46 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %53 = mat.scale %26, %52 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %54 = mat.dot %4, %30 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x1xf64>
      %55 = mat.scale %26, %54 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %56 = mat.scale %53, %55 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %57 = mat.scale %56, %4 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %58 = mat.scale %27, %30 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %59 = mat.add %57, %58 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %60 = mat.reshape %59 {shape = array<i64: 3, 1>} : (tensor<1x3xf64>) -> tensor<3x1xf64>
      %61 = mat.dot %4, %31 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x1xf64>
      %62 = mat.scale %26, %61 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %63 = mat.scale %53, %62 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %64 = mat.scale %63, %4 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %65 = mat.scale %27, %31 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %66 = mat.add %64, %65 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %67 = mat.reshape %66 {shape = array<i64: 3, 1>} : (tensor<1x3xf64>) -> tensor<3x1xf64>
      %68 = mat.dot %4, %32 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x1xf64>
      %69 = mat.scale %26, %68 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %70 = mat.scale %53, %69 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %71 = mat.scale %70, %4 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %72 = mat.scale %27, %32 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %73 = mat.add %71, %72 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %74 = mat.reshape %73 {shape = array<i64: 3, 1>} : (tensor<1x3xf64>) -> tensor<3x1xf64>
      %75 = mat.concat_cols %60, %67, %74 : (tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<3x3xf64>
      %76 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<2x3xf64>} : () -> tensor<2x3xf64>
      %77 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<2x3xf64>} : () -> tensor<2x3xf64>
      %78 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<2x3xf64>} : () -> tensor<2x3xf64>
      %79 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<2x3xf64>} : () -> tensor<2x3xf64>
      %80 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<2x3xf64>} : () -> tensor<2x3xf64>
      %81 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<2x3xf64>} : () -> tensor<2x3xf64>
      %82 = mat.constant {value = dense<[[-1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %83 = mat.constant {value = dense<[[-1.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %84 = mat.constant {value = dense<[[0.000000e+00, -1.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %85 = mat.constant {value = dense<[[0.000000e+00], [-1.000000e+00], [0.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %86 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, -1.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %87 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [-1.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %88 = mat.constant {value = dense<[[1.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %89 = mat.constant {value = dense<[[0.000000e+00], [1.000000e+00], [0.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %90 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [1.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %91 = mat.constant {value = dense<[[-1.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, -1.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, -1.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<3x6xf64>} : () -> tensor<3x6xf64>
      %92 = mat.congruence %75, %91 : (tensor<3x3xf64>, tensor<3x6xf64>) -> tensor<6x6xf64>
      %93 = mat.neg %28 : (tensor<1x3xf64>) -> tensor<1x3xf64>
      %94 = mat.embed %28 {place = array<i64: 1, 0, 2, 3>} : (tensor<1x3xf64>) -> tensor<2x3xf64>
      %95 = mat.embed %93 {place = array<i64: 0, 0, 2, 3>} : (tensor<1x3xf64>) -> tensor<2x3xf64>
      %96 = mat.add %94, %95 : (tensor<2x3xf64>, tensor<2x3xf64>) -> tensor<2x3xf64>
      %97 = mat.reshape %96 {shape = array<i64: 6, 1>} : (tensor<2x3xf64>) -> tensor<6x1xf64>
      %98 = mat.project_psd %75 {mode = "clamp"} : (tensor<3x3xf64>) -> tensor<3x3xf64>
      %99 = mat.congruence %98, %91 : (tensor<3x3xf64>, tensor<3x6xf64>) -> tensor<6x6xf64>
      rel.yield_derivative %13 : tensor<1x1xf64> gradient %97 : tensor<6x1xf64> hessian %99 : tensor<6x6xf64> wrt %1 : tensor<2x3xf64>
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
      %2 = mat.concat_cols %0, %1 : (tensor<1x1xi32>, tensor<1x1xi32>) -> tensor<1x2xi32>
      rel.yield %2 : tensor<1x2xi32>
    }
    rel.attribute @still.v.x.kappa on @still.v : tensor<1x1xi32> {
      %0 = mat.constant {value = dense<0> : tensor<1x1xi32>} : () -> tensor<1x1xi32>
      rel.yield %0 : tensor<1x1xi32>
    }
    rel.attribute @both.v.x.kappa on @both.v : tensor<1x2xi32> {
      %0 = rel.union [@soft.v.x.kappa, @stiff.v.x.kappa, @still.v.x.kappa] : tensor<1x2xi32>
      rel.yield %0 : tensor<1x2xi32>
    }
    rel.attribute @both.pp.barrier.kappa on @both.pp : tensor<1x4xi32> {
      %0 = rel.join @both.v.x.kappa through @both.pp.ends : tensor<2x2xi32>
      %1 = mat.reshape %0 {shape = array<i64: 1, 4>} : (tensor<2x2xi32>) -> tensor<1x4xi32>
      rel.yield %1 : tensor<1x4xi32>
    }
  }
}
