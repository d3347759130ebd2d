// How the inverse of a diagonal block is found, and why a solve ends: for the CPU and for a thread of a GPU.
//
// Whoever includes this has defined YASPS_ALWAYS_INLINE and YASPS_UNROLLED.
#pragma once

namespace yasps {

// Why a solve ended; StopReason in runtime/solvers/pcg.py. Only sweeps have too few digits, and others take over.
enum Reason : long { kConverged = 0, kMaxIterations = 1, kNotPositiveDefinite = 2, kNotFinite = 3, kTooFewDigits = 4 };

// a (q x q, row-major, lower triangle used) becomes the inverse of its Cholesky factor. Returns kConverged, or why not.
// Size: int, or what is a constant of that type.
template <class Size>
YASPS_ALWAYS_INLINE Reason invert_factor_of(double* a, Size q) {
    YASPS_UNROLLED
    for (int j = 0; j < q; ++j) {
        const double before = a[j * q + j];
        double pivot = before;
        YASPS_UNROLLED
        for (int k = 0; k < j; ++k) pivot -= a[j * q + k] * a[j * q + k];
        if (!(fabs(pivot) <= 1.7976931348623157e308)) return kNotFinite;
        // A pivot that is nothing but rounding error means that the block is singular.
        if (pivot <= 4e-16 * q * before || pivot <= 0) return kNotPositiveDefinite;
        const double reciprocal = 1 / sqrt(pivot);
        a[j * q + j] = reciprocal;
        YASPS_UNROLLED
        for (int i = j + 1; i < q; ++i) {
            double sum = a[i * q + j];
            YASPS_UNROLLED
            for (int k = 0; k < j; ++k) sum -= a[i * q + k] * a[j * q + k];
            a[i * q + j] = sum * reciprocal;
        }
    }
    YASPS_UNROLLED
    for (int j = 0; j < q; ++j) {
        YASPS_UNROLLED
        for (int i = j + 1; i < q; ++i) {
            double sum = 0;
            YASPS_UNROLLED
            for (int k = j; k < i; ++k) sum += a[i * q + k] * a[k * q + j];
            a[i * q + j] = -sum * a[i * q + i];
        }
    }
    return kConverged;
}

// Entry (i, j) of W^T W for W = L^-1, the inverse of the block: symmetric and positive definite also after rounding. It
// needs no row of W above i, and of row i only what comes from j on.
template <class Size>
YASPS_ALWAYS_INLINE double entry_of_inverse(const double* w, Size q, int i, int j) {
    double sum = 0;
    YASPS_UNROLLED
    for (int k = i; k < q; ++k) sum += w[k * q + i] * w[k * q + j];
    return sum;
}

}  // namespace yasps
