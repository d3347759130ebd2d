// Close pairs of surface pieces sorted by the distance formula that each needs, and how far a step may go.
//
// The pairs come from near_pairs.cpp: edges as int [n, 4], edge by edge; vertex and triangle as int [n, 4], the
// vertex first. What is close, and with which weight, is as in Li et al. 2020 and its supplement; or, with improved
// max, as in improved_max.h.
#include <algorithm>
#include <new>

#include "collision/improved_max.h"
#include "collision/list.h"
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
struct CloseEntry {
    int kind;
    int vertices[4];  // the places that a kind does not use are 0
    int edges[2];     // of an edge pair, with improved max
    int times[2];     // how often the areas of vertices[0] and vertices[1] count, with improved max
    int weight;       // how many pairs it is
};

inline bool same_entry(const CloseEntry& a, const CloseEntry& b) {
    return a.kind == b.kind && std::equal(a.vertices, a.vertices + 4, b.vertices) &&
           std::equal(a.edges, a.edges + 2, b.edges);
}
inline bool before(const CloseEntry& a, const CloseEntry& b) {
    if (a.kind != b.kind) return a.kind < b.kind;
    for (int k = 0; k < 4; ++k)
        if (a.vertices[k] != b.vertices[k]) return a.vertices[k] < b.vertices[k];
    return std::lexicographical_compare(a.edges, a.edges + 2, b.edges, b.edges + 2);
}

inline CloseEntry entry(int kind, int a, int b, int c, int d) { return {kind, {a, b, c, d}, {0, 0}, {0, 0}, 1}; }
inline CloseEntry point_point(int a, int b) { return entry(kPointPoint, std::min(a, b), std::max(a, b), 0, 0); }
inline CloseEntry point_edge(int point, int a, int b) {
    return entry(kPointEdge, point, std::min(a, b), std::max(a, b), 0);
}

inline void gather(const int* ids, const Point* x, Point* p) {
    for (int c = 0; c < 4; ++c) p[c] = x[ids[c]];
}

CloseEntry of_vertex_and_triangle(const int* v, int features) {
    const int* const corner = v + 1;
    if (features >= kInside) return entry(kPointTriangle, v[0], v[1], v[2], v[3]);
    if (features >= kSide) {
        const int k = features - kSide;
        return point_edge(v[0], corner[k], corner[k == 2 ? 0 : k + 1]);
    }
    return point_point(v[0], corner[features]);
}

// threshold: the pair is mollified where |u x v|^2 is below it.
CloseEntry of_edges(const int* v, const Point* p, double threshold, int features) {
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

// Which edge has which two ends.
class EdgeNumbers {
  public:
    int count = 0;

    // edges: [count, 2], the lower end first, in lexicographic order. False: out of memory.
    bool take(const int* edges, long edge_count, long vertices) {
        if (!last_.reserve(edge_count) || !first_of_.reserve(vertices + 1)) return false;
        count = static_cast<int>(edge_count);
        int edge = 0;
        for (long v = 0; v <= vertices; ++v) {
            while (edge < count && edges[2 * edge] < v) ++edge;
            first_of_[v] = edge;
        }
        for (int k = 0; k < count; ++k) last_[k] = edges[2 * k + 1];
        return true;
    }
    int of(int a, int b) const {
        const int lower = std::min(a, b), upper = std::max(a, b);
        const int* const last = last_.data;
        return static_cast<int>(std::lower_bound(last + first_of_[lower], last + first_of_[lower + 1], upper) - last);
    }

  private:
    Buffer<int> last_;      // [edges]: their upper ends
    Buffer<int> first_of_;  // [vertices + 1]: the first edge from a lower end on
};

// The close pairs last found, and memory for the next ones.
struct CloseSet {
    EdgeNumbers edges;
    ImprovedMax improved_max;
    List<NearTriangle> near;
    List<CloseEntry> entries;

    // An edge pair that is not merged with others.
    bool add_edges(const int* v, CloseEntry entry) {
        for (int k = 0; k < 2; ++k) entry.edges[k] = edges.of(v[2 * k], v[2 * k + 1]);
        return entries.push(entry);
    }

    // How often each vertex counts at each place of the triangles near it.
    bool add_near(const Point* x, double reach) {
        std::sort(near.begin(), near.end(),
                  [](const NearTriangle& a, const NearTriangle& b) { return a.vertex < b.vertex; });
        for (long k = 0, next; k < near.count; k = next) {
            const int vertex = near[k].vertex;
            for (next = k; next < near.count && near[next].vertex == vertex;) ++next;
            const auto add = [&](CloseEntry entry, int times) {
                entry.times[entry.vertices[0] == vertex ? 0 : 1] = times;
                entry.edges[0] = entry.edges[1] = edges.count;
                return entries.push(entry);
            };
            const bool fine = improved_max.count(
                &near[k], next - k, x, reach,
                [&](const NearTriangle& t) { return add(of_vertex_and_triangle(&t.vertex, t.features), 1); },
                [&](int a, int b, int times) { return add(point_edge(vertex, a, b), times); },
                [&](int a, int times) { return add(point_point(vertex, a), times); });
            if (!fine) return false;
        }
        return true;
    }

    // Sorts the entries and makes one of equal ones; with improved max, none where they cancel.
    void merge(bool improved) {
        std::sort(entries.begin(), entries.end(), before);
        long kept = 0;
        for (long k = 0, next; k < entries.count; k = next) {
            CloseEntry entry = entries[k];
            for (next = k + 1; next < entries.count && same_entry(entry, entries[next]); ++next) {
                entry.weight += entries[next].weight;
                for (int c = 0; c < 2; ++c) entry.times[c] += entries[next].times[c];
            }
            const bool cancelled = improved && entry.edges[0] == edges.count && !entry.times[0] && !entry.times[1];
            if (!cancelled) entries[kept++] = entry;
        }
        entries.count = kept;
    }
};

}  // namespace
}  // namespace yasps

using namespace yasps;

extern "C" {

void yasps_close_set_free(void* set) { delete static_cast<CloseSet*>(set); }

// Null: out of memory. edges: [edge_count, 2] of all vertices, the lower end first, in lexicographic order.
void* yasps_close_set_new(const int* edges, long edge_count, long vertices) {
    CloseSet* const set = new (std::nothrow) CloseSet;
    if (set == nullptr) return nullptr;
    if (!set->edges.take(edges, edge_count, vertices) || !set->improved_max.prepare(vertices)) {
        delete set;
        return nullptr;
    }
    return set;
}

// Finds the pairs closer than `reach`, sorted by kind, vertices and edges, equal ones once; they stay in the set until
// the next call. improved: with improved max and edges. rest: where edges have their lengths at rest, for mollifiers.
// ends[k] becomes the end of kind k; nearest[0] the squared distance of the nearest pair, infinite where there is none.
int yasps_close_set_find(void* close_set, const double* positions, const double* rest, double reach, int improved,
                         const int* edge_edge, long edge_count, const int* vertex_triangle, long triangle_count,
                         long* ends, double* nearest) {
    const Point *const x = reinterpret_cast<const Point*>(positions), *const x0 = reinterpret_cast<const Point*>(rest);
    CloseSet& set = *static_cast<CloseSet*>(close_set);
    set.near.clear(), set.entries.clear();
    Point p[4];
    double least = INFINITY;
    for (long k = 0; k < edge_count; ++k) {
        const int* const v = edge_edge + 4 * k;
        gather(v, x, p);
        const Closest closest = closest_edges(p);
        if (!(closest.squared < reach * reach)) continue;
        least = std::min(least, closest.squared);
        const double threshold = 1e-3 * square(x0[v[1]] - x0[v[0]]) * square(x0[v[3]] - x0[v[2]]);
        const CloseEntry edges = of_edges(v, p, threshold, closest.features);
        if (!(improved ? set.add_edges(v, edges) : set.entries.push(edges))) return kOutOfMemory;
    }
    for (long k = 0; k < triangle_count; ++k) {
        const int* const v = vertex_triangle + 4 * k;
        gather(v, x, p);
        const Closest closest = closest_vertex_triangle(p);
        if (!(closest.squared < reach * reach)) continue;
        least = std::min(least, closest.squared);
        const bool fine = improved ? set.near.push({v[0], {v[1], v[2], v[3]}, closest.features})
                                   : set.entries.push(of_vertex_and_triangle(v, closest.features));
        if (!fine) return kOutOfMemory;
    }
    if (improved && !set.add_near(x, reach)) return kOutOfMemory;
    set.merge(improved);
    long end = 0;
    for (int kind = 0; kind < kKinds; ++kind) {
        while (end < set.entries.count && set.entries[end].kind == kind) ++end;
        ends[kind] = end;
    }
    *nearest = least;
    return kOk;
}

// Copies what was found last: [the last end].
void yasps_close_set_copy(const void* close_set, void* entries) {
    const CloseSet& set = *static_cast<const CloseSet*>(close_set);
    std::copy_n(set.entries.items.data, set.entries.count, static_cast<CloseEntry*>(entries));
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
