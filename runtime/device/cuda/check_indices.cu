// Indices that somebody else wrote to the device, looked at before kernels read through them. Floor: one read of them.
#include "core/sink.h"

// first_bad: the lowest place of an index outside 0 .. most - 1.
extern "C" __global__ void __launch_bounds__(kYaspsThreads)
    yasps_check_indices(const int* indices, long count, long most, unsigned long long* first_bad) {
    const long k = blockIdx.x * (long)blockDim.x + threadIdx.x;
    if (k < count && (indices[k] < 0 || indices[k] >= most)) atomicMin(first_bad, (unsigned long long)k);
}
