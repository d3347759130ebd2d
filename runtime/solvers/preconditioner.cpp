// Block-Jacobi preconditioner: the explicit inverses of the diagonal blocks of H (paper, appendix D).
#include "core/runtime.h"

namespace yasps {
namespace {

// Everything below is inlined into one function for each common size, in which loops over q are unrolled.
#define YASPS_INLINE inline __attribute__((always_inline))

// a (q x q, row-major, lower triangle used) becomes its Cholesky factor L, but with the reciprocals of L's diagonal.
YASPS_INLINE InversionStatus factorise(double* a, int q) {
#pragma GCC unroll 3
    for (int j = 0; j < q; ++j) {
        const double before = a[j * q + j];
        double pivot = before;
#pragma GCC unroll 3
        for (int k = 0; k < j; ++k) pivot -= a[j * q + k] * a[j * q + k];
        if (!(fabs(pivot) < INFINITY)) return kNonFinite;
        // A pivot that is nothing but rounding error means that the block is singular.
        if (pivot <= 4e-16 * q * before || pivot <= 0) return kIndefinite;
        const double reciprocal = 1 / sqrt(pivot);
        a[j * q + j] = reciprocal;
#pragma GCC unroll 3
        for (int i = j + 1; i < q; ++i) {
            double sum = a[i * q + j];
#pragma GCC unroll 3
            for (int k = 0; k < j; ++k) sum -= a[i * q + k] * a[j * q + k];
            a[i * q + j] = sum * reciprocal;
        }
    }
    return kInverted;
}

// Inverts the lower triangular matrix in place; its diagonal already is.
YASPS_INLINE void invert_factor(double* l, int q) {
#pragma GCC unroll 3
    for (int j = 0; j < q; ++j) {
#pragma GCC unroll 3
        for (int i = j + 1; i < q; ++i) {
            double sum = 0;
#pragma GCC unroll 3
            for (int k = j; k < i; ++k) sum += l[i * q + k] * l[k * q + j];
            l[i * q + j] = -sum * l[i * q + i];
        }
    }
}

// Inverts the q x q sum of what the parts have of a diagonal block; `scratch` holds q^2 doubles. The inverse is formed
// as W^T W with W = L^-1, which is symmetric and positive definite also after rounding. Its rows are padded to whole
// vectors.
YASPS_INLINE InversionStatus invert_block(int q, int parts, const Structure* const* structures,
                                          const double* const* values, long block, double* out, double* scratch) {
#pragma GCC unroll 9
    for (int k = 0; k < q * q; ++k) scratch[k] = 0;
    for (int p = 0; p < parts; ++p) {
        const long offset = structures[p]->diagonal[block];
        if (offset < 0) continue;
        const double* const part = values[p] + offset;
#pragma GCC unroll 9
        for (int k = 0; k < q * q; ++k) scratch[k] += part[k];
    }
    bool finite = true;
#pragma GCC unroll 9
    for (int k = 0; k < q * q; ++k) finite &= fabs(scratch[k]) < INFINITY;
    if (!finite) return kNonFinite;
    const InversionStatus status = factorise(scratch, q);
    if (status != kInverted) return status;
    invert_factor(scratch, q);
    const int stride = padded_size(q);
#pragma GCC unroll 3
    for (int i = 0; i < q; ++i) {
#pragma GCC unroll 3
        for (int j = 0; j <= i; ++j) {
            double sum = 0;
#pragma GCC unroll 3
            for (int k = i; k < q; ++k) sum += scratch[k * q + i] * scratch[k * q + j];
            out[i * stride + j] = sum;
            out[j * stride + i] = sum;
        }
        for (int j = q; j < stride; ++j) out[i * stride + j] = 0;
    }
    return kInverted;
}

}  // namespace

InversionStatus invert_diagonal(int parts, const Structure* const* structures, const double* const* values, Range range,
                                double* inverse, double* scratch, long* bad_block) {
    const Layout& layout = structures[0]->layout;
    for (long block = range.begin; block < range.end; ++block) {
        constexpr long kAhead = 12;  // diagonal blocks lie too far apart for the processor to guess the next
        if (block + kAhead < range.end)
            for (int p = 0; p < parts; ++p) {
                const long offset = structures[p]->diagonal[block + kAhead];
                if (offset >= 0) __builtin_prefetch(values[p] + offset);
            }
        const int q = layout.size[block];
        double* const out = inverse + layout.inverse_start[block];
        InversionStatus status;
        if (q == 3) {
            double small[9];  // in registers, as far as possible
            status = invert_block(3, parts, structures, values, block, out, small);
        } else {
            status = invert_block(q, parts, structures, values, block, out, scratch);
        }
        *bad_block = block;
        if (status != kInverted) return status;
    }
    return kInverted;
}

}  // namespace yasps
