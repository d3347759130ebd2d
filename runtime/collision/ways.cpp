// How far vertices are from where they are on a straight way, all of them at the same time.
#include <algorithm>

#include "collision/pair_distance.h"
#include "core/runtime.h"

namespace yasps {
namespace {

// A straight way of all vertices, of which those in ids, [count], are looked at.
struct Way {
    const Point *start, *end;
    const int* ids;
    long count;

    Point at(int v, double time) const { return start[v] + time * (end[v] - start[v]); }

    // The time in [0, 1] at which the sum of all squared distances to these positions is least.
    double nearest_time(const Point* positions) const {
        double along = 0, length = 0;
        for (long k = 0; k < count; ++k) {
            const Point way = end[ids[k]] - start[ids[k]];
            along += dot(way, positions[ids[k]] - start[ids[k]]);
            length += square(way);
        }
        return length > 0 ? std::min(1.0, std::max(0.0, along / length)) : 0;
    }

    // The largest distance of these positions at this time, squared.
    double most_off(const Point* positions, double time) const {
        double largest = 0;
        for (long k = 0; k < count; ++k) largest = std::max(largest, square(positions[ids[k]] - at(ids[k], time)));
        return largest;
    }

    // The middle of the times in [0, 1] at which all are within `margin`; -1 if there is none. Of each vertex these are
    // an interval about the time at which it is nearest to its own line.
    double time_within(const Point* positions, double margin) const {
        double first = 0, last = 1;
        for (long k = 0; k < count; ++k) {
            const Point way = end[ids[k]] - start[ids[k]], offset = positions[ids[k]] - start[ids[k]];
            const double length = square(way), nearest = length > 0 ? dot(way, offset) / length : 0;
            const double room = margin * margin - square(offset - nearest * way);
            if (!(room >= 0)) return -1;
            if (!(length > 0)) continue;
            const double half = sqrt(room / length);
            first = std::max(first, nearest - half), last = std::min(last, nearest + half);
            if (first > last) return -1;
        }
        return 0.5 * (first + last);
    }
};

const Point* points(const double* x) { return reinterpret_cast<const Point*>(x); }

}  // namespace
}  // namespace yasps

using namespace yasps;

extern "C" {

// How far the farthest vertex of ids, [count], is from where it is on the way from start to end ([vertices, 3]): at a
// time at which all are within `margin`, if there is one, else at that of the least sum of squares.
void yasps_distance_to_way(const double* start, const double* end, const double* positions, const int* ids, long count,
                           double margin, double* result) {
    const Way way = {points(start), points(end), ids, count};
    const Point* const at = points(positions);
    double squared = way.most_off(at, way.nearest_time(at));
    if (squared > margin * margin) {
        const double time = way.time_within(at, margin);
        if (time >= 0) squared = way.most_off(at, time);
    }
    *result = sqrt(squared);
}

// Takes over, of the way from start to end, the part that is nearest to the way new_start to new_end: these, of ids,
// become its ends for all vertices that are within `allowed` of them at both, and others are marked in `strayed`
// ([vertices], 0 before).
void yasps_part_of_way(const double* start, const double* end, const int* ids, long count, double allowed,
                       double* new_start, double* new_end, uint8_t* strayed) {
    const Way way = {points(start), points(end), ids, count};
    Point *const first = reinterpret_cast<Point*>(new_start), *const last = reinterpret_cast<Point*>(new_end);
    const double begin = way.nearest_time(first), finish = way.nearest_time(last);
    for (long k = 0; k < count; ++k) {
        const int v = ids[k];
        const Point from = way.at(v, begin), to = way.at(v, finish);
        const bool stays = std::max(square(first[v] - from), square(last[v] - to)) <= allowed * allowed;
        if (stays)
            first[v] = from, last[v] = to;
        else
            strayed[v] = 1;
    }
}
}
