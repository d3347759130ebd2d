// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

extern "C" void yasps<stiff.v.x>_value_lanes(Arguments a, const long* own, V* out);
extern "C" long yasps<stiff.v.x.jacobian>_pull_lanes(Arguments a, const long* own, const V* b, long n, V* out, int* sizes);
extern "C" void yasps<both.v.x>_value_lanes(Arguments a, const long* own, V* out) {
    const long* const p0 = (const long*)a[0];
    const double* const p1 = (const double*)a[1];
    Arguments const p2 = (Arguments)a[2];
    const double* const p3 = (const double*)a[3];
    long of[8];
    const double* at[8];
    V part[3];
    if (const unsigned in = lanes_within(own, p0[0], p0[1], of)) {
        #pragma GCC unroll 8
        for (long l = 0; l < 8; ++l) at[l] = p1 + of[l] * 3;
        gather(at, 3, part);
        take_lanes(in, part, 3, out);
    }
    if (const unsigned in = lanes_within(own, p0[1], p0[2], of)) {
        yasps<stiff.v.x>_value_lanes(p2, of, part);
        take_lanes(in, part, 3, out);
    }
    if (const unsigned in = lanes_within(own, p0[2], p0[3], of)) {
        #pragma GCC unroll 8
        for (long l = 0; l < 8; ++l) at[l] = p3 + of[l] * 3;
        gather(at, 3, part);
        take_lanes(in, part, 3, out);
    }
    (void)of, (void)at, (void)own;
}

extern "C" long yasps<both.v.x>_pull_lanes(Arguments a, const long* own, const V* b, long n, V* out, int* sizes) {
    const long* const p0 = (const long*)a[0];
    const double* const p1 = (const double*)a[1];
    Arguments const p2 = (Arguments)a[2];
    const double* const p3 = (const double*)a[3];
    Arguments const p4 = (Arguments)a[4];
    long of[8];
    if (own[0] < p0[1]) {
        copy_rows(3, b, n, out);
        sizes[0] = 3;
        return 1;
    }
    if (own[0] < p0[2]) {
        for (long l = 0; l < 8; ++l) of[l] = own[l] - p0[1];
        return yasps<stiff.v.x.jacobian>_pull_lanes(p4, of, b, n, out, sizes);
    }
    if (own[0] < p0[3]) {
        copy_rows(3, b, n, out);
        sizes[0] = 3;
        return 1;
    }
    (void)of;
    return 0;
}
