// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

extern "C" void yasps<m.v.gravity.kappa>_value(Arguments a, long i, int* out) {
    const long* const p0 = (const long*)a[0];
    out[0] = (int)(p0[0] + 3 * i + 1);
}

extern "C" void yasps<m.v.gravity.kappa>_batch(Arguments a, long begin, long end, int* out) {
    const long* const p0 = (const long*)a[0];
    for (long i = begin; i < end; ++i) yasps<m.v.gravity.kappa>_value(a, i, out + i * 1);
}
