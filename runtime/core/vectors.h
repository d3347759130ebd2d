// Eight or sixteen numbers, one of each matrix of a group, that are computed together.
//
// Eight and Sixteen are one register or pairs of pairs of registers, whatever the processor has: g++ splits wider
// vector types itself, but does their selects and roots one number at a time.
//
// Functions that are written for these types and for one number of a GPU's thread alike (projection/three_by_three.h)
// say with the macros what differs; projection/cuda/number.cuh is the thread's counterpart of this file.
#pragma once

#define YASPS_FUNCTION
#define YASPS_ALWAYS_INLINE __attribute__((always_inline)) inline
#define YASPS_SELDOM __attribute__((noinline))  // what seldom runs need not make others' code longer
#define YASPS_UNROLLED _Pragma("GCC unroll 9")
#define YASPS_UNROLLED_FOR_A_THREAD
#define YASPS_ROLLED

namespace yasps {

constexpr double kEpsilon = 2.220446049250313e-16;
constexpr double kSmallestNormal = 2.2250738585072014e-308;

#if defined(__AVX512F__)
constexpr int kRegister = 64;
#elif defined(__AVX__)
constexpr int kRegister = 32;
#else
constexpr int kRegister = 16;
#endif
typedef double Register __attribute__((vector_size(kRegister)));
typedef long RegisterMask __attribute__((vector_size(kRegister)));
constexpr int kRegisterLanes = kRegister / 8;

// Two vectors, or two masks.
template <class T>
struct Pair {
    T first, second;
};
template <class T>
inline Pair<T> pair(T first, T second) {
    return {first, second};
}
template <int kBytes>
struct OfSize {
    typedef Pair<typename OfSize<kBytes / 2>::type> type;
};
template <>
struct OfSize<kRegister> {
    typedef Register type;
};
typedef OfSize<64>::type Eight;
typedef OfSize<128>::type Sixteen;

// Applies f to every register of v.
template <class F, class... T>
inline auto each(F f, T... v) {
    return f(v...);
}
template <class F, class... T>
inline auto each(F f, Pair<T>... v) {
    return pair(each(f, v.first...), each(f, v.second...));
}
template <class T>
inline Pair<T> operator+(Pair<T> a, Pair<T> b) {
    return {a.first + b.first, a.second + b.second};
}
template <class T>
inline Pair<T> operator-(Pair<T> a, Pair<T> b) {
    return {a.first - b.first, a.second - b.second};
}
template <class T>
inline Pair<T> operator*(Pair<T> a, Pair<T> b) {
    return {a.first * b.first, a.second * b.second};
}
template <class T>
inline Pair<T> operator*(Pair<T> a, double b) {
    return {a.first * b, a.second * b};
}
template <class T>
inline Pair<T> operator&(Pair<T> a, Pair<T> b) {
    return {a.first & b.first, a.second & b.second};
}
template <class T>
inline Pair<T> operator|(Pair<T> a, Pair<T> b) {
    return {a.first | b.first, a.second | b.second};
}
template <class T>
inline Pair<T> operator~(Pair<T> a) {
    return {~a.first, ~a.second};
}

template <class V>
inline auto less(V a, V b) {
    return each([](Register x, Register y) { return RegisterMask(x < y); }, a, b);
}
template <class V>
using Mask = decltype(less(V{}, V{}));

template <class M, class T>
inline T select(M mask, T yes, T no) {
    return each([](RegisterMask m, auto a, auto b) { return m ? a : b; }, mask, yes, no);
}
template <class V>
inline V constant(double value) {
    return each([value](Register zero) { return zero + value; }, V{});
}
template <class V>
inline V magnitude(V v) {
    return each([](Register x) { return Register(RegisterMask(x) & INT64_MAX); }, v);
}
// The size of v with the sign of `sign`.
template <class V>
inline V with_sign(V v, V sign) {
    return each(
        [](Register x, Register s) { return Register((RegisterMask(x) & INT64_MAX) | (RegisterMask(s) & INT64_MIN)); },
        v, sign);
}
template <class V>
inline V maximum(V a, V b) {
    return select(less(b, a), a, b);
}
template <class V>
inline V minimum(V a, V b) {
    return select(less(a, b), a, b);
}
template <class V>
inline V quotient(V a, V b) {
    return each([](Register x, Register y) { return x / y; }, a, b);
}
template <class V>
inline V inverse(V v) {
    return each([](Register x) { return 1.0 / x; }, v);
}
template <class V>
inline V square_root(V v) {
    return each(
        [](Register x) {
            Register root;
            for (int lane = 0; lane < kRegisterLanes; ++lane) root[lane] = sqrt(x[lane]);
            return root;
        },
        v);
}
// 1 / sqrt(v) of normal numbers above zero, to two units in the last place.
template <class V>
inline V inverse_root(V v) {
#if defined(__AVX512F__)
    // A first guess right to 2^-14, and the series of 1 / sqrt(1 - error) for what it misses.
    return each(
        [](Register x) {
            const Register guess = __builtin_ia32_rsqrt14pd512_mask(x, x, static_cast<unsigned char>(255));
            const Register error = 1.0 - (x * guess) * guess;
            return guess + (guess * error) * (0.5 + error * (0.375 + error * 0.3125));
        },
        v);
#else
    return inverse(square_root(v));
#endif
}
// 1 / v of normal numbers whose inverse is normal, to two units in the last place; NaN where v or that is zero.
template <class V>
inline V reciprocal(V v) {
#if defined(__AVX512F__)
    // As inverse_root: a division keeps its unit busy for longer than all of these.
    return each(
        [](Register x) {
            const Register guess = __builtin_ia32_rcp14pd512_mask(x, x, static_cast<unsigned char>(255));
            const Register error = 1.0 - x * guess;
            return guess + (guess * error) * (1.0 + error * (1.0 + error));
        },
        v);
#else
    return inverse(v);
#endif
}
// 2^(sign e), with numbers v of about 2^e; normal numbers, also where v is not.
template <class V>
inline V power_of_two(V v, int sign) {
    return each(
        [sign](Register x) {
            const RegisterMask biased = (RegisterMask(x) >> 52) & 0x7ff;
            const RegisterMask below = biased < 2 ? RegisterMask{} + 2 : biased;
            const RegisterMask exponent = below > 2044 ? RegisterMask{} + 2044 : below;
            return Register((1023 + sign * (exponent - 1023)) << 52);
        },
        v);
}
// The root and its inverse of normal numbers above zero.
template <class V>
inline void find_roots(V v, V* root, V* inverse_root) {
#if defined(__AVX512F__)
    *inverse_root = yasps::inverse_root(v);
    *root = v * *inverse_root;
#else
    *root = square_root(v);
    *inverse_root = *root * inverse(v);
#endif
}
inline long largest_of(RegisterMask v) {
    long largest = v[0];
    for (int lane = 1; lane < kRegisterLanes; ++lane) largest = v[lane] > largest ? v[lane] : largest;
    return largest;
}
template <class M>
inline long largest_of(Pair<M> v) {
    return largest_of(each([](RegisterMask a, RegisterMask b) { return a > b ? a : b; }, v.first, v.second));
}
// One bit a lane.
inline unsigned bits_of(RegisterMask mask) {
#if defined(__AVX512DQ__)
    typedef long long Quads __attribute__((vector_size(64)));
    return static_cast<unsigned char>(__builtin_ia32_cvtq2mask512(reinterpret_cast<Quads>(mask)));
#elif defined(__AVX__) && !defined(__AVX512F__)
    return static_cast<unsigned>(__builtin_ia32_movmskpd256(reinterpret_cast<Register>(mask)));
#elif defined(__SSE2__) && !defined(__AVX__)
    return static_cast<unsigned>(__builtin_ia32_movmskpd(reinterpret_cast<Register>(mask)));
#else
    unsigned bits = 0;
    for (int lane = 0; lane < kRegisterLanes; ++lane) bits |= static_cast<unsigned>(mask[lane] & 1) << lane;
    return bits;
#endif
}
template <class M>
inline unsigned bits_of(Pair<M> mask) {
    return bits_of(mask.first) | bits_of(mask.second) << (sizeof(M) / 8);
}
template <class M>
inline bool any(M mask) {
    return bits_of(mask) != 0;
}
// The lanes whose bits are set.
inline void mask_lanes(unsigned bits, RegisterMask* to) {
    RegisterMask bit;
    for (int lane = 0; lane < kRegisterLanes; ++lane) bit[lane] = 1L << lane;
    *to = (bit & static_cast<long>(bits)) != 0;
}
template <class M>
inline void mask_lanes(unsigned bits, Pair<M>* to) {
    mask_lanes(bits, &to->first);
    mask_lanes(bits >> (sizeof(M) / 8), &to->second);
}
typedef double UnalignedRegister __attribute__((vector_size(kRegister), aligned(8)));
inline void load_lanes(const double* from, Register* to) { *to = *reinterpret_cast<const UnalignedRegister*>(from); }
template <class T>
inline void load_lanes(const double* from, Pair<T>* to) {
    load_lanes(from, &to->first);
    load_lanes(from + sizeof(T) / 8, &to->second);
}
inline void store_lanes(double* to, Register v) { *reinterpret_cast<UnalignedRegister*>(to) = v; }
template <class T>
inline void store_lanes(double* to, Pair<T> v) {
    store_lanes(to, v.first);
    store_lanes(to + sizeof(T) / 8, v.second);
}

}  // namespace yasps
