// What every generated file of device code begins with, after sink.h. No headers: there are none where NVRTC compiles
// it.
typedef const void* const* Arguments;
typedef double Columns;  // what `pull` has of each row

// Of the runtime: projection.cu, isotropic.cu.
extern "C" __device__ int yasps_project(double* packed, int n, int mode, double* work);
extern "C" __device__ int yasps_project_apart(double* packed, long packed_step, int n, int mode, double* work,
                                              long work_step);
extern "C" __device__ int yasps_project_isotropic(double* packed, const double* deformation, int n, int mode);

YASPS_FUNCTION double* block_at(const yasps_sink& sink, long offset) { return sink.blocks + offset; }
YASPS_FUNCTION void add_to(double* to, double x) { atomicAdd(to, x); }
YASPS_FUNCTION double first_of(double x) { return x; }

template <int N>
YASPS_FUNCTION bool all_finite(const double* x) {
    double zero = 0.0;
#pragma unroll
    for (int k = 0; k < N; ++k) zero += x[k] * 0.0;
    return zero == 0.0;
}

YASPS_FUNCTION void report_not_finite(const yasps_sink& sink, long i) {
    atomicMin(sink.outcome, (unsigned long long)i);
}

// Rows of J^T b for what is a target itself; without b they are only counted.
YASPS_FUNCTION long copy_rows(long rows, const double* b, double* out) {
    if (b)
        for (long k = 0; k < rows; ++k) out[k] = b[k];
    return rows;
}

// Place in the gradient of leaf p of instance i, whose row of kappa this is.
YASPS_FUNCTION long gradient_place(const yasps_sink& sink, const int* kappa, long i, long capacity, long p) {
    return sink.gradient_at ? sink.gradient_at[i * capacity + p] : kappa[p] - 1;
}

template <int N>
YASPS_FUNCTION void add_gradient(const yasps_sink& sink, const int* kappa, long i, long capacity, long p,
                                 const double* from) {
    double* const to = sink.gradient + gradient_place(sink, kappa, i, capacity, p);
#pragma unroll
    for (int e = 0; e < N; ++e) add_to(to + e, from[e]);
}

// Adds an R x C block to its place.
template <int R, int C>
YASPS_FUNCTION void add_block(const yasps_sink& sink, long where, const double* b) {
    if (where < 0) return;
    double* const to = block_at(sink, where >> kYaspsFlagBits);
    const bool turn = where & kYaspsTurned,
               both = where & kYaspsTwice;  // both: two slots of one instance are the same unknowns
#pragma unroll
    for (int r = 0; r < R; ++r)
#pragma unroll
        for (int c = 0; c < C; ++c)
            add_to(to + (turn ? c * R + r : r * C + c), both ? b[r * C + c] + b[c % R * C + r % C] : b[r * C + c]);
}

// Adds row `row_in_slot` of an expanded block: of the leaf among those from p_begin on that it belongs to, in the
// columns of the leaves q_begin .. q_end, as far as these come later or are the same.
YASPS_FUNCTION void add_row(const yasps_sink& sink, const int* kappa, const long* position, long capacity, long p_begin,
                            long row_in_slot, long q_begin, long q_end, const double* row) {
    long p = p_begin, r = row_in_slot, rows = 0;
    for (;; ++p) {
        if (!kappa[p]) continue;
        rows = sink.block_size_at[kappa[p] - 1];
        if (r < rows) break;
        r -= rows;
    }
    for (long q = q_begin; q < q_end; ++q) {
        if (!kappa[q]) continue;
        const long cols = sink.block_size_at[kappa[q] - 1];
        if (q >= p) {
            const long where = position[upper_place(capacity, p, q)];
            double* const to = block_at(sink, where >> kYaspsFlagBits);
            for (long c = 0; c < cols; ++c) {
                if (where & (kYaspsTurned | kYaspsTwice)) add_to(to + c * rows + r, row[c]);
                if (!(where & kYaspsTurned)) add_to(to + r * cols + c, row[c]);
            }
        }
        row += cols;
    }
}
