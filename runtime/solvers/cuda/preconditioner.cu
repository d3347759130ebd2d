// Block-Jacobi preconditioner: the explicit inverses of the diagonal blocks of H (paper, appendix D).
//
// Floor of bytes, once a solve: each diagonal block of q scalars read and its inverse written, 16 q^2.
#include "solvers/cuda/solver.cuh"

struct yasps_diagonal {
    const double* values;
    const long* offsets;  // of each dof block's diagonal block in values, or -1
};

namespace {

// a becomes the inverse of the symmetric positive definite a, in place.
template <class Size>
__device__ __forceinline__ long invert(double* a, Size q) {
    bool finite = true;
#pragma unroll
    for (int k = 0; k < q * q; ++k) finite = finite && is_finite(a[k]);
    if (!finite) return kNotFinite;
    const long status = invert_factor_of(a, q);
    if (status != kConverged) return status;
#pragma unroll
    for (int i = 0; i < q; ++i) {
#pragma unroll
        for (int j = 0; j <= i; ++j) {
            a[i * q + j] = entry_of_inverse(a, q, i, j);
        }
    }
#pragma unroll
    for (int i = 0; i < q; ++i) {
#pragma unroll
        for (int j = 0; j < i; ++j) a[j * q + i] = a[i * q + j];
    }
    return kConverged;
}

__device__ __forceinline__ double sum_at(const yasps_diagonal* parts, long count, long block, long k) {
    double sum = 0;
    for (long p = 0; p < count; ++p)
        if (parts[p].offsets[block] >= 0) sum += __ldg(parts[p].values + parts[p].offsets[block] + k);
    return sum;
}

template <int Q>
__device__ __forceinline__ long invert_in_registers(const yasps_diagonal* parts, long count, long block, double* out) {
    double a[Q * Q];
#pragma unroll
    for (int k = 0; k < Q * Q; ++k) a[k] = sum_at(parts, count, block, k);
    const long status = invert(a, Fixed<Q>());
#pragma unroll
    for (int k = 0; k < Q * Q; ++k) out[k] = a[k];
    return status;
}

}  // namespace

// One dof block a thread. Where one cannot be inverted, *worst becomes at most 4 * (its first scalar) + reason, so that
// the first of them is named. Blocks of more than 3 scalars are worked on where the inverse goes.
extern "C" __global__ void __launch_bounds__(kThreads, 8)
    yasps_invert_diagonal(const yasps_diagonal* parts, long part_count, const int* block_start, long blocks,
                          const yasps_run* runs, long run_count, double* inverse, long long* worst) {
    const long block = thread_of_grid();
    if (block >= blocks) return;
    const yasps_place place = place_of(runs, run_count, block_start[block]);
    double* const out = inverse + place.inverse;
    long status;
    if (place.size == 3) {
        status = invert_in_registers<3>(parts, part_count, block, out);
    } else if (place.size == 1) {
        status = invert_in_registers<1>(parts, part_count, block, out);
    } else {
        for (int k = 0; k < place.size * place.size; ++k) out[k] = sum_at(parts, part_count, block, k);
        status = invert(out, place.size);
    }
    if (status != kConverged) atomicMin(worst, (long long)(4 * place.first + status));
}
