// Added to the prelude of kernels whose inputs are nonlinear in the targets: their local Hessian is expanded to the
// targets, where leaves with one place are merged, projected as a whole and scattered (paper, 7.2).

// Distinct leaves, where they start when merged, and the merged row of each row. Returns how many leaves there are;
// start[that many] is the width.
YASPS_FUNCTION long merge_leaves(const yasps_sink& sink, const int* kappa, long capacity, int* leaf, int* start,
                                 int* to) {
    long leaves = 0, row = 0;
    int width = 0;
    for (long p = 0; p < capacity; ++p) {
        if (!kappa[p]) continue;
        const int size = sink.block_size_at[kappa[p] - 1];
        long k = 0;
        while (k < leaves && kappa[leaf[k]] != kappa[p]) ++k;
        if (k == leaves) {
            leaf[leaves] = (int)p;
            start[leaves++] = width;
            width += size;
        }
        for (int e = 0; e < size; ++e) to[row++] = start[k] + e;
    }
    start[leaves] = width;
    return leaves;
}

// Packed triangles lie in the workspace, entry k at packed[k * step]. Adds entry (r, c) of a symmetric matrix and, when
// r is not c, entry (c, r), merged.
YASPS_FUNCTION void add_merged(double* packed, long step, long width, const int* to, long r, long c, double value) {
    packed[step * packed_place(width, to[r], to[c])] += r != c && to[r] == to[c] ? 2.0 * value : value;
}

// Adds row r of the block between two slots whose rows begin at p and q; of one slot's own block its upper triangle.
YASPS_FUNCTION void add_merged_row(double* packed, long step, long width, const int* to, long p, long r, long q,
                                   long breadth, const double* row) {
    for (long c = p == q ? r : 0; c < breadth; ++c) add_merged(packed, step, width, to, p + r, q + c, row[c]);
}

// Adds the blocks of a merged triangle to their places in HessianBlocks.
YASPS_FUNCTION void scatter_merged(const yasps_sink& sink, const long* position, long capacity, long leaves,
                                   const int* leaf, const int* start, const double* packed, long step) {
    const long width = start[leaves];
    for (long a = 0; a < leaves; ++a)
        for (long b = a; b < leaves; ++b) {
            const long rows = start[a + 1] - start[a], cols = start[b + 1] - start[b];
            const long where = position[upper_place(capacity, leaf[a], leaf[b])];
            double* const to = block_at(sink, where >> kYaspsFlagBits);
            for (long r = 0; r < rows; ++r)
                for (long c = 0; c < cols; ++c)
                    add_to(to + (where & kYaspsTurned ? c * rows + r : r * cols + c),
                           packed[step * packed_place(width, start[a] + r, start[b] + c)]);
        }
}
