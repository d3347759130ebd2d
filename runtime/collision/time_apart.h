// How long two pieces that move straight stay apart: continuous collision detection by separating directions.
//
// Along any direction n, two pieces are apart by the smallest n . w / |n| of all ways w from a vertex of the first to
// one of the second. Here n is that of the shortest way between the pieces, and may turn with an edge or a triangle:
// n(t) = n0 + n1 t + n2 t^2. Then each n . w is a cubic, and the first time at which one reaches a wanted distance is a
// time up to which the pieces are farther apart than that. Where they come closer along n, this is Newton's method for
// the distance, from the safe side; where they slide past each other, or turn about a place where they nearly touch,
// there is no such time, however small the gap.
#pragma once

#include <algorithm>

#include "collision/pair_distance.h"
#include "core/runtime.h"

namespace yasps {

// Two pieces: where their vertices are and how far they move in the whole time 1. split: vertices of the first.
struct MovingPair {
    Point at[4], move[4];
    int split;

    Closest closest(const Point* p) const { return split == 1 ? closest_vertex_triangle(p) : closest_edges(p); }
    // The sum of how fast both move at most.
    double speed() const {
        double fastest[2] = {0, 0};
        for (int c = 0; c < 4; ++c) {
            double& side = fastest[c >= split];
            side = std::max(side, square(move[c]));
        }
        return sqrt(fastest[0]) + sqrt(fastest[1]);
    }
};

// n0 + n1 t + n2 t^2
struct Direction {
    Point n0, n1, n2;
};

// c0 + c1 t + c2 t^2 + c3 t^3
struct Cubic {
    double c[4];

    double at(double t) const { return c[0] + t * (c[1] + t * (c[2] + t * c[3])); }

    // A time in [0, end] up to which it is not negative: nearly the last one; infinite if that is all of [0, end].
    // Parabolas that lie below it from the present time on take it there, the last ones in steps of Newton's method.
    double first_root(double end) const {
        constexpr int kMostSteps = 16;
        constexpr double kNearly = 1e-4;
        double t = 0, value = c[0];
        if (!(value > 0)) return 0;
        for (int k = 0; k < kMostSteps; ++k) {
            const double slope = c[1] + t * (2 * c[2] + t * 3 * c[3]);
            const double bend = std::min(0.0, c[2] + 3 * std::min(c[3] * t, c[3] * end));  // half the least curvature
            if (slope >= 0 && bend == 0) return INFINITY;
            const double root = sqrt(slope * slope - 4 * bend * value);  // of the parabola, without cancellation
            const double ahead = slope > 0 ? (root + slope) / (-2 * bend) : 2 * value / (root - slope);
            if (t + ahead >= end) return INFINITY;
            value = at(t + ahead);
            if (!(value >= -kNearly * c[0])) break;  // rounding, or numbers too large
            t += ahead;
            if (value < kNearly * c[0]) break;
        }
        return t;
    }
};

// The part of n across edge e, and how it turns when the edge moves: it stays across it. All 0 if there is none.
inline Direction across(Point n, Point e, Point e_moves) {
    Point n0 = cross(e, cross(n, e));
    const double size = square(n0), length = square(e);
    if (!(size > 0)) return {};
    n0 = (1 / sqrt(size)) * n0;
    return {n0, (dot(e_moves, e) / length) * n0 - (dot(e_moves, n0) / length) * e, {}};
}

// Across two edges. What f has along e is taken out first, at all times: so it is across e to rounding even if they are
// nearly parallel, and thereby across f. It points along w. All 0 if there is none.
inline Direction across_both(Point e, Point e_moves, Point f, Point f_moves, Point w) {
    const double length = square(e), share = length > 0 ? dot(e, f) / length : 0;
    f = f - share * e, f_moves = f_moves - share * e_moves;
    const Point n0 = cross(e, f);
    const double size = square(n0);
    if (!(size > 0)) return {};
    const double scale = (dot(n0, w) < 0 ? -1 : 1) / sqrt(size);
    return {scale * n0, scale * (cross(e_moves, f) + cross(e, f_moves)), scale * cross(e_moves, f_moves)};
}

// From the first piece to the second along the shortest way between features that are not inside the triangle or
// between the ends of both edges; of any length.
inline Point shortest_way(const Point* p, bool triangle, int features) {
    if (triangle) {
        const Point* const corner = p + 1;
        if (features < kSide) return corner[features] - p[0];
        const int k = features - kSide;
        const Point side = corner[k == 2 ? 0 : k + 1] - corner[k];
        return cross(side, cross(corner[k] - p[0], side));
    }
    const int first = features / 3, second = features % 3;
    const Point u = p[1] - p[0], v = p[3] - p[2];
    if (first == kBetween) return cross(u, cross(p[2 + second] - p[0], u));
    if (second == kBetween) return cross(v, cross(p[2] - p[first], v));
    return p[2 + second] - p[first];
}

// Looks how long the pair stays `keep` apart from `start` on, where its vertices are at p. For rounding, size and speed
// bound the numbers that went into p and the moves.
struct Separation {
    const MovingPair& pair;
    const Point* p;
    const double start, keep, size, speed;

    static constexpr double kRounding = 8 * 2.3e-16;

    // Along n, a unit vector; infinite if up to the end of the motion.
    double along(Point n) const {
        double time = 1 - start;
        for (int i = 0; i < pair.split; ++i)
            for (int j = pair.split; j < 4; ++j) {
                const double gap = dot(n, p[j] - p[i]) - keep - kRounding * size;
                const double closing = dot(n, pair.move[i] - pair.move[j]) + kRounding * speed;
                if (!(gap > 0)) return 0;
                if (gap < time * closing) time = gap / closing;
            }
        return time < 1 - start ? time : INFINITY;
    }

    // Along a direction that turns.
    double along(Direction d) const {
        const double a = dot(d.n0, d.n1), b = dot(d.n0, d.n2), one = square(d.n1), two = square(d.n2);
        const double rest = 1 - start, turn = sqrt(one), bend = sqrt(two);
        // |n|, n0 being a unit vector, is at most 1 + l1 t + l2 t^2 + l3 t^3, because sqrt(1 + x) <= 1 + x / 2.
        const double l1 = a, l2 = 0.5 * one + b, l3 = dot(d.n1, d.n2) + 0.5 * two * rest;
        const Cubic taken = {{keep + kRounding * size, keep * l1 + kRounding * (speed + turn * size),
                              keep * l2 + kRounding * (turn * speed + bend * size),
                              keep * l3 + kRounding * bend * speed}};
        double time = INFINITY;
        for (int i = 0; i < pair.split; ++i)
            for (int j = pair.split; j < 4; ++j) {
                const Point w = p[j] - p[i], way = pair.move[j] - pair.move[i];
                const Cubic gap = {{dot(d.n0, w) - taken.c[0], dot(d.n0, way) + dot(d.n1, w) - taken.c[1],
                                    dot(d.n1, way) + dot(d.n2, w) - taken.c[2], dot(d.n2, way) - taken.c[3]}};
                time = std::min(time, gap.first_root(rest));
                if (time == 0) return 0;
            }
        return time;
    }

    // Along the shortest way between these features, as it is now.
    double along_way(int features) const {
        const bool inside = features == (pair.split == 1 ? int(kInside) : int(kLineLine));
        const Point way = inside ? normal().n0 : shortest_way(p, pair.split == 1, features);
        const double size = square(way);
        return size > 0 ? along((1 / sqrt(size)) * way) : 0;
    }

    // The longest along directions that turn, and start as that of the shortest way or near it.
    double along_turning(int features) const {
        const Direction both = normal();
        const bool triangle = pair.split == 1, inside = features == (triangle ? int(kInside) : int(kLineLine));
        const Point way = inside ? both.n0 : shortest_way(p, triangle, features);
        double time = along(both);
        const auto turn_with = [&](int a, int b) {
            if (time < INFINITY) time = std::max(time, along(across(way, p[b] - p[a], pair.move[b] - pair.move[a])));
        };
        if (triangle) {
            turn_with(1, 2), turn_with(2, 3), turn_with(3, 1);
        } else {
            turn_with(0, 1), turn_with(2, 3);
        }
        return time;
    }

  private:
    // Of the triangle, or across both edges.
    Direction normal() const {
        const int a = pair.split == 1 ? 1 : 0, b = a + 1, c = pair.split == 1 ? 1 : 2;
        return across_both(p[b] - p[a], pair.move[b] - pair.move[a], p[3] - p[c], pair.move[3] - pair.move[c],
                           p[pair.split] - p[0]);
    }
};

// A time in [0, latest] up to which a pair keeps `offset` and a tenth of what its distance is more, which it nearly has
// then; or infinite.
// closest: its closest features at the start. The pair's numbers are then relative to a vertex and to the mean motion.
inline double time_apart(MovingPair& pair, Closest closest, double offset, double latest) {
    constexpr double kKept = 0.1, kNearly = 1.01 * kKept;
    constexpr int kMostSteps = 64;     // most pairs take one or two
    constexpr double kLargest = 1e30;  // products below do not overflow
    const Point mean = 0.25 * ((pair.move[0] + pair.move[1]) + (pair.move[2] + pair.move[3]));
    for (Point& move : pair.move) move = move - mean;  // moving together changes no distance
    const Point origin = pair.at[0];                   // so that numbers are as small as the pair
    double size = 0;
    for (Point& at : pair.at) at = at - origin, size = std::max(size, square(at));
    size = sqrt(size);
    const double distance = sqrt(closest.squared), gap = distance - offset, speed = pair.speed();
    const double keep = offset + kKept * gap, nearly = offset + kNearly * gap;
    const double numbers = speed + sqrt(square(mean));  // that the moves are differences of
    if (latest * speed + Separation::kRounding * (size + latest * numbers) < distance - keep) return INFINITY;
    if (!(numbers < kLargest && size < kLargest)) return 0;
    Point p[4];
    std::copy_n(pair.at, 4, p);
    double time = 0;
    for (int k = 0; k < kMostSteps && (k == 0 || closest.squared > nearly * nearly); ++k) {
        const Separation here = {pair, p, time, keep, size + time * numbers, numbers};
        double ahead = here.along_way(closest.features);
        // The others cost more. They are for pairs that do not come near along the shortest way, or are free after all.
        if (time + ahead < latest && (k > 0 || ahead == 0))
            ahead = std::max(ahead, here.along_turning(closest.features));
        if (time + ahead >= latest) return INFINITY;
        if (time + ahead == time) break;
        time += ahead;
        for (int c = 0; c < 4; ++c) p[c] = pair.at[c] + time * pair.move[c];
        closest = pair.closest(p);
    }
    return time;
}

}  // namespace yasps
