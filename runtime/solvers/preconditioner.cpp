// Block-Jacobi preconditioner: the explicit inverses of the diagonal blocks of H (paper, appendix D).
#include "solvers/preconditioner.h"

#include "core/runtime.h"

namespace yasps {
namespace {

// Everything below is inlined into one function for each common size, in which loops over q are unrolled.

// Inverts the q x q sum of what the parts have of a diagonal block; `scratch` holds q^2 doubles. Rows of the
// inverse are padded to whole vectors.
YASPS_ALWAYS_INLINE Reason invert_block(int q, int parts, const Structure* const* structures,
                                        const double* const* values, long block, double* out, double* scratch) {
    const Reason status = invert_factor_of_sum(q, parts, structures, values, block, scratch);
    if (status != kConverged) return status;
    const int stride = padded_size(q);
#pragma GCC unroll 3
    for (int i = 0; i < q; ++i) {
#pragma GCC unroll 3
        for (int j = 0; j <= i; ++j) {
            out[i * stride + j] = out[j * stride + i] = entry_of_inverse(scratch, q, i, j);
        }
        for (int j = q; j < stride; ++j) out[i * stride + j] = 0;
    }
    return kConverged;
}

}  // namespace

Reason invert_diagonal(int parts, const Structure* const* structures, const double* const* values, Range range,
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
        Reason status;
        if (q == 3) {
            double small[9];  // in registers, as far as possible
            status = invert_block(3, parts, structures, values, block, out, small);
        } else {
            status = invert_block(q, parts, structures, values, block, out, scratch);
        }
        *bad_block = block;
        if (status != kConverged) return status;
    }
    return kConverged;
}

}  // namespace yasps
