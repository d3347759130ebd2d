// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

// backend/codegen/preludes/merge.h stands here

// backend/cpp/preludes/expand.h stands here

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

extern "C" void yasps<m.tips.x.curvature>_second(Arguments a, long i, const double* v, double* out);
static inline void pull_back_pack(const V* x0, const V* x1, const V* x2, V* __restrict y0) {
    const V t4 = v_cos(x0[0]);
    const V t5 = x1[0] * t4;
    const V t6 = v_sin(x0[0]);
    const V t7 = x1[0] * t6;
    const V t8 = x2[0] * t7;
    const V t9 = x2[1] * t5;
    const V t10 = t9 - t8;
    y0[0] = t10;
}

extern "C" long yasps<m.tips.x.jacobian>_pull(Arguments a, long i, const V* b, long n, V* out) {
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
    V r0_pack[1];
    for (long e = 0; e < 1; ++e) r0_pack[e] = splat(r0[e]);
    V r1_pack[1];
    for (long e = 0; e < 1; ++e) r1_pack[e] = splat(r1[e]);
    V v[2], x[1];
    for (long c = 0; c < n; ++c) {
        for (long k = 0; k < 2; ++k) v[k] = b[k * n + c];
        pull_back_pack(r0_pack, r1_pack, v, x);
        for (long k = 0; k < 1; ++k) out[k * n + c] = x[k];
    }
    return 1;
}

extern "C" void yasps<m.tips.x.jacobian>_curve(Arguments a, long i, const double* v, double* packed, long step, long width, const int* to) {
    const int* const p0 = (const int*)a[0];
    const double* const p1 = (const double*)a[1];
    const double* const p2 = (const double*)a[2];
    Arguments const p3 = (Arguments)a[3];
    long at[2];
    at[0] = 0;
    at[1] = at[0] + copy_rows(1, (const V*)0, 0, (V*)0);
    double second[1];
    yasps<m.tips.x.curvature>_second(p3, i, v, second);
    V rows0[1];
    V left0[1];
    copy_rows_of_triangle(second, 1, 0, 1, (double*)rows0, 8);
    const long height0 = copy_rows(1, rows0, 1, left0);
    {
        V right[1];
        V both[1];
        const long breadth = (height0 + 7) / 8, across = 8 * breadth;
        for (long r = 0; breadth && r < 1; ++r) right[(r + 1) * breadth - 1] = splat(0.0);
        long column = 0;
        copy_transposed((const double*)left0 + 0, 8, height0, 1, (double*)right + column, across);
        column += height0;
        const long height = copy_rows(1, right, breadth, both);
        const double* block = (const double*)both;
        for (long r = 0; r < height; ++r) add_merged_row(packed, step, width, to, at[0], r, at[0], height0, block + r * across);
        block += height0;
        (void)column, (void)block, (void)height;
    }
}
