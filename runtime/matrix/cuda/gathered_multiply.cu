// y = H x without atomic additions: each dof block gathers its row of the full matrix, in a fixed order.
//
// Every block above the diagonal is read twice, so the floor of bytes is about twice that of multiply.cu: for each
// block of a row of the full matrix 8 r c + 16 (its entry), and 16 a scalar.
#include "matrix/cuda/block_list.cuh"

// One block in the row of a dof block: where its numbers are, and what they multiply.
struct yasps_entry {
    const double* block;
    int other;  // scalar offset of what it multiplies
    int shape;  // 2 * scalars of that, plus 1 if the block is stored transposed
};

// Which dof block each stored block of a list belongs to, and which its transpose: keys[2 b] and keys[2 b + 1] become
// scalar offsets, `none` for the transpose of a diagonal block, and ids their own place.
extern "C" __global__ void __launch_bounds__(kThreads)
    yasps_gather_keys(const yasps_block_list* lists, long list_count, long total, long none, unsigned long* keys,
                      unsigned* ids) {
    const long i = thread_of_grid();
    if (i >= total) return;
    const yasps_block_list& list = list_of(lists, list_count, i);
    const long b = i - list.before;
    const int row = list.rows[b], col = list.cols[b];
    keys[2 * i] = (unsigned long)row;
    keys[2 * i + 1] = row == col ? (unsigned long)none : (unsigned long)col;
    ids[2 * i] = (unsigned)(2 * i);
    ids[2 * i + 1] = (unsigned)(2 * i + 1);
}

// From sorted keys and ids: the entries, and where those of the dof block at each scalar offset begin and end. `bounds`
// [2, size] is zero before.
extern "C" __global__ void __launch_bounds__(kThreads)
    yasps_gather_entries(const yasps_block_list* lists, long list_count, long total, long none,
                         const unsigned long* keys, const unsigned* ids, const int* block_size_at, yasps_entry* entries,
                         long* bounds) {
    const long i = thread_of_grid();
    if (i >= 2 * total) return;
    const long key = (long)keys[i];
    if (key == none) return;
    if (i == 0 || (long)keys[i - 1] != key) bounds[key] = i;
    if (i == 2 * total - 1 || (long)keys[i + 1] != key) bounds[none + key] = i + 1;
    const long source = ids[i] / 2;
    const int transposed = (int)(ids[i] % 2);
    const yasps_block_list& list = list_of(lists, list_count, source);
    const long b = source - list.before;
    const int row = list.rows[b], col = list.cols[b];
    const int r = block_size_at[row], c = block_size_at[col];
    entries[i].block = list.values + b * r * c;
    entries[i].other = transposed ? row : col;
    entries[i].shape = 2 * (transposed ? r : c) + transposed;
}

namespace {

constexpr int kTeam = 8;  // lanes for a dof block of at most 3 scalars

template <int Q>
__device__ __forceinline__ void add_entry(const yasps_entry& entry, const double* x, double* sums) {
    const int length = entry.shape / 2;
    const bool transposed = entry.shape % 2;
    const int down = transposed ? 1 : length, along = transposed ? Q : 1;
    for (int j = 0; j < length; ++j) {
        const double factor = x[entry.other + j];
#pragma unroll
        for (int i = 0; i < Q; ++i) sums[i] += __ldg(entry.block + i * down + j * along) * factor;
    }
}

template <int Q>
__device__ __forceinline__ void gather_small(const yasps_entry* entries, long begin, long end, const double* x,
                                             double* sums) {
    for (long e = begin; e < end; e += kTeam) add_entry<Q>(entries[e], x, sums);
}

}  // namespace

// Dof blocks of at most 3 scalars, `starts` are their scalar offsets.
extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_gather_small(const int* starts, long count, const int* block_size_at, const yasps_entry* entries,
                       const long* bounds, long size, const double* x, double* y, const long* reason) {
    if (reason != nullptr && *reason != kRunning) return;
    const long k = thread_of_grid() / kTeam;
    const int lane = threadIdx.x % kTeam;
    const int start = k < count ? starts[k] : -1;
    const int q = start >= 0 ? block_size_at[start] : 0;
    double sums[3] = {};
    if (q > 0) {
        const long begin = bounds[start] + lane, end = bounds[size + start];
        if (q == 3) gather_small<3>(entries, begin, end, x, sums);
        if (q == 2) gather_small<2>(entries, begin, end, x, sums);
        if (q == 1) gather_small<1>(entries, begin, end, x, sums);
    }
#pragma unroll
    for (int by = kTeam / 2; by > 0; by /= 2) {
#pragma unroll
        for (int i = 0; i < 3; ++i) sums[i] += __shfl_xor_sync(~0u, sums[i], by);
    }
    if (lane != 0) return;
#pragma unroll
    for (int i = 0; i < 3; ++i)
        if (i < q) y[start + i] = sums[i];
}

// Larger ones: a block of threads for each, 16 rows at a time, 8 teams that take every 8th entry.
extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_gather_large(const int* starts, long count, const int* block_size_at, const yasps_entry* entries,
                       const long* bounds, long size, const double* x, double* y, const long* reason) {
    constexpr int kRows = 16, kTeams = kThreads / kRows;
    __shared__ double parts[kTeams][kRows];
    if (reason != nullptr && *reason != kRunning) return;
    if (blockIdx.x >= count) return;
    const int start = starts[blockIdx.x], q = block_size_at[start];
    const int lane = threadIdx.x % kRows, team = threadIdx.x / kRows;
    const long begin = bounds[start], end = bounds[size + start];
    for (int top = 0; top < q; top += kRows) {
        const int row = top + lane;
        double sum = 0;
        if (row < q) {
            for (long e = begin + team; e < end; e += kTeams) {
                const yasps_entry entry = entries[e];
                const int length = entry.shape / 2;
                const bool transposed = entry.shape % 2;
                const double* const line = entry.block + (transposed ? row : row * length);
                const int along = transposed ? q : 1;
                for (int j = 0; j < length; ++j) sum += __ldg(line + j * along) * x[entry.other + j];
            }
        }
        parts[team][lane] = sum;
        __syncthreads();
        if (team == 0 && row < q) {
            double total = 0;
            for (int t = 0; t < kTeams; ++t) total += parts[t][lane];
            y[start + row] = total;
        }
        __syncthreads();
    }
}
