// What a double can do, so that functions for packs of numbers (core/vectors.h) serve a thread with one number, too:
// the functions of that file's names, and what device code writes before its own.
//
// All stays in registers: where arrays are indexed by a loop's variable, the loop is unrolled.
#pragma once

#ifdef __CUDACC__
#define YASPS_ROLLED _Pragma("unroll 1")
#define YASPS_UNROLLED _Pragma("unroll")
#else
#define YASPS_ROLLED
#define YASPS_UNROLLED
#endif
#define YASPS_UNROLLED_FOR_A_THREAD YASPS_UNROLLED
#define YASPS_FUNCTION __device__
#define YASPS_ALWAYS_INLINE __device__ __forceinline__
#define YASPS_SELDOM __device__ inline  // a call would put its arguments into local memory

namespace yasps {

constexpr double kEpsilon = 2.220446049250313e-16;
constexpr double kSmallestNormal = 2.2250738585072014e-308;
constexpr double kLargest = 1.7976931348623157e308;

template <class V>
using Mask = bool;

template <class V>
__device__ inline V constant(double value) {
    return value;
}
template <class T>
__device__ inline T select(bool mask, T yes, T no) {
    return mask ? yes : no;
}
__device__ inline bool less(double a, double b) { return a < b; }
__device__ inline double magnitude(double v) { return fabs(v); }
__device__ inline double with_sign(double v, double sign) { return copysign(v, sign); }
__device__ inline double maximum(double a, double b) { return fmax(a, b); }
__device__ inline double inverse(double v) { return 1.0 / v; }
__device__ inline double reciprocal(double v) { return 1.0 / v; }
__device__ inline double inverse_root(double v) { return rsqrt(v); }
// The root and its inverse; of zero they are 0 and finite.
__device__ inline void find_roots(double v, double* root, double* inverse_root) {
    *inverse_root = rsqrt(fmax(v, kSmallestNormal));
    *root = v * *inverse_root;
}
__device__ inline unsigned bits_of(bool mask) { return mask ? 1u : 0u; }
__device__ inline bool any(bool mask) { return mask; }
// 2^(sign e), with numbers v of about 2^e; normal numbers, also where v is not.
__device__ inline double power_of_two(double v, int sign) {
    const int exponent = ilogb(v), below = exponent < 1021 ? exponent : 1021;
    return scalbn(1.0, sign * (below > -1021 ? below : -1021));
}

}  // namespace yasps
