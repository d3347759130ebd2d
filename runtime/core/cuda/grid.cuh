// The threads of a grid, and sums over them, for kernels that are launched with blocks of kThreads.
#ifndef YASPS_GRID_CUH
#define YASPS_GRID_CUH

#include "core/sink.h"

constexpr int kThreads = kYaspsThreads;  // of every block of these kernels
constexpr int kWarps = kThreads / 32;

__device__ __forceinline__ bool is_finite(double value) { return fabs(value) <= 1.7976931348623157e308; }

__device__ __forceinline__ long thread_of_grid() { return blockIdx.x * (long)blockDim.x + threadIdx.x; }
__device__ __forceinline__ long threads_of_grid() { return gridDim.x * (long)blockDim.x; }

// The sum over all threads of a block, known to each. Always the same order of additions.
__device__ inline double block_sum(double value) {
    __shared__ double sums[kWarps];
    for (int by = 16; by > 0; by /= 2) value += __shfl_down_sync(~0u, value, by);
    if (threadIdx.x % 32 == 0) sums[threadIdx.x / 32] = value;
    __syncthreads();
    double total = 0;
    for (int warp = 0; warp < kWarps; ++warp) total += sums[warp];
    __syncthreads();  // so that the next call may write
    return total;
}

// The sum of what the blocks of an earlier kernel left, known to each thread. Every block adds them up for itself, in
// reads that hit the L2 cache: with as many blocks as run at once (8 a multiprocessor) 8 reads a thread on an H100,
// cheaper than one more kernel.
__device__ inline double sum_of(const double* partial, long count) {
    double sum = 0;
    for (long i = threadIdx.x; i < count; i += kThreads) sum += partial[i];
    return block_sum(sum);
}

#endif
