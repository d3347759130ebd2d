// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

static inline void derive_uniforms_one(const double* x0, double* __restrict y0) {
    y0[0] = x0[0];
}

static inline void derive_pack(const V* x0, const V* x1, V* __restrict y0, V* __restrict y1) {
    const V t3 = x1[0] * x0[0];
    y1[1] = t3;
    y0[0] = splat(0.0);
    y1[0] = splat(0.0);
    y1[2] = splat(0.0);
}

extern "C" long yasps<m.v.gravity.derivative>_derive(Arguments a, long begin, long end, const yasps_sink* results) {
    const double* const p0 = (const double*)a[0];
    const double* const p1 = (const double*)a[1];
    const double* const p2 = (const double*)a[2];
    const yasps_sink& sink = *results;
    double u0_one[1];
    derive_uniforms_one(p0, u0_one);
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
        V energy[1], gradient[3];
        derive_pack(r1, u0, energy, gradient);
        V check = sum_of_zeros(gradient, 3) + energy[0] * 0.0;
        if (any_not_finite(check))
            for (long l = 0; l < lanes; ++l)
                if (check[l] != 0.0) return first + l;
        for (long l = 0; l < lanes; ++l) {
            const long i = first + l;
            const int* const kappa = sink.kappa + i * 1;
            add_gradient(sink.gradient + kappa[0] - 1, gradient + 0, l, 3);
            (void)i;
        }
    }
    return -1;
}
