// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

#if defined(__AVX512F__)
extern "C" V _ZGVeN8v_cos(V a);
static inline V v_cos(V a) { return _ZGVeN8v_cos(a); }
#elif defined(__AVX2__)
typedef double V4 __attribute__((vector_size(32), may_alias));
extern "C" V4 _ZGVdN4v_cos(V4);
static inline V v_cos(V a) {
    V r;
    for (int h = 0; h < 2; ++h) ((V4*)&r)[h] = _ZGVdN4v_cos(((const V4*)&a)[h]);
    return r;
}
#else
static inline V v_cos(V a) {
    V r;
    for (int l = 0; l < 8; ++l) r[l] = __builtin_cos(a[l]);
    return r;
}
#endif

#if defined(__AVX512F__)
extern "C" V _ZGVeN8v_sin(V a);
static inline V v_sin(V a) { return _ZGVeN8v_sin(a); }
#elif defined(__AVX2__)
typedef double V4 __attribute__((vector_size(32), may_alias));
extern "C" V4 _ZGVdN4v_sin(V4);
static inline V v_sin(V a) {
    V r;
    for (int h = 0; h < 2; ++h) ((V4*)&r)[h] = _ZGVdN4v_sin(((const V4*)&a)[h]);
    return r;
}
#else
static inline V v_sin(V a) {
    V r;
    for (int l = 0; l < 8; ++l) r[l] = __builtin_sin(a[l]);
    return r;
}
#endif

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

static inline void value_pack(const V* x0, const V* x1, V* __restrict y0) {
    const V t2 = v_sin(x0[0]);
    const V t3 = x1[0] * t2;
    y0[1] = t3;
    const V t4 = v_cos(x0[0]);
    const V t5 = x1[0] * t4;
    y0[0] = t5;
}

extern "C" void yasps<m.tips.x>_value_lanes(Arguments a, const long* own, V* out) {
    const int* const p0 = (const int*)a[0];
    const double* const p1 = (const double*)a[1];
    const double* const p2 = (const double*)a[2];
    V r0[1];
    V r1[1];
    long of[8];
    const double* at[8];
    for (long s = 0; s < 1; ++s) {
        instances_from(p0 + s, 1, own, of);
        #pragma GCC unroll 8
        for (long l = 0; l < 8; ++l) at[l] = p1 + of[l] * 1;
        gather(at, 1, r0 + s * 1);
    }
    for (long l = 0; l < 8; ++l) of[l] = own[l];
    #pragma GCC unroll 8
    for (long l = 0; l < 8; ++l) at[l] = p2 + of[l] * 1;
    gather(at, 1, r1);
    (void)of, (void)at, (void)own;
    value_pack(r0, r1, out);
}
