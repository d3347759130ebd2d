// The sum of an array, always added in the same order: each block leaves one number, a last block adds those up.
// Floor: one read of the array.
#include "core/cuda/grid.cuh"

// As many blocks of kThreads as run at once, or fewer.
extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_sum_parts(const double* values, long count, double* partial) {
    double sum = 0;
    for (long i = thread_of_grid(); i < count; i += threads_of_grid()) sum += values[i];
    sum = block_sum(sum);
    if (threadIdx.x == 0) partial[blockIdx.x] = sum;
}

// One block.
extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_sum_finish(const double* partial, long count, double* sum) {
    const double total = sum_of(partial, count);
    if (threadIdx.x == 0) *sum = total;
}
