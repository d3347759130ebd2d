// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

#if defined(__AVX512F__)
extern "C" V _ZGVeN8v_log(V a);
static inline V v_log(V a) { return _ZGVeN8v_log(a); }
#elif defined(__AVX2__)
typedef double V4 __attribute__((vector_size(32), may_alias));
extern "C" V4 _ZGVdN4v_log(V4);
static inline V v_log(V a) {
    V r;
    for (int h = 0; h < 2; ++h) ((V4*)&r)[h] = _ZGVdN4v_log(((const V4*)&a)[h]);
    return r;
}
#else
static inline V v_log(V a) {
    V r;
    for (int l = 0; l < 8; ++l) r[l] = __builtin_log(a[l]);
    return r;
}
#endif

extern "C" void yasps<both.v.x>_value_lanes(Arguments a, const long* own, V* out);
static inline void value_uniforms_one(const double* x0, double* __restrict y0) {
    const double t3 = 1.0 / x0[0];
    y0[1] = t3;
    y0[0] = x0[1];
}

static inline void value_pack(const V* x0, const V* x1, V* __restrict y0) {
    const V t8 = x0[0] - x0[3];
    const V t9 = x0[1] - x0[4];
    const V t10 = x0[2] - x0[5];
    const V t11 = t8 * t8;
    const V t12 = t9 * t9;
    const V t13 = t10 * t10;
    const V t14 = t11 + t13;
    const V t15 = t12 + t14;
    const V t16 = x1[1] * t15;
    const V t17 = v_log(t16);
    const V t18 = x1[0] - t15;
    const V t19 = t18 * t18;
    const V t20 = t17 * t19;
    const V t21 = t17 * t20;
    y0[0] = t21;
}

extern "C" void yasps<both.pp.barrier>_batch(Arguments a, long begin, long end, double* out) {
    const double* const p0 = (const double*)a[0];
    const int* const p1 = (const int*)a[1];
    Arguments const p2 = (Arguments)a[2];
    double u0_one[2];
    value_uniforms_one(p0, u0_one);
    V u0[2];
    for (long e = 0; e < 2; ++e) u0[e] = splat(u0_one[e]);
    for (long first = begin; first < end; first += 8) {
        const long lanes = end - first < 8 ? end - first : 8;
        V r0[6];
        long of[8];
        const double* at[8];
        for (long s = 0; s < 2; ++s) {
            connected_instances(p1 + first * 2 + s, 2, lanes, of);
            yasps<both.v.x>_value_lanes(p2, of, r0 + s * 3);
        }
        (void)of, (void)at;
        V y[1];
        value_pack(r0, u0, y);
        for (long l = 0; l < lanes; ++l)
            for (long e = 0; e < 1; ++e) out[(first + l) * 1 + e] = y[e][l];
    }
}
