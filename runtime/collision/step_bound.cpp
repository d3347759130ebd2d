// How far a step may go until a pair of surface pieces has used up nine tenths of its gap.
//
// Most pairs are sure to keep enough of it, and are left out eight at a time (free_ways.h). The others are looked at
// one by one, those that may be the first to meet before all others: when what is left is free up to the bound that was
// found, nothing remains to be done. Rounds have the same pairs whatever the number of threads, and every round begins
// with the bound of those before it.
#include <algorithm>
#include <new>

#include "collision/chunks.h"
#include "collision/free_ways.h"
#include "collision/thickness.h"
#include "collision/time_apart.h"
#include "core/runtime.h"

namespace yasps {
namespace {

constexpr long kFirstRound = 32;

struct StepBound {
    FreeWays free_ways;
    ChunkLists<Suspect> found;
    Buffer<Suspect> suspects;
    Buffer<double> bounds;  // of the pairs of one round

    // How far the pair v may go, at most `latest`; -1 if its gap is nothing.
    static double of_pair(const int* v, int split, const Point* from, const Point* to, const Point* rest,
                          const Thickness& thickness, double touching, double latest) {
        const auto moving = [&] {
            MovingPair pair;
            pair.split = split;
            for (int c = 0; c < 4; ++c) pair.at[c] = from[v[c]], pair.move[c] = to[v[c]] - pair.at[c];
            return pair;
        };
        MovingPair pair = moving();
        const Closest closest = pair.closest(pair.at);
        if (!thickness.any()) {
            if (!(closest.squared > touching * touching)) return -1;
            return std::min(latest, time_apart(pair, closest, 0, latest));
        }
        const double offset = thickness.offset(v, pair.at, split, closest.features), least = thickness.least(v, split);
        const double distance = sqrt(closest.squared);
        if (distance - offset > touching && !(time_apart(pair, closest, least, latest) < latest)) return latest;
        const double share = thickness.share(v, split, rest);  // it costs more, and allows more
        if (!(distance - share * offset > touching)) return -1;
        pair = moving();
        return std::min(latest, time_apart(pair, closest, share * least, latest));
    }

    // False: out of memory.
    bool find(int split, const Point* from, const Point* to, const Point* rest, const Thickness& thickness,
              double touching, const int* rows, long count, int threads, double* step) {
        const bool fine = free_ways.find(split, rows, count, threads, &found);
        const long total = found.total();
        if (!fine || !suspects.reserve(total) || !bounds.reserve(total)) return false;
        found.copy(suspects.data, threads);
        std::sort(suspects.data, suspects.data + total, [](const Suspect& a, const Suspect& b) {
            return a.free_until < b.free_until || (a.free_until == b.free_until && a.number < b.number);
        });
        long end = 0;
        for (long begin = 0, most = kFirstRound; begin < total && *step >= 0; begin = end, most *= 2) {
            const double latest = *step;
            while (end < total && end - begin < most &&
                   (suspects[end].free_until < latest || suspects[end].free_until == 0))
                ++end;
            if (end == begin) break;
#pragma omp parallel for num_threads(threads) schedule(dynamic, 8) if (threads > 1 && end - begin > kFirstRound)
            for (long k = begin; k < end; ++k)
                bounds[k] = of_pair(rows + 4L * suspects[k].number, split, from, to, rest, thickness, touching, latest);
            for (long k = begin; k < end; ++k) *step = std::min(*step, bounds[k]);
        }
        return true;
    }
};

}  // namespace
}  // namespace yasps

using namespace yasps;

extern "C" {

void yasps_step_bound_free(void* memory) { delete static_cast<StepBound*>(memory); }

// Memory for yasps_step_bound, kept from call to call. Null: out of memory.
void* yasps_step_bound_new() { return new (std::nothrow) StepBound; }

// The largest step in [0, 1] from start towards end ([vertices, 3]) at which every pair still has a tenth of its gap,
// to 1 %, goes to `step`; -1 if one is within `touching` at the start. radii, objects, rest, reach: see Thickness.
int yasps_step_bound(void* memory, const double* start, const double* end, long vertices, const double* rest,
                     const double* radii, const int* objects, double reach, double touching, const int* edge_edge,
                     long edge_count, const int* vertex_triangle, long triangle_count, int threads, double* step) {
    StepBound& bound = *static_cast<StepBound*>(memory);
    const Point *const from = reinterpret_cast<const Point*>(start), *const to = reinterpret_cast<const Point*>(end);
    const Point* const x0 = reinterpret_cast<const Point*>(rest);
    const Thickness thickness = {radii, objects, reach};
    const int used = std::min(threads, kMostThreads);
    if (!bound.free_ways.take(from, to, radii, vertices, touching, used)) return kOutOfMemory;
    *step = 1;
    const auto look_at = [&](int split, const int* pairs, long count) {
        return *step < 0 || bound.find(split, from, to, x0, thickness, touching, pairs, count, used, step);
    };
    return look_at(2, edge_edge, edge_count) && look_at(1, vertex_triangle, triangle_count) ? kOk : kOutOfMemory;
}
}
