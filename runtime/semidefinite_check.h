// Finds the few matrices of many that are not positive semidefinite, and hands them on sixteen at a time.
//
// Most matrices of a simulation are semidefinite, and an LDL^T factorisation of eight at once finds out at a fraction
// of the cost of a decomposition. Matrices that fail are collected from all packs, so that decomposing them keeps the
// lanes of two vectors busy.
#pragma once

#include <float.h>

namespace yasps {
namespace {

constexpr int kLanes = kYaspsLanes;
constexpr int kCollected = 2 * kLanes;  // matrices that are decomposed at once

enum Mode { kClamp = 0, kAbsolute = 1, kLeave = 2 };

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
        const d8 inverse = 1.0 / pivot;
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

// Bit set of lanes with an entry that is not finite.
inline unsigned not_finite_lanes(const d8_unaligned* a, long entries) {
    l8 finite = ~l8{};
    for (long k = 0; k < entries; ++k) finite &= size_of(a[k]) <= DBL_MAX;
    return bits_of_eight(~finite);
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

// Failing lanes of one pack, and the slots of one half of the collected where they are decomposed, in the same order.
struct Run {
    long pack;
    int half;
    unsigned lanes, slots;
};
// Matrices drawn from several packs. They stay in their packs until sixteen are known.
struct Collected {
    double* matrices;    // [entries, kCollected]
    double* sizes;       // [kCollected]: sum of the absolute values of the triangle
    double* companions;  // [companions, kCollected]
    int count, run_count;
    Run runs[kCollected];
};
inline long collected_size(const Packs& packs) { return (packs.entries() + 1 + packs.companions) * kCollected; }

// Notes the lowest lanes that there is room for; returns the others.
inline unsigned collect(long pack, unsigned lanes, Collected* c) {
    while (lanes != 0 && c->count < kCollected) {
        const int first = c->count % kLanes, failed = __builtin_popcount(lanes);
        const int taken = failed < kLanes - first ? failed : kLanes - first;
        unsigned left = 0;
        if (taken < failed) {
            left = lanes;
            for (int k = 0; k < taken; ++k) left &= left - 1;
        }
        Run& run = c->runs[c->run_count++];
        run.pack = pack;
        run.half = c->count / kLanes;
        run.lanes = lanes ^ left;
        run.slots = ((1u << taken) - 1) << first;
        c->count += taken;
        lanes = left;
    }
    return lanes;
}

constexpr int kHalves = kCollected / kLanes;
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
inline void gather(const Run& run, const d8_unaligned* from, long rows, double* to) {
    const l8 slots = mask_of(run.slots), lane_of = matching_lanes(run.lanes, run.slots);
    d8* const row = reinterpret_cast<d8*>(to) + run.half;
    if (run.slots & 1)
#pragma GCC unroll 5
        for (long k = 0; k < rows; ++k) row[k * kHalves] = slots ? __builtin_shuffle(from[k], lane_of) : d8{};
    else
#pragma GCC unroll 5
        for (long k = 0; k < rows; ++k)
            row[k * kHalves] = slots ? __builtin_shuffle(from[k], lane_of) : row[k * kHalves];
}
// The other way round.
inline void scatter(const Run& run, const double* from, long rows, d8_unaligned* to) {
    const l8 lanes = mask_of(run.lanes), slot_of = matching_lanes(run.slots, run.lanes);
    const d8* const row = reinterpret_cast<const d8*>(from) + run.half;
#pragma GCC unroll 5
    for (long k = 0; k < rows; ++k) to[k] = lanes ? __builtin_shuffle(row[k * kHalves], slot_of) : to[k];
}
#else
template <class Copy>
inline void for_lanes(const Run& run, const Copy& copy) {
    for (unsigned lanes = run.lanes, slots = run.slots; lanes != 0; lanes &= lanes - 1, slots &= slots - 1)
        copy(__builtin_ctz(lanes), run.half * kLanes + __builtin_ctz(slots));
}
inline void gather(const Run& run, const d8_unaligned* from, long rows, double* to) {
    for (long k = 0; k < rows && run.slots & 1; ++k) reinterpret_cast<d8*>(to)[k * kHalves + run.half] = d8{};
    for_lanes(run, [from, rows, to](int lane, int slot) {
        for (long k = 0; k < rows; ++k) to[k * kCollected + slot] = from[k][lane];
    });
}
inline void scatter(const Run& run, const double* from, long rows, d8_unaligned* to) {
    for_lanes(run, [from, rows, to](int lane, int slot) {
        for (long k = 0; k < rows; ++k) to[k][lane] = from[k * kCollected + slot];
    });
}
#endif

// The sum of the absolute values of all entries of eight triangles.
inline d8 sizes_of(const double* triangles, long entries) {
    const d8* const row = reinterpret_cast<const d8*>(triangles);
    d8 sums[4] = {};
    long k = 0;
    for (; k + 3 < entries; k += 4)
#pragma GCC unroll 4
        for (int i = 0; i < 4; ++i) sums[i] += size_of(row[(k + i) * kHalves]);
    for (; k < entries; ++k) sums[0] += size_of(row[k * kHalves]);
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

// -(1 + matrix) for the first of the collected with an entry that is not finite, or 0.
inline long find_not_finite(const Packs& packs, const Collected& c) {
    for (int r = 0; r < c.run_count; ++r) {
        const Run& run = c.runs[r];
        const unsigned lanes = not_finite_lanes(packs.pack(run.pack), packs.entries()) & run.lanes;
        if (lanes != 0) return -(1 + run.pack * kLanes + __builtin_ctz(lanes));
    }
    return 0;
}

// Decomposes what has been collected and puts it back. Returns the number changed or -(1 + matrix).
template <class Decompose>
long flush(const Packs& packs, Collected* c, const Decompose& decompose) {
    for (int r = 0; r < c->run_count; ++r) {
        const Run& run = c->runs[r];
        gather(run, packs.pack(run.pack), packs.entries(), c->matrices);
        gather(run, packs.companions_of(run.pack), packs.companions, c->companions);
    }
    const int halves = c->count > kLanes ? 2 : 1;
    for (int half = 0; half < kHalves; ++half) {
        d8 sizes = {};
        if (half < halves) sizes = sizes_of(c->matrices + half * kLanes, packs.entries());
        reinterpret_cast<d8*>(c->sizes)[half] = sizes;
        const long not_finite = bits_of_eight(~(sizes <= DBL_MAX)) == 0 ? 0 : find_not_finite(packs, *c);
        if (not_finite != 0) return not_finite;
        // Matrices of a half without any are not looked at, but what comes with them is.
        for (long k = 0; k < packs.companions && half >= halves; ++k)
            reinterpret_cast<d8*>(c->companions)[k * kHalves + half] = d8{};
    }
    const NegativePart result = decompose(*c, halves);
    for (int r = 0; r < c->run_count; ++r) {
        const Run& run = c->runs[r];
        const unsigned unfinished = result.unfinished >> run.half * kLanes & run.slots;
        for (unsigned lanes = run.lanes, slots = run.slots; unfinished != 0; lanes &= lanes - 1, slots &= slots - 1)
            if (unfinished & slots & -slots) return -(1 + run.pack * kLanes + __builtin_ctz(lanes));
        scatter(run, c->matrices, packs.entries(), packs.pack(run.pack));
    }
    c->count = c->run_count = 0;
    return __builtin_popcount(result.changed);
}

// Calls decompose(Collected, packs) -> NegativePart for the matrices that fail the check; what it leaves in their
// places is put back. memory: collected_size, aligned to 64 bytes, and work for the triangles of a pack where kWidth is
// zero. Returns the number of matrices changed or -(1 + matrix) for one that is not finite or not finished.
template <int kWidth, class Decompose>
long project_failing(const Packs& packs, double* memory, bool leave, const Decompose& decompose) {
    Collected collected;
    collected.matrices = memory;
    collected.sizes = memory + packs.entries() * kCollected;
    collected.companions = collected.sizes + kCollected;
    collected.count = collected.run_count = 0;
    d8* const work = reinterpret_cast<d8*>(memory + collected_size(packs));
    long changed = 0;
    for (long pack = 0; pack * kLanes < packs.matrices; ++pack) {
        const long rest = packs.matrices - pack * kLanes;
        const unsigned valid = rest < kLanes ? (1u << rest) - 1 : 255u;
        const Check check = check_pack<kWidth>(packs.pack(pack), packs.n, work);
        // Near the ends of the number range the factorisation overflows; there the eigenvalues decide, after scaling.
        const l8 safe = (check.trace < 1e290) & ((check.trace > 1e-290) | (check.trace == 0.0));
        unsigned failed = bits_of_eight(~(check.passed & safe)) & valid;
        if (failed == 0) continue;
        if (leave) {
            const unsigned not_finite = not_finite_lanes(packs.pack(pack), packs.entries()) & failed;
            if (not_finite != 0) return -(1 + pack * kLanes + __builtin_ctz(not_finite));
            continue;
        }
        while (failed != 0) {
            failed = collect(pack, failed, &collected);
            if (collected.count < kCollected) continue;
            const long result = flush(packs, &collected, decompose);
            if (result < 0) return result;
            changed += result;
        }
    }
    if (collected.count == 0) return changed;
    const long result = flush(packs, &collected, decompose);
    return result < 0 ? result : changed + result;
}

}  // namespace
}  // namespace yasps
