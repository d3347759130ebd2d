// backend/kernel_prelude.h stands here

static inline void value_pack(const V* x0, V* y0) {
    const V t13 = x0[0] - x0[9];
    const V t14 = x0[1] - x0[10];
    const V t15 = x0[2] - x0[11];
    const V t16 = x0[0] - x0[6];
    const V t17 = x0[1] - x0[7];
    const V t18 = x0[2] - x0[8];
    const V t19 = x0[0] - x0[3];
    const V t20 = x0[1] - x0[4];
    const V t21 = x0[2] - x0[5];
    const V t22 = t15 * t17;
    const V t23 = t14 * t18;
    const V t24 = t22 - t23;
    const V t25 = t15 * t16;
    const V t26 = t13 * t18;
    const V t27 = t25 - t26;
    const V t28 = t14 * t16;
    const V t29 = t13 * t17;
    const V t30 = t28 - t29;
    const V t31 = t19 * t24;
    const V t32 = t20 * t27;
    const V t33 = t21 * t30;
    const V t34 = splat(0.5) + t33;
    const V t35 = t31 + t34;
    const V t36 = t35 - t32;
    const V t38 = t36 * t36;
    const V t39 = splat(3.0) * t38;
    y0[0] = t39;
}

extern "C" void yasps<m.t.swell>_batch(Arguments a, long begin, long end, double* out) {
    const int* const p0 = (const int*)a[0];
    const double* const p1 = (const double*)a[1];
    for (long first = begin; first < end; first += 8) {
        const long lanes = end - first < 8 ? end - first : 8;
        V r0[12];
        long at[8];
        for (long s = 0; s < 4; ++s) {
            connected_offsets(p0 + first * 4 + s, 4, lanes, 3, at);
            gather(p1, at, 3, r0 + s * 3);
        }
        (void)at;
        V y[1];
        value_pack(r0, y);
        for (long l = 0; l < lanes; ++l)
            for (long e = 0; e < 1; ++e) out[(first + l) * 1 + e] = y[e][l];
    }
}
