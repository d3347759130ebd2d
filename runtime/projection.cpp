// Projection of small symmetric matrices onto the positive semidefinite cone.
//
// Most matrices of a simulation are already semidefinite, and an LDL^T factorisation of eight at once finds out at a
// fraction of the cost of their eigenvalues. Matrices that fail are collected from all packs, so that decomposing them
// (negative_part.cpp) keeps the lanes of two vectors busy.
#include <float.h>

#include "runtime.h"

namespace yasps {
namespace {

constexpr int kLanes = kYaspsLanes;
constexpr int kCollected = 2 * kLanes;        // matrices that are decomposed at once
constexpr int kStride = kCollected + kLanes;  // with room for a store of eight behind the last
// The most scratch, in bytes, that lies on the stack; width 15 needs no more.
constexpr long kLargestStack = 1 << 18;

enum Mode { kClamp = 0, kAbsolute = 1, kLeave = 2 };

inline d8 magnitude(d8 v) { return reinterpret_cast<d8>(reinterpret_cast<l8>(v) & INT64_MAX); }

typedef long long quads __attribute__((vector_size(64)));

// One bit a lane.
inline unsigned bits_of(l8 mask) {
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

inline d8 shift_of(d8 trace) {
    // The absolute part lets a zero matrix pass.
    return trace * kProjectionShift + DBL_MIN;
}

// Checks a pack of width n; `row` is memory for n (n + 1) / 2 entries.
Check check_any(const d8_unaligned* a, int n, d8* row) {
    Check check = {d8{}, ~l8{}};
    d8 trace = {};
    for (int k = 0; k < n * (n + 1) / 2; ++k) check.sum += magnitude(row[k] = a[k]);
    for (int i = 0, k = 0; i < n; k += n - i, ++i) trace += magnitude(a[k]);
    for (int i = 0, k = 0; i < n; k += n - i, ++i) row[k] += shift_of(trace);
    for (int left = n; left > 0; row += left, --left) {
        check.passed &= row[0] > 0.0;
        const d8 inverse = 1.0 / row[0];
        d8* below = row + left;
        for (int i = 1; i < left; below += left - i, ++i) {
            const d8 factor = row[i] * inverse;
            for (int j = i; j < left; ++j) below[j - i] -= factor * row[j];
        }
    }
    return check;
}

// The same for a width known here: unrolled, with most of the triangle in registers, it takes a third of the time.
template <int n>
Check check_unrolled(const d8_unaligned* a) {
    d8 triangle[n * (n + 1) / 2];
    d8* row = triangle;
    Check check = {d8{}, ~l8{}};
    d8 trace = {};
#pragma GCC unroll 100
    for (int k = 0; k < n * (n + 1) / 2; ++k) check.sum += magnitude(row[k] = a[k]);
#pragma GCC unroll 16
    for (int i = 0, k = 0; i < n; k += n - i, ++i) trace += magnitude(a[k]);
#pragma GCC unroll 16
    for (int i = 0, k = 0; i < n; k += n - i, ++i) row[k] += shift_of(trace);
#pragma GCC unroll 16
    for (int left = n; left > 0; --left) {
        check.passed &= row[0] > 0.0;
        const d8 inverse = 1.0 / row[0];
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

Check check_pack(const d8_unaligned* a, int n, d8* work) {
    switch (n) {
        case 3:
            return check_unrolled<3>(a);
        case 6:
            return check_unrolled<6>(a);
        case 9:
            return check_unrolled<9>(a);
        case 12:
            return check_unrolled<12>(a);
        default:
            return check_any(a, n, work);
    }
}

// Bit set of lanes with an entry that is not finite.
unsigned not_finite_lanes(const d8_unaligned* a, long entries) {
    l8 finite = ~l8{};
    for (long k = 0; k < entries; ++k) finite &= magnitude(a[k]) <= DBL_MAX;
    return bits_of(~finite);
}

// Matrices drawn from several packs. Those of one pack are a run: in slots from `slot` on, in the order of its lanes.
struct Run {
    long pack;
    unsigned lanes;
    int slot;
};
struct Collected {
    double* matrices;  // [entries, kStride], the first kCollected of a row are used
    double* sizes;     // [kStride]: sum of the absolute values of the triangle
    int count, run_count;
    Run runs[kCollected];
};

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

// Adds the lowest lanes that there is room for; returns the others.
unsigned collect(const double* packed, long pack, long entries, unsigned lanes, d8 sizes, Collected* c) {
    unsigned left = lanes;
    int taken = 0;
    for (; left != 0 && c->count + taken < kCollected; ++taken) left &= left - 1;
    const d8_unaligned* const from = reinterpret_cast<const d8_unaligned*>(packed + pack * entries * kLanes);
    double* const to = c->matrices + c->count;
    for (long k = 0; k < entries; ++k)
        *reinterpret_cast<d8_unaligned*>(to + k * kStride) = compress(from[k], lanes ^ left);
    *reinterpret_cast<d8_unaligned*>(c->sizes + c->count) = compress(sizes, lanes ^ left);
    c->runs[c->run_count++] = {pack, lanes ^ left, c->count};
    c->count += taken;
    return left;
}

// Decomposes what has been collected and puts it back. Returns the number changed or -(1 + matrix).
long flush(Collected* c, double* packed, int n, Mode mode, double* scratch) {
    const long entries = static_cast<long>(n) * (n + 1) / 2;
    const int packs = c->count > kLanes ? 2 : 1;
    // Lanes to spare are done at once as zero matrices.
    for (int slot = c->count; slot < packs * kLanes; ++slot) {
        c->sizes[slot] = 0.0;
        for (long k = 0; k < entries; ++k) c->matrices[k * kStride + slot] = 0.0;
    }
    NegativePart result;
    remove_negative_part(c->matrices, kStride, c->sizes, n, packs, mode == kAbsolute, scratch, &result);
    for (int r = 0; r < c->run_count; ++r) {
        const Run run = c->runs[r];
        for (unsigned lanes = run.lanes, slot = run.slot; lanes != 0; lanes &= lanes - 1, ++slot)
            if (result.unfinished >> slot & 1) return -(1 + run.pack * kLanes + __builtin_ctz(lanes));
        d8_unaligned* const to = reinterpret_cast<d8_unaligned*>(packed + run.pack * entries * kLanes);
        const double* const from = c->matrices + run.slot;
        for (long k = 0; k < entries; ++k)
            to[k] = expand(*reinterpret_cast<const d8_unaligned*>(from + k * kStride), to[k], run.lanes);
    }
    c->count = c->run_count = 0;
    return __builtin_popcount(result.changed);
}

long project(double* packed, int n, long lanes, Mode mode, double* memory) {
    const long entries = static_cast<long>(n) * (n + 1) / 2;
    Collected collected;
    collected.matrices = memory;
    collected.sizes = memory + entries * kStride;
    collected.count = collected.run_count = 0;
    double* const scratch = memory + (entries + 1) * kStride;
    long changed = 0;
    for (long pack = 0; pack * kLanes < lanes; ++pack) {
        const d8_unaligned* const a = reinterpret_cast<const d8_unaligned*>(packed + pack * entries * kLanes);
        const unsigned valid = lanes - pack * kLanes < kLanes ? (1u << (lanes - pack * kLanes)) - 1 : 255u;
        const Check check = check_pack(a, n, reinterpret_cast<d8*>(scratch));
        // Near the ends of the number range the factorisation overflows; there the eigenvalues decide, after scaling.
        const l8 safe = (check.sum < 1e290) & ((check.sum > 1e-290) | (check.sum == 0.0));
        unsigned failed = bits_of(~(check.passed & safe)) & valid;
        if (failed == 0) continue;
        if (bits_of(~(check.sum < DBL_MAX)) & valid) {
            const unsigned not_finite = not_finite_lanes(a, entries) & valid;
            if (not_finite != 0) return -(1 + pack * kLanes + __builtin_ctz(not_finite));
        }
        if (mode == kLeave) continue;
        while (failed != 0) {
            failed = collect(packed, pack, entries, failed, check.sum, &collected);
            if (collected.count < kCollected) continue;
            const long result = flush(&collected, packed, n, mode, scratch);
            if (result < 0) return result;
            changed += result;
        }
    }
    if (collected.count == 0) return changed;
    const long result = flush(&collected, packed, n, mode, scratch);
    return result < 0 ? result : changed + result;
}

}  // namespace
}  // namespace yasps

extern "C" {

// Projects `lanes` symmetric matrices in place. Eight are interleaved in a pack: packed[k * 8 + lane] is entry k of the
// upper triangle, row by row; packs follow each other, and the last may be partly filled. Give many packs at once where
// possible: only matrices that need it are decomposed, and sixteen of those cost hardly more than one.
// mode: 0 = negative eigenvalues become 0, 1 = their absolute value, 2 = nothing is changed. A matrix that is
// semidefinite up to rounding keeps every bit.
// Returns the number of matrices changed; -(1 + lane) for a matrix with an entry that is not finite (or whose
// eigenvalues cannot be found), when others before it may have been projected; INT64_MIN when memory for a wide
// matrix runs out.
long yasps_project(double* packed, int width, int lanes, int mode) {
    using namespace yasps;
    if (width <= 0) return 0;
    const long entries = static_cast<long>(width) * (width + 1) / 2;
    const long size = negative_part_scratch(width) + (entries + 1) * kStride;
    if (size * static_cast<long>(sizeof(double)) <= kLargestStack) {
        void* const memory = __builtin_alloca_with_align(static_cast<size_t>(size) * sizeof(double), 8 * sizeof(d8));
        return project(packed, width, lanes, static_cast<Mode>(mode), static_cast<double*>(memory));
    }
    Buffer<double> buffer;
    if (!buffer.reserve(size)) return INT64_MIN;
    return project(packed, width, lanes, static_cast<Mode>(mode), buffer.data);
}
}
