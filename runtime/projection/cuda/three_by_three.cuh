// Symmetric 3x3 matrices and their eigenvectors: one matrix a thread, all in registers.
//
// The same method as runtime/projection/singular_values.h, where it is derived. Nothing here is indexed by a variable,
// so that the compiler needs no local memory.
#pragma once

#ifdef __CUDACC__
#define YASPS_ROLLED _Pragma("unroll 1")
#define YASPS_UNROLLED _Pragma("unroll")
#else
#define YASPS_ROLLED
#define YASPS_UNROLLED
#endif

namespace yasps {

constexpr double kEpsilon = 2.220446049250313e-16;
constexpr double kSmallestNormal = 2.2250738585072014e-308;
constexpr double kLargest = 1.7976931348623157e308;
// Sweeps of Jacobi rotations before giving up; one or none is usual, four or five without a good start.
constexpr int kMostSweeps = 30;

struct Vector {
    double x, y, z;
};
__device__ inline Vector operator*(const Vector& a, double s) { return {a.x * s, a.y * s, a.z * s}; }
__device__ inline Vector operator+(const Vector& a, const Vector& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
__device__ inline Vector operator-(const Vector& a, const Vector& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
__device__ inline double dot(const Vector& a, const Vector& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
__device__ inline Vector cross(const Vector& a, const Vector& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// Three columns of a 3x3 matrix.
struct Columns {
    Vector a, b, c;
};
__device__ inline Columns unit_columns() { return {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}; }

struct Symmetric {
    double xx, yy, zz, yz, xz, xy;
};
__device__ inline Vector times(const Symmetric& m, const Vector& a) {
    return {m.xx * a.x + m.xy * a.y + m.xz * a.z, m.xy * a.x + m.yy * a.y + m.yz * a.z,
            m.xz * a.x + m.yz * a.y + m.zz * a.z};
}

struct Rotation {
    double cosine, sine;
};
// The rotation by at most 45 degrees that diagonalises [[p, off], [off, q]], for difference = p - q and twice = 2 off:
// columns (p, q) become (cosine p + sine q, cosine q - sine p).
__device__ inline Rotation rotation_for(double difference, double twice) {
    const double adjacent = fabs(difference) + sqrt(difference * difference + twice * twice);
    const double squared = adjacent * adjacent + twice * twice;
    if (squared < kSmallestNormal) return {1, 0};  // too small to be known: leave the columns as they are
    const double reciprocal = rsqrt(squared);
    return {adjacent * reciprocal, (difference < 0 ? -twice : twice) * reciprocal};
}
__device__ inline void turn(Vector& p, Vector& q, Rotation r) {
    const Vector old = p;
    p = p * r.cosine + q * r.sine;
    q = q * r.cosine - old * r.sine;
}

// Of the three roots of 4 c^3 - 3 c = h, cos(acos(h) / 3), for h from 0 to 1: the one far from the others.
__device__ inline double far_root(double h) {
    // A polynomial through five of its values is right to 6e-6; two steps of Newton's method make that 1e-16.
    double c = (((h * -0.0040354 + 0.0175122) * h - 0.0459219) * h + 0.166412) * h + 0.86603;
    YASPS_UNROLLED
    for (int step = 0; step < 2; ++step) c -= (c * (4 * c * c - 3) - h) / (12 * c * c - 3);
    return c;
}

// Eigenvectors of m, right to rounding errors of the size of m: the eigenvector of the eigenvalue that is far from the
// others from a column of the adjugate, the two others in the plane orthogonal to it.
__device__ inline Columns eigenvectors_of(const Symmetric& m) {
    const double mean = (m.xx + m.yy + m.zz) * (1.0 / 3.0);
    const double a = m.xx - mean, b = m.yy - mean, c = m.zz - mean, p = m.yz, q = m.xz, r = m.xy;
    const double squared = (a * a + b * b + c * c + (p * p + q * q + r * r) * 2.0) * (1.0 / 6.0);
    const double size = sqrt(squared);
    const double determinant = a * (b * c - p * p) - r * (r * c - p * q) + q * (r * p - b * q);
    const double half = 0.5 * determinant / fmax(squared * size, kSmallestNormal);
    const double far = copysign(2.0 * size * far_root(fmin(fabs(half), 1.0)), half);
    const double a1 = a - far, b1 = b - far, c1 = c - far;
    const Vector first = {b1 * c1 - p * p, p * q - r * c1, p * r - q * b1};
    const Vector second = {first.y, a1 * c1 - q * q, q * r - p * a1};
    const Vector third = {first.z, second.z, a1 * b1 - r * r};
    const double x = fabs(first.x), y = fabs(second.y), z = fabs(third.z);
    const Vector column = x < fmax(y, z) ? (y < z ? third : second) : first;
    const double length = dot(column, column);
    const bool none = length < kSmallestNormal;  // m is a multiple of the identity
    const Vector u = none ? Vector{0, 0, 1} : column * rsqrt(length);
    // Two vectors orthogonal to u and to each other (Duff et al. 2017, "Building an orthonormal basis, revisited").
    const double sign = copysign(1.0, u.z), shared = -1.0 / (sign + u.z), product = u.x * u.y * shared;
    const Vector v = {1.0 + sign * u.x * u.x * shared, sign * product, -sign * u.x};
    const Vector w = {product, sign + u.y * u.y * shared, -u.y};
    const Vector mv = times(m, v), mw = times(m, w);
    Columns e = {u, v, w};
    turn(e.b, e.c, rotation_for(dot(v, mv) - dot(w, mw), dot(v, mw) * 2.0));
    return e;
}

// Turns axes p and q so that `off` between them becomes zero, where it is not negligible. (p, k) and (q, k) lead to the
// third axis.
__device__ inline bool eliminate(double negligible, double& p, double& q, double& off, double& pk, double& qk,
                                 Vector& ep, Vector& eq) {
    if (fabs(off) <= negligible) return false;
    const double difference = p - q, twice = 2.0 * off, old = pk;
    const Rotation r = rotation_for(difference, twice);
    const double shift = r.sine * (r.cosine * twice - r.sine * difference);
    p += shift;
    q -= shift;
    off = 0.0;
    pk = r.cosine * old + r.sine * qk;
    qk = r.cosine * qk - r.sine * old;
    turn(ep, eq, r);
    return true;
}

// Turns m into its eigenvalues; the columns of e become its eigenvectors. False if that failed, which with finite
// numbers it does not.
__device__ inline bool diagonalise(Symmetric& m, Columns& e) {
    const double negligible =
        (fabs(m.xx) + fabs(m.yy) + fabs(m.zz) + fabs(m.yz) + fabs(m.xz) + fabs(m.xy)) * (4 * kEpsilon);
    e = eigenvectors_of(m);
    const Vector a = times(m, e.a), b = times(m, e.b), c = times(m, e.c);
    m = {dot(e.a, a), dot(e.b, b), dot(e.c, c), dot(e.b, c), dot(e.c, a), dot(e.a, b)};
    // Jacobi rotations, until nothing is left to rotate; there seldom is anything.
    YASPS_ROLLED
    for (int sweep = 0; sweep <= kMostSweeps; ++sweep) {
        bool busy = eliminate(negligible, m.xx, m.yy, m.xy, m.xz, m.yz, e.a, e.b);
        busy |= eliminate(negligible, m.xx, m.zz, m.xz, m.xy, m.yz, e.a, e.c);
        busy |= eliminate(negligible, m.yy, m.zz, m.yz, m.xy, m.xz, e.b, e.c);
        if (!busy) return true;
    }
    return false;
}

}  // namespace yasps
