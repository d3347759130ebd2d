// Blocks of a matrix as products read them: filled by runtime/matrix/cuda/product.py, which knows the layout. All
// members have 8 bytes.
#ifndef YASPS_BLOCK_LIST_CUH
#define YASPS_BLOCK_LIST_CUH

#include "core/cuda/grid.cuh"

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

// The list with block i of all, lists in the order of their blocks.
__device__ __forceinline__ const yasps_block_list& list_of(const yasps_block_list* lists, long count, long i) {
    long l = count - 1;
    while (lists[l].before > i) --l;
    return lists[l];
}

// What a solver's reason to stop is as long as there is none: products are computed only then.
constexpr long kRunning = -1;

#endif
