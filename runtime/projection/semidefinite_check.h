// Finds the few matrices of many that are not positive semidefinite, and hands them on sixteen at a time.
//
// Most matrices of a simulation are semidefinite, and an LDL^T factorisation of eight at once finds out at a fraction
// of the cost of a decomposition. Matrices that fail are collected from all packs, so that decomposing them keeps the
// lanes of two vectors busy. Packs of which nearly all lanes fail can be decomposed as they are.
#pragma once

#include <float.h>

#include "core/vectors.h"
#include "projection/cone.h"

namespace yasps {
namespace {

constexpr int kLanes = kYaspsLanes;
constexpr int kCollected = 2 * kLanes;  // matrices that are decomposed at once

inline d8 size_of(d8 v) { return reinterpret_cast<d8>(reinterpret_cast<l8>(v) & INT64_MAX); }

typedef long long quads __attribute__((vector_size(64)));

// One bit a lane.
inline unsigned bits_of_eight(l8 mask) {
#ifdef __AVX512DQ__
    return static_cast<unsigned char>(__builtin_ia32_cvtq2mask512(reinterpret_cast<quads>(mask)));
#else
    unsigned bits = 0;
    for (int lane = 0; lane < kLanes; ++lane) bits |= static_cast<unsigned>(mask[lane] & 1) << lane;
    return bits;
#endif
}

// 1 / v. What is near the ends of the number range may become NaN, which then fails the check.
inline d8 over(d8 v) {
#ifdef __AVX512F__
    return reciprocal(v);
#else
    return 1.0 / v;
#endif
}

struct Check {
    d8 trace;   // of the absolute values
    l8 passed;  // the matrix plus the shift has an LDL^T factorisation with a positive D; not where one is not finite
};

// Checks a pack. kWidth is the width, or zero for any: `n`, with `work` for n (n + 1) / 2 entries. Widths of common
// energies are unrolled, so that most of the triangle stays in registers.
template <int kWidth>
inline Check check_pack(const d8_unaligned* a, int any_width, d8* work) {
    const int n = kWidth > 0 ? kWidth : any_width;
    d8 unrolled[kWidth > 0 ? kWidth * (kWidth + 1) / 2 : 1];
    d8* row = kWidth > 0 ? unrolled : work;
    Check check = {d8{}, ~l8{}};
#pragma GCC unroll 16
    for (int i = 0, k = 0; i < n; ++i) {
        check.trace += size_of(row[k] = a[k]);
        ++k;
#pragma GCC unroll 16
        for (int j = i + 1; j < n; ++j, ++k) row[k] = a[k];
    }
    // The absolute part lets a zero matrix pass.
    const d8 shift = check.trace * kProjectionShift + DBL_MIN;
#pragma GCC unroll 16
    for (int i = 0, k = 0; i < n; k += n - i, ++i) row[k] += shift;
#pragma GCC unroll 16
    for (int left = n; left > 0; --left) {
        const d8 pivot = row[0];
        check.passed &= pivot > 0.0;
        const d8 inverse = over(pivot);
        d8* below = row + left;
#pragma GCC unroll 16
        for (int i = 1; i < left; ++i) {
            const d8 factor = row[i] * inverse;
#pragma GCC unroll 16
            for (int j = i; j < left; ++j) below[j - i] -= factor * row[j];
            below += left - i;
        }
        row += left;
    }
    return check;
}

// Bit set of lanes that do not pass. Near the ends of the number range the factorisation overflows, and none does:
// there the eigenvalues decide, after scaling.
inline unsigned failing_lanes(const Check& check) {
    const l8 safe = (check.trace < kLargestSum) & ((check.trace > kSmallestSum) | (check.trace == 0.0));
    return bits_of_eight(~(check.passed & safe));
}

// Bit set of lanes with an entry that is not finite; entries follow each other kRow vectors apart.
template <int kRow = 1>
inline unsigned not_finite_lanes(const d8_unaligned* a, long entries) {
    d8 zeros[2] = {};
    for (long k = 0; k < entries; ++k) zeros[k & 1] += a[k * kRow] * 0.0;
    return bits_of_eight(~((zeros[0] + zeros[1]) == 0.0));
}

// Packs of symmetric matrices of width n, and `companions` numbers for each of them.
struct Packs {
    double* packed;           // [packs, n (n + 1) / 2, kLanes]
    const double* companion;  // [packs, companions, kLanes]
    int n, companions;
    long matrices;

    long entries() const { return static_cast<long>(n) * (n + 1) / 2; }
    d8_unaligned* pack(long index) const {
        return reinterpret_cast<d8_unaligned*>(packed + index * entries() * kLanes);
    }
    const d8_unaligned* companions_of(long index) const {
        return reinterpret_cast<const d8_unaligned*>(companion + index * companions * kLanes);
    }
};

// Failing lanes of one pack, and the slots of a half where they are decomposed, in the same order.
struct Run {
    long pack;
    unsigned lanes, slots;
};
// Eight matrices that are decomposed together: a pack as it lies there, or drawn from several, which stay in their
// packs until it is their turn.
struct Half {
    bool in_place;
    int count, run_count;
    Run runs[kLanes];
};
constexpr int kHalves = 2;  // that are decomposed together
// A pack is decomposed in place if at least so many lanes fail: to draw them together costs more than idle lanes.
constexpr int kMostLanes = 6;

// What is decomposed at once.
struct Group {
    double* matrices[kHalves];          // entries follow each other kRow vectors apart
    const double* companions[kHalves];  // entries follow each other
    int halves;                         // with matrices
    unsigned lanes;                     // bits of the matrices; what other lanes hold stays as it is
};

// Notes the lowest lanes that there is room for; returns the others.
inline unsigned collect(long pack, unsigned lanes, Half* half) {
    const int failed = __builtin_popcount(lanes), first = half->count;
    const int taken = failed < kLanes - first ? failed : kLanes - first;
    unsigned left = 0;
    if (taken < failed) {
        left = lanes;
        for (int k = 0; k < taken; ++k) left &= left - 1;
    }
    half->runs[half->run_count++] = {pack, lanes ^ left, ((1u << taken) - 1) << first};
    half->count += taken;
    return left;
}

#if defined(__AVX512F__) && !defined(__clang__)
inline l8 mask_of(unsigned lanes) {
    const l8 bit = {1, 2, 4, 8, 16, 32, 64, 128};
    return (bit & static_cast<long>(lanes)) != 0;
}

// For each lane of `to`, in ascending order, the next lane of `from`.
inline l8 matching_lanes(unsigned from, unsigned to) {
    const quads all = {0, 1, 2, 3, 4, 5, 6, 7};
    const quads packed = __builtin_ia32_compressdi512_mask(all, quads{}, static_cast<unsigned char>(from));
    return reinterpret_cast<l8>(__builtin_ia32_expanddi512_mask(packed, quads{}, static_cast<unsigned char>(to)));
}

// Copies the lanes of a run to their slots. The first run of a half leaves zeros in the slots that no other fills.
template <int kRow>
inline void gather(const Run& run, const d8_unaligned* from, long rows, double* to) {
    const l8 slots = mask_of(run.slots), lane_of = matching_lanes(run.lanes, run.slots);
    d8* const row = reinterpret_cast<d8*>(to);
    if (run.slots & 1)
#pragma GCC unroll 5
        for (long k = 0; k < rows; ++k) row[k * kRow] = slots ? __builtin_shuffle(from[k], lane_of) : d8{};
    else
#pragma GCC unroll 5
        for (long k = 0; k < rows; ++k) row[k * kRow] = slots ? __builtin_shuffle(from[k], lane_of) : row[k * kRow];
}
// The other way round.
template <int kRow>
inline void scatter(const Run& run, const double* from, long rows, d8_unaligned* to) {
    const l8 lanes = mask_of(run.lanes), slot_of = matching_lanes(run.slots, run.lanes);
    const d8* const row = reinterpret_cast<const d8*>(from);
#pragma GCC unroll 5
    for (long k = 0; k < rows; ++k) to[k] = lanes ? __builtin_shuffle(row[k * kRow], slot_of) : to[k];
}
#else
template <class Copy>
inline void for_lanes(const Run& run, const Copy& copy) {
    for (unsigned lanes = run.lanes, slots = run.slots; lanes != 0; lanes &= lanes - 1, slots &= slots - 1)
        copy(__builtin_ctz(lanes), __builtin_ctz(slots));
}
template <int kRow>
inline void gather(const Run& run, const d8_unaligned* from, long rows, double* to) {
    for (long k = 0; k < rows && run.slots & 1; ++k) reinterpret_cast<d8*>(to)[k * kRow] = d8{};
    for_lanes(run, [from, rows, to](int lane, int slot) {
        for (long k = 0; k < rows; ++k) to[k * kRow * kLanes + slot] = from[k][lane];
    });
}
template <int kRow>
inline void scatter(const Run& run, const double* from, long rows, d8_unaligned* to) {
    for_lanes(run, [from, rows, to](int lane, int slot) {
        for (long k = 0; k < rows; ++k) to[k][lane] = from[k * kRow * kLanes + slot];
    });
}
#endif

// The sums of the absolute values of all entries of triangles whose halves interleave. Returns bits of lanes
// with an entry that is not finite; the sum of finite ones may overflow.
inline unsigned sizes_of(const double* triangles, long entries, int halves, double* sizes) {
    const d8_unaligned* const row = reinterpret_cast<const d8_unaligned*>(triangles);
    unsigned not_finite = 0;
    for (int half = 0; half < halves; ++half) {
        d8 sums[4] = {};
        long k = 0;
        for (; k + 3 < entries; k += 4)
#pragma GCC unroll 4
            for (int i = 0; i < 4; ++i) sums[i] += size_of(row[(k + i) * kHalves + half]);
        for (; k < entries; ++k) sums[0] += size_of(row[k * kHalves + half]);
        const d8 size = (sums[0] + sums[1]) + (sums[2] + sums[3]);
        reinterpret_cast<d8*>(sizes)[half] = size;
        if (bits_of_eight(~(size <= DBL_MAX)) != 0)
            not_finite |= not_finite_lanes<kHalves>(row + half, entries) << half * kLanes;
    }
    return not_finite;
}

// Matrices that wait to be decomposed.
struct Waiting {
    Half halves[kHalves + 1];  // full ones, of which there are full_count; and one with room for more
    Half* full[kHalves];
    Half* open;
    int full_count;
    double* memory;  // see memory_size
};
inline void clear(Half* half) { half->in_place = false, half->count = half->run_count = 0; }
inline void start(Waiting* waiting) {
    for (int k = 0; k < kHalves; ++k) waiting->full[k] = waiting->halves + k;
    waiting->open = waiting->halves + kHalves;
    waiting->full_count = 0;
    clear(waiting->open);
}
// What is open counts as full from now on.
inline void take_open(Waiting* waiting) {
    Half* const open = waiting->open;
    waiting->open = waiting->full[waiting->full_count];
    waiting->full[waiting->full_count++] = open;
    clear(waiting->open);
}

// The matrix to be reported when `unfinished` slots of what is full could not be decomposed: the first that is not
// finite, if there is one.
__attribute__((noinline)) inline long find_unfinished(const Packs& packs, const Waiting& waiting, unsigned unfinished) {
    long not_finite = -1, first = -1;
    for (int h = 0; h <= waiting.full_count; ++h) {
        const Half& half = h < waiting.full_count ? *waiting.full[h] : *waiting.open;
        for (int r = 0; r < half.run_count; ++r) {
            const Run& run = half.runs[r];
            const unsigned bad = not_finite_lanes(packs.pack(run.pack), packs.entries()) & run.lanes;
            const long matrix = run.pack * kLanes + (bad != 0 ? __builtin_ctz(bad) : 0);
            if (bad != 0 && (not_finite < 0 || matrix < not_finite)) not_finite = matrix;
            unsigned lanes = run.lanes, slots = h < waiting.full_count ? run.slots : 0;
            for (; slots != 0; lanes &= lanes - 1, slots &= slots - 1)
                if (first < 0 && unfinished >> h * kLanes & slots & -slots)
                    first = run.pack * kLanes + __builtin_ctz(lanes);
        }
    }
    return not_finite >= 0 ? not_finite : first;
}

// Doubles of memory for matrices that are decomposed and what comes with them.
inline long memory_size(const Packs& packs) { return (packs.entries() + packs.companions) * kCollected; }

// Decomposes what is full and puts it back. Returns the number changed or -(1 + matrix).
template <int kRow, class Decompose>
long flush(const Packs& packs, Waiting* waiting, const Decompose& decompose) {
    Group group = {};
    group.halves = waiting->full_count;
    for (int h = 0; h < waiting->full_count; ++h) {
        const Half& half = *waiting->full[h];
        if (half.in_place) {
            const Run& run = half.runs[0];
            group.lanes |= run.lanes << h * kLanes;
            group.matrices[h] = reinterpret_cast<double*>(packs.pack(run.pack));
            group.companions[h] = reinterpret_cast<const double*>(packs.companions_of(run.pack));
            continue;
        }
        double* const matrices = waiting->memory + h * kLanes * (kRow == kHalves ? 1 : packs.entries());
        double* const companions = waiting->memory + (packs.entries() * kHalves + packs.companions * h) * kLanes;
        for (int r = 0; r < half.run_count; ++r) {
            const Run& run = half.runs[r];
            gather<kRow>(run, packs.pack(run.pack), packs.entries(), matrices);
            gather<1>(run, packs.companions_of(run.pack), packs.companions, companions);
        }
        group.lanes |= ((1u << half.count) - 1) << h * kLanes;
        group.matrices[h] = matrices;
        group.companions[h] = companions;
    }
    const NegativePart result = decompose(group);
    if (result.unfinished != 0) return -(1 + find_unfinished(packs, *waiting, result.unfinished));
    for (int h = 0; h < waiting->full_count; ++h) {
        const Half& half = *waiting->full[h];
        for (int r = 0; r < half.run_count && !half.in_place; ++r)
            scatter<kRow>(half.runs[r], group.matrices[h], packs.entries(), packs.pack(half.runs[r].pack));
    }
    waiting->full_count = 0;
    return __builtin_popcount(result.changed);
}

// Calls decompose(Group) -> NegativePart for the matrices that fail the check; what it leaves in their places is put
// back. Where packs are decomposed in place and nearly all of one group had to be, the next is not checked: decompose
// leaves semidefinite matrices as they are. kRow: 2 if the halves of a group shall interleave; 1 if each is by itself,
// so that a pack can be one. memory: memory_size, aligned to 64 bytes, and work for the triangles of a pack where
// kWidth is zero. Returns the number of matrices changed or -(1 + matrix) for one that is not finite or not finished.
template <int kWidth, int kRow, class Decompose>
long project_failing(const Packs& packs, double* memory, bool leave, const Decompose& decompose) {
    Waiting waiting;
    waiting.memory = memory;
    start(&waiting);
    d8* const work = reinterpret_cast<d8*>(memory + memory_size(packs));
    long changed = 0;
    bool expect_failure = false;
    for (long pack = 0; pack * kLanes < packs.matrices; ++pack) {
        const long rest = packs.matrices - pack * kLanes;
        const unsigned valid = rest < kLanes ? (1u << rest) - 1 : 255u;
        unsigned failed = valid;
        const bool unchecked = expect_failure && valid == 255u;
        if (leave) {
            const unsigned not_finite = not_finite_lanes(packs.pack(pack), packs.entries()) & valid;
            if (not_finite != 0) return -(1 + pack * kLanes + __builtin_ctz(not_finite));
            continue;
        }
        if (!unchecked) failed &= failing_lanes(check_pack<kWidth>(packs.pack(pack), packs.n, work));
        if (failed == 0) continue;
        const bool in_place = kRow == 1 && valid == 255u && __builtin_popcount(failed) >= kMostLanes;
        while (failed != 0) {
            if (in_place) {
                Half* const full = waiting.full[waiting.full_count];
                full->in_place = true;
                full->run_count = 1;
                full->runs[0] = {pack, failed, failed};
                failed = 0;
                ++waiting.full_count;
            } else {
                failed = collect(pack, failed, waiting.open);
                if (waiting.open->count < kLanes) continue;
                take_open(&waiting);
            }
            if (waiting.full_count < kHalves) continue;
            const bool both_in_place = waiting.full[0]->in_place && waiting.full[1]->in_place;
            const long result = flush<kRow>(packs, &waiting, decompose);
            if (result < 0) return result;
            expect_failure = both_in_place && result >= kHalves * kMostLanes;
            changed += result;
        }
    }
    if (waiting.open->count != 0) take_open(&waiting);
    if (waiting.full_count == 0) return changed;
    const long result = flush<kRow>(packs, &waiting, decompose);
    return result < 0 ? result : changed + result;
}

}  // namespace
}  // namespace yasps
