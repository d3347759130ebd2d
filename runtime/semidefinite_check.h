// One matrix per vector lane: helpers for eight symmetric matrices at once, and the cheap test that most of them pass.
//
// Most Hessians of a simulation are already semidefinite. An LDL^T factorisation of all lanes finds out at a fraction
// of the cost of a decomposition, and the lanes that fail are then drawn together from several packs.
#pragma once

#include <float.h>

namespace yasps {
namespace {

constexpr int kLanes = kYaspsLanes;
// Eigenvalues above -kShift * (sum of |diagonal|) count as zero: rigid motions leave such rounding error behind.
constexpr double kShift = 1e-13;

enum Mode { kClamp = 0, kAbsolute = 1, kLeave = 2 };

inline d8 splat(double v) { return d8{v, v, v, v, v, v, v, v}; }
inline d8 select(l8 mask, d8 yes, d8 no) { return mask ? yes : no; }
inline d8 magnitude(d8 v) { return reinterpret_cast<d8>(reinterpret_cast<l8>(v) & INT64_MAX); }
inline d8 maximum(d8 a, d8 b) { return select(a > b, a, b); }
inline d8 minimum(d8 a, d8 b) { return select(a < b, a, b); }
inline d8 square_root(d8 v) {
    d8 root;
    for (int lane = 0; lane < kLanes; ++lane) root[lane] = sqrt(v[lane]);
    return root;
}
inline bool any(l8 mask) {
    l4 halves[2];
    memcpy(halves, &mask, sizeof(mask));
    const l4 found = halves[0] | halves[1];
    return ((found[0] | found[1]) | (found[2] | found[3])) != 0;
}
inline l8 lanes_below(long count) { return l8{0, 1, 2, 3, 4, 5, 6, 7} < count; }
inline int first_lane(l8 mask) {
    int lane = 0;
    while (lane < kLanes && !mask[lane]) ++lane;
    return lane;
}

// Powers of two that bring `largest` of every lane to about one; exact to multiply with, and normal numbers.
inline void find_scales(d8 largest, d8* down, d8* up) {
    const l8 biased = (reinterpret_cast<l8>(largest) >> 52) & 0x7ff;
    const l8 exponent = biased < 2 ? l8{} + 2 : biased > 2044 ? l8{} + 2044 : biased;
    *up = reinterpret_cast<d8>(exponent << 52);
    *down = reinterpret_cast<d8>((2046 - exponent) << 52);
}

struct Check {
    l8 finite;
    l8 failed;   // has, or may have, a negative eigenvalue
    d8 largest;  // absolute value of the largest entry
};

// Which of eight matrices of width n, given by packed upper triangles, have an LDL^T factorisation with a positive D
// when the shift is added. `work` holds a packed triangle.
inline Check check_pack(const d8_unaligned* a, int n, d8* work) {
    const int entries = n * (n + 1) / 2;
    Check check = {~l8{}, l8{}, d8{}};
    for (int k = 0; k < entries; ++k) {
        const d8 size = magnitude(a[k]);
        check.finite &= size <= DBL_MAX;
        check.largest = maximum(size, check.largest);
        work[k] = a[k];
    }
    d8 trace = {};
    for (int i = 0, k = 0; i < n; k += n - i, ++i) trace += magnitude(a[k]);
    const d8 shift = trace * kShift + DBL_MIN;  // the absolute part lets a zero matrix pass
    for (int i = 0, k = 0; i < n; k += n - i, ++i) work[k] += shift;
    // Near the ends of the number range the factorisation overflows; there the eigenvalues decide, after scaling.
    l8 passed = (check.largest < 1e290) & ((check.largest > 1e-290) | (check.largest == 0.0));
    d8* row = work;
    for (int k = 0; k < n; ++k) {
        const d8 pivot = row[0];
        passed &= pivot > 0.0;
        const d8 inverse = 1.0 / pivot;
        d8* below = row + (n - k);
        for (int i = 1; i < n - k; ++i) {
            const d8 factor = row[i] * inverse;
            for (int j = i; j < n - k; ++j) below[j - i] -= factor * row[j];
            below += n - k - i;
        }
        row += n - k;
    }
    check.failed = ~passed;
    return check;
}

}  // namespace
}  // namespace yasps
