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
constexpr int kCollected = 2 * kLanes;        // matrices that are decomposed at once
constexpr int kStride = kCollected + kLanes;  // with room for a store of eight behind the last

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
    d8 sum;     // of the absolute values of all entries of the triangle; not finite where one is not
    l8 passed;  // the matrix plus the shift has an LDL^T factorisation with a positive D
};

// Checks a pack. kWidth is the width, or zero for any: `n`, with `work` for n (n + 1) / 2 entries. Widths of common
// energies are unrolled, so that most of the triangle stays in registers.
template <int kWidth>
inline Check check_pack(const d8_unaligned* a, int any_width, d8* work) {
    const int n = kWidth > 0 ? kWidth : any_width;
    d8 unrolled[kWidth > 0 ? kWidth * (kWidth + 1) / 2 : 1];
    d8* row = kWidth > 0 ? unrolled : work;
    Check check = {d8{}, ~l8{}};
    d8 trace = {};
#pragma GCC unroll 16
    for (int i = 0, k = 0; i < n; ++i) {
        trace += size_of(row[k] = a[k]);
        ++k;
#pragma GCC unroll 16
        for (int j = i + 1; j < n; ++j, ++k) check.sum += size_of(row[k] = a[k]);
    }
    check.sum += trace;
    // The absolute part lets a zero matrix pass.
    const d8 shift = trace * kProjectionShift + DBL_MIN;
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

#ifdef __AVX512F__
inline d8 compress(d8 v, unsigned lanes) {
    return __builtin_ia32_compressdf512_mask(v, d8{}, static_cast<unsigned char>(lanes));
}
inline d8 expand(d8 v, d8 others, unsigned lanes) {
    return __builtin_ia32_expanddf512_mask(v, others, static_cast<unsigned char>(lanes));
}
#else
inline d8 compress(d8 v, unsigned lanes) {
    d8 packed = {};
    for (int lane = 0, slot = 0; lane < kLanes; ++lane)
        if (lanes >> lane & 1) packed[slot++] = v[lane];
    return packed;
}
inline d8 expand(d8 v, d8 others, unsigned lanes) {
    for (int lane = 0, slot = 0; lane < kLanes; ++lane)
        if (lanes >> lane & 1) others[lane] = v[slot++];
    return others;
}
#endif

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

// Matrices drawn from several packs. Those of one pack are a run: in slots from `slot` on, in the order of its lanes.
struct Run {
    long pack;
    unsigned lanes;
    int slot;
};
struct Collected {
    double* matrices;    // [entries, kStride], the first kCollected of a row are used
    double* sizes;       // [kStride]: sum of the absolute values of the triangle
    double* companions;  // [companions, kStride]
    int count, run_count;
    Run runs[kCollected];
};
inline long collected_size(const Packs& packs) { return (packs.entries() + 1 + packs.companions) * kStride; }

inline void collect_rows(const d8_unaligned* from, long rows, unsigned lanes, double* to) {
    for (long k = 0; k < rows; ++k) *reinterpret_cast<d8_unaligned*>(to + k * kStride) = compress(from[k], lanes);
}

// Adds the lowest lanes that there is room for; returns the others.
inline unsigned collect(const Packs& packs, long pack, unsigned lanes, d8 sizes, Collected* c) {
    unsigned left = lanes;
    int taken = 0;
    for (; left != 0 && c->count + taken < kCollected; ++taken) left &= left - 1;
    collect_rows(packs.pack(pack), packs.entries(), lanes ^ left, c->matrices + c->count);
    collect_rows(packs.companions_of(pack), packs.companions, lanes ^ left, c->companions + c->count);
    *reinterpret_cast<d8_unaligned*>(c->sizes + c->count) = compress(sizes, lanes ^ left);
    c->runs[c->run_count++] = {pack, lanes ^ left, c->count};
    c->count += taken;
    return left;
}

// Decomposes what has been collected and puts it back. Returns the number changed or -(1 + matrix).
template <class Decompose>
long flush(const Packs& packs, Collected* c, const Decompose& decompose) {
    const long rows = packs.entries() + 1 + packs.companions;
    // Lanes to spare are done at once as zero matrices.
    for (int slot = c->count; slot < kCollected; ++slot)
        for (long k = 0; k < rows; ++k) c->matrices[k * kStride + slot] = 0.0;
    const NegativePart result = decompose(*c, c->count > kLanes ? 2 : 1);
    for (int r = 0; r < c->run_count; ++r) {
        const Run run = c->runs[r];
        for (unsigned lanes = run.lanes, slot = run.slot; lanes != 0; lanes &= lanes - 1, ++slot)
            if (result.unfinished >> slot & 1) return -(1 + run.pack * kLanes + __builtin_ctz(lanes));
        d8_unaligned* const to = packs.pack(run.pack);
        const double* const from = c->matrices + run.slot;
        for (long k = 0; k < packs.entries(); ++k)
            to[k] = expand(*reinterpret_cast<const d8_unaligned*>(from + k * kStride), to[k], run.lanes);
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
    collected.sizes = memory + packs.entries() * kStride;
    collected.companions = collected.sizes + kStride;
    collected.count = collected.run_count = 0;
    d8* const work = reinterpret_cast<d8*>(memory + collected_size(packs));
    long changed = 0;
    for (long pack = 0; pack * kLanes < packs.matrices; ++pack) {
        const long rest = packs.matrices - pack * kLanes;
        const unsigned valid = rest < kLanes ? (1u << rest) - 1 : 255u;
        const Check check = check_pack<kWidth>(packs.pack(pack), packs.n, work);
        // Near the ends of the number range the factorisation overflows; there the eigenvalues decide, after scaling.
        const l8 safe = (check.sum < 1e290) & ((check.sum > 1e-290) | (check.sum == 0.0));
        unsigned failed = bits_of_eight(~(check.passed & safe)) & valid;
        if (failed == 0) continue;
        if (bits_of_eight(~(check.sum < DBL_MAX)) & valid) {
            const unsigned not_finite = not_finite_lanes(packs.pack(pack), packs.entries()) & valid;
            if (not_finite != 0) return -(1 + pack * kLanes + __builtin_ctz(not_finite));
        }
        if (leave) continue;
        while (failed != 0) {
            failed = collect(packs, pack, failed, check.sum, &collected);
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
