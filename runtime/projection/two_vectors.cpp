// Projection of the Hessians of isotropic energies of two vectors onto the positive semidefinite cone.
//
// If an energy of vectors a_0 and a_1 of space does not change when a rotation turns both, then a reflection in a plane
// that both lie in leaves it alone too: it turns any two vectors as a rotation does. So the Hessian does not couple
// what moves a_0 and a_1 along the plane's normal n with what moves them in the plane. With an orthonormal basis q_0,
// q_1 of the plane it falls into a 2x2 matrix N, N_cd = n^T H_cd n, and a 4x4 matrix P of the q_i^T H_cd q_j, H_cd
// being its 3x3 blocks. Their eigenvalues cost half of those of the 6x6 matrix.
#include "core/runtime.h"
#include "projection/cone.h"
#include "projection/groups.h"
#include "projection/three_by_three.h"

namespace yasps {
namespace {

constexpr int kWidth = 6, kInner = 4, kInnerEntries = kInner * (kInner + 1) / 2;
// Beside the length of a_1: less than this across a_0 has the direction of rounding. Squared.
constexpr double kAcross = 1.6e-15 * 1.6e-15;

// The vector of a pack, scaled to about one by a power of two; zero where it is not finite, and such bits in `failed`.
Vector<Eight> scaled_vector(const double* f, unsigned* failed) {
    const Vector<Eight> v = {{load_entry(f, 0), load_entry(f, 1), load_entry(f, 2)}};
    const Eight sum = magnitude(v.at[0]) + magnitude(v.at[1]) + magnitude(v.at[2]);
    const auto finite = less(sum, constant<Eight>(INFINITY));
    *failed |= bits_of(finite) ^ 0xffu;
    const Eight scale = select(finite, power_of_two(sum, -1), Eight{});
    const Vector<Eight> zero = {};
    return choose<Eight>(finite, v, zero) * scale;
}

// q_0, q_1 and n.
Columns<Eight> frame_of(const Vector<Eight>& a, const Vector<Eight>& b) {
    const Eight one = constant<Eight>(1), first = dot(a, a), length = dot(b, b);
    const auto nothing = less(first, constant<Eight>(kLeastSquare));
    Columns<Eight> q;
    q.c[0] = choose<Eight>(nothing, unit_columns<Eight>().c[0], a * inverse_root(select(nothing, one, first)));
    Vector<Eight> rest = b - q.c[0] * dot(b, q.c[0]);
    const Eight across = dot(rest, rest);
    const auto along = less(across, maximum(length * kAcross, constant<Eight>(kLeastSquare)));
    rest = rest * inverse_root(select(along, one, across));
    rest = rest - q.c[0] * dot(rest, q.c[0]);  // of a short rest much is rounding
    q.c[1] = choose<Eight>(along, any_orthogonal(q.c[0]), rest * inverse_root(select(along, one, dot(rest, rest))));
    q.c[2] = cross(q.c[0], q.c[1]);
    return q;
}

// Entry (3 c + r, 3 d + s) of the packed triangle, c <= d.
constexpr int entry_at(int c, int r, int d, int s) { return place_of<kWidth>(3 * c + r, 3 * d + s); }
constexpr int kPairs[3][2] = {{0, 0}, {0, 1}, {1, 1}};

// What is missing in [[p, o], [o, q]] = `normal` to be semidefinite, or to have absolute eigenvalues (factor 2).
Eight complete(const Eight normal[3], double factor, Eight missing[3]) {
    const Eight mean = (normal[0] + normal[2]) * 0.5, half = (normal[0] - normal[2]) * 0.5, off = normal[1];
    Eight radius, over_radius;
    find_roots(maximum(half * half + off * off, constant<Eight>(kLeastSquare)), &radius, &over_radius);
    const auto missing_of = [factor](Eight value) { return select(less(value, Eight{}), value * -factor, Eight{}); };
    const Eight smaller = missing_of(mean - radius), larger = missing_of(mean + radius);
    const Eight both = (smaller + larger) * 0.5, turn = (larger - smaller) * over_radius * 0.5;
    missing[0] = both + half * turn;
    missing[1] = off * turn;
    missing[2] = both - half * turn;
    return mean - radius;
}

// The blocks of a pack in its frame, and what was taken for the size of the matrix.
struct Parts {
    Columns<Eight> q;
    Eight normal[3], size;
};

// inner: [kInnerEntries, 16], of which this pack has 8.
void take_apart(const double* h, const Columns<Eight>& q, Parts* parts, Eight inner[kInnerEntries]) {
    parts->q = q;
    parts->size = Eight{};
#pragma GCC unroll 3
    for (int k = 0; k < 3; ++k) {
        const int c = kPairs[k][0], d = kPairs[k][1];
        Eight p[2][2];
#pragma GCC unroll 2
        for (int j = 0; j < 2; ++j) {
            Vector<Eight> image;
#pragma GCC unroll 3
            for (int r = 0; r < 3; ++r)
                image.at[r] = load_entry(h, entry_at(c, r, d, 0)) * q.c[j].at[0] +
                              load_entry(h, entry_at(c, r, d, 1)) * q.c[j].at[1] +
                              load_entry(h, entry_at(c, r, d, 2)) * q.c[j].at[2];
            p[0][j] = dot(q.c[0], image);
            p[1][j] = dot(q.c[1], image);
        }
        parts->normal[k] = load_entry(h, entry_at(c, 0, d, 0)) + load_entry(h, entry_at(c, 1, d, 1)) +
                           load_entry(h, entry_at(c, 2, d, 2)) - p[0][0] - p[1][1];
#pragma GCC unroll 2
        for (int i = 0; i < 2; ++i)
#pragma GCC unroll 2
            for (int j = c == d ? i : 0; j < 2; ++j) {
                inner[place_of<kInner>(2 * c + i, 2 * d + j)] = p[i][j];
                parts->size = parts->size + magnitude(p[i][j]);
            }
        parts->size = parts->size + magnitude(parts->normal[k]);
    }
}

// Adds what is missing, in the plane and along the normal, to lanes of a pack.
void put_back(const Columns<Eight>& q, const Eight missing[kInnerEntries], const Eight normal[3], Mask<Eight> lanes,
              double* h) {
#pragma GCC unroll 3
    for (int k = 0; k < 3; ++k) {
        const int c = kPairs[k][0], d = kPairs[k][1];
#pragma GCC unroll 3
        for (int r = 0; r < 3; ++r) {
            Eight left[2];
#pragma GCC unroll 2
            for (int j = 0; j < 2; ++j)
                left[j] = q.c[0].at[r] * missing[place_of<kInner>(2 * c, 2 * d + j)] +
                          q.c[1].at[r] * missing[place_of<kInner>(2 * c + 1, 2 * d + j)];
            const Eight along = q.c[2].at[r] * normal[k];
#pragma GCC unroll 3
            for (int s = c == d ? r : 0; s < 3; ++s) {
                double* const to = h + entry_at(c, r, d, s) * kLanes;
                const Eight before = load_entry(to, 0);
                const Eight sum = before + left[0] * q.c[0].at[s] + left[1] * q.c[1].at[s] + along * q.c[2].at[s];
                store_lanes(to, select(lanes, sum, before));
            }
        }
    }
}

NegativePart project_group(const Group& group, bool flip) {
    alignas(64) double inner[kInnerEntries * kCollected], sizes[kCollected];
    Parts parts[2];
    Eight before[2][kInnerEntries], up[2];
    unsigned failed = 0;
    for (int k = 0; k < group.halves; ++k) {
        unsigned failed_here = 0;
        const Vector<Eight> a = scaled_vector(group.companions[k], &failed_here);
        const Vector<Eight> b = scaled_vector(group.companions[k] + 3 * kLanes, &failed_here);
        take_apart(group.matrices[k], frame_of(a, b), &parts[k], before[k]);
        const Eight size = parts[k].size, down = power_of_two(size, -1);
        failed_here |= ~lanes_in_range(size);
        failed |= (failed_here & 0xffu) << k * kLanes;
        Mask<Eight> usable;
        mask_lanes(~failed_here, &usable);
        up[k] = power_of_two(size, 1);
#pragma GCC unroll 3
        for (int i = 0; i < 3; ++i) parts[k].normal[i] = select(usable, parts[k].normal[i] * down, Eight{});
        Eight sum = {};
#pragma GCC unroll 10
        for (int i = 0; i < kInnerEntries; ++i) {
            before[k][i] = select(usable, before[k][i] * down, Eight{});
            sum = sum + magnitude(before[k][i]);
            store_lanes(inner + i * kCollected + k * kLanes, before[k][i]);
        }
        store_lanes(sizes + k * kLanes, sum);
    }
    NegativePart of_inner, result = {};
    const size_t scratch = static_cast<size_t>(negative_part_scratch(kInner)) * sizeof(double);
    remove_negative_part(inner, kCollected, sizes, kInner, group.halves, flip,
                         static_cast<double*>(__builtin_alloca_with_align(scratch, 8 * sizeof(d8))), &of_inner);
    failed = (failed | of_inner.unfinished) & group.lanes;
    if (failed != 0) result = project_generally<kWidth>(group, failed, flip);
    for (int k = 0; k < group.halves; ++k) {
        double* const h = group.matrices[k];
        Eight trace = {}, normal[3], missing[kInnerEntries];
#pragma GCC unroll 6
        for (int i = 0; i < kWidth; ++i) trace = trace + magnitude(load_entry(h, place_of<kWidth>(i, i)));
        const Eight smallest = complete(parts[k].normal, flip ? 2 : 1, normal) * up[k];
        unsigned changed = of_inner.changed >> k * kLanes | bits_of(less(smallest, trace * -kProjectionShift));
        changed &= (group.lanes & ~failed) >> k * kLanes & 0xffu;
        if (changed == 0) continue;
        result.changed |= changed << k * kLanes;
        for (int i = 0; i < 3; ++i) normal[i] = normal[i] * up[k];
        for (int i = 0; i < kInnerEntries; ++i) {
            Eight after;
            load_lanes(inner + i * kCollected + k * kLanes, &after);
            missing[i] = (after - before[k][i]) * up[k];
        }
        Mask<Eight> lanes;
        mask_lanes(changed, &lanes);
        put_back(parts[k].q, missing, normal, lanes, h);
    }
    return result;
}

long project(double* packed, const double* vectors, long lanes, Mode mode) {
    const Packs packs = {packed, vectors, kWidth, kWidth, lanes};
    alignas(64) double memory[(kWidth * (kWidth + 1) / 2 + kWidth) * kCollected];
    return project_failing<kWidth, 1>(packs, memory, mode == kLeave,
                                      [mode](const Group& group) { return project_group(group, mode == kAbsolute); });
}

}  // namespace
}  // namespace yasps

extern "C" {

// As yasps_project for a width of 6, for Hessians with respect to two vectors of space, one after the other, of an
// energy that rotations of both leave alone. vectors[k * 8 + lane] is entry k of the vectors; packs follow each other
// as those of `packed` do. The result is that of yasps_project up to rounding, and so is what is returned. A matrix
// whose vectors are not finite is projected without them.
long yasps_project_two_vectors(double* packed, const double* vectors, int width, int lanes, int mode) {
    using namespace yasps;
    if (width != kWidth) return yasps_project(packed, width, lanes, mode);
    return project(packed, vectors, lanes, static_cast<Mode>(mode));
}
}
