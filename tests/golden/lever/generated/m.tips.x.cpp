// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

static inline void value_one(const double* x0, const double* x1, double* __restrict y0) {
    const double t2 = __builtin_sin(x0[0]);
    const double t3 = x1[0] * t2;
    y0[1] = t3;
    const double t4 = __builtin_cos(x0[0]);
    const double t5 = x1[0] * t4;
    y0[0] = t5;
}

extern "C" void yasps<m.tips.x>_value(Arguments a, long i, double* out) {
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
    value_one(r0, r1, out);
}
