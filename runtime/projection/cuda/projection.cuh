// What the projections onto the positive semidefinite cone share: the check that most matrices pass.
//
// One thread has one matrix, its upper triangle packed row by row. Most matrices of a simulation are semidefinite, and
// an LDL^T factorisation finds out at a small part of the cost of a decomposition.
//
// What waiting costs: threads of a warp whose matrices pass wait for those that fail. If a share f of all matrices
// fails, scattered, 1 - (1 - f)^32 of the warps decompose: 28 % at f = 1 %, 95 % at 9 %. So between a few per cent and
// half, where most lanes idle, a decomposition costs up to 1 / f of what it must. Decided: nothing is done about it.
// Contacts fail nearly all together (76 to 100 % in docs/performance.md), elements at rest nearly never. The remedy
// would be a list of those that fail and a second kernel over it, which costs writing and reading their matrices
// through memory (n (n + 1) doubles each) and splits every generated kernel in two; not without a GPU to measure it.
#pragma once

#include "projection/cone.h"
#include "projection/cuda/number.cuh"
#include "projection/three_by_three.h"

// mode: 0 = negative eigenvalues become 0, 1 = their absolute value, 2 = nothing is changed. Returns 1 if the matrix
// was changed, 0 if it keeps every bit, -1 if an entry is not finite (or eigenvalues cannot be found). work: scratch of
// n (n + 2) doubles, none of them is read before it is written; not used for n <= 3.
extern "C" __device__ int yasps_project(double* packed, int n, int mode, double* work);

// The same where number k of the matrix is packed[k * packed_step], and that of work work[k * work_step].
extern "C" __device__ int yasps_project_apart(double* packed, long packed_step, int n, int mode, double* work,
                                              long work_step);

// The same for a Hessian with respect to F, 3x3 (n = 9) or 3x2 (n = 6), row by row, of an energy that sees only the
// singular values of F. A matrix whose F is not finite is projected without it.
extern "C" __device__ int yasps_project_isotropic(double* packed, const double* deformation, int n, int mode);

namespace yasps {

enum Outcome { kNotFinite = -1, kUnchanged = 0, kChanged = 1, kUndecided = 2 };

// Numbers `step` apart. In global memory that many threads work on, number k of one thread stands beside number k of
// the next, so that a warp reads and writes whole lines; what a compiler puts on the stack it arranges so itself.
struct Apart {
    double* at;
    long step;
    __device__ double& operator[](long k) const { return at[k * step]; }
    __device__ Apart operator+(long k) const { return {at + k * step, step}; }
};

struct Check {
    double sum;   // of the absolute values of all entries of the triangle; not finite where one is not
    bool passed;  // the matrix plus the shift has an LDL^T factorisation with a positive D
};

__device__ inline bool in_range(double sum) { return sum < kLargestSum && (sum > kSmallestSum || sum == 0.0); }

template <class Numbers>
__device__ inline bool all_finite(Numbers packed, int entries) {
    bool finite = true;
    // Unrolled, this would be merged with other uses of the entries and keep them in registers.
    YASPS_ROLLED
    for (int k = 0; k < entries; ++k) finite = finite && fabs(packed[k]) <= kLargest;
    return finite;
}

// What a check of a matrix tells of it. Undecided: it has to be decomposed.
template <class Numbers>
__device__ inline Outcome outcome_of(const Check& check, Numbers packed, int n, int mode) {
    if (check.passed && in_range(check.sum)) return kUnchanged;
    if (!(check.sum <= kLargest) && !all_finite(packed, n * (n + 1) / 2)) return kNotFinite;
    return mode == kLeave ? kUnchanged : kUndecided;
}

// Checks a triangle of a width known here, in registers, in place. Bounds of all loops are constants, so that every
// compiler unrolls them and no entry is indexed by a variable.
template <int n>
__device__ inline Check check_in_registers(double (&a)[n * (n + 1) / 2]) {
    double sum = 0.0, trace = 0.0;
    bool passed = true;
    YASPS_UNROLLED
    for (int k = 0; k < n * (n + 1) / 2; ++k) sum += fabs(a[k]);
    YASPS_UNROLLED
    for (int i = 0; i < n; ++i) trace += fabs(a[place_of<n>(i, i)]);
    // The absolute part lets a zero matrix pass.
    const double shift = trace * kProjectionShift + kSmallestNormal;
    YASPS_UNROLLED
    for (int i = 0; i < n; ++i) {
        const double pivot = a[place_of<n>(i, i)] + shift;
        passed = passed && pivot > 0.0;
        const double inverse = 1.0 / pivot;
        YASPS_UNROLLED
        for (int j = 0; j < n; ++j) {
            const double factor = j > i ? a[place_of<n>(i, j)] * inverse : 0.0;
            YASPS_UNROLLED
            for (int k = 0; k < n; ++k)
                if (j > i && k >= j) a[place_of<n>(j, k)] -= factor * a[place_of<n>(i, k)];
        }
    }
    return {sum, passed};
}
template <int n, class Numbers>
__device__ inline Check check_of(Numbers packed) {
    double a[n * (n + 1) / 2];
    YASPS_UNROLLED
    for (int k = 0; k < n * (n + 1) / 2; ++k) a[k] = packed[k];
    return check_in_registers<n>(a);
}

}  // namespace yasps
