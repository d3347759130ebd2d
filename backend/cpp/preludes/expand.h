// Added to the prelude of kernels whose Hessian is expanded.

// The `entries` of each instance of a pack after each other: instance l from to[l * vectors] on.
static inline void lane_by_lane(const V* h, long entries, V* to, long vectors) {
    long k = 0;
    for (; k + 8 <= entries; k += 8) {
        V a[8];
#pragma GCC unroll 8
        for (int e = 0; e < 8; ++e) a[e] = h[k + e];
        transpose(a);
#pragma GCC unroll 8
        for (int l = 0; l < 8; ++l) to[l * vectors + k / 8] = a[l];
    }
    for (; k < entries; ++k)
        for (long l = 0; l < 8; ++l) ((double*)(to + l * vectors))[k] = h[k][l];
}

// Rows [begin, begin + height) of the symmetric n x n matrix with this upper triangle, from column `begin` on; they lie
// `stride` apart, a multiple of 8, and are filled up with zeros.
static inline void copy_rows_of_triangle(const double* triangle, long n, long begin, long height, double* to,
                                         long stride) {
    for (long r = begin; r < begin + height; ++r, to += stride) {
        *(V*)(to + stride - 8) = splat(0.0);
        for (long c = begin; c < r; ++c) to[c - begin] = triangle[upper_place(n, c, r)];
        for (long c = r; c < n; ++c) to[c - begin] = triangle[upper_place(n, r, c)];
    }
}

// Columns [0, size) of `height` rows, which lie `stride` apart, become rows `across` apart.
static inline void copy_transposed(const double* from, long stride, long height, long size, double* to, long across) {
    for (long c = 0; c < size; ++c)
        for (long r = 0; r < height; ++r) to[c * across + r] = from[r * stride + c];
}

// Adds the blocks between the leaves p_begin .. p_end and q_begin .. q_end of kappa, which come later or are the same;
// the rows of `both`, `across` apart, are the unknowns of q, its columns those of p.
static void add_expanded(const yasps_sink& sink, const int* kappa, const long* position, long capacity, long p_begin,
                         long p_end, long q_begin, long q_end, const double* both, long across) {
    for (long p = p_begin; p < p_end; ++p) {
        if (!kappa[p]) continue;
        const long rows = sink.block_size_at[kappa[p] - 1];
        const double* b = both;
        for (long q = q_begin; q < q_end; ++q) {
            if (!kappa[q]) continue;
            const long cols = sink.block_size_at[kappa[q] - 1];
            if (q >= p) {
                const long where = position[upper_place(capacity, p, q)];
                double* const to = block_at(sink, where >> kYaspsFlagBits);
                if (where & kYaspsTwice) {  // two leaves are the same unknowns
                    for (long r = 0; r < rows; ++r)
                        for (long c = 0; c < cols; ++c) to[r * cols + c] += b[c * across + r] + b[r * across + c];
                } else if (where & kYaspsTurned) {
                    for (long c = 0; c < cols; ++c)
                        for (long r = 0; r < rows; ++r) to[c * rows + r] += b[c * across + r];
                } else {
                    for (long r = 0; r < rows; ++r)
                        for (long c = 0; c < cols; ++c) to[r * cols + c] += b[c * across + r];
                }
            }
            b += cols * across;
        }
        both += rows;
    }
}
