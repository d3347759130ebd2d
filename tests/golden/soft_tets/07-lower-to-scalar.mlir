builtin.module {
  rel.scene @soft_tets {
    rel.mesh @m in @soft_tets
    rel.primitive @m.t in @m size 1 : i64
    rel.primitive @m.v in @m size 4 : i64
    rel.connectivity @m.t.corners from @m.t to @m.v arity 4 : i64
    rel.storage @m.v.x on @m.v : tensor<3x1xf64>
    rel.storage @m.v.mass on @m.v : tensor<1x1xf64> constant
    rel.attribute @m.t.swell on @m.t : tensor<1x1xf64> {
      %0 = rel.join @m.v.x through @m.t.corners : tensor<4x3xf64>
      %1 = rel.apply @m.t.swell.value(%0) : (tensor<4x3xf64>) -> tensor<1x1xf64>
      rel.yield %1 : tensor<1x1xf64>
    }
    rel.attribute @m.v.gravity on @m.v : tensor<1x1xf64> {
      %x = rel.data @m.v.x : tensor<3x1xf64>
      %mass = rel.data @m.v.mass : tensor<1x1xf64>
      %0 = rel.apply @m.v.gravity.value(%x, %mass) : (tensor<3x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      rel.yield %0 : tensor<1x1xf64>
    }
    rel.energy @m.t.swell projection "clamp"
    rel.energy @m.v.gravity projection "clamp"
    rel.target @m.v.x
    rel.derivative @m.t.swell.derivative of @m.t.swell on @m.t projection "clamp" indices @m.t.swell.kappa projects "9x9 of 12x12: the energy reads its inputs through a linear cut" {
      %0 = rel.join @m.v.x through @m.t.corners : tensor<4x3xf64>
      %1, %2 = rel.apply @m.t.swell.derive(%0) : (tensor<4x3xf64>) -> (tensor<12x1xf64>, tensor<45x1xf64>)
      %3 = rel.project %2 width 9 : i64 mode "clamp" : tensor<45x1xf64> -> tensor<45x1xf64>
      %4 = rel.apply @m.t.swell.pull_back(%3) : (tensor<45x1xf64>) -> tensor<78x1xf64>
      rel.yield_derivative gradient %1 : tensor<12x1xf64> hessian %4 : tensor<78x1xf64> wrt %0 : tensor<4x3xf64>
    }
    rel.derivative @m.v.gravity.derivative of @m.v.gravity on @m.v projection "clamp" indices @m.v.gravity.kappa projects "nowhere: the energy is affine, its Hessian is zero" {
      %x = rel.data @m.v.x : tensor<3x1xf64>
      %mass = rel.data @m.v.mass : tensor<1x1xf64>
      %0 = rel.apply @m.v.gravity.derive(%mass) : (tensor<1x1xf64>) -> tensor<3x1xf64>
      rel.yield_derivative gradient %0 : tensor<3x1xf64> wrt %x : tensor<3x1xf64>
    }
    rel.attribute @m.v.x.kappa on @m.v : tensor<1x1xi32> {
      %0 = rel.target_index @m.v.x : tensor<1x1xi32>
      rel.yield %0 : tensor<1x1xi32>
    }
    rel.attribute @m.t.swell.kappa on @m.t : tensor<1x4xi32> {
      %0 = rel.join @m.v.x.kappa through @m.t.corners : tensor<4x1xi32>
      %1 = rel.apply @m.t.swell.kappa.value(%0) : (tensor<4x1xi32>) -> tensor<1x4xi32>
      rel.yield %1 : tensor<1x4xi32>
    }
    rel.attribute @m.v.gravity.kappa on @m.v : tensor<1x1xi32> {
      %0 = rel.target_index @m.v.x : tensor<1x1xi32>
      rel.yield %0 : tensor<1x1xi32>
    }
    func.func @m.t.swell.value(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64, %6: f64, %7: f64, %8: f64, %9: f64, %10: f64, %11: f64) -> f64 {
      %12 = arith.constant 5.000000e-01 : f64
      %13 = arith.subf %0, %9 : f64
      %14 = arith.subf %1, %10 : f64
      %15 = arith.subf %2, %11 : f64
      %16 = arith.subf %0, %6 : f64
      %17 = arith.subf %1, %7 : f64
      %18 = arith.subf %2, %8 : f64
      %19 = arith.subf %0, %3 : f64
      %20 = arith.subf %1, %4 : f64
      %21 = arith.subf %2, %5 : f64
      %22 = arith.mulf %15, %17 : f64
      %23 = arith.mulf %14, %18 : f64
      %24 = arith.subf %22, %23 : f64
      %25 = arith.mulf %15, %16 : f64
      %26 = arith.mulf %13, %18 : f64
      %27 = arith.subf %25, %26 : f64
      %28 = arith.mulf %14, %16 : f64
      %29 = arith.mulf %13, %17 : f64
      %30 = arith.subf %28, %29 : f64
      %31 = arith.mulf %19, %24 : f64
      %32 = arith.mulf %20, %27 : f64
      %33 = arith.mulf %21, %30 : f64
      %34 = arith.subf %31, %32 : f64
      %35 = arith.addf %33, %34 : f64
      %36 = arith.addf %12, %35 : f64
      %37 = arith.constant 3.000000e+00 : f64
      %38 = arith.mulf %37, %36 : f64
      %39 = arith.mulf %36, %38 : f64
      func.return %39 : f64
    }
    func.func @m.v.gravity.value(%0: f64, %1: f64, %2: f64, %3: f64) -> f64 {
      %4 = arith.constant 9.800000e+00 : f64
      %5 = arith.mulf %4, %3 : f64
      %6 = arith.mulf %1, %5 : f64
      func.return %6 : f64
    }
    func.func @m.t.swell.derive(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64, %6: f64, %7: f64, %8: f64, %9: f64, %10: f64, %11: f64) -> (f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64) {
      %12 = arith.subf %0, %9 : f64
      %13 = arith.subf %1, %10 : f64
      %14 = arith.subf %2, %11 : f64
      %15 = arith.subf %0, %6 : f64
      %16 = arith.subf %1, %7 : f64
      %17 = arith.subf %2, %8 : f64
      %18 = arith.subf %0, %3 : f64
      %19 = arith.subf %1, %4 : f64
      %20 = arith.subf %2, %5 : f64
      %21 = arith.mulf %14, %16 : f64
      %22 = arith.mulf %13, %17 : f64
      %23 = arith.subf %21, %22 : f64
      %24 = arith.mulf %14, %15 : f64
      %25 = arith.mulf %12, %17 : f64
      %26 = arith.subf %24, %25 : f64
      %27 = arith.mulf %13, %15 : f64
      %28 = arith.mulf %12, %16 : f64
      %29 = arith.subf %27, %28 : f64
      %30 = arith.mulf %14, %19 : f64
      %31 = arith.mulf %13, %20 : f64
      %32 = arith.subf %30, %31 : f64
      %33 = arith.mulf %14, %18 : f64
      %34 = arith.mulf %12, %20 : f64
      %35 = arith.subf %33, %34 : f64
      %36 = arith.mulf %13, %18 : f64
      %37 = arith.mulf %12, %19 : f64
      %38 = arith.subf %36, %37 : f64
      %39 = arith.mulf %17, %19 : f64
      %40 = arith.mulf %16, %20 : f64
      %41 = arith.subf %39, %40 : f64
      %42 = arith.mulf %17, %18 : f64
      %43 = arith.mulf %15, %20 : f64
      %44 = arith.subf %42, %43 : f64
      %45 = arith.mulf %16, %18 : f64
      %46 = arith.mulf %15, %19 : f64
      %47 = arith.subf %45, %46 : f64
      %48 = arith.constant 5.000000e-01 : f64
      %49 = arith.mulf %18, %23 : f64
      %50 = arith.mulf %19, %26 : f64
      %51 = arith.mulf %20, %29 : f64
      %52 = arith.subf %49, %50 : f64
      %53 = arith.addf %51, %52 : f64
      %54 = arith.addf %48, %53 : f64
      %55 = arith.constant 3.000000e+00 : f64
      %56 = arith.mulf %55, %54 : f64
      %57 = arith.addf %56, %56 : f64
      %58 = arith.mulf %23, %57 : f64
      %59 = arith.negf %58 : f64
      %60 = arith.mulf %26, %57 : f64
      %61 = arith.mulf %29, %57 : f64
      %62 = arith.negf %61 : f64
      %63 = arith.mulf %32, %57 : f64
      %64 = arith.mulf %35, %57 : f64
      %65 = arith.negf %64 : f64
      %66 = arith.mulf %38, %57 : f64
      %67 = arith.mulf %41, %57 : f64
      %68 = arith.negf %67 : f64
      %69 = arith.mulf %44, %57 : f64
      %70 = arith.mulf %47, %57 : f64
      %71 = arith.negf %70 : f64
      %72 = arith.subf %58, %63 : f64
      %73 = arith.subf %60, %64 : f64
      %74 = arith.subf %61, %66 : f64
      %75 = arith.addf %67, %72 : f64
      %76 = arith.addf %69, %73 : f64
      %77 = arith.negf %76 : f64
      %78 = arith.addf %70, %74 : f64
      %79 = arith.mulf %16, %57 : f64
      %80 = arith.mulf %15, %57 : f64
      %81 = arith.mulf %19, %57 : f64
      %82 = arith.mulf %18, %57 : f64
      %83 = arith.mulf %55, %47 : f64
      %84 = arith.addf %83, %83 : f64
      %85 = arith.mulf %23, %84 : f64
      %86 = arith.mulf %26, %84 : f64
      %87 = arith.mulf %29, %84 : f64
      %88 = arith.mulf %32, %84 : f64
      %89 = arith.mulf %35, %84 : f64
      %90 = arith.mulf %38, %84 : f64
      %91 = arith.negf %90 : f64
      %92 = arith.mulf %41, %84 : f64
      %93 = arith.mulf %44, %84 : f64
      %94 = arith.negf %93 : f64
      %95 = arith.mulf %47, %84 : f64
      %96 = arith.addf %79, %85 : f64
      %97 = arith.addf %80, %86 : f64
      %98 = arith.negf %97 : f64
      %99 = arith.addf %81, %88 : f64
      %100 = arith.negf %99 : f64
      %101 = arith.addf %82, %89 : f64
      %102 = arith.mulf %17, %57 : f64
      %103 = arith.mulf %20, %57 : f64
      %104 = arith.mulf %55, %44 : f64
      %105 = arith.addf %104, %104 : f64
      %106 = arith.mulf %23, %105 : f64
      %107 = arith.mulf %26, %105 : f64
      %108 = arith.mulf %29, %105 : f64
      %109 = arith.mulf %32, %105 : f64
      %110 = arith.mulf %35, %105 : f64
      %111 = arith.negf %110 : f64
      %112 = arith.mulf %38, %105 : f64
      %113 = arith.mulf %41, %105 : f64
      %114 = arith.negf %113 : f64
      %115 = arith.mulf %44, %105 : f64
      %116 = arith.addf %102, %106 : f64
      %117 = arith.negf %116 : f64
      %118 = arith.subf %80, %108 : f64
      %119 = arith.addf %103, %109 : f64
      %120 = arith.subf %82, %112 : f64
      %121 = arith.negf %120 : f64
      %122 = arith.mulf %55, %41 : f64
      %123 = arith.addf %122, %122 : f64
      %124 = arith.mulf %23, %123 : f64
      %125 = arith.mulf %26, %123 : f64
      %126 = arith.mulf %29, %123 : f64
      %127 = arith.mulf %32, %123 : f64
      %128 = arith.negf %127 : f64
      %129 = arith.mulf %35, %123 : f64
      %130 = arith.mulf %38, %123 : f64
      %131 = arith.mulf %41, %123 : f64
      %132 = arith.subf %102, %125 : f64
      %133 = arith.subf %79, %126 : f64
      %134 = arith.negf %133 : f64
      %135 = arith.subf %103, %129 : f64
      %136 = arith.negf %135 : f64
      %137 = arith.subf %81, %130 : f64
      %138 = arith.mulf %13, %57 : f64
      %139 = arith.mulf %12, %57 : f64
      %140 = arith.mulf %55, %38 : f64
      %141 = arith.addf %140, %140 : f64
      %142 = arith.mulf %23, %141 : f64
      %143 = arith.mulf %26, %141 : f64
      %144 = arith.mulf %29, %141 : f64
      %145 = arith.negf %144 : f64
      %146 = arith.mulf %32, %141 : f64
      %147 = arith.mulf %35, %141 : f64
      %148 = arith.negf %147 : f64
      %149 = arith.mulf %38, %141 : f64
      %150 = arith.addf %138, %142 : f64
      %151 = arith.negf %150 : f64
      %152 = arith.addf %139, %143 : f64
      %153 = arith.mulf %14, %57 : f64
      %154 = arith.mulf %55, %35 : f64
      %155 = arith.addf %154, %154 : f64
      %156 = arith.mulf %23, %155 : f64
      %157 = arith.mulf %26, %155 : f64
      %158 = arith.negf %157 : f64
      %159 = arith.mulf %29, %155 : f64
      %160 = arith.mulf %32, %155 : f64
      %161 = arith.negf %160 : f64
      %162 = arith.mulf %35, %155 : f64
      %163 = arith.addf %153, %156 : f64
      %164 = arith.subf %139, %159 : f64
      %165 = arith.negf %164 : f64
      %166 = arith.mulf %55, %32 : f64
      %167 = arith.addf %166, %166 : f64
      %168 = arith.mulf %23, %167 : f64
      %169 = arith.negf %168 : f64
      %170 = arith.mulf %26, %167 : f64
      %171 = arith.mulf %29, %167 : f64
      %172 = arith.mulf %32, %167 : f64
      %173 = arith.subf %153, %170 : f64
      %174 = arith.negf %173 : f64
      %175 = arith.subf %138, %171 : f64
      %176 = arith.mulf %55, %29 : f64
      %177 = arith.addf %176, %176 : f64
      %178 = arith.mulf %23, %177 : f64
      %179 = arith.mulf %26, %177 : f64
      %180 = arith.negf %179 : f64
      %181 = arith.mulf %29, %177 : f64
      %182 = arith.mulf %55, %26 : f64
      %183 = arith.addf %182, %182 : f64
      %184 = arith.mulf %23, %183 : f64
      %185 = arith.negf %184 : f64
      %186 = arith.mulf %26, %183 : f64
      %187 = arith.mulf %55, %23 : f64
      %188 = arith.addf %187, %187 : f64
      %189 = arith.mulf %23, %188 : f64
      func.return %75, %77, %78, %59, %60, %62, %63, %65, %66, %68, %69, %71, %189, %185, %178, %169, %163, %151, %124, %117, %96, %186, %180, %174, %158, %152, %132, %107, %98, %181, %175, %165, %145, %134, %118, %87, %172, %161, %146, %128, %119, %100, %162, %148, %136, %111, %101, %149, %137, %121, %91, %131, %114, %92, %115, %94, %95 : f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64
    }
    func.func @m.t.swell.pull_back(%0: f64, %1: f64, %2: f64, %3: f64, %4: f64, %5: f64, %6: f64, %7: f64, %8: f64, %9: f64, %10: f64, %11: f64, %12: f64, %13: f64, %14: f64, %15: f64, %16: f64, %17: f64, %18: f64, %19: f64, %20: f64, %21: f64, %22: f64, %23: f64, %24: f64, %25: f64, %26: f64, %27: f64, %28: f64, %29: f64, %30: f64, %31: f64, %32: f64, %33: f64, %34: f64, %35: f64, %36: f64, %37: f64, %38: f64, %39: f64, %40: f64, %41: f64, %42: f64, %43: f64, %44: f64) -> (f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64) {
      %45 = arith.addf %0, %3 : f64
      %46 = arith.addf %6, %45 : f64
      %47 = arith.negf %46 : f64
      %48 = arith.addf %1, %11 : f64
      %49 = arith.addf %14, %48 : f64
      %50 = arith.negf %49 : f64
      %51 = arith.addf %2, %18 : f64
      %52 = arith.addf %21, %51 : f64
      %53 = arith.negf %52 : f64
      %54 = arith.addf %3, %24 : f64
      %55 = arith.addf %27, %54 : f64
      %56 = arith.negf %55 : f64
      %57 = arith.addf %4, %25 : f64
      %58 = arith.addf %32, %57 : f64
      %59 = arith.negf %58 : f64
      %60 = arith.addf %5, %26 : f64
      %61 = arith.addf %36, %60 : f64
      %62 = arith.negf %61 : f64
      %63 = arith.addf %6, %27 : f64
      %64 = arith.addf %39, %63 : f64
      %65 = arith.negf %64 : f64
      %66 = arith.addf %7, %28 : f64
      %67 = arith.addf %40, %66 : f64
      %68 = arith.negf %67 : f64
      %69 = arith.addf %8, %29 : f64
      %70 = arith.addf %41, %69 : f64
      %71 = arith.negf %70 : f64
      %72 = arith.addf %1, %4 : f64
      %73 = arith.addf %7, %72 : f64
      %74 = arith.negf %73 : f64
      %75 = arith.addf %9, %12 : f64
      %76 = arith.addf %15, %75 : f64
      %77 = arith.negf %76 : f64
      %78 = arith.addf %10, %19 : f64
      %79 = arith.addf %22, %78 : f64
      %80 = arith.negf %79 : f64
      %81 = arith.addf %11, %25 : f64
      %82 = arith.addf %28, %81 : f64
      %83 = arith.negf %82 : f64
      %84 = arith.addf %12, %30 : f64
      %85 = arith.addf %33, %84 : f64
      %86 = arith.negf %85 : f64
      %87 = arith.addf %13, %31 : f64
      %88 = arith.addf %37, %87 : f64
      %89 = arith.negf %88 : f64
      %90 = arith.addf %14, %32 : f64
      %91 = arith.addf %40, %90 : f64
      %92 = arith.negf %91 : f64
      %93 = arith.addf %15, %33 : f64
      %94 = arith.addf %42, %93 : f64
      %95 = arith.negf %94 : f64
      %96 = arith.addf %16, %34 : f64
      %97 = arith.addf %43, %96 : f64
      %98 = arith.negf %97 : f64
      %99 = arith.addf %2, %5 : f64
      %100 = arith.addf %8, %99 : f64
      %101 = arith.negf %100 : f64
      %102 = arith.addf %10, %13 : f64
      %103 = arith.addf %16, %102 : f64
      %104 = arith.negf %103 : f64
      %105 = arith.addf %17, %20 : f64
      %106 = arith.addf %23, %105 : f64
      %107 = arith.negf %106 : f64
      %108 = arith.addf %18, %26 : f64
      %109 = arith.addf %29, %108 : f64
      %110 = arith.negf %109 : f64
      %111 = arith.addf %19, %31 : f64
      %112 = arith.addf %34, %111 : f64
      %113 = arith.negf %112 : f64
      %114 = arith.addf %20, %35 : f64
      %115 = arith.addf %38, %114 : f64
      %116 = arith.negf %115 : f64
      %117 = arith.addf %21, %36 : f64
      %118 = arith.addf %41, %117 : f64
      %119 = arith.negf %118 : f64
      %120 = arith.addf %22, %37 : f64
      %121 = arith.addf %43, %120 : f64
      %122 = arith.negf %121 : f64
      %123 = arith.addf %23, %38 : f64
      %124 = arith.addf %44, %123 : f64
      %125 = arith.negf %124 : f64
      %126 = arith.addf %46, %55 : f64
      %127 = arith.addf %64, %126 : f64
      %128 = arith.addf %73, %82 : f64
      %129 = arith.addf %91, %128 : f64
      %130 = arith.addf %100, %109 : f64
      %131 = arith.addf %118, %130 : f64
      %132 = arith.addf %76, %85 : f64
      %133 = arith.addf %94, %132 : f64
      %134 = arith.addf %103, %112 : f64
      %135 = arith.addf %121, %134 : f64
      %136 = arith.addf %106, %115 : f64
      %137 = arith.addf %124, %136 : f64
      func.return %127, %129, %131, %47, %50, %53, %56, %59, %62, %65, %68, %71, %133, %135, %74, %77, %80, %83, %86, %89, %92, %95, %98, %137, %101, %104, %107, %110, %113, %116, %119, %122, %125, %0, %1, %2, %3, %4, %5, %6, %7, %8, %9, %10, %11, %12, %13, %14, %15, %16, %17, %18, %19, %20, %21, %22, %23, %24, %25, %26, %27, %28, %29, %30, %31, %32, %33, %34, %35, %36, %37, %38, %39, %40, %41, %42, %43, %44 : f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64, f64
    }
    func.func @m.v.gravity.derive(%0: f64) -> (f64, f64, f64) {
      %1 = arith.constant 0.000000e+00 : f64
      %2 = arith.constant 9.800000e+00 : f64
      %3 = arith.mulf %2, %0 : f64
      func.return %1, %3, %1 : f64, f64, f64
    }
    func.func @m.t.swell.kappa.value(%0: i32, %1: i32, %2: i32, %3: i32) -> (i32, i32, i32, i32) {
      func.return %0, %1, %2, %3 : i32, i32, i32, i32
    }
  }
}
