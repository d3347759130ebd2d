// Added to the prelude of kernels whose inputs are parameterised: what lies behind a slot is pulled back for the 8
// instances of a pack at once, as far as they are of the same branches of UNIONs.

// Rows of J^T b behind instances of[0], ..., of[7] of a source, all of one branch: b has n columns, `out` too. Writes
// the sizes of the leaves, and returns their number.
typedef long (*PullLanes)(Arguments a, const long* of, const V* b, long n, V* out, int* sizes);

// An input of the instances of a pack.
struct LaneSlot {
    PullLanes pull;  // null: direct in all branches
    Arguments arguments;
    long size, entry, leaf;  // entries; where they begin in the gradient, and leaves in kappa
    long of[8];              // which instance each lane reads
    int branch[8];           // of the UNION that is read; 0: direct
    // Of the branch at hand:
    long leaves, height, cols;
    int* sizes;  // of leaves
    V* left;     // [height, cols]: J^T H, from column `entry` on; null: direct
};

// The lanes of `left` in which all slots are of the same branches as in its first lane; the other lanes then read what
// that one reads.
static unsigned take_branches(LaneSlot* slots, long count, unsigned left, LaneSlot* taken) {
    const int first = __builtin_ctz(left);
    unsigned same = left;
    for (long s = 0; s < count; ++s)
        for (long l = 0; l < 8; ++l)
            if (slots[s].branch[l] != slots[s].branch[first]) same &= ~(1u << l);
    for (long s = 0; s < count; ++s) {
        taken[s] = slots[s];
        for (long l = 0; l < 8; ++l)
            if (!(same >> l & 1)) taken[s].of[l] = slots[s].of[first];
    }
    return same;
}

static inline bool all_direct(const LaneSlot* slots, long count) {
    bool direct = true;
    for (long s = 0; s < count; ++s) direct = direct && slots[s].branch[0] == 0;
    return direct;
}

// Adds the gradient of these lanes; `rows` has room for what lies behind any slot.
static void add_gradient_of_lanes(const yasps_sink& sink, const LaneSlot* slots, long count, const int* kappa,
                                  long capacity, unsigned lanes, const V* gradient, V* rows, int* sizes) {
    for (long s = 0; s < count; ++s) {
        const LaneSlot& slot = slots[s];
        const V* from = gradient + slot.entry;
        long leaves = 1;
        sizes[0] = (int)slot.size;
        if (slot.branch[__builtin_ctz(lanes)]) {
            leaves = slot.pull(slot.arguments, slot.of, from, 1, rows, sizes);
            from = rows;
        }
        for (long p = 0; p < leaves; from += sizes[p++])
            for (unsigned left = lanes; left; left &= left - 1) {
                const int l = __builtin_ctz(left), k = kappa[l * capacity + slot.leaf + p];
                if (k) add_gradient(sink.gradient + k - 1, from, l, sizes[p]);
            }
    }
}

// Entries (r, c) of a block of each instance: from[r * down + c * along].
struct LaneBlock {
    const V* from;
    long rows, cols, down, along;
};

// Adds a block to where these lanes have it, all turned alike, so that r of the block runs slower than c. What goes to
// one place, as of one body, is added up first.
static void add_entries(const yasps_sink& sink, const long* position, long stride, unsigned lanes,
                        const LaneBlock& block) {
    double* to[8];
    const long first = position[__builtin_ctz(lanes) * stride], size = block.rows * block.cols;
    bool one_place = true;
    for (unsigned left = lanes; left; left &= left - 1) {
        const int l = __builtin_ctz(left);
        one_place = one_place && position[l * stride] == first;
        to[l] = block_at(sink, position[l * stride] >> kYaspsFlagBits);
    }
    double* const place = to[__builtin_ctz(lanes)];
    const V* row = block.from;
    long k = 0, c = 0;
    const auto next = [&] {
        const V entry = row[c * block.along];
        if (++c == block.cols) c = 0, row += block.down;
        return entry;
    };
    for (; k + 8 <= size; k += 8) {
        V a[8];
        for (int e = 0; e < 8; ++e) a[e] = next();
        transpose(a);
        if (one_place) {
            V sum = splat(0.0);
            for (unsigned left = lanes; left; left &= left - 1) sum += a[__builtin_ctz(left)];
            *(V_unaligned*)(place + k) += sum;
        } else {
            for (unsigned left = lanes; left; left &= left - 1) {
                const int l = __builtin_ctz(left);
                *(V_unaligned*)(to[l] + k) += a[l];
            }
        }
    }
    for (; k < size; ++k) {
        const V entry = next();
        if (one_place) {
            double sum = 0.0;
            for (unsigned left = lanes; left; left &= left - 1) sum += entry[__builtin_ctz(left)];
            place[k] += sum;
        } else {
            for (unsigned left = lanes; left; left &= left - 1) {
                const int l = __builtin_ctz(left);
                to[l][k] += entry[l];
            }
        }
    }
}

// Adds a block of these lanes to its places; `sum` has room for another.
static void add_block_of_lanes(const yasps_sink& sink, const long* position, long stride, unsigned lanes,
                               const LaneBlock& block, V* sum) {
    unsigned plain = 0, turned = 0, twice = 0;
    for (unsigned left = lanes; left; left &= left - 1) {
        const int l = __builtin_ctz(left);
        const long where = position[l * stride];
        if (where < 0) continue;
        (where & kYaspsTwice ? twice : where & kYaspsTurned ? turned : plain) |= 1u << l;
    }
    if (plain) add_entries(sink, position, stride, plain, block);
    const LaneBlock other = {block.from, block.cols, block.rows, block.along, block.down};
    if (turned) add_entries(sink, position, stride, turned, other);
    if (!twice) return;
    const long n = block.rows;  // two leaves are the same unknowns: the block and its transpose
    for (long r = 0; r < n; ++r)
        for (long c = 0; c < n; ++c)
            sum[r * n + c] =
                block.from[r * block.down + c * block.along] + block.from[c * block.down + r * block.along];
    add_entries(sink, position, stride, twice, {sum, n, n, n, 1});
}

// Room for what add_hessian_of_lanes makes: rows of H [size, columns] of a slot, J^T H of all slots one after another,
// its transpose [size, unknowns], that pulled back [height, unknowns], and a block of leaves.
struct LaneRoom {
    V *rows, *left, *right, *both, *block;
    int* sizes;  // [capacity]
};

// Blocks of targets, added by add_packs_3x3.
struct DirectBlocks {
    short entry[9 * MOST_PAIRS];
    long place[MOST_PAIRS], count = 0;
};

// Adds J^T H J for the packed Hessians h of these lanes, n wide.
static void add_hessian_of_lanes(const yasps_sink& sink, LaneSlot* slots, long count, const long* position,
                                 long capacity, unsigned lanes, const V* h, long n, const LaneRoom& room) {
    const long pairs = capacity * (capacity + 1) / 2;
    // Positions are read block by block, 8 lines at a time that lie far apart: the processor does not see that the next
    // pack's follow.
    for (long k = 0; k < pairs; ++k) __builtin_prefetch(position + 8 * (pairs + k));
    V* next = room.left;
    for (long s = 0; s < count; ++s) {
        LaneSlot& slot = slots[s];
        slot.sizes = room.sizes + slot.leaf;
        slot.cols = n - slot.entry;
        if (!slot.branch[__builtin_ctz(lanes)]) {
            slot.left = nullptr;
            slot.leaves = 1;
            slot.height = slot.size;
            slot.sizes[0] = (int)slot.size;
            continue;
        }
        for (long r = 0; r < slot.size; ++r) {
            V* const row = room.rows + r * slot.cols;
            for (long c = 0; c < r; ++c) row[c] = room.rows[c * slot.cols + r];
            const V* const from = h + upper_place(n, slot.entry + r, slot.entry + r) - r;
            for (long c = r; c < slot.cols; ++c) row[c] = from[c];
        }
        slot.left = next;
        slot.leaves = slot.pull(slot.arguments, slot.of, room.rows, slot.cols, slot.left, slot.sizes);
        slot.height = 0;
        for (long p = 0; p < slot.leaves; ++p) slot.height += slot.sizes[p];
        next += slot.height * slot.cols;
    }
    // The first lanes, of targets of 3 numbers: most blocks of most scenes.
    const bool by_packs = !(lanes & (lanes + 1)) && n < 256;
    const long in_pack = __builtin_popcount(lanes);
    DirectBlocks blocks;
    for (long t = 0; t < count; ++t) {
        const LaneSlot& other = slots[t];
        long across = 0;
        if (other.left) {
            for (long s = 0; s <= t; ++s) across += slots[s].height;
            long column = 0;
            for (long s = 0; s <= t; ++s) {
                const LaneSlot& slot = slots[s];
                for (long e = 0; e < other.size; ++e)
                    for (long r = 0; r < slot.height; ++r)
                        room.right[e * across + column + r] =
                            slot.left ? slot.left[r * slot.cols + other.entry - slot.entry + e]
                                      : h[upper_place(n, slot.entry + r, other.entry + e)];
                column += slot.height;
            }
            other.pull(other.arguments, other.of, room.right, across, room.both, other.sizes);
        }
        long column = 0;
        for (long s = 0; s <= t; ++s) {
            const LaneSlot& slot = slots[s];
            if (!slot.left && !other.left) {
                const long place = upper_place(capacity, slot.leaf, other.leaf);
                if (by_packs && slot.size == 3 && other.size == 3) {
                    blocks.place[blocks.count] = place;
                    for (long k = 0; k < 9; ++k)
                        blocks.entry[9 * blocks.count + k] =
                            (short)packed_place(n, slot.entry + k / 3, other.entry + k % 3);
                    if (++blocks.count == MOST_PAIRS) {
                        add_packs_3x3(sink, position, pairs, in_pack, h, blocks.entry, blocks.place, MOST_PAIRS);
                        blocks.count = 0;
                    }
                    continue;
                }
                for (long r = 0; r < slot.size; ++r)
                    for (long c = 0; c < other.size; ++c)
                        room.block[r * other.size + c] = h[packed_place(n, slot.entry + r, other.entry + c)];
                const LaneBlock block = {room.block, slot.size, other.size, other.size, 1};
                add_block_of_lanes(sink, position + place, pairs, lanes, block, room.block + slot.size * other.size);
                continue;
            }
            const long down = other.left ? 1 : slot.cols, along = other.left ? across : 1;
            const V* from = other.left ? room.both + column : slot.left + other.entry - slot.entry;
            for (long p = 0; p < slot.leaves; from += slot.sizes[p++] * down) {
                const V* of_leaf = from;
                for (long q = 0; q < other.leaves; of_leaf += other.sizes[q++] * along) {
                    if (s == t && q < p) continue;
                    const long place = upper_place(capacity, slot.leaf + p, other.leaf + q);
                    const LaneBlock block = {of_leaf, slot.sizes[p], other.sizes[q], down, along};
                    add_block_of_lanes(sink, position + place, pairs, lanes, block, room.block);
                }
            }
            column += slot.height;
        }
    }
    if (blocks.count) add_packs_3x3(sink, position, pairs, in_pack, h, blocks.entry, blocks.place, blocks.count);
}
