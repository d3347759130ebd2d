// Symmetric block-sparse matrix-vector product, specialised per block shape (paper, appendix C).
//
// Only the upper triangle is stored, so each block off the diagonal also applies its transpose. The blocks of one row
// follow each other: its part of x and of the result stay in registers while they last.
#include <algorithm>

#include "core/runtime.h"

namespace yasps {
namespace {

// The first C % 4 lanes of the last vector of C numbers; the others were read from beyond them.
template <int C>
d4 keep_columns(d4 v) {
    const d4 zero = {};
    if (C % 4 == 1) return __builtin_shufflevector(v, zero, 0, 4, 4, 4);
    if (C % 4 == 2) return __builtin_shufflevector(v, zero, 0, 1, 4, 4);
    if (C % 4 == 3) return __builtin_shufflevector(v, zero, 0, 1, 2, 4);
    return v;
}

inline d4 splat(double v) { return d4{v, v, v, v}; }

// What the blocks of one row add up to for each of its R scalars, before the lanes are added. Numbers from beyond the
// last column get into lanes of `tails` that are dropped at the end: masking every block would take longer.
template <int R, int C>
struct RowSums {
    static constexpr int kWhole = C / 4;
    static constexpr bool kTail = C % 4 != 0;
    d4 whole[R] = {};
    d4 tails[R] = {};

    double total(int i) const {
        if (!kTail) return sum_of(whole[i]);
        double tail = tails[i][0];
        for (int lane = 1; lane < C % 4; ++lane) tail += tails[i][lane];
        return kWhole == 0 ? tail : sum_of(whole[i]) + tail;
    }
};

// Adds block x to the row's sums, and transpose(block) x to y where kTwice; xi holds each of the row's numbers of x in
// all lanes.
template <int R, int C, bool kTwice>
void apply(const double* block, const double* xj, const d4 (&xi)[R], RowSums<R, C>& sums, double* y) {
    constexpr int kVectors = (C + 3) / 4;
    d4 transposed[kVectors] = {};
#pragma GCC unroll 12
    for (int i = 0; i < R; ++i) {
#pragma GCC unroll 3
        for (int v = 0; v < kVectors; ++v) {
            const d4 entries = load_unaligned(block + i * C + 4 * v);
            d4& sum = v == RowSums<R, C>::kWhole ? sums.tails[i] : sums.whole[i];
            sum += entries * load(xj + 4 * v);
            if (kTwice) transposed[v] += entries * xi[i];
        }
    }
    if (!kTwice) return;
    // With one vector a block the lanes beyond C are masked in xi, once a row.
    if (kVectors > 1) transposed[kVectors - 1] = keep_columns<C>(transposed[kVectors - 1]);
#pragma GCC unroll 3
    for (int v = 0; v < kVectors; ++v) store(y + 4 * v, load(y + 4 * v) + transposed[v]);
}

// HessianBlocks must be readable four doubles past the last block.
template <int R, int C>
void multiply_runs(const Run* run, const Run* end, const int* cols, const double* blocks, const double* __restrict x,
                   double* __restrict y) {
    for (; run != end; ++run) {
        const double* const x_row = x + run->row;
        d4 xi[R];
#pragma GCC unroll 12
        for (int i = 0; i < R; ++i) xi[i] = C <= 4 ? keep_columns<C>(splat(x_row[i])) : splat(x_row[i]);
        RowSums<R, C> sums;
        long b = run->first;
        // A diagonal block comes first in its row and is its own transpose.
        if (R == C && cols[b] == run->row) {
            apply<R, C, false>(blocks + b * (R * C), x_row, xi, sums, nullptr);
            ++b;
        }
        for (; b < run[1].first; ++b) apply<R, C, true>(blocks + b * (R * C), x + cols[b], xi, sums, y + cols[b]);
        double* const y_row = y + run->row;
#pragma GCC unroll 12
        for (int i = 0; i < R; ++i) y_row[i] += sums.total(i);
    }
}

// Blocks of one number need no vectors.
template <>
void multiply_runs<1, 1>(const Run* run, const Run* end, const int* cols, const double* blocks,
                         const double* __restrict x, double* __restrict y) {
    for (; run != end; ++run) {
        const double xi = x[run->row];
        double sum = 0;
        long b = run->first;
        if (cols[b] == run->row) sum = blocks[b++] * xi;
        for (; b < run[1].first; ++b) {
            sum += blocks[b] * x[cols[b]];
            y[cols[b]] += blocks[b] * xi;
        }
        y[run->row] += sum;
    }
}

void multiply_any_shape(int r, int c, const Run* run, const Run* end, const int* cols, const double* blocks,
                        const double* x, double* y) {
    for (; run != end; ++run) {
        const double* const xi = x + run->row;
        double* const yi = y + run->row;
        for (long b = run->first; b < run[1].first; ++b) {
            const double* const xj = x + cols[b];
            double* const yj = y + cols[b];
            const double* block = blocks + b * r * c;
            const bool diagonal = cols[b] == run->row;
            for (int i = 0; i < r; ++i, block += c) {
                double sum = 0;
                for (int j = 0; j < c; ++j) sum += block[j] * xj[j];
                if (!diagonal)
                    for (int j = 0; j < c; ++j) yj[j] += block[j] * xi[i];
                yi[i] += sum;
            }
        }
    }
}

void multiply_group(const Group& group, const Run* run, const Run* end, const int* cols, const double* blocks,
                    const double* x, double* y) {
    const bool small = group.rows < 64 && group.cols < 64;
    switch (small ? group.rows * 64 + group.cols : 0) {
#define YASPS_SHAPE(R, C)                                  \
    case (R) * 64 + (C):                                   \
        multiply_runs<R, C>(run, end, cols, blocks, x, y); \
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
            multiply_any_shape(group.rows, group.cols, run, end, cols, blocks, x, y);
    }
}

// The first run of the group in this row or a later one; the one behind the last where there is none.
const Run* first_run(const Structure& s, const Group& group, long row) {
    const Run* const runs = s.runs.data + group.first_run;
    return std::lower_bound(runs, runs + group.runs, row, [](const Run& run, long wanted) { return run.row < wanted; });
}

}  // namespace

void multiply_rows(const Structure& s, const double* values, Range rows, const double* x, double* y) {
    for (int g = 0; g < s.group_count; ++g) {
        const Group& group = s.groups[g];
        multiply_group(group, first_run(s, group, rows.begin), first_run(s, group, rows.end),
                       s.padded_col.data + group.first_block, values + group.first_value, x, y);
    }
}

long reach_of(const Structure& s, Range rows) {
    long reach = rows.end;
    for (int g = 0; g < s.group_count; ++g) {
        const Group& group = s.groups[g];
        const Run* const end = first_run(s, group, rows.end);
        if (end != first_run(s, group, rows.begin) && end[-1].reach > reach) reach = end[-1].reach;
    }
    return reach;
}

void mark_stretches(const Structure& s, Range rows, bool* touched) {
    for (int g = 0; g < s.group_count; ++g) {
        const Group& group = s.groups[g];
        const int* const cols = s.padded_col.data + group.first_block;
        const int last = padded_size(group.cols) - 1;
        const Run* const end = first_run(s, group, rows.end);
        for (const Run* run = first_run(s, group, rows.begin); run != end; ++run)
            for (long b = run[1].first - 1; b >= run->first && cols[b] + last >= rows.end; --b)
                for (long stretch = cols[b] / kStretch; stretch <= (cols[b] + last) / kStretch; ++stretch)
                    touched[stretch] = true;
    }
}

long values_before(const Structure& s, long row) {
    long values = 0;
    for (int g = 0; g < s.group_count; ++g) {
        const Group& group = s.groups[g];
        values += first_run(s, group, row)->first * group.rows * group.cols;
    }
    return values;
}

void pack(const Layout& layout, Range blocks, const double* compact, double* padded) {
    if (layout.classes == 1 && layout.largest == 3) {  // as in most scenes
        for (long b = blocks.begin; b < blocks.end; ++b) {
            const double* const from = compact + layout.start[b];
            store(padded + 4 * b, d4{from[0], from[1], from[2], 0});
        }
        return;
    }
    for (long b = blocks.begin; b < blocks.end; ++b) {
        const int q = layout.size[b];
        const double* const from = compact + layout.start[b];
        double* const to = padded + layout.padded_start[b];
        for (int i = 0; i < q; ++i) to[i] = from[i];
        for (int i = q; i < padded_size(q); ++i) to[i] = 0;
    }
}

void unpack(const Layout& layout, Range blocks, const double* padded, double* compact) {
    if (layout.classes == 1 && layout.largest == 3) {
        for (long b = blocks.begin; b < blocks.end; ++b) {
            const double* const from = padded + 4 * b;
            double* const to = compact + layout.start[b];
            to[0] = from[0], to[1] = from[1], to[2] = from[2];
        }
        return;
    }
    for (long b = blocks.begin; b < blocks.end; ++b) {
        const double* const from = padded + layout.padded_start[b];
        double* const to = compact + layout.start[b];
        for (int i = 0; i < layout.size[b]; ++i) to[i] = from[i];
    }
}

}  // namespace yasps
