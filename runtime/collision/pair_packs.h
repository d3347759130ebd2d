// Eight pairs of surface pieces at a time, one in each lane: what pair_distance.h says of one pair, without branches.
#pragma once

#include "collision/pair_distance.h"
#include "core/runtime.h"
#include "core/vectors.h"

namespace yasps {

constexpr int kPack = 8;
typedef PointOf<Eight> PointPack;

// A place or a motion of every vertex, and its radius, side by side.
struct Places {
    Buffer<double> of;  // [vertices, 4]: x, y, z, radius

    // x - from, or x itself; radii: or null. False: out of memory.
    bool take(const Point* x, const Point* from, const double* radii, long count, int threads) {
        if (!of.reserve(4 * count)) return false;
        double* const to = of.data;
#pragma omp parallel for num_threads(threads) schedule(static) if (threads > 1)
        for (long v = 0; v < count; ++v) {
            const Point p = from == nullptr ? x[v] : x[v] - from[v];
            store(to + 4 * v, d4{p.x, p.y, p.z, radii == nullptr ? 0 : radii[v]});
        }
        return true;
    }
};

struct PairPack {
    PointPack p[4];
    Eight radius[4];

    // The vertices relative to the first one, to q, [4].
    void relative(PointPack* q) const {
        for (int c = 0; c < 4; ++c) q[c] = p[c] - p[0];
    }
};

inline Eight joined(d4 first, d4 second) {
    static_assert(sizeof(Eight) == 2 * sizeof(d4), "eight numbers");
    Eight to;
    if constexpr (kRegister == sizeof(Eight)) {
        const d8 both = __builtin_shufflevector(first, second, 0, 1, 2, 3, 4, 5, 6, 7);
        memcpy(&to, &both, sizeof(to));
    } else {
        memcpy(&to, &first, sizeof(first));
        memcpy(reinterpret_cast<char*>(&to) + sizeof(first), &second, sizeof(second));
    }
    return to;
}

// Four places to their coordinates and radii, of four each.
inline void transpose(d4* a) {
    const d4 low = __builtin_shufflevector(a[0], a[1], 0, 4, 2, 6);
    const d4 high = __builtin_shufflevector(a[0], a[1], 1, 5, 3, 7);
    const d4 next_low = __builtin_shufflevector(a[2], a[3], 0, 4, 2, 6);
    const d4 next_high = __builtin_shufflevector(a[2], a[3], 1, 5, 3, 7);
    a[0] = __builtin_shufflevector(low, next_low, 0, 1, 4, 5);
    a[1] = __builtin_shufflevector(high, next_high, 0, 1, 4, 5);
    a[2] = __builtin_shufflevector(low, next_low, 2, 3, 6, 7);
    a[3] = __builtin_shufflevector(high, next_high, 2, 3, 6, 7);
}

// The vertices of the pairs rows[4 * numbers[lane]], ..., [4]; lanes beyond `count` have those of the last.
inline PairPack gather(const Places& places, const int* rows, const int* numbers, long count) {
    const int* row[kPack];
    for (int l = 0; l < kPack; ++l) row[l] = rows + 4L * numbers[l < count ? l : count - 1];
    PairPack pack;
    const double* const of = places.of.data;
#pragma GCC unroll 4
    for (int c = 0; c < 4; ++c) {
        d4 first[4], second[4];
#pragma GCC unroll 4
        for (int l = 0; l < 4; ++l) {
            first[l] = load(of + 4L * row[l][c]);
            second[l] = load(of + 4L * row[l + 4][c]);
        }
        transpose(first), transpose(second);
        pack.p[c] = {joined(first[0], second[0]), joined(first[1], second[1]), joined(first[2], second[2])};
        pack.radius[c] = joined(first[3], second[3]);
    }
    return pack;
}

// Of both pieces together: the largest radius of each.
template <int kSplit>
inline Eight most_radii(const Eight* radius) {
    if (kSplit == 1) return radius[0] + maximum(radius[1], maximum(radius[2], radius[3]));
    return maximum(radius[0], radius[1]) + maximum(radius[2], radius[3]);
}
// And the least.
template <int kSplit>
inline Eight least_radii(const Eight* radius) {
    if (kSplit == 1) return radius[0] + minimum(radius[1], minimum(radius[2], radius[3]));
    return minimum(radius[0], radius[1]) + minimum(radius[2], radius[3]);
}

// The largest and smallest number of the first and second piece.
template <int kSplit>
inline Eight last_of_first(const Eight* a) {
    return kSplit == 1 ? a[0] : maximum(a[0], a[1]);
}
template <int kSplit>
inline Eight first_of_second(const Eight* a) {
    return kSplit == 1 ? minimum(a[1], minimum(a[2], a[3])) : minimum(a[2], a[3]);
}

// A lower bound of the distance, cheaper than it: how far apart pieces are along the line through their middles.
struct AlongLine {
    Eight gap;      // times the length of the line
    Eight squared;  // length of the line

    Mask<Eight> is_beyond(Eight distance) const {
        const Eight zero = constant<Eight>(0);
        return less(zero, gap) & less(distance * distance * squared, gap * gap);
    }
};

// From the middle of the first piece to that of the second, of vertices relative to the first one.
template <int kSplit>
inline PointPack line_of_middles(const PointPack* q) {
    if (kSplit == 1) return constant<Eight>(1.0 / 3) * (q[1] + q[2] + q[3]);
    return constant<Eight>(0.5) * (q[2] + q[3] - q[1]);
}

template <int kSplit>
inline AlongLine along(PointPack line, const PointPack* q) {
    constexpr double kRounding = 16 * kEpsilon;
    const Eight squared = square(line);
    Eight places[4], largest = squared;
    for (int c = 0; c < 4; ++c) places[c] = dot(line, q[c]), largest = maximum(largest, square(q[c]));
    const Eight gap = first_of_second<kSplit>(places) - last_of_first<kSplit>(places);
    return {gap - largest * kRounding, squared};
}

template <int kSplit>
inline AlongLine along_middles(const PointPack* q) {
    return along<kSplit>(line_of_middles<kSplit>(q), q);
}

inline PointPack select(Mask<Eight> mask, PointPack yes, PointPack no) {
    return {select(mask, yes.x, no.x), select(mask, yes.y, no.y), select(mask, yes.z, no.z)};
}

// As Closest, for eight pairs. way: from the first piece to the second, of any length. sure: a bit for each lane; what
// is said of others means nothing, because their normal is mostly rounding.
struct ClosestPack {
    Eight features, squared;
    PointPack way;
    unsigned sure;

    void take_where(Mask<Eight> mask, Eight feature, Eight distance, PointPack to) {
        features = select(mask, feature, features);
        squared = select(mask, distance, squared);
        way = select(mask, to, way);
    }
};

// As closest_vertex_triangle.
inline ClosestPack closest_vertex_triangles(const PointPack* p) {
    const PointPack* const corner = p + 1;
    const Eight zero = constant<Eight>(0);
    const PointPack side[3] = {corner[1] - corner[0], corner[2] - corner[1], corner[0] - corner[2]};
    const PointPack normal = cross(side[0], corner[2] - corner[0]);
    PointPack back[3], across[3];
    Eight along[3], length[3];
    for (int k = 0; k < 3; ++k) {
        const PointPack offset = p[0] - corner[k];
        back[k] = corner[k] - p[0];
        along[k] = dot(side[k], offset), length[k] = square(side[k]), across[k] = cross(offset, side[k]);
    }
    const Eight size = square(normal), height = dot(normal, back[0]);
    const Eight slanted = length[0] * length[2] * kSlanted;
    ClosestPack closest = {constant<Eight>(kInside), quotient(height * height, size), height * normal,
                           bits_of(less(slanted, size))};
    for (int k = 2; k >= 0; --k) {
        const int before = k == 0 ? 2 : k - 1;
        const auto at_corner = ~(less(zero, along[k]) | less(along[before], length[before]));
        closest.take_where(at_corner, constant<Eight>(kCorner + k), square(back[k]), back[k]);
    }
    for (int k = 2; k >= 0; --k) {
        const auto outwards = ~less(dot(normal, across[k]), zero);
        const auto beside = outwards & less(zero, along[k]) & less(along[k], length[k]);
        const Eight per_length = inverse(length[k]);
        closest.take_where(beside, constant<Eight>(kSide + k), square(across[k]) * per_length,
                           back[k] + (along[k] * per_length) * side[k]);
    }
    return closest;
}

// As closest_edges.
inline ClosestPack closest_of_edges(const PointPack* p) {
    const Eight zero = constant<Eight>(0), one = constant<Eight>(1), two = constant<Eight>(2);
    const PointPack u = p[1] - p[0], v = p[3] - p[2], w = p[0] - p[2], normal = cross(u, v);
    const Eight size = square(normal), u_length = square(u), v_length = square(v);
    const Eight per_u = inverse(u_length), per_v = inverse(v_length);
    ClosestPack closest = {zero, constant<Eight>(INFINITY), w, 0};
    for (int k = 0; k < 4; ++k) {
        const bool first = k < 2;
        const PointPack edge = first ? v : u;
        const Eight length = first ? v_length : u_length, per_length = first ? per_v : per_u;
        const PointPack *const other = first ? p + 2 : p, offset = p[k] - other[0], behind = p[k] - other[1];
        const Eight along = dot(edge, offset);
        const auto begun = less(zero, along), ended = ~less(along, length), between = begun & ~ended;
        const PointPack foot = offset - (along * per_length) * edge;
        const Eight squared =
            select(begun, select(between, square(cross(offset, edge)) * per_length, square(behind)), square(offset));
        const Eight feature = select(begun, select(between, two, one), zero);
        const PointPack back = select(begun, select(between, foot, behind), offset);
        const PointPack none = {zero, zero, zero};
        closest.take_where(less(squared, closest.squared),
                           first ? feature + constant<Eight>(3 * k) : feature * 3.0 + constant<Eight>(k - 2), squared,
                           first ? none - back : back);
    }
    const Eight s = dot(normal, cross(v, w)), t = dot(normal, cross(u, w)), height = dot(normal, w);
    const auto between = less(zero, s) & less(s, size) & less(zero, t) & less(t, size);
    closest.take_where(between, constant<Eight>(kLineLine), quotient(height * height, size), (zero - height) * normal);
    closest.sure = ~bits_of(between) | bits_of(less(u_length * v_length * kSlanted, size));
    return closest;
}

// p: the vertices, [4]; kSplit: how many are of the first piece.
template <int kSplit>
inline ClosestPack closest_of_pack(const PointPack* p) {
    return kSplit == 1 ? closest_vertex_triangles(p) : closest_of_edges(p);
}

inline Closest closest_of_pair(const Point* p, int split) {
    return split == 1 ? closest_vertex_triangle(p) : closest_edges(p);
}

}  // namespace yasps
