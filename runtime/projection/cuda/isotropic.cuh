// Singular value decomposition of a 3x3 or 3x2 matrix, one a thread, all in registers. The method is that of
// runtime/projection/singular_values.h.
#pragma once

#include "projection/cuda/three_by_three.cuh"

namespace yasps {

// Columns are orthogonal if the cosine of their angle is below this.
constexpr double kCosine = 4e-15;
// Columns this short count as zero beside an F of size one.
constexpr double kNothing = 1e-17;
// Two of the columns of F V give two of U. They need not be the longest ones, but longer than this if two are.
constexpr double kShort = 1e-3;

// Turns columns p and q of F V until they are orthogonal, and those of V along.
__device__ inline bool make_orthogonal(Vector& p, Vector& q, Vector& vp, Vector& vq) {
    const double pp = dot(p, p), qq = dot(q, q), pq = dot(p, q);
    if (pq * pq <= (pp * qq + kNothing * kNothing) * (kCosine * kCosine)) return false;
    const Rotation r = rotation_for(pp - qq, pq * 2.0);
    turn(p, q, r);
    turn(vp, vq, r);
    return true;
}

// Puts the longer of two columns first; one changes its sign, so that this is a rotation too.
__device__ inline void sort(Vector& p, Vector& q, Vector& vp, Vector& vq) {
    if (dot(p, p) >= dot(q, q)) return;
    turn(p, q, {0, 1});
    turn(vp, vq, {0, 1});
}

// A unit vector orthogonal to the unit vector u.
__device__ inline Vector any_orthogonal(const Vector& u) {
    const double x = fabs(u.x), y = fabs(u.y), z = fabs(u.z);
    const Vector axis = fmin(y, z) < x ? (z < y ? Vector{0, 0, 1} : Vector{0, 1, 0}) : Vector{1, 0, 0};
    const Vector w = axis - u * dot(axis, u);
    return w * rsqrt(dot(w, w));
}

// Rotations u and v with u^T f v diagonal, for columns f no longer than about one. Without a third column, which is
// zero, v's third column is (0, 0, 1). False if there are none, which with finite numbers does not happen.
template <int cols>
__device__ inline bool singular_frames(Columns f, Columns& u, Columns& v) {
    v = unit_columns();
    if (cols == 3) {
        v = eigenvectors_of({dot(f.a, f.a), dot(f.b, f.b), dot(f.c, f.c), dot(f.b, f.c), dot(f.a, f.c), dot(f.a, f.b)});
        f = {f.a * v.a.x + f.b * v.a.y + f.c * v.a.z, f.a * v.b.x + f.b * v.b.y + f.c * v.b.z,
             f.a * v.c.x + f.b * v.c.y + f.c * v.c.z};
    }
    bool busy = true;
    YASPS_ROLLED
    for (int sweep = 0; busy && sweep <= kMostSweeps; ++sweep) {
        busy = make_orthogonal(f.a, f.b, v.a, v.b);
        if (cols == 3) {
            busy |= make_orthogonal(f.a, f.c, v.a, v.c);
            busy |= make_orthogonal(f.b, f.c, v.b, v.c);
        }
    }
    if (fmin(dot(f.a, f.a), dot(f.b, f.b)) < kShort * kShort) {
        sort(f.a, f.b, v.a, v.b);
        if (cols == 3) {
            sort(f.a, f.c, v.a, v.c);
            sort(f.b, f.c, v.b, v.c);
        }
    }
    const double first = dot(f.a, f.a);
    u.a = first < kNothing * kNothing ? Vector{1, 0, 0} : f.a * rsqrt(first);
    const Vector rest = f.b - u.a * dot(f.b, u.a);
    const double second = dot(rest, rest);
    u.b = second < kNothing * kNothing ? any_orthogonal(u.a) : rest * rsqrt(second);
    u.c = cross(u.a, u.b);  // so the third singular value takes the sign of det f
    return !busy;
}

}  // namespace yasps
