// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

extern "C" void yasps<m.tips.x.kappa>_value(Arguments a, long i, int* out);
static inline void value_index(const int* x0, int* __restrict y0) {
    y0[0] = x0[0];
    y0[1] = x0[1];
}

extern "C" void yasps<m.springs.stretch.kappa>_value(Arguments a, long i, int* out) {
    const int* const p0 = (const int*)a[0];
    Arguments const p1 = (Arguments)a[1];
    int r0[2];
    for (long s = 0; s < 2; ++s) {
        const long j = p0[i * 2 + s];
        yasps<m.tips.x.kappa>_value(p1, j, (r0 + s * 1));
    }
    value_index(r0, out);
}

extern "C" void yasps<m.springs.stretch.kappa>_batch(Arguments a, long begin, long end, int* out) {
    const int* const p0 = (const int*)a[0];
    Arguments const p1 = (Arguments)a[1];
    for (long i = begin; i < end; ++i) yasps<m.springs.stretch.kappa>_value(a, i, out + i * 2);
}
