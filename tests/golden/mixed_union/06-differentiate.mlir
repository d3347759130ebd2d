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
    rel.attribute @stiff.v.x on @stiff.v : 3x1 {
      %0 = rel.join @stiff.body.t through @stiff.v.owner : 1x3
      %1 = mat.reshape %0 : 3x1
      %rest = rel.data @stiff.v.rest : 3x1
      %2 = rel.join @stiff.body.A through @stiff.v.owner : 1x9
      %3 = mat.reshape %2 : 3x3
      %4 = mat.matmul %3, %rest : 3x1
      %5 = mat.add %4, %1 : 3x1
      rel.yield %5
    }
    rel.attribute @both.v.x on @both.v : 3x1 {
      %0 = rel.union [@soft.v.x, @stiff.v.x, @still.v.x] : 3x1
      rel.yield %0
    }
    rel.attribute @both.pp.barrier on @both.pp : 1x1 {
      %0 = rel.data @both.pp.barrier.numbers : 2x1
      %1 = rel.join @both.v.x through @both.pp.ends : 2x3
      %2 = mat.block %1[0, 0] : 1x3
      %3 = mat.block %1[1, 0] : 1x3
      %4 = mat.sub %3, %2 : 1x3
      %5 = mat.dot %4, %4 : 1x1
      %6 = mat.block %0[0, 0] : 1x1
      %7 = mat.divide %5, %6 : 1x1
      %8 = mat.log %7 : 1x1
      %9 = mat.block %0[1, 0] : 1x1
      %10 = mat.sub %5, %9 : 1x1
      %11 = mat.scale %10, %10 : 1x1
      %12 = mat.scale %11, %8 : 1x1
      %13 = mat.scale %12, %8 : 1x1
      rel.yield %13
    }
    rel.energy @both.pp.barrier projection "clamp" dynamic
    rel.target @soft.v.x
    rel.target @stiff.body.A
    rel.target @stiff.body.t
    rel.jacobian @stiff.v.x.jacobian of @stiff.v.x on @stiff.v {
      %0 = rel.join @stiff.body.t through @stiff.v.owner : 1x3
      %1 = mat.reshape %0 : 3x1
      %rest = rel.data @stiff.v.rest : 3x1
      %2 = rel.join @stiff.body.A through @stiff.v.owner : 1x9
      %3 = mat.reshape %2 : 3x3
      %4 = mat.matmul %3, %rest : 3x1
      %5 = mat.add %4, %1 : 3x1
      %6 = mat.constant [[1.0, 0.0, 0.0]] : 1x3
      %7 = mat.constant [[0.0, 1.0, 0.0]] : 1x3
      %8 = mat.constant [[0.0, 0.0, 1.0]] : 1x3
      %9 = mat.constant [[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]] : 1x9
      %10 = mat.constant [[0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]] : 1x9
      %11 = mat.constant [[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]] : 1x9
      %12 = mat.constant [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]] : 1x9
      %13 = mat.constant [[0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]] : 1x9
      %14 = mat.constant [[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]] : 1x9
      %15 = mat.constant [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]] : 1x9
      %16 = mat.constant [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]] : 1x9
      %17 = mat.constant [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]] : 1x9
      %18 = mat.constant [[1.0], [0.0], [0.0]] : 3x1
      %19 = mat.constant [[0.0], [1.0], [0.0]] : 3x1
      %20 = mat.constant [[0.0], [0.0], [1.0]] : 3x1
      %21 = mat.constant [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %22 = mat.matmul %21, %rest : 3x1
      %23 = mat.constant [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %24 = mat.matmul %23, %rest : 3x1
      %25 = mat.constant [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %26 = mat.matmul %25, %rest : 3x1
      %27 = mat.constant [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %28 = mat.matmul %27, %rest : 3x1
      %29 = mat.constant [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %30 = mat.matmul %29, %rest : 3x1
      %31 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]] : 3x3
      %32 = mat.matmul %31, %rest : 3x1
      %33 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]] : 3x3
      %34 = mat.matmul %33, %rest : 3x1
      %35 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]] : 3x3
      %36 = mat.matmul %35, %rest : 3x1
      %37 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]] : 3x3
      %38 = mat.matmul %37, %rest : 3x1
      %39 = mat.concat_cols %18, %19, %20, %22, %24, %26, %28, %30, %32, %34, %36, %38 : 3x12
      rel.yield_jacobian %39 wrt %0, %2
    }
    rel.derivative @both.pp.barrier.derivative of @both.pp.barrier on @both.pp projection "clamp" dynamic {
      %0 = rel.data @both.pp.barrier.numbers : 2x1
      %1 = rel.join @both.v.x through @both.pp.ends : 2x3
      %2 = mat.block %1[0, 0] : 1x3
      %3 = mat.block %1[1, 0] : 1x3
      %4 = mat.sub %3, %2 : 1x3
      %5 = mat.dot %4, %4 : 1x1
      %6 = mat.block %0[0, 0] : 1x1
      %7 = mat.divide %5, %6 : 1x1
      %8 = mat.log %7 : 1x1
      %9 = mat.block %0[1, 0] : 1x1
      %10 = mat.sub %5, %9 : 1x1
      %11 = mat.scale %10, %10 : 1x1
      %12 = mat.scale %11, %8 : 1x1
      %13 = mat.scale %12, %8 : 1x1
      %14 = mat.constant 1.0 : 1x1
      %15 = mat.scale %8, %8 : 1x1
      %16 = mat.scale %15, %10 : 1x1
      %17 = mat.add %16, %16 : 1x1
      %18 = mat.neg %17 : 1x1
      %19 = mat.add %12, %12 : 1x1
      %20 = mat.pow %7 exponent -1.0 : 1x1
      %21 = mat.scale %20, %19 : 1x1
      %22 = mat.divide %21, %6 : 1x1
      %23 = mat.scale %22, %7 : 1x1
      %24 = mat.neg %23 : 1x1
      %25 = mat.add %17, %22 : 1x1
      %26 = mat.constant 2.0 : 1x1
      %27 = mat.scale %26, %25 : 1x1
      %28 = mat.scale %27, %4 : 1x3
      %29 = mat.constant 0.0 : 1x3
      %30 = mat.constant [[1.0, 0.0, 0.0]] : 1x3
      %31 = mat.constant [[0.0, 1.0, 0.0]] : 1x3
      %32 = mat.constant [[0.0, 0.0, 1.0]] : 1x3
      %33 = mat.divide %14, %6 : 1x1
      %34 = mat.scale %20, %33 : 1x1
      %35 = mat.add %10, %10 : 1x1
      %36 = mat.scale %35, %8 : 1x1
      %37 = mat.scale %11, %34 : 1x1
      %38 = mat.add %36, %37 : 1x1
      %39 = mat.add %38, %38 : 1x1
      %40 = mat.pow %20 exponent 2.0 : 1x1
      %41 = mat.neg %40 : 1x1
      %42 = mat.scale %41, %33 : 1x1
      %43 = mat.scale %42, %19 : 1x1
      %44 = mat.scale %20, %39 : 1x1
      %45 = mat.add %43, %44 : 1x1
      %46 = mat.divide %45, %6 : 1x1
      %47 = mat.scale %34, %8 : 1x1
      %48 = mat.add %47, %47 : 1x1
      %49 = mat.scale %48, %10 : 1x1
      %50 = mat.add %49, %15 : 1x1
      %51 = mat.add %50, %50 : 1x1
      %52 = mat.add %51, %46 : 1x1
      %53 = mat.scale %26, %52 : 1x1
      %54 = mat.dot %4, %30 : 1x1
      %55 = mat.scale %26, %54 : 1x1
      %56 = mat.scale %53, %55 : 1x1
      %57 = mat.scale %56, %4 : 1x3
      %58 = mat.scale %27, %30 : 1x3
      %59 = mat.add %57, %58 : 1x3
      %60 = mat.reshape %59 : 3x1
      %61 = mat.dot %4, %31 : 1x1
      %62 = mat.scale %26, %61 : 1x1
      %63 = mat.scale %53, %62 : 1x1
      %64 = mat.scale %63, %4 : 1x3
      %65 = mat.scale %27, %31 : 1x3
      %66 = mat.add %64, %65 : 1x3
      %67 = mat.reshape %66 : 3x1
      %68 = mat.dot %4, %32 : 1x1
      %69 = mat.scale %26, %68 : 1x1
      %70 = mat.scale %53, %69 : 1x1
      %71 = mat.scale %70, %4 : 1x3
      %72 = mat.scale %27, %32 : 1x3
      %73 = mat.add %71, %72 : 1x3
      %74 = mat.reshape %73 : 3x1
      %75 = mat.concat_cols %60, %67, %74 : 3x3
      %76 = mat.constant [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 2x3
      %77 = mat.constant [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]] : 2x3
      %78 = mat.constant [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]] : 2x3
      %79 = mat.constant [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]] : 2x3
      %80 = mat.constant [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]] : 2x3
      %81 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]] : 2x3
      %82 = mat.constant [[-1.0, 0.0, 0.0]] : 1x3
      %83 = mat.constant [[-1.0], [0.0], [0.0]] : 3x1
      %84 = mat.constant [[0.0, -1.0, 0.0]] : 1x3
      %85 = mat.constant [[0.0], [-1.0], [0.0]] : 3x1
      %86 = mat.constant [[0.0, 0.0, -1.0]] : 1x3
      %87 = mat.constant [[0.0], [0.0], [-1.0]] : 3x1
      %88 = mat.constant [[1.0], [0.0], [0.0]] : 3x1
      %89 = mat.constant [[0.0], [1.0], [0.0]] : 3x1
      %90 = mat.constant [[0.0], [0.0], [1.0]] : 3x1
      %91 = mat.constant [[-1.0, 0.0, 0.0, 1.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 0.0, 0.0, 1.0]] : 3x6
      %92 = mat.congruence %75, %91 : 6x6
      %93 = mat.neg %28 : 1x3
      %94 = mat.embed %28[1, 0] : 2x3
      %95 = mat.embed %93[0, 0] : 2x3
      %96 = mat.add %94, %95 : 2x3
      %97 = mat.reshape %96 : 6x1
      rel.yield_derivative %13 gradient %97 hessian %92 cut %4 wrt %1
    }
  }
}
