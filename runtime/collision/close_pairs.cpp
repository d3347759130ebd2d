// Close pairs of surface pieces sorted by the distance formula that each needs.
//
// The pairs come from near_pairs.cpp: edges as int [n, 4], edge by edge; vertex and triangle as int [n, 4], the
// vertex first. What is close, and with which weight, is as in Li et al. 2020 and its supplement; or, with improved
// max, as in improved_max.h.
//
// Threads take pairs in chunks. Pairs that are far apart along the line through their middles are left out eight at a
// time, then those whose distance is too large; what is left is put into its kind. Entries are sorted in the end, and
// equal ones added up, which are whole numbers: so nothing depends on who found what.
#include <algorithm>
#include <new>

#include "collision/chunks.h"
#include "collision/close_entry.h"
#include "collision/improved_max.h"
#include "collision/list.h"
#include "collision/pair_distance.h"
#include "collision/pair_packs.h"
#include "collision/thickness.h"
#include "core/runtime.h"

namespace yasps {
namespace {

constexpr long kChunk = 1024;  // pairs

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

// Where vertices are now and at rest, and how close is close.
struct Question {
    const Point *x, *rest;
    double reach;
    bool improved;
    int threads;
};

// The least distance and gap that a thread has seen; of the distance the square.
struct alignas(64) Least {
    double squared, gap;
};

// The close pairs last found, and memory for the next ones.
struct CloseSet {
    long vertices = 0;
    EdgeNumbers edges;
    Thickness thickness;
    Places places, places_at_rest;
    ChunkLists<CloseEntry> of_edges_found, of_triangles_found;
    ChunkLists<NearTriangle> near_found;
    Buffer<NearTriangle> near;
    Buffer<int> group_start, order;
    ImprovedMax improved_max[kMostThreads];
    Least least[kMostThreads];
    Buffer<CloseEntry> sorted;  // all that was found; of each part the first ones remain
    Buffer<long> bucket_start, next, part_start;
    struct Part {
        Range left;  // what remains of it, in `sorted`
        long of_kind[kKinds];
    };
    Buffer<Part> parts;
    long part_count = 0;

    // False: out of memory.
    bool find(const Question& ask, const int* edge_edge, long edge_count, const int* vertex_triangle,
              long triangle_count) {
        const double* const radii = thickness.radii;
        if (!places.take(ask.x, nullptr, radii, vertices, ask.threads)) return false;
        if (thickness.any() && !places_at_rest.take(ask.rest, nullptr, radii, vertices, ask.threads)) return false;
        for (Least& one : least) one = {INFINITY, INFINITY};
        of_triangles_found.clear(), near_found.clear();
        const bool edges_fine = look<2>(ask, edge_edge, edge_count, of_edges_found, [&](const Near& pair, auto& list) {
            if (!list.grow(1)) return false;
            list.add(entry_of_edges(ask, pair.v, pair.closest.features));
            CloseEntry& entry = list[list.count - 1];
            entry.share = pair.share;
            if (ask.improved)  // edge pairs are not merged with others
                for (int k = 0; k < 2; ++k) entry.edges[k] = edges.of(pair.v[2 * k], pair.v[2 * k + 1]);
            return true;
        });
        if (!edges_fine) return false;
        const auto close_triangle = [&](const Near& pair, List<CloseEntry>& list) {
            if (!list.grow(1)) return false;
            list.add(of_vertex_and_triangle(pair.v, pair.closest.features));
            list[list.count - 1].share = pair.share;
            return true;
        };
        const auto near_triangle = [&](const Near& pair, List<NearTriangle>& list) {
            const int* const v = pair.v;
            return list.push({v[0], {v[1], v[2], v[3]}, pair.closest.features, pair.close, pair.share});
        };
        const bool triangles_fine =
            ask.improved ? look<1>(ask, vertex_triangle, triangle_count, near_found, near_triangle) && add_near(ask)
                         : look<1>(ask, vertex_triangle, triangle_count, of_triangles_found, close_triangle);
        return triangles_fine && merge(ask);
    }

    // Where the entries of each kind end.
    void ends_of_kinds(long* ends) const {
        std::fill_n(ends, int(kKinds), 0);
        for (long p = 0; p < part_count; ++p)
            for (int kind = 0; kind < kKinds; ++kind) ends[kind] += parts[p].of_kind[kind];
        for (int kind = 1; kind < kKinds; ++kind) ends[kind] += ends[kind - 1];
    }

  private:
    // A pair that may be close; `close` says if it is. share: of its offset.
    struct Near {
        const int* v;
        Closest closest;
        bool close;
        double share;
    };
    // A pair whose gap is less than the reach if its offset counts whole.
    struct Measured {
        int number;
        Closest closest;
        double distance, offset;
    };

    // Calls take(Near, list) for all pairs that are close; and for those of vertex and triangle, with improved max, of
    // which another place of the triangle may be. False: out of memory.
    template <int kSplit, class T, class Take>
    bool look(const Question& ask, const int* rows, long count, ChunkLists<T>& lists, const Take& take) {
        constexpr int kMany = 5;  // lanes of eight that are near: the others are not worth another look at the vertices
        return lists.run((count + kChunk - 1) / kChunk, ask.threads, [&](long chunk, List<T>& list) {
            const long begin = chunk * kChunk, end = std::min(count, begin + kChunk);
            int near[kChunk], near_count = 0;
            Measured measured[kChunk];
            Measured* last = measured;
            for (long k = begin; k < end; k += kPack) {
                int numbers[kPack];
                const int lanes = static_cast<int>(std::min<long>(kPack, end - k));
                for (int l = 0; l < kPack; ++l) numbers[l] = static_cast<int>(k + l);
                const PairPack pack = gather(places, rows, numbers, lanes);
                const unsigned within = near_lanes<kSplit>(ask, pack) & ((1U << lanes) - 1);
                if (__builtin_popcount(within) >= kMany) {
                    if (!measure<kSplit>(ask, rows, pack, numbers, within, &last, list, take)) return false;
                    continue;
                }
                for (int l = 0; l < lanes; ++l) {
                    near[near_count] = numbers[l];
                    near_count += within >> l & 1;
                }
            }
            for (int k = 0; k < near_count; k += kPack) {
                const int lanes = std::min<int>(kPack, near_count - k);
                const PairPack pack = gather(places, rows, near + k, lanes);
                if (!measure<kSplit>(ask, rows, pack, near + k, (1U << lanes) - 1, &last, list, take)) return false;
            }
            for (const Measured* first = measured; first < last; first += kPack) {
                const int lanes = static_cast<int>(std::min<long>(kPack, last - first));
                if (!settle<kSplit>(ask, rows, first, lanes, list, take)) return false;
            }
            return true;
        });
    }

    // A bit for each of eight pairs that may be within reach, by the line through their middles.
    template <int kSplit>
    unsigned near_lanes(const Question& ask, const PairPack& pack) const {
        PointPack q[4];
        pack.relative(q);
        return ~bits_of(along_middles<kSplit>(q).is_beyond(far_away<kSplit>(ask, pack)));
    }

    // The distance from which on pairs are not close, whatever their shares are.
    template <int kSplit>
    static Eight far_away(const Question& ask, const PairPack& pack) {
        return most_radii<kSplit>(pack.radius) + constant<Eight>(ask.reach);
    }

    // Measures these lanes of eight pairs; writes those that may be close from *last on. False: out of memory.
    template <int kSplit, class T, class Take>
    bool measure(const Question& ask, const int* rows, const PairPack& pack, const int* numbers, unsigned lanes,
                 Measured** last, List<T>& list, const Take& take) const {
        const ClosestPack closest = closest_of_pack<kSplit>(pack.p);
        const Eight far = far_away<kSplit>(ask, pack);
        lanes &= ~(bits_of(less(far * far * (1 + 1e-9), closest.squared)) & closest.sure);
        double features[kPack], squared[kPack];
        store_lanes(features, closest.features), store_lanes(squared, closest.squared);
        for (; lanes != 0; lanes &= lanes - 1) {
            const int l = __builtin_ctz(lanes), *const v = rows + 4L * numbers[l];
            Point p[4];
            gather(v, ask.x, p);
            Measured pair = {numbers[l], {static_cast<int>(features[l]), squared[l]}, 0, 0};
            if (!(closest.sure >> l & 1)) pair.closest = closest_of_pair(p, kSplit);
            if (!thickness.any()) {
                if (pair.closest.squared < ask.reach * ask.reach) *(*last)++ = pair;
                continue;
            }
            pair.distance = sqrt(pair.closest.squared);
            pair.offset = thickness.offset(v, p, kSplit, pair.closest.features);
            if (pair.distance - pair.offset < ask.reach)
                *(*last)++ = pair;
            else if (may_count<kSplit>(ask, v, pair.closest) && !take({v, pair.closest, false, 1}, list))
                return false;
        }
        return true;
    }

    // Takes those of up to eight pairs whose gap is less than the reach, and notes how near they are. Of their offset
    // those that are far apart at rest have all. False: out of memory.
    template <int kSplit, class T, class Take>
    bool settle(const Question& ask, const int* rows, const Measured* pairs, int lanes, List<T>& list,
                const Take& take) {
        unsigned apart_at_rest = 0;
        if (thickness.any()) {
            int numbers[kPack];
            for (int l = 0; l < lanes; ++l) numbers[l] = pairs[l].number;
            const PairPack pack = gather(places_at_rest, rows, numbers, lanes);
            PointPack q[4];
            pack.relative(q);
            const Eight far = most_radii<kSplit>(pack.radius) + constant<Eight>(thickness.reach);
            apart_at_rest = bits_of(along_middles<kSplit>(q).is_beyond(far * (1 + 1e-9)));
        }
        Least& here = least[omp_get_thread_num()];
        for (int l = 0; l < lanes; ++l) {
            const Measured& pair = pairs[l];
            const int* const v = rows + 4L * pair.number;
            double share = 1;
            bool close = true;
            if (thickness.any()) {
                share = apart_at_rest >> l & 1 ? 1 : thickness.share(v, kSplit, ask.rest);
                const double gap = pair.distance - share * pair.offset;
                close = gap < ask.reach;
                if (close) here.gap = std::min(here.gap, gap);
            }
            if (close) here.squared = std::min(here.squared, pair.closest.squared);
            if ((close || may_count<kSplit>(ask, v, pair.closest)) && !take({v, pair.closest, close, share}, list))
                return false;
        }
        return true;
    }

    // Whether a pair that is not close counts with improved max.
    template <int kSplit>
    bool may_count(const Question& ask, const int* v, Closest closest) const {
        return kSplit == 1 && ask.improved && thickness.any() && thickness.may_be_close(v, closest, ask.reach);
    }

    static CloseEntry entry_of_edges(const Question& ask, const int* v, int features) {
        Point p[4];
        gather(v, ask.x, p);
        const Point* const x0 = ask.rest;
        const double threshold = 1e-3 * square(x0[v[1]] - x0[v[0]]) * square(x0[v[3]] - x0[v[2]]);
        return of_edges(v, p, threshold, features);
    }

    // How often each vertex counts at each place of the triangles near it.
    bool add_near(const Question& ask) {
        const long count = near_found.total();
        if (!near.reserve(count) || !order.reserve(count) || !group_start.reserve(vertices + 2)) return false;
        near_found.copy(near.data, ask.threads);
        for (int t = 0; t < ask.threads; ++t)
            if (!improved_max[t].prepare(vertices)) return false;
        // By vertices, in the order of the pairs.
        int* const start = group_start.data;
        std::fill_n(start, vertices + 2, 0);
        for (long k = 0; k < count; ++k) ++start[near[k].vertex + 2];
        for (long v = 0; v < vertices; ++v) start[v + 2] += start[v + 1];
        for (long k = 0; k < count; ++k) order[start[near[k].vertex + 1]++] = static_cast<int>(k);
        const long chunks = (count + kChunk - 1) / kChunk;
        return of_triangles_found.run(chunks, ask.threads, [&](long chunk, List<CloseEntry>& list) {
            ImprovedMax& improved = improved_max[omp_get_thread_num()];
            const auto vertex_of = [&](long k) { return near[order[k]].vertex; };
            const long end = std::min(count, (chunk + 1) * kChunk);
            long k = chunk * kChunk;
            if (k > 0) k = start[vertex_of(k - 1) + 1];  // the vertex there belongs to the chunk before
            for (; k < end; k = start[vertex_of(k) + 1])
                if (!add_vertex(ask, &order[k], start[vertex_of(k) + 1] - k, improved, list)) return false;
            return true;
        });
    }

    bool add_vertex(const Question& ask, const int* numbers, long count, ImprovedMax& improved,
                    List<CloseEntry>& list) const {
        const auto triangle = [&](long t) -> const NearTriangle& { return near[numbers[t]]; };
        const int vertex = triangle(0).vertex;
        const auto add = [&](CloseEntry entry, int times, double share) {
            entry.times[entry.vertices[0] == vertex ? 0 : 1] = times;
            entry.edges[0] = entry.edges[1] = edges.count;
            entry.share = share;
            return list.push(entry);
        };
        return improved.count(
            triangle, count, ask.x, ask.reach, thickness,
            [&](const NearTriangle& t) { return add(of_vertex_and_triangle(&t.vertex, t.features), 1, t.share); },
            [&](int a, int b, int times, double share) { return add(point_edge(vertex, a, b), times, share); },
            [&](int a, int times, double share) { return add(point_point(vertex, a), times, share); });
    }

    // Sorts what was found, and makes one entry of equal ones; with improved max, none where they cancel. False: out of
    // memory. Buckets of kinds and first vertices are in order; each is sorted by itself.
    bool merge(const Question& ask) {
        const List<CloseEntry>* lists[2 * kMostThreads];
        int list_count = 0;
        long count = 0;
        for (const ChunkLists<CloseEntry>* const found : {&of_edges_found, &of_triangles_found})
            for (int t = 0; t < ask.threads; ++t) {
                const List<CloseEntry>& list = found->of_thread(t);
                count += list.count;
                if (list.count > 0) lists[list_count++] = &list;
            }
        int shift = 0;
        while (vertices >> shift > 256 + count / 8) ++shift;
        const long of_kind = (vertices >> shift) + 1, buckets = kKinds * of_kind;
        part_count = (count + kChunk - 1) / kChunk;
        if (!sorted.reserve(count) || !bucket_start.reserve(buckets + 1) || !next.reserve(list_count * buckets) ||
            !parts.reserve(part_count))
            return false;
        const auto bucket_of = [&](const CloseEntry& entry) {
            return entry.kind * of_kind + (entry.vertices[0] >> shift);
        };
        // Where each list's entries of each bucket go.
#pragma omp parallel for num_threads(ask.threads) schedule(dynamic) if (ask.threads > 1)
        for (int l = 0; l < list_count; ++l) {
            long* const of_list = &next[l * buckets];
            std::fill_n(of_list, buckets, 0);
            for (long k = 0; k < lists[l]->count; ++k) ++of_list[bucket_of((*lists[l])[k])];
        }
        long sum = 0;
        for (long b = 0; b < buckets; ++b) {
            bucket_start[b] = sum;
            for (int l = 0; l < list_count; ++l) {
                const long here = next[l * buckets + b];
                next[l * buckets + b] = sum;
                sum += here;
            }
        }
        bucket_start[buckets] = sum;
#pragma omp parallel for num_threads(ask.threads) schedule(dynamic) if (ask.threads > 1)
        for (int l = 0; l < list_count; ++l) {
            long* const of_list = &next[l * buckets];
            for (long k = 0; k < lists[l]->count; ++k) {
                const CloseEntry& entry = (*lists[l])[k];
                sorted[of_list[bucket_of(entry)]++] = entry;
            }
        }
#pragma omp parallel for num_threads(ask.threads) schedule(dynamic) if (ask.threads > 1)
        for (long p = 0; p < part_count; ++p) {
            // Buckets that begin among the entries of this part.
            const long* const start = bucket_start.data;
            const long begin = kChunk * p, end = std::min(count, begin + kChunk);
            long bucket = std::lower_bound(start, start + buckets, begin) - start;
            Part& part = parts[p];
            part = {{start[bucket], start[bucket]}, {}};
            for (; bucket < buckets && start[bucket] < end; ++bucket) {
                const long before_it = part.left.end;
                part.left.end = add_bucket(ask, {start[bucket], start[bucket + 1]}, before_it);
                part.of_kind[bucket / of_kind] += part.left.end - before_it;
            }
        }
        return true;
    }

    // Sorts a bucket, and writes what remains of it from `to` on. Returns where that ends.
    long add_bucket(const Question& ask, Range bucket, long to) {
        CloseEntry* const entries = sorted.data;
        std::sort(entries + bucket.begin, entries + bucket.end, before);
        for (long k = bucket.begin, next; k < bucket.end; k = next) {
            CloseEntry entry = entries[k];
            for (next = k + 1; next < bucket.end && same_entry(entry, entries[next]); ++next) {
                entry.weight += entries[next].weight;
                for (int c = 0; c < 2; ++c) entry.times[c] += entries[next].times[c];
            }
            const bool cancelled = ask.improved && entry.edges[0] == edges.count && !entry.times[0] && !entry.times[1];
            if (!cancelled) entries[to++] = entry;
        }
        return to;
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
    set->vertices = vertices;
    set->thickness = {radii, objects, reach};
    if (!set->edges.take(edges, edge_count, vertices)) {
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
                         int threads, long* ends, double* least) {
    CloseSet& set = *static_cast<CloseSet*>(close_set);
    const Question ask = {reinterpret_cast<const Point*>(positions), reinterpret_cast<const Point*>(rest), reach,
                          improved != 0, std::min(threads, kMostThreads)};
    if (!set.find(ask, edge_edge, edge_count, vertex_triangle, triangle_count)) return kOutOfMemory;
    set.ends_of_kinds(ends);
    Least all = {INFINITY, INFINITY};
    for (const Least& one : set.least) all = {std::min(all.squared, one.squared), std::min(all.gap, one.gap)};
    least[0] = sqrt(all.squared);
    least[1] = set.thickness.any() ? all.gap : least[0];
    return kOk;
}

// Copies what was found last, [the last end] each: vertices [4], weights, counts and edges [2], shares. Null: not
// needed.
int yasps_close_set_copy(void* close_set, int threads, int* vertices, double* weights, int* counts, int* edges,
                         double* shares) {
    CloseSet& set = *static_cast<CloseSet*>(close_set);
    if (!set.part_start.reserve(set.part_count)) return kOutOfMemory;
    long sum = 0;
    for (long p = 0; p < set.part_count; ++p) {
        set.part_start[p] = sum;
        sum += set.parts[p].left.end - set.parts[p].left.begin;
    }
#pragma omp parallel for num_threads(std::min(threads, kMostThreads)) schedule(dynamic) if (threads > 1)
    for (long p = 0; p < set.part_count; ++p) {
        const Range left = set.parts[p].left;
        long to = set.part_start[p];
        for (long k = left.begin; k < left.end; ++k, ++to) {
            const CloseEntry& entry = set.sorted[k];
            std::copy_n(entry.vertices, 4, vertices + 4 * to);
            weights[to] = entry.weight, shares[to] = entry.share;
            if (counts != nullptr) std::copy_n(entry.times, 2, counts + 2 * to);
            if (edges != nullptr) std::copy_n(entry.edges, 2, edges + 2 * to);
        }
    }
    return kOk;
}
}
