// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

extern "C" void yasps<stiff.v.x>_value(Arguments a, long i, double* out);
extern "C" long yasps<stiff.v.x.jacobian>_pull(Arguments a, long i, const V* b, long n, V* out);
extern "C" void yasps<both.v.x>_value(Arguments a, long i, double* out) {
    const long* const p0 = (const long*)a[0];
    const double* const p1 = (const double*)a[1];
    Arguments const p2 = (Arguments)a[2];
    const double* const p3 = (const double*)a[3];
    if (i < p0[1]) { const long j = i - p0[0]; for (long e = 0; e < 3; ++e) out[e] = p1[j * 3 + e]; return; }
    if (i < p0[2]) { const long j = i - p0[1]; yasps<stiff.v.x>_value(p2, j, out); return; }
    if (i < p0[3]) { const long j = i - p0[2]; for (long e = 0; e < 3; ++e) out[e] = p3[j * 3 + e]; return; }
}

extern "C" long yasps<both.v.x>_pull(Arguments a, long i, const V* b, long n, V* out) {
    const long* const p0 = (const long*)a[0];
    const double* const p1 = (const double*)a[1];
    Arguments const p2 = (Arguments)a[2];
    const double* const p3 = (const double*)a[3];
    Arguments const p4 = (Arguments)a[4];
    if (i < p0[1]) { return copy_rows(3, b, n, out); }
    if (i < p0[2]) { const long j = i - p0[1]; return yasps<stiff.v.x.jacobian>_pull(p4, j, b, n, out); }
    if (i < p0[3]) { return 0; }
    return 0;
}
