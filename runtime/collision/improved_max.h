// A vertex against a surface of triangles: what it counts at each place, so that the sum is that of the nearest
// triangle alone, however many others are near it at the same place.
//
// Of all triangles near a vertex, each counts 1 where it is nearest to the vertex. Each of their edges counts 1 less
// the number of them that have it, each corner what is left to 1 then: 1 + triangles - edges at it. A place that
// belongs to several pieces is so counted once (inclusion and exclusion, Li et al. 2023, arXiv 2307.15908, section 4.2,
// there for closed surfaces). Triangles with the vertex itself are no pairs, and do not count.
//
// Where triangles have different shares of their offset by radii, an edge or a corner has the least of its triangles':
// then it is never nearer than one of them, and what is left is never negative.
#pragma once

#include <limits.h>

#include <algorithm>

#include "collision/list.h"
#include "collision/pair_distance.h"
#include "collision/thickness.h"

namespace yasps {

// A vertex and a triangle that are near, and the features of the triangle that are closest. Not close: an edge of it
// may be, where its radius is larger.
struct NearTriangle {
    int vertex, corner[3];
    int features;
    bool close;
    double share;
};

class ImprovedMax {
  public:
    // vertices: one more than the largest id. False: out of memory.
    bool prepare(long vertices) {
        if (corners_.capacity >= vertices && corners_.data != nullptr) return true;
        if (!corners_.reserve(vertices)) return false;
        for (long v = 0; v < vertices; ++v) corners_[v].around = kUntouched;
        return true;
    }

    // near(t): the triangles near one vertex, [count]; x: all places. `inside(triangle)`, `on_side(a, b, times, share)`
    // with a < b, and `at_corner(a, times, share)` take what counts other than 0 times; each a bool, false: out of
    // memory.
    template <class Near, class Inside, class OnSide, class AtCorner>
    bool count(const Near& near, long count, const Point* x, double reach, const Thickness& thickness,
               const Inside& inside, const OnSide& on_side, const AtCorner& at_corner) {
        sides_.clear(), touched_.clear();
        if (!sides_.grow(3 * count) || !touched_.grow(3 * count)) return false;
        const int vertex = near(0).vertex;
        const Point p = x[vertex];
        bool even = true, fine = true;  // even: one share for all
        for (long t = 1; t < count; ++t) even = even && near(t).share == near(0).share;
        for (long t = 0; t < count; ++t) {
            const NearTriangle& triangle = near(t);
            const int features = triangle.close ? triangle.features : kNone;
            if (features >= kInside) fine = inside(triangle) && fine;
            for (int k = 0; k < 3; ++k) {
                const int a = triangle.corner[k], b = triangle.corner[k == 2 ? 0 : k + 1];
                const int first = std::min(a, b), second = std::max(a, b);
                bool on_this = features == kSide + k, at_this = features == kCorner + k;
                if (!even) {  // what has different shares does not add
                    if (on_this) fine = on_side(first, second, 1, triangle.share) && fine;
                    if (at_this) fine = at_corner(a, 1, triangle.share) && fine;
                    on_this = at_this = false;
                }
                const uint64_t ends = static_cast<uint64_t>(first) << 32 | static_cast<uint64_t>(second);
                sides_.add({ends, static_cast<int>(t), on_this});
                Corner& corner = corners_[a];
                if (corner.around == kUntouched) corner = {1, 0, triangle.share}, touched_.add(a);
                ++corner.around;
                corner.times += at_this;
                corner.share = std::min(corner.share, triangle.share);
            }
        }
        std::sort(sides_.begin(), sides_.end());
        for (long k = 0, next; k < sides_.count; k = next) {
            const uint64_t ends = sides_[k].ends;
            const int first = static_cast<int>(ends >> 32), second = static_cast<int>(ends & 0xffffffff);
            int times = 0;
            double share = 1;
            for (next = k; next < sides_.count && sides_[next].ends == ends; ++next) {
                times += sides_[next].closest;
                share = std::min(share, near(sides_[next].triangle).share);
            }
            --corners_[first].around, --corners_[second].around;
            const int own = 1 - static_cast<int>(next - k);
            if (own != 0) {
                const Point a = x[first], b = x[second];
                const Closest closest = closest_on_edge(p, a, b);
                const int end = closest.features == 0 ? first : second;
                double far = reach;
                if (thickness.any()) {
                    const double* const r = thickness.radii;
                    const bool middle = closest.features == kBetween;
                    far += share * (r[vertex] + (middle ? radius_on_edge(p, a, b, r[first], r[second]) : r[end]));
                }
                if (closest.squared < far * far) {
                    if (closest.features == kBetween)
                        times += own;
                    else if (even)
                        corners_[end].times += own;
                    else
                        fine = at_corner(end, own, share) && fine;
                }
            }
            if (times != 0) fine = on_side(first, second, times, share) && fine;
        }
        for (const int a : touched_) {
            Corner corner = corners_[a];
            corners_[a].around = kUntouched;
            int times = corner.times;
            if (corner.around != 0) {
                double far = reach;
                if (thickness.any()) far += corner.share * (thickness.radii[vertex] + thickness.radii[a]);
                if (square(x[a] - p) < far * far) times += corner.around;
            }
            if (times != 0) fine = at_corner(a, times, corner.share) && fine;
        }
        return fine;
    }

  private:
    static constexpr int kUntouched = INT_MIN, kNone = -1;
    struct Side {
        uint64_t ends;  // the lower, then the upper one
        int triangle;
        bool closest;  // to the vertex, of its triangle
        bool operator<(const Side& other) const { return ends < other.ends; }
    };
    struct Corner {
        int around;  // 1 + triangles - edges at it
        int times;   // how often it counts
        double share;
    };
    Buffer<Corner> corners_;  // [vertices]
    List<Side> sides_;
    List<int> touched_;
};

}  // namespace yasps
