// Added to the prelude of kernels that write blocks of targets. Entries lie instance by instance in a block but pack by
// pack in registers, so eight entries of eight instances are transposed at a time.
enum { MOST_PAIRS = 16 };
// Adds 3x3 blocks of each instance of a pack, `pairs` of them: at[9 p + 3 r + c] says which of h is entry (r, c) of
// block p, and position[l * stride + place[p]] where the block of instance l goes. One instance after the other,
// because neighbours often share a block, and adding twice in a row to one place waits for the first addition to be
// stored.
static void add_packs_3x3(double* blocks, const long* position, long stride, long lanes, const V* h, const short* at,
                          const short* place, long pairs) {
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
                double* const to = blocks + (where >> 2);
                const V same = block[l * MOST_PAIRS + p];
                const V turned = __builtin_shufflevector(same, same, 0, 3, 6, 1, 4, 7, 2, 5);
                V sum = where & 1 ? turned : same;
                double last = corner[p][l];
                if (where & 2) {  // two slots of one instance are the same unknowns
                    sum = same + turned;
                    last += last;
                }
                *(V_unaligned*)to += sum;
                to[8] += last;
            }
    }
}
