// The blocks that the Hessian of an isotropic energy falls into, for packs of matrices and for one.
//
// If an energy psi(F), F 3x3 or 3x2, does not change under F -> R F Q for rotations R and Q, and F = U S V^T with
// rotations U and V, then its Hessian falls apart in the basis of the matrices u_i v_j^T: into one block of the i = j,
// and for each i < j a block [[a, b], [b, a]] of (i, j) and (j, i), with eigenvalues a + b (flip) and a - b (twist);
// of a 3x2 F, u_3 v_1^T and u_3 v_2^T remain, each an eigenvector. So one 3x3 eigenproblem takes the place of a 9x9.
// (Smith, de Goes and Kim 2019, "Analytic eigensystems for isotropic distortion energies". Their derivatives by
// singular values are not needed: the blocks are read off the Hessian that is there.) U and V need not be unique: any
// singular value decomposition does, so equal, zero and negative singular values are no special cases.
#pragma once

#include "projection/three_by_three.h"

namespace yasps {
namespace {

// The blocks of h in the basis u_i v_j^T. Those that an F of two columns does not have are zero, and so are the blocks
// that an F of three columns does not have.
template <class V>
struct Blocks {
    Symmetric<V> same;      // of all u_i v_i^T
    V alike[3], across[3];  // of the pair without index k: [[alike, across], [across, alike]]
    V last[2];              // of u_3 v_1^T and u_3 v_2^T, for an F of two columns
};

// A 3 x cols matrix, row by row.
template <int cols, class V>
struct Matrix {
    V at[3 * cols];
};
// a b^T.
template <int cols, class V>
YASPS_FUNCTION inline Matrix<cols, V> outer(const Vector<V>& a, const Vector<V>& b) {
    Matrix<cols, V> m;
    YASPS_UNROLLED
    for (int k = 0; k < 3 * cols; ++k) m.at[k] = a.at[k / cols] * b.at[k % cols];
    return m;
}
template <int cols, class V>
YASPS_FUNCTION inline Matrix<cols, V> operator+(const Matrix<cols, V>& a, const Matrix<cols, V>& b) {
    Matrix<cols, V> m;
    YASPS_UNROLLED
    for (int k = 0; k < 3 * cols; ++k) m.at[k] = a.at[k] + b.at[k];
    return m;
}
template <int cols, class V>
YASPS_FUNCTION inline Vector<V> times(const Matrix<cols, V>& m, const Vector<V>& b) {
    Vector<V> result;
    YASPS_UNROLLED
    for (int r = 0; r < 3; ++r) {
        result.at[r] = m.at[r * cols] * b.at[0] + m.at[r * cols + 1] * b.at[1];
        if (cols == 3) result.at[r] = result.at[r] + m.at[r * cols + cols - 1] * b.at[2];
    }
    return result;
}

// h x; entries(k) is entry k of the upper triangle of h, row by row.
template <int cols, class V, class Entries>
YASPS_FUNCTION inline Matrix<cols, V> multiply(const Entries& entries, const Matrix<cols, V>& x) {
    constexpr int n = 3 * cols;
    Matrix<cols, V> hx;
    YASPS_UNROLLED
    for (int r = 0; r < n; ++r) hx.at[r] = entries(r) * x.at[0];
    YASPS_UNROLLED
    for (int r = 0; r < n; ++r) {
        YASPS_UNROLLED
        for (int s = r > 0 ? r : 1; s < n; ++s) {
            const V entry = entries(place_of<n>(r, s));
            hx.at[r] = hx.at[r] + entry * x.at[s];
            if (r > 0 && s > r) hx.at[s] = hx.at[s] + entry * x.at[r];
        }
    }
    return hx;
}

// h is known to consist of blocks, so its product with one matrix and a few sums of its entries tell all of them.
template <int cols, class V, class Entries>
YASPS_FUNCTION Blocks<V> blocks_of(const Entries& entries, const Columns<V>& u, const Columns<V>& v) {
    constexpr int n = 3 * cols;
    Blocks<V> found = {};
    Symmetric<V>& same = found.same;
    if (cols == 3) {
        // u_i v_j^T of all i <= j.
        const Vector<V> two = v.c[1] + v.c[2];
        const Matrix<cols, V> image = multiply<cols, V>(
            entries, outer<cols>(u.c[0], v.c[0] + two) + outer<cols>(u.c[1], two) + outer<cols>(u.c[2], v.c[2]));
        const Vector<V> right[3] = {times(image, v.c[0]), times(image, v.c[1]), times(image, v.c[2])};
        found.alike[0] = dot(u.c[1], right[2]), found.across[0] = dot(u.c[2], right[1]);
        found.alike[1] = dot(u.c[0], right[2]), found.across[1] = dot(u.c[2], right[0]);
        found.alike[2] = dot(u.c[0], right[1]), found.across[2] = dot(u.c[1], right[0]);
        // The sum of the 3x3 blocks of h on the diagonal has, for v_j, the sum of the entries of all u_i v_j^T.
        Symmetric<V> sums;
        YASPS_UNROLLED
        for (int a = 0; a < 3; ++a) {
            const int b = (a + 1) % 3, c = (a + 2) % 3;
            sums.diagonal[a] = entries(place_of<n>(a, a)) + entries(place_of<n>(n - 6 + a, n - 6 + a)) +
                               entries(place_of<n>(n - 3 + a, n - 3 + a));
            sums.opposite[a] = entries(place_of<n>(b, c)) + entries(place_of<n>(n - 6 + b, n - 6 + c)) +
                               entries(place_of<n>(n - 3 + b, n - 3 + c));
        }
        const V first = dot(v.c[0], times(sums, v.c[0])), second = dot(v.c[1], times(sums, v.c[1]));
        const V third = sums.diagonal[0] + sums.diagonal[1] + sums.diagonal[2] - first - second;
        same.diagonal[0] = first - found.alike[1] - found.alike[2];
        same.diagonal[1] = second - found.alike[0] - found.alike[2];
        same.diagonal[2] = third - found.alike[0] - found.alike[1];
        // Sums of the two entries beside the diagonal.
        const V x = dot(u.c[0], right[0]) - same.diagonal[0], y = dot(u.c[1], right[1]) - same.diagonal[1];
        const V z = dot(u.c[2], right[2]) - same.diagonal[2];
        same.opposite[0] = (y + z - x) * 0.5;
        same.opposite[1] = (x + z - y) * 0.5;
        same.opposite[2] = (x + y - z) * 0.5;
    } else {
        // All of u_i v_j^T but u_2 v_1^T.
        const Matrix<cols, V> image =
            multiply<cols, V>(entries, outer<cols>(u.c[0] + u.c[2], v.c[0] + v.c[1]) + outer<cols>(u.c[1], v.c[1]));
        const Vector<V> right[2] = {times(image, v.c[0]), times(image, v.c[1])};
        found.alike[2] = dot(u.c[0], right[1]);
        found.across[2] = dot(u.c[1], right[0]);
        found.last[0] = dot(u.c[2], right[0]);
        found.last[1] = dot(u.c[2], right[1]);
        const V first = dot(u.c[0], right[0]), second = dot(u.c[1], right[1]);
        V both = found.alike[2] * -2.0 - found.last[0] - found.last[1];
        YASPS_UNROLLED
        for (int k = 0; k < n; ++k) both = both + entries(place_of<n>(k, k));
        same.diagonal[0] = (both + first - second) * 0.5;
        same.diagonal[1] = (both + second - first) * 0.5;
        same.opposite[2] = first - same.diagonal[0];
    }
    return found;
}

}  // namespace
}  // namespace yasps
