// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

static inline void pull_back_pack(const V* x0, const V* x1, V* __restrict y0) {
    const V t6 = x0[0] * x1[0];
    y0[3] = t6;
    const V t7 = x0[1] * x1[0];
    y0[4] = t7;
    const V t8 = x0[2] * x1[0];
    y0[5] = t8;
    const V t9 = x0[0] * x1[1];
    y0[6] = t9;
    const V t10 = x0[1] * x1[1];
    y0[7] = t10;
    const V t11 = x0[2] * x1[1];
    y0[8] = t11;
    const V t12 = x0[0] * x1[2];
    y0[9] = t12;
    const V t13 = x0[1] * x1[2];
    y0[10] = t13;
    const V t14 = x0[2] * x1[2];
    y0[11] = t14;
    y0[0] = x1[0];
    y0[1] = x1[1];
    y0[2] = x1[2];
}

extern "C" long yasps<stiff.v.x.jacobian>_pull(Arguments a, long i, const V* b, long n, V* out) {
    const int* const p0 = (const int*)a[0];
    const double* const p1 = (const double*)a[1];
    const double* const p2 = (const double*)a[2];
    const double* const p3 = (const double*)a[3];
    double r0[3];
    double r1[3];
    double r2[9];
    for (long s = 0; s < 1; ++s) {
        const long j = p0[i * 1 + s];
        for (long e = 0; e < 3; ++e) (r0 + s * 3)[e] = p1[j * 3 + e];
    }
    for (long e = 0; e < 3; ++e) r1[e] = p2[i * 3 + e];
    for (long s = 0; s < 1; ++s) {
        const long j = p0[i * 1 + s];
        for (long e = 0; e < 9; ++e) (r2 + s * 9)[e] = p3[j * 9 + e];
    }
    V r0_pack[3];
    for (long e = 0; e < 3; ++e) r0_pack[e] = splat(r0[e]);
    V r1_pack[3];
    for (long e = 0; e < 3; ++e) r1_pack[e] = splat(r1[e]);
    V r2_pack[9];
    for (long e = 0; e < 9; ++e) r2_pack[e] = splat(r2[e]);
    V v[3], x[12];
    for (long c = 0; c < n; ++c) {
        for (long k = 0; k < 3; ++k) v[k] = b[k * n + c];
        pull_back_pack(r1_pack, v, x);
        for (long k = 0; k < 12; ++k) out[k * n + c] = x[k];
    }
    return 12;
}
