// Projection of a small symmetric matrix onto the positive semidefinite cone by its eigenvalues.
//
// The methods of the CPU (runtime/projection/negative_part.cpp), with one matrix a thread: Householder's reduction to
// tridiagonal form, then QL sweeps with Wilkinson's shift (Golub & Van Loan, sec. 8.3). Eigenvectors are carried along,
// in the place of the matrix: unlike a list of rotations they need no more memory than the caller gives, whatever the
// sweeps. What is indexed by a variable lies in the caller's `work`, whose loops are rolled.
//
// Work for n = 12, counted: the check takes 290 multiplications (n^3 / 6) and reads the matrix, which is also the least
// there is to do; a decomposition 4,600 to reduce the matrix and back (8 / 3 n^3), and 190 rotations (1.3 n^2) with
// 9,000 multiplications, loads and stores on eigenvectors. Compiled, never timed.
#include "projection/cuda/projection.cuh"

namespace yasps {
namespace {

// Sweeps for each eigenvalue: two are usual. After the first number couplings of growing size are taken for zero, after
// the second the search ends.
constexpr int kManySweeps = 4, kSweepsPerEigenvalue = 10;

// Checks a matrix of any width: rows of U in A = U^T D^-1 U one after another, three columns at a time so that four
// numbers are loaded for three multiplications. Ends at the first pivot that is not positive.
template <class Matrix, class Work>
__device__ inline bool passes(Matrix packed, int n, double shift, Work work) {
    const Work u = work;
    const Work inverse = work + n * (n + 1) / 2;
    const Work factor = inverse + n;
    YASPS_ROLLED
    for (int i = 0; i < n; ++i) {
        const int row = i * n - i * (i + 1) / 2;
        for (int k = 0, at = i; k < i; ++k, at += n - k) factor[k] = u[at] * inverse[k];
        YASPS_ROLLED
        for (int j = i; j < n; j += 3) {
            // Behind the last column that one is done again.
            const int j1 = j + 1 < n ? j + 1 : n - 1, j2 = j + 2 < n ? j + 2 : n - 1;
            const auto entry = [&](int column) { return packed[row + column] + (column == i ? shift : 0.0); };
            double a = entry(j), b = entry(j1), c = entry(j2);
            for (int k = 0, at = 0; k < i; ++k, at += n - k) {
                a -= factor[k] * u[at + j];
                b -= factor[k] * u[at + j1];
                c -= factor[k] * u[at + j2];
            }
            u[row + j] = a;
            u[row + j1] = b;
            u[row + j2] = c;
        }
        const double pivot = u[row + i];
        if (!(pivot > 0.0)) return false;
        inverse[i] = 1.0 / pivot;
    }
    return true;
}

template <class Matrix, class Work>
__device__ Check check_any(Matrix packed, int n, Work work) {
    double sum = 0.0, trace = 0.0;
    YASPS_ROLLED
    for (int i = 0, k = 0; i < n; ++i) {
        trace += fabs(packed[k++]);
        for (int j = i + 1; j < n; ++j) sum += fabs(packed[k++]);
    }
    return {sum + trace, passes(packed, n, trace * kProjectionShift + kSmallestNormal, work)};
}

// Reduces the symmetric matrix a (n x n, upper triangle) to tridiagonal form: diagonal d, off-diagonal e[0 .. n-2].
// Reflection k is I - s v v^T with v in row k of a, right of the diagonal, and s below the diagonal, at (k + 1, k).
// What is not yet needed of e is scratch.
template <class Work>
__device__ inline void tridiagonalise(Work a, int n, Work d, Work e) {
    YASPS_ROLLED
    for (int k = 0; k + 2 < n; ++k) {
        const int m = n - k - 1;  // what is left to reduce: b, below and right of entry (k, k)
        const Work v = a + (k * n + k + 1);
        const Work b = v + n;
        const Work p = e + (k + 1);
        d[k] = v[-1];
        double squared = 0.0;
        for (int i = 0; i < m; ++i) squared += v[i] * v[i];
        const double first = v[0];
        b[-1] = 0.0;
        // Columns this small are far below rounding of a matrix of size one.
        if (squared < 1e-40) {
            e[k] = first;
            continue;
        }
        const double reflected = -copysign(sqrt(squared), first), scale = 1.0 / (squared - first * reflected);
        e[k] = reflected;
        b[-1] = scale;
        v[0] = first - reflected;
        for (int i = 0; i < m; ++i) p[i] = 0.0;
        double half = 0.0;
        YASPS_ROLLED
        for (int i = 0; i < m; ++i) {
            const Work row = b + i * n;
            const double factor = v[i];
            double sum = p[i] + row[i] * factor;
            for (int j = i + 1; j < m; ++j) {
                sum += row[j] * v[j];
                p[j] += row[j] * factor;
            }
            p[i] = sum;
            half += sum * factor;
        }
        half *= 0.5 * scale * scale;
        for (int i = 0; i < m; ++i) p[i] = half * v[i] - scale * p[i];
        YASPS_ROLLED
        for (int i = 0; i < m; ++i) {
            const Work row = b + i * n;
            const double vi = v[i], pi = p[i];
            for (int j = i; j < m; ++j) row[j] += vi * p[j] + pi * v[j];
        }
    }
    const Work corner = a + ((n - 2) * n + n - 2);
    d[n - 2] = corner[0];
    e[n - 2] = corner[1];
    d[n - 1] = corner[n + 1];
}

// Puts the product of all reflections in their place, its columns as rows of a.
template <class Work>
__device__ inline void multiply_reflections(Work a, int n) {
    const Work corner = a + ((n - 2) * n + n - 2);
    corner[0] = corner[n + 1] = 1.0;
    corner[1] = corner[n] = 0.0;
    // So far the product of those after k is known, in the rows and columns after k + 1.
    YASPS_ROLLED
    for (int k = n - 3; k >= 0; --k) {
        const Work v = a + (k * n + k + 1);
        const Work next = a + ((k + 1) * n + k + 1);  // row k + 1
        const int m = n - k - 1;
        const double scale = next[-1];
        YASPS_ROLLED
        for (int c = 1; c < m; ++c) {
            const Work x = next + c * n;
            double sum = 0.0;
            for (int i = 1; i < m; ++i) sum += v[i] * x[i];
            sum *= -scale;
            x[0] = sum * v[0];
            for (int i = 1; i < m; ++i) x[i] += sum * v[i];
        }
        const double factor = scale * v[0];
        next[0] = 1.0 - factor * v[0];
        for (int i = 1; i < m; ++i) next[i] = -factor * v[i];
        a[k * n + k] = 1.0;
        for (int i = 1; i <= m; ++i) a[k * n + k + i] = a[(k + i) * n + k] = 0.0;
    }
}

// Diagonalises the tridiagonal matrix: d becomes the eigenvalues, in no order. The rows of z are turned along. e has
// room for n. False if eigenvalues were not found.
template <class Work>
__device__ inline bool diagonalise(Work d, Work e, int n, Work z) {
    double norm = 0.0;
    for (int i = 0; i < n; ++i) norm = fmax(norm, fabs(d[i]) + (i + 1 < n ? fabs(e[i]) : 0.0));
    // Of a multiple eigenvalue less than kEpsilon may remain for ever: it is rounding of the shifted diagonal.
    double negligible = norm * (2 * kEpsilon);
    int low = 0;
    YASPS_ROLLED
    for (int sweep = 0;; ++sweep) {
        while (low + 1 < n && fabs(e[low]) <= negligible) ++low;
        if (low + 1 >= n) return true;
        if (sweep == kSweepsPerEigenvalue * n) return false;
        if (sweep > kManySweeps * n && sweep % n == 0) negligible *= 2.0;
        int high = low + 1;
        while (high + 1 < n && fabs(e[high]) > negligible) ++high;

        // Wilkinson's shift: the eigenvalue of the first 2 x 2 block next to its first entry.
        const double diagonal = d[low], next = d[low + 1], difference = next - diagonal;
        const double root = sqrt(4.0 * e[low] * e[low] + difference * difference);
        const double shift = 0.5 * (diagonal + next - copysign(root, difference));
        double p = d[high] - shift, cosine = 1.0, sine = 0.0;
        YASPS_ROLLED
        for (int i = high - 1; i >= low; --i) {
            const double entry = d[i] - shift, coupling = e[i];
            const double squared = coupling * coupling + p * p;
            // Where both are nothing there is no angle, and none is needed.
            const bool zero = squared < 1e-280;
            const double over_length = zero ? 0.0 : rsqrt(squared);
            const double g = cosine * coupling, h = cosine * p;
            e[i + 1] = sine * squared * over_length;
            sine = coupling * over_length;
            cosine = zero ? 1.0 : p * over_length;
            d[i + 1] = h + sine * (cosine * g + sine * entry) + shift;
            p = zero ? entry : (p * entry - coupling * g) * over_length;
            const Work upper = z + i * n;
            const Work lower = upper + n;
            for (int r = 0; r < n; ++r) {
                const double x = upper[r], y = lower[r];
                upper[r] = cosine * x - sine * y;
                lower[r] = sine * x + cosine * y;
            }
        }
        e[low] = sine * p;
        d[low] = cosine * p + shift;
    }
}

// n > 1. size: sum of the absolute values of the entries, which are finite; the sum may be infinite.
template <class Matrix, class Work>
__device__ __noinline__ int remove_negative(Matrix packed, int n, bool flip, double size, Work work) {
    const Work a = work;
    const Work d = work + n * n;
    const Work e = d + n;
    const Scales scale = scales_of(size);
    double trace = 0.0;
    YASPS_ROLLED
    for (int i = 0, k = 0; i < n; ++i) {
        trace += fabs(packed[k] * scale.down);
        for (int j = i; j < n; ++j) a[i * n + j] = packed[k++] * scale.down;
    }
    tridiagonalise(a, n, d, e);
    multiply_reflections(a, n);
    if (!diagonalise(d, e, n, a)) return kNotFinite;

    double smallest = 0.0;
    for (int i = 0; i < n; ++i) smallest = fmin(smallest, d[i]);
    if (!(smallest < trace * -kProjectionShift)) return kUnchanged;
    // Eigenvectors of negative eigenvalues come first, weighted by e; smaller ones are rounding.
    const double rounding = trace * (-4 * kEpsilon);
    int count = 0;
    YASPS_ROLLED
    for (int i = 0; i < n; ++i) {
        if (!(d[i] < rounding)) continue;
        e[count] = d[i] * (flip ? -2.0 : -1.0);
        for (int r = 0; r < n; ++r) a[count * n + r] = a[i * n + r];
        ++count;
    }
    YASPS_ROLLED
    for (int r = 0, k = 0; r < n; ++r) {
        for (int j = 0; j < count; ++j) d[j] = e[j] * a[j * n + r];
        YASPS_ROLLED
        for (int c = r; c < n; ++c, ++k) {
            double sum = packed[k] * scale.down;
            for (int j = 0; j < count; ++j) sum += d[j] * a[j * n + c];
            packed[k] = sum * scale.up;
        }
    }
    return kChanged;
}

// A width of up to three, as a matrix of width three with zeros.
template <class Matrix>
__device__ __noinline__ int project_small(Matrix packed, int n, int mode) {
    double all[6] = {packed[0], 0.0, 0.0, 0.0, 0.0, 0.0};
    if (n > 1) {
        all[1] = packed[1];
        all[3] = packed[n];
    }
    if (n > 2) {
        all[2] = packed[2];
        all[4] = packed[4];
        all[5] = packed[5];
    }
    const Symmetric given = {all[0], all[3], all[5], all[4], all[2], all[1]};
    const Check check = check_in_registers<3>(all);
    const Outcome outcome = outcome_of(check, packed, n, mode);
    if (outcome != kUndecided) return outcome;
    if (n == 1) {
        if (!(packed[0] < 0.0)) return kUnchanged;
        packed[0] = mode == kAbsolute ? -packed[0] : 0.0;
        return kChanged;
    }
    const Scales scale = scales_of(check.sum);
    const Symmetric scaled = {given.xx * scale.down, given.yy * scale.down, given.zz * scale.down,
                              given.yz * scale.down, given.xz * scale.down, given.xy * scale.down};
    const double trace = fabs(scaled.xx) + fabs(scaled.yy) + fabs(scaled.zz);
    Symmetric turned = scaled;
    Columns e;
    if (!diagonalise(turned, e)) return kNotFinite;
    if (!(fmin(turned.xx, fmin(turned.yy, turned.zz)) < trace * -kProjectionShift)) return kUnchanged;
    const double factor = mode == kAbsolute ? -2.0 : -1.0;
    const Vector a = e.a * (factor * fmin(turned.xx, 0.0)), b = e.b * (factor * fmin(turned.yy, 0.0)),
                 c = e.c * (factor * fmin(turned.zz, 0.0));
    packed[0] = (scaled.xx + a.x * e.a.x + b.x * e.b.x + c.x * e.c.x) * scale.up;
    packed[1] = (scaled.xy + a.x * e.a.y + b.x * e.b.y + c.x * e.c.y) * scale.up;
    packed[n] = (scaled.yy + a.y * e.a.y + b.y * e.b.y + c.y * e.c.y) * scale.up;
    if (n == 2) return kChanged;
    packed[2] = (scaled.xz + a.x * e.a.z + b.x * e.b.z + c.x * e.c.z) * scale.up;
    packed[4] = (scaled.yz + a.y * e.a.z + b.y * e.b.z + c.y * e.c.z) * scale.up;
    packed[5] = (scaled.zz + a.z * e.a.z + b.z * e.b.z + c.z * e.c.z) * scale.up;
    return kChanged;
}

template <class Matrix, class Work>
__device__ __forceinline__ int project(Matrix packed, int n, int mode, Work work) {
    if (n <= 0) return kUnchanged;
    if (n <= 3) return project_small(packed, n, mode);
    const Check check = n == 6 ? check_of<6>(packed) : check_any(packed, n, work);
    const Outcome outcome = outcome_of(check, packed, n, mode);
    return outcome == kUndecided ? remove_negative(packed, n, mode == kAbsolute, check.sum, work) : outcome;
}

}  // namespace
}  // namespace yasps

extern "C" __device__ int yasps_project(double* packed, int n, int mode, double* work) {
    return yasps::project(packed, n, mode, work);
}

extern "C" __device__ int yasps_project_apart(double* packed, long packed_step, int n, int mode, double* work,
                                              long work_step) {
    using yasps::Apart;
    return yasps::project(Apart{packed, packed_step}, n, mode, Apart{work, work_step});
}
