// Added to the prelude of kernels that write blocks of targets. Entries lie instance by instance in a block but pack by
// pack in registers, so eight entries of eight instances are transposed at a time.
enum { MOST_PAIRS = 16 };
// The first eight entries of a 3x3 block, or of its transpose. Which is anyone's guess, so no branch where a shuffle
// can read its pattern.
static inline V turned_if(long turn, V a) {
#ifdef __AVX512F__
    typedef long Pattern __attribute__((vector_size(64)));
    static const Pattern pattern[2] = {{0, 1, 2, 3, 4, 5, 6, 7}, {0, 3, 6, 1, 4, 7, 2, 5}};
    return __builtin_shuffle(a, pattern[turn]);
#else
    return turn ? __builtin_shufflevector(a, a, 0, 3, 6, 1, 4, 7, 2, 5) : a;
#endif
}
// Adds 3x3 blocks of each instance of a pack, `pairs` of them: at[9 p + 3 r + c] says which of h is entry (r, c) of
// block p, and position[l * stride + place[p]] where the block of instance l goes. One instance after the other,
// because neighbours often share a block, and adding twice in a row to one place waits for the first addition to be
// stored.
template <class Place>
static void add_packs_3x3(const yasps_sink& sink, const long* position, long stride, long lanes, const V* h,
                          const short* at, const Place* place, long pairs) {
    V block[8 * MOST_PAIRS], corner[MOST_PAIRS];
    for (long begin = 0; begin < pairs; begin += MOST_PAIRS, at += 9 * MOST_PAIRS, place += MOST_PAIRS) {
        const long count = pairs - begin < MOST_PAIRS ? pairs - begin : MOST_PAIRS;
        for (long p = 0; p < count; ++p) {
            V entries[8];
#pragma GCC unroll 8
            for (int k = 0; k < 8; ++k) entries[k] = h[at[9 * p + k]];
            transpose(entries);
#pragma GCC unroll 8
            for (long l = 0; l < 8; ++l) block[l * MOST_PAIRS + p] = entries[l];
            corner[p] = h[at[9 * p + 8]];
        }
        for (long l = 0; l < lanes; ++l)
            for (long p = 0; p < count; ++p) {
                const long where = position[l * stride + place[p]];
                if (where < 0) continue;
                double* const to = block_at(sink, where >> kYaspsFlagBits);
                const V same = block[l * MOST_PAIRS + p];
                V sum = turned_if(where & kYaspsTurned, same);
                double last = corner[p][l];
                if (__builtin_expect(where & kYaspsTwice, 0)) {  // two slots of one instance are the same unknowns
                    sum = same + turned_if(1, same);
                    last += last;
                }
                *(V_unaligned*)to += sum;
                to[8] += last;
            }
    }
}
// The same for blocks of any shape.
template <long rows, long cols, class Place>
static void add_packs(const yasps_sink& sink, const long* position, long stride, long lanes, const V* h,
                      const short* at, const Place* place, long pairs) {
    constexpr long size = rows * cols, vectors = (size + 7) / 8;
    V block[8 * vectors];
    for (long p = 0; p < pairs; ++p, at += size) {
        for (long k = 0; k + 8 <= size; k += 8) {
            V entries[8];
            for (long e = 0; e < 8; ++e) entries[e] = h[at[k + e]];
            transpose(entries);
            for (long l = 0; l < 8; ++l) block[vectors * l + k / 8] = entries[l];
        }
        for (long k = size / 8 * 8; k < size; ++k)
            for (long l = 0; l < 8; ++l) ((double*)(block + vectors * l))[k] = h[at[k]][l];
        for (long l = 0; l < lanes; ++l) {
            const double* const b = (const double*)(block + vectors * l);
            add_block(sink, position[l * stride + place[p]], b, rows, cols);
        }
    }
}
