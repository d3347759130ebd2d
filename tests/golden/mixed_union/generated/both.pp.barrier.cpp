// backend/kernel_prelude.h stands here

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

extern "C" void yasps<both.v.x>_value(Arguments, long, double*);
static inline void value_pack(const V* x0, V* y0) {
    const V t7 = x0[0] - x0[3];
    const V t8 = x0[1] - x0[4];
    const V t9 = x0[2] - x0[5];
    const V t10 = t7 * t7;
    const V t11 = t8 * t8;
    const V t12 = t9 * t9;
    const V t13 = t10 + t12;
    const V t14 = t11 + t13;
    const V t15 = t14 / splat(2.5);
    const V t16 = v_log(t15);
    const V t17 = splat(2.5) - t14;
    const V t18 = t17 * t17;
    const V t19 = t16 * t18;
    const V t20 = t16 * t19;
    y0[0] = t20;
}

extern "C" void yasps<both.pp.barrier>_batch(Arguments a, long begin, long end, double* out) {
    const int* const p0 = (const int*)a[0];
    Arguments const p1 = (Arguments)a[1];
    for (long first = begin; first < end; first += 8) {
        const long lanes = end - first < 8 ? end - first : 8;
        V r0[6];
        long at[8];
        for (long l = 0; l < 8; ++l) {
            const long i = first + (l < lanes ? l : lanes - 1);
            double one[6];
            for (long s = 0; s < 2; ++s) {
                const long j = p0[i * 2 + s];
                yasps<both.v.x>_value(p1, j, (one + s * 3));
            }
            for (long e = 0; e < 6; ++e) r0[e][l] = one[e];
            (void)i;
        }
        (void)at;
        V y[1];
        value_pack(r0, y);
        for (long l = 0; l < lanes; ++l)
            for (long e = 0; e < 1; ++e) out[(first + l) * 1 + e] = y[e][l];
    }
}
