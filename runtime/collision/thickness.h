// Vertices with radii: surfaces are as thick as these, in between by interpolation.
//
// Two pieces then keep apart by the sum of their radii where they are closest, the offset. Pieces of one object that
// are nearer at rest than the offset and the reach of the barrier have only a share of it: so much that the gap at rest
// is the reach; none if the distance at rest is less than that.
#pragma once

#include <algorithm>

#include "collision/pair_distance.h"

namespace yasps {

inline double between(double a, double b, double t) { return a + std::min(1.0, std::max(0.0, t)) * (b - a); }

// Radius at what of the edge from a to b is closest to p.
inline double radius_on_edge(Point p, Point a, Point b, double first, double second) {
    const Point edge = b - a;
    return first == second ? first : between(first, second, dot(edge, p - a) / square(edge));
}

struct Thickness {
    const double* radii = nullptr;  // [vertices], or null: nothing has one
    const int* objects = nullptr;   // [vertices]
    double reach = 0;

    bool any() const { return radii != nullptr; }

    // The sum of both radii where the pair v, with its vertices at p, is closest.
    double offset(const int* v, const Point* p, int split, int features) const {
        const double r[4] = {radii[v[0]], radii[v[1]], radii[v[2]], radii[v[3]]};
        return split == 1 ? r[0] + of_triangle(p, r, features) : of_edges(p, r, features);
    }
    // The least offset of any two places of the pair.
    double least(const int* v, int split) const {
        double side[2] = {INFINITY, INFINITY};
        for (int c = 0; c < 4; ++c) side[c >= split] = std::min(side[c >= split], radii[v[c]]);
        return side[0] + side[1];
    }
    // Whether any place of the triangle may be within `reach` and the offset there.
    bool may_be_close(const int* v, Closest closest, double distance) const {
        const double most = std::max(radii[v[1]], std::max(radii[v[2]], radii[v[3]]));
        return sqrt(closest.squared) - (radii[v[0]] + most) < distance;
    }
    // Of the offset, by where the vertices are at rest. It is rounded down, so that a gap at rest is not below the
    // reach by rounding, and pairs with the same closest points there have the same share.
    double share(const int* v, int split, const Point* rest) const {
        if (objects[v[0]] != objects[v[split]]) return 1;
        const Point p[4] = {rest[v[0]], rest[v[1]], rest[v[2]], rest[v[3]]};
        const Closest closest = split == 1 ? closest_vertex_triangle(p) : closest_edges(p);
        const double whole = offset(v, p, split, closest.features);
        const double exact = (sqrt(closest.squared) - reach) / whole;
        if (!(exact < 1)) return 1;  // also where nothing has a radius
        constexpr double kSteps = 1 << 20;
        return std::max(0.0, floor((exact - 1e-9) * kSteps) / kSteps);
    }

  private:
    static double of_triangle(const Point* p, const double* r, int features) {
        if (features < kSide) return r[1 + features];
        if (features < kInside) {
            const int a = 1 + features - kSide, b = a == 3 ? 1 : a + 1;
            return radius_on_edge(p[0], p[a], p[b], r[a], r[b]);
        }
        if (r[1] == r[2] && r[1] == r[3]) return r[1];
        const Point first = p[2] - p[1], last = p[3] - p[1], offset = p[0] - p[1], normal = cross(first, last);
        const double size = square(normal);
        const double b = std::min(1.0, std::max(0.0, dot(cross(offset, last), normal) / size));
        const double c = std::min(1.0 - b, std::max(0.0, dot(cross(first, offset), normal) / size));
        return r[1] + b * (r[2] - r[1]) + c * (r[3] - r[1]);
    }
    static double of_edges(const Point* p, const double* r, int features) {
        const int first = features / 3, second = features % 3;
        if (r[0] == r[1] && r[2] == r[3]) return r[0] + r[2];
        if (features != kLineLine) {
            if (first == kBetween) return radius_on_edge(p[2 + second], p[0], p[1], r[0], r[1]) + r[2 + second];
            if (second == kBetween) return r[first] + radius_on_edge(p[first], p[2], p[3], r[2], r[3]);
            return r[first] + r[2 + second];
        }
        const Point u = p[1] - p[0], v = p[3] - p[2], w = p[0] - p[2], normal = cross(u, v);
        const double size = square(normal);
        return between(r[0], r[1], dot(normal, cross(v, w)) / size) +
               between(r[2], r[3], dot(normal, cross(u, w)) / size);
    }
};

}  // namespace yasps
