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

class FreeWays {
  public:
    // Where vertices start and end, [vertices]; radii: or null; touching: a gap that is nothing. False: out of memory.
    bool take(const Point* start, const Point* end, const double* radii, long vertices, double touching, int threads) {
        touching_ = touching;
        return at_.take(start, nullptr, radii, vertices, threads) &&
               moves_.take(end, start, nullptr, vertices, threads);
    }

    // Those of `count` pairs that are not sure to be free, in their order. False: out of memory.
    bool find(int split, const int* pairs, long count, int threads, ChunkLists<Suspect>* found) const {
        constexpr long kChunk = 1024;
        return found->run((count + kChunk - 1) / kChunk, threads, [&](long chunk, List<Suspect>& list) {
            const long begin = chunk * kChunk, end = std::min(count, begin + kChunk);
            if (!list.grow(end - begin)) return false;
            for (long k = begin; k < end; k += kPack) {
                const long lanes = std::min<long>(kPack, end - k);
                int numbers[kPack];
                for (int l = 0; l < kPack; ++l) numbers[l] = static_cast<int>(k + l);
                double until[kPack];
                const unsigned free = split == 1 ? free_lanes<1>(pairs, numbers, lanes, until)
                                                 : free_lanes<2>(pairs, numbers, lanes, until);
                for (int l = 0; l < lanes; ++l)
                    if (!(free >> l & 1)) list.add({numbers[l], until[l]});
            }
            return true;
        });
    }

  private:
    static constexpr double kRounding = 16 * kEpsilon, kApproach = 0.9;  // of a gap that may be used up

    // A bit for each pair that is free, and the times up to which the others are.
    template <int kSplit>
    unsigned free_lanes(const int* rows, const int* numbers, long lanes, double* until) const {
        const PairPack here = gather(at_, rows, numbers, lanes), way = gather(moves_, rows, numbers, lanes);
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
        const auto apart = less(constant<Eight>(touching_), distance - most_radii<kSplit>(here.radius));
        const auto free = apart & (less(speed, room) | less(wanted, narrowest));
        store_lanes(until, select(apart & less(zero, room), quotient(room, speed), zero));
        for (int l = 0; l < kPack; ++l)
            if (!(closest.sure >> l & 1) || !(until[l] > 0)) until[l] = 0;
        return bits_of(free) & closest.sure;
    }

    Places at_, moves_;
    double touching_ = 0;
};

}  // namespace yasps
