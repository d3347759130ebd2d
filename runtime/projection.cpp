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
l8 is_semidefinite(const d8_unaligned* a, int n, d8* work) {
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

// For every lane the first index m >= l whose off-diagonal is negligible, and the diagonal entry there.
struct Splits {
    l8 at;
    d8 diagonal;
};
Splits find_splits(const d8* d, const d8* e, int n, int l, d8 negligible) {
    Splits splits = {l8{} + (n - 1L), d[n - 1]};
    for (long m = n - 2; m >= l; --m) {
        const l8 here = magnitude(e[m]) <= negligible;
        splits.at = here ? l8{} + m : splits.at;
        splits.diagonal = select(here, d[m], splits.diagonal);
    }
    return splits;
}

long largest_of(l8 v) {
    long largest = v[0];
    for (int lane = 1; lane < kLanes; ++lane) largest = v[lane] > largest ? v[lane] : largest;
    return largest;
}

// Diagonalises the tridiagonal matrix; d becomes the eigenvalues (in no order) and
// the columns of z the eigenvectors. Returns the lanes that did not converge.
l8 diagonalise(d8* d, d8* e, int n, d8* z) {
    d8 norm = {};
    for (int i = 0; i < n; ++i) norm = maximum(norm, magnitude(d[i]) + (i + 1 < n ? magnitude(e[i]) : d8{}));
    const d8 negligible = norm * (DBL_EPSILON / 2);
    for (int l = 0; l + 1 < n; ++l) {
        for (int sweep = 0;; ++sweep) {
            const Splits splits = find_splits(d, e, n, l, negligible);
            const l8 last = splits.at;
            const long largest = largest_of(last);
            const l8 busy = last > l;
            if (largest == l) break;
            if (sweep == kMaxSweeps) return busy;

            // Wilkinson's shift from the leading 2 x 2 block.
            const d8 safe = select(busy, e[l], splat(1));
            const d8 ratio = (d[l + 1] - d[l]) / (2.0 * safe);
            const d8 root = square_root(ratio * ratio + 1.0);
            d8 g = splits.diagonal - d[l] + safe / (ratio + select(ratio < 0.0, -root, root));
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
// keeps what is already semidefinite untouched by rounding. Returns the lanes that changed; `unfinished` receives those
// whose eigenvalues were not found.
l8 remove_negative(d8_unaligned* packed, int n, Mode mode, l8 failed, d8 largest, const Scratch& s, l8* unfinished) {
    d8 down, up;
    find_scales(largest, &down, &up);
    const d8_unaligned* from = packed;
    d8 trace = {};
    for (int i = 0; i < n; ++i) {
        // The other lanes become zero and are done at once.
        for (int j = i; j < n; ++j) s.a[i * n + j] = select(failed, *from++ * down, d8{});
        trace += magnitude(s.a[i * n + i]);
    }
    tridiagonalise(s.a, n, s.d, s.e, s.z, s.p);
    *unfinished = diagonalise(s.d, s.e, n, s.z);

    d8 smallest = {};
    for (int i = 0; i < n; ++i) smallest = select(s.d[i] < smallest, s.d[i], smallest);
    const l8 changes = failed & (smallest < -kShift * trace);
    if (!any(changes)) return changes;
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
    return changes;
}

struct Check {
    l8 finite;
    l8 failed;   // has, or may have, a negative eigenvalue
    d8 largest;  // absolute value of the largest entry
};
Check check_pack(const d8_unaligned* packed, int n, Mode mode, d8* work) {
    Check check = {~l8{}, l8{}, d8{}};
    for (int k = 0; k < n * (n + 1) / 2; ++k) {
        const d8 size = magnitude(packed[k]);
        check.finite &= size <= DBL_MAX;
        check.largest = maximum(size, check.largest);
    }
    if (mode == kLeave) return check;
    // Near the ends of the number range the factorisation overflows; there the eigenvalues decide, after scaling.
    const l8 safe = (check.largest < 1e290) & ((check.largest > 1e-290) | (check.largest == 0.0));
    check.failed = ~(is_semidefinite(packed, n, work) & safe);
    return check;
}

l8 lanes_below(long count) {
    l8 mask;
    for (int lane = 0; lane < kLanes; ++lane) mask[lane] = lane < count ? -1 : 0;
    return mask;
}

int first_lane(l8 mask) {
    int lane = 0;
    while (lane < kLanes && !mask[lane]) ++lane;
    return lane;
}

// Matrices that failed the check, drawn together from several packs so that decomposing them keeps all lanes busy.
struct Compacted {
    double* pack;  // [entries, kLanes]
    long source[kLanes];
    d8 largest;
    int count;
};

// Decomposes what has been collected and puts it back. Returns the number changed or -(1 + source).
long flush(Compacted& c, double* packed, int n, Mode mode, const Scratch& scratch) {
    const long entries = static_cast<long>(n) * (n + 1) / 2;
    l8 unfinished;
    const l8 changes = remove_negative(reinterpret_cast<d8_unaligned*>(c.pack), n, mode, lanes_below(c.count),
                                       c.largest, scratch, &unfinished);
    if (any(unfinished)) return -(1 + c.source[first_lane(unfinished)]);
    long changed = 0;
    for (int slot = 0; slot < c.count; ++slot) {
        if (!changes[slot]) continue;
        ++changed;
        double* const to = packed + c.source[slot] / kLanes * entries * kLanes + c.source[slot] % kLanes;
        for (long k = 0; k < entries; ++k) to[k * kLanes] = c.pack[k * kLanes + slot];
    }
    c.count = 0;
    return changed;
}

long project(double* packed, int n, long lanes, Mode mode, d8* memory) {
    const long entries = static_cast<long>(n) * (n + 1) / 2;
    const Scratch scratch = cut_scratch(memory, n);
    Compacted collected = {reinterpret_cast<double*>(memory + scratch_size(n)), {}, d8{}, 0};
    long changed = 0;
    for (long first = 0; first < lanes; first += kLanes) {
        double* const pack = packed + first * entries;
        const l8 valid = lanes_below(lanes - first);
        const Check check = check_pack(reinterpret_cast<d8_unaligned*>(pack), n, mode, scratch.work);
        const l8 not_finite = ~check.finite & valid;
        if (any(not_finite)) return -(1 + first + first_lane(not_finite));
        const l8 failed = check.failed & valid;
        if (!any(failed)) continue;
        for (int lane = 0; lane < kLanes; ++lane) {
            if (!failed[lane]) continue;
            for (long k = 0; k < entries; ++k) collected.pack[k * kLanes + collected.count] = pack[k * kLanes + lane];
            collected.largest[collected.count] = check.largest[lane];
            collected.source[collected.count] = first + lane;
            if (++collected.count < kLanes) continue;
            const long result = flush(collected, packed, n, mode, scratch);
            if (result < 0) return result;
            changed += result;
        }
    }
    if (collected.count == 0) return changed;
    const long result = flush(collected, packed, n, mode, scratch);
    return result < 0 ? result : changed + result;
}

}  // namespace
}  // namespace yasps

extern "C" {

// Projects `lanes` symmetric matrices in place. Eight are interleaved in a pack: packed[k * 8 + lane] is entry k of the
// upper triangle, row by row; packs follow each other, and the last may be partly filled. Give many packs at once where
// possible: only matrices that need it are decomposed, and eight of those cost as much as one.
// mode: 0 = negative eigenvalues become 0, 1 = their absolute value, 2 = nothing is changed. A matrix that is
// semidefinite up to rounding keeps every bit.
// Returns the number of matrices changed; -(1 + lane) for a matrix with an entry that is not finite (or whose
// eigenvalues cannot be found), when others before it may have been projected; INT64_MIN when memory for a wide
// matrix runs out.
long yasps_project(double* packed, int width, int lanes, int mode) {
    using namespace yasps;
    if (width <= 0) return 0;
    const long size = scratch_size(width) + static_cast<long>(width) * (width + 1) / 2;
    if (width <= kStackWidth) {
        void* const memory = __builtin_alloca_with_align(static_cast<size_t>(size) * sizeof(d8), 8 * sizeof(d8));
        return project(packed, width, lanes, static_cast<Mode>(mode), static_cast<d8*>(memory));
    }
    Buffer<double> buffer;
    if (!buffer.reserve(size * kLanes)) return INT64_MIN;
    return project(packed, width, lanes, static_cast<Mode>(mode), reinterpret_cast<d8*>(buffer.data));
}
}
