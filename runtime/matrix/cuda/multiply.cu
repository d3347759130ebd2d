// y += H x for blocks of the upper triangle of a symmetric matrix (paper, appendix C): one kernel for each shape.
//
// y must be zero before the first of them. Each kernel takes the blocks of its shape of all matrices that are summed.
// If `reason` is not null, nothing happens unless *reason is kRunning.
//
// Floor of bytes: each block once, 8 r c + 8 (its row and column), x read and y read and written once, 24 a scalar.
// Blocks are read as one contiguous stream through shared memory; x is read and y added to at scattered places, which
// the caches hold where the order of unknowns is local. Sums of a row are added up within a warp before they go to
// memory; columns go there block by block. The order of atomic additions is not fixed, see gathered_multiply.cu.
#include "matrix/cuda/block_list.cuh"

namespace {

// The chunk that a warp takes. False: none is left for it.
__device__ __forceinline__ bool find_chunk(const yasps_block_list* lists, long count, long chunk,
                                           yasps_block_list* list, long* first) {
#pragma unroll 1
    for (long l = 0; l < count; ++l) {
        const long chunks = lists[l].chunks;
        if (chunk < chunks) {
            *list = lists[l];
            *first = chunk * list->chunk;
            return true;
        }
        chunk -= chunks;
    }
    return false;
}

// One block a thread, 32 blocks a warp.
template <int R, int C>
__device__ __forceinline__ void multiply_small(const yasps_block_list* lists, long list_count, const double* x,
                                               double* y, const long* reason) {
    constexpr int kSize = R * C, kStride = kSize | 1;  // odd, so that the lanes read from different banks
    __shared__ double staged[kWarps][32 * kStride];
    if (reason != nullptr && *reason != kRunning) return;
    const int lane = threadIdx.x % 32;
    double* const mine = staged[threadIdx.x / 32];
    yasps_block_list list;
    long first;
    if (!find_chunk(lists, list_count, thread_of_grid() / 32, &list, &first)) return;
    const long left = list.count - first;
    const int here = left < 32 ? (int)left : 32;
    const double* const source = list.values + first * kSize;
    double part[kSize];  // all are on their way before one is waited for
#pragma unroll
    for (int k = 0; k < kSize; ++k) {
        const int e = k * 32 + lane;
        part[k] = __ldg(source + (e < here * kSize ? e : 0));
    }
    const int row = lane < here ? __ldg(list.rows + first + lane) : -1;
    const int col = lane < here ? __ldg(list.cols + first + lane) : -1;
#pragma unroll
    for (int k = 0; k < kSize; ++k) {
        const int e = k * 32 + lane;
        mine[e / kSize * kStride + e % kSize] = part[k];
    }
    __syncwarp();
    double sums[R] = {}, transposed[C] = {};
    if (lane < here) {
        double at_row[R];
#pragma unroll
        for (int i = 0; i < R; ++i) at_row[i] = x[row + i];
#pragma unroll
        for (int j = 0; j < C; ++j) {
            const double at_col = x[col + j];
#pragma unroll
            for (int i = 0; i < R; ++i) {
                const double entry = mine[lane * kStride + i * C + j];
                sums[i] += entry * at_col;
                transposed[j] += entry * at_row[i];
            }
        }
    }
    // Rows are sorted: lanes of the same row are neighbours, and where no lane has one of its row `by` lanes
    // further, none has one beyond.
    for (int by = 1; by < 32; by *= 2) {
        const int further = __shfl_down_sync(~0u, row, by);
        const bool same = lane + by < 32 && further == row && row >= 0;
        if (!__any_sync(~0u, same)) break;
#pragma unroll
        for (int i = 0; i < R; ++i) {
            const double sum = __shfl_down_sync(~0u, sums[i], by);
            if (same) sums[i] += sum;
        }
    }
    const int before = __shfl_up_sync(~0u, row, 1);
    if (row >= 0 && (lane == 0 || before != row)) {
#pragma unroll
        for (int i = 0; i < R; ++i) atomicAdd(y + row + i, sums[i]);
    }
    if (row != col) {
#pragma unroll
        for (int j = 0; j < C; ++j) atomicAdd(y + col + j, transposed[j]);
    }
}

// A team of LANES lanes takes block after block; a lane has one row of it or one column. Sums of rows are kept as long
// as the row stays the same.
template <int R, int C, int LANES>
__device__ __forceinline__ void multiply_wide(const yasps_block_list* lists, long list_count, const double* x,
                                              double* y, const long* reason) {
    static_assert(R + C <= LANES && (LANES == 16 || LANES == 32), "a lane for each row and column");
    constexpr int kStride = C | 1, kTeams = kThreads / LANES;
    constexpr int kParts = (R * C + LANES - 1) / LANES;
    __shared__ double staged[kTeams][R * kStride + R + C];
    if (reason != nullptr && *reason != kRunning) return;
    const int lane = threadIdx.x % LANES;
    const int team = threadIdx.x % 32 / LANES;
    double* const block = staged[threadIdx.x / LANES];
    double* const operand = block + R * kStride;  // x at the rows, then at the columns
    const bool of_row = lane < R, of_col = lane >= R && lane < R + C;
    const double* const factors = operand + (of_row ? R : 0);
    const double* const entries = block + (of_row ? lane * kStride : of_col ? lane - R : 0);
    const int step = of_row ? 1 : kStride, length = of_row ? C : R;
    yasps_block_list list;
    long first;
    if (!find_chunk(lists, list_count, thread_of_grid() / 32, &list, &first)) return;
    const long steps = list.chunk / (32 / LANES);  // all lanes of a warp take as many
    int row = -1;
    double sum = 0;
#pragma unroll 1
    for (long k = 0; k < steps; ++k) {
        const long b = first + team * steps + k;
        const bool is_block = b < list.count;
        const long read = is_block ? b : first;
        const double* const source = list.values + read * (R * C);
        double part[kParts];  // all are on their way before one is waited for
#pragma unroll
        for (int m = 0; m < kParts; ++m) part[m] = __ldg(source + (m * LANES + lane < R * C ? m * LANES + lane : 0));
        const int read_row = __ldg(list.rows + read), col = __ldg(list.cols + read);
        const double mine = of_row ? x[read_row + lane] : of_col ? x[col + lane - R] : 0.0;
#pragma unroll
        for (int m = 0; m < kParts; ++m) {
            const int e = m * LANES + lane;
            if (e < R * C) block[e / C * kStride + e % C] = part[m];
        }
        if (of_row || of_col) operand[lane] = mine;
        const int next_row = is_block ? read_row : -1;
        __syncwarp();
        double product = 0;
        const double* entry = entries;
        if (is_block && (of_row || of_col)) {
#pragma unroll 3
            for (int j = 0; j < length; ++j, entry += step) product += *entry * factors[j];
        }
        if (next_row != row) {
            if (of_row && row >= 0) atomicAdd(y + row + lane, sum);
            sum = 0;
            row = next_row;
        }
        if (of_row) sum += product;
        if (of_col && is_block && next_row != col) atomicAdd(y + col + lane - R, product);
        __syncwarp();
    }
    if (of_row && row >= 0) atomicAdd(y + row + lane, sum);
}

}  // namespace

extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_multiply_1x1(const yasps_block_list* lists, long list_count, const double* x, double* y, const long* reason) {
    multiply_small<1, 1>(lists, list_count, x, y, reason);
}
extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_multiply_1x3(const yasps_block_list* lists, long list_count, const double* x, double* y, const long* reason) {
    multiply_small<1, 3>(lists, list_count, x, y, reason);
}
extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_multiply_3x1(const yasps_block_list* lists, long list_count, const double* x, double* y, const long* reason) {
    multiply_small<3, 1>(lists, list_count, x, y, reason);
}
extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_multiply_2x2(const yasps_block_list* lists, long list_count, const double* x, double* y, const long* reason) {
    multiply_small<2, 2>(lists, list_count, x, y, reason);
}
extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_multiply_3x3(const yasps_block_list* lists, long list_count, const double* x, double* y, const long* reason) {
    multiply_small<3, 3>(lists, list_count, x, y, reason);
}
extern "C" __global__ void __launch_bounds__(kThreads, 5)
    yasps_multiply_3x12(const yasps_block_list* lists, long list_count, const double* x, double* y,
                        const long* reason) {
    multiply_wide<3, 12, 16>(lists, list_count, x, y, reason);
}
extern "C" __global__ void __launch_bounds__(kThreads, 5)
    yasps_multiply_12x3(const yasps_block_list* lists, long list_count, const double* x, double* y,
                        const long* reason) {
    multiply_wide<12, 3, 16>(lists, list_count, x, y, reason);
}
extern "C" __global__ void __launch_bounds__(kThreads, 5)
    yasps_multiply_6x6(const yasps_block_list* lists, long list_count, const double* x, double* y, const long* reason) {
    multiply_wide<6, 6, 16>(lists, list_count, x, y, reason);
}
extern "C" __global__ void __launch_bounds__(kThreads, 5)
    yasps_multiply_9x9(const yasps_block_list* lists, long list_count, const double* x, double* y, const long* reason) {
    multiply_wide<9, 9, 32>(lists, list_count, x, y, reason);
}
extern "C" __global__ void __launch_bounds__(kThreads, 5)
    yasps_multiply_12x12(const yasps_block_list* lists, long list_count, const double* x, double* y,
                         const long* reason) {
    multiply_wide<12, 12, 32>(lists, list_count, x, y, reason);
}

// Any shape: a warp takes block after block, a lane every 32nd of its rows and columns.
extern "C" __global__ void __launch_bounds__(kThreads, 8)
    yasps_multiply_any(const yasps_block_list* lists, long list_count, const double* x, double* y, const long* reason,
                       long r, long c) {
    if (reason != nullptr && *reason != kRunning) return;
    yasps_block_list list;
    long first;
    if (!find_chunk(lists, list_count, thread_of_grid() / 32, &list, &first)) return;
    const long end = first + list.chunk < list.count ? first + list.chunk : list.count;
    for (long b = first; b < end; ++b) {
        const double* const block = list.values + b * r * c;
        const int row = __ldg(list.rows + b), col = __ldg(list.cols + b);
        for (long t = threadIdx.x % 32; t < r + c; t += 32) {
            const bool of_row = t < r;
            if (!of_row && row == col) continue;
            const double* const entries = of_row ? block + t * c : block + (t - r);
            const double* const factors = of_row ? x + col : x + row;
            const long step = of_row ? 1 : c, length = of_row ? c : r;
            double sum = 0;
            for (long j = 0; j < length; ++j) sum += __ldg(entries + j * step) * factors[j];
            atomicAdd(y + (of_row ? row + t : col + t - r), sum);
        }
    }
}
