// Which dof blocks move together in the coarse space of the two-level preconditioner.
//
// An aggregate grows by breadth-first search over the couplings of the static part, so it is connected and belongs to
// one body where bodies are not coupled; the next one begins beside it. Only blocks of one size share an aggregate.
#include <algorithm>

#include "core/runtime.h"
#include "solvers/coarse_space.h"

namespace yasps {
namespace {

// The coarse matrix is dense. It has about this share of what H has of numbers, and at most so many rows.
constexpr double kShare = 0.15;
constexpr long kMostUnknowns = 1000;
// So few unknowns of one size, of affine bodies or joints, are all in the coarse space by themselves.
constexpr long kFewUnknowns = 192;

// What aggregates follow from: the sizes of the dof blocks, and which pairs of them a matrix has blocks for.
struct Couplings {
    long blocks;
    const int* size;  // [blocks]: scalars
    long pairs;
    const int *row, *col;  // [pairs]: dof blocks
    long values;           // numbers of the matrix
};

// The other blocks of the same size that each one is coupled with.
struct Neighbours {
    Buffer<long> start;  // [blocks + 1]
    Buffer<int> other;

    bool find(const Couplings& s) {
        const auto couples = [&](long k) { return s.row[k] != s.col[k] && s.size[s.row[k]] == s.size[s.col[k]]; };
        if (!start.reserve(s.blocks + 2) || !other.reserve(2 * s.pairs)) return false;
        long* const next = start.data + 1;  // of block b: behind what was found of it
        std::fill_n(start.data, s.blocks + 2, 0L);
        for (long k = 0; k < s.pairs; ++k)
            if (couples(k)) ++start[s.row[k] + 2], ++start[s.col[k] + 2];
        for (long b = 0; b < s.blocks; ++b) start[b + 2] += start[b + 1];
        for (long k = 0; k < s.pairs; ++k) {
            if (!couples(k)) continue;
            other[next[s.row[k]]++] = s.col[k];
            other[next[s.col[k]]++] = s.row[k];
        }
        return true;
    }
};

struct Growth {
    const Couplings& s;
    const Neighbours& neighbours;
    Aggregates& found;
    Buffer<int> members;  // of the aggregate that grows, in the order of the search
    Buffer<int> seeds;    // blocks beside those taken

    // One aggregate from this block on; returns how many blocks it has.
    long grow(int seed, long most) {
        const int number = found.count;
        long taken = 0;
        found.of[seed] = number;
        members[taken++] = seed;
        for (long k = 0; k < taken; ++k)
            for (long e = neighbours.start[members[k]]; e < neighbours.start[members[k] + 1] && taken < most; ++e) {
                const int other = neighbours.other[e];
                if (found.of[other] >= 0) continue;
                found.of[other] = number;
                members[taken++] = other;
            }
        return taken;
    }

    // The aggregate of a block beside the members that belongs to another one, or -1.
    int beside(long taken) const {
        for (long k = 0; k < taken; ++k)
            for (long e = neighbours.start[members[k]]; e < neighbours.start[members[k] + 1]; ++e) {
                const int owner = found.of[neighbours.other[e]];
                if (owner >= 0 && owner != found.count) return owner;
            }
        return -1;
    }

    // Takes all blocks that are coupled with this one, directly or not.
    void grow_body(int first, long most) {
        long begin = 0, end = 0;
        seeds[end++] = first;
        while (begin < end) {
            const int seed = seeds[begin++];
            if (found.of[seed] >= 0) continue;
            const long taken = grow(seed, most);
            const int owner = taken < most / 4 ? beside(taken) : -1;  // a crumb
            for (long k = 0; k < taken; ++k) {
                if (owner >= 0) found.of[members[k]] = owner;
                for (long e = neighbours.start[members[k]]; e < neighbours.start[members[k] + 1]; ++e)
                    if (found.of[neighbours.other[e]] < 0) seeds[end++] = neighbours.other[e];
            }
            if (owner >= 0) {
                found.weight[owner] += static_cast<int>(taken);
            } else {
                found.width[found.count] = s.size[seed];
                found.weight[found.count++] = static_cast<int>(taken);
            }
        }
    }
};

// Leaves only the largest aggregates, so that the coarse space is small enough; what the others had takes no part.
bool drop_smallest(Aggregates& found, long blocks) {
    Buffer<int> order, number;
    if (!order.reserve(found.count) || !number.reserve(found.count)) return false;
    for (int k = 0; k < found.count; ++k) order[k] = k, number[k] = -1;
    std::stable_sort(order.data, order.data + found.count,
                     [&](int a, int b) { return found.weight[a] > found.weight[b]; });
    long unknowns = 0;
    for (int k = 0; k < found.count && unknowns + found.width[order[k]] <= kMostUnknowns; ++k) {
        unknowns += found.width[order[k]];
        number[order[k]] = 0;
    }
    int kept = 0;
    for (int k = 0; k < found.count; ++k)
        if (number[k] == 0) {
            found.width[kept] = found.width[k];
            found.weight[kept] = found.weight[k];
            number[k] = kept++;
        }
    for (long b = 0; b < blocks; ++b) found.of[b] = number[found.of[b]];
    found.count = kept;
    return true;
}

long unknowns_of(const Aggregates& found) {
    long sum = 0;
    for (int k = 0; k < found.count; ++k) sum += found.width[k];
    return sum;
}

bool find(Aggregates& found, const Couplings& s) {
    const long blocks = s.blocks;
    const int largest = blocks ? *std::max_element(s.size, s.size + blocks) : 0;
    Neighbours neighbours;
    Growth growth = {s, neighbours, found, {}, {}};
    Buffer<long> unknowns_of_size;
    const bool room = neighbours.find(s) && growth.members.reserve(blocks) &&
                      growth.seeds.reserve(blocks + neighbours.start[blocks]) && found.of.reserve(blocks) &&
                      found.width.reserve(blocks) && found.weight.reserve(blocks) &&
                      unknowns_of_size.reserve(largest + 1);
    if (!room) return false;
    long scalars = 0;
    std::fill_n(unknowns_of_size.data, largest + 1, 0L);
    for (long b = 0; b < blocks; ++b) unknowns_of_size[s.size[b]] += s.size[b], scalars += s.size[b];
    // Larger aggregates until they are few enough, or one for each body.
    const double wanted = sqrt(kShare * static_cast<double>(s.values));
    for (long most = 1 + static_cast<long>(static_cast<double>(scalars) / (wanted + 1));; most *= 2) {
        found.count = 0;
        std::fill_n(found.of.data, blocks, -1);
        for (long b = 0; b < blocks; ++b)
            if (found.of[b] < 0)
                growth.grow_body(static_cast<int>(b), unknowns_of_size[s.size[b]] > kFewUnknowns ? most : 1);
        if (unknowns_of(found) <= kMostUnknowns) break;
        if (most >= blocks) {
            if (!drop_smallest(found, blocks)) return false;
            break;
        }
    }
    found.unknowns = unknowns_of(found);
    if (!found.first.reserve(found.count + 1) || !found.padded_of.reserve(found.unknowns)) return false;
    long unknown = 0, length = 0;
    for (int k = 0; k < found.count; ++k) {
        found.first[k] = static_cast<int>(unknown);
        for (int i = 0; i < found.width[k]; ++i) found.padded_of[unknown++] = static_cast<int>(length + i);
        length += padded_size(found.width[k]);
    }
    found.first[found.count] = static_cast<int>(unknown);
    found.length = length;
    found.known = true;
    return true;
}

}  // namespace

bool find_aggregates(const Structure& s) {
    if (s.aggregates.known) return true;
    return find(s.aggregates, {s.layout.blocks, s.layout.size.data, s.blocks, s.row.data, s.col.data, s.values});
}

}  // namespace yasps

extern "C" {

// of[i]: the aggregate of the dof block of scalar i, or -1 for one that takes no part.
int yasps_aggregates(const yasps::Structure* s, int* of) {
    if (!yasps::find_aggregates(*s)) return yasps::kOutOfMemory;
    const yasps::Layout& layout = s->layout;
    for (long b = 0; b < layout.blocks; ++b)
        for (int i = 0; i < layout.size[b]; ++i) of[layout.start[b] + i] = s->aggregates.of[b];
    return yasps::kOk;
}

// For a matrix that is not here, as that of a GPU: of[b] is the aggregate of dof block b, or -1. size [blocks]: scalars
// of each; row, col [pairs]: dof blocks that the matrix has a block for; values: its numbers.
int yasps_aggregates_of(long blocks, const int* size, long pairs, const int* row, const int* col, long values,
                        int* of) {
    yasps::Aggregates found;
    if (!yasps::find(found, {blocks, size, pairs, row, col, values})) return yasps::kOutOfMemory;
    for (long b = 0; b < blocks; ++b) of[b] = found.of[b];
    return yasps::kOk;
}
}
