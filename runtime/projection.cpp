// Projection of small symmetric matrices onto the positive semidefinite cone, eight at a time.
//
// Most matrices of a simulation are already semidefinite, and an LDL^T factorisation of all lanes at once finds out
// at a fraction of the cost of their eigenvalues. Only a pack with a lane that fails is decomposed: Householder
// reduction to tridiagonal form and implicit QL with Wilkinson's shift (Golub & Van Loan, sec. 8.3), with one matrix
// per vector lane. Lanes take different numbers of steps; those that are ahead wait behind a mask. Loops are rolled on
// purpose: unrolling them for every width costs a minute of compile time and gains little.
#include <float.h>

#include "runtime.h"

namespace yasps {
namespace {

constexpr int kLanes = kYaspsLanes;
// Eigenvalues above -kShift * (sum of |diagonal|) count as zero: rigid motions leave such rounding error behind.
constexpr double kShift = 1e-13;
// Sweeps per eigenvalue before giving up; two or three are usual.
constexpr int kMaxSweeps = 100;
// Widths whose scratch lives on the stack.
constexpr int kStackWidth = 24;

enum Mode { kClamp = 0, kAbsolute = 1, kLeave = 2 };

inline d8 splat(double v) { return d8{v, v, v, v, v, v, v, v}; }
inline d8 select(l8 mask, d8 yes, d8 no) { return mask ? yes : no; }
inline d8 magnitude(d8 v) { return reinterpret_cast<d8>(reinterpret_cast<l8>(v) & INT64_MAX); }
inline d8 maximum(d8 a, d8 b) { return select(a > b, a, b); }
inline d8 square_root(d8 v) {
    d8 root;
    for (int lane = 0; lane < kLanes; ++lane) root[lane] = sqrt(v[lane]);
    return root;
}
inline bool any(l8 mask) {
    long found = 0;
    for (int lane = 0; lane < kLanes; ++lane) found |= mask[lane];
    return found != 0;
}

// Lanes whose matrix plus the shift has an LDL^T factorisation with a positive D. `work` holds the packed triangle.
l8 is_semidefinite(const d8* a, int n, d8* work) {
    const int packed = n * (n + 1) / 2;
    d8 trace = {};
    for (int i = 0, k = 0; i < n; k += n - i, ++i) trace += magnitude(a[k]);
    for (int k = 0; k < packed; ++k) work[k] = a[k];
    // The absolute part lets a zero matrix pass.
    const d8 shift = trace * kShift + DBL_MIN;
    for (int i = 0, k = 0; i < n; k += n - i, ++i) work[k] += shift;
    l8 passed = ~l8{};
    d8* row = work;
    for (int k = 0; k < n; ++k) {
        const d8 pivot = row[0];
        passed &= pivot > 0.0;
        const d8 inverse = 1.0 / pivot;
        d8* below = row + (n - k);
        for (int i = 1; i < n - k; ++i) {
            const d8 factor = row[i] * inverse;
            for (int j = i; j < n - k; ++j) below[j - i] -= factor * row[j];
            below += n - k - i;
        }
        row += n - k;
    }
    return passed;
}

// Reduces the full symmetric matrix a (n x n) to tridiagonal form, diagonal d and off-diagonal e[0 .. n-2]; the
// columns of z (z[c * n + k] = element k of column c) become the accumulated reflections. p is scratch of n.
void tridiagonalise(d8* a, int n, d8* d, d8* e, d8* z, d8* p) {
    for (int k = 0; k + 2 < n; ++k) {
        d8* const v = a + k * n;  // row k right of the diagonal becomes the reflection's vector
        d8 squared = {};
        for (int i = k + 1; i < n; ++i) squared += v[i] * v[i];
        const d8 first = v[k + 1];
        const d8 norm = square_root(squared);
        const d8 reflected = select(first > 0.0, -norm, norm);
        // Columns this small are zero next to a matrix of size one; dividing by them would overflow.
        const l8 small = squared < 1e-200;
        e[k] = select(small, first, reflected);
        v[k + 1] = first - reflected;
        const d8 scale = select(small, d8{}, 1.0 / select(small, splat(1), squared - first * reflected));
        d[k] = scale;  // kept here until the vectors are accumulated
        for (int i = k + 1; i < n; ++i) p[i] = d8{};
        for (int i = k + 1; i < n; ++i) {
            const d8* const row = a + i * n;
            d8 sum = row[i] * v[i];
            for (int j = i + 1; j < n; ++j) {
                sum += row[j] * v[j];
                p[j] += row[j] * v[i];
            }
            p[i] += sum;
        }
        d8 inner = {};
        for (int i = k + 1; i < n; ++i) {
            p[i] *= scale;
            inner += p[i] * v[i];
        }
        const d8 half = inner * scale * 0.5;
        for (int i = k + 1; i < n; ++i) p[i] -= half * v[i];
        for (int i = k + 1; i < n; ++i) {
            d8* const row = a + i * n;
            for (int j = i; j < n; ++j) row[j] -= v[i] * p[j] + p[i] * v[j];
        }
    }
    for (int i = 0; i < n * n; ++i) z[i] = d8{};
    for (int i = 0; i < n; ++i) z[i * n + i] = splat(1);
    for (int k = n - 3; k >= 0; --k) {
        const d8* const v = a + k * n;
        for (int c = k + 1; c < n; ++c) {
            d8* const column = z + c * n;
            d8 inner = {};
            for (int i = k + 1; i < n; ++i) inner += v[i] * column[i];
            inner *= d[k];
            for (int i = k + 1; i < n; ++i) column[i] -= inner * v[i];
        }
    }
    if (n > 1) e[n - 2] = a[(n - 2) * n + n - 1];
    for (int i = 0; i < n; ++i) d[i] = a[i * n + i];
}

// For every lane the first index m >= l whose off-diagonal is negligible.
void find_splits(const d8* e, int n, int l, d8 negligible, long* split) {
    for (int lane = 0; lane < kLanes; ++lane) split[lane] = n - 1;
    for (int m = n - 2; m >= l; --m) {
        const l8 splits = magnitude(e[m]) <= negligible;
        for (int lane = 0; lane < kLanes; ++lane) split[lane] = splits[lane] ? m : split[lane];
    }
}

// Diagonalises the tridiagonal matrix; d becomes the eigenvalues (in no order) and
// the columns of z the eigenvectors. Returns the lanes that did not converge.
l8 diagonalise(d8* d, d8* e, int n, d8* z) {
    d8 norm = {};
    for (int i = 0; i < n; ++i) norm = maximum(norm, magnitude(d[i]) + (i + 1 < n ? magnitude(e[i]) : d8{}));
    const d8 negligible = norm * (DBL_EPSILON / 2);
    for (int l = 0; l + 1 < n; ++l) {
        for (int sweep = 0;; ++sweep) {
            long split[kLanes];
            find_splits(e, n, l, negligible, split);
            l8 last;
            d8 at_split;
            long largest = l;
            for (int lane = 0; lane < kLanes; ++lane) {
                last[lane] = split[lane];
                at_split[lane] = d[split[lane]][lane];
                if (split[lane] > largest) largest = split[lane];
            }
            const l8 busy = last > l;
            if (largest == l) break;
            if (sweep == kMaxSweeps) return busy;

            // Wilkinson's shift from the leading 2 x 2 block.
            const d8 safe = select(busy, e[l], splat(1));
            const d8 ratio = (d[l + 1] - d[l]) / (2.0 * safe);
            const d8 root = square_root(ratio * ratio + 1.0);
            d8 g = at_split - d[l] + safe / (ratio + select(ratio < 0.0, -root, root));
            d8 s = splat(1), c = splat(1), p = {};
            for (long i = largest - 1; i >= l; --i) {
                const l8 active = busy & (last > i);
                const d8 f = s * e[i];
                const d8 b = c * e[i];
                const d8 r = square_root(f * f + g * g);
                const l8 zero = r == 0.0;
                const d8 inverse = 1.0 / select(zero, splat(1), r);
                const d8 sine = select(zero, d8{}, f * inverse);
                const d8 cosine = select(zero, splat(1), g * inverse);
                const d8 shifted = d[i + 1] - p;
                const d8 t = (d[i] - shifted) * sine + 2.0 * cosine * b;
                e[i + 1] = select(active & (last != i + 1), r, e[i + 1]);
                s = select(active, sine, s);
                c = select(active, cosine, c);
                p = select(active, sine * t, p);
                d[i + 1] = select(active, shifted + p, d[i + 1]);
                g = select(active, cosine * t - b, g);
                const d8 turn_sine = select(active, sine, d8{});
                const d8 turn_cosine = select(active, cosine, splat(1));
                d8* const lower = z + i * n;
                d8* const upper = lower + n;
                for (int k = 0; k < n; ++k) {
                    const d8 u = upper[k], v = lower[k];
                    upper[k] = turn_sine * v + turn_cosine * u;
                    lower[k] = turn_cosine * v - turn_sine * u;
                }
            }
            d[l] -= select(busy, p, d8{});
            e[l] = select(busy, g, e[l]);
        }
    }
    return l8{};
}

struct Scratch {
    d8 *work, *a, *z, *d, *e, *p;
};
long scratch_size(long n) { return n * (n + 1) / 2 + 2 * n * n + 3 * n; }
Scratch cut_scratch(d8* memory, int n) {
    Scratch s;
    s.work = memory;
    s.a = s.work + n * (n + 1) / 2;
    s.z = s.a + n * n;
    s.d = s.z + n * n;
    s.e = s.d + n;
    s.p = s.e + n;
    return s;
}

// Powers of two that bring the largest entry of every lane to about one; exact to multiply with.
void find_scales(d8 largest, d8* down, d8* up) {
    for (int lane = 0; lane < kLanes; ++lane) {
        int exponent = 0;
        if (largest[lane] > 0) frexp(largest[lane], &exponent);
        // Both powers must be normal numbers.
        exponent = exponent < -1021 ? -1021 : exponent > 1021 ? 1021 : exponent;
        (*down)[lane] = ldexp(1.0, -exponent);
        (*up)[lane] = ldexp(1.0, exponent);
    }
}

// Removes the negative eigenvalues of the lanes in `failed`. Adding -lambda v v^T for the negative eigenvalues alone
// keeps what is already semidefinite untouched by rounding. Returns the number of changed lanes or -(1 + lane).
long remove_negative(d8* packed, int n, Mode mode, l8 failed, d8 largest, const Scratch& s) {
    d8 down, up;
    find_scales(largest, &down, &up);
    down = select(failed, down, d8{});  // other lanes become zero and are done at once
    const d8* from = packed;
    d8 trace = {};
    for (int i = 0; i < n; ++i) {
        for (int j = i; j < n; ++j) s.a[i * n + j] = *from++ * down;
        trace += magnitude(s.a[i * n + i]);
    }
    tridiagonalise(s.a, n, s.d, s.e, s.z, s.p);
    const l8 unfinished = diagonalise(s.d, s.e, n, s.z);
    for (int lane = 0; lane < kLanes; ++lane)
        if (unfinished[lane]) return -(1 + lane);

    d8 smallest = {};
    for (int i = 0; i < n; ++i) smallest = select(s.d[i] < smallest, s.d[i], smallest);
    const l8 changes = failed & (smallest < -kShift * trace);
    if (!any(changes)) return 0;
    for (int k = 0; k < n * (n + 1) / 2; ++k) s.work[k] = d8{};
    for (int i = 0; i < n; ++i) {
        const l8 negative = changes & (s.d[i] < 0.0);
        if (!any(negative)) continue;
        const d8 weight = select(negative, mode == kAbsolute ? -2.0 * s.d[i] : -s.d[i], d8{});
        const d8* const v = s.z + i * n;
        d8* to = s.work;
        for (int j = 0; j < n; ++j) {
            const d8 scaled = weight * v[j];
            for (int k = j; k < n; ++k) *to++ += scaled * v[k];
        }
    }
    for (int k = 0; k < n * (n + 1) / 2; ++k)
        packed[k] = select(changes, (packed[k] * down + s.work[k]) * up, packed[k]);
    long count = 0;
    for (int lane = 0; lane < kLanes; ++lane) count += changes[lane] ? 1 : 0;
    return count;
}

long project(d8* packed, int n, l8 valid, Mode mode, d8* memory) {
    const int entries = n * (n + 1) / 2;
    d8 largest = {};
    l8 finite = ~l8{};
    for (int k = 0; k < entries; ++k) {
        const d8 size = magnitude(packed[k]);
        finite &= size <= DBL_MAX;
        largest = maximum(size, largest);
    }
    finite |= ~valid;
    if (any(~finite)) {
        for (int lane = 0; lane < kLanes; ++lane)
            if (!finite[lane]) return -(1 + lane);
    }
    if (mode == kLeave) return 0;
    const Scratch scratch = cut_scratch(memory, n);
    l8 passed = is_semidefinite(packed, n, scratch.work);
    // Near the ends of the number range the check itself overflows or underflows; eigenvalues are found after scaling.
    passed &= (largest < 1e290) & ((largest > 1e-290) | (largest == 0.0));
    const l8 failed = ~passed & valid;
    if (!any(failed)) return 0;
    return remove_negative(packed, n, mode, failed, largest, scratch);
}

}  // namespace
}  // namespace yasps

extern "C" {

// Projects the first `lanes` (at most 8) of eight interleaved symmetric matrices in place; packed[k * 8 + lane] is
// entry k of the upper triangle, row by row. mode: 0 = negative eigenvalues become 0, 1 = their absolute value,
// 2 = nothing is changed. A matrix that is semidefinite up to rounding keeps every bit.
// Returns the number of lanes changed; -(1 + lane) for the first lane with an entry that is not finite (or whose
// eigenvalues cannot be found); -1000 when memory for a wide matrix runs out.
long yasps_project(double* packed, int width, int lanes, int mode) {
    using namespace yasps;
    if (width <= 0) return 0;
    l8 valid;
    for (int lane = 0; lane < kLanes; ++lane) valid[lane] = lane < lanes ? -1 : 0;
    const long size = scratch_size(width);
    const long entries = static_cast<long>(width) * (width + 1) / 2;
    if (width <= kStackWidth) {
        d8* const memory = static_cast<d8*>(
            __builtin_alloca_with_align(static_cast<size_t>(size + entries) * sizeof(d8), 8 * sizeof(d8)));
        if (reinterpret_cast<uintptr_t>(packed) % sizeof(d8) == 0)
            return project(reinterpret_cast<d8*>(packed), width, valid, static_cast<Mode>(mode), memory);
        d8* const copy = memory + size;
        memcpy(copy, packed, static_cast<size_t>(entries) * sizeof(d8));
        const long changed = project(copy, width, valid, static_cast<Mode>(mode), memory);
        if (changed > 0) memcpy(packed, copy, static_cast<size_t>(entries) * sizeof(d8));
        return changed;
    }
    Buffer<double> buffer;
    if (!buffer.reserve((size + entries) * kLanes)) return -1000;
    d8* const memory = reinterpret_cast<d8*>(buffer.data);
    d8* const copy = memory + size;
    memcpy(copy, packed, static_cast<size_t>(entries) * sizeof(d8));
    const long changed = project(copy, width, valid, static_cast<Mode>(mode), memory);
    if (changed > 0) memcpy(packed, copy, static_cast<size_t>(entries) * sizeof(d8));
    return changed;
}
}
