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
      %uniforms = rel.apply @m.t.swell.value_uniforms(%swell_numbers) uniform : 1x1
      %0 = rel.apply @m.t.swell.value(%x, %uniforms) : 1x1
      rel.yield %0
    }
    rel.attribute @m.v.gravity on @m.v : 1x1 {
      %gravity_numbers = rel.data @m.v.gravity.numbers : 1x1
      %x = rel.data @m.v.x : 3x1
      %mass = rel.data @m.v.mass : 1x1
      %uniforms = rel.apply @m.v.gravity.value_uniforms(%gravity_numbers) uniform : 1x1
      %0 = rel.apply @m.v.gravity.value(%x, %mass, %uniforms) : 1x1
      rel.yield %0
    }
    rel.energy @m.t.swell projection "clamp"
    rel.energy @m.v.gravity projection "clamp"
    rel.target @m.v.x
    // energy @m.t.swell of x 4x3; projection clamp 9x9 of 12x12; operations: derive_uniforms 1, derive 171, pull_back 93
    rel.derivative @m.t.swell.derivative of @m.t.swell on @m.t projection "clamp" indices @m.t.swell.kappa projects "9x9 of 12x12: the energy reads its inputs through a linear cut; by singular values: isotropic in this 3x3 matrix" {
      %swell_numbers = rel.data @m.t.swell.numbers : 1x1
      %x = rel.join @m.v.x through @m.t.corners : 4x3
      %uniforms = rel.apply @m.t.swell.derive_uniforms(%swell_numbers) uniform : 2x1
      %energy, %gradient, %hessian, %deformation = rel.apply @m.t.swell.derive(%x, %uniforms) : 1x1, 12x1, 45x1, 9x1
      %projected = rel.project %hessian width 9 mode "clamp" isotropic in %deformation : 45x1
      %0 = rel.apply @m.t.swell.pull_back(%projected) : 78x1
      rel.yield_derivative %energy gradient %gradient hessian %0 wrt %x
    }
    // energy @m.v.gravity of x 3x1; projection clamp nowhere; operations: derive_uniforms 0, derive 1
    rel.derivative @m.v.gravity.derivative of @m.v.gravity on @m.v projection "clamp" indices @m.v.gravity.kappa projects "nowhere: the energy is affine, its Hessian is zero" {
      %gravity_numbers = rel.data @m.v.gravity.numbers : 1x1
      %x = rel.data @m.v.x : 3x1
      %mass = rel.data @m.v.mass : 1x1
      %uniforms = rel.apply @m.v.gravity.derive_uniforms(%gravity_numbers) uniform : 1x1
      %energy, %gradient = rel.apply @m.v.gravity.derive(%mass, %uniforms) : 1x1, 3x1
      rel.yield_derivative %energy gradient %gradient wrt %x
    }
    rel.attribute @m.v.x.kappa on @m.v : 1x1xi32 {
      %index_of_x = rel.target_index @m.v.x : 1x1xi32
      rel.yield %index_of_x
    }
    rel.attribute @m.t.swell.kappa on @m.t : 1x4xi32 {
      %x_kappa_at_corners = rel.join_indices @m.v.x.kappa through @m.t.corners : 4x1xi32
      %0 = rel.apply @m.t.swell.kappa.value(%x_kappa_at_corners) : 1x4xi32
      rel.yield %0
    }
    rel.attribute @m.v.gravity.kappa on @m.v : 1x1xi32 {
      %index_of_x = rel.target_index @m.v.x : 1x1xi32
      rel.yield %index_of_x
    }
    func.func @m.t.swell.value_uniforms(%0: f64) -> f64 {
      func.return %0 : f64
    }
    func.func @m.t.swell.value(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64, %6: f64, %7: f64, %8: f64, %9: f64, %10: f64, %11: f64, %12: f64) -> f64 {
      %13 = arith.constant 5.000000e-01 : f64
      %14 = arith.subf %0, %9 : f64
      %15 = arith.subf %1, %10 : f64
      %16 = arith.subf %2, %11 : f64
      %17 = arith.subf %0, %6 : f64
      %18 = arith.subf %1, %7 : f64
      %19 = arith.subf %2, %8 : f64
      %20 = arith.subf %0, %3 : f64
      %21 = arith.subf %1, %4 : f64
      %22 = arith.subf %2, %5 : f64
      %23 = arith.mulf %16, %18 : f64
      %24 = arith.mulf %15, %19 : f64
      %25 = arith.subf %23, %24 : f64
      %26 = arith.mulf %16, %17 : f64
      %27 = arith.mulf %14, %19 : f64
      %28 = arith.subf %26, %27 : f64
      %29 = arith.mulf %15, %17 : f64
      %30 = arith.mulf %14, %18 : f64
      %31 = arith.subf %29, %30 : f64
      %32 = arith.mulf %20, %25 : f64
      %33 = arith.mulf %21, %28 : f64
      %34 = arith.mulf %22, %31 : f64
      %35 = arith.addf %13, %34 : f64
      %36 = arith.addf %32, %35 : f64
      %37 = arith.subf %36, %33 : f64
      %38 = arith.mulf %37, %37 : f64
      %39 = arith.mulf %12, %38 : f64
      func.return %39 : f64
    }
    func.func @m.v.gravity.value_uniforms(%0: f64) -> f64 {
      func.return %0 : f64
    }
    func.func @m.v.gravity.value(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64) -> f64 {
      %5 = arith.mulf %1, %3 : f64
      %6 = arith.mulf %4, %5 : f64
      func.return %6 : f64
    }
    func.func @m.t.swell.derive_uniforms(%0: f64) -> (f64, f64) {
      %1 = arith.constant 2.000000e+00 : f64
      %2 = arith.mulf %1, %0 : f64
      func.return %0, %2 : f64, f64
    }
    func.func @m.t.swell.derive(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64, %6: f64, %7: f64, %8: f64, %9: f64, %10: f64, %11: f64, %12: f64, %13: f64) -> (f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64) {
      %14 = arith.subf %0, %9 : f64
      %15 = arith.subf %1, %10 : f64
      %16 = arith.subf %2, %11 : f64
      %17 = arith.subf %0, %6 : f64
      %18 = arith.subf %1, %7 : f64
      %19 = arith.subf %2, %8 : f64
      %20 = arith.subf %0, %3 : f64
      %21 = arith.subf %1, %4 : f64
      %22 = arith.subf %2, %5 : f64
      %23 = arith.mulf %16, %18 : f64
      %24 = arith.mulf %15, %19 : f64
      %25 = arith.subf %23, %24 : f64
      %26 = arith.mulf %16, %17 : f64
      %27 = arith.mulf %14, %19 : f64
      %28 = arith.subf %26, %27 : f64
      %29 = arith.mulf %15, %17 : f64
      %30 = arith.mulf %14, %18 : f64
      %31 = arith.subf %29, %30 : f64
      %32 = arith.mulf %16, %21 : f64
      %33 = arith.mulf %15, %22 : f64
      %34 = arith.subf %32, %33 : f64
      %35 = arith.mulf %16, %20 : f64
      %36 = arith.mulf %14, %22 : f64
      %37 = arith.subf %35, %36 : f64
      %38 = arith.mulf %15, %20 : f64
      %39 = arith.mulf %14, %21 : f64
      %40 = arith.subf %38, %39 : f64
      %41 = arith.mulf %19, %21 : f64
      %42 = arith.mulf %18, %22 : f64
      %43 = arith.subf %41, %42 : f64
      %44 = arith.mulf %19, %20 : f64
      %45 = arith.mulf %17, %22 : f64
      %46 = arith.subf %44, %45 : f64
      %47 = arith.mulf %18, %20 : f64
      %48 = arith.mulf %17, %21 : f64
      %49 = arith.subf %47, %48 : f64
      %50 = arith.constant 5.000000e-01 : f64
      %51 = arith.mulf %20, %25 : f64
      %52 = arith.mulf %21, %28 : f64
      %53 = arith.mulf %22, %31 : f64
      %54 = arith.addf %50, %53 : f64
      %55 = arith.addf %51, %54 : f64
      %56 = arith.subf %55, %52 : f64
      %57 = arith.mulf %13, %56 : f64
      %58 = arith.mulf %25, %57 : f64
      %59 = arith.mulf %28, %57 : f64
      %60 = arith.mulf %31, %57 : f64
      %61 = arith.mulf %34, %57 : f64
      %62 = arith.mulf %37, %57 : f64
      %63 = arith.mulf %40, %57 : f64
      %64 = arith.mulf %43, %57 : f64
      %65 = arith.mulf %46, %57 : f64
      %66 = arith.mulf %49, %57 : f64
      %67 = arith.addf %58, %64 : f64
      %68 = arith.subf %67, %61 : f64
      %69 = arith.subf %62, %65 : f64
      %70 = arith.subf %69, %59 : f64
      %71 = arith.addf %60, %66 : f64
      %72 = arith.subf %71, %63 : f64
      %73 = arith.mulf %18, %57 : f64
      %74 = arith.mulf %17, %57 : f64
      %75 = arith.mulf %21, %57 : f64
      %76 = arith.mulf %20, %57 : f64
      %77 = arith.mulf %13, %49 : f64
      %78 = arith.mulf %25, %77 : f64
      %79 = arith.mulf %28, %77 : f64
      %80 = arith.mulf %31, %77 : f64
      %81 = arith.mulf %34, %77 : f64
      %82 = arith.mulf %37, %77 : f64
      %83 = arith.mulf %40, %77 : f64
      %84 = arith.mulf %43, %77 : f64
      %85 = arith.mulf %46, %77 : f64
      %86 = arith.mulf %49, %77 : f64
      %87 = arith.addf %73, %78 : f64
      %88 = arith.addf %74, %79 : f64
      %89 = arith.addf %75, %81 : f64
      %90 = arith.addf %76, %82 : f64
      %91 = arith.mulf %19, %57 : f64
      %92 = arith.mulf %22, %57 : f64
      %93 = arith.mulf %13, %46 : f64
      %94 = arith.mulf %25, %93 : f64
      %95 = arith.mulf %28, %93 : f64
      %96 = arith.mulf %31, %93 : f64
      %97 = arith.mulf %34, %93 : f64
      %98 = arith.mulf %37, %93 : f64
      %99 = arith.mulf %40, %93 : f64
      %100 = arith.mulf %43, %93 : f64
      %101 = arith.mulf %46, %93 : f64
      %102 = arith.addf %91, %94 : f64
      %103 = arith.subf %74, %96 : f64
      %104 = arith.addf %92, %97 : f64
      %105 = arith.subf %99, %76 : f64
      %106 = arith.mulf %13, %43 : f64
      %107 = arith.mulf %25, %106 : f64
      %108 = arith.mulf %28, %106 : f64
      %109 = arith.mulf %31, %106 : f64
      %110 = arith.mulf %34, %106 : f64
      %111 = arith.mulf %37, %106 : f64
      %112 = arith.mulf %40, %106 : f64
      %113 = arith.mulf %43, %106 : f64
      %114 = arith.subf %91, %108 : f64
      %115 = arith.subf %109, %73 : f64
      %116 = arith.subf %111, %92 : f64
      %117 = arith.subf %75, %112 : f64
      %118 = arith.mulf %15, %57 : f64
      %119 = arith.mulf %14, %57 : f64
      %120 = arith.mulf %13, %40 : f64
      %121 = arith.mulf %25, %120 : f64
      %122 = arith.mulf %28, %120 : f64
      %123 = arith.mulf %31, %120 : f64
      %124 = arith.mulf %34, %120 : f64
      %125 = arith.mulf %37, %120 : f64
      %126 = arith.mulf %40, %120 : f64
      %127 = arith.addf %118, %121 : f64
      %128 = arith.addf %119, %122 : f64
      %129 = arith.mulf %16, %57 : f64
      %130 = arith.mulf %13, %37 : f64
      %131 = arith.mulf %25, %130 : f64
      %132 = arith.mulf %28, %130 : f64
      %133 = arith.mulf %31, %130 : f64
      %134 = arith.mulf %34, %130 : f64
      %135 = arith.mulf %37, %130 : f64
      %136 = arith.addf %129, %131 : f64
      %137 = arith.subf %133, %119 : f64
      %138 = arith.mulf %13, %34 : f64
      %139 = arith.mulf %25, %138 : f64
      %140 = arith.mulf %28, %138 : f64
      %141 = arith.mulf %31, %138 : f64
      %142 = arith.mulf %34, %138 : f64
      %143 = arith.subf %140, %129 : f64
      %144 = arith.subf %118, %141 : f64
      %145 = arith.mulf %13, %31 : f64
      %146 = arith.mulf %25, %145 : f64
      %147 = arith.mulf %28, %145 : f64
      %148 = arith.mulf %31, %145 : f64
      %149 = arith.mulf %13, %28 : f64
      %150 = arith.mulf %25, %149 : f64
      %151 = arith.mulf %28, %149 : f64
      %152 = arith.mulf %25, %25 : f64
      %153 = arith.mulf %13, %152 : f64
      %154 = arith.mulf %56, %56 : f64
      %155 = arith.mulf %12, %154 : f64
      %156 = arith.negf %58 : f64
      %157 = arith.negf %60 : f64
      %158 = arith.negf %62 : f64
      %159 = arith.negf %64 : f64
      %160 = arith.negf %66 : f64
      %161 = arith.negf %150 : f64
      %162 = arith.negf %139 : f64
      %163 = arith.negf %127 : f64
      %164 = arith.negf %102 : f64
      %165 = arith.negf %147 : f64
      %166 = arith.negf %132 : f64
      %167 = arith.negf %88 : f64
      %168 = arith.negf %123 : f64
      %169 = arith.negf %134 : f64
      %170 = arith.negf %110 : f64
      %171 = arith.negf %89 : f64
      %172 = arith.negf %125 : f64
      %173 = arith.negf %98 : f64
      %174 = arith.negf %83 : f64
      %175 = arith.negf %100 : f64
      %176 = arith.negf %85 : f64
      %177 = arith.negf %20 : f64
      %178 = arith.negf %21 : f64
      %179 = arith.negf %22 : f64
      %180 = arith.negf %17 : f64
      %181 = arith.negf %18 : f64
      %182 = arith.negf %19 : f64
      %183 = arith.negf %14 : f64
      %184 = arith.negf %15 : f64
      %185 = arith.negf %16 : f64
      func.return %155, %68, %70, %72, %156, %59, %157, %61, %158, %63, %159, %65, %160, %153, %161, %146, %162, %136, %163, %107, %164, %87, %151, %165, %143, %166, %128, %114, %95, %167, %148, %144, %137, %168, %115, %103, %80, %142, %169, %124, %170, %104, %171, %135, %172, %116, %173, %90, %126, %117, %105, %174, %113, %175, %84, %101, %176, %86, %177, %178, %179, %180, %181, %182, %183, %184, %185 : f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64
    }
    func.func @m.t.swell.pull_back(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64, %6: f64, %7: f64, %8: f64, %9: f64, %10: f64, %11: f64, %12: f64, %13: f64, %14: f64, %15: f64, %16: f64, %17: f64, %18: f64, %19: f64, %20: f64, %21: f64, %22: f64, %23: f64, %24: f64, %25: f64, %26: f64, %27: f64, %28: f64, %29: f64, %30: f64, %31: f64, %32: f64, %33: f64, %34: f64, %35: f64, %36: f64, %37: f64, %38: f64, %39: f64, %40: f64, %41: f64, %42: f64, %43: f64, %44: f64) -> (f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64) {
      %45 = arith.addf %0, %6 : f64
      %46 = arith.addf %3, %45 : f64
      %47 = arith.addf %1, %14 : f64
      %48 = arith.addf %11, %47 : f64
      %49 = arith.addf %2, %21 : f64
      %50 = arith.addf %18, %49 : f64
      %51 = arith.addf %3, %27 : f64
      %52 = arith.addf %24, %51 : f64
      %53 = arith.addf %4, %32 : f64
      %54 = arith.addf %25, %53 : f64
      %55 = arith.addf %5, %36 : f64
      %56 = arith.addf %26, %55 : f64
      %57 = arith.addf %6, %39 : f64
      %58 = arith.addf %27, %57 : f64
      %59 = arith.addf %7, %40 : f64
      %60 = arith.addf %28, %59 : f64
      %61 = arith.addf %8, %41 : f64
      %62 = arith.addf %29, %61 : f64
      %63 = arith.addf %1, %7 : f64
      %64 = arith.addf %4, %63 : f64
      %65 = arith.addf %9, %15 : f64
      %66 = arith.addf %12, %65 : f64
      %67 = arith.addf %10, %22 : f64
      %68 = arith.addf %19, %67 : f64
      %69 = arith.addf %11, %28 : f64
      %70 = arith.addf %25, %69 : f64
      %71 = arith.addf %12, %33 : f64
      %72 = arith.addf %30, %71 : f64
      %73 = arith.addf %13, %37 : f64
      %74 = arith.addf %31, %73 : f64
      %75 = arith.addf %14, %40 : f64
      %76 = arith.addf %32, %75 : f64
      %77 = arith.addf %15, %42 : f64
      %78 = arith.addf %33, %77 : f64
      %79 = arith.addf %16, %43 : f64
      %80 = arith.addf %34, %79 : f64
      %81 = arith.addf %2, %8 : f64
      %82 = arith.addf %5, %81 : f64
      %83 = arith.addf %10, %16 : f64
      %84 = arith.addf %13, %83 : f64
      %85 = arith.addf %17, %23 : f64
      %86 = arith.addf %20, %85 : f64
      %87 = arith.addf %18, %29 : f64
      %88 = arith.addf %26, %87 : f64
      %89 = arith.addf %19, %34 : f64
      %90 = arith.addf %31, %89 : f64
      %91 = arith.addf %20, %38 : f64
      %92 = arith.addf %35, %91 : f64
      %93 = arith.addf %21, %41 : f64
      %94 = arith.addf %36, %93 : f64
      %95 = arith.addf %22, %43 : f64
      %96 = arith.addf %37, %95 : f64
      %97 = arith.addf %23, %44 : f64
      %98 = arith.addf %38, %97 : f64
      %99 = arith.addf %46, %58 : f64
      %100 = arith.addf %52, %99 : f64
      %101 = arith.addf %64, %76 : f64
      %102 = arith.addf %70, %101 : f64
      %103 = arith.addf %82, %94 : f64
      %104 = arith.addf %88, %103 : f64
      %105 = arith.addf %66, %78 : f64
      %106 = arith.addf %72, %105 : f64
      %107 = arith.addf %84, %96 : f64
      %108 = arith.addf %90, %107 : f64
      %109 = arith.addf %86, %98 : f64
      %110 = arith.addf %92, %109 : f64
      %111 = arith.negf %46 : f64
      %112 = arith.negf %48 : f64
      %113 = arith.negf %50 : f64
      %114 = arith.negf %52 : f64
      %115 = arith.negf %54 : f64
      %116 = arith.negf %56 : f64
      %117 = arith.negf %58 : f64
      %118 = arith.negf %60 : f64
      %119 = arith.negf %62 : f64
      %120 = arith.negf %64 : f64
      %121 = arith.negf %66 : f64
      %122 = arith.negf %68 : f64
      %123 = arith.negf %70 : f64
      %124 = arith.negf %72 : f64
      %125 = arith.negf %74 : f64
      %126 = arith.negf %76 : f64
      %127 = arith.negf %78 : f64
      %128 = arith.negf %80 : f64
      %129 = arith.negf %82 : f64
      %130 = arith.negf %84 : f64
      %131 = arith.negf %86 : f64
      %132 = arith.negf %88 : f64
      %133 = arith.negf %90 : f64
      %134 = arith.negf %92 : f64
      %135 = arith.negf %94 : f64
      %136 = arith.negf %96 : f64
      %137 = arith.negf %98 : f64
      func.return %100, %102, %104, %111, %112, %113, %114, %115, %116, %117, %118, %119, %106, %108, %120, %121, %122, %123, %124, %125, %126, %127, %128, %110, %129, %130, %131, %132, %133, %134, %135, %136, %137, %0, %1, %2, %3, %4, %5, %6, %7, %8, %9, %10, %11, %12, %13, %14, %15, %16, %17, %18, %19, %20, %21, %22, %23, %24, %25, %26, %27, %28, %29, %30, %31, %32, %33, %34, %35, %36, %37, %38, %39, %40, %41, %42, %43, %44 : f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64
    }
    func.func @m.v.gravity.derive_uniforms(%0: f64) -> f64 {
      func.return %0 : f64
    }
    func.func @m.v.gravity.derive(%0: f64, %1: f64) -> (f64, f64, f64, f64) {
      %2 = arith.constant 0.000000e+00 : f64
      %3 = arith.mulf %1, %0 : f64
      func.return %2, %2, %3, %2 : f64, f64, f64, f64
    }
    func.func @m.t.swell.kappa.value(%0: i32, %1: i32, %2: i32, %3: i32) -> (i32, i32, i32, i32) {
      func.return %0, %1, %2, %3 : i32, i32, i32, i32
    }
  }
}
