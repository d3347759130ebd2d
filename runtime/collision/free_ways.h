// Which of many pairs are sure to keep a tenth of their gap on a straight way, looked at eight at a time.
//
// First by speed: if both pieces ran at each other as fast as their vertices move apart from what all four share, the
// gap would not be used up. Then along the shortest way at the start: vertices move straight, so that what separates
// pieces along a direction at both ends of the motion does so in between.
#pragma once

#include "collision/chunks.h"
#include "collision/pair_packs.h"
#include "core/runtime.h"

namespace yasps {

// A pair that may not be free, and a time up to which it is.
struct Suspect {
    int number;
    double free_until;  // 0 where it may touch at the start
};

struct Motion {
    Places at, moves;
    const Point* start;
    double touching;  // a gap that is nothing

    // radii: or null. False: out of memory.
    bool take(const Point* from, const Point* to, const double* radii, long vertices, double nothing, int threads) {
        start = from, touching = nothing;
        return at.take(from, nullptr, radii, vertices, threads) && moves.take(to, from, nullptr, vertices, threads);
    }

    // Adds those of `count` of the pairs that are not sure to be free. numbers: [count].
    template <int kSplit>
    bool look(const int* rows, const int* numbers, long count, List<Suspect>* suspects) const {
        if (!suspects->grow(count)) return false;
        for (long k = 0; k < count; k += kPack) {
            const long lanes = std::min<long>(kPack, count - k);
            double until[kPack];
            const unsigned free = free_lanes<kSplit>(rows, numbers + k, lanes, until);
            for (int l = 0; l < lanes; ++l)
                if (!(free >> l & 1)) suspects->add({numbers[k + l], until[l]});
        }
        return true;
    }

  private:
    static constexpr double kRounding = 16 * kEpsilon, kApproach = 0.9;  // of a gap that may be used up

    // A bit for each pair that is free, and the times up to which the others are.
    template <int kSplit>
    unsigned free_lanes(const int* rows, const int* numbers, long lanes, double* until) const {
        const PairPack here = gather(at, rows, numbers, lanes), way = gather(moves, rows, numbers, lanes);
        const PointPack mean = constant<Eight>(0.25) * ((way.p[0] + way.p[1]) + (way.p[2] + way.p[3]));
        PointPack q[4], move[4];  // relative to the first vertex, and to the mean motion
        here.relative(q);
        Eight size = constant<Eight>(0), fastest[4];
        for (int c = 0; c < 4; ++c) {
            move[c] = way.p[c] - mean;
            fastest[c] = square(move[c]), size = maximum(size, square(q[c]));
        }
        const Eight last = maximum(fastest[2], fastest[3]);
        const Eight first = kSplit == 1 ? fastest[0] : maximum(fastest[0], fastest[1]);
        const Eight second = kSplit == 1 ? maximum(fastest[1], last) : last;
        const Eight speed = square_root(first) + square_root(second);  // how fast both pieces move at most
        const Eight numbers_of_moves = speed + square_root(square(mean));
        const Eight rounding = (square_root(size) + numbers_of_moves) * kRounding;

        const ClosestPack closest = closest_of_pack<kSplit>(q);
        const Eight zero = constant<Eight>(0), distance = square_root(closest.squared);
        const Eight least = least_radii<kSplit>(here.radius);
        const Eight keep = least + (distance - least) * (1 - kApproach);
        Eight before[4], after[4];
        for (int c = 0; c < 4; ++c) {
            before[c] = dot(closest.way, q[c]);
            after[c] = before[c] + dot(closest.way, move[c]);
        }
        const Eight narrowest = minimum(first_of_second<kSplit>(before) - last_of_first<kSplit>(before),
                                        first_of_second<kSplit>(after) - last_of_first<kSplit>(after));
        const Eight wanted = (keep + rounding) * square_root(square(closest.way));
        const Eight room = distance - keep - rounding;
        const auto apart = less(constant<Eight>(touching), distance - most_radii<kSplit>(here.radius));
        const auto free = apart & (less(speed, room) | less(wanted, narrowest));
        store_lanes(until, select(apart & less(zero, room), quotient(room, speed), zero));
        for (int l = 0; l < kPack; ++l)
            if (!(closest.sure >> l & 1) || !(until[l] > 0)) until[l] = 0;
        return bits_of(free) & closest.sure;
    }
};

}  // namespace yasps
