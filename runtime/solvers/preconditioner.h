// The CPU's block-Jacobi preconditioner.
#pragma once

#include "core/runtime.h"

#define YASPS_ALWAYS_INLINE inline __attribute__((always_inline))
#define YASPS_UNROLLED _Pragma("GCC unroll 3")  // blocks of 3 scalars as a whole

#include "solvers/inverse.h"

namespace yasps {

// sum becomes the inverse of the Cholesky factor of what the parts have of a diagonal block of q x q numbers, in its
// lower triangle. Returns kConverged, or why not.
YASPS_ALWAYS_INLINE Reason invert_factor_of_sum(int q, int parts, const Structure* const* structures,
                                                const double* const* values, long block, double* sum) {
#pragma GCC unroll 9
    for (int k = 0; k < q * q; ++k) sum[k] = 0;
    for (int p = 0; p < parts; ++p) {
        const long offset = structures[p]->diagonal[block];
        if (offset < 0) continue;
        const double* const part = values[p] + offset;
#pragma GCC unroll 9
        for (int k = 0; k < q * q; ++k) sum[k] += part[k];
    }
    bool finite = true;
#pragma GCC unroll 9
    for (int k = 0; k < q * q; ++k) finite &= fabs(sum[k]) < INFINITY;
    return finite ? invert_factor_of(sum, q) : kNotFinite;
}

// Inverts the sum of the diagonal blocks of all parts, for dof blocks [range). Returns kConverged, or why `bad_block`
// has no inverse.
Reason invert_diagonal(int parts, const Structure* const* structures, const double* const* values, Range range,
                       double* inverse, double* scratch, long* bad_block);

}  // namespace yasps
