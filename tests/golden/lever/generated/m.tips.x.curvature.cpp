// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

static inline void second_one(const double* x0, const double* x1, const double* x2, double* __restrict y0) {
    const double t4 = x1[0] * x2[1];
    const double t5 = __builtin_sin(x0[0]);
    const double t6 = t4 * t5;
    const double t7 = x1[0] * x2[0];
    const double t8 = __builtin_cos(x0[0]);
    const double t9 = t7 * t8;
    const double t10 = t6 + t9;
    const double t11 = -t10;
    y0[0] = t11;
}

extern "C" void yasps<m.tips.x.curvature>_second(Arguments a, long i, const double* v, double* out) {
    const int* const p0 = (const int*)a[0];
    const double* const p1 = (const double*)a[1];
    const double* const p2 = (const double*)a[2];
    double r0[1];
    double r1[1];
    for (long s = 0; s < 1; ++s) {
        const long j = p0[i * 1 + s];
        for (long e = 0; e < 1; ++e) (r0 + s * 1)[e] = p1[j * 1 + e];
    }
    for (long e = 0; e < 1; ++e) r1[e] = p2[i * 1 + e];
    second_one(r0, r1, v, out);
}
