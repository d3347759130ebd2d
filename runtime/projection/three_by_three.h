// Eigenvectors and singular value decompositions of 3x3 matrices, for packs of them and for one.
//
// V is a number of each matrix: Eight or Sixteen of core/vectors.h on the CPU, a double of cuda/number.cuh for a thread
// of a GPU. Whoever includes this has included one of the two, which say what can be done with numbers.
#pragma once

namespace yasps {
namespace {

// Where entry (r, s) of the upper triangle of an n x n matrix is if packed row by row, or (s, r) below the diagonal.
template <int n>
YASPS_FUNCTION constexpr int place_of(int r, int s) {
    return r <= s ? r * n - r * (r + 1) / 2 + s : s * n - s * (s + 1) / 2 + r;
}

// Sweeps of Jacobi rotations before giving up; one or none is usual, four or five without a good start.
constexpr int kMostSweeps = 30;
// Columns are orthogonal if the projection of one on a longer one is below this, for an F of size one.
constexpr double kOblique = 4e-15;
// Beside an F of size one: columns this short have no direction but that of rounding. Measured: with 1e-17 what
// rounding leaves of an F of rank one counts as a direction (errors of 3e-14), with 1e-15 columns lose theirs (9e-15);
// here 3e-15.
constexpr double kNothing = 3e-16;
// Columns this much shorter than others get their direction with care.
constexpr double kThin = 1e-5;
// Squares of sizes below this are zero; divided by the third power of its root there is no overflow.
constexpr double kLeastSquare = 1e-200;

template <class V>
struct Vector {
    V at[3];
};
template <class V>
YASPS_FUNCTION inline Vector<V> operator*(const Vector<V>& a, V s) {
    return {{a.at[0] * s, a.at[1] * s, a.at[2] * s}};
}
template <class V>
YASPS_FUNCTION inline Vector<V> operator+(const Vector<V>& a, const Vector<V>& b) {
    return {{a.at[0] + b.at[0], a.at[1] + b.at[1], a.at[2] + b.at[2]}};
}
template <class V>
YASPS_FUNCTION inline Vector<V> operator-(const Vector<V>& a, const Vector<V>& b) {
    return {{a.at[0] - b.at[0], a.at[1] - b.at[1], a.at[2] - b.at[2]}};
}
template <class V>
YASPS_FUNCTION inline V dot(const Vector<V>& a, const Vector<V>& b) {
    return a.at[0] * b.at[0] + a.at[1] * b.at[1] + a.at[2] * b.at[2];
}
template <class V>
YASPS_FUNCTION inline Vector<V> cross(const Vector<V>& a, const Vector<V>& b) {
    return {{a.at[1] * b.at[2] - a.at[2] * b.at[1], a.at[2] * b.at[0] - a.at[0] * b.at[2],
             a.at[0] * b.at[1] - a.at[1] * b.at[0]}};
}
template <class V>
YASPS_FUNCTION inline Vector<V> choose(Mask<V> mask, const Vector<V>& a, const Vector<V>& b) {
    return {{select(mask, a.at[0], b.at[0]), select(mask, a.at[1], b.at[1]), select(mask, a.at[2], b.at[2])}};
}

// Three columns of a 3x3 matrix.
template <class V>
struct Columns {
    Vector<V> c[3];
};
template <class V>
YASPS_FUNCTION inline Columns<V> unit_columns() {
    const V zero = {}, one = constant<V>(1);
    return {{{{one, zero, zero}}, {{zero, one, zero}}, {{zero, zero, one}}}};
}

template <class V>
struct Rotation {
    V cosine, sine;
};
// The rotation that diagonalises [[p, off], [off, q]] and puts the larger eigenvalue first, for difference = p - q and
// twice = 2 off: columns (p, q) become (cosine p + sine q, cosine q - sine p).
template <class V>
YASPS_ALWAYS_INLINE Rotation<V> rotation_for(V difference, V twice) {
    const V one = constant<V>(1), squared = difference * difference + twice * twice;
    const auto nothing =
        less(squared, constant<V>(kSmallestNormal));  // too small to be known: leave the columns as they are
    // Of the doubled angle, cosine and sine are difference and twice times the reciprocal.
    const V reciprocal = inverse_root(select(nothing, one, squared));
    const V larger_squared = magnitude(difference) * reciprocal * 0.5 + constant<V>(0.5);
    const V inverse_larger = inverse_root(larger_squared), half = twice * reciprocal * 0.5;
    const V larger = larger_squared * inverse_larger, smaller = half * inverse_larger;
    const auto swapped = less(difference, V{});
    return {select(nothing, one, select(swapped, magnitude(smaller), larger)),
            select(nothing, V{}, select(swapped, with_sign(larger, half), smaller))};
}
template <class V>
YASPS_ALWAYS_INLINE void turn(Vector<V>& p, Vector<V>& q, Rotation<V> r) {
    const Vector<V> old = p;
    p = p * r.cosine + q * r.sine;
    q = q * r.cosine - old * r.sine;
}
// Of columns of which the first belongs to the value far from the others and the second to the larger of those: all in
// descending order. far_smallest: where the value of the first is the smallest.
template <class V>
YASPS_FUNCTION inline Columns<V> in_order(Mask<V> far_smallest, const Columns<V>& a) {
    return {choose<V>(far_smallest, a.c[1], a.c[0]), choose<V>(far_smallest, a.c[2], a.c[1]),
            choose<V>(far_smallest, a.c[0], a.c[2])};
}

// A symmetric 3x3 matrix: its diagonal, and the entries opposite to it.
template <class V>
struct Symmetric {
    V diagonal[3], opposite[3];  // opposite[k] stands at the two other indices
};
template <class V>
YASPS_FUNCTION inline Vector<V> times(const Symmetric<V>& m, const Vector<V>& a) {
    return {{m.diagonal[0] * a.at[0] + m.opposite[2] * a.at[1] + m.opposite[1] * a.at[2],
             m.opposite[2] * a.at[0] + m.diagonal[1] * a.at[1] + m.opposite[0] * a.at[2],
             m.opposite[1] * a.at[0] + m.opposite[0] * a.at[1] + m.diagonal[2] * a.at[2]}};
}

// Of the three roots of 4 c^3 - 3 c = h, cos(acos(h) / 3), for h from 0 to 1: the one far from the others.
template <class V>
YASPS_FUNCTION inline V far_root(V h) {
    // A polynomial through six of its values is right to 7e-7; a step of Halley's method leaves the third power of
    // that.
    V c = h * 0.0019473 + constant<V>(-0.00896645);
    c = c * h + constant<V>(0.0218996);
    c = c * h + constant<V>(-0.047525);
    c = c * h + constant<V>(0.166619);
    c = c * h + constant<V>(0.866026);
    const V squared = c * c;
    const V value = c * (squared * 4.0 - constant<V>(3)) - h, slope = squared * 12.0 - constant<V>(3);
    return c - value * slope * inverse(slope * slope - value * c * 12.0);
}

// An orthonormal basis. Its first column is the eigenvector, right to rounding errors of the size of m, of the
// eigenvalue that is far from the others, from a column of the adjugate. far_smallest: where that eigenvalue is the
// smallest, elsewhere it is the largest.
template <class V>
YASPS_FUNCTION Columns<V> basis_for(const Symmetric<V>& m, Mask<V>* far_smallest) {
    const V one = constant<V>(1), mean = (m.diagonal[0] + m.diagonal[1] + m.diagonal[2]) * (1.0 / 3.0);
    const V a = m.diagonal[0] - mean, b = m.diagonal[1] - mean, c = m.diagonal[2] - mean;
    const V p = m.opposite[0], q = m.opposite[1], r = m.opposite[2];
    const V squared = (a * a + b * b + c * c + (p * p + q * q + r * r) * 2.0) * (1.0 / 6.0);
    const V reciprocal = inverse_root(maximum(squared, constant<V>(kLeastSquare)));
    const V determinant = a * (b * c - p * p) - r * (r * c - p * q) + q * (r * p - b * q);
    const V half = determinant * reciprocal * (reciprocal * reciprocal) * 0.5;
    const V absolute = magnitude(half);
    const V root = far_root(select(less(absolute, one), absolute, one));
    const V far = with_sign(squared * reciprocal * root * 2.0, half);
    *far_smallest = less(far, V{});
    const V a1 = a - far, b1 = b - far, c1 = c - far;
    const Vector<V> first = {{b1 * c1 - p * p, p * q - r * c1, p * r - q * b1}};
    const Vector<V> second = {{first.at[1], a1 * c1 - q * q, q * r - p * a1}};
    const Vector<V> third = {{first.at[2], second.at[2], a1 * b1 - r * r}};
    const V x = magnitude(first.at[0]), y = magnitude(second.at[1]), z = magnitude(third.at[2]);
    const Vector<V> later = choose<V>(less(y, z), third, second);
    const Vector<V> column = choose<V>(less(x, maximum(y, z)), later, first);
    const V length = dot(column, column);
    const auto none = less(length, constant<V>(kLeastSquare));  // m is a multiple of the identity
    const Vector<V> u = choose<V>(none, unit_columns<V>().c[2], column * inverse_root(select(none, one, length)));
    // Two vectors orthogonal to u and to each other (Duff et al. 2017, "Building an orthonormal basis, revisited").
    const V sign = with_sign(one, u.at[2]);
    const V shared = V{} - inverse(sign + u.at[2]), product = u.at[0] * u.at[1] * shared;
    return {{u,
             {{one + sign * u.at[0] * u.at[0] * shared, sign * product, V{} - sign * u.at[0]}},
             {{product, sign + u.at[1] * u.at[1] * shared, V{} - u.at[1]}}}};
}

// Jacobi rotations of m and e, until nothing is left to rotate. Returns the bits of lanes that did not get there, which
// with finite numbers are none.
template <class V>
YASPS_SELDOM unsigned finish_diagonal(Symmetric<V>& m, Columns<V>& e, V negligible) {
    for (int sweep = 0;; ++sweep) {
        unsigned busy = 0;
        YASPS_UNROLLED_FOR_A_THREAD
        for (int p = 0; p < 2; ++p) {
            YASPS_UNROLLED_FOR_A_THREAD
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

// Turns m into its eigenvalues, the largest first; the columns of e become its eigenvectors. With two columns the third
// row and column of m are zero and stay last. Returns the bits of lanes that failed.
template <int cols, class V>
YASPS_FUNCTION unsigned diagonalise(Symmetric<V>& m, Columns<V>& e) {
    if (cols == 2) {
        e = unit_columns<V>();
        const V difference = m.diagonal[0] - m.diagonal[1], twice = m.opposite[2] * 2.0;
        const Rotation<V> r = rotation_for(difference, twice);
        const V shift = r.sine * (r.cosine * twice - r.sine * difference);
        m.diagonal[0] = m.diagonal[0] + shift;
        m.diagonal[1] = m.diagonal[1] - shift;
        turn(e.c[0], e.c[1], r);
        return 0;
    }
    Mask<V> far_smallest;
    e = basis_for(m, &far_smallest);
    const V size = magnitude(m.diagonal[0]) + magnitude(m.diagonal[1]) + magnitude(m.diagonal[2]) +
                   magnitude(m.opposite[0]) + magnitude(m.opposite[1]) + magnitude(m.opposite[2]);
    const V negligible = size * (4 * kEpsilon);
    // What m is in this basis; then with the second and third column turned.
    const Vector<V> image = times(m, e.c[1]), other = times(m, e.c[2]);
    const V p = dot(e.c[1], image), q = dot(e.c[2], other), twice = dot(e.c[1], other) * 2.0;
    const V far = m.diagonal[0] + m.diagonal[1] + m.diagonal[2] - p - q;
    const Rotation<V> r = rotation_for(p - q, twice);
    const V shift = r.sine * (r.cosine * twice - r.sine * (p - q));
    const V before = dot(e.c[0], image), after = dot(e.c[0], other);
    turn(e.c[1], e.c[2], r);
    e = in_order(far_smallest, e);
    m.diagonal[0] = select(far_smallest, p + shift, far);
    m.diagonal[1] = select(far_smallest, q - shift, p + shift);
    m.diagonal[2] = select(far_smallest, far, q - shift);
    const V at_second = r.cosine * before + r.sine * after, at_third = r.cosine * after - r.sine * before;
    if (!any(less(negligible, maximum(magnitude(at_second), magnitude(at_third))))) return 0;
    m.opposite[0] = select(far_smallest, at_third, V{});
    m.opposite[1] = select(far_smallest, at_second, at_third);
    m.opposite[2] = select(far_smallest, V{}, at_second);
    return finish_diagonal(m, e, negligible);
}

// Turns the columns of `a` by rotations until they are orthogonal, and those of `v` along (one-sided Jacobi). Returns
// the bits of lanes that did not get there, which with finite numbers are none.
template <class V>
YASPS_SELDOM unsigned finish_orthogonal(Columns<V>& a, Columns<V>& v, V most) {
    for (int sweep = 0;; ++sweep) {
        unsigned busy = 0;
        YASPS_UNROLLED_FOR_A_THREAD
        for (int p = 0; p < 2; ++p) {
            YASPS_UNROLLED_FOR_A_THREAD
            for (int q = p + 1; q < 3; ++q) {
                const V pp = dot(a.c[p], a.c[p]), qq = dot(a.c[q], a.c[q]), pq = dot(a.c[p], a.c[q]);
                const unsigned turned = bits_of(less(pp * most, pq * pq));
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

// A unit vector orthogonal to the unit vector u.
template <class V>
YASPS_FUNCTION inline Vector<V> any_orthogonal(const Vector<V>& u) {
    const V x = magnitude(u.at[0]), y = magnitude(u.at[1]), z = magnitude(u.at[2]);
    const Columns<V> axes = unit_columns<V>();
    const Vector<V> later = choose<V>(less(z, y), axes.c[2], axes.c[1]);
    const Vector<V> axis = choose<V>(less(select(less(z, y), z, y), x), later, axes.c[0]);
    const Vector<V> w = axis - u * dot(axis, u);
    return w * inverse_root(dot(w, w));
}

// Where a has a second column of next to no length, or no first one either: the first two columns of u.
template <class V>
YASPS_SELDOM void replace_thin(const Columns<V>& a, Mask<V> thin, Columns<V>& u) {
    const V nothing = constant<V>(kNothing * kNothing), one = constant<V>(1);
    const V first = dot(a.c[0], a.c[0]);
    const auto zero = less(first, nothing);
    const Vector<V> direction =
        choose<V>(zero, unit_columns<V>().c[0], a.c[0] * inverse_root(select(zero, one, first)));
    const Vector<V> rest = a.c[1] - direction * dot(a.c[1], direction);
    const V second = dot(rest, rest);
    const auto none = less(second, nothing);
    const Vector<V> other = choose<V>(none, any_orthogonal(direction), rest * inverse_root(select(none, one, second)));
    u.c[0] = choose<V>(thin, direction, u.c[0]);
    u.c[1] = choose<V>(thin, other, u.c[1]);
}

// Rotations u and v with u^T f v diagonal, for columns of f no longer than about one; the last of the descending
// singular values takes the sign of det f. Without a third column, which is zero, v's third column is (0, 0, 1).
// Returns the bits of lanes that have none.
template <int cols, class V>
YASPS_FUNCTION unsigned singular_frames(const Columns<V>& f, Columns<V>& u, Columns<V>& v) {
    Columns<V> a;  // f v
    constexpr int kTurned = cols - 2;
    Mask<V> far_smallest;
    v = unit_columns<V>();
    if (cols == 3) {
        v = basis_for<V>({{dot(f.c[0], f.c[0]), dot(f.c[1], f.c[1]), dot(f.c[2], f.c[2])},
                          {dot(f.c[1], f.c[2]), dot(f.c[0], f.c[2]), dot(f.c[0], f.c[1])}},
                         &far_smallest);
        YASPS_UNROLLED
        for (int k = 0; k < 3; ++k) a.c[k] = f.c[0] * v.c[k].at[0] + f.c[1] * v.c[k].at[1] + f.c[2] * v.c[k].at[2];
    } else {
        a.c[0] = f.c[0], a.c[1] = f.c[1];
    }
    Vector<V>&p = a.c[kTurned], &q = a.c[kTurned + 1];
    const Rotation<V> r = rotation_for(dot(p, p) - dot(q, q), dot(p, q) * 2.0);
    turn(p, q, r);
    turn(v.c[kTurned], v.c[kTurned + 1], r);
    unsigned failed = 0;
    if (cols == 3) {
        a = in_order(far_smallest, a);
        v = in_order(far_smallest, v);
        const V total = dot(a.c[0], a.c[0]) + dot(a.c[1], a.c[1]) + dot(a.c[2], a.c[2]);
        const V most = total * (kOblique * kOblique);
        const V x = dot(a.c[0], a.c[1]), y = dot(a.c[0], a.c[2]), z = dot(a.c[1], a.c[2]);
        const V first = dot(a.c[0], a.c[0]) * most, second = dot(a.c[1], a.c[1]) * most;
        if (any(less(first, maximum(x * x, y * y)) | less(second, z * z))) failed = finish_orthogonal(a, v, most);
    }
    // What the first two columns of u miss to be orthogonal is taken off after they got their length, to save time.
    const V first = dot(a.c[0], a.c[0]), second = dot(a.c[1], a.c[1]);
    const V inverse_first = inverse_root(first), inverse_second = inverse_root(second);
    u.c[0] = a.c[0] * inverse_first;
    u.c[1] = a.c[1] * inverse_second - u.c[0] * (dot(a.c[0], a.c[1]) * inverse_first * inverse_second);
    const auto thin = less(second, maximum(first * (kThin * kThin), constant<V>(kSmallestNormal)));
    if (any(thin)) replace_thin(a, thin, u);
    u.c[2] = cross(u.c[0], u.c[1]);
    return failed;
}

}  // namespace
}  // namespace yasps
