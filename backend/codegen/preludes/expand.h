// Added to the prelude of kernels whose inputs are not targets themselves.

// Adds the first column of expanded rows to the gradient, at the leaves p_begin .. p_end of instance i.
YASPS_FUNCTION void add_gradient_rows(const yasps_sink& sink, const int* kappa, long i, long capacity, long p_begin,
                                      long p_end, const Columns* rows) {
    for (long p = p_begin; p < p_end; ++p) {
        if (!kappa[p]) continue;
        double* const to = sink.gradient + gradient_place(sink, kappa, i, capacity, p);
        const long size = sink.block_size_at[kappa[p] - 1];
        for (long e = 0; e < size; ++e) add_to(to + e, first_of(*rows++));
    }
}
