// Distances of surface pieces: which of their features are closest, and how far these are apart.
//
// A vertex and a triangle, or two edges, as their four vertices p: the vertex first, or edge by edge. Features follow
// from where the other piece lies among the normals of each: see Ericson, Real-Time Collision Detection, 2005, ch. 5.
//
// Nearly parallel edges and thin triangles have a normal that is mostly rounding. There, a distance is that of two
// points of the pieces, so that it is right to rounding whatever the normal is; and line and line, or point and plane,
// are the closest features only if their formula, which an energy will use, is sure to give that distance better than
// the formula of an end or a side does.
#pragma once

#include "core/runtime.h"

namespace yasps {

// T: a number, or a pack of them.
template <class T>
struct PointOf {
    T x, y, z;
};
typedef PointOf<double> Point;
template <class T>
inline PointOf<T> operator+(PointOf<T> a, PointOf<T> b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class T>
inline PointOf<T> operator-(PointOf<T> a, PointOf<T> b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class T>
inline PointOf<T> operator*(T s, PointOf<T> a) {
    return {s * a.x, s * a.y, s * a.z};
}
template <class T>
inline T dot(PointOf<T> a, PointOf<T> b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T>
inline T square(PointOf<T> a) {
    return dot(a, a);
}
template <class T>
inline PointOf<T> cross(PointOf<T> a, PointOf<T> b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// The closest features of a pair: a vertex or all of each piece. On the vertex's side of a triangle pair that is the
// vertex itself; on the triangle's, a corner (kCorner + k), a side from corner k to the next (kSide + k), or kInside.
// Edges: 3 * (of the first) + (of the second), each 0 or 1 for an end, 2 for a point between.
struct Closest {
    int features;
    double squared;
};
enum { kCorner = 0, kSide = 3, kInside = 6 };
enum { kBetween = 2, kLineLine = 3 * kBetween + kBetween };

// A normal is right to 100 roundings where the squared sine of the angle between its two edges is above this.
constexpr double kSlanted = 1e-4;

// What of the edge from a to b is closest to p: 0 or 1 for an end, or kBetween.
inline Closest closest_on_edge(Point p, Point a, Point b) {
    const Point edge = b - a, offset = p - a;
    const double length = square(edge), along = dot(edge, offset);  // squared, and times it; one without any is a point
    if (!(along > 0)) return {0, square(offset)};
    if (!(along < length)) return {1, square(p - b)};
    return {kBetween, square(cross(offset, edge)) / length};
}

// Whether a formula with the normal of edges u and v, and a way w to it, is sure to be nearer to the distance of a pair
// (squared: `squared`), in proportion, than that of other features, which is not less (`others`). Rounding is not the
// same wherever the formula is computed, so that it is bounded here.
inline bool fits(Point normal, Point u, Point v, Point w, double squared, double others) {
    constexpr double kRounding = 4.5e-16;
    const double error = kRounding * sqrt(square(u) * square(v) * square(w) / square(normal));
    const double distance = sqrt(squared), other = sqrt(others);
    return error * other <= distance * (other - distance);
}

// Squared distance of p[0] and the point inside the triangle that is nearest to it; infinite if there is none. The
// triangle may be thin: the longest side is taken out of everything first.
inline double squared_inside(const Point* p) {
    const Point* const corner = p + 1;
    int k = 0;  // the longest side is from corner k to the next
    double length = 0;
    for (int j = 0; j < 3; ++j) {
        const double other = square(corner[(j + 1) % 3] - corner[j]);
        if (other > length) length = other, k = j;
    }
    if (!(length > 0)) return INFINITY;
    const Point a = corner[k], side = corner[(k + 1) % 3] - a, apex = corner[(k + 2) % 3] - a, offset = p[0] - a;
    const double along = dot(offset, side) / length, apex_along = dot(apex, side) / length;
    const Point height = apex - apex_along * side, across = offset - along * side;
    const double up = dot(across, height) / square(height);  // weights: `up` of the apex,
    const double next = along - up * apex_along;             // this of the second end of the side
    if (!(up > 0 && next > 0 && up + next < 1)) return INFINITY;
    return square(across - up * height);
}

// Any triangle, also one that is a line or a point.
inline Closest closest_of_thin_triangle(const Point* p) {
    const Point* const corner = p + 1;
    Closest best = {0, INFINITY};
    for (int k = 0; k < 3; ++k) {
        const int next = k == 2 ? 0 : k + 1;
        const Closest side = closest_on_edge(p[0], corner[k], corner[next]);
        if (side.squared < best.squared) {
            const int end = side.features == 0 ? k : next;
            best = {side.features == kBetween ? kSide + k : kCorner + end, side.squared};
        }
    }
    const double squared = squared_inside(p);
    if (!(squared < best.squared)) return best;
    const Point first = corner[1] - corner[0], last = corner[2] - corner[0], offset = p[0] - corner[0];
    const bool inside = fits(cross(first, last), first, last, offset, squared, best.squared);
    return {inside ? int(kInside) : best.features, squared};
}

inline Closest closest_vertex_triangle(const Point* p) {
    const Point* const corner = p + 1;
    const Point first = corner[1] - corner[0], last = corner[2] - corner[0], normal = cross(first, last);
    const double size = square(normal);
    if (!(size > kSlanted * square(first) * square(last))) return closest_of_thin_triangle(p);
    double along[3];  // where the vertex projects to on each side: 0 at its first corner, 1 at its second
    for (int k = 0; k < 3; ++k) {
        const Point a = corner[k], side = corner[k == 2 ? 0 : k + 1] - a, offset = p[0] - a;
        along[k] = dot(side, offset) / square(side);
        const bool outside = dot(cross(side, normal), offset) >= 0;
        if (outside && along[k] > 0 && along[k] < 1) return {kSide + k, square(cross(offset, side)) / square(side)};
    }
    for (int k = 0; k < 3; ++k)
        if (along[k] <= 0 && along[k == 0 ? 2 : k - 1] >= 1) return {kCorner + k, square(p[0] - corner[k])};
    const double height = dot(normal, p[0] - corner[0]);
    return {kInside, height * height / size};
}

// Two edges of which an end is closest: of the four, each to the other edge.
inline Closest closest_end(const Point* p) {
    Closest best = {0, INFINITY};
    for (int k = 0; k < 4; ++k) {
        const bool first = k < 2;
        const Point* const other = first ? p + 2 : p;
        const Closest end = closest_on_edge(p[k], other[0], other[1]);
        if (end.squared < best.squared) best = {first ? 3 * k + end.features : 3 * end.features + (k - 2), end.squared};
    }
    return best;
}

inline Closest closest_edges(const Point* p) {
    const Point u = p[1] - p[0], v = p[3] - p[2], w = p[0] - p[2], normal = cross(u, v);
    const double size = square(normal);
    // Where the lines are closest, times `size`. With products of dot products in place of crosses these would be off
    // by rounding over the squared sine of the angle between the edges; so it is rounding over the sine.
    const double s = dot(normal, cross(v, w)), t = dot(normal, cross(u, w));
    const bool between = s > 0 && s < size && t > 0 && t < size;
    if (!between) return closest_end(p);
    if (size > kSlanted * square(u) * square(v)) {
        const double height = dot(normal, w);
        return {kLineLine, height * height / size};
    }
    const Closest end = closest_end(p);
    const Point offset = w + (s / size) * u;
    const double along = dot(offset, v) / square(v);  // the best for this s: their errors would not go together
    if (!(along > 0 && along < 1)) return end;
    const double squared = square(offset - along * v);
    if (!(squared < end.squared)) return end;
    return {fits(normal, u, v, w, squared, end.squared) ? int(kLineLine) : end.features, squared};
}

}  // namespace yasps
