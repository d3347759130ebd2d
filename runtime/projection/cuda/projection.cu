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
#include "projection/tridiagonal.h"

namespace yasps {
namespace {

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
    double negligible = negligible_coupling<double>(d, e, n);
    int low = 0;
    YASPS_ROLLED
    for (int sweep = 0;; ++sweep) {
        while (low + 1 < n && fabs(e[low]) <= negligible) ++low;
        if (low + 1 >= n) return true;
        if (sweep == kMaxSweeps * n) return false;
        if (sweep > kManySweeps * n && sweep % n == 0) negligible *= 2.0;
        int high = low + 1;
        while (high + 1 < n && fabs(e[high]) > negligible) ++high;

        QlSweep<double> ql(shift_for(d[low], d[low + 1], e[low]), d, high);
        YASPS_ROLLED
        for (int i = high - 1; i >= low; --i) {
            ql.step(d, e, i);
            const double cosine = ql.turn.cosine, sine = ql.turn.sine;
            const Work upper = z + i * n;
            const Work lower = upper + n;
            for (int r = 0; r < n; ++r) {
                const double x = upper[r], y = lower[r];
                upper[r] = cosine * x - sine * y;
                lower[r] = sine * x + cosine * y;
            }
        }
        ql.finish(d, e, low);
    }
}

// n > 1. size: sum of the absolute values of the entries, which are finite; the sum may be infinite.
template <class Matrix, class Work>
__device__ __noinline__ int remove_negative(Matrix packed, int n, bool flip, double size, Work work) {
    const Work a = work;
    const Work d = work + n * n;
    const Work e = d + n;
    const double down = power_of_two(size, -1), up = power_of_two(size, 1);
    double trace = 0.0;
    YASPS_ROLLED
    for (int i = 0, k = 0; i < n; ++i) {
        trace += fabs(packed[k] * down);
        for (int j = i; j < n; ++j) a[i * n + j] = packed[k++] * down;
    }
    tridiagonalise<double>(a, n, d, e);
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
            double sum = packed[k] * down;
            for (int j = 0; j < count; ++j) sum += d[j] * a[j * n + c];
            packed[k] = sum * up;
        }
    }
    return kChanged;
}

// A width of up to three, as a matrix of width three with zeros.
template <class Matrix>
__device__ __noinline__ int project_small(Matrix packed, int n, int mode) {
    const auto place = [n](int r, int s) { return r * n - r * (r + 1) / 2 + s; };
    double all[6];
    YASPS_UNROLLED
    for (int r = 0; r < 3; ++r) {
        YASPS_UNROLLED
        for (int s = 0; s < 3; ++s)
            if (s >= r) all[place_of<3>(r, s)] = s < n ? packed[place(r, s)] : 0.0;
    }
    Symmetric<double> turned;
    YASPS_UNROLLED
    for (int k = 0; k < 3; ++k) {
        turned.diagonal[k] = all[place_of<3>(k, k)];
        turned.opposite[k] = all[place_of<3>((k + 1) % 3, (k + 2) % 3)];
    }
    const Check check = check_in_registers<3>(all);
    const Outcome outcome = outcome_of(check, packed, n, mode);
    if (outcome != kUndecided) return outcome;
    if (n == 1) {
        if (!(packed[0] < 0.0)) return kUnchanged;
        packed[0] = mode == kAbsolute ? -packed[0] : 0.0;
        return kChanged;
    }
    const double down = power_of_two(check.sum, -1);
    YASPS_UNROLLED
    for (int k = 0; k < 3; ++k) {
        turned.diagonal[k] *= down;
        turned.opposite[k] *= down;
    }
    const double trace = fabs(turned.diagonal[0]) + fabs(turned.diagonal[1]) + fabs(turned.diagonal[2]);
    Columns<double> e;
    if (diagonalise<3>(turned, e) != 0) return kNotFinite;
    double* const values = turned.diagonal;
    if (!(fmin(values[0], fmin(values[1], values[2])) < trace * -kProjectionShift)) return kUnchanged;
    const double factor = mode == kAbsolute ? -2.0 : -1.0, up = power_of_two(check.sum, 1);
    YASPS_UNROLLED
    for (int k = 0; k < 3; ++k) values[k] = factor * fmin(values[k], 0.0);
    YASPS_UNROLLED
    for (int r = 0; r < 3; ++r) {
        YASPS_UNROLLED
        for (int s = 0; s < 3; ++s) {
            if (s < r || s >= n) continue;
            double sum = packed[place(r, s)] * down;
            YASPS_UNROLLED
            for (int k = 0; k < 3; ++k) sum += values[k] * e.c[k].at[r] * e.c[k].at[s];
            packed[place(r, s)] = sum * up;
        }
    }
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
