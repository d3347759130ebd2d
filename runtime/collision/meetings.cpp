// Which pairs of surface pieces would meet on a straight way, when, and where they are closest then.
#include <algorithm>

#include "collision/chunks.h"
#include "collision/free_ways.h"
#include "collision/pair_distance.h"
#include "collision/thickness.h"
#include "collision/time_apart.h"
#include "core/runtime.h"

namespace yasps {
namespace {

// Where the point q is projected to on the line from a (0) to b (1).
double along(Point q, Point a, Point b) { return dot(q - a, b - a) / square(b - a); }

// Weights g of the vertices p of a pair: sum of g p is the way between its closest points. Those of the first piece are
// negative and sum to -1, those of the second to 1.
void weigh(const Point* p, bool triangle, int features, double* g) {
    std::fill_n(g, 4, 0.0);
    if (triangle) {
        g[0] = -1;
        if (features < kSide) {
            g[1 + features] = 1;
        } else if (features < kInside) {
            const int a = 1 + features - kSide, b = a == 3 ? 1 : a + 1;
            g[b] = along(p[0], p[a], p[b]);
            g[a] = 1 - g[b];
        } else {
            const Point first = p[2] - p[1], last = p[3] - p[1], offset = p[0] - p[1], normal = cross(first, last);
            g[2] = dot(cross(offset, last), normal) / square(normal);
            g[3] = dot(cross(first, offset), normal) / square(normal);
            g[1] = 1 - g[2] - g[3];
        }
        return;
    }
    const int first = features / 3, second = features % 3;
    double s = first, t = second;
    if (features == kLineLine) {
        const Point u = p[1] - p[0], v = p[3] - p[2], w = p[2] - p[0], normal = cross(u, v);
        s = dot(cross(w, v), normal) / square(normal), t = dot(cross(w, u), normal) / square(normal);
    } else if (first == kBetween) {
        s = along(p[2 + second], p[0], p[1]);
    } else if (second == kBetween) {
        t = along(p[first], p[2], p[3]);
    }
    g[0] = s - 1, g[1] = -s, g[2] = 1 - t, g[3] = t;
}

}  // namespace
}  // namespace yasps

using namespace yasps;

extern "C" {

// For each of `count` pairs, [4] vertices, the first `split` of them of the first piece: the time in [0, 1] on the way
// from start to end ([vertices, 3]) at which it has hardly more than a tenth of its gap, above 1 if it never has. For
// those that have: the gap at the start, the offset by radii, closest-point weights [4] at that time and the way [3]
// between the closest points then. radii, objects, rest, reach: see Thickness.
int yasps_meetings(const double* start, const double* end, long vertices, const double* rest, const double* radii,
                   const int* objects, double reach, const int* pairs, long count, int split, int threads,
                   double* times, double* gaps, double* offsets, double* weights, double* ways) {
    const Point *const from = reinterpret_cast<const Point*>(start), *const to = reinterpret_cast<const Point*>(end);
    const Point* const x0 = reinterpret_cast<const Point*>(rest);
    const Thickness thickness = {radii, objects, reach};
    const int used = std::min(threads, kMostThreads);
    FreeWays free_ways;
    ChunkLists<Suspect> found;
    Buffer<Suspect> suspects;
    if (!free_ways.take(from, to, radii, vertices, 0, used) || !free_ways.find(split, pairs, count, used, &found) ||
        !suspects.reserve(found.total()))
        return kOutOfMemory;
    found.copy(suspects.data, used);
    std::fill_n(times, count, INFINITY);
#pragma omp parallel for num_threads(used) schedule(dynamic, 64) if (used > 1)
    for (long n = 0; n < found.total(); ++n) {
        const long k = suspects[n].number;
        const int* const v = pairs + 4 * k;
        MovingPair pair;
        pair.split = split;
        for (int c = 0; c < 4; ++c) pair.at[c] = from[v[c]], pair.move[c] = to[v[c]] - pair.at[c];
        const Closest closest = pair.closest(pair.at);
        double offset = 0, least = 0;
        if (thickness.any()) {
            const double share = thickness.share(v, split, x0);
            offset = share * thickness.offset(v, pair.at, split, closest.features);
            least = share * thickness.least(v, split);
        }
        const double time = time_apart(pair, closest, least, 1);
        times[k] = time;
        if (!(time <= 1)) continue;
        gaps[k] = sqrt(closest.squared) - offset, offsets[k] = offset;
        Point p[4];
        for (int c = 0; c < 4; ++c) p[c] = from[v[c]] + time * (to[v[c]] - from[v[c]]);
        double* const g = weights + 4 * k;
        weigh(p, split == 1, pair.closest(p).features, g);
        Point* const way = reinterpret_cast<Point*>(ways) + k;
        *way = g[0] * p[0] + g[1] * p[1];
        *way = *way + (g[2] * p[2] + g[3] * p[3]);
    }
    return kOk;
}
}
