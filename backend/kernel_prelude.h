// The first lines of every generated file. No headers: they would take longer to compile than the kernels.
typedef double V __attribute__((vector_size(64), may_alias));  // one value of 8 instances

// Layout shared with runtime/runtime.h.
struct yasps_sink {
    double* gradient;
    double* blocks;
    const int* kappa;
    const long* position;
    const int* block_size_at;
    long (*project)(double* packed, int width, int lanes, int mode);
    int mode;
    long* projected;
};

typedef const void* const* Arguments;

static inline V splat(double x) { return V{x, x, x, x, x, x, x, x}; }

// Adds a rows x cols block to its place in HessianBlocks; see PositionInData in the runtime.
static inline void add_block(double* blocks, long position, const double* b, long rows, long cols) {
    if (position < 0) return;
    double* const to = blocks + (position >> 2);
    if (position & 2) {  // two slots of one instance are the same unknowns
        for (long r = 0; r < rows; ++r)
            for (long c = 0; c < cols; ++c) to[r * cols + c] += b[r * cols + c] + b[c * cols + r];
    } else if (position & 1) {
        for (long r = 0; r < rows; ++r)
            for (long c = 0; c < cols; ++c) to[c * rows + r] += b[r * cols + c];
    } else {
        for (long k = 0; k < rows * cols; ++k) to[k] += b[k];
    }
}

// Where entry (r, c), r <= c, of a symmetric n x n matrix stands in its packed upper triangle.
static inline constexpr long packed(long n, long r, long c) { return r * n - r * (r - 1) / 2 + c - r; }
