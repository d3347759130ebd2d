// Close pairs of surface pieces sorted by the distance formula that each needs, and how far a step may go.
//
// The pairs come from near_pairs.cpp: edges as int [n, 4], edge by edge; vertex and triangle as int [n, 4], the
// vertex first. What is close, and with which weight, is as in Li et al. 2020 and its supplement.
#include <algorithm>

#include "collision/pair_distance.h"
#include "collision/time_apart.h"
#include "core/runtime.h"

namespace yasps {
namespace {

// In the order of the fields of ActiveSet.
enum Kind {
    kPointPoint,
    kPointEdge,
    kPointTriangle,
    kEdgeEdge,
    kMollifiedEdgeEdge,
    kMollifiedPointEdge,
    kMollifiedPointPoint,
    kKinds
};

// Its layout is part of the interface to Python.
struct ClosePair {
    int kind;
    int vertices[4];  // the places that a kind does not use are 0
    int unused;
    double weight, threshold;
};

inline bool same_entry(const ClosePair& a, const ClosePair& b) {
    return a.kind == b.kind && std::equal(a.vertices, a.vertices + 4, b.vertices);
}
inline bool before(const ClosePair& a, const ClosePair& b) {
    if (a.kind != b.kind) return a.kind < b.kind;
    return std::lexicographical_compare(a.vertices, a.vertices + 4, b.vertices, b.vertices + 4);
}

inline ClosePair point_point(int a, int b) { return {kPointPoint, {std::min(a, b), std::max(a, b), 0, 0}, 0, 1, 0}; }
inline ClosePair point_edge(int point, int a, int b) {
    return {kPointEdge, {point, std::min(a, b), std::max(a, b), 0}, 0, 1, 0};
}

inline void gather(const int* ids, const Point* x, Point* p) {
    for (int c = 0; c < 4; ++c) p[c] = x[ids[c]];
}

ClosePair of_vertex_and_triangle(const int* v, int features) {
    const int* const corner = v + 1;
    if (features >= kInside) return {kPointTriangle, {v[0], v[1], v[2], v[3]}, 0, 1, 0};
    if (features >= kSide) {
        const int k = features - kSide;
        return point_edge(v[0], corner[k], corner[k == 2 ? 0 : k + 1]);
    }
    return point_point(v[0], corner[features]);
}

// threshold: the pair is mollified where |u x v|^2 is below it.
ClosePair of_edges(const int* v, const Point* p, double threshold, int features) {
    const int first = features / 3, second = features % 3;
    const bool mollified = square(cross(p[1] - p[0], p[3] - p[2])) < threshold;
    if (features == kLineLine) {
        const int kind = mollified ? kMollifiedEdgeEdge : kEdgeEdge;
        return {kind, {v[0], v[1], v[2], v[3]}, 0, 1, mollified ? threshold : 0};
    }
    if (first != kBetween && second != kBetween) {
        int a = v[first], a_other = v[1 - first], b = v[2 + second], b_other = v[3 - second];
        if (!mollified) return point_point(a, b);
        if (b < a) std::swap(a, b), std::swap(a_other, b_other);
        return {kMollifiedPointPoint, {a, b, a_other, b_other}, 0, 1, threshold};
    }
    // An end of one edge, and the other edge.
    const int* const edge = first == kBetween ? v : v + 2;
    const int* const own = first == kBetween ? v + 2 : v;
    const int end = first == kBetween ? second : first;
    if (!mollified) return point_edge(own[end], edge[0], edge[1]);
    return {kMollifiedPointEdge, {own[end], edge[0], edge[1], own[1 - end]}, 0, 1, threshold};
}

}  // namespace
}  // namespace yasps

using namespace yasps;

extern "C" {

// Writes the pairs closer than `reach` to `found`, sorted by kind and vertices, equal ones once with their number as
// weight; found has room for both counts together. ends[k] becomes the end of kind k in it, nearest[0] the squared
// distance of the nearest pair, infinite where there is none. rest: where edges get their threshold from.
void yasps_close_pairs(const double* positions, const double* rest, double reach, const int* edge_edge, long edge_count,
                       const int* vertex_triangle, long triangle_count, void* found, long* ends, double* nearest) {
    const Point *const x = reinterpret_cast<const Point*>(positions), *const x0 = reinterpret_cast<const Point*>(rest);
    ClosePair* const pairs = static_cast<ClosePair*>(found);
    Point p[4];
    long count = 0;
    double least = INFINITY;
    for (long k = 0; k < edge_count; ++k) {
        const int* const v = edge_edge + 4 * k;
        gather(v, x, p);
        const Closest closest = closest_edges(p);
        if (!(closest.squared < reach * reach)) continue;
        least = std::min(least, closest.squared);
        const double threshold = 1e-3 * square(x0[v[1]] - x0[v[0]]) * square(x0[v[3]] - x0[v[2]]);
        pairs[count++] = of_edges(v, p, threshold, closest.features);
    }
    for (long k = 0; k < triangle_count; ++k) {
        const int* const v = vertex_triangle + 4 * k;
        gather(v, x, p);
        const Closest closest = closest_vertex_triangle(p);
        if (!(closest.squared < reach * reach)) continue;
        least = std::min(least, closest.squared);
        pairs[count++] = of_vertex_and_triangle(v, closest.features);
    }
    std::sort(pairs, pairs + count, before);
    long last = -1;
    for (long k = 0; k < count; ++k) {
        // Only entries without a mollifier can be equal: a mollified one names both its edges.
        if (last >= 0 && same_entry(pairs[last], pairs[k]))
            pairs[last].weight += 1;
        else
            pairs[++last] = pairs[k];
    }
    long end = 0;
    for (int kind = 0; kind < kKinds; ++kind) {
        while (end <= last && pairs[end].kind == kind) ++end;
        ends[kind] = end;
    }
    *nearest = least;
}

// The largest step in [0, 1] from start towards end at which every pair still has a tenth of its distance, to 1 %; -1
// if one is within `touching` at the start.
double yasps_step_bound(const double* start, const double* end, double touching, const int* edge_edge, long edge_count,
                        const int* vertex_triangle, long triangle_count) {
    const Point *const from = reinterpret_cast<const Point*>(start), *const to = reinterpret_cast<const Point*>(end);
    double step = 1;
    const auto look_at = [&](const int* v, int split) {
        MovingPair pair;
        pair.split = split;
        for (int c = 0; c < 4; ++c) pair.at[c] = from[v[c]], pair.move[c] = to[v[c]] - pair.at[c];
        const Closest closest = pair.closest(pair.at);
        if (!(closest.squared > touching * touching)) return false;
        step = std::min(step, time_apart(pair, closest, step));
        return true;
    };
    for (long k = 0; k < edge_count; ++k)
        if (!look_at(edge_edge + 4 * k, 2)) return -1;
    for (long k = 0; k < triangle_count; ++k)
        if (!look_at(vertex_triangle + 4 * k, 1)) return -1;
    return step;
}

// Where on the way from start to end ([vertices, 3], of ids [count]) all vertices are nearest to `positions`, and the
// largest distance of one from there.
void yasps_distance_to_way(const double* start, const double* end, const double* positions, const int* ids, long count,
                           double* result) {
    const Point *const from = reinterpret_cast<const Point*>(start), *const to = reinterpret_cast<const Point*>(end);
    const Point* const at = reinterpret_cast<const Point*>(positions);
    double along = 0, length = 0;
    for (long k = 0; k < count; ++k) {
        const Point way = to[ids[k]] - from[ids[k]];
        along += dot(way, at[ids[k]] - from[ids[k]]);
        length += square(way);
    }
    const double step = length > 0 ? std::min(1.0, std::max(0.0, along / length)) : 0;
    double largest = 0;
    for (long k = 0; k < count; ++k) {
        const Point way = to[ids[k]] - from[ids[k]];
        largest = std::max(largest, square(at[ids[k]] - from[ids[k]] - step * way));
    }
    *result = sqrt(largest);
}
}
