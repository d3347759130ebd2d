// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

extern "C" void yasps<soft.v.x.kappa>_value(Arguments a, long i, int* out);
extern "C" void yasps<stiff.body.A.kappa>_value(Arguments a, long i, int* out);
static inline void value_index(const int* x0, const int* x1, int* __restrict y0) {
    y0[0] = x0[0];
    y0[1] = x1[0];
}

extern "C" void yasps<stiff.v.x.kappa>_value(Arguments a, long i, int* out) {
    const int* const p0 = (const int*)a[0];
    Arguments const p1 = (Arguments)a[1];
    Arguments const p2 = (Arguments)a[2];
    int r0[1];
    int r1[1];
    for (long s = 0; s < 1; ++s) {
        const long j = p0[i * 1 + s];
        yasps<soft.v.x.kappa>_value(p1, j, (r0 + s * 1));
    }
    for (long s = 0; s < 1; ++s) {
        const long j = p0[i * 1 + s];
        yasps<stiff.body.A.kappa>_value(p2, j, (r1 + s * 1));
    }
    value_index(r0, r1, out);
}
