// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

static inline void value_uniforms_one(const double* x0, double* __restrict y0) {
    y0[0] = x0[0];
}

static inline void value_pack(const V* x0, const V* x1, const V* x2, V* __restrict y0) {
    const V t5 = x0[1] * x1[0];
    const V t6 = x2[0] * t5;
    y0[0] = t6;
}

extern "C" void yasps<m.v.gravity>_batch(Arguments a, long begin, long end, double* out) {
    const double* const p0 = (const double*)a[0];
    const double* const p1 = (const double*)a[1];
    const double* const p2 = (const double*)a[2];
    double u0_one[1];
    value_uniforms_one(p0, u0_one);
    V u0[1];
    for (long e = 0; e < 1; ++e) u0[e] = splat(u0_one[e]);
    for (long first = begin; first < end; first += 8) {
        const long lanes = end - first < 8 ? end - first : 8;
        V r0[3];
        V r1[1];
        long of[8];
        const double* at[8];
        own_instances(first, lanes, of);
        #pragma GCC unroll 8
        for (long l = 0; l < 8; ++l) at[l] = p1 + of[l] * 3;
        gather(at, 3, r0);
        own_instances(first, lanes, of);
        #pragma GCC unroll 8
        for (long l = 0; l < 8; ++l) at[l] = p2 + of[l] * 1;
        gather(at, 1, r1);
        (void)of, (void)at;
        V y[1];
        value_pack(r0, r1, u0, y);
        for (long l = 0; l < lanes; ++l)
            for (long e = 0; e < 1; ++e) out[(first + l) * 1 + e] = y[e][l];
    }
}
