// Distances of surface pieces: which of their features are closest, and how far these are apart.
//
// A vertex and a triangle, or two edges, as their four vertices p: the vertex first, or edge by edge. Features follow
// from where the other piece lies among the normals of each: see Ericson, Real-Time Collision Detection, 2005, ch. 5.
#pragma once

#include "runtime.h"

namespace yasps {

struct Point {
    double x, y, z;
};
inline Point operator+(Point a, Point b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Point operator-(Point a, Point b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Point operator*(double s, Point a) { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(Point a, Point b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline double square(Point a) { return dot(a, a); }
inline Point cross(Point a, Point b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }

// The closest features of a pair: a vertex or all of each piece. On the vertex's side of a triangle pair that is the
// vertex itself; on the triangle's, a corner (kCorner + k), a side from corner k to the next (kSide + k), or kInside.
// Edges: 3 * (of the first) + (of the second), each 0 or 1 for an end, 2 for a point between.
struct Closest {
    int features;
    double squared;
};
enum { kCorner = 0, kSide = 3, kInside = 6 };
enum { kBetween = 2, kLineLine = 3 * kBetween + kBetween };

// Squared distance of a point and the line through a and b.
inline double squared_to_line(Point p, Point a, Point b) { return square(cross(a - p, b - p)) / square(b - a); }

inline Closest closest_vertex_triangle(const Point* p) {
    const Point* const corner = p + 1;
    const Point normal = cross(corner[1] - corner[0], corner[2] - corner[0]);
    double along[3];  // where the vertex projects to on each side: 0 at its first corner, 1 at its second
    for (int k = 0; k < 3; ++k) {
        const Point a = corner[k], b = corner[k == 2 ? 0 : k + 1], side = b - a;
        along[k] = dot(side, p[0] - a) / square(side);
        const bool outside = dot(cross(side, normal), p[0] - a) >= 0;
        if (outside && along[k] > 0 && along[k] < 1) return {kSide + k, squared_to_line(p[0], a, b)};
    }
    for (int k = 0; k < 3; ++k)
        if (along[k] <= 0 && along[k == 0 ? 2 : k - 1] >= 1) return {kCorner + k, square(p[0] - corner[k])};
    const double height = dot(normal, p[0] - corner[0]);
    return {kInside, height * height / square(normal)};
}

// The end or between of the point at `along` on an edge.
inline int feature_at(double along) { return along <= 0 ? 0 : along >= 1 ? 1 : kBetween; }

// Two edges of which an end is closest: of the four, each to the other edge.
inline Closest closest_end(const Point* p) {
    Closest best = {0, INFINITY};
    for (int k = 0; k < 4; ++k) {
        const bool first = k < 2;
        const Point *const other = first ? p + 2 : p, edge = other[1] - other[0];
        const double length = square(edge);  // squared; an edge without any is a point
        const int at = length > 0 ? feature_at(dot(edge, p[k] - other[0]) / length) : 0;
        const double squared = at == kBetween ? squared_to_line(p[k], other[0], other[1]) : square(p[k] - other[at]);
        if (squared < best.squared) best = {first ? 3 * k + at : 3 * at + (k - 2), squared};
    }
    return best;
}

inline Closest closest_edges(const Point* p) {
    // Edges less than this far from parallel (sine squared) have no reliable closest points between the ends, nor any
    // that is nearer than an end by more than rounding.
    constexpr double kParallel = 1e-20;
    const Point u = p[1] - p[0], v = p[3] - p[2], w = p[0] - p[2], normal = cross(u, v);
    const double a = square(u), b = dot(u, v), c = square(v), d = dot(u, w), e = dot(v, w);
    const double size = square(normal);
    if (size > kParallel * a * c) {
        const double s = b * e - c * d, t = a * e - b * d;  // times `size`: where the lines are closest
        if (s > 0 && s < size && t > 0 && t < size) {
            const double height = dot(normal, w);
            return {kLineLine, height * height / size};
        }
    }
    return closest_end(p);
}

}  // namespace yasps
