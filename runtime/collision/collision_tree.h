// Bounding volume trees of surface pieces: vertices, edges or triangles that move straight from one place to another.
//
// A node keeps a box around where its pieces start and one around how they move. Two boxes are tested by sweeping one
// along their relative motion, so that pieces which move together are as far apart as at rest. Boxes are in single
// precision; the distance asked for makes up for the rounding.
#pragma once

#include <algorithm>

#include "collision/pair_distance.h"
#include "core/runtime.h"

namespace yasps {

// The fourth number of each is not part of the box.
typedef float f4 __attribute__((vector_size(16)));
typedef int i4 __attribute__((vector_size(16)));
inline f4 smaller(f4 a, f4 b) { return a < b ? a : b; }
inline f4 larger(f4 a, f4 b) { return a > b ? a : b; }

struct Box {
    f4 lower, upper;      // around where its pieces start
    f4 slowest, fastest;  // around how they move

    void include(const Box& other) {
        lower = smaller(lower, other.lower), upper = larger(upper, other.upper);
        slowest = smaller(slowest, other.slowest), fastest = larger(fastest, other.fastest);
    }
    // The largest number that a start or an end in it has.
    float largest() const {
        float size = 0;
        for (int k = 0; k < 3; ++k)
            size = std::max({size, fabsf(lower[k]) + fabsf(slowest[k]), fabsf(upper[k]) + fabsf(fastest[k])});
        return size;
    }
};

// Of each vertex the box around it, with its radius, and its way: pieces share vertices, so this is made once.
struct VertexBoxes {
    Buffer<Box> of;  // [vertices]

    // radii: or null. False: out of memory.
    bool take(const Point* start, const Point* end, const double* radii, long count, int threads) {
        if (!of.reserve(count)) return false;
#pragma omp parallel for num_threads(threads) schedule(static) if (threads > 1)
        for (long v = 0; v < count; ++v) {
            const Point from = start[v], way = end[v] - from;
            const f4 at = {static_cast<float>(from.x), static_cast<float>(from.y), static_cast<float>(from.z), 0};
            const f4 along = {static_cast<float>(way.x), static_cast<float>(way.y), static_cast<float>(way.z), 0};
            const f4 around = f4{} + (radii == nullptr ? 0 : static_cast<float>(radii[v]));
            of[v] = {at - around, at + around, along, along};
        }
        return true;
    }
};

// One bit a lane.
inline unsigned bits_of(i4 mask) {
#if defined(__SSE__)
    return static_cast<unsigned>(__builtin_ia32_movmskps(reinterpret_cast<f4>(mask)));
#else
    unsigned bits = 0;
    for (int lane = 0; lane < 4; ++lane) bits |= static_cast<unsigned>(mask[lane] & 1) << lane;
    return bits;
#endif
}

// Whether what both boxes hold may come within `reach` of each other, in all coordinates.
inline bool may_meet(const Box& a, const Box& b, float reach) {
    const f4 zero = {0, 0, 0, 0};
    const f4 lower = a.lower + smaller(zero, a.slowest - b.fastest);
    const f4 upper = a.upper + larger(zero, a.fastest - b.slowest);
    const i4 apart = (lower > b.upper + reach) | (upper < b.lower - reach);
    return (bits_of(apart) & 7) == 0;
}

// The boxes of up to eight pieces that lie near each other, coordinate by coordinate.
constexpr int kBlock = 8;
typedef float f8 __attribute__((vector_size(32)));
typedef int i8 __attribute__((vector_size(32)));
inline unsigned bits_of(i8 mask) {
#if defined(__AVX__)
    return static_cast<unsigned>(__builtin_ia32_movmskps256(reinterpret_cast<f8>(mask)));
#else
    unsigned bits = 0;
    for (int lane = 0; lane < kBlock; ++lane) bits |= static_cast<unsigned>(mask[lane] & 1) << lane;
    return bits;
#endif
}
struct Block {
    f8 lower[3], upper[3], slowest[3], fastest[3];
    i8 vertices[3], label;  // of the pieces; a piece has as many as its arity
    unsigned strayed;       // a bit for each piece of which a vertex is

    // The boxes of pieces, [kBlock].
    void set(const Box* boxes) {
        transpose(boxes, &Box::lower, lower), transpose(boxes, &Box::upper, upper);
        transpose(boxes, &Box::slowest, slowest), transpose(boxes, &Box::fastest, fastest);
    }
    // Nonzero where a piece has a vertex with the one at `place` of `other`, or both have the same label, from 0 on.
    template <int kArity, int kOtherArity>
    i8 joined_with(const Block& other, int place) const {
        const int its_label = other.label[place];
        i8 joined = its_label < 0 ? i8{} : label == its_label;
        for (int d = 0; d < kOtherArity; ++d)
            for (int c = 0; c < kArity; ++c) joined |= vertices[c] == other.vertices[d][place];
        return joined;
    }
    // Nonzero where a box is farther than `reach` from the one at `place` of `other`, as may_meet.
    i8 apart_from(const Block& other, int place, float reach) const {
        i8 apart = {};
#pragma GCC unroll 3
        for (int k = 0; k < 3; ++k) {
            const f8 back = slowest[k] - other.fastest[k][place], ahead = fastest[k] - other.slowest[k][place];
            apart |= lower[k] + (back < 0 ? back : f8{}) > other.upper[k][place] + reach;
            apart |= upper[k] + (ahead > 0 ? ahead : f8{}) < other.lower[k][place] - reach;
        }
        return apart;
    }
    // The same for a whole node.
    i8 apart_from(const Box& other, float reach) const {
        i8 apart = {};
#pragma GCC unroll 3
        for (int k = 0; k < 3; ++k) {
            const f8 back = slowest[k] - other.fastest[k], ahead = fastest[k] - other.slowest[k];
            apart |= lower[k] + (back < 0 ? back : f8{}) > other.upper[k] + reach;
            apart |= upper[k] + (ahead > 0 ? ahead : f8{}) < other.lower[k] - reach;
        }
        return apart;
    }

  private:
    static void transpose(const Box* boxes, f4 Box::* part, f8* to) {
        f8 pair[4];  // the boxes k and k + 4 side by side
        for (int k = 0; k < 4; ++k)
            pair[k] = __builtin_shufflevector(boxes[k].*part, boxes[k + 4].*part, 0, 1, 2, 3, 4, 5, 6, 7);
        const f8 xy = __builtin_shufflevector(pair[0], pair[1], 0, 8, 1, 9, 4, 12, 5, 13);
        const f8 z = __builtin_shufflevector(pair[0], pair[1], 2, 10, 3, 11, 6, 14, 7, 15);
        const f8 next_xy = __builtin_shufflevector(pair[2], pair[3], 0, 8, 1, 9, 4, 12, 5, 13);
        const f8 next_z = __builtin_shufflevector(pair[2], pair[3], 2, 10, 3, 11, 6, 14, 7, 15);
        to[0] = __builtin_shufflevector(xy, next_xy, 0, 1, 8, 9, 4, 5, 12, 13);
        to[1] = __builtin_shufflevector(xy, next_xy, 2, 3, 10, 11, 6, 7, 14, 15);
        to[2] = __builtin_shufflevector(z, next_z, 0, 1, 8, 9, 4, 5, 12, 13);
    }
};

// Some nodes' pieces: a leaf's are one block. A node's children follow it, the first half of its blocks, then the rest;
// so no links are needed.
struct Branch {
    long node;
    int block, blocks;

    bool is_leaf() const { return blocks == 1; }
    Branch first() const { return {node + 1, block, blocks / 2}; }
    Branch second() const { return {node + 2 * (blocks / 2), block + blocks / 2, blocks - blocks / 2}; }
};

// One kind of pieces, each of `arity` vertices.
struct Tree {
    struct Node {
        Box box;
        int label;     // of all its pieces, or -1 where they differ
        bool strayed;  // whether any of them is
    };
    int arity = 0;
    int count = 0;
    Buffer<int> vertices;       // [count, arity], in the order of the blocks
    Buffer<int> label;          // [count]: of all its vertices, or -1 where they differ
    Buffer<int> order, before;  // [count] and [count, arity], only while a better order is made
    Buffer<Point> middle;       // [count], the same
    Buffer<Node> nodes;         // [2 blocks - 1], depth first
    Buffer<Block> blocks;       // [blocks]

    int block_count() const { return (count + kBlock - 1) / kBlock; }
    int end_of(int block) const { return std::min(count, kBlock * block); }
    const int* at(int k) const { return &vertices[static_cast<long>(k) * arity]; }

    // False: out of memory. labels: of all vertices.
    bool take(const int* given, int n, int each, const int* labels) {
        arity = each, count = n;
        const long numbers = static_cast<long>(n) * each;
        if (!vertices.reserve(numbers) || !label.reserve(n) || !order.reserve(n) || !before.reserve(numbers) ||
            !middle.reserve(n) || !nodes.reserve(2L * block_count()) || !blocks.reserve(block_count()))
            return false;
        std::copy_n(given, numbers, vertices.data);
        for (int k = 0; k < n; ++k) {
            label[k] = labels[at(k)[0]];
            for (int c = 1; c < each; ++c)
                if (labels[at(k)[c]] != label[k]) label[k] = -1;
        }
        return true;
    }

    // Sorts the pieces so that those near each other share blocks and nodes; any order is correct.
    void sort(const Point* x) {
        for (int k = 0; k < count; ++k) {
            Point sum = {0, 0, 0};
            for (int c = 0; c < arity; ++c) sum = sum + x[at(k)[c]];
            middle[k] = (1.0 / arity) * sum;
            order[k] = k;
        }
        halve({0, 0, block_count()});
        std::copy_n(vertices.data, static_cast<long>(count) * arity, before.data);
        for (int k = 0; k < count; ++k)
            std::copy_n(&before[static_cast<long>(order[k]) * arity], arity, &vertices[static_cast<long>(k) * arity]);
        std::copy_n(label.data, count, before.data);
        for (int k = 0; k < count; ++k) label[k] = before[order[k]];
    }

    // boxes, strayed: of all vertices; all are strayed where that is null.
    void fit(const Box* boxes, const uint8_t* strayed) {
        if (count > 0) fit({0, 0, block_count()}, boxes, strayed);
    }

  private:
    void halve(Branch branch) {
        if (branch.blocks < 2) return;
        const int begin = kBlock * branch.block, end = end_of(branch.block + branch.blocks);
        Point lower = middle[order[begin]], upper = lower;
        for (int k = begin + 1; k < end; ++k) {
            const Point m = middle[order[k]];
            lower = {std::min(lower.x, m.x), std::min(lower.y, m.y), std::min(lower.z, m.z)};
            upper = {std::max(upper.x, m.x), std::max(upper.y, m.y), std::max(upper.z, m.z)};
        }
        const Point size = upper - lower;
        double Point::* axis = size.x >= size.y ? &Point::x : &Point::y;
        if (size.z >= size.*axis) axis = &Point::z;
        std::nth_element(order.data + begin, order.data + kBlock * branch.second().block, order.data + end,
                         [&](int a, int b) {
                             const double left = middle[a].*axis, right = middle[b].*axis;
                             return left < right || (left == right && a < b);
                         });
        halve(branch.first()), halve(branch.second());
    }

    void fit(Branch branch, const Box* boxes, const uint8_t* strayed) {
        Node& here = nodes[branch.node];
        if (branch.is_leaf()) return fit_leaf(branch.block, &here, boxes, strayed);
        fit(branch.first(), boxes, strayed), fit(branch.second(), boxes, strayed);
        const Node &a = nodes[branch.first().node], &b = nodes[branch.second().node];
        here.box = a.box;
        here.box.include(b.box);
        here.label = a.label == b.label ? a.label : -1;
        here.strayed = a.strayed || b.strayed;
    }

    void fit_leaf(int at_block, Node* here, const Box* boxes, const uint8_t* strayed) {
        Block& block = blocks[at_block];
        const int begin = kBlock * at_block, end = end_of(at_block + 1);
        Box of_pieces[kBlock];
        block.strayed = strayed == nullptr ? 0xff : 0;
        for (int k = begin; k < end; ++k) {
            const int* const ids = at(k);
            Box& box = of_pieces[k - begin];
            box = boxes[ids[0]];
            for (int c = 1; c < arity; ++c) box.include(boxes[ids[c]]);
            for (int c = 0; c < arity; ++c) block.vertices[c][k - begin] = ids[c];
            block.label[k - begin] = label[k];
            for (int c = 0; strayed != nullptr && c < arity; ++c)
                block.strayed |= static_cast<unsigned>(strayed[ids[c]]) << (k - begin);
        }
        *here = {of_pieces[0], label[begin], block.strayed != 0};
        for (int k = begin + 1; k < end; ++k) {
            here->box.include(of_pieces[k - begin]);
            if (label[k] != here->label) here->label = -1;
        }
        const Box nowhere = {f4{} + INFINITY, f4{} - INFINITY, {}, {}};  // it meets nothing
        for (int k = end; k < begin + kBlock; ++k) of_pieces[k - begin] = nowhere;
        block.set(of_pieces);
    }
};

}  // namespace yasps
