// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

extern "C" void yasps<soft.v.x.kappa>_value(Arguments a, long i, int* out);
extern "C" void yasps<stiff.v.x.kappa>_value(Arguments a, long i, int* out);
extern "C" void yasps<still.v.x.kappa>_value(Arguments a, long i, int* out);
extern "C" void yasps<both.v.x.kappa>_value(Arguments a, long i, int* out) {
    const long* const p0 = (const long*)a[0];
    Arguments const p1 = (Arguments)a[1];
    Arguments const p2 = (Arguments)a[2];
    Arguments const p3 = (Arguments)a[3];
    if (i < p0[1]) { const long j = i - p0[0]; yasps<soft.v.x.kappa>_value(p1, j, out); out[1] = 0; return; }
    if (i < p0[2]) { const long j = i - p0[1]; yasps<stiff.v.x.kappa>_value(p2, j, out); return; }
    if (i < p0[3]) { const long j = i - p0[2]; yasps<still.v.x.kappa>_value(p3, j, out); out[1] = 0; return; }
}
