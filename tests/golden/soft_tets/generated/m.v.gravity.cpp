// backend/kernel_prelude.h stands here

static inline void value_pack(const V* x0, const V* x1, V* y0) {
    const V t5 = x0[1] * x1[0];
    const V t6 = splat(9.8) * t5;
    y0[0] = t6;
}

extern "C" void yasps<m.v.gravity>_batch(Arguments a, long begin, long end, double* out) {
    const double* const p0 = (const double*)a[0];
    const double* const p1 = (const double*)a[1];
    for (long first = begin; first < end; first += 8) {
        const long lanes = end - first < 8 ? end - first : 8;
        V r0[3];
        V r1[1];
        for (long l = 0; l < 8; ++l) {
            const long i = first + (l < lanes ? l : lanes - 1);
            double g0[3];
            for (long e = 0; e < 3; ++e) g0[e] = p0[i * 3 + e];
            for (long e = 0; e < 3; ++e) r0[e][l] = g0[e];
            double g1[1];
            for (long e = 0; e < 1; ++e) g1[e] = p1[i * 1 + e];
            for (long e = 0; e < 1; ++e) r1[e][l] = g1[e];
        }
        V y[1];
        value_pack(r0, r1, y);
        for (long l = 0; l < lanes; ++l)
            for (long e = 0; e < 1; ++e) out[(first + l) * 1 + e] = y[e][l];
    }
}
