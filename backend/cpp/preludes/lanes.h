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

// Room for the expansion of a pack: rows of H [size, columns] of a slot, J^T H of all slots one after another, its
// transpose [size, unknowns], that pulled back [height, unknowns], and a block of leaves.
struct LaneRoom {
    V *rows, *left, *right, *both, *block;
    int* sizes;  // [capacity]
};
