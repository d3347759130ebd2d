// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

static inline void value_pack(const V* x0, const V* x1, const V* x2, V* __restrict y0) {
    const V t15 = x1[0] * x2[0];
    const V t16 = x1[1] * x2[1];
    const V t17 = x1[2] * x2[2];
    const V t18 = x1[0] * x2[3];
    const V t19 = x1[1] * x2[4];
    const V t20 = x1[2] * x2[5];
    const V t21 = x1[0] * x2[6];
    const V t22 = x1[1] * x2[7];
    const V t23 = x1[2] * x2[8];
    const V t24 = x0[0] + t17;
    const V t25 = t15 + t24;
    const V t26 = t16 + t25;
    y0[0] = t26;
    const V t27 = x0[1] + t20;
    const V t28 = t18 + t27;
    const V t29 = t19 + t28;
    y0[1] = t29;
    const V t30 = x0[2] + t23;
    const V t31 = t21 + t30;
    const V t32 = t22 + t31;
    y0[2] = t32;
}

extern "C" void yasps<stiff.v.x>_value_lanes(Arguments a, const long* own, V* out) {
    const int* const p0 = (const int*)a[0];
    const double* const p1 = (const double*)a[1];
    const double* const p2 = (const double*)a[2];
    const double* const p3 = (const double*)a[3];
    V r0[3];
    V r1[3];
    V r2[9];
    long of[8];
    const double* at[8];
    for (long s = 0; s < 1; ++s) {
        instances_from(p0 + s, 1, own, of);
        #pragma GCC unroll 8
        for (long l = 0; l < 8; ++l) at[l] = p1 + of[l] * 3;
        gather(at, 3, r0 + s * 3);
    }
    for (long l = 0; l < 8; ++l) of[l] = own[l];
    #pragma GCC unroll 8
    for (long l = 0; l < 8; ++l) at[l] = p2 + of[l] * 3;
    gather(at, 3, r1);
    for (long s = 0; s < 1; ++s) {
        instances_from(p0 + s, 1, own, of);
        #pragma GCC unroll 8
        for (long l = 0; l < 8; ++l) at[l] = p3 + of[l] * 9;
        gather(at, 9, r2 + s * 9);
    }
    (void)of, (void)at, (void)own;
    value_pack(r0, r1, r2, out);
}
