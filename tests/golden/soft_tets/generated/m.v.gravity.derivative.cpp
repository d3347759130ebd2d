// backend/kernel_prelude.h stands here

static inline void derive_pack(const V* x0, V* y0) {
    const V t3 = splat(9.8) * x0[0];
    y0[0] = splat(0.0);
    y0[1] = t3;
    y0[2] = splat(0.0);
}

extern "C" long yasps<m.v.gravity.derivative>_derive(Arguments a, long begin, long end, const yasps_sink* sink) {
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
        V gradient[3];
        derive_pack(r1, gradient);
        V check = splat(0.0);
        for (long k = 0; k < 3; ++k) check += gradient[k] * 0.0;
        for (long l = 0; l < lanes; ++l)
            if (check[l] != 0.0) return first + l;  // not finite
        for (long l = 0; l < lanes; ++l) {
            const long i = first + l;
            const int* const kappa = sink->kappa + i * 1;
            for (long e = 0; e < 3; ++e)
                sink->gradient[kappa[0] - 1 + e] += gradient[0 + e][l];
            (void)i;
        }
    }
    return -1;
}
