// backend/kernel_prelude.h stands here

extern "C" void yasps<m.tips.x.curvature>_second(Arguments, long, const double*, double*);
static inline void pull_back_one(const double* x0, const double* x1, const double* x2, double* y0) {
    const double t4 = __builtin_cos(x0[0]);
    const double t5 = x1[0] * t4;
    const double t6 = __builtin_sin(x0[0]);
    const double t7 = x1[0] * t6;
    const double t8 = x2[0] * t7;
    const double t9 = x2[1] * t5;
    const double t10 = t9 - t8;
    y0[0] = t10;
}

extern "C" long yasps<m.tips.x.jacobian>_pull(Arguments a, long i, const double* b, long n, double* out) {
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
    double v[2], x[1];
    for (long c = 0; c < n; ++c) {
        for (long k = 0; k < 2; ++k) v[k] = b[k * n + c];
        pull_back_one(r0, r1, v, x);
        for (long k = 0; k < 1; ++k) out[k * n + c] = x[k];
    }
    return 1;
}

static inline long copy_rows(long rows, const double* b, long n, double* out) {
    for (long k = 0; k < rows * n; ++k) out[k] = b[k];
    return rows;
}

extern "C" long yasps<m.tips.x.jacobian>_curve(Arguments a, long i, const double* v, double* out, long n) {
    const int* const p0 = (const int*)a[0];
    const double* const p1 = (const double*)a[1];
    const double* const p2 = (const double*)a[2];
    Arguments const p3 = (Arguments)a[3];
    long at[2];
    at[0] = 0;
    at[1] = at[0] + copy_rows(1, (const double*)0, 0, (double*)0);
    double second[1];
    yasps<m.tips.x.curvature>_second(p3, i, v, second);
    {
        double b[1], left[1];
        double turned[1], both[1];
        for (long r = 0; r < 1; ++r)
            for (long c = 0; c < 1; ++c)
                b[r * 1 + c] = second[packed(1, 0 + (r < c ? r : c), 0 + (r < c ? c : r))];
        const long height = copy_rows(1, b, 1, left);
        for (long r = 0; r < height; ++r)
            for (long c = 0; c < 1; ++c)
                turned[c * height + r] = left[r * 1 + c];
        const long across = copy_rows(1, turned, height, both);
        for (long r = 0; r < height; ++r)
            for (long c = 0; c < across; ++c) {
                out[(at[0] + r) * n + at[0] + c] += both[c * height + r];
            }
    }
    return at[1];
}
