// What the kernels of the linear solver share: the state of the iteration, lists of blocks, and sums over a grid.
//
// Structures here are filled or read by runtime/solvers/cuda/pcg.py, which knows their layout. All members have 8
// bytes.
#ifndef YASPS_SOLVER_CUH
#define YASPS_SOLVER_CUH

#include "core/sink.h"

constexpr int kThreads = kYaspsThreads;  // of every block of these kernels
constexpr int kWarps = kThreads / 32;

// Blocks of one shape of one matrix, sorted by (row, col); rows and cols are scalar offsets.
struct yasps_block_list {
    const double* values;
    const int* rows;
    const int* cols;
    long count;
    long chunk;   // blocks that a warp takes at once
    long chunks;  // count / chunk, rounded up
    long before;  // blocks of the lists before this one
    long unused;
};

// Dof blocks of one size that follow each other.
struct yasps_run {
    long start;    // scalar offset
    long size;     // of each dof block
    long inverse;  // where their inverted diagonal blocks begin; one row after another, `size` doubles each
};

enum : long { kRunning = -1, kConverged = 0, kMaxIterations = 1, kNotPositiveDefinite = 2, kNotFinite = 3 };

// Between two iterations. An iteration reads one and fills the other, so no kernel reads what it writes.
struct yasps_pcg_state {
    double squared;    // r^T M^-1 r
    double reference;  // g^T M^-1 g
    double relative;   // their ratio
    double step;       // of this iteration along the direction, found in its middle
    long iteration;
    long reason;   // kRunning, or why the iteration stopped
    long verdict;  // found in the middle of this iteration: kRunning, or why it must stop
    long block;    // first scalar of the dof block to blame, or -1
};

struct yasps_pcg_settings {
    double tolerance;
    long max_iterations;
    double* history;  // [max_iterations + 1] or null
};

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

// Where scalar i lies: its dof block is the `size` scalars from `first` on, and `inverse` the row of its inverse.
struct yasps_place {
    long first;
    int size;
    long inverse;
};
__device__ inline yasps_place place_of(const yasps_run* runs, long count, long i) {
    long low = 0, high = count;  // the run that begins last at or before i; neighbours mostly share it
    while (high - low > 1) {
        const long middle = (low + high) / 2;
        if (runs[middle].start <= i)
            low = middle;
        else
            high = middle;
    }
    const yasps_run run = runs[low];
    const unsigned within = (unsigned)(i - run.start), size = (unsigned)run.size;
    const unsigned behind = size == 3 ? within % 3u : within % size;
    return {i - behind, (int)size, run.inverse + (long)within * run.size};
}

#endif
