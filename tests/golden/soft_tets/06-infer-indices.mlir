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
    rel.derivative @m.t.swell.derivative of @m.t.swell on @m.t projection "clamp" indices @m.t.swell.kappa projects "9x9 of 12x12: the energy reads its inputs through a linear cut" {
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
      %23 = mat.constant {value = dense<0.000000e+00> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %24 = mat.cross %23, %4 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %25 = mat.cross %6, %23 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %26 = mat.add %24, %25 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %27 = mat.cross %23, %8 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %28 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %29 = mat.cross %4, %28 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %30 = mat.add %27, %29 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %31 = mat.cross %28, %6 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %32 = mat.cross %8, %23 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %33 = mat.add %31, %32 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %34 = mat.concat_rows %26, %30, %33 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %35 = mat.dot %19, %22 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %36 = mat.scale %12, %35 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %37 = mat.add %36, %36 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %38 = mat.scale %37, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %39 = mat.scale %17, %34 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %40 = mat.add %38, %39 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %41 = mat.reshape %40 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %42 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %43 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %44 = mat.cross %4, %43 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %45 = mat.add %27, %44 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %46 = mat.cross %43, %6 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %47 = mat.add %46, %32 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %48 = mat.concat_rows %26, %45, %47 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %49 = mat.dot %19, %42 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %50 = mat.scale %12, %49 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %51 = mat.add %50, %50 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %52 = mat.scale %51, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %53 = mat.scale %17, %48 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %54 = mat.add %52, %53 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %55 = mat.reshape %54 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %56 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %57 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %58 = mat.cross %4, %57 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %59 = mat.add %27, %58 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %60 = mat.cross %57, %6 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %61 = mat.add %60, %32 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %62 = mat.concat_rows %26, %59, %61 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %63 = mat.dot %19, %56 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %64 = mat.scale %12, %63 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %65 = mat.add %64, %64 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %66 = mat.scale %65, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %67 = mat.scale %17, %62 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %68 = mat.add %66, %67 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %69 = mat.reshape %68 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %70 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %71 = mat.cross %28, %4 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %72 = mat.add %71, %25 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %73 = mat.cross %4, %23 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %74 = mat.add %27, %73 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %75 = mat.cross %23, %6 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %76 = mat.cross %8, %28 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %77 = mat.add %75, %76 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %78 = mat.concat_rows %72, %74, %77 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %79 = mat.dot %19, %70 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %80 = mat.scale %12, %79 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %81 = mat.add %80, %80 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %82 = mat.scale %81, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %83 = mat.scale %17, %78 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %84 = mat.add %82, %83 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %85 = mat.reshape %84 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %86 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %87 = mat.cross %43, %4 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %88 = mat.add %87, %25 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %89 = mat.cross %8, %43 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %90 = mat.add %75, %89 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %91 = mat.concat_rows %88, %74, %90 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %92 = mat.dot %19, %86 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %93 = mat.scale %12, %92 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %94 = mat.add %93, %93 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %95 = mat.scale %94, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %96 = mat.scale %17, %91 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %97 = mat.add %95, %96 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %98 = mat.reshape %97 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %99 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %100 = mat.cross %57, %4 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %101 = mat.add %100, %25 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %102 = mat.cross %8, %57 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %103 = mat.add %75, %102 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %104 = mat.concat_rows %101, %74, %103 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %105 = mat.dot %19, %99 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %106 = mat.scale %12, %105 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %107 = mat.add %106, %106 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %108 = mat.scale %107, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %109 = mat.scale %17, %104 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %110 = mat.add %108, %109 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %111 = mat.reshape %110 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %112 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %113 = mat.cross %6, %28 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %114 = mat.add %24, %113 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %115 = mat.cross %28, %8 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %116 = mat.add %115, %73 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %117 = mat.add %75, %32 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %118 = mat.concat_rows %114, %116, %117 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %119 = mat.dot %19, %112 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %120 = mat.scale %12, %119 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %121 = mat.add %120, %120 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %122 = mat.scale %121, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %123 = mat.scale %17, %118 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %124 = mat.add %122, %123 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %125 = mat.reshape %124 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %126 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %127 = mat.cross %6, %43 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %128 = mat.add %24, %127 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %129 = mat.cross %43, %8 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %130 = mat.add %129, %73 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %131 = mat.concat_rows %128, %130, %117 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %132 = mat.dot %19, %126 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %133 = mat.scale %12, %132 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %134 = mat.add %133, %133 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %135 = mat.scale %134, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %136 = mat.scale %17, %131 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %137 = mat.add %135, %136 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %138 = mat.reshape %137 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %139 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %140 = mat.cross %6, %57 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %141 = mat.add %24, %140 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %142 = mat.cross %57, %8 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %143 = mat.add %142, %73 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %144 = mat.concat_rows %141, %143, %117 : (tensor<1x3xf64>, tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<3x3xf64>
      %145 = mat.dot %19, %139 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<1x1xf64>
      %146 = mat.scale %12, %145 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %147 = mat.add %146, %146 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %148 = mat.scale %147, %19 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %149 = mat.scale %17, %144 : (tensor<1x1xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %150 = mat.add %148, %149 : (tensor<3x3xf64>, tensor<3x3xf64>) -> tensor<3x3xf64>
      %151 = mat.reshape %150 {shape = array<i64: 9, 1>} : (tensor<3x3xf64>) -> tensor<9x1xf64>
      %152 = mat.concat_cols %41, %55, %69, %85, %98, %111, %125, %138, %151 : (tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>, tensor<9x1xf64>) -> tensor<9x9xf64>
      %153 = mat.constant {value = dense<[[1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %154 = mat.constant {value = dense<[[-1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %155 = mat.constant {value = dense<[[-1.000000e+00, 0.000000e+00, 0.000000e+00], [-1.000000e+00, 0.000000e+00, 0.000000e+00], [-1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %156 = mat.constant {value = dense<[[-1.000000e+00], [0.000000e+00], [0.000000e+00], [-1.000000e+00], [0.000000e+00], [0.000000e+00], [-1.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %157 = mat.constant {value = dense<[[0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %158 = mat.constant {value = dense<[[0.000000e+00, -1.000000e+00, 0.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %159 = mat.constant {value = dense<[[0.000000e+00, -1.000000e+00, 0.000000e+00], [0.000000e+00, -1.000000e+00, 0.000000e+00], [0.000000e+00, -1.000000e+00, 0.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %160 = mat.constant {value = dense<[[0.000000e+00], [-1.000000e+00], [0.000000e+00], [0.000000e+00], [-1.000000e+00], [0.000000e+00], [0.000000e+00], [-1.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %161 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %162 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, -1.000000e+00]]> : tensor<1x3xf64>} : () -> tensor<1x3xf64>
      %163 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, -1.000000e+00], [0.000000e+00, 0.000000e+00, -1.000000e+00], [0.000000e+00, 0.000000e+00, -1.000000e+00]]> : tensor<3x3xf64>} : () -> tensor<3x3xf64>
      %164 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [-1.000000e+00], [0.000000e+00], [0.000000e+00], [-1.000000e+00], [0.000000e+00], [0.000000e+00], [-1.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %165 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %166 = mat.constant {value = dense<[[1.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %167 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %168 = mat.constant {value = dense<[[0.000000e+00], [1.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %169 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %170 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [1.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %171 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %172 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [0.000000e+00], [1.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %173 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %174 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [1.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %175 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %176 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [1.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %177 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [1.000000e+00, 0.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %178 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [1.000000e+00], [0.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %179 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 1.000000e+00, 0.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %180 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [1.000000e+00], [0.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %181 = mat.constant {value = dense<[[0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 0.000000e+00], [0.000000e+00, 0.000000e+00, 1.000000e+00]]> : tensor<4x3xf64>} : () -> tensor<4x3xf64>
      %182 = mat.constant {value = dense<[[0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [0.000000e+00], [1.000000e+00]]> : tensor<9x1xf64>} : () -> tensor<9x1xf64>
      %183 = mat.constant {value = dense<"0x000000000000F0BF00000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F03F000000000000000000000000000000000000000000000000000000000000F0BF00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000F03F"> : tensor<9x12xf64>} : () -> tensor<9x12xf64>
      %184 = mat.congruence %152, %183 : (tensor<9x9xf64>, tensor<9x12xf64>) -> tensor<12x12xf64>
      %185 = mat.block %20 {block = array<i64: 0, 0, 1, 3>} : (tensor<3x3xf64>) -> tensor<1x3xf64>
      %186 = mat.block %20 {block = array<i64: 1, 0, 1, 3>} : (tensor<3x3xf64>) -> tensor<1x3xf64>
      %187 = mat.block %20 {block = array<i64: 2, 0, 1, 3>} : (tensor<3x3xf64>) -> tensor<1x3xf64>
      %188 = mat.neg %185 : (tensor<1x3xf64>) -> tensor<1x3xf64>
      %189 = mat.embed %185 {place = array<i64: 1, 0, 4, 3>} : (tensor<1x3xf64>) -> tensor<4x3xf64>
      %190 = mat.neg %186 : (tensor<1x3xf64>) -> tensor<1x3xf64>
      %191 = mat.embed %186 {place = array<i64: 2, 0, 4, 3>} : (tensor<1x3xf64>) -> tensor<4x3xf64>
      %192 = mat.neg %187 : (tensor<1x3xf64>) -> tensor<1x3xf64>
      %193 = mat.embed %187 {place = array<i64: 3, 0, 4, 3>} : (tensor<1x3xf64>) -> tensor<4x3xf64>
      %194 = mat.add %188, %190 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %195 = mat.add %194, %192 : (tensor<1x3xf64>, tensor<1x3xf64>) -> tensor<1x3xf64>
      %196 = mat.embed %195 {place = array<i64: 0, 0, 4, 3>} : (tensor<1x3xf64>) -> tensor<4x3xf64>
      %197 = mat.add %189, %191 : (tensor<4x3xf64>, tensor<4x3xf64>) -> tensor<4x3xf64>
      %198 = mat.add %197, %193 : (tensor<4x3xf64>, tensor<4x3xf64>) -> tensor<4x3xf64>
      %199 = mat.add %198, %196 : (tensor<4x3xf64>, tensor<4x3xf64>) -> tensor<4x3xf64>
      %200 = mat.reshape %199 {shape = array<i64: 12, 1>} : (tensor<4x3xf64>) -> tensor<12x1xf64>
      %201 = mat.project_psd %152 {mode = "clamp"} : (tensor<9x9xf64>) -> tensor<9x9xf64>
      %202 = mat.congruence %201, %183 : (tensor<9x9xf64>, tensor<9x12xf64>) -> tensor<12x12xf64>
      rel.yield_derivative gradient %200 : tensor<12x1xf64> hessian %202 : tensor<12x12xf64> wrt %1 : tensor<4x3xf64>
    }
    rel.derivative @m.v.gravity.derivative of @m.v.gravity on @m.v projection "clamp" indices @m.v.gravity.kappa projects "nowhere: the energy is affine, its Hessian is zero" {
      %x = rel.data @m.v.x : tensor<3x1xf64>
      %0 = mat.block %x {block = array<i64: 1, 0, 1, 1>} : (tensor<3x1xf64>) -> tensor<1x1xf64>
      %mass = rel.data @m.v.mass : tensor<1x1xf64>
      %1 = mat.constant {value = dense<9.800000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %2 = mat.scale %1, %mass : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %3 = mat.scale %2, %0 : (tensor<1x1xf64>, tensor<1x1xf64>) -> tensor<1x1xf64>
      %4 = mat.constant {value = dense<1.000000e+00> : tensor<1x1xf64>} : () -> tensor<1x1xf64>
      %5 = mat.embed %2 {place = array<i64: 1, 0, 3, 1>} : (tensor<1x1xf64>) -> tensor<3x1xf64>
      rel.yield_derivative gradient %5 : tensor<3x1xf64> wrt %x : tensor<3x1xf64>
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
