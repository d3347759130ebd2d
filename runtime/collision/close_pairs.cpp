// Close pairs of surface pieces sorted by the distance formula that each needs, and how far a step may go.
//
// The pairs come from near_pairs.cpp: edges as int [n, 4], edge by edge; vertex and triangle as int [n, 4], the
// vertex first. What is close, and with which weight, is as in Li et al. 2020 and its supplement; or, with improved
// max, as in improved_max.h.
#include <algorithm>
#include <new>

#include "collision/close_entry.h"
#include "collision/improved_max.h"
#include "collision/list.h"
#include "collision/pair_distance.h"
#include "collision/thickness.h"
#include "collision/time_apart.h"
#include "core/runtime.h"

namespace yasps {
namespace {

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
    Thickness thickness;
    ImprovedMax improved_max;
    List<NearTriangle> near;
    List<uint64_t> order;
    List<CloseEntry> found, entries;  // before and after equal ones became one
    List<EntryKey> keys;
    double least_distance, least_gap;  // squared where nothing has a radius

    // Two edges. improved: they are not merged with others.
    bool look_at_edges(const int* v, const Point* x, const Point* x0, double reach, bool improved) {
        Point p[4];
        gather(v, x, p);
        const Closest closest = closest_edges(p);
        double share = 1;
        if (!is_close(v, 2, p, closest, x0, reach, &share)) return true;
        const double threshold = 1e-3 * square(x0[v[1]] - x0[v[0]]) * square(x0[v[3]] - x0[v[2]]);
        CloseEntry entry = of_edges(v, p, threshold, closest.features);
        entry.share = share;
        if (improved)
            for (int k = 0; k < 2; ++k) entry.edges[k] = edges.of(v[2 * k], v[2 * k + 1]);
        return found.push(entry);
    }

    // A vertex and a triangle. improved: they are kept for add_near.
    bool look_at_triangle(const int* v, const Point* x, const Point* x0, double reach, bool improved) {
        Point p[4];
        gather(v, x, p);
        const Closest closest = closest_vertex_triangle(p);
        double share = 1;
        const bool close = is_close(v, 1, p, closest, x0, reach, &share);
        if (improved) {
            if (!close && !(thickness.any() && thickness.may_be_close(v, closest, reach))) return true;
            return near.push({v[0], {v[1], v[2], v[3]}, closest.features, close, share});
        }
        if (!close) return true;
        CloseEntry entry = of_vertex_and_triangle(v, closest.features);
        entry.share = share;
        return found.push(entry);
    }

    // How often each vertex counts at each place of the triangles near it.
    bool add_near(const Point* x, double reach) {
        order.clear();
        if (!order.grow(near.count)) return false;
        for (long k = 0; k < near.count; ++k) order.add(static_cast<uint64_t>(near[k].vertex) << 32 | k);
        std::sort(order.begin(), order.end());
        for (long k = 0, next; k < order.count; k = next) {
            const uint64_t upper = order[k] >> 32;
            for (next = k; next < order.count && order[next] >> 32 == upper;) ++next;
            const int vertex = static_cast<int>(upper);
            const auto triangle = [&](long t) -> const NearTriangle& { return near[order[k + t] & 0xffffffff]; };
            const auto add = [&](CloseEntry entry, int times, double share) {
                entry.times[entry.vertices[0] == vertex ? 0 : 1] = times;
                entry.edges[0] = entry.edges[1] = edges.count;
                entry.share = share;
                return found.push(entry);
            };
            const bool fine = improved_max.count(
                triangle, next - k, x, reach, thickness,
                [&](const NearTriangle& t) { return add(of_vertex_and_triangle(&t.vertex, t.features), 1, t.share); },
                [&](int a, int b, int times, double share) { return add(point_edge(vertex, a, b), times, share); },
                [&](int a, int times, double share) { return add(point_point(vertex, a), times, share); });
            if (!fine) return false;
        }
        return true;
    }

    // Sorts what was found, and makes one entry of equal ones; with improved max, none where they cancel. False: out of
    // memory.
    bool merge(bool improved) {
        keys.clear(), entries.clear();
        if (!keys.grow(found.count) || !entries.grow(found.count)) return false;
        for (long k = 0; k < found.count; ++k) keys.add({found[k], static_cast<int>(k)});
        std::sort(keys.begin(), keys.end(), Before{found.begin()});
        for (long k = 0, next; k < keys.count; k = next) {
            CloseEntry entry = found[keys[k].index];
            for (next = k + 1; next < keys.count && same_entry(entry, found[keys[next].index]); ++next) {
                const CloseEntry& other = found[keys[next].index];
                entry.weight += other.weight;
                for (int c = 0; c < 2; ++c) entry.times[c] += other.times[c];
            }
            const bool cancelled = improved && entry.edges[0] == edges.count && !entry.times[0] && !entry.times[1];
            if (!cancelled) entries.add(entry);
        }
        return true;
    }

  private:
    // Whether a pair's gap is less than `reach`; then notes how near it is. share: of its offset, if it is near at all.
    bool is_close(const int* v, int split, const Point* p, Closest closest, const Point* x0, double reach,
                  double* share) {
        if (!thickness.any()) {
            if (!(closest.squared < reach * reach)) return false;
            least_distance = std::min(least_distance, closest.squared);
            return true;
        }
        const double offset = thickness.offset(v, p, split, closest.features), distance = sqrt(closest.squared);
        if (!(distance - offset < reach)) return false;
        *share = thickness.share(v, split, x0);
        const double gap = distance - *share * offset;
        if (!(gap < reach)) return false;
        least_distance = std::min(least_distance, closest.squared), least_gap = std::min(least_gap, gap);
        return true;
    }
};

}  // namespace
}  // namespace yasps

using namespace yasps;

extern "C" {

void yasps_close_set_free(void* set) { delete static_cast<CloseSet*>(set); }

// Null: out of memory. edges: [edge_count, 2] of all vertices, the lower end first, in lexicographic order. radii:
// [vertices], or null; objects: [vertices], the number of the object that each is in; both are kept, not copied.
// reach: of the barrier, which pairs of one object have between them at rest.
void* yasps_close_set_new(const int* edges, long edge_count, long vertices, const double* radii, const int* objects,
                          double reach) {
    CloseSet* const set = new (std::nothrow) CloseSet;
    if (set == nullptr) return nullptr;
    set->thickness = {radii, objects, reach};
    if (!set->edges.take(edges, edge_count, vertices) || !set->improved_max.prepare(vertices)) {
        delete set;
        return nullptr;
    }
    return set;
}

// Finds the pairs whose gap is less than `reach`, sorted by kind, vertices, edges and share, equal ones once; they stay
// in the set until the next call. improved: with improved max and edges. rest: where vertices are at rest.
// ends[k] becomes the end of kind k; least[0] the distance of the nearest pair, least[1] the least gap, infinite where
// there is none.
int yasps_close_set_find(void* close_set, const double* positions, const double* rest, double reach, int improved,
                         const int* edge_edge, long edge_count, const int* vertex_triangle, long triangle_count,
                         long* ends, double* least) {
    const Point *const x = reinterpret_cast<const Point*>(positions), *const x0 = reinterpret_cast<const Point*>(rest);
    CloseSet& set = *static_cast<CloseSet*>(close_set);
    set.near.clear(), set.found.clear();
    set.least_distance = set.least_gap = INFINITY;
    for (long k = 0; k < edge_count; ++k)
        if (!set.look_at_edges(edge_edge + 4 * k, x, x0, reach, improved)) return kOutOfMemory;
    for (long k = 0; k < triangle_count; ++k)
        if (!set.look_at_triangle(vertex_triangle + 4 * k, x, x0, reach, improved)) return kOutOfMemory;
    if ((improved && !set.add_near(x, reach)) || !set.merge(improved)) return kOutOfMemory;
    long end = 0;
    for (int kind = 0; kind < kKinds; ++kind) {
        while (end < set.entries.count && set.entries[end].kind == kind) ++end;
        ends[kind] = end;
    }
    least[0] = sqrt(set.least_distance);
    least[1] = set.thickness.any() ? set.least_gap : least[0];
    return kOk;
}

// Copies what was found last, [the last end] each: vertices [4], weights, counts and edges [2], shares. Null: not
// needed.
void yasps_close_set_copy(const void* close_set, int* vertices, double* weights, int* counts, int* edges,
                          double* shares) {
    const CloseSet& set = *static_cast<const CloseSet*>(close_set);
    for (long k = 0; k < set.entries.count; ++k) {
        const CloseEntry& entry = set.entries[k];
        std::copy_n(entry.vertices, 4, vertices + 4 * k);
        weights[k] = entry.weight, shares[k] = entry.share;
        if (counts != nullptr) std::copy_n(entry.times, 2, counts + 2 * k);
        if (edges != nullptr) std::copy_n(entry.edges, 2, edges + 2 * k);
    }
}

// The largest step in [0, 1] from start towards end at which every pair still has a tenth of its gap, to 1 %; -1 if one
// is within `touching` at the start. The gap is less by the radii of the close set.
double yasps_step_bound(const void* close_set, const double* start, const double* end, const double* rest,
                        double touching, const int* edge_edge, long edge_count, const int* vertex_triangle,
                        long triangle_count) {
    const Point *const from = reinterpret_cast<const Point*>(start), *const to = reinterpret_cast<const Point*>(end);
    const Point* const x0 = reinterpret_cast<const Point*>(rest);
    const Thickness& thickness = static_cast<const CloseSet*>(close_set)->thickness;
    double step = 1;
    const auto moving = [&](const int* v, int split) {
        MovingPair pair;
        pair.split = split;
        for (int c = 0; c < 4; ++c) pair.at[c] = from[v[c]], pair.move[c] = to[v[c]] - pair.at[c];
        return pair;
    };
    const auto look_at = [&](const int* v, int split) {
        MovingPair pair = moving(v, split);
        const Closest closest = pair.closest(pair.at);
        if (!(closest.squared > touching * touching)) return false;
        step = std::min(step, time_apart(pair, closest, 0, step));
        return true;
    };
    const auto look_at_thick = [&](const int* v, int split) {
        MovingPair pair = moving(v, split);
        const Closest closest = pair.closest(pair.at);
        const double offset = thickness.offset(v, pair.at, split, closest.features), least = thickness.least(v, split);
        const double distance = sqrt(closest.squared);
        if (distance - offset > touching && !(time_apart(pair, closest, least, step) < step)) return true;
        const double share = thickness.share(v, split, x0);  // it costs more, and allows more
        if (!(distance - share * offset > touching)) return false;
        pair = moving(v, split);
        step = std::min(step, time_apart(pair, closest, share * least, step));
        return true;
    };
    const auto all = [&](const auto& look) {
        for (long k = 0; k < edge_count; ++k)
            if (!look(edge_edge + 4 * k, 2)) return false;
        for (long k = 0; k < triangle_count; ++k)
            if (!look(vertex_triangle + 4 * k, 1)) return false;
        return true;
    };
    return (thickness.any() ? all(look_at_thick) : all(look_at)) ? step : -1;
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
