// Symmetric block-sparse matrix-vector product, specialised per block shape (paper, appendix C).
//
// Only the upper triangle is stored, so each block off the diagonal also applies its transpose. Blocks of one row
// follow each other, so a row's result stays in registers until the row changes. Every thread adds into its own
// vector; the caller adds those up in a fixed order.
#include "runtime.h"

namespace yasps {
namespace {

// Keeps the first C % 4 lanes of a block row's last vector; the rest was read from beyond the row.
template <int C>
d4 keep_columns(d4 v) {
    const d4 zero = {};
    if (C % 4 == 1) return __builtin_shufflevector(v, zero, 0, 4, 4, 4);
    if (C % 4 == 2) return __builtin_shufflevector(v, zero, 0, 1, 4, 4);
    if (C % 4 == 3) return __builtin_shufflevector(v, zero, 0, 1, 2, 4);
    return v;
}

// y += B x for the row sums gathered so far; sums hold one vector per row of the block.
template <int R, int C>
void flush(d4 (&sums)[R][(C + 3) / 4], double* y) {
    constexpr int kVectors = (C + 3) / 4;
#pragma GCC unroll 12
    for (int i = 0; i < R; ++i) {
        d4 total = keep_columns<C>(sums[i][kVectors - 1]);
        for (int v = 0; v + 1 < kVectors; ++v) total += sums[i][v];
        y[i] += sum_of(total);
        for (int v = 0; v < kVectors; ++v) sums[i][v] = d4{};
    }
}

// HessianBlocks must be readable four doubles past the last block.
template <int R, int C>
void multiply_shape(Range range, const int* rows, const int* cols, const double* blocks, const double* x, double* y) {
    constexpr int kVectors = (C + 3) / 4;
    d4 sums[R][kVectors] = {};
    double ignored[4 * kVectors] __attribute__((aligned(32))) = {};
    int row = -1;
    for (long b = range.begin; b < range.end; ++b) {
        if (rows[b] != row) {
            if (row >= 0) flush<R, C>(sums, y + row);
            row = rows[b];
        }
        const double* const xi = x + rows[b];
        const double* const xj = x + cols[b];
        const double* const block = blocks + b * (R * C);
        // A diagonal block is its own transpose; its second contribution goes nowhere, without a branch.
        double* const yj = cols[b] == row ? ignored : y + cols[b];
        d4 transposed[kVectors] = {};
#pragma GCC unroll 12
        for (int i = 0; i < R; ++i) {
#pragma GCC unroll 3
            for (int v = 0; v < kVectors; ++v) {
                const d4 entries = load_unaligned(block + i * C + 4 * v);
                sums[i][v] += entries * load(xj + 4 * v);
                transposed[v] += entries * xi[i];
            }
        }
#pragma GCC unroll 3
        for (int v = 0; v + 1 < kVectors; ++v) store(yj + 4 * v, load(yj + 4 * v) + transposed[v]);
        double* const last = yj + 4 * (kVectors - 1);
        store(last, load(last) + keep_columns<C>(transposed[kVectors - 1]));
    }
    if (row >= 0) flush<R, C>(sums, y + row);
}

void multiply_any_shape(int r, int c, Range range, const int* rows, const int* cols, const double* blocks,
                        const double* x, double* y) {
    for (long b = range.begin; b < range.end; ++b) {
        const double* const xi = x + rows[b];
        const double* const xj = x + cols[b];
        double* const yi = y + rows[b];
        double* const yj = y + cols[b];
        const double* block = blocks + b * r * c;
        const bool diagonal = rows[b] == cols[b];
        for (int i = 0; i < r; ++i, block += c) {
            double sum = 0;
            for (int j = 0; j < c; ++j) sum += block[j] * xj[j];
            if (!diagonal)
                for (int j = 0; j < c; ++j) yj[j] += block[j] * xi[i];
            yi[i] += sum;
        }
    }
}

void multiply_group(const Group& group, Range range, const int* rows, const int* cols, const double* blocks,
                    const double* x, double* y) {
    const bool small = group.rows < 64 && group.cols < 64;
    switch (small ? group.rows * 64 + group.cols : 0) {
#define YASPS_SHAPE(R, C)                                      \
    case (R) * 64 + (C):                                       \
        multiply_shape<R, C>(range, rows, cols, blocks, x, y); \
        return;
        YASPS_SHAPE(1, 1)
        YASPS_SHAPE(2, 2)
        YASPS_SHAPE(3, 3)
        YASPS_SHAPE(3, 6)
        YASPS_SHAPE(3, 9)
        YASPS_SHAPE(3, 12)
        YASPS_SHAPE(6, 3)
        YASPS_SHAPE(6, 6)
        YASPS_SHAPE(9, 3)
        YASPS_SHAPE(9, 9)
        YASPS_SHAPE(9, 12)
        YASPS_SHAPE(12, 3)
        YASPS_SHAPE(12, 9)
        YASPS_SHAPE(12, 12)
#undef YASPS_SHAPE
        default:
            multiply_any_shape(group.rows, group.cols, range, rows, cols, blocks, x, y);
    }
}

}  // namespace

void multiply_part(const Structure& s, const double* values, long thread, long threads, const double* x, double* y) {
    for (int g = 0; g < s.group_count; ++g) {
        const Group& group = s.groups[g];
        multiply_group(group, piece(group.count, thread, threads), s.padded_row.data + group.first_block,
                       s.padded_col.data + group.first_block, values + group.first_value, x, y);
    }
}

Range touched_by_part(const Structure& s, long thread, long threads) {
    long lowest = s.layout.padded, highest = 0;
    for (int g = 0; g < s.group_count; ++g) {
        const Group& group = s.groups[g];
        const Range range = piece(group.count, thread, threads);
        if (range.begin == range.end) continue;
        const int* const rows = s.padded_row.data + group.first_block;
        const int* const cols = s.padded_col.data + group.first_block;
        // Rows ascend, and no column lies left of its row.
        if (rows[range.begin] < lowest) lowest = rows[range.begin];
        int last_col = 0;
        for (long b = range.begin; b < range.end; ++b) last_col = cols[b] > last_col ? cols[b] : last_col;
        const long row_end = rows[range.end - 1] + padded_size(group.rows);
        const long col_end = last_col + padded_size(group.cols);
        if (row_end > highest) highest = row_end;
        if (col_end > highest) highest = col_end;
    }
    return lowest < highest ? Range{lowest, highest} : Range{0, 0};
}

void pack(const Layout& layout, Range blocks, const double* compact, double* padded) {
    for (long b = blocks.begin; b < blocks.end; ++b) {
        const int q = layout.size[b];
        const double* const from = compact + layout.start[b];
        double* const to = padded + layout.padded_start[b];
        for (int i = 0; i < q; ++i) to[i] = from[i];
        for (int i = q; i < padded_size(q); ++i) to[i] = 0;
    }
}

void unpack(const Layout& layout, Range blocks, const double* padded, double* compact) {
    for (long b = blocks.begin; b < blocks.end; ++b) {
        const double* const from = padded + layout.padded_start[b];
        double* const to = compact + layout.start[b];
        for (int i = 0; i < layout.size[b]; ++i) to[i] = from[i];
    }
}

}  // namespace yasps
