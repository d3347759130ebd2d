// Added to the prelude of kernels whose inputs are nonlinear in the targets: their local Hessian is expanded to the
// targets as a dense matrix, compressed, projected as a whole and scattered (paper, 7.2).

// `hessian` is n x n, its rows in the order of the leaves with a place in kappa. Leaves with one place are merged.
// Returns how many matrices were changed by the projection, or a negative number if it is not finite.
static inline long project_and_scatter(const yasps_sink* sink, const int* kappa, const long* position, long capacity,
                                       const double* hessian, long n) {
    long* const leaf = (long*)__builtin_alloca(sizeof(long) * (capacity + 1));   // distinct leaves
    long* const start = (long*)__builtin_alloca(sizeof(long) * (capacity + 1));  // where they start when compressed
    long* const to = (long*)__builtin_alloca(sizeof(long) * (n + 1));            // compressed row of each row
    long leaves = 0, width = 0, row = 0;
    for (long p = 0; p < capacity; ++p) {
        if (!kappa[p]) continue;
        const long size = sink->block_size_at[kappa[p] - 1];
        long k = 0;
        while (k < leaves && kappa[leaf[k]] != kappa[p]) ++k;
        if (k == leaves) {
            leaf[leaves] = p;
            start[leaves++] = width;
            width += size;
        }
        for (long e = 0; e < size; ++e) to[row++] = start[k] + e;
    }
    double* const small = (double*)__builtin_alloca(sizeof(double) * width * width);
    for (long k = 0; k < width * width; ++k) small[k] = 0.0;
    for (long r = 0; r < n; ++r)
        for (long c = 0; c < n; ++c) small[to[r] * width + to[c]] += hessian[r * n + c];
    double* const upper = (double*)__builtin_alloca_with_align(sizeof(double) * 8 * (width * (width + 1) / 2), 512);
    for (long r = 0, k = 0; r < width; ++r)
        for (long c = r; c < width; ++c, ++k) upper[k * 8] = small[r * width + c];
    const long changed = sink->project(upper, (int)width, 1, sink->mode);
    if (changed < 0) return changed;
    for (long r = 0, k = 0; r < width; ++r)
        for (long c = r; c < width; ++c, ++k) small[r * width + c] = small[c * width + r] = upper[k * 8];
    double* const block = (double*)__builtin_alloca(sizeof(double) * width * width);
    for (long a = 0; a < leaves; ++a)
        for (long b = a; b < leaves; ++b) {
            const long rows = (a + 1 < leaves ? start[a + 1] : width) - start[a];
            const long cols = (b + 1 < leaves ? start[b + 1] : width) - start[b];
            for (long r = 0; r < rows; ++r)
                for (long c = 0; c < cols; ++c) block[r * cols + c] = small[(start[a] + r) * width + start[b] + c];
            const long p = leaf[a], q = leaf[b];
            add_block(sink, position[upper_place(capacity, p, q)], block, rows, cols);
        }
    return changed;
}
