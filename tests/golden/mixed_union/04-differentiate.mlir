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
      %0 = mat.constant {value = dense<2.500000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %1 = rel.join @both.v.x through @both.pp.ends : tensor<2x3xf64>
      %2 = mat.block %1 {block = array<i64: 0, 0, 1, 3>} : (tensor<2x3xf64>) -> tensor<1x3xf64>
      %3 = mat.block %1 {block = array<i64: 1, 0, 1, 3>} : (tensor<2x3xf64>) -> tensor<1x3xf64>
      %4 = mat.sub %3, %2 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %5 = mat.dot %4, %4 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x1xf64>
      %6 = mat.divide %5, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %7 = mat.log %6 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %8 = mat.sub %5, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %9 = mat.scale %8, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %10 = mat.scale %9, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %11 = mat.scale %10, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      rel.yield %11 : tensor<1x1xf64>
    }
    rel.energy @both.pp.barrier projection "clamp" dynamic
    rel.target @soft.v.x
    rel.target @stiff.body.A
    rel.target @stiff.body.t
    rel.jacobian @stiff.v.x.jacobian of @stiff.v.x on @stiff.v {
      %0 = rel.join @stiff.body.t through @stiff.v.owner : tensor<1x3xf64>
      %1 = mat.reshape %0 {shape = array<i64: 3, 1>} : (tensor<1x3xf64>) -> tensor<3x1xf64>
      %rest = rel.data @stiff.v.rest : tensor<3x1xf64>
      %2 = rel.join @stiff.body.A through @stiff.v.owner : tensor<1x9xf64>
      %3 = mat.reshape %2 {shape = array<i64: 3, 3>} : (tensor<1x9xf64>) -> tensor<3x3xf64>
      %4 = mat.matmul %3, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %5 = mat.add %4, %1 : (tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %6 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %7 = mat.constant {value = dense<[[1.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %8 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %9 = mat.constant {value = dense<[[0.000000e+00], [1.000000e+00], [0.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %10 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %11 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [1.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %12 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %13 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %14 = mat.matmul %13, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %15 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %16 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %17 = mat.matmul %16, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %18 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %19 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %20 = mat.matmul %19, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %21 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %22 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %23 = mat.matmul %22, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %24 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %25 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %26 = mat.matmul %25, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %27 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %28 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %29 = mat.matmul %28, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %30 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %31 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %32 = mat.matmul %31, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %33 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %34 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %35 = mat.matmul %34, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %36 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<1x9xf64>} : () -> tensor<1x9xf64>
      %37 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %38 = mat.matmul %37, %rest : (tensor<3x3xf64>, tensor<3x1xf64>) -> tensor<3x1xf64>
      %39 = mat.concat_cols %7, %9, %11, %14, %17, %20, %23, %26, %29, %32, %35, %38 : (tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<3x12xf64>
      rel.yield_jacobian %39 : tensor<3x12xf64> wrt %0, %2 : tensor<1x3xf64>, tensor<1x9xf64>
    }
    rel.derivative @both.pp.barrier.derivative of @both.pp.barrier on @both.pp projection "clamp" dynamic {
      %0 = mat.constant {value = dense<2.500000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %1 = rel.join @both.v.x through @both.pp.ends : tensor<2x3xf64>
      %2 = mat.block %1 {block = array<i64: 0, 0, 1, 3>} : (tensor<2x3xf64>) -> tensor<1x3xf64>
      %3 = mat.block %1 {block = array<i64: 1, 0, 1, 3>} : (tensor<2x3xf64>) -> tensor<1x3xf64>
      %4 = mat.sub %3, %2 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %5 = mat.dot %4, %4 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x1xf64>
      %6 = mat.divide %5, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %7 = mat.log %6 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %8 = mat.sub %5, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %9 = mat.scale %8, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %10 = mat.scale %9, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %11 = mat.scale %10, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %12 = mat.constant {value = dense<1.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %13 = mat.scale %7, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %14 = mat.scale %13, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %15 = mat.add %14, %14 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %16 = mat.neg %15 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %17 = mat.add %10, %10 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %18 = mat.pow %6 {exponent = -1.000000e+00 : f64} : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %19 = mat.scale %18, %17 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %20 = mat.divide %19, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %21 = mat.scale %20, %6 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %22 = mat.neg %21 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %23 = mat.add %15, %20 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %24 = mat.constant {value = dense<2.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %25 = mat.scale %24, %23 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %26 = mat.scale %25, %4 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %27 = mat.constant {value = dense<0.000000e+00> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %28 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %29 = mat.dot %4, %28 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x1xf64>
      %30 = mat.scale %24, %29 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %31 = mat.divide %30, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %32 = mat.scale %18, %31 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %33 = mat.scale %30, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %34 = mat.add %33, %33 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %35 = mat.scale %34, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %36 = mat.scale %9, %32 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %37 = mat.add %35, %36 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %38 = mat.add %37, %37 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %39 = mat.constant {value = dense<-1.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %40 = mat.pow %6 {exponent = -2.000000e+00 : f64} : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %41 = mat.scale %39, %40 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %42 = mat.scale %41, %31 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %43 = mat.scale %42, %17 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %44 = mat.scale %18, %38 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %45 = mat.add %43, %44 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %46 = mat.divide %45, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %47 = mat.scale %32, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %48 = mat.add %47, %47 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %49 = mat.scale %48, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %50 = mat.scale %13, %30 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %51 = mat.add %49, %50 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %52 = mat.add %51, %51 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %53 = mat.add %52, %46 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %54 = mat.scale %24, %53 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %55 = mat.scale %54, %4 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %56 = mat.scale %25, %28 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %57 = mat.add %55, %56 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %58 = mat.reshape %57 {shape = array<i64: 3, 1>} : (tensor<1x3xf64>) -> tensor<3x1xf64>
      %59 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %60 = mat.dot %4, %59 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x1xf64>
      %61 = mat.scale %24, %60 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %62 = mat.divide %61, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %63 = mat.scale %18, %62 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %64 = mat.scale %61, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %65 = mat.add %64, %64 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %66 = mat.scale %65, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %67 = mat.scale %9, %63 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %68 = mat.add %66, %67 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %69 = mat.add %68, %68 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %70 = mat.scale %41, %62 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %71 = mat.scale %70, %17 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %72 = mat.scale %18, %69 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %73 = mat.add %71, %72 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %74 = mat.divide %73, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %75 = mat.scale %63, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %76 = mat.add %75, %75 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %77 = mat.scale %76, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %78 = mat.scale %13, %61 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %79 = mat.add %77, %78 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %80 = mat.add %79, %79 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %81 = mat.add %80, %74 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %82 = mat.scale %24, %81 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %83 = mat.scale %82, %4 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %84 = mat.scale %25, %59 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %85 = mat.add %83, %84 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %86 = mat.reshape %85 {shape = array<i64: 3, 1>} : (tensor<1x3xf64>) -> tensor<3x1xf64>
      %87 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %88 = mat.dot %4, %87 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x1xf64>
      %89 = mat.scale %24, %88 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %90 = mat.divide %89, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %91 = mat.scale %18, %90 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %92 = mat.scale %89, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %93 = mat.add %92, %92 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %94 = mat.scale %93, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %95 = mat.scale %9, %91 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %96 = mat.add %94, %95 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %97 = mat.add %96, %96 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %98 = mat.scale %41, %90 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %99 = mat.scale %98, %17 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %100 = mat.scale %18, %97 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %101 = mat.add %99, %100 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %102 = mat.divide %101, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %103 = mat.scale %91, %7 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %104 = mat.add %103, %103 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %105 = mat.scale %104, %8 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %106 = mat.scale %13, %89 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %107 = mat.add %105, %106 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %108 = mat.add %107, %107 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %109 = mat.add %108, %102 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %110 = mat.scale %24, %109 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %111 = mat.scale %110, %4 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %112 = mat.scale %25, %87 : (tensor<1x1xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %113 = mat.add %111, %112 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %114 = mat.reshape %113 {shape = array<i64: 3, 1>} : (tensor<1x3xf64>) -> tensor<3x1xf64>
      %115 = mat.concat_cols %58, %86, %114 : (tensor<3x1xf64>, tensor<3x1xf64>, tensor<3x1xf64>) -> tensor<3x3xf64>
      %116 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<2x3xf64>} : () -> tensor<2x3xf64>
      %117 = mat.constant {value = dense<[[-1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %118 = mat.constant {value = dense<[[-1.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %119 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<2x3xf64>} : () -> tensor<2x3xf64>
      %120 = mat.constant {value = dense<[[0.000000e+00, -1.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %121 = mat.constant {value = dense<[[0.000000e+00], [-1.000000e+00], [0.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %122 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<2x3xf64>} : () -> tensor<2x3xf64>
      %123 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, -1.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %124 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [-1.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %125 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<2x3xf64>} : () -> tensor<2x3xf64>
      %126 = mat.constant {value = dense<[[1.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %127 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<2x3xf64>} : () -> tensor<2x3xf64>
      %128 = mat.constant {value = dense<[[0.000000e+00], [1.000000e+00], [0.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %129 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<2x3xf64>} : () -> tensor<2x3xf64>
      %130 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [1.000000e+00]]> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %131 = mat.constant {value = dense<[[-1.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, -1.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, -1.000000e+00, 0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<3x6xf64>} : () -> tensor<3x6xf64>
      %132 = mat.congruence %115, %131 : (tensor<3x3xf64>, tensor<3x6xf64>) -> tensor<6x6xf64>
      %133 = mat.neg %26 : (tensor<1x3xf64>) -> tensor<1x3xf64>
      %134 = mat.embed %26 {place = array<i64: 1, 0, 2, 3>} : (tensor<1x3xf64>) -> tensor<2x3xf64>
      %135 = mat.embed %133 {place = array<i64: 0, 0, 2, 3>} : (tensor<1x3xf64>) -> tensor<2x3xf64>
      %136 = mat.add %134, %135 : (tensor<2x3xf64>, tensor<2x3xf64>) -> tensor<2x3xf64>
      %137 = mat.reshape %136 {shape = array<i64: 6, 1>} : (tensor<2x3xf64>) -> tensor<6x1xf64>
      rel.yield_derivative gradient %137 : tensor<6x1xf64> hessian %132 : tensor<6x6xf64> wrt %1 : tensor<2x3xf64>
    }
  }
}
