// Entries of the active set: a distance formula and the vertices that it needs.
#pragma once

#include <algorithm>

#include "collision/pair_distance.h"
#include "core/runtime.h"

namespace yasps {

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

struct CloseEntry {
    int kind;
    int vertices[4];  // the places that a kind does not use are 0
    int edges[2];     // of an edge pair, with improved max
    int times[2];     // how often the areas of vertices[0] and vertices[1] count, with improved max
    int weight;       // how many pairs it is
    double share;     // of the offset by the radii
};

inline bool same_entry(const CloseEntry& a, const CloseEntry& b) {
    return a.kind == b.kind && std::equal(a.vertices, a.vertices + 4, b.vertices) &&
           std::equal(a.edges, a.edges + 2, b.edges) && a.share == b.share;
}
// The order of entries: by kind, vertices, edges and share.
inline bool before(const CloseEntry& a, const CloseEntry& b) {
    if (a.kind != b.kind) return a.kind < b.kind;
    for (int k = 0; k < 4; ++k)
        if (a.vertices[k] != b.vertices[k]) return a.vertices[k] < b.vertices[k];
    for (int k = 0; k < 2; ++k)
        if (a.edges[k] != b.edges[k]) return a.edges[k] < b.edges[k];
    return a.share < b.share;
}

inline CloseEntry entry(int kind, int a, int b, int c, int d) { return {kind, {a, b, c, d}, {0, 0}, {0, 0}, 1, 1}; }
inline CloseEntry point_point(int a, int b) { return entry(kPointPoint, std::min(a, b), std::max(a, b), 0, 0); }
inline CloseEntry point_edge(int point, int a, int b) {
    return entry(kPointEdge, point, std::min(a, b), std::max(a, b), 0);
}

inline void gather(const int* ids, const Point* x, Point* p) {
    for (int c = 0; c < 4; ++c) p[c] = x[ids[c]];
}

inline CloseEntry of_vertex_and_triangle(const int* v, int features) {
    const int* const corner = v + 1;
    if (features >= kInside) return entry(kPointTriangle, v[0], v[1], v[2], v[3]);
    if (features >= kSide) {
        const int k = features - kSide;
        return point_edge(v[0], corner[k], corner[k == 2 ? 0 : k + 1]);
    }
    return point_point(v[0], corner[features]);
}

// threshold: the pair is mollified where |u x v|^2 is below it.
inline CloseEntry of_edges(const int* v, const Point* p, double threshold, int features) {
    const int first = features / 3, second = features % 3;
    const bool mollified = square(cross(p[1] - p[0], p[3] - p[2])) < threshold;
    if (features == kLineLine) return entry(mollified ? kMollifiedEdgeEdge : kEdgeEdge, v[0], v[1], v[2], v[3]);
    if (first != kBetween && second != kBetween) {
        int a = v[first], a_other = v[1 - first], b = v[2 + second], b_other = v[3 - second];
        if (!mollified) return point_point(a, b);
        if (b < a) std::swap(a, b), std::swap(a_other, b_other);
        return entry(kMollifiedPointPoint, a, b, a_other, b_other);
    }
    // An end of one edge, and the other edge.
    const int* const edge = first == kBetween ? v : v + 2;
    const int* const own = first == kBetween ? v + 2 : v;
    const int end = first == kBetween ? second : first;
    if (!mollified) return point_edge(own[end], edge[0], edge[1]);
    return entry(kMollifiedPointEdge, own[end], edge[0], edge[1], own[1 - end]);
}

}  // namespace yasps
