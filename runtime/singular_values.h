// Eigenvectors and singular value decompositions of 3x3 matrices, one in each lane of V: Eight or Sixteen of vectors.h.
#pragma once

#include <float.h>

#include "vectors.h"

namespace yasps {
namespace {

// Sweeps of Jacobi rotations before giving up; one or none is usual, four or five without a good start.
constexpr int kMostSweeps = 30;
// Columns are orthogonal if the cosine of their angle is below this.
constexpr double kCosine = 4e-15;
// Columns this short count as zero beside an F of size one.
constexpr double kNothing = 1e-17;
// Two of the columns of F V give two of U. They need not be the longest ones, but longer than this if two are.
constexpr double kShort = 1e-3;

template <class V>
struct Vector {
    V at[3];
};
template <class V>
inline Vector<V> operator*(const Vector<V>& a, V s) {
    return {{a.at[0] * s, a.at[1] * s, a.at[2] * s}};
}
template <class V>
inline Vector<V> operator+(const Vector<V>& a, const Vector<V>& b) {
    return {{a.at[0] + b.at[0], a.at[1] + b.at[1], a.at[2] + b.at[2]}};
}
template <class V>
inline Vector<V> operator-(const Vector<V>& a, const Vector<V>& b) {
    return {{a.at[0] - b.at[0], a.at[1] - b.at[1], a.at[2] - b.at[2]}};
}
template <class V>
inline V dot(const Vector<V>& a, const Vector<V>& b) {
    return a.at[0] * b.at[0] + a.at[1] * b.at[1] + a.at[2] * b.at[2];
}
template <class V>
inline Vector<V> cross(const Vector<V>& a, const Vector<V>& b) {
    return {{a.at[1] * b.at[2] - a.at[2] * b.at[1], a.at[2] * b.at[0] - a.at[0] * b.at[2],
             a.at[0] * b.at[1] - a.at[1] * b.at[0]}};
}
template <class V>
inline Vector<V> choose(Mask<V> mask, const Vector<V>& a, const Vector<V>& b) {
    return {{select(mask, a.at[0], b.at[0]), select(mask, a.at[1], b.at[1]), select(mask, a.at[2], b.at[2])}};
}

// Three columns of a 3x3 matrix.
template <class V>
struct Columns {
    Vector<V> c[3];
};
template <class V>
inline Columns<V> unit_columns() {
    const V zero = {}, one = constant<V>(1);
    return {{{{one, zero, zero}}, {{zero, one, zero}}, {{zero, zero, one}}}};
}

template <class V>
struct Rotation {
    V cosine, sine;
};
// The rotation by at most 45 degrees that diagonalises [[p, off], [off, q]], for difference = p - q and twice = 2 off:
// columns (p, q) become (cosine p + sine q, cosine q - sine p).
template <class V>
inline Rotation<V> rotation_for(V difference, V twice) {
    const V adjacent = magnitude(difference) + square_root(difference * difference + twice * twice);
    const V squared = adjacent * adjacent + twice * twice, one = constant<V>(1);
    const auto nothing = less(squared, constant<V>(DBL_MIN));  // too small to be known: leave the columns as they are
    const V reciprocal = inverse(square_root(select(nothing, one, squared)));
    const V sine = select(less(difference, V{}), V{} - twice, twice) * reciprocal;
    return {select(nothing, one, adjacent * reciprocal), select(nothing, V{}, sine)};
}
template <class V>
inline void turn(Vector<V>& p, Vector<V>& q, Rotation<V> r) {
    const Vector<V> old = p;
    p = p * r.cosine + q * r.sine;
    q = q * r.cosine - old * r.sine;
}

// A symmetric 3x3 matrix: its diagonal, and the entries opposite to it.
template <class V>
struct Symmetric {
    V diagonal[3], opposite[3];  // opposite[k] stands at the two other indices
};
template <class V>
inline Vector<V> times(const Symmetric<V>& m, const Vector<V>& a) {
    return {{m.diagonal[0] * a.at[0] + m.opposite[2] * a.at[1] + m.opposite[1] * a.at[2],
             m.opposite[2] * a.at[0] + m.diagonal[1] * a.at[1] + m.opposite[0] * a.at[2],
             m.opposite[1] * a.at[0] + m.opposite[0] * a.at[1] + m.diagonal[2] * a.at[2]}};
}

// Of the three roots of 4 c^3 - 3 c = h, cos(acos(h) / 3), for h from 0 to 1: the one far from the others.
template <class V>
inline V far_root(V h) {
    // A polynomial through five of its values is right to 6e-6; two steps of Newton's method make that 1e-16.
    V c = h * -0.0040354 + constant<V>(0.0175122);
    c = c * h + constant<V>(-0.0459219);
    c = c * h + constant<V>(0.166412);
    c = c * h + constant<V>(0.86603);
    for (int step = 0; step < 2; ++step) {
        const V squared = c * c, three = constant<V>(3);
        c = c - (c * (squared * 4.0 - three) - h) * inverse(squared * 12.0 - three);
    }
    return c;
}

// Eigenvectors of m, right to rounding errors of the size of m: the eigenvector of the eigenvalue that is far from the
// others from a column of the adjugate, the two others in the plane orthogonal to it.
template <class V>
Columns<V> eigenvectors_of(const Symmetric<V>& m) {
    const V one = constant<V>(1), mean = (m.diagonal[0] + m.diagonal[1] + m.diagonal[2]) * (1.0 / 3.0);
    const V a = m.diagonal[0] - mean, b = m.diagonal[1] - mean, c = m.diagonal[2] - mean;
    const V p = m.opposite[0], q = m.opposite[1], r = m.opposite[2];
    const V squared = (a * a + b * b + c * c + (p * p + q * q + r * r) * 2.0) * (1.0 / 6.0);
    const V size = square_root(squared);
    const V determinant = a * (b * c - p * p) - r * (r * c - p * q) + q * (r * p - b * q);
    const V half = determinant * inverse(maximum(squared * size, constant<V>(DBL_MIN))) * 0.5;
    const V absolute = magnitude(half);
    const V far = with_sign(size * far_root(select(less(absolute, one), absolute, one)) * 2.0, half);
    const V a1 = a - far, b1 = b - far, c1 = c - far;
    const Vector<V> first = {{b1 * c1 - p * p, p * q - r * c1, p * r - q * b1}};
    const Vector<V> second = {{first.at[1], a1 * c1 - q * q, q * r - p * a1}};
    const Vector<V> third = {{first.at[2], second.at[2], a1 * b1 - r * r}};
    const V x = magnitude(first.at[0]), y = magnitude(second.at[1]), z = magnitude(third.at[2]);
    const Vector<V> later = choose<V>(less(y, z), third, second);
    const Vector<V> column = choose<V>(less(x, maximum(y, z)), later, first);
    const V length = dot(column, column);
    const auto none = less(length, constant<V>(DBL_MIN));  // m is a multiple of the identity
    const Vector<V> u =
        choose<V>(none, unit_columns<V>().c[2], column * inverse(square_root(select(none, one, length))));
    // Two vectors orthogonal to u and to each other (Duff et al. 2017, "Building an orthonormal basis, revisited").
    const V sign = with_sign(one, u.at[2]);
    const V shared = V{} - inverse(sign + u.at[2]), product = u.at[0] * u.at[1] * shared;
    const Vector<V> v = {{one + sign * u.at[0] * u.at[0] * shared, sign * product, V{} - sign * u.at[0]}};
    const Vector<V> w = {{product, sign + u.at[1] * u.at[1] * shared, V{} - u.at[1]}};
    const Vector<V> mv = times(m, v), mw = times(m, w);
    Columns<V> e = {{u, v, w}};
    turn(e.c[1], e.c[2], rotation_for(dot(v, mv) - dot(w, mw), dot(v, mw) * 2.0));
    return e;
}

// Turns m into its eigenvalues; the columns of e become its eigenvectors. Returns the bits of lanes that failed.
template <class V>
unsigned diagonalise(Symmetric<V>& m, Columns<V>& e) {
    const V size = magnitude(m.diagonal[0]) + magnitude(m.diagonal[1]) + magnitude(m.diagonal[2]) +
                   magnitude(m.opposite[0]) + magnitude(m.opposite[1]) + magnitude(m.opposite[2]);
    const V negligible = size * (4 * DBL_EPSILON);
    e = eigenvectors_of(m);
    const Vector<V> images[3] = {times(m, e.c[0]), times(m, e.c[1]), times(m, e.c[2])};
    for (int k = 0; k < 3; ++k) {
        m.diagonal[k] = dot(e.c[k], images[k]);
        m.opposite[k] = dot(e.c[(k + 1) % 3], images[(k + 2) % 3]);
    }
    // Jacobi rotations, until nothing is left to rotate; there seldom is anything.
    for (int sweep = 0;; ++sweep) {
        unsigned busy = 0;
        for (int p = 0; p < 2; ++p) {
            for (int q = p + 1; q < 3; ++q) {
                const int k = 3 - p - q;
                const V off = m.opposite[k];
                const unsigned turned = bits_of(less(negligible, magnitude(off)));
                if (turned == 0) continue;
                busy |= turned;
                const V difference = m.diagonal[p] - m.diagonal[q], twice = off * 2.0;
                const Rotation<V> r = rotation_for(difference, twice);
                const V shift = r.sine * (r.cosine * twice - r.sine * difference);
                m.diagonal[p] = m.diagonal[p] + shift;
                m.diagonal[q] = m.diagonal[q] - shift;
                m.opposite[k] = V{};
                const V at_p = m.opposite[q], at_q = m.opposite[p];  // (p, k) and (q, k)
                m.opposite[q] = r.cosine * at_p + r.sine * at_q;
                m.opposite[p] = r.cosine * at_q - r.sine * at_p;
                turn(e.c[p], e.c[q], r);
            }
        }
        if (busy == 0 || sweep == kMostSweeps) return busy;
    }
}

// Turns the columns of `a` by rotations until they are orthogonal, and those of `v` along (one-sided Jacobi). Returns
// the bits of lanes that did not get there, which with finite numbers are none.
template <class V>
unsigned make_orthogonal(Columns<V>& a, Columns<V>& v) {
    for (int sweep = 0;; ++sweep) {
        unsigned busy = 0;
        for (int p = 0; p < 2; ++p) {
            for (int q = p + 1; q < 3; ++q) {
                const V pp = dot(a.c[p], a.c[p]), qq = dot(a.c[q], a.c[q]), pq = dot(a.c[p], a.c[q]);
                const V most = (pp * qq + constant<V>(kNothing * kNothing)) * (kCosine * kCosine);
                const unsigned turned = bits_of(less(most, pq * pq));
                if (turned == 0) continue;
                busy |= turned;
                const Rotation<V> r = rotation_for(pp - qq, pq * 2.0);
                turn(a.c[p], a.c[q], r);
                turn(v.c[p], v.c[q], r);
            }
        }
        if (busy == 0 || sweep == kMostSweeps) return busy;
    }
}

// Puts the longer of two columns first; one changes its sign, so that this is a rotation too.
template <class V>
inline void sort(Columns<V>& a, Columns<V>& v, int p, int q) {
    const auto swapped = less(dot(a.c[p], a.c[p]), dot(a.c[q], a.c[q]));
    const Vector<V> ap = a.c[p], vp = v.c[p], zero = {};
    a.c[p] = choose<V>(swapped, a.c[q], ap);
    v.c[p] = choose<V>(swapped, v.c[q], vp);
    a.c[q] = choose<V>(swapped, zero - ap, a.c[q]);
    v.c[q] = choose<V>(swapped, zero - vp, v.c[q]);
}

// A unit vector orthogonal to the unit vector u.
template <class V>
inline Vector<V> any_orthogonal(const Vector<V>& u) {
    const V x = magnitude(u.at[0]), y = magnitude(u.at[1]), z = magnitude(u.at[2]);
    const Columns<V> axes = unit_columns<V>();
    const Vector<V> later = choose<V>(less(z, y), axes.c[2], axes.c[1]);
    const Vector<V> axis = choose<V>(less(select(less(z, y), z, y), x), later, axes.c[0]);
    const Vector<V> w = axis - u * dot(axis, u);
    return w * inverse(square_root(dot(w, w)));
}

// Rotations u and v with u^T f v diagonal, for columns of f no longer than about one. Without a third column, which is
// zero, v's third column is (0, 0, 1). Returns the bits of lanes that have none.
template <int cols, class V>
unsigned singular_frames(Columns<V> f, Columns<V>& u, Columns<V>& v) {
    v = unit_columns<V>();
    if (cols == 3) {
        v = eigenvectors_of<V>({{dot(f.c[0], f.c[0]), dot(f.c[1], f.c[1]), dot(f.c[2], f.c[2])},
                                {dot(f.c[1], f.c[2]), dot(f.c[0], f.c[2]), dot(f.c[0], f.c[1])}});
        const Columns<V> given = f;
        for (int k = 0; k < 3; ++k)
            f.c[k] = given.c[0] * v.c[k].at[0] + given.c[1] * v.c[k].at[1] + given.c[2] * v.c[k].at[2];
    }
    const unsigned failed = make_orthogonal(f, v);
    const V least = constant<V>(kShort * kShort), nothing = constant<V>(kNothing * kNothing), one = constant<V>(1);
    if (bits_of(less(dot(f.c[0], f.c[0]), least) | less(dot(f.c[1], f.c[1]), least)) != 0) {
        sort(f, v, 0, 1);
        sort(f, v, 0, 2);
        sort(f, v, 1, 2);
    }
    const V first = dot(f.c[0], f.c[0]);
    const auto zero = less(first, nothing);
    u.c[0] = choose<V>(zero, unit_columns<V>().c[0], f.c[0] * inverse(square_root(select(zero, one, first))));
    const Vector<V> rest = f.c[1] - u.c[0] * dot(f.c[1], u.c[0]);
    const V second = dot(rest, rest);
    const auto thin = less(second, nothing);
    u.c[1] = rest * inverse(square_root(select(thin, one, second)));
    if (bits_of(thin) != 0) u.c[1] = choose<V>(thin, any_orthogonal(u.c[0]), u.c[1]);
    u.c[2] = cross(u.c[0], u.c[1]);  // so the third singular value takes the sign of det f
    return failed;
}

}  // namespace
}  // namespace yasps
