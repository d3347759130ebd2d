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
      %0 = rel.data @m.t.swell.numbers : 1x1
      %1 = rel.join @m.v.x through @m.t.corners : 4x3
      %2 = mat.block %1[0, 0] : 1x3
      %3 = mat.block %1[3, 0] : 1x3
      %4 = mat.sub %3, %2 : 1x3
      %5 = mat.block %1[2, 0] : 1x3
      %6 = mat.sub %5, %2 : 1x3
      %7 = mat.block %1[1, 0] : 1x3
      %8 = mat.sub %7, %2 : 1x3
      %9 = mat.concat_rows %8, %6, %4 : 3x3
      %10 = mat.det %9 : 1x1
      %11 = mat.constant 0.5 : 1x1
      %12 = mat.sub %10, %11 : 1x1
      %13 = mat.scale %0, %12 : 1x1
      %14 = mat.scale %13, %12 : 1x1
      rel.yield %14
    }
    rel.attribute @m.v.gravity on @m.v : 1x1 {
      %0 = rel.data @m.v.gravity.numbers : 1x1
      %x = rel.data @m.v.x : 3x1
      %1 = mat.block %x[1, 0] : 1x1
      %mass = rel.data @m.v.mass : 1x1
      %2 = mat.scale %0, %mass : 1x1
      %3 = mat.scale %2, %1 : 1x1
      rel.yield %3
    }
    rel.energy @m.t.swell projection "clamp"
    rel.energy @m.v.gravity projection "clamp"
    rel.target @m.v.x
    rel.derivative @m.t.swell.derivative of @m.t.swell on @m.t projection "clamp" indices @m.t.swell.kappa projects "9x9 of 12x12: the energy reads its inputs through a linear cut; by singular values: isotropic in this 3x3 matrix" {
      %0 = rel.data @m.t.swell.numbers : 1x1
      %1 = rel.join @m.v.x through @m.t.corners : 4x3
      %2 = mat.block %1[0, 0] : 1x3
      %3 = mat.block %1[3, 0] : 1x3
      %4 = mat.sub %3, %2 : 1x3
      %5 = mat.block %1[2, 0] : 1x3
      %6 = mat.sub %5, %2 : 1x3
      %7 = mat.block %1[1, 0] : 1x3
      %8 = mat.sub %7, %2 : 1x3
      %9 = mat.concat_rows %8, %6, %4 : 3x3
      %10 = mat.det %9 : 1x1
      %11 = mat.constant 0.5 : 1x1
      %12 = mat.sub %10, %11 : 1x1
      %13 = mat.scale %0, %12 : 1x1
      %14 = mat.scale %13, %12 : 1x1
      %15 = mat.constant 1.0 : 1x1
      %16 = mat.scale %12, %12 : 1x1
      %17 = mat.add %13, %13 : 1x1
      %18 = mat.neg %17 : 1x1
      %19 = mat.cofactor %9 : 3x3
      %20 = mat.scale %17, %19 : 3x3
      %21 = mat.constant 0.0 : 3x3
      %22 = mat.constant [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %23 = mat.constant [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %24 = mat.constant [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %25 = mat.constant [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %26 = mat.constant [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]] : 3x3
      %27 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]] : 3x3
      %28 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]] : 3x3
      %29 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]] : 3x3
      %30 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]] : 3x3
      %31 = mat.constant 0.0 : 1x3
      %32 = mat.cross %31, %4 : 1x3
      %33 = mat.cross %6, %31 : 1x3
      %34 = mat.add %32, %33 : 1x3
      %35 = mat.cross %31, %8 : 1x3
      %36 = mat.constant [[1.0, 0.0, 0.0]] : 1x3
      %37 = mat.cross %4, %36 : 1x3
      %38 = mat.add %35, %37 : 1x3
      %39 = mat.cross %36, %6 : 1x3
      %40 = mat.cross %8, %31 : 1x3
      %41 = mat.add %39, %40 : 1x3
      %42 = mat.concat_rows %34, %38, %41 : 3x3
      %43 = mat.add %0, %0 : 1x1
      %44 = mat.dot %19, %22 : 1x1
      %45 = mat.scale %43, %44 : 1x1
      %46 = mat.scale %45, %19 : 3x3
      %47 = mat.scale %17, %42 : 3x3
      %48 = mat.add %46, %47 : 3x3
      %49 = mat.reshape %48 : 9x1
      %50 = mat.constant [[0.0, 1.0, 0.0]] : 1x3
      %51 = mat.cross %4, %50 : 1x3
      %52 = mat.add %35, %51 : 1x3
      %53 = mat.cross %50, %6 : 1x3
      %54 = mat.add %53, %40 : 1x3
      %55 = mat.concat_rows %34, %52, %54 : 3x3
      %56 = mat.dot %19, %23 : 1x1
      %57 = mat.scale %43, %56 : 1x1
      %58 = mat.scale %57, %19 : 3x3
      %59 = mat.scale %17, %55 : 3x3
      %60 = mat.add %58, %59 : 3x3
      %61 = mat.reshape %60 : 9x1
      %62 = mat.constant [[0.0, 0.0, 1.0]] : 1x3
      %63 = mat.cross %4, %62 : 1x3
      %64 = mat.add %35, %63 : 1x3
      %65 = mat.cross %62, %6 : 1x3
      %66 = mat.add %65, %40 : 1x3
      %67 = mat.concat_rows %34, %64, %66 : 3x3
      %68 = mat.dot %19, %24 : 1x1
      %69 = mat.scale %43, %68 : 1x1
      %70 = mat.scale %69, %19 : 3x3
      %71 = mat.scale %17, %67 : 3x3
      %72 = mat.add %70, %71 : 3x3
      %73 = mat.reshape %72 : 9x1
      %74 = mat.cross %36, %4 : 1x3
      %75 = mat.add %74, %33 : 1x3
      %76 = mat.cross %4, %31 : 1x3
      %77 = mat.add %35, %76 : 1x3
      %78 = mat.cross %31, %6 : 1x3
      %79 = mat.cross %8, %36 : 1x3
      %80 = mat.add %78, %79 : 1x3
      %81 = mat.concat_rows %75, %77, %80 : 3x3
      %82 = mat.dot %19, %25 : 1x1
      %83 = mat.scale %43, %82 : 1x1
      %84 = mat.scale %83, %19 : 3x3
      %85 = mat.scale %17, %81 : 3x3
      %86 = mat.add %84, %85 : 3x3
      %87 = mat.reshape %86 : 9x1
      %88 = mat.cross %50, %4 : 1x3
      %89 = mat.add %88, %33 : 1x3
      %90 = mat.cross %8, %50 : 1x3
      %91 = mat.add %78, %90 : 1x3
      %92 = mat.concat_rows %89, %77, %91 : 3x3
      %93 = mat.dot %19, %26 : 1x1
      %94 = mat.scale %43, %93 : 1x1
      %95 = mat.scale %94, %19 : 3x3
      %96 = mat.scale %17, %92 : 3x3
      %97 = mat.add %95, %96 : 3x3
      %98 = mat.reshape %97 : 9x1
      %99 = mat.cross %62, %4 : 1x3
      %100 = mat.add %99, %33 : 1x3
      %101 = mat.cross %8, %62 : 1x3
      %102 = mat.add %78, %101 : 1x3
      %103 = mat.concat_rows %100, %77, %102 : 3x3
      %104 = mat.dot %19, %27 : 1x1
      %105 = mat.scale %43, %104 : 1x1
      %106 = mat.scale %105, %19 : 3x3
      %107 = mat.scale %17, %103 : 3x3
      %108 = mat.add %106, %107 : 3x3
      %109 = mat.reshape %108 : 9x1
      %110 = mat.cross %6, %36 : 1x3
      %111 = mat.add %32, %110 : 1x3
      %112 = mat.cross %36, %8 : 1x3
      %113 = mat.add %112, %76 : 1x3
      %114 = mat.add %78, %40 : 1x3
      %115 = mat.concat_rows %111, %113, %114 : 3x3
      %116 = mat.dot %19, %28 : 1x1
      %117 = mat.scale %43, %116 : 1x1
      %118 = mat.scale %117, %19 : 3x3
      %119 = mat.scale %17, %115 : 3x3
      %120 = mat.add %118, %119 : 3x3
      %121 = mat.reshape %120 : 9x1
      %122 = mat.cross %6, %50 : 1x3
      %123 = mat.add %32, %122 : 1x3
      %124 = mat.cross %50, %8 : 1x3
      %125 = mat.add %124, %76 : 1x3
      %126 = mat.concat_rows %123, %125, %114 : 3x3
      %127 = mat.dot %19, %29 : 1x1
      %128 = mat.scale %43, %127 : 1x1
      %129 = mat.scale %128, %19 : 3x3
      %130 = mat.scale %17, %126 : 3x3
      %131 = mat.add %129, %130 : 3x3
      %132 = mat.reshape %131 : 9x1
      %133 = mat.cross %6, %62 : 1x3
      %134 = mat.add %32, %133 : 1x3
      %135 = mat.cross %62, %8 : 1x3
      %136 = mat.add %135, %76 : 1x3
      %137 = mat.concat_rows %134, %136, %114 : 3x3
      %138 = mat.dot %19, %30 : 1x1
      %139 = mat.scale %43, %138 : 1x1
      %140 = mat.scale %139, %19 : 3x3
      %141 = mat.scale %17, %137 : 3x3
      %142 = mat.add %140, %141 : 3x3
      %143 = mat.reshape %142 : 9x1
      %144 = mat.concat_cols %49, %61, %73, %87, %98, %109, %121, %132, %143 : 9x9
      %145 = mat.constant [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %146 = mat.constant [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %147 = mat.constant [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %148 = mat.constant [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %149 = mat.constant [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %150 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %151 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %152 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]] : 4x3
      %153 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]] : 4x3
      %154 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]] : 4x3
      %155 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]] : 4x3
      %156 = mat.constant [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]] : 4x3
      %157 = mat.constant [[-1.0, 0.0, 0.0]] : 1x3
      %158 = mat.constant [[-1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]] : 3x3
      %159 = mat.constant [[-1.0], [0.0], [0.0], [-1.0], [0.0], [0.0], [-1.0], [0.0], [0.0]] : 9x1
      %160 = mat.constant [[0.0, -1.0, 0.0]] : 1x3
      %161 = mat.constant [[0.0, -1.0, 0.0], [0.0, -1.0, 0.0], [0.0, -1.0, 0.0]] : 3x3
      %162 = mat.constant [[0.0], [-1.0], [0.0], [0.0], [-1.0], [0.0], [0.0], [-1.0], [0.0]] : 9x1
      %163 = mat.constant [[0.0, 0.0, -1.0]] : 1x3
      %164 = mat.constant [[0.0, 0.0, -1.0], [0.0, 0.0, -1.0], [0.0, 0.0, -1.0]] : 3x3
      %165 = mat.constant [[0.0], [0.0], [-1.0], [0.0], [0.0], [-1.0], [0.0], [0.0], [-1.0]] : 9x1
      %166 = mat.constant [[1.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0]] : 9x1
      %167 = mat.constant [[0.0], [1.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0]] : 9x1
      %168 = mat.constant [[0.0], [0.0], [1.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0]] : 9x1
      %169 = mat.constant [[0.0], [0.0], [0.0], [1.0], [0.0], [0.0], [0.0], [0.0], [0.0]] : 9x1
      %170 = mat.constant [[0.0], [0.0], [0.0], [0.0], [1.0], [0.0], [0.0], [0.0], [0.0]] : 9x1
      %171 = mat.constant [[0.0], [0.0], [0.0], [0.0], [0.0], [1.0], [0.0], [0.0], [0.0]] : 9x1
      %172 = mat.constant [[0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [1.0], [0.0], [0.0]] : 9x1
      %173 = mat.constant [[0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [1.0], [0.0]] : 9x1
      %174 = mat.constant [[0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [1.0]] : 9x1
      %175 = mat.constant [[-1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]] : 9x12
      %176 = mat.congruence %144, %175 : 12x12
      %177 = mat.block %20[0, 0] : 1x3
      %178 = mat.block %20[1, 0] : 1x3
      %179 = mat.block %20[2, 0] : 1x3
      %180 = mat.neg %177 : 1x3
      %181 = mat.embed %177[1, 0] : 4x3
      %182 = mat.neg %178 : 1x3
      %183 = mat.embed %178[2, 0] : 4x3
      %184 = mat.neg %179 : 1x3
      %185 = mat.embed %179[3, 0] : 4x3
      %186 = mat.add %180, %182 : 1x3
      %187 = mat.add %186, %184 : 1x3
      %188 = mat.embed %187[0, 0] : 4x3
      %189 = mat.add %181, %183 : 4x3
      %190 = mat.add %189, %185 : 4x3
      %191 = mat.add %190, %188 : 4x3
      %192 = mat.reshape %191 : 12x1
      %193 = mat.project_psd %144 mode "clamp" isotropic in %9 : 9x9
      %194 = mat.congruence %193, %175 : 12x12
      rel.yield_derivative %14 gradient %192 hessian %194 cut %9 wrt %1
    }
    rel.derivative @m.v.gravity.derivative of @m.v.gravity on @m.v projection "clamp" indices @m.v.gravity.kappa projects "nowhere: the energy is affine, its Hessian is zero" {
      %0 = rel.data @m.v.gravity.numbers : 1x1
      %x = rel.data @m.v.x : 3x1
      %1 = mat.block %x[1, 0] : 1x1
      %mass = rel.data @m.v.mass : 1x1
      %2 = mat.scale %0, %mass : 1x1
      %3 = mat.scale %2, %1 : 1x1
      %4 = mat.constant 1.0 : 1x1
      %5 = mat.constant 0.0 : 3x1
      %6 = mat.constant 0.0 : 1x1
      %7 = mat.embed %2[1, 0] : 3x1
      rel.yield_derivative %6 gradient %7 wrt %x
    }
    rel.attribute @m.v.x.kappa on @m.v : 1x1xi32 {
      %0 = rel.target_index @m.v.x : 1x1xi32
      rel.yield %0
    }
    rel.attribute @m.t.swell.kappa on @m.t : 1x4xi32 {
      %0 = rel.join @m.v.x.kappa through @m.t.corners : 4x1xi32
      %1 = mat.reshape %0 : 1x4xi32
      rel.yield %1
    }
    rel.attribute @m.v.gravity.kappa on @m.v : 1x1xi32 {
      %0 = rel.target_index @m.v.x : 1x1xi32
      rel.yield %0
    }
  }
}
