// What generated kernels and the runtime agree on. Every generated file begins with this text, so it includes nothing;
// runtime/core/sink.py reads the numbers and the fields.
#pragma once

#if defined(__device__) || defined(__CUDACC__)
#define YASPS_FUNCTION static __device__ inline
#else
#define YASPS_FUNCTION static inline
#endif

enum {
    kYaspsLanes = 8,      // instances that a kernel of the processor evaluates at once
    kYaspsTileBits = 9,   // a processor reaches HessianBlocks through tiles of 2^9 doubles
    kYaspsThreads = 128,  // of a block of a device, where a kernel does not ask for another number
    // PositionInData is negative where there is no block, else the block's offset in HessianBlocks before these flags.
    kYaspsTurned = 1,  // the block's transpose is stored
    kYaspsTwice = 2,   // two slots of one instance are the same unknowns: the block is added, and its transpose
    kYaspsFlagBits = 2
};
// What a projection and a kernel of derivatives of the processor return where memory ran out.
#define YASPS_NO_MEMORY (-0x7fffffffffffffffL - 1)

// Where a kernel's results go: `mode` of projection is 0 = clamp, 1 = abs, 2 = leave.
#if defined(__device__) || defined(__CUDACC__)
struct yasps_sink {            // its fields are the kernel's parameters
    double* gradient;          // what gradients are added to
    double* blocks;            // HessianBlocks, or null: gradient only
    const int* kappa;          // [n, capacity], 1-based, 0 = no contribution
    const long* position;      // [n, capacity (capacity + 1) / 2]: PositionInData
    const long* gradient_at;   // [n, capacity]: places in `gradient`, or null: those of kappa
    const int* block_size_at;  // [scalars]: size of the dof block that starts here
    const unsigned* order;     // [n]: the instances as threads take them, or null: one after another
    long mode;
    unsigned long long* outcome;  // [2]: the first instance that is not finite; how many Hessians were projected
    double* workspace;            // of all threads: number k of thread t at k * (number of threads) + t
};
#else
struct yasps_sink {
    double* gradient;  // [scalars]
    double** tiles;    // where each tile of HessianBlocks is, null if nobody has asked for it yet; null: gradient only
    const int* kappa;  // as on a device, and so on
    const long* position;
    const int* block_size_at;
    long (*project)(double* packed, int width, int lanes, int mode);
    int mode;
    long* projected;
    long (*project_isotropic)(double* packed, const double* deformation, int width, int lanes, int mode);
    long (*project_two_vectors)(double* packed, const double* vectors, int width, int lanes, int mode);
    double* (*open_tile)(const yasps_sink* sink, long tile);  // empties a tile and says where it is
};
#endif

// Where entry (r, c), r <= c, of a symmetric n x n matrix stands in its packed upper triangle.
YASPS_FUNCTION constexpr long upper_place(long n, long r, long c) { return r * n - r * (r - 1) / 2 + c - r; }
// The same for any entry.
YASPS_FUNCTION constexpr long packed_place(long n, long r, long c) {
    return r <= c ? upper_place(n, r, c) : upper_place(n, c, r);
}
