// runtime/core/sink.h stands here

// backend/cuda/preludes/kernel.cuh stands here

// backend/codegen/preludes/expand.h stands here

extern "C" __device__ long yasps<both.v.x>_pull(Arguments a, long i, const double* b, double* out);
extern "C" __device__ void yasps<both.v.x>_value(Arguments a, long i, double* out);
static __device__ inline void pull_back_one(const double* x0, double* __restrict y0) {
    const double t6 = -x0[0];
    y0[3] = t6;
    const double t7 = -x0[1];
    y0[4] = t7;
    y0[8] = t7;
    const double t8 = -x0[2];
    y0[5] = t8;
    y0[12] = t8;
    const double t9 = -x0[3];
    y0[9] = t9;
    const double t10 = -x0[4];
    y0[10] = t10;
    y0[13] = t10;
    const double t11 = -x0[5];
    y0[14] = t11;
    y0[0] = x0[0];
    y0[15] = x0[0];
    y0[1] = x0[1];
    y0[16] = x0[1];
    y0[2] = x0[2];
    y0[17] = x0[2];
    y0[6] = x0[3];
    y0[18] = x0[3];
    y0[7] = x0[4];
    y0[19] = x0[4];
    y0[11] = x0[5];
    y0[20] = x0[5];
}

static __device__ inline void derive_uniforms_one(const double* x0, double* __restrict y0) {
    const double t3 = 1.0 / x0[0];
    y0[1] = t3;
    y0[0] = x0[1];
}

static __device__ inline void derive_one(const double* x0, const double* x1, double* __restrict y0, double* __restrict y1, double* __restrict y2) {
    const double t9 = x0[0] - x0[3];
    const double t10 = x0[1] - x0[4];
    const double t11 = x0[2] - x0[5];
    const double t12 = t9 * t9;
    const double t13 = t10 * t10;
    const double t14 = t11 * t11;
    const double t15 = t12 + t14;
    const double t16 = t13 + t15;
    const double t17 = x1[1] * t16;
    const double t18 = log(t17);
    const double t19 = x1[0] - t16;
    const double t20 = t19 * t19;
    const double t21 = t18 * t20;
    const double t23 = 2.0 * t21;
    const double t24 = 1.0 / t17;
    const double t25 = t23 * t24;
    const double t26 = x1[1] * t25;
    const double t27 = t18 * t18;
    const double t28 = t19 * t27;
    const double t29 = 2.0 * t28;
    const double t30 = t26 - t29;
    const double t31 = 2.0 * t30;
    const double t32 = t9 * t31;
    y1[0] = t32;
    const double t33 = t10 * t31;
    y1[1] = t33;
    const double t34 = t11 * t31;
    y1[2] = t34;
    const double t35 = x1[1] * t24;
    const double t36 = t20 * t35;
    const double t37 = t18 * t19;
    const double t38 = 2.0 * t37;
    const double t39 = t36 - t38;
    const double t40 = t24 * t39;
    const double t41 = 2.0 * t40;
    const double t42 = t24 * t24;
    const double t43 = t23 * t42;
    const double t44 = x1[1] * t43;
    const double t45 = t41 - t44;
    const double t46 = x1[1] * t45;
    const double t47 = t18 * t35;
    const double t48 = t19 * t47;
    const double t49 = 2.0 * t48;
    const double t50 = t27 - t49;
    const double t51 = 2.0 * t50;
    const double t52 = t46 + t51;
    const double t53 = 2.0 * t52;
    const double t54 = t11 * t53;
    const double t55 = 2.0 * t54;
    const double t56 = t9 * t55;
    y2[2] = t56;
    const double t57 = t10 * t55;
    y2[4] = t57;
    const double t58 = t11 * t55;
    const double t59 = t31 + t58;
    y2[5] = t59;
    const double t60 = t10 * t53;
    const double t61 = 2.0 * t60;
    const double t62 = t9 * t61;
    y2[1] = t62;
    const double t63 = t10 * t61;
    const double t64 = t31 + t63;
    y2[3] = t64;
    const double t65 = t9 * t53;
    const double t66 = t9 * t65;
    const double t67 = 2.0 * t66;
    const double t68 = t31 + t67;
    y2[0] = t68;
    const double t69 = t18 * t21;
    y0[0] = t69;
    const double t70 = -t32;
    y1[3] = t70;
    const double t71 = -t33;
    y1[4] = t71;
    const double t72 = -t34;
    y1[5] = t72;
}

extern "C" __global__ void __launch_bounds__(128, 4) yasps<both.pp.barrier.derivative>_derive(Arguments a, long count, double* gradient, double* blocks, const int* kappa, const long* position, const long* gradient_at, const int* block_size_at, const unsigned* order, long mode, unsigned long long* outcome, double* workspace) {
    const long* const p0 = (const long*)a[0];
    const int* const p1 = (const int*)a[1];
    Arguments const p2 = (Arguments)a[2];
    const double* const p3 = (const double*)a[3];
    const yasps_sink sink = {gradient, blocks, kappa, position, gradient_at, block_size_at, order, mode, outcome, workspace};
    const long thread = blockIdx.x * (long)blockDim.x + threadIdx.x;
    for (long turn = thread; turn < count; turn += (long)gridDim.x * blockDim.x) {
        const long i = sink.order ? sink.order[turn] : turn;
        double u0[2];
        derive_uniforms_one(p3, u0);
        double r0[6];
        for (long s = 0; s < 2; ++s) {
            const long j = p1[i * 2 + s];
            yasps<both.v.x>_value(p2, j, (r0 + s * 3));
        }
        double energy[1];
        double gradient[6];
        double middle[6];
        derive_one(r0, u0, energy, gradient, middle);
        if (!(all_finite<1>(energy) && all_finite<6>(gradient) && all_finite<6>(middle))) {
            report_not_finite(sink, i);
            continue;
        }
        const int* const kappa = sink.kappa + i * 4;
        for (long k = 0; k < 2; ++k) {
            double rows[12];
            yasps<both.v.x>_pull(p2, (long)p1[i * 2 + k], gradient + k * 3, rows);
            add_gradient_rows(sink, kappa, i, 4, k * 2, 2 + k * 2, rows);
        }
        if (!sink.blocks) continue;
        const long* const position = sink.position + i * 10;
        double work[15];
        const int changed = yasps_project(middle, 3, (int)mode, work);
        if (changed < 0) {
            report_not_finite(sink, i);
            continue;
        }
        if (changed) atomicAdd(sink.outcome + 1, 1ull);
        double hessian[21];
        pull_back_one(middle, hessian);
        for (long s = 0; s < 2; ++s)
            for (long t = s; t < 2; ++t) {
                double left[3][12];
                long height = 0;
                for (long c = 0; c < 3; ++c) {
                    double b[3];
                    for (long e = 0; e < 3; ++e) b[e] = hessian[packed_place(6, 0 + s * 3 + e, 0 + t * 3 + c)];
                    height = yasps<both.v.x>_pull(p2, (long)p1[i * 2 + s], b, left[c]);
                }
                for (long r = 0; r < height; ++r) {
                    double b[3], row[12];
                    for (long c = 0; c < 3; ++c) b[c] = left[c][r];
                    const long breadth = yasps<both.v.x>_pull(p2, (long)p1[i * 2 + t], b, row);
                    add_row(sink, kappa, position, 4, 0 + s * 2, r, 0 + t * 2, 0 + t * 2 + 2, row);
                }
            }
    }
}

extern "C" __global__ void __launch_bounds__(128, 4) yasps<both.pp.barrier.derivative>_branches(Arguments a, long count, unsigned long* keys, unsigned* ids) {
    const long* const p0 = (const long*)a[0];
    const int* const p1 = (const int*)a[1];
    Arguments const p2 = (Arguments)a[2];
    const double* const p3 = (const double*)a[3];
    const long i = blockIdx.x * (long)blockDim.x + threadIdx.x;
    if (i >= count) return;
    unsigned long number = 0;
    {
        const long j = (long)p1[i * 2 + 0];
        number = number * 2 + (j < p0[1] ? 0 : j < p0[2] ? 1 : 0);
    }
    {
        const long j = (long)p1[i * 2 + 1];
        number = number * 2 + (j < p0[1] ? 0 : j < p0[2] ? 1 : 0);
    }
    keys[i] = number;
    ids[i] = (unsigned)i;
}
