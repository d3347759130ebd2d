// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

extern "C" void yasps<m.arms.angle.kappa>_value(Arguments a, long i, int* out) {
    const long* const p0 = (const long*)a[0];
    out[0] = (int)(p0[0] + 1 * i + 1);
}
