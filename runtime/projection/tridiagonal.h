// Steps on the way to the eigenvalues of a symmetric matrix of any width, for packs of matrices and for one:
// Householder's reduction to tridiagonal form, and the rotations of QL sweeps with Wilkinson's shift (Golub & Van Loan,
// sec. 8.3).
//
// V is a number as in three_by_three.h; Numbers are pointers to V, or what is indexed as these.
#pragma once

#include "projection/three_by_three.h"

namespace yasps {
namespace {

// Sweeps for each eigenvalue: two are usual. After the first number couplings of growing size are taken for zero, after
// the second the search ends.
constexpr int kManySweeps = 4, kMaxSweeps = 10;
// Columns whose squares have a smaller sum are far below rounding of a matrix of size one.
constexpr double kNoColumn = 1e-40;

// Two sums side by side: one alone would wait for each addition.
template <class V, class Numbers>
YASPS_FUNCTION inline V dot(Numbers a, Numbers b, int n) {
    V even = {}, odd = {};
    int i = 0;
    for (; i + 1 < n; i += 2) {
        even = even + a[i] * b[i];
        odd = odd + a[i + 1] * b[i + 1];
    }
    if (i < n) even = even + a[i] * b[i];
    return even + odd;
}

// Reduces the symmetric matrix a (n x n, upper triangle, n > 1) to tridiagonal form: diagonal d, off-diagonal
// e[0 .. n-2]. Reflection k is I - s v v^T with v in row k of a, right of the diagonal, and s below the diagonal, at
// (k + 1, k). e has room for n; what is not yet needed of it is scratch.
template <class V, class Numbers>
YASPS_FUNCTION inline void tridiagonalise(Numbers a, int n, Numbers d, Numbers e) {
    YASPS_ROLLED
    for (int k = 0; k + 2 < n; ++k) {
        const int m = n - k - 1;  // what is left to reduce: b, below and right of entry (k, k)
        const Numbers v = a + (k * n + k + 1);
        const Numbers b = v + n;
        const Numbers p = e + (k + 1);
        d[k] = v[-1];
        const V squared = dot<V>(v, v, m);
        const V first = v[0];
        const auto has_column = less(constant<V>(kNoColumn), squared);
        if (!any(has_column)) {
            e[k] = first;
            b[-1] = V{};
            continue;
        }
        V length, over_length;
        find_roots(maximum(squared, constant<V>(kNoColumn)), &length, &over_length);
        const V reflected = with_sign(length, first) * -1.0;
        e[k] = select(has_column, reflected, first);
        v[0] = first - reflected;
        // The divisor |v|^2 / 2 is one to two times the square of the length.
        const V scale = select(has_column, reciprocal(squared - first * reflected), V{});
        b[-1] = scale;
        for (int i = 0; i < m; ++i) p[i] = V{};
        YASPS_ROLLED
        for (int i = 0; i < m; ++i) {
            const Numbers row = b + i * n;
            const V factor = v[i];
            V sum = row[i] * factor;
            for (int j = i + 1; j < m; ++j) {
                sum = sum + row[j] * v[j];
                p[j] = p[j] + row[j] * factor;
            }
            p[i] = p[i] + sum;
        }
        const V half = dot<V>(p, v, m) * scale * scale * 0.5;
        for (int i = 0; i < m; ++i) p[i] = half * v[i] - p[i] * scale;
        YASPS_ROLLED
        for (int i = 0; i < m; ++i) {
            const Numbers row = b + i * n;
            const V vi = v[i], pi = p[i];
            for (int j = i; j < m; ++j) row[j] = row[j] + vi * p[j] + pi * v[j];
        }
    }
    const Numbers corner = a + ((n - 2) * n + n - 2);
    d[n - 2] = corner[0];
    e[n - 2] = corner[1];
    d[n - 1] = corner[n + 1];
}

// Couplings up to this are zero at first, in a matrix with the diagonal d and the off-diagonal e. Of a multiple
// eigenvalue less than kEpsilon may remain for ever: it is rounding of the shifted diagonal.
template <class V, class Numbers>
YASPS_FUNCTION inline V negligible_coupling(Numbers d, Numbers e, int n) {
    V norm = {};
    for (int i = 0; i < n; ++i) norm = maximum(norm, magnitude(d[i]) + (i + 1 < n ? magnitude(e[i]) : V{}));
    return norm * (2 * kEpsilon);
}

// Wilkinson's shift: the eigenvalue of [[diagonal, coupling], [coupling, next]] that is closer to its first entry.
template <class V>
YASPS_FUNCTION inline V shift_for(V diagonal, V next, V coupling) {
    const V difference = next - diagonal;
    V root, over_root;
    find_roots(maximum(coupling * coupling * 4.0 + difference * difference, constant<V>(1e-280)), &root, &over_root);
    return (diagonal + next - with_sign(root, difference)) * 0.5;
}

// A QL sweep of the tridiagonal matrix, from its last row to its first.
template <class V>
struct QlSweep {
    V shift, p;
    Rotation<V> turn;

    // Begins at row `high`.
    template <class Numbers>
    YASPS_FUNCTION QlSweep(V shift_by, Numbers d, int high)
        : shift(shift_by), p(d[high] - shift_by), turn{constant<V>(1), V{}} {}

    // Turns axes (i, i + 1) by the rotation that is `turn` then.
    template <class Numbers>
    YASPS_ALWAYS_INLINE void step(Numbers d, Numbers e, int i) {
        const V entry = d[i] - shift, coupling = e[i];
        // What is added is nothing beside what has an angle, and keeps the inverse finite.
        const V squared = (coupling * coupling + constant<V>(1e-300)) + p * p;
        // Where both are nothing there is no angle, and none is needed.
        const auto zero = less(squared, constant<V>(1e-280));
        V length, over_length;
        find_roots(squared, &length, &over_length);
        const V g = turn.cosine * coupling;
        const V h = turn.cosine * p;
        e[i + 1] = turn.sine * length;
        turn.sine = select(zero, V{}, coupling * over_length);
        turn.cosine = select(zero, constant<V>(1), p * over_length);
        d[i + 1] = h + turn.sine * (turn.cosine * g + turn.sine * entry) + shift;
        p = select(zero, entry, (p * entry - coupling * g) * over_length);
    }

    // Ends at row `low`.
    template <class Numbers>
    YASPS_FUNCTION void finish(Numbers d, Numbers e, int low) {
        e[low] = turn.sine * p;
        d[low] = turn.cosine * p + shift;
    }
};

}  // namespace
}  // namespace yasps
