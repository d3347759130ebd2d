builtin.module {
  rel.scene @soft_tets {
    rel.mesh @m in @soft_tets
    rel.primitive @m.t in @m size 1
    rel.primitive @m.v in @m size 4
    rel.connectivity @m.t.corners from @m.t to @m.v arity 4
    rel.storage @m.v.x on @m.v : 3x1
    rel.storage @m.v.mass on @m.v : 1x1 constant
    rel.storage @m.t.swell.numbers on @soft_tets : 1x1 constant numbers 3.0
    rel.storage @m.v.gravity.numbers on @soft_tets : 1x1 constant numbers 9.8
    rel.attribute @m.t.swell on @m.t : 1x1 {
      %swell_numbers = rel.data @m.t.swell.numbers : 1x1
      %x = rel.join @m.v.x through @m.t.corners : 4x3
      %x_row0 = mat.block %x[0, 0] : 1x3
      %x_row3 = mat.block %x[3, 0] : 1x3
      %0 = mat.sub %x_row3, %x_row0 : 1x3
      %x_row2 = mat.block %x[2, 0] : 1x3
      %1 = mat.sub %x_row2, %x_row0 : 1x3
      %x_row1 = mat.block %x[1, 0] : 1x3
      %2 = mat.sub %x_row1, %x_row0 : 1x3
      %3 = mat.concat_rows %2, %1, %0 : 3x3
      %4 = mat.det %3 : 1x1
      %half = mat.constant 0.5 : 1x1
      %5 = mat.sub %4, %half : 1x1
      %6 = mat.scale %swell_numbers, %5 : 1x1
      %swell = mat.scale %6, %5 : 1x1
      rel.yield %swell
    }
    rel.attribute @m.v.gravity on @m.v : 1x1 {
      %gravity_numbers = rel.data @m.v.gravity.numbers : 1x1
      %x = rel.data @m.v.x : 3x1
      %x_row1 = mat.block %x[1, 0] : 1x1
      %mass = rel.data @m.v.mass : 1x1
      %0 = mat.scale %gravity_numbers, %mass : 1x1
      %gravity = mat.scale %0, %x_row1 : 1x1
      rel.yield %gravity
    }
    rel.energy @m.t.swell projection "clamp"
    rel.energy @m.v.gravity projection "clamp"
    rel.target @m.v.x
    // energy @m.t.swell of x 4x3; cut cut 3x3; projection clamp 9x9 of 12x12; operations: on matrices 146
    rel.derivative @m.t.swell.derivative of @m.t.swell on @m.t projection "clamp" indices @m.t.swell.kappa projects "9x9 of 12x12: the energy reads its inputs through a linear cut; by singular values: isotropic in this 3x3 matrix" {
      %swell_numbers = rel.data @m.t.swell.numbers : 1x1
      %x = rel.join @m.v.x through @m.t.corners : 4x3
      %x_row0 = mat.block %x[0, 0] : 1x3
      %x_row3 = mat.block %x[3, 0] : 1x3
      %0 = mat.sub %x_row3, %x_row0 : 1x3
      %x_row2 = mat.block %x[2, 0] : 1x3
      %1 = mat.sub %x_row2, %x_row0 : 1x3
      %x_row1 = mat.block %x[1, 0] : 1x3
      %2 = mat.sub %x_row1, %x_row0 : 1x3
      %cut = mat.concat_rows %2, %1, %0 : 3x3
      %det_cut = mat.det %cut : 1x1
      %half = mat.constant 0.5 : 1x1
      %3 = mat.sub %det_cut, %half : 1x1
      %4 = mat.scale %swell_numbers, %3 : 1x1
      %swell = mat.scale %4, %3 : 1x1
      %c1 = mat.constant 1.0 : 1x1
      %5 = mat.scale %3, %3 : 1x1
      %6 = mat.add %4, %4 : 1x1
      %7 = mat.neg %6 : 1x1
      %cof_cut = mat.cofactor %cut : 3x3
      %8 = mat.scale %6, %cof_cut : 3x3
      %zero = mat.constant 0.0 : 3x3
      %9 = mat.constant [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %10 = mat.constant [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %11 = mat.constant [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %12 = mat.constant [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %13 = mat.constant [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %14 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]] : 3x3
      %15 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]] : 3x3
      %16 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]] : 3x3
      %17 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]] : 3x3
      %18 = mat.add %swell_numbers, %swell_numbers : 1x1
      %zero_1 = mat.constant 0.0 : 1x3
      %19 = mat.cross %zero_1, %0 : 1x3
      %20 = mat.cross %1, %zero_1 : 1x3
      %21 = mat.add %19, %20 : 1x3
      %22 = mat.cross %zero_1, %2 : 1x3
      %23 = mat.constant [[1.0, 0.0, 0.0]] : 1x3
      %24 = mat.cross %0, %23 : 1x3
      %25 = mat.add %22, %24 : 1x3
      %26 = mat.cross %23, %1 : 1x3
      %27 = mat.cross %2, %zero_1 : 1x3
      %28 = mat.add %26, %27 : 1x3
      %29 = mat.concat_rows %21, %25, %28 : 3x3
      %30 = mat.dot %cof_cut, %9 : 1x1
      %31 = mat.scale %18, %30 : 1x1
      %32 = mat.scale %31, %cof_cut : 3x3
      %33 = mat.scale %6, %29 : 3x3
      %34 = mat.add %32, %33 : 3x3
      %35 = mat.reshape %34 : 9x1
      %36 = mat.constant [[0.0, 1.0, 0.0]] : 1x3
      %37 = mat.cross %0, %36 : 1x3
      %38 = mat.add %22, %37 : 1x3
      %39 = mat.cross %36, %1 : 1x3
      %40 = mat.add %39, %27 : 1x3
      %41 = mat.concat_rows %21, %38, %40 : 3x3
      %42 = mat.dot %cof_cut, %10 : 1x1
      %43 = mat.scale %18, %42 : 1x1
      %44 = mat.scale %43, %cof_cut : 3x3
      %45 = mat.scale %6, %41 : 3x3
      %46 = mat.add %44, %45 : 3x3
      %47 = mat.reshape %46 : 9x1
      %48 = mat.constant [[0.0, 0.0, 1.0]] : 1x3
      %49 = mat.cross %0, %48 : 1x3
      %50 = mat.add %22, %49 : 1x3
      %51 = mat.cross %48, %1 : 1x3
      %52 = mat.add %51, %27 : 1x3
      %53 = mat.concat_rows %21, %50, %52 : 3x3
      %54 = mat.dot %cof_cut, %11 : 1x1
      %55 = mat.scale %18, %54 : 1x1
      %56 = mat.scale %55, %cof_cut : 3x3
      %57 = mat.scale %6, %53 : 3x3
      %58 = mat.add %56, %57 : 3x3
      %59 = mat.reshape %58 : 9x1
      %60 = mat.cross %23, %0 : 1x3
      %61 = mat.add %60, %20 : 1x3
      %62 = mat.cross %0, %zero_1 : 1x3
      %63 = mat.add %22, %62 : 1x3
      %64 = mat.cross %zero_1, %1 : 1x3
      %65 = mat.cross %2, %23 : 1x3
      %66 = mat.add %64, %65 : 1x3
      %67 = mat.concat_rows %61, %63, %66 : 3x3
      %68 = mat.dot %cof_cut, %12 : 1x1
      %69 = mat.scale %18, %68 : 1x1
      %70 = mat.scale %69, %cof_cut : 3x3
      %71 = mat.scale %6, %67 : 3x3
      %72 = mat.add %70, %71 : 3x3
      %73 = mat.reshape %72 : 9x1
      %74 = mat.cross %36, %0 : 1x3
      %75 = mat.add %74, %20 : 1x3
      %76 = mat.cross %2, %36 : 1x3
      %77 = mat.add %64, %76 : 1x3
      %78 = mat.concat_rows %75, %63, %77 : 3x3
      %79 = mat.dot %cof_cut, %13 : 1x1
      %80 = mat.scale %18, %79 : 1x1
      %81 = mat.scale %80, %cof_cut : 3x3
      %82 = mat.scale %6, %78 : 3x3
      %83 = mat.add %81, %82 : 3x3
      %84 = mat.reshape %83 : 9x1
      %85 = mat.cross %48, %0 : 1x3
      %86 = mat.add %85, %20 : 1x3
      %87 = mat.cross %2, %48 : 1x3
      %88 = mat.add %64, %87 : 1x3
      %89 = mat.concat_rows %86, %63, %88 : 3x3
      %90 = mat.dot %cof_cut, %14 : 1x1
      %91 = mat.scale %18, %90 : 1x1
      %92 = mat.scale %91, %cof_cut : 3x3
      %93 = mat.scale %6, %89 : 3x3
      %94 = mat.add %92, %93 : 3x3
      %95 = mat.reshape %94 : 9x1
      %96 = mat.cross %1, %23 : 1x3
      %97 = mat.add %19, %96 : 1x3
      %98 = mat.cross %23, %2 : 1x3
      %99 = mat.add %98, %62 : 1x3
      %100 = mat.add %64, %27 : 1x3
      %101 = mat.concat_rows %97, %99, %100 : 3x3
      %102 = mat.dot %cof_cut, %15 : 1x1
      %103 = mat.scale %18, %102 : 1x1
      %104 = mat.scale %103, %cof_cut : 3x3
      %105 = mat.scale %6, %101 : 3x3
      %106 = mat.add %104, %105 : 3x3
      %107 = mat.reshape %106 : 9x1
      %108 = mat.cross %1, %36 : 1x3
      %109 = mat.add %19, %108 : 1x3
      %110 = mat.cross %36, %2 : 1x3
      %111 = mat.add %110, %62 : 1x3
      %112 = mat.concat_rows %109, %111, %100 : 3x3
      %113 = mat.dot %cof_cut, %16 : 1x1
      %114 = mat.scale %18, %113 : 1x1
      %115 = mat.scale %114, %cof_cut : 3x3
      %116 = mat.scale %6, %112 : 3x3
      %117 = mat.add %115, %116 : 3x3
      %118 = mat.reshape %117 : 9x1
      %119 = mat.cross %1, %48 : 1x3
      %120 = mat.add %19, %119 : 1x3
      %121 = mat.cross %48, %2 : 1x3
      %122 = mat.add %121, %62 : 1x3
      %123 = mat.concat_rows %120, %122, %100 : 3x3
      %124 = mat.dot %cof_cut, %17 : 1x1
      %125 = mat.scale %18, %124 : 1x1
      %126 = mat.scale %125, %cof_cut : 3x3
      %127 = mat.scale %6, %123 : 3x3
      %128 = mat.add %126, %127 : 3x3
      %129 = mat.reshape %128 : 9x1
      %hessian_of_cut = mat.concat_cols %35, %47, %59, %73, %84, %95, %107, %118, %129 : 9x9
      %130 = mat.constant [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %131 = mat.constant [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %132 = mat.constant [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %133 = mat.constant [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %134 = mat.constant [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %135 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %136 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %137 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %138 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]] : 4x3
      %139 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]] : 4x3
      %140 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]] : 4x3
      %141 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]] : 4x3
      %142 = mat.constant [[-1.0, -0.0, -0.0]] : 1x3
      %143 = mat.constant [[-1.0, -0.0, -0.0], [-1.0, -0.0, -0.0], [-1.0, -0.0, -0.0]] : 3x3
      %144 = mat.constant [[-1.0], [-0.0], [-0.0], [-1.0], [-0.0], [-0.0], [-1.0], [-0.0], [-0.0]] : 9x1
      %145 = mat.constant [[-0.0, -1.0, -0.0]] : 1x3
      %146 = mat.constant [[-0.0, -1.0, -0.0], [-0.0, -1.0, -0.0], [-0.0, -1.0, -0.0]] : 3x3
      %147 = mat.constant [[-0.0], [-1.0], [-0.0], [-0.0], [-1.0], [-0.0], [-0.0], [-1.0], [-0.0]] : 9x1
      %148 = mat.constant [[-0.0, -0.0, -1.0]] : 1x3
      %149 = mat.constant [[-0.0, -0.0, -1.0], [-0.0, -0.0, -1.0], [-0.0, -0.0, -1.0]] : 3x3
      %150 = mat.constant [[-0.0], [-0.0], [-1.0], [-0.0], [-0.0], [-1.0], [-0.0], [-0.0], [-1.0]] : 9x1
      %151 = mat.constant [[1.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0]] : 9x1
      %152 = mat.constant [[0.0], [1.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0]] : 9x1
      %153 = mat.constant [[0.0], [0.0], [1.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0]] : 9x1
      %154 = mat.constant [[0.0], [0.0], [0.0], [1.0], [0.0], [0.0], [0.0], [0.0], [0.0]] : 9x1
      %155 = mat.constant [[0.0], [0.0], [0.0], [0.0], [1.0], [0.0], [0.0], [0.0], [0.0]] : 9x1
      %156 = mat.constant [[0.0], [0.0], [0.0], [0.0], [0.0], [1.0], [0.0], [0.0], [0.0]] : 9x1
      %157 = mat.constant [[0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [1.0], [0.0], [0.0]] : 9x1
      %158 = mat.constant [[0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [1.0], [0.0]] : 9x1
      %159 = mat.constant [[0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [1.0]] : 9x1
      %160 = mat.constant [[-1.0, -0.0, -0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [-0.0, -1.0, -0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [-0.0, -0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [-1.0, -0.0, -0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [-0.0, -1.0, -0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0], [-0.0, -0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [-1.0, -0.0, -0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0], [-0.0, -1.0, -0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], [-0.0, -0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]] : 9x12
      %hessian = mat.congruence %hessian_of_cut, %160 : 12x12
      %161 = mat.block %8[0, 0] : 1x3
      %162 = mat.block %8[1, 0] : 1x3
      %163 = mat.block %8[2, 0] : 1x3
      %164 = mat.neg %161 : 1x3
      %165 = mat.embed %161[1, 0] : 4x3
      %166 = mat.neg %162 : 1x3
      %167 = mat.embed %162[2, 0] : 4x3
      %168 = mat.neg %163 : 1x3
      %169 = mat.embed %163[3, 0] : 4x3
      %170 = mat.add %164, %166 : 1x3
      %171 = mat.add %170, %168 : 1x3
      %172 = mat.embed %171[0, 0] : 4x3
      %173 = mat.add %165, %167 : 4x3
      %174 = mat.add %173, %169 : 4x3
      %175 = mat.add %174, %172 : 4x3
      %gradient = mat.reshape %175 : 12x1
      %projected = mat.project_psd %hessian_of_cut mode "clamp" isotropic in %cut : 9x9
      %hessian_1 = mat.congruence %projected, %160 : 12x12
      rel.yield_derivative %swell gradient %gradient hessian %hessian_1 cut %cut wrt %x
    }
    // energy @m.v.gravity of x 3x1; projection clamp nowhere; operations: on matrices 4
    rel.derivative @m.v.gravity.derivative of @m.v.gravity on @m.v projection "clamp" indices @m.v.gravity.kappa projects "nowhere: the energy is affine, its Hessian is zero" {
      %gravity_numbers = rel.data @m.v.gravity.numbers : 1x1
      %x = rel.data @m.v.x : 3x1
      %x_row1 = mat.block %x[1, 0] : 1x1
      %mass = rel.data @m.v.mass : 1x1
      %0 = mat.scale %gravity_numbers, %mass : 1x1
      %gravity = mat.scale %0, %x_row1 : 1x1
      %c1 = mat.constant 1.0 : 1x1
      %zero = mat.constant 0.0 : 3x1
      %gravity_1 = mat.constant 0.0 : 1x1
      %gradient = mat.embed %0[1, 0] : 3x1
      rel.yield_derivative %gravity_1 gradient %gradient wrt %x
    }
    rel.attribute @m.v.x.kappa on @m.v : 1x1xi32 {
      %index_of_x = rel.target_index @m.v.x : 1x1xi32
      rel.yield %index_of_x
    }
    rel.attribute @m.t.swell.kappa on @m.t : 1x4xi32 {
      %x_kappa_at_corners = rel.join_indices @m.v.x.kappa through @m.t.corners : 4x1xi32
      %0 = mat.reshape %x_kappa_at_corners : 1x4xi32
      rel.yield %0
    }
    rel.attribute @m.v.gravity.kappa on @m.v : 1x1xi32 {
      %index_of_x = rel.target_index @m.v.x : 1x1xi32
      rel.yield %index_of_x
    }
  }
}
