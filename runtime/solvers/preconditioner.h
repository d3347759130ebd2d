// The CPU's block-Jacobi preconditioner.
#pragma once

#include "core/runtime.h"

#define YASPS_ALWAYS_INLINE inline __attribute__((always_inline))
#define YASPS_UNROLLED _Pragma("GCC unroll 3")  // blocks of 3 scalars as a whole

#include "solvers/inverse.h"

namespace yasps {

// Inverts the sum of the diagonal blocks of all parts, for dof blocks [range). Returns kConverged, or why `bad_block`
// has no inverse.
Reason invert_diagonal(int parts, const Structure* const* structures, const double* const* values, Range range,
                       double* inverse, double* scratch, long* bad_block);

}  // namespace yasps
