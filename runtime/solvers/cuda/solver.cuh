// What the kernels of the linear solver share: the state of the iteration and the place of a scalar in its dof block.
//
// Structures here are filled or read by runtime/solvers/cuda/pcg.py, which knows their layout. All members have 8
// bytes.
#ifndef YASPS_SOLVER_CUH
#define YASPS_SOLVER_CUH

#include "matrix/cuda/block_list.cuh"

#define YASPS_ALWAYS_INLINE __device__ __forceinline__
#ifdef __CUDACC__
#define YASPS_UNROLLED _Pragma("unroll")
#else
#define YASPS_UNROLLED
#endif

#include "solvers/inverse.h"

using namespace yasps;

// Dof blocks of one size that follow each other.
struct yasps_run {
    long start;    // scalar offset
    long size;     // of each dof block
    long inverse;  // where their inverted diagonal blocks begin; one row after another, `size` doubles each
};

// Why the first iteration waits before it begins: for the coarse space.
constexpr long kPaused = -2;

// A number that the compiler knows.
template <int Q>
struct Fixed {
    __device__ __forceinline__ constexpr operator int() const { return Q; }
};

// Between two iterations. An iteration reads one and fills the other, so no kernel reads what it writes.
struct yasps_pcg_state {
    double squared;    // r^T M^-1 r, with the coarse space in M where it is used
    double reference;  // g^T D^-1 g
    double relative;   // r^T D^-1 r over the reference
    double step;       // of this iteration along the direction, found in its middle
    long iteration;
    long reason;   // kRunning, kPaused, or why the iteration stopped
    long verdict;  // found in the middle of this iteration: kRunning, or why it must stop
    long block;    // first scalar of the dof block to blame, or -1
};

struct yasps_pcg_settings {
    double tolerance;
    long max_iterations;
    double* history;  // [max_iterations + 1] or null
    long pause;       // whether the first iteration waits for the coarse space
};

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
