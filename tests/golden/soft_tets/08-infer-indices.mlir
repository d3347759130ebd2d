builtin.module {
  rel.scene @soft_tets {
    rel.mesh @m in @soft_tets
    rel.primitive @m.t in @m size 1 : i64
    rel.primitive @m.v in @m size 4 : i64
    rel.connectivity @m.t.corners from @m.t to @m.v arity 4 : i64
    rel.storage @m.v.x on @m.v : tensor<3x1xf64>
    rel.storage @m.v.mass on @m.v : tensor<1x1xf64> constant
    rel.attribute @m.t.swell on @m.t : tensor<1x1xf64> {
      %0 = mat.constant {value = dense<5.000000e-01> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %1 = rel.join @m.v.x through @m.t.corners : tensor<4x3xf64>
      %2 = mat.block %1 {block = array<i64: 0, 0, 1, 3>} : (tensor<4x3xf64>) -> tensor<1x3xf64>
      %3 = mat.block %1 {block = array<i64: 3, 0, 1, 3>} : (tensor<4x3xf64>) -> tensor<1x3xf64>
      %4 = mat.sub %3, %2 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %5 = mat.block %1 {block = array<i64: 2, 0, 1, 3>} : (tensor<4x3xf64>) -> tensor<1x3xf64>
      %6 = mat.sub %5, %2 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %7 = mat.block %1 {block = array<i64: 1, 0, 1, 3>} : (tensor<4x3xf64>) -> tensor<1x3xf64>
      %8 = mat.sub %7, %2 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %9 = mat.concat_rows %8, %6, %4 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %10 = mat.det %9 : (tensor<3x3xf64>) -> tensor<1x1xf64>
      %11 = mat.sub %10, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %12 = mat.constant {value = dense<3.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %13 = mat.scale %12, %11 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %14 = mat.scale %13, %11 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      rel.yield %14 : tensor<1x1xf64>
    }
    rel.attribute @m.v.gravity on @m.v : tensor<1x1xf64> {
      %x = rel.data @m.v.x : tensor<3x1xf64>
      %0 = mat.block %x {block = array<i64: 1, 0, 1, 1>} : (tensor<3x1xf64>) -> tensor<1x1xf64>
      %mass = rel.data @m.v.mass : tensor<1x1xf64>
      %1 = mat.constant {value = dense<9.800000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %2 = mat.scale %1, %mass : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %3 = mat.scale %2, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      rel.yield %3 : tensor<1x1xf64>
    }
    rel.energy @m.t.swell projection "clamp"
    rel.energy @m.v.gravity projection "clamp"
    rel.target @m.v.x
    rel.derivative @m.t.swell.derivative of @m.t.swell on @m.t projection "clamp" indices @m.t.swell.kappa projects "9x9 of 12x12: the energy reads its inputs through a linear cut; by singular values: isotropic in this 3x3 matrix" {
      %0 = mat.constant {value = dense<5.000000e-01> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %1 = rel.join @m.v.x through @m.t.corners : tensor<4x3xf64>
      %2 = mat.block %1 {block = array<i64: 0, 0, 1, 3>} : (tensor<4x3xf64>) -> tensor<1x3xf64>
      %3 = mat.block %1 {block = array<i64: 3, 0, 1, 3>} : (tensor<4x3xf64>) -> tensor<1x3xf64>
      %4 = mat.sub %3, %2 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %5 = mat.block %1 {block = array<i64: 2, 0, 1, 3>} : (tensor<4x3xf64>) -> tensor<1x3xf64>
      %6 = mat.sub %5, %2 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %7 = mat.block %1 {block = array<i64: 1, 0, 1, 3>} : (tensor<4x3xf64>) -> tensor<1x3xf64>
      %8 = mat.sub %7, %2 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %9 = mat.concat_rows %8, %6, %4 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %10 = mat.det %9 : (tensor<3x3xf64>) -> tensor<1x1xf64>
      %11 = mat.sub %10, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %12 = mat.constant {value = dense<3.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %13 = mat.scale %12, %11 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %14 = mat.scale %13, %11 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %15 = mat.constant {value = dense<1.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %16 = mat.scale %11, %11 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %17 = mat.add %13, %13 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %18 = mat.neg %17 : (tensor<1x1xf64>) -> tensor<1x1xf64>
      %19 = mat.cofactor %9 : (tensor<3x3xf64>) -> tensor<3x3xf64>
      %20 = mat.scale %17, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %21 = mat.constant {value = dense<0.000000e+00> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %22 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %23 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %24 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %25 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %26 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %27 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %28 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %29 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %30 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %31 = mat.constant {value = dense<0.000000e+00> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %32 = mat.cross %31, %4 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %33 = mat.cross %6, %31 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %34 = mat.add %32, %33 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %35 = mat.cross %31, %8 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %36 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %37 = mat.cross %4, %36 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %38 = mat.add %35, %37 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %39 = mat.cross %36, %6 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %40 = mat.cross %8, %31 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %41 = mat.add %39, %40 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %42 = mat.concat_rows %34, %38, %41 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %43 = mat.constant {value = dense<6.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %44 = mat.dot %19, %22 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %45 = mat.scale %43, %44 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %46 = mat.scale %45, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %47 = mat.scale %17, %42 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %48 = mat.add %46, %47 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %49 = mat.reshape %48 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %50 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %51 = mat.cross %4, %50 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %52 = mat.add %35, %51 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %53 = mat.cross %50, %6 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %54 = mat.add %53, %40 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %55 = mat.concat_rows %34, %52, %54 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %56 = mat.dot %19, %23 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %57 = mat.scale %43, %56 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %58 = mat.scale %57, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %59 = mat.scale %17, %55 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %60 = mat.add %58, %59 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %61 = mat.reshape %60 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %62 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %63 = mat.cross %4, %62 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %64 = mat.add %35, %63 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %65 = mat.cross %62, %6 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %66 = mat.add %65, %40 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %67 = mat.concat_rows %34, %64, %66 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %68 = mat.dot %19, %24 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %69 = mat.scale %43, %68 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %70 = mat.scale %69, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %71 = mat.scale %17, %67 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %72 = mat.add %70, %71 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %73 = mat.reshape %72 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %74 = mat.cross %36, %4 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %75 = mat.add %74, %33 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %76 = mat.cross %4, %31 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %77 = mat.add %35, %76 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %78 = mat.cross %31, %6 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %79 = mat.cross %8, %36 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %80 = mat.add %78, %79 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %81 = mat.concat_rows %75, %77, %80 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %82 = mat.dot %19, %25 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %83 = mat.scale %43, %82 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %84 = mat.scale %83, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %85 = mat.scale %17, %81 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %86 = mat.add %84, %85 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %87 = mat.reshape %86 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %88 = mat.cross %50, %4 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %89 = mat.add %88, %33 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %90 = mat.cross %8, %50 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %91 = mat.add %78, %90 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %92 = mat.concat_rows %89, %77, %91 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %93 = mat.dot %19, %26 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %94 = mat.scale %43, %93 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %95 = mat.scale %94, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %96 = mat.scale %17, %92 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %97 = mat.add %95, %96 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %98 = mat.reshape %97 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %99 = mat.cross %62, %4 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %100 = mat.add %99, %33 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %101 = mat.cross %8, %62 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %102 = mat.add %78, %101 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %103 = mat.concat_rows %100, %77, %102 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %104 = mat.dot %19, %27 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %105 = mat.scale %43, %104 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %106 = mat.scale %105, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %107 = mat.scale %17, %103 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %108 = mat.add %106, %107 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %109 = mat.reshape %108 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %110 = mat.cross %6, %36 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %111 = mat.add %32, %110 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %112 = mat.cross %36, %8 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %113 = mat.add %112, %76 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %114 = mat.add %78, %40 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %115 = mat.concat_rows %111, %113, %114 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %116 = mat.dot %19, %28 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %117 = mat.scale %43, %116 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %118 = mat.scale %117, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %119 = mat.scale %17, %115 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %120 = mat.add %118, %119 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %121 = mat.reshape %120 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %122 = mat.cross %6, %50 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %123 = mat.add %32, %122 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %124 = mat.cross %50, %8 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %125 = mat.add %124, %76 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %126 = mat.concat_rows %123, %125, %114 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %127 = mat.dot %19, %29 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %128 = mat.scale %43, %127 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %129 = mat.scale %128, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %130 = mat.scale %17, %126 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %131 = mat.add %129, %130 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %132 = mat.reshape %131 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %133 = mat.cross %6, %62 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %134 = mat.add %32, %133 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %135 = mat.cross %62, %8 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %136 = mat.add %135, %76 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %137 = mat.concat_rows %134, %136, %114 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %138 = mat.dot %19, %30 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %139 = mat.scale %43, %138 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %140 = mat.scale %139, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %141 = mat.scale %17, %137 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %142 = mat.add %140, %141 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %143 = mat.reshape %142 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %144 = mat.concat_cols %49, %61, %73, %87, %98, %109, %121, %132, %143 : (tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>) -> tensor<9x9xf64>
      %145 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %146 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %147 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %148 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %149 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %150 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %151 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %152 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %153 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %154 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %155 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %156 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %157 = mat.constant {value = dense<[[-1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %158 = mat.constant {value = dense<[[-1.000000e+00, 0.000000e+00, 0.000000e+00], [-1.000000e+00, 0.000000e+00, 0.000000e+00], [-1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %159 = mat.constant {value = dense<[[-1.000000e+00], [0.000000e+00], [0.000000e+00], [-1.000000e+00], [0.000000e+00], [0.000000e+00], [-1.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %160 = mat.constant {value = dense<[[0.000000e+00, -1.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %161 = mat.constant {value = dense<[[0.000000e+00, -1.000000e+00, 0.000000e+00], [0.000000e+00, -1.000000e+00, 0.000000e+00], [0.000000e+00, -1.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %162 = mat.constant {value = dense<[[0.000000e+00], [-1.000000e+00], [0.000000e+00], [0.000000e+00], [-1.000000e+00], [0.000000e+00], [0.000000e+00], [-1.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %163 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, -1.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %164 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, -1.000000e+00], [0.000000e+00, 0.000000e+00, -1.000000e+00], [0.000000e+00, 0.000000e+00, -1.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %165 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [-1.000000e+00], [0.000000e+00], [0.000000e+00], [-1.000000e+00], [0.000000e+00], [0.000000e+00], [-1.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %166 = mat.constant {value = dense<[[1.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %167 = mat.constant {value = dense<[[0.000000e+00], [1.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %168 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [1.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %169 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [0.000000e+00], [1.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %170 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [1.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %171 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [1.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %172 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [1.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %173 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [1.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %174 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [1.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %175 = mat.constant {value = dense<"0x000000000000F0BF00000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F03F"> : tensor<9x12xf64>} : () -> tensor<9x12xf64>
      %176 = mat.congruence %144, %175 : (tensor<9x9xf64>, tensor<9x12xf64>) -> tensor<12x12xf64>
      %177 = mat.block %20 {block = array<i64: 0, 0, 1, 3>} : (tensor<3x3xf64>) -> tensor<1x3xf64>
      %178 = mat.block %20 {block = array<i64: 1, 0, 1, 3>} : (tensor<3x3xf64>) -> tensor<1x3xf64>
      %179 = mat.block %20 {block = array<i64: 2, 0, 1, 3>} : (tensor<3x3xf64>) -> tensor<1x3xf64>
      %180 = mat.neg %177 : (tensor<1x3xf64>) -> tensor<1x3xf64>
      %181 = mat.embed %177 {place = array<i64: 1, 0, 4, 3>} : (tensor<1x3xf64>) -> tensor<4x3xf64>
      %182 = mat.neg %178 : (tensor<1x3xf64>) -> tensor<1x3xf64>
      %183 = mat.embed %178 {place = array<i64: 2, 0, 4, 3>} : (tensor<1x3xf64>) -> tensor<4x3xf64>
      %184 = mat.neg %179 : (tensor<1x3xf64>) -> tensor<1x3xf64>
      %185 = mat.embed %179 {place = array<i64: 3, 0, 4, 3>} : (tensor<1x3xf64>) -> tensor<4x3xf64>
      %186 = mat.add %180, %182 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %187 = mat.add %186, %184 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %188 = mat.embed %187 {place = array<i64: 0, 0, 4, 3>} : (tensor<1x3xf64>) -> tensor<4x3xf64>
      %189 = mat.add %181, %183 : (tensor<4x3xf64>, tensor<4x3xf64>) -> tensor<4x3xf64>
      %190 = mat.add %189, %185 : (tensor<4x3xf64>, tensor<4x3xf64>) -> tensor<4x3xf64>
      %191 = mat.add %190, %188 : (tensor<4x3xf64>, tensor<4x3xf64>) -> tensor<4x3xf64>
      %192 = mat.reshape %191 {shape = array<i64: 12, 1>} : (tensor<4x3xf64>) -> tensor<12x1xf64>
      %193 = mat.project_psd %144, %9 {mode = "clamp"} : (tensor<9x9xf64>, tensor<3x3xf64>) -> tensor<9x9xf64>
      %194 = mat.congruence %193, %175 : (tensor<9x9xf64>, tensor<9x12xf64>) -> tensor<12x12xf64>
      rel.yield_derivative %14 : tensor<1x1xf64> gradient %192 : tensor<12x1xf64> hessian %194 : tensor<12x12xf64> wrt %1 : tensor<4x3xf64>
    }
    rel.derivative @m.v.gravity.derivative of @m.v.gravity on @m.v projection "clamp" indices @m.v.gravity.kappa projects "nowhere: the energy is affine, its Hessian is zero" {
      %x = rel.data @m.v.x : tensor<3x1xf64>
      %0 = mat.block %x {block = array<i64: 1, 0, 1, 1>} : (tensor<3x1xf64>) -> tensor<1x1xf64>
      %mass = rel.data @m.v.mass : tensor<1x1xf64>
      %1 = mat.constant {value = dense<9.800000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %2 = mat.scale %1, %mass : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %3 = mat.scale %2, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %4 = mat.constant {value = dense<1.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %5 = mat.constant {value = dense<0.000000e+00> : tensor<3x1xf64>} : () -> tensor<3x1xf64>
      %6 = mat.constant {value = dense<0.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %7 = mat.embed %2 {place = array<i64: 1, 0, 3, 1>} : (tensor<1x1xf64>) -> tensor<3x1xf64>
      rel.yield_derivative %6 : tensor<1x1xf64> gradient %7 : tensor<3x1xf64> wrt %x : tensor<3x1xf64>
    }
    rel.attribute @m.v.x.kappa on @m.v : tensor<1x1xi32> {
      %0 = rel.target_index @m.v.x : tensor<1x1xi32>
      rel.yield %0 : tensor<1x1xi32>
    }
    rel.attribute @m.t.swell.kappa on @m.t : tensor<1x4xi32> {
      %0 = rel.join @m.v.x.kappa through @m.t.corners : tensor<4x1xi32>
      %1 = mat.reshape %0 {shape = array<i64: 1, 4>} : (tensor<4x1xi32>) -> tensor<1x4xi32>
      rel.yield %1 : tensor<1x4xi32>
    }
    rel.attribute @m.v.gravity.kappa on @m.v : tensor<1x1xi32> {
      %0 = rel.target_index @m.v.x : tensor<1x1xi32>
      rel.yield %0 : tensor<1x1xi32>
    }
  }
}
