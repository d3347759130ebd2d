// CUB's device-wide algorithms for the Python side. Called without scratch memory, a function only says in `size` how
// many bytes of it are needed. Returns an error of the CUDA runtime, 0 for none.
#include <stdint.h>

#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_scan.cuh>

extern "C" int yasps_sort_pairs(void* scratch, size_t* size, const uint64_t* keys_in, uint64_t* keys_out,
                                const uint32_t* values_in, uint32_t* values_out, long count, int bits,
                                cudaStream_t stream) {
    return cub::DeviceRadixSort::SortPairs(scratch, *size, keys_in, keys_out, values_in, values_out, count, 0, bits,
                                           stream);
}

extern "C" int yasps_exclusive_sum(void* scratch, size_t* size, const int64_t* from, int64_t* to, long count,
                                   cudaStream_t stream) {
    return cub::DeviceScan::ExclusiveSum(scratch, *size, from, to, count, stream);
}
