// A vertex against a surface of triangles: what it counts at each place, so that the sum is that of the nearest
// triangle alone, however many others are near it at the same place.
//
// Of all triangles near a vertex, each counts 1 where it is nearest to the vertex. Each of their edges counts 1 less
// the number of them that have it, each corner what is left to 1 then: 1 + triangles - edges at it. A place that
// belongs to several pieces is so counted once (inclusion and exclusion, Li et al. 2023, arXiv 2307.15908, section 4.2,
// there for closed surfaces). Triangles with the vertex itself are no pairs, and do not count.
#pragma once

#include <limits.h>

#include <algorithm>

#include "collision/list.h"
#include "collision/pair_distance.h"

namespace yasps {

// A vertex and a triangle that are near, and the features of the triangle that are closest.
struct NearTriangle {
    int vertex, corner[3];
    int features;
};

class ImprovedMax {
  public:
    // vertices: one more than the largest id. False: out of memory.
    bool prepare(long vertices) {
        if (!around_.reserve(vertices) || !net_.reserve(vertices)) return false;
        std::fill_n(around_.data, vertices, kUntouched);
        return true;
    }

    // near: [count], all of one vertex; x: all places. `inside(triangle)`, `on_side(a, b, times)` with a < b, and
    // `at_corner(a, times)` take what counts other than 0 times; each a bool, false: out of memory.
    template <class Inside, class OnSide, class AtCorner>
    bool count(const NearTriangle* near, long count, const Point* x, double reach, const Inside& inside,
               const OnSide& on_side, const AtCorner& at_corner) {
        sides_.clear(), corners_.clear();
        if (!sides_.grow(3 * count) || !corners_.grow(3 * count)) return false;
        const Point p = x[near[0].vertex];
        for (long t = 0; t < count; ++t) {
            const NearTriangle& triangle = near[t];
            if (triangle.features >= kInside && !inside(triangle)) return false;
            for (int k = 0; k < 3; ++k) {
                const int a = triangle.corner[k], b = triangle.corner[k == 2 ? 0 : k + 1];
                sides_.add({std::min(a, b), std::max(a, b), triangle.features == kSide + k});
                if (around_[a] == kUntouched) around_[a] = 1, net_[a] = 0, corners_.add(a);
                ++around_[a];
                net_[a] += triangle.features == kCorner + k;
            }
        }
        std::sort(sides_.begin(), sides_.end());
        for (long k = 0, next; k < sides_.count; k = next) {
            const Side side = sides_[k];
            int times = 0;
            for (next = k; next < sides_.count && !(side < sides_[next]); ++next) times += sides_[next].closest;
            --around_[side.a], --around_[side.b];
            const int share = 1 - static_cast<int>(next - k);
            if (share != 0) {
                const Closest closest = closest_on_edge(p, x[side.a], x[side.b]);
                if (closest.squared < reach * reach) {
                    if (closest.features == kBetween)
                        times += share;
                    else
                        net_[closest.features == 0 ? side.a : side.b] += share;
                }
            }
            if (times != 0 && !on_side(side.a, side.b, times)) return false;
        }
        bool fine = true;
        for (const int corner : corners_) {
            const int share = around_[corner];
            around_[corner] = kUntouched;
            int times = net_[corner];
            if (share != 0 && square(x[corner] - p) < reach * reach) times += share;
            if (times != 0) fine = at_corner(corner, times) && fine;
        }
        return fine;
    }

  private:
    static constexpr int kUntouched = INT_MIN;
    struct Side {
        int a, b;
        bool closest;  // to the vertex, of its triangle
        bool operator<(const Side& other) const { return a != other.a ? a < other.a : b < other.b; }
    };
    Buffer<int> around_;  // [vertices]: 1 + triangles - edges at a corner
    Buffer<int> net_;     // [vertices]: how often a corner counts
    List<Side> sides_;
    List<int> corners_;
};

}  // namespace yasps
