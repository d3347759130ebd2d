// The coarse space of the two-level preconditioner z = D^-1 r + P (P^T H P)^-1 P^T r, as solvers/coarse_space.h has it.
//
// Once for each structure yasps_coarse_keys, a sort and yasps_coarse_entries say which blocks of H add to which block
// of the coarse matrix. For each system yasps_coarse_matrix adds them up, and for every 8 rows yasps_coarse_pivot and
// yasps_coarse_sweep turn the matrix into minus its inverse. In each iteration yasps_coarse_restrict and
// yasps_coarse_solve are launched. Every sum has one order, so the bits are the same in every run.
//
// Unlike the CPU's, an aggregate moves all its dof blocks: no unknown is ever fixed on a device.
//
// Floor of bytes, m unknowns: for each block of H 8 r c + 16 (its entry), and 8 m^2 (matrix); 16 m^2 for every 8 rows
// (inverse); 12 a scalar (restriction); 8 m^2 (solution).
#include "solvers/cuda/solver.cuh"

// Dof blocks of one size that the coarse space moves together.
struct yasps_aggregate {
    long first;       // its first unknown
    long width;       // scalars of each dof block
    long begin, end;  // in the list of members
};

// A block of H that is added to a block of the coarse matrix.
struct yasps_coarse_entry {
    const double* block;
    long flags;  // kYaspsTurned: its transpose is added. kYaspsTwice: the block and its transpose are
};

// Which block of the coarse matrix, (larger aggregate) * count + smaller, each block of H adds to; count^2 for none.
// aggregate_of: of each scalar, or -1.
extern "C" __global__ void __launch_bounds__(kThreads)
    yasps_coarse_keys(const yasps_block_list* lists, long list_count, long total, const int* aggregate_of, long count,
                      unsigned long* keys, unsigned* ids) {
    const long i = thread_of_grid();
    if (i >= total) return;
    const yasps_block_list& list = list_of(lists, list_count, i);
    const long above = aggregate_of[list.rows[i - list.before]], beside = aggregate_of[list.cols[i - list.before]];
    const long high = above > beside ? above : beside, low = above > beside ? beside : above;
    keys[i] = (unsigned long)(low < 0 ? count * count : high * count + low);
    ids[i] = (unsigned)i;
}

// From sorted keys and ids: the entries, and where those of each key begin and end. `bounds` [2, count^2] is zero
// before.
extern "C" __global__ void __launch_bounds__(kThreads)
    yasps_coarse_entries(const yasps_block_list* lists, long list_count, long total, const yasps_aggregate* aggregates,
                         const int* aggregate_of, long count, const unsigned long* keys, const unsigned* ids,
                         yasps_coarse_entry* entries, long* bounds) {
    const long i = thread_of_grid();
    if (i >= total) return;
    const long key = (long)keys[i], none = count * count;
    if (key == none) return;
    if (i == 0 || (long)keys[i - 1] != key) bounds[key] = i;
    if (i == total - 1 || (long)keys[i + 1] != key) bounds[none + key] = i + 1;
    const yasps_block_list& list = list_of(lists, list_count, ids[i]);
    const long b = ids[i] - list.before;
    const int row = list.rows[b], col = list.cols[b], above = aggregate_of[row], beside = aggregate_of[col];
    entries[i].block = list.values + b * aggregates[above].width * aggregates[beside].width;
    entries[i].flags = (above < beside ? kYaspsTurned : 0) | (above == beside && row != col ? kYaspsTwice : 0);
}

namespace {

// The sum of the entries' numbers (i, j), of blocks of r x c numbers, or c x r where turned.
__device__ __forceinline__ double entry_at(const yasps_coarse_entry& entry, long r, long c, long i, long j) {
    const double straight = __ldg(entry.block + (entry.flags & kYaspsTurned ? j * r + i : i * c + j));
    return entry.flags & kYaspsTwice ? straight + __ldg(entry.block + j * c + i) : straight;
}

// Number (i, j) of the block of two aggregates, and its mirror image. A diagonal that is zero becomes 1, as on the CPU.
__device__ __forceinline__ void put(double* matrix, long stride, const yasps_aggregate& a, const yasps_aggregate& b,
                                    long i, long j, double sum) {
    const long row = a.first + i, col = b.first + j;
    const double number = row == col && sum == 0 ? 1.0 : sum;
    matrix[row * stride + col] = number;
    matrix[col * stride + row] = number;
}

constexpr int kPanel = 8;  // rows that are eliminated together
constexpr int kTile = 32;  // rows and columns of what a block of threads computes

// Row k of the pivots' inverse times a column of their rows.
__device__ __forceinline__ double times_inverse(const double* inverse, int k, const double (*rows)[kTile], int at) {
    double sum = 0;
#pragma unroll
    for (int l = 0; l < kPanel; ++l) sum += rows[l][at] * __ldg(inverse + l * kPanel + k);
    return sum;
}

}  // namespace

// The coarse matrix, both triangles: a warp for each pair of aggregates. [stride, stride], zero before.
extern "C" __global__ void __launch_bounds__(kThreads)
    yasps_coarse_matrix(const yasps_aggregate* aggregates, long count, const yasps_coarse_entry* entries,
                        const long* bounds, long stride, double* matrix) {
    const long key = thread_of_grid() / 32, high = key / count, low = key % count;
    const int lane = threadIdx.x % 32;
    if (high >= count || low > high) return;
    const yasps_aggregate a = aggregates[high], b = aggregates[low];
    const long begin = bounds[key], end = bounds[count * count + key];
    if (a.width == 3 && b.width == 3) {  // often with many entries: they are shared
        double sums[9] = {};
        for (long e = begin + lane; e < end; e += 32) {
            const yasps_coarse_entry entry = entries[e];
#pragma unroll
            for (int k = 0; k < 9; ++k) sums[k] += entry_at(entry, 3, 3, k / 3, k % 3);
        }
#pragma unroll
        for (int by = 16; by > 0; by /= 2) {
#pragma unroll
            for (int k = 0; k < 9; ++k) sums[k] += __shfl_xor_sync(~0u, sums[k], by);
        }
        if (lane != 0) return;
#pragma unroll
        for (int k = 0; k < 9; ++k)
            if (high != low || k / 3 >= k % 3) put(matrix, stride, a, b, k / 3, k % 3, sums[k]);
        return;
    }
    for (long k = lane; k < a.width * b.width; k += 32) {  // else the numbers are
        const long i = k / b.width, j = k % b.width;
        if (high == low && i < j) continue;
        double sum = 0;
        for (long e = begin; e < end; ++e) sum += entry_at(entries[e], a.width, b.width, i, j);
        put(matrix, stride, a, b, i, j, sum);
    }
}

// The inverse of the diagonal block of 8 rows from `first` on, [8, 8]; *outcome becomes why there is none. Behind the m
// unknowns the matrix is the identity. One thread.
extern "C" __global__ void __launch_bounds__(kThreads)
    yasps_coarse_pivot(const double* matrix, long m, long stride, long first, double* inverse, long* outcome) {
    if (thread_of_grid() != 0 || *outcome != kConverged) return;
    double factor[kPanel * kPanel];
#pragma unroll
    for (int k = 0; k < kPanel * kPanel; ++k) {
        const long row = first + k / kPanel, col = first + k % kPanel;
        factor[k] = row < col ? 0.0 : row >= m ? (row == col ? 1.0 : 0.0) : matrix[row * stride + col];
    }
    const long status = invert_factor_of(factor, Fixed<kPanel>());
    if (status != kConverged) {
        *outcome = status;
        return;
    }
#pragma unroll
    for (int i = 0; i < kPanel; ++i) {
#pragma unroll
        for (int j = 0; j <= i; ++j)
            inverse[i * kPanel + j] = inverse[j * kPanel + i] = entry_of_inverse(factor, Fixed<kPanel>(), i, j);
    }
}

// One step of the symmetric sweep operator with a block as pivot (solvers/coarse_space.cpp), [stride, stride], into
// another matrix. A block of threads computes a tile; what it writes left of the diagonal, another one writes right of
// it with the same bits.
extern "C" __global__ void __launch_bounds__(kThreads)
    yasps_coarse_sweep(const double* from, long stride, long first, const double* inverse, const long* outcome,
                       double* to) {
    __shared__ double above[kPanel][kTile], beside[kPanel][kTile], by[kTile][kPanel + 1];
    if (*outcome != kConverged) return;
    const long tiles = (stride + kTile - 1) / kTile;
    const long top = blockIdx.x / tiles * kTile, left = blockIdx.x % tiles * kTile;
    const long high = top > left ? top : left, low = top > left ? left : top;
    for (int t = threadIdx.x; t < kPanel * kTile; t += kThreads) {
        const int k = t / kTile, at = t % kTile;
        const double* const row = from + (first + k) * stride;
        above[k][at] = high + at < stride ? row[high + at] : 0.0;
        beside[k][at] = low + at < stride ? row[low + at] : 0.0;
    }
    __syncthreads();
    for (int t = threadIdx.x; t < kPanel * kTile; t += kThreads)
        by[t % kTile][t / kTile] = times_inverse(inverse, t / kTile, above, t % kTile);
    __syncthreads();
    for (long t = threadIdx.x; t < kTile * kTile; t += kThreads) {
        const long i = top + t / kTile, j = left + t % kTile;
        if (i >= stride || j >= stride) continue;
        const long far = i > j ? i : j, near = i > j ? j : i;
        const long far_pivot = far - first, near_pivot = near - first;
        const bool far_is_pivot = far_pivot >= 0 && far_pivot < kPanel;
        const bool near_is_pivot = near_pivot >= 0 && near_pivot < kPanel;
        double number;
        if (far_is_pivot && near_is_pivot) {
            number = -inverse[far_pivot * kPanel + near_pivot];
        } else if (far_is_pivot) {
            number = times_inverse(inverse, (int)far_pivot, beside, (int)(near - low));
        } else if (near_is_pivot) {
            number = by[far - high][near_pivot];
        } else {
            number = from[i * stride + j];
#pragma unroll
            for (int k = 0; k < kPanel; ++k) number -= by[far - high][k] * beside[k][near - low];
        }
        to[i * stride + j] = number;
    }
}

// P^T r: a block of threads for each aggregate. members: scalar offsets of dof blocks.
extern "C" __global__ void __launch_bounds__(kThreads, 8)
    yasps_coarse_restrict(const yasps_aggregate* aggregates, long count, const int* members, const double* r,
                          const long* reason, double* restricted) {
    if (reason != nullptr && *reason != kRunning) return;
    if (blockIdx.x >= count) return;
    const yasps_aggregate a = aggregates[blockIdx.x];
    for (long i = 0; i < a.width; ++i) {
        double sum = 0;
#pragma unroll 4
        for (long k = a.begin + threadIdx.x; k < a.end; k += kThreads) sum += r[__ldg(members + k) + i];
        sum = block_sum(sum);
        if (threadIdx.x == 0) restricted[a.first + i] = sum;
    }
}

// y = (P^T H P)^-1 P^T r, a warp for each row of minus the inverse. Leaves the shares of r^T P y.
extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_coarse_solve(const double* matrix, long m, long stride, const double* restricted, const long* reason,
                       double* y, double* partial) {
    if (reason != nullptr && *reason != kRunning) return;
    const long i = thread_of_grid() / 32;
    const int lane = threadIdx.x % 32;
    double sum = 0;
    if (i < m)
        for (long j = lane; j < m; j += 32) sum -= matrix[i * stride + j] * restricted[j];
    for (int by = 16; by > 0; by /= 2) sum += __shfl_xor_sync(~0u, sum, by);
    const bool first = lane == 0 && i < m;
    if (first) y[i] = sum;
    sum = block_sum(first ? sum * restricted[i] : 0.0);
    if (threadIdx.x == 0) partial[blockIdx.x] = sum;
}
