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
      %t = rel.join @stiff.body.t through @stiff.v.owner : 1x3
      %t_flat = mat.reshape %t : 3x1
      %rest = rel.data @stiff.v.rest : 3x1
      %A = rel.join @stiff.body.A through @stiff.v.owner : 1x9
      %0 = mat.reshape %A : 3x3
      %1 = mat.matmul %0, %rest : 3x1
      %x = mat.add %1, %t_flat : 3x1
      rel.yield %x
    }
    rel.attribute @both.v.x on @both.v : 3x1 {
      %x = rel.union [@soft.v.x, @stiff.v.x, @still.v.x] : 3x1
      rel.yield %x
    }
    rel.attribute @both.pp.barrier on @both.pp : 1x1 {
      %barrier_numbers = rel.data @both.pp.barrier.numbers : 2x1
      %pair = rel.join @both.v.x through @both.pp.ends : 2x3
      %pair_row0 = mat.block %pair[0, 0] : 1x3
      %pair_row1 = mat.block %pair[1, 0] : 1x3
      %0 = mat.sub %pair_row1, %pair_row0 : 1x3
      %1 = mat.dot %0, %0 : 1x1
      %barrier_numbers_row0 = mat.block %barrier_numbers[0, 0] : 1x1
      %2 = mat.divide %1, %barrier_numbers_row0 : 1x1
      %3 = mat.log %2 : 1x1
      %barrier_numbers_row1 = mat.block %barrier_numbers[1, 0] : 1x1
      %4 = mat.sub %1, %barrier_numbers_row1 : 1x1
      %5 = mat.scale %4, %4 : 1x1
      %6 = mat.scale %5, %3 : 1x1
      %barrier = mat.scale %6, %3 : 1x1
      rel.yield %barrier
    }
    rel.energy @both.pp.barrier projection "clamp" dynamic
    rel.target @soft.v.x
    rel.target @stiff.body.A
    rel.target @stiff.body.t
    rel.jacobian @stiff.v.x.jacobian of @stiff.v.x on @stiff.v indices @stiff.v.x.kappa {
      %t = rel.join @stiff.body.t through @stiff.v.owner : 1x3
      %t_flat = mat.reshape %t : 3x1
      %rest = rel.data @stiff.v.rest : 3x1
      %A = rel.join @stiff.body.A through @stiff.v.owner : 1x9
      %0 = mat.reshape %A : 3x3
      %1 = mat.matmul %0, %rest : 3x1
      %x = mat.add %1, %t_flat : 3x1
      %2 = mat.constant [[1.0, 0.0, 0.0]] : 1x3
      %3 = mat.constant [[0.0, 1.0, 0.0]] : 1x3
      %4 = mat.constant [[0.0, 0.0, 1.0]] : 1x3
      %5 = mat.constant [[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]] : 1x9
      %6 = mat.constant [[0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]] : 1x9
      %7 = mat.constant [[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]] : 1x9
      %8 = mat.constant [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]] : 1x9
      %9 = mat.constant [[0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]] : 1x9
      %10 = mat.constant [[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]] : 1x9
      %11 = mat.constant [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]] : 1x9
      %12 = mat.constant [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]] : 1x9
      %13 = mat.constant [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]] : 1x9
      %14 = mat.constant [[1.0], [0.0], [0.0]] : 3x1
      %15 = mat.constant [[0.0], [1.0], [0.0]] : 3x1
      %16 = mat.constant [[0.0], [0.0], [1.0]] : 3x1
      %17 = mat.constant [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %18 = mat.matmul %17, %rest : 3x1
      %19 = mat.constant [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %20 = mat.matmul %19, %rest : 3x1
      %21 = mat.constant [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %22 = mat.matmul %21, %rest : 3x1
      %23 = mat.constant [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %24 = mat.matmul %23, %rest : 3x1
      %25 = mat.constant [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %26 = mat.matmul %25, %rest : 3x1
      %27 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]] : 3x3
      %28 = mat.matmul %27, %rest : 3x1
      %29 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]] : 3x3
      %30 = mat.matmul %29, %rest : 3x1
      %31 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]] : 3x3
      %32 = mat.matmul %31, %rest : 3x1
      %33 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]] : 3x3
      %34 = mat.matmul %33, %rest : 3x1
      %35 = mat.concat_cols %14, %15, %16, %18, %20, %22, %24, %26, %28, %30, %32, %34 : 3x12
      rel.yield_jacobian %35 wrt %t, %A
    }
    // energy @both.pp.barrier of pair 2x3; cut cut 1x3; projection clamp 3x3 of 6x6; operations: on matrices 76
    rel.derivative @both.pp.barrier.derivative of @both.pp.barrier on @both.pp projection "clamp" dynamic indices @both.pp.barrier.kappa projects "3x3 of 6x6: the energy reads its inputs through a linear cut" {
      %barrier_numbers = rel.data @both.pp.barrier.numbers : 2x1
      %pair = rel.join @both.v.x through @both.pp.ends : 2x3
      %pair_row0 = mat.block %pair[0, 0] : 1x3
      %pair_row1 = mat.block %pair[1, 0] : 1x3
      %cut = mat.sub %pair_row1, %pair_row0 : 1x3
      %0 = mat.dot %cut, %cut : 1x1
      %barrier_numbers_row0 = mat.block %barrier_numbers[0, 0] : 1x1
      %1 = mat.divide %0, %barrier_numbers_row0 : 1x1
      %2 = mat.log %1 : 1x1
      %barrier_numbers_row1 = mat.block %barrier_numbers[1, 0] : 1x1
      %3 = mat.sub %0, %barrier_numbers_row1 : 1x1
      %4 = mat.scale %3, %3 : 1x1
      %5 = mat.scale %4, %2 : 1x1
      %barrier = mat.scale %5, %2 : 1x1
      %c1 = mat.constant 1.0 : 1x1
      %6 = mat.scale %2, %2 : 1x1
      %7 = mat.scale %6, %3 : 1x1
      %8 = mat.add %7, %7 : 1x1
      %9 = mat.neg %8 : 1x1
      %10 = mat.add %5, %5 : 1x1
      %11 = mat.pow %1 exponent -1.0 : 1x1
      %12 = mat.scale %11, %10 : 1x1
      %13 = mat.divide %12, %barrier_numbers_row0 : 1x1
      %14 = mat.scale %13, %1 : 1x1
      %15 = mat.neg %14 : 1x1
      %16 = mat.add %8, %13 : 1x1
      %c2 = mat.constant 2.0 : 1x1
      %17 = mat.scale %c2, %16 : 1x1
      %18 = mat.scale %17, %cut : 1x3
      %zero = mat.constant 0.0 : 1x3
      %19 = mat.constant [[1.0, 0.0, 0.0]] : 1x3
      %20 = mat.constant [[0.0, 1.0, 0.0]] : 1x3
      %21 = mat.constant [[0.0, 0.0, 1.0]] : 1x3
      %22 = mat.divide %c1, %barrier_numbers_row0 : 1x1
      %23 = mat.scale %11, %22 : 1x1
      %24 = mat.add %3, %3 : 1x1
      %25 = mat.scale %24, %2 : 1x1
      %26 = mat.scale %4, %23 : 1x1
      %27 = mat.add %25, %26 : 1x1
      %28 = mat.add %27, %27 : 1x1
      %29 = mat.pow %11 exponent 2.0 : 1x1
      %30 = mat.neg %29 : 1x1
      %31 = mat.scale %30, %22 : 1x1
      %32 = mat.scale %31, %10 : 1x1
      %33 = mat.scale %11, %28 : 1x1
      %34 = mat.add %32, %33 : 1x1
      %35 = mat.divide %34, %barrier_numbers_row0 : 1x1
      %36 = mat.scale %23, %2 : 1x1
      %37 = mat.add %36, %36 : 1x1
      %38 = mat.scale %37, %3 : 1x1
      %39 = mat.add %38, %6 : 1x1
      %40 = mat.add %39, %39 : 1x1
      %41 = mat.add %40, %35 : 1x1
      %42 = mat.scale %c2, %41 : 1x1
      %43 = mat.dot %cut, %19 : 1x1
      %44 = mat.scale %c2, %43 : 1x1
      %45 = mat.scale %42, %44 : 1x1
      %46 = mat.scale %45, %cut : 1x3
      %47 = mat.scale %17, %19 : 1x3
      %48 = mat.add %46, %47 : 1x3
      %49 = mat.reshape %48 : 3x1
      %50 = mat.dot %cut, %20 : 1x1
      %51 = mat.scale %c2, %50 : 1x1
      %52 = mat.scale %42, %51 : 1x1
      %53 = mat.scale %52, %cut : 1x3
      %54 = mat.scale %17, %20 : 1x3
      %55 = mat.add %53, %54 : 1x3
      %56 = mat.reshape %55 : 3x1
      %57 = mat.dot %cut, %21 : 1x1
      %58 = mat.scale %c2, %57 : 1x1
      %59 = mat.scale %42, %58 : 1x1
      %60 = mat.scale %59, %cut : 1x3
      %61 = mat.scale %17, %21 : 1x3
      %62 = mat.add %60, %61 : 1x3
      %63 = mat.reshape %62 : 3x1
      %hessian_of_cut = mat.concat_cols %49, %56, %63 : 3x3
      %64 = mat.constant [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 2x3
      %65 = mat.constant [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]] : 2x3
      %66 = mat.constant [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]] : 2x3
      %67 = mat.constant [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]] : 2x3
      %68 = mat.constant [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]] : 2x3
      %69 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]] : 2x3
      %70 = mat.constant [[-1.0, -0.0, -0.0]] : 1x3
      %71 = mat.constant [[-1.0], [-0.0], [-0.0]] : 3x1
      %72 = mat.constant [[-0.0, -1.0, -0.0]] : 1x3
      %73 = mat.constant [[-0.0], [-1.0], [-0.0]] : 3x1
      %74 = mat.constant [[-0.0, -0.0, -1.0]] : 1x3
      %75 = mat.constant [[-0.0], [-0.0], [-1.0]] : 3x1
      %76 = mat.constant [[1.0], [0.0], [0.0]] : 3x1
      %77 = mat.constant [[0.0], [1.0], [0.0]] : 3x1
      %78 = mat.constant [[0.0], [0.0], [1.0]] : 3x1
      %79 = mat.constant [[-1.0, -0.0, -0.0, 1.0, 0.0, 0.0], [-0.0, -1.0, -0.0, 0.0, 1.0, 0.0], [-0.0, -0.0, -1.0, 0.0, 0.0, 1.0]] : 3x6
      %hessian = mat.congruence %hessian_of_cut, %79 : 6x6
      %80 = mat.neg %18 : 1x3
      %81 = mat.embed %18[1, 0] : 2x3
      %82 = mat.embed %80[0, 0] : 2x3
      %83 = mat.add %81, %82 : 2x3
      %gradient = mat.reshape %83 : 6x1
      %projected = mat.project_psd %hessian_of_cut mode "clamp" : 3x3
      %hessian_1 = mat.congruence %projected, %79 : 6x6
      rel.yield_derivative %barrier gradient %gradient hessian %hessian_1 cut %cut wrt %pair
    }
    rel.attribute @soft.v.x.kappa on @soft.v : 1x1xi32 {
      %index_of_x = rel.target_index @soft.v.x : 1x1xi32
      rel.yield %index_of_x
    }
    rel.attribute @stiff.body.t.kappa on @stiff.body : 1x1xi32 {
      %index_of_t = rel.target_index @stiff.body.t : 1x1xi32
      rel.yield %index_of_t
    }
    rel.attribute @stiff.body.A.kappa on @stiff.body : 1x1xi32 {
      %index_of_A = rel.target_index @stiff.body.A : 1x1xi32
      rel.yield %index_of_A
    }
    rel.attribute @stiff.v.x.kappa on @stiff.v : 1x2xi32 {
      %t_kappa_at_owner = rel.join_indices @stiff.body.t.kappa through @stiff.v.owner : 1x1xi32
      %A_kappa_at_owner = rel.join_indices @stiff.body.A.kappa through @stiff.v.owner : 1x1xi32
      %0 = mat.concat_cols %t_kappa_at_owner, %A_kappa_at_owner : 1x2xi32
      rel.yield %0
    }
    rel.attribute @still.v.x.kappa on @still.v : 1x1xi32 {
      %c0 = mat.constant 0 : 1x1xi32
      rel.yield %c0
    }
    rel.attribute @both.v.x.kappa on @both.v : 1x2xi32 {
      %x_kappa = rel.union_indices [@soft.v.x.kappa, @stiff.v.x.kappa, @still.v.x.kappa] : 1x2xi32
      rel.yield %x_kappa
    }
    rel.attribute @both.pp.barrier.kappa on @both.pp : 1x4xi32 {
      %x_kappa_at_ends = rel.join_indices @both.v.x.kappa through @both.pp.ends : 2x2xi32
      %0 = mat.reshape %x_kappa_at_ends : 1x4xi32
      rel.yield %0
    }
  }
}
