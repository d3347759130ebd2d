// What every generated file begins with, after sink.h. No headers: they would take longer to compile than the kernels.
typedef double V __attribute__((vector_size(64), may_alias));  // one value of 8 instances
typedef double V_unaligned __attribute__((vector_size(64), aligned(8), may_alias));

// The block at this offset of HessianBlocks. Who first asks for one of its tile empties the whole tile: memory is then
// written as it comes, and additions find it in the cache.
static inline double* block_at(const yasps_sink& sink, long offset) {
    double* tile = sink.tiles[offset >> kYaspsTileBits];
    if (__builtin_expect(!tile, 0)) tile = sink.open_tile(&sink, offset >> kYaspsTileBits);
    return tile + (offset & ((1L << kYaspsTileBits) - 1));
}

typedef const void* const* Arguments;
typedef V Columns;  // what `pull` has of each row: 8 columns

static inline double first_of(V x) { return x[0]; }
static inline void add_to(double* to, double x) { *to += x; }
static inline long gradient_place(const yasps_sink&, const int* kappa, long, long, long p) { return kappa[p] - 1; }

// Rows of J^T b for what is a target itself, in n packs of columns.
static inline long copy_rows(long rows, const V* b, long n, V* out) {
    for (long k = 0; k < rows * n; ++k) out[k] = b[k];
    return rows;
}

// What is too large for a thread's stack. `data` is null where memory ran out.
struct Scratch {
    void* const allocated;
    V* const data;
    explicit Scratch(long count)
        : allocated(__builtin_malloc((unsigned long)(count + 1) * sizeof(V))),
          data(allocated ? (V*)(((unsigned long)allocated / sizeof(V) + 1) * sizeof(V)) : nullptr) {}
    Scratch(const Scratch&) = delete;
    Scratch& operator=(const Scratch&) = delete;
    ~Scratch() { __builtin_free(allocated); }
};

static inline V splat(double x) { return V{x, x, x, x, x, x, x, x}; }

// Of whole packs: compiled lane by lane, halves of the result would go through memory, and reading it waits for them.
static inline V v_sqrt(V a) {
#if defined(__AVX512F__) && !defined(__clang__)
    return __builtin_ia32_sqrtpd512_mask(a, a, (unsigned char)255, 4);  // 4: rounded as ever
#else
    V r;
    for (int l = 0; l < 8; ++l) r[l] = __builtin_sqrt(a[l]);
    return r;
#endif
}
static inline V v_fabs(V a) {
    typedef long Bits __attribute__((vector_size(64)));
    return (V)((Bits)a & 0x7fffffffffffffffL);
}

// The same value, but one the compiler knows nothing about. Where the second operand of an interleaving shuffle is a
// constant, GCC 12 may compile it as if both operands were the first (its vmovddup alternative).
static inline V hidden(V x) {
#if defined(__x86_64__) && !defined(__clang__)
#ifdef __AVX512F__
    asm("" : "+v"(x));
#else
    asm("" : "+m"(x));
#endif
#endif
    return x;
}

// Turns 8 entries of 8 instances into 8 instances of 8 entries, or back. Written out, since -O2 leaves loops alone.
static inline void transpose(V* a) {
#pragma GCC unroll 8
    for (int k = 1; k < 8; k += 2) a[k] = hidden(a[k]);
    const V p0 = __builtin_shufflevector(a[0], a[1], 0, 8, 2, 10, 4, 12, 6, 14);
    const V q0 = __builtin_shufflevector(a[0], a[1], 1, 9, 3, 11, 5, 13, 7, 15);
    const V p1 = __builtin_shufflevector(a[2], a[3], 0, 8, 2, 10, 4, 12, 6, 14);
    const V q1 = __builtin_shufflevector(a[2], a[3], 1, 9, 3, 11, 5, 13, 7, 15);
    const V p2 = __builtin_shufflevector(a[4], a[5], 0, 8, 2, 10, 4, 12, 6, 14);
    const V q2 = __builtin_shufflevector(a[4], a[5], 1, 9, 3, 11, 5, 13, 7, 15);
    const V p3 = __builtin_shufflevector(a[6], a[7], 0, 8, 2, 10, 4, 12, 6, 14);
    const V q3 = __builtin_shufflevector(a[6], a[7], 1, 9, 3, 11, 5, 13, 7, 15);
    const V p01_low = __builtin_shufflevector(p0, p1, 0, 1, 8, 9, 4, 5, 12, 13);
    const V p01_high = __builtin_shufflevector(p0, p1, 2, 3, 10, 11, 6, 7, 14, 15);
    const V p23_low = __builtin_shufflevector(p2, p3, 0, 1, 8, 9, 4, 5, 12, 13);
    const V p23_high = __builtin_shufflevector(p2, p3, 2, 3, 10, 11, 6, 7, 14, 15);
    const V q01_low = __builtin_shufflevector(q0, q1, 0, 1, 8, 9, 4, 5, 12, 13);
    const V q01_high = __builtin_shufflevector(q0, q1, 2, 3, 10, 11, 6, 7, 14, 15);
    const V q23_low = __builtin_shufflevector(q2, q3, 0, 1, 8, 9, 4, 5, 12, 13);
    const V q23_high = __builtin_shufflevector(q2, q3, 2, 3, 10, 11, 6, 7, 14, 15);
    a[0] = __builtin_shufflevector(p01_low, p23_low, 0, 1, 2, 3, 8, 9, 10, 11);
    a[4] = __builtin_shufflevector(p01_low, p23_low, 4, 5, 6, 7, 12, 13, 14, 15);
    a[1] = __builtin_shufflevector(q01_low, q23_low, 0, 1, 2, 3, 8, 9, 10, 11);
    a[5] = __builtin_shufflevector(q01_low, q23_low, 4, 5, 6, 7, 12, 13, 14, 15);
    a[2] = __builtin_shufflevector(p01_high, p23_high, 0, 1, 2, 3, 8, 9, 10, 11);
    a[6] = __builtin_shufflevector(p01_high, p23_high, 4, 5, 6, 7, 12, 13, 14, 15);
    a[3] = __builtin_shufflevector(q01_high, q23_high, 0, 1, 2, 3, 8, 9, 10, 11);
    a[7] = __builtin_shufflevector(q01_high, q23_high, 4, 5, 6, 7, 12, 13, 14, 15);
}

// The numbers of the instances of a pack; lanes past the end repeat the last one.
static inline void own_instances(long first, long lanes, long* of) {
#pragma GCC unroll 8
    for (long l = 0; l < 8; ++l) of[l] = first + (l < lanes ? l : lanes - 1);
}

// Those of what they are connected to: the one of lane l to indices[l * arity].
static inline void connected_instances(const int* indices, long arity, long lanes, long* of) {
    if (lanes == 8) {
#pragma GCC unroll 8
        for (long l = 0; l < 8; ++l) of[l] = indices[l * arity];
    } else {
        for (long l = 0; l < 8; ++l) of[l] = indices[(l < lanes ? l : lanes - 1) * arity];
    }
}

// Those of what any 8 instances are connected to.
static inline void instances_from(const int* indices, long arity, const long* own, long* of) {
#pragma GCC unroll 8
    for (long l = 0; l < 8; ++l) of[l] = indices[own[l] * arity];
}

// Bits of the lanes whose instance is in [begin, end); there `of` is its number from `begin` on, in other lanes that of
// the first of these.
static inline unsigned lanes_within(const long* own, long begin, long end, long* of) {
    unsigned in = 0;
    for (int l = 0; l < 8; ++l) in |= (unsigned)(own[l] >= begin && own[l] < end) << l;
    if (in)
        for (int l = 0; l < 8; ++l) of[l] = own[in >> l & 1 ? l : __builtin_ctz(in)] - begin;
    return in;
}

// Copies these lanes of n numbers.
static inline void take_lanes(unsigned in, const V* from, long n, V* to) {
    typedef long Mask __attribute__((vector_size(64)));
    Mask mask;
    for (int l = 0; l < 8; ++l) mask[l] = -(long)(in >> l & 1);
    for (long k = 0; k < n; ++k) to[k] = in == 255 ? from[k] : mask ? from[k] : to[k];
}

// The first two numbers from at[l] + k on of the instances l of a pack: pairs are loaded, and only then taken apart.
static inline void gather_two(const double* const* at, long k, V* to) {
    typedef double Pair __attribute__((vector_size(16)));
    typedef double Pair_unaligned __attribute__((vector_size(16), aligned(8), may_alias));
    Pair pair[8];
#pragma GCC unroll 8
    for (long l = 0; l < 8; ++l) pair[l] = *(const Pair_unaligned*)(at[l] + k);
    const auto even_low = __builtin_shufflevector(pair[0], pair[2], 0, 1, 2, 3);
    const auto even_high = __builtin_shufflevector(pair[4], pair[6], 0, 1, 2, 3);
    const auto odd_low = __builtin_shufflevector(pair[1], pair[3], 0, 1, 2, 3);
    const auto odd_high = __builtin_shufflevector(pair[5], pair[7], 0, 1, 2, 3);
    const V even = __builtin_shufflevector(even_low, even_high, 0, 1, 2, 3, 4, 5, 6, 7);
    const V odd = hidden(__builtin_shufflevector(odd_low, odd_high, 0, 1, 2, 3, 4, 5, 6, 7));
    to[0] = __builtin_shufflevector(even, odd, 0, 8, 2, 10, 4, 12, 6, 14);
    to[1] = __builtin_shufflevector(even, odd, 1, 9, 3, 11, 5, 13, 7, 15);
}

// The n numbers from at[l] on of the instances l of a pack.
static inline void gather(const double* const* at, long n, V* to) {
    long k = 0;
    for (; k + 8 <= n; k += 8) {
#pragma GCC unroll 8
        for (long l = 0; l < 8; ++l) to[k + l] = *(const V_unaligned*)(at[l] + k);
        transpose(to + k);
    }
    for (; k + 2 <= n; k += 2) gather_two(at, k, to + k);
    for (; k < n; ++k) {
        to[k] = V{at[0][k], at[1][k], at[2][k], at[3][k], at[4][k], at[5][k], at[6][k], at[7][k]};
    }
}

// Zero where all n numbers of a lane are finite, else not a number. Four sums, because one would wait for itself.
static inline V sum_of_zeros(const V* x, long n) {
    V a = splat(0.0), b = a, c = a, d = a;
    for (; n >= 4; n -= 4, x += 4) {
        a += x[0] * 0.0;
        b += x[1] * 0.0;
        c += x[2] * 0.0;
        d += x[3] * 0.0;
    }
    for (; n > 0; --n, ++x) a += x[0] * 0.0;
    return (a + b) + (c + d);
}

// Whether any lane of what sum_of_zeros gave is not a number.
static inline bool any_not_finite(V zeros) {
    zeros += __builtin_shufflevector(zeros, zeros, 4, 5, 6, 7, 0, 1, 2, 3);
    zeros += __builtin_shufflevector(zeros, zeros, 2, 3, 0, 1, 6, 7, 4, 5);
    return !(zeros[0] + zeros[1] == 0.0);
}

// Adds n entries of lane l.
static inline void add_gradient(double* to, const V* from, long l, long n) {
#pragma GCC unroll 4
    for (long e = 0; e < n; ++e) to[e] += from[e][l];
}

// Adds a rows x cols block to its place in HessianBlocks; at a PositionInData.
static inline void add_block(const yasps_sink& sink, long position, const double* b, long rows, long cols) {
    if (position < 0) return;
    double* const to = block_at(sink, position >> kYaspsFlagBits);
    if (position & kYaspsTwice) {  // two slots of one instance are the same unknowns
        for (long r = 0; r < rows; ++r)
            for (long c = 0; c < cols; ++c) to[r * cols + c] += b[r * cols + c] + b[c * cols + r];
    } else if (position & kYaspsTurned) {
        for (long r = 0; r < rows; ++r)
            for (long c = 0; c < cols; ++c) to[c * rows + r] += b[r * cols + c];
    } else {
        for (long k = 0; k < rows * cols; ++k) to[k] += b[k];
    }
}
