// The matrix of the coarse space of the two-level preconditioner, its inverse, and products with that.
//
// Every number is computed by one thread, from the same numbers in the same order: results do not depend on how many
// threads there are.
#include "solvers/coarse_space.h"

#include "core/runtime.h"
#include "solvers/preconditioner.h"

namespace yasps {
namespace {

constexpr int kPanel = 8;  // columns that are eliminated together
constexpr int kRows = 4;   // rows that are multiplied together

inline d8 load8(const double* p) { return *reinterpret_cast<const d8*>(p); }
inline void store8(double* p, d8 v) { *reinterpret_cast<d8*>(p) = v; }

// to += factor * block
void add(double* to, long stride, const double* block, int r, int c, double factor) {
    if (r == 3 && c == 3) {
        for (int i = 0; i < 3; ++i) {
            const d4 row = __builtin_shufflevector(load_unaligned(block + 3 * i), d4{}, 0, 1, 2, 4);
            d4_unaligned& sum = *reinterpret_cast<d4_unaligned*>(to + i * stride);
            sum += factor * row;
        }
        return;
    }
    for (int i = 0; i < r; ++i)
        for (int j = 0; j < c; ++j) to[i * stride + j] += factor * block[i * c + j];
}

// Adds P^T U P for the rows of these aggregates: U is the upper triangle of A with half its diagonal blocks.
void add_part(CoarseSpace& c, const Structure& s, const double* values, const Aggregates& aggregates, Range own) {
    const int absent = static_cast<int>(c.length);
    for (int g = 0; g < s.group_count; ++g) {
        const Group& group = s.groups[g];
        const long size = group.rows * group.cols;
        const Run* const end = s.runs.data + group.first_run + group.runs;
        for (const Run* run = s.runs.data + group.first_run; run != end; ++run) {
            const long first = group.first_block + run->first, last = group.first_block + run[1].first;
            const int row = s.row[first], aggregate = aggregates.of[row];
            if (aggregate < own.begin || aggregate >= own.end || c.place[row] == absent) continue;
            double* const to = &c.matrix[aggregates.first[aggregate] * c.stride];
            const double* block = values + group.first_value + run->first * size;
            for (long k = first; k < last; ++k, block += size) {
                const int col = s.col[k];
                if (c.place[col] == absent) continue;
                add(to + aggregates.first[aggregates.of[col]], c.stride, block, group.rows, group.cols,
                    col == row ? 0.5 : 1);
            }
        }
    }
}

// Adds the transpose, in the lower triangle.
void fold(CoarseSpace& c, Range rows) {
    for (long begin = rows.begin; begin < rows.end; begin += 8) {
        const long end = begin + 8 < rows.end ? begin + 8 : rows.end;
        for (long j = 0; j < end; ++j)
            for (long i = j < begin ? begin : j; i < end; ++i) c.matrix[i * c.stride + j] += c.matrix[j * c.stride + i];
    }
}

// The inverse of the diagonal block from `first` on, both triangles. Every thread computes the same.
Reason invert_pivot(const CoarseSpace& c, long first, int size, double (&inverse)[kPanel * kPanel]) {
    double factor[kPanel * kPanel];
    for (int i = 0; i < size; ++i)
        for (int j = 0; j < size; ++j) factor[i * size + j] = j <= i ? c.matrix[(first + i) * c.stride + first + j] : 0;
    const Reason status = invert_factor_of(factor, size);
    if (status != kConverged) return status;
    for (int i = 0; i < size; ++i)
        for (int j = 0; j <= i; ++j)
            inverse[i * kPanel + j] = inverse[j * kPanel + i] = entry_of_inverse(factor, size, i, j);
    return kConverged;
}

// row[0 .. length) -= sum over k of by[k] * panel row k, for two rows that share what is read of the panel.
void eliminate(double* row, double* other, long length, const double* panel, long stride, d8 by, d8 other_by) {
    d8 factors[kPanel], other_factors[kPanel];
#pragma GCC unroll 8
    for (int k = 0; k < kPanel; ++k) factors[k] = by[k] - d8{}, other_factors[k] = other_by[k] - d8{};
    for (long j = 0; j < length; j += 8) {
        d8 entries = load8(row + j), others = load8(other + j);
#pragma GCC unroll 8
        for (int k = 0; k < kPanel; ++k) {
            const d8 column = load8(panel + k * stride + j);
            entries -= factors[k] * column;
            others -= other_factors[k] * column;
        }
        store8(row + j, entries);
        store8(other + j, others);
    }
}

// The lower triangle becomes that of minus the inverse, by the symmetric sweep operator with blocks as pivots (Lange
// 2010, Numerical Analysis for Statisticians, sec. 7.4). Without exchanges: pivots are those of Cholesky's method.
bool invert_lower(CoarseSpace& c, TeamBarrier& barrier) {
    const long n = c.unknowns, thread = omp_get_thread_num(), threads = omp_get_num_threads();
    for (long first = 0; first < n; first += kPanel) {
        const int size = static_cast<int>(n - first < kPanel ? n - first : kPanel);
        alignas(64) double inverse[kPanel * kPanel] = {};
        if (invert_pivot(c, first, size, inverse) != kConverged) return false;
        const Range share = piece(c.stride / 8, thread, threads);
        for (long i = 8 * share.begin; i < 8 * share.end; ++i) {
            const bool outside = i < n && (i < first || i >= first + size);
            const double* const from = i < first ? &c.matrix[first * c.stride + i] : &c.matrix[i * c.stride + first];
            const long step = i < first ? c.stride : 1;
            for (int k = 0; k < kPanel; ++k) c.panel[k * c.stride + i] = outside && k < size ? from[k * step] : 0;
        }
        barrier.wait();
        // Rows by twos, and what lies right of the diagonal means nothing yet; a row of the pivots, or behind the last,
        // has a place of its own for it.
        double* const idle = &c.idle[thread * c.stride];
        for (long pair = 2 * thread; pair < n; pair += 2 * threads) {
            d8 by[2] = {};
            double* rows[2] = {idle, idle};
            for (int r = 0; r < 2; ++r) {
                const long i = pair + r;
                if (i >= n || (i >= first && i < first + size)) continue;
                rows[r] = &c.matrix[i * c.stride];
                for (int l = 0; l < kPanel; ++l) by[r] += c.panel[l * c.stride + i] * load8(inverse + l * kPanel);
            }
            if (rows[0] == rows[1]) continue;
            eliminate(rows[0], rows[1], pair + 2, c.panel.data, c.stride, by[0], by[1]);
            for (int r = 0; r < 2; ++r) {
                if (rows[r] == idle) continue;
                const long i = pair + r;
                for (int k = 0; k < size; ++k)
                    (i > first ? rows[r][first + k] : c.matrix[(first + k) * c.stride + i]) = by[r][k];
            }
        }
        if (thread == 0)
            for (int k = 0; k < size; ++k)
                for (int l = 0; l <= k; ++l) c.matrix[(first + k) * c.stride + first + l] = -inverse[k * kPanel + l];
        barrier.wait();
    }
    return true;
}

}  // namespace

bool reserve_coarse_space(CoarseSpace& c, const Structure& structure, long pieces, long threads) {
    const Aggregates& aggregates = structure.aggregates;
    const long idle = padded_size(structure.layout.largest);
    c.unknowns = aggregates.unknowns;
    c.length = aggregates.length;
    c.stride = (c.unknowns + 8) / 8 * 8;  // one number more at least, which `add` writes
    c.restricted_length = c.length + idle;
    return c.place.reserve(structure.layout.blocks) && c.matrix.reserve(c.unknowns * c.stride) &&
           c.panel.reserve(kPanel * c.stride) && c.idle.reserve(threads * c.stride) &&
           c.restricted.reserve(kCopies * pieces * c.restricted_length) &&
           c.sum.reserve(threads * c.restricted_length) && c.residual.reserve(threads * c.stride) &&
           c.solution.reserve(c.restricted_length);
}

void place_blocks(CoarseSpace& c, const Structure& structure, const double* inverse, Range blocks) {
    const Layout& layout = structure.layout;
    const Aggregates& aggregates = structure.aggregates;
    for (long b = blocks.begin; b < blocks.end; ++b) {
        const int q = layout.size[b], stride = padded_size(q), aggregate = aggregates.of[b];
        const double* const block = inverse + layout.inverse_start[b];
        bool identity = true;
        for (int i = 0; i < q && identity; ++i)
            for (int j = 0; j < q; ++j) identity &= block[i * stride + j] == (i == j ? 1 : 0);
        c.place[b] =
            aggregate < 0 || identity ? static_cast<int>(c.length) : aggregates.padded_of[aggregates.first[aggregate]];
    }
}

bool make_coarse_matrix(CoarseSpace& c, const Parts& parts, TeamBarrier& barrier) {
    const Aggregates& aggregates = parts.structures[0]->aggregates;
    const int thread = omp_get_thread_num(), threads = omp_get_num_threads();
    const Range own = piece(aggregates.count, thread, threads);
    const Range rows = {aggregates.first[own.begin], aggregates.first[own.end]};
    for (long i = rows.begin * c.stride; i < rows.end * c.stride; ++i) c.matrix[i] = 0;
    for (int p = 0; p < parts.count; ++p) add_part(c, *parts.structures[p], parts.values[p], aggregates, own);
    barrier.wait();
    fold(c, rows);
    // Of an aggregate whose blocks are all fixed nothing is left.
    for (long i = rows.begin; i < rows.end; ++i)
        if (c.matrix[i * c.stride + i] == 0) c.matrix[i * c.stride + i] = 1;
    if (thread == 0)
        for (long i = 0; i < c.restricted_length; ++i) c.solution[i] = 0;
    barrier.wait();
    if (!invert_lower(c, barrier)) return false;
    for (long i = thread; i < c.unknowns; i += threads)
        for (long j = i + 1; j < c.unknowns; ++j) c.matrix[i * c.stride + j] = c.matrix[j * c.stride + i];
    barrier.wait();
    return true;
}

void solve_coarse(CoarseSpace& c, const Aggregates& aggregates, long pieces) {
    const long thread = omp_get_thread_num(), threads = omp_get_num_threads();
    double *const sum = &c.sum[thread * c.restricted_length], *const residual = &c.residual[thread * c.stride];
    for (long i = 0; i < c.length; i += 4) store(sum + i, load(&c.restricted[i]));
    for (long k = 1; k < kCopies * pieces; ++k) {
        const double* const copy = &c.restricted[k * c.restricted_length];
        for (long i = 0; i < c.length; i += 4) store(sum + i, load(sum + i) + load(copy + i));
    }
    for (long i = 0; i < c.unknowns; ++i) residual[i] = sum[aggregates.padded_of[i]];
    for (long i = c.unknowns; i < c.stride; ++i) residual[i] = 0;
    const Range share = piece(c.unknowns, thread, threads);
    for (long i = share.begin; i < share.end; i += kRows) {
        const double* rows[kRows];  // the last ones may be the same
        for (int k = 0; k < kRows; ++k) rows[k] = &c.matrix[(i + k < share.end ? i + k : share.end - 1) * c.stride];
        d8 sums[kRows] = {};
        for (long j = 0; j < c.stride; j += 8) {
            const d8 entries = load8(residual + j);
#pragma GCC unroll 4
            for (int k = 0; k < kRows; ++k) sums[k] += load8(rows[k] + j) * entries;
        }
        for (int k = 0; k < kRows && i + k < share.end; ++k) {
            const d8 sum = sums[k];
            c.solution[aggregates.padded_of[i + k]] =
                -(((sum[0] + sum[1]) + (sum[2] + sum[3])) + ((sum[4] + sum[5]) + (sum[6] + sum[7])));
        }
    }
}

double coarse_product(const CoarseSpace& c, const Aggregates& aggregates) {
    const double* const residual = &c.residual[omp_get_thread_num() * c.stride];
    double sum = 0;
    for (long i = 0; i < c.unknowns; ++i) sum += residual[i] * c.solution[aggregates.padded_of[i]];
    return sum;
}

}  // namespace yasps
