// Block-Jacobi preconditioner: the explicit inverses of the diagonal blocks of H (paper, appendix D).
#include "runtime.h"

namespace yasps {
namespace {

// a (q x q, row-major, lower triangle used) becomes its Cholesky factor L.
InversionStatus factorise(double* a, int q) {
    for (int j = 0; j < q; ++j) {
        const double before = a[j * q + j];
        double pivot = before;
        for (int k = 0; k < j; ++k) pivot -= a[j * q + k] * a[j * q + k];
        if (!(fabs(pivot) < INFINITY)) return kNonFinite;
        // A pivot that is nothing but rounding error means that the block is singular.
        if (pivot <= 4e-16 * q * before || pivot <= 0) return kIndefinite;
        const double diagonal = sqrt(pivot);
        a[j * q + j] = diagonal;
        for (int i = j + 1; i < q; ++i) {
            double sum = a[i * q + j];
            for (int k = 0; k < j; ++k) sum -= a[i * q + k] * a[j * q + k];
            a[i * q + j] = sum / diagonal;
        }
    }
    return kInverted;
}

// Inverts the lower triangular matrix in place.
void invert_factor(double* l, int q) {
    for (int j = 0; j < q; ++j) {
        l[j * q + j] = 1 / l[j * q + j];
        for (int i = j + 1; i < q; ++i) {
            double sum = 0;
            for (int k = j; k < i; ++k) sum += l[i * q + k] * l[k * q + j];
            l[i * q + j] = -sum / l[i * q + i];
        }
    }
}

}  // namespace

// The inverse is formed as W^T W with W = L^-1, which is symmetric and positive definite also after rounding.
// Rows are padded to whole vectors. `scratch` holds largest^2 doubles.
InversionStatus invert_diagonal(int parts, const Structure* const* structures, const double* const* values, Range range,
                                double* inverse, double* scratch, long* bad_block) {
    const Layout& layout = structures[0]->layout;
    for (long block = range.begin; block < range.end; ++block) {
        const int q = layout.size[block];
        for (int k = 0; k < q * q; ++k) scratch[k] = 0;
        for (int p = 0; p < parts; ++p) {
            const long offset = structures[p]->diagonal[block];
            if (offset < 0) continue;
            for (int k = 0; k < q * q; ++k) scratch[k] += values[p][offset + k];
        }
        *bad_block = block;
        for (int k = 0; k < q * q; ++k)
            if (!(fabs(scratch[k]) < INFINITY)) return kNonFinite;
        const InversionStatus status = factorise(scratch, q);
        if (status != kInverted) return status;
        invert_factor(scratch, q);
        const int stride = padded_size(q);
        double* const out = inverse + layout.inverse_start[block];
        for (int i = 0; i < q; ++i) {
            for (int j = 0; j <= i; ++j) {
                double sum = 0;
                for (int k = i; k < q; ++k) sum += scratch[k * q + i] * scratch[k * q + j];
                out[i * stride + j] = sum;
                out[j * stride + i] = sum;
            }
            for (int j = q; j < stride; ++j) out[i * stride + j] = 0;
        }
    }
    return kInverted;
}

}  // namespace yasps
