// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

extern "C" void yasps<m.arms.angle.kappa>_value(Arguments a, long i, int* out);
extern "C" void yasps<m.tips.x.kappa>_value(Arguments a, long i, int* out) {
    const int* const p0 = (const int*)a[0];
    Arguments const p1 = (Arguments)a[1];
    for (long s = 0; s < 1; ++s) {
        const long j = p0[i * 1 + s];
        yasps<m.arms.angle.kappa>_value(p1, j, (out + s * 1));
    }
}
