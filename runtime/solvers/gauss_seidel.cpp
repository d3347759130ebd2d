// The lists of products of the symmetric Gauss-Seidel preconditioner, their numbers and the sweeps.
#include "solvers/gauss_seidel.h"

#include <algorithm>
#include <type_traits>

#include "core/runtime.h"

namespace yasps {
namespace {

typedef float f4 __attribute__((vector_size(16)));
typedef float f4_unaligned __attribute__((vector_size(16), aligned(4), may_alias));

// One of so many rows of a second piece may come late because of contacts.
constexpr long kFewestPerLate = 8;
// What `Product` and `Uses` can number.
constexpr long kMostProducts = 2147483647;

bool is_three(const Group& group) { return group.rows == 3 && group.cols == 3; }

// Of a third part, which nobody has, all blocks are products of other shapes.
bool is_swept(const Group& group, int part) { return is_three(group) && part < 2; }

// Cuts a list of `counts` into ranges from `first` on, and makes the counts where each begins. Returns the end.
long begin_lists(const long* counts, long pieces, long first, Range* lists, long* next) {
    for (long k = 0; k < pieces; ++k) {
        lists[k] = {first, first + counts[k]};
        next[k] = first;
        first += counts[k];
    }
    return first;
}

// Visits the blocks of a part off the diagonal, (shape, number in the part, row, column).
template <class Visit>
void for_each_coupling(const Structure& s, Visit visit) {
    for (int g = 0; g < s.group_count; ++g) {
        const Group& group = s.groups[g];
        for (long b = group.first_block; b < group.first_block + group.count; ++b)
            if (s.row[b] != s.col[b]) visit(group, b, s.row[b], s.col[b]);
    }
}

// Four numbers of a block from here on; the last may be another block's.
inline d4 load_numbers(const float* p) {
    return __builtin_convertvector(*reinterpret_cast<const f4_unaligned*>(p), d4);
}

inline void store_three(float* p, d4 v) {
    const f4 numbers = __builtin_convertvector(v, f4);
    memcpy(p, &numbers, 3 * sizeof(float));
}

// v += sign B x for all products of a list.
template <int kSign>
void multiply_list(const GaussSeidel& s, Range list, const double* x, double* v) {
    const Product* const products = s.products.data;
    const float* block = s.blocks.data + 9 * list.begin;
    for (long k = list.begin; k < list.end; ++k, block += 9) {
        const double* const from = x + products[k].from;
        double* const to = v + products[k].to;
        const d4 first = load_numbers(block) * from[0];
        const d4 others = load_numbers(block + 3) * from[1] + load_numbers(block + 6) * from[2];
        store(to, kSign > 0 ? load(to) + (first + others) : load(to) - (first + others));
    }
}

// v -= B v for the products of both parts, those from one row after those to it.
void solve_in_turn(const GaussSeidel& s, Range fixed, Range moving, Range stops, double* v) {
    for (long k = stops.begin; k < stops.end; ++k) {
        const Stop stop = s.stops[k];
        multiply_list<-1>(s, {fixed.begin, stop.fixed}, v, v);
        multiply_list<-1>(s, {moving.begin, stop.moving}, v, v);
        fixed.begin = stop.fixed;
        moving.begin = stop.moving;
    }
    multiply_list<-1>(s, fixed, v, v);
}

void multiply_others(const GaussSeidel& s, Range list, const double* x, double* v) {
    for (long k = list.begin; k < list.end; ++k) {
        const OtherProduct& product = s.other_products[k];
        const float* row = s.others.data + product.block;
        const double* const from = x + product.from;
        for (int i = 0; i < product.rows; ++i, row += product.cols) {
            double sum = 0;
            for (int j = 0; j < product.cols; ++j) sum += row[j] * from[j];
            v[product.to + i] += sum;
        }
    }
}

// Visits the dof blocks of a piece in the order of L, and backwards: a first piece downwards; a second one upwards,
// first the rows that are not late.
template <class Visit>
void in_order(const GaussSeidel& s, const Piece& piece, long k, Visit visit) {
    const Range blocks = piece.blocks;
    if (k % 2 == 0) {
        for (long b = blocks.begin; b < blocks.end; ++b) visit(b);
        return;
    }
    for (const char late : {0, 1})
        for (long b = blocks.end - 1; b >= blocks.begin; --b)
            if (s.late[b] == late) visit(b);
}

template <class Visit>
void against_order(const GaussSeidel& s, const Piece& piece, long k, Visit visit) {
    const Range blocks = piece.blocks;
    if (k % 2 == 0) {
        for (long b = blocks.end - 1; b >= blocks.begin; --b) visit(b);
        return;
    }
    for (const char late : {1, 0})
        for (long b = blocks.begin; b < blocks.end; ++b)
            if (s.late[b] == late) visit(b);
}

// How a coupling above the diagonal takes part: with its row before its column in the order of L, or behind it; from
// the first piece of a pair to the second; or not at all.
enum Kind { kForwards, kBackwards, kCross, kBetween };

Kind kind_of(const GaussSeidel& s, int row, int col) {
    const int first = s.piece_of[row], second = s.piece_of[col];
    if (first != second) return first % 2 == 0 && second == first + 1 && s.late[col] ? kCross : kBetween;
    return first % 2 == 0 || s.late[row] < s.late[col] ? kForwards : kBackwards;
}

// Lists what a part's 3x3 blocks are for, from product `first` on; `uses` are those of its blocks. Returns the end.
long list_part(GaussSeidel& s, Lists& lists, Uses* uses, const Structure& structure, const Layout& layout,
               const Piece* pieces, long piece_count, long first) {
    int *const down = lists.down_end.data, *const up = lists.up_end.data;
    long* const between = s.next.data;               // [pieces]
    long* const cross_down = between + piece_count;  // [pieces]
    long* const cross_up = cross_down + piece_count;
    std::fill_n(s.next.data, 3 * piece_count, 0L);
    std::fill_n(down, layout.blocks, 0);
    std::fill_n(up, layout.blocks, 0);
    for_each_coupling(structure, [&](const Group& group, long, int row, int col) {
        if (!is_three(group)) return;
        const int of_row = s.piece_of[row], of_col = s.piece_of[col];
        switch (kind_of(s, row, col)) {
            case kForwards:
                ++down[row];
                ++up[col];
                break;
            case kBackwards:
                ++down[col];
                ++up[row];
                break;
            case kCross:
                ++cross_down[of_col];
                ++cross_up[of_row];
                break;
            case kBetween:
                ++between[of_row];
                ++between[of_col];
        }
    });
    const auto begin = [&](auto& count) {
        const long n = count;
        count = static_cast<std::decay_t<decltype(count)>>(first);
        first += n;
        return first;
    };
    for (long k = 0; k < piece_count; ++k) {
        Sweep &below = lists.down[k], &above = lists.up[k];
        const bool is_second = k % 2 != 0;
        // Down: what comes from rows that are not late; then, after the barrier, from the first piece; then the rest.
        below.early = {first, first};
        long turn = first;
        in_order(s, pieces[k], k, [&](long b) {
            begin(down[b]);
            if (!is_second || !s.late[b]) turn = first;
        });
        below.early.end = turn;
        below.late = {turn, first};
        below.cross = {first, begin(cross_down[k])};
        // Up: late rows of the second piece go first, and the first piece waits for them.
        above.early = {first, first};
        turn = first;
        against_order(s, pieces[k], k, [&](long b) {
            begin(up[b]);
            if (is_second && s.late[b]) turn = first;
        });
        above.early.end = turn;
        above.late = {turn, first};
        above.cross = {first, begin(cross_up[k])};
        lists.between[k] = {first, begin(between[k])};
    }
    for_each_coupling(structure, [&](const Group& group, long block, int row, int col) {
        if (!is_three(group)) return;
        const int i = layout.padded_start[row], j = layout.padded_start[col];
        const int of_row = s.piece_of[row], of_col = s.piece_of[col];
        long straight = 0, turned = 0;  // from row to col, and back
        switch (kind_of(s, row, col)) {
            case kForwards:
                straight = down[row]++;
                turned = up[col]++;
                break;
            case kBackwards:
                straight = up[row]++;
                turned = down[col]++;
                break;
            case kCross:
                straight = cross_down[of_col]++;
                turned = cross_up[of_row]++;
                break;
            case kBetween:
                straight = between[of_col]++;
                turned = between[of_row]++;
        }
        s.products[straight] = {i, j};
        s.products[turned] = {j, i};
        uses[block] = {static_cast<int>(straight), static_cast<int>(turned)};
    });
    return first;
}

// Where the sweeps change from one part's lists to the other's.
void list_stops(GaussSeidel& s, const Piece* pieces, long piece_count) {
    long count = 0;
    for (long k = 0; k < piece_count; ++k) {
        long taken;
        const auto visit = [&](long b, const Buffer<int>& fixed, const Buffer<int>& moving) {
            if (moving[b] == taken) return;
            s.stops[count++] = {fixed[b], moving[b]};
            taken = moving[b];
        };
        const auto list = [&](Stops& stops, const Sweep& moving, auto each) {
            taken = moving.early.begin;
            stops.early = {count, count};
            each();
            stops.late.end = count;
            while (stops.early.end < count && s.stops[stops.early.end].moving <= moving.early.end) ++stops.early.end;
            stops.late.begin = stops.early.end;
        };
        list(s.down_stops[k], s.moving.down[k],
             [&] { in_order(s, pieces[k], k, [&](long b) { visit(b, s.fixed.down_end, s.moving.down_end); }); });
        list(s.up_stops[k], s.moving.up[k],
             [&] { against_order(s, pieces[k], k, [&](long b) { visit(b, s.fixed.up_end, s.moving.up_end); }); });
    }
}

// Finds which rows of second pieces come last: those that are coupled with the first piece. Where contacts make more
// than a share of the rows late, they are left out: late rows are for one thread. Returns whether that is as before.
bool find_late_rows(GaussSeidel& s, const Structure& fixed, const Structure& moving, const Piece* pieces,
                    long piece_count) {
    const long blocks = fixed.layout.blocks;
    char* const late = s.next_late.data;
    std::fill_n(late, blocks, 0);
    long* const counts = s.next.data;  // [pieces]
    std::fill_n(counts, piece_count, 0L);
    const auto shared = [&](const Group& group, int row, int col) {
        const int first = s.piece_of[row];
        return is_three(group) && first % 2 == 0 && s.piece_of[col] == first + 1;
    };
    constexpr char kByContact = 2;
    for_each_coupling(fixed, [&](const Group& group, long, int row, int col) {
        if (shared(group, row, col)) late[col] = 1;
    });
    for_each_coupling(moving, [&](const Group& group, long, int row, int col) {
        if (!shared(group, row, col) || late[col]) return;
        late[col] = kByContact;
        ++counts[s.piece_of[col]];
    });
    for (long k = 1; k < piece_count; k += 2) {
        const Range rows = pieces[k].blocks;
        const bool few = counts[k] * kFewestPerLate <= rows.end - rows.begin;
        for (long b = rows.begin; b < rows.end; ++b) late[b] = late[b] == kByContact ? few : late[b];
    }
    if (memcmp(late, s.late.data, static_cast<size_t>(blocks)) == 0) return true;
    s.late.swap(s.next_late);
    return false;
}

// The products of other shapes.
void list_others(GaussSeidel& s, const System& system, long piece_count) {
    const Layout& layout = system.layout();
    long* const counts = s.next.data;         // [pieces]
    long* const next = counts + piece_count;  // [pieces]
    std::fill_n(counts, piece_count, 0L);
    for (int p = 0; p < system.parts; ++p)
        for_each_coupling(*system.structures[p], [&](const Group& group, long, int row, int col) {
            if (is_swept(group, p)) return;
            ++counts[s.piece_of[row]];
            ++counts[s.piece_of[col]];
        });
    begin_lists(counts, piece_count, 0, s.other.data, next);
    long offset = 0;
    Uses* uses = s.uses.data;
    for (int p = 0; p < system.parts; ++p) {
        for_each_coupling(*system.structures[p], [&](const Group& group, long block, int row, int col) {
            if (is_swept(group, p)) return;
            const int i = layout.padded_start[row], j = layout.padded_start[col];
            const int straight = static_cast<int>(next[s.piece_of[col]]++);
            const int turned = static_cast<int>(next[s.piece_of[row]]++);
            const long size = static_cast<long>(group.rows) * group.cols;
            s.other_products[straight] = {i, j, group.cols, group.rows, offset};
            s.other_products[turned] = {j, i, group.rows, group.cols, offset + size};
            uses[block] = {straight, turned};
            offset += 2 * size;
        });
        uses += system.structures[p]->blocks;
    }
}

// C^-T of a diagonal block; inlined into one function for 3x3, in which loops over q are unrolled.
YASPS_ALWAYS_INLINE Reason factor_block(int q, const System& system, long block, double* out, double* scratch) {
    const Reason status = invert_factor_of_sum(q, system.parts, system.structures, system.values, block, scratch);
    if (status != kConverged) return status;
    const int stride = padded_size(q);
#pragma GCC unroll 3
    for (int i = 0; i < q; ++i) {
#pragma GCC unroll 4
        for (int j = 0; j < stride; ++j) out[i * stride + j] = j < q && j >= i ? scratch[j * q + i] : 0;
    }
    return kConverged;
}

// out = C^-1 h C'^-T for a 3x3 block, its rows.
void scale_three(const double* h, const double* wi, const double* wj, d4 (&out)[3]) {
    const d4 h0 = load_unaligned(h), h1 = load_unaligned(h + 3), h2 = load_unaligned(h + 6);
    const d4 a[3] = {wi[0] * h0, wi[1] * h0 + wi[5] * h1, wi[2] * h0 + wi[6] * h1 + wi[10] * h2};
    const d4 w0 = load(wj), w1 = load(wj + 4), w2 = load(wj + 8);
    for (int i = 0; i < 3; ++i) out[i] = a[i][0] * w0 + a[i][1] * w1 + a[i][2] * w2;
}

// The same for any shape; and its transpose.
void scale_any(const double* h, int r, int c, const double* wi, const double* wj, float* turned, float* straight) {
    const int rs = padded_size(r), cs = padded_size(c);
    for (int i = 0; i < r; ++i)
        for (int j = 0; j < c; ++j) {
            double sum = 0;
            for (int m = 0; m <= i; ++m) {
                double along = 0;
                for (int n = 0; n <= j; ++n) along += h[m * c + n] * wj[n * cs + j];
                sum += wi[m * rs + i] * along;
            }
            turned[i * c + j] = straight[j * r + i] = static_cast<float>(sum);
        }
}

}  // namespace

bool can_sweep(const Structure& structure) {
    const Layout& layout = structure.layout;
    long couplings = 0;
    for (int g = 0; g < structure.group_count; ++g)
        if (is_three(structure.groups[g])) couplings += structure.groups[g].count;
    for (long b = 0; b < layout.blocks; ++b) couplings -= layout.size[b] == 3 && structure.diagonal[b] >= 0;
    return 2 * couplings >= layout.blocks;
}

bool list_products(GaussSeidel& s, const System& system, const Piece* pieces, long piece_count) {
    const Layout& layout = system.layout();
    const Structure& fixed = *system.structures[0];
    long threes = 0, others = 0, other_values = 0, blocks = 0;
    for (int p = 0; p < system.parts; ++p) {
        const Structure& structure = *system.structures[p];
        for (int g = 0; g < structure.group_count; ++g) {
            const Group& group = structure.groups[g];
            (is_swept(group, p) ? threes : others) += group.count;
            if (!is_swept(group, p)) other_values += group.count * group.rows * group.cols;
        }
        blocks += structure.blocks;
    }
    if (2 * std::max(threes, others) > kMostProducts) return false;
    const Product* const before = s.products.data;
    const Uses* const uses_before = s.uses.data;
    const auto reserve = [&](Lists& lists) {
        return lists.down.reserve(piece_count) && lists.up.reserve(piece_count) && lists.between.reserve(piece_count) &&
               lists.down_end.reserve(layout.blocks) && lists.up_end.reserve(layout.blocks);
    };
    const bool room =
        s.factors.reserve(layout.inverse_start[layout.blocks]) && s.piece_of.reserve(layout.blocks) &&
        s.products.reserve(2 * threes) && s.blocks.reserve(18 * threes + 8) && s.other_products.reserve(2 * others) &&
        s.others.reserve(2 * other_values) && s.uses.reserve(blocks) && reserve(s.fixed) && reserve(s.moving) &&
        s.stops.reserve(2 * layout.blocks) && s.down_stops.reserve(piece_count) && s.up_stops.reserve(piece_count) &&
        s.other.reserve(piece_count) && s.late.reserve(layout.blocks) && s.next_late.reserve(layout.blocks) &&
        s.next.reserve(3 * piece_count);
    if (!room) return false;
    static const Structure none;
    const Structure& moving = system.parts > 1 ? *system.structures[1] : none;
    const bool known = s.build == fixed.build && s.piece_count == piece_count && before == s.products.data &&
                       uses_before == s.uses.data;
    if (!known) {
        std::fill_n(s.late.data, layout.blocks, 0);
        for (long k = 0; k < piece_count; ++k)
            std::fill(s.piece_of.data + pieces[k].blocks.begin, s.piece_of.data + pieces[k].blocks.end,
                      static_cast<int>(k));
    }
    if (!find_late_rows(s, fixed, moving, pieces, piece_count) || !known) {
        s.fixed_end = list_part(s, s.fixed, s.uses.data, fixed, layout, pieces, piece_count, 0);
        s.build = fixed.build;
        s.piece_count = piece_count;
    }
    list_part(s, s.moving, s.uses.data + fixed.blocks, moving, layout, pieces, piece_count, s.fixed_end);
    list_stops(s, pieces, piece_count);
    list_others(s, system, piece_count);
    return true;
}

void factor_diagonal(GaussSeidel& s, const System& system, Piece& piece, double* scratch) {
    const Layout& layout = system.layout();
    for (long b = piece.blocks.begin; b < piece.blocks.end; ++b) {
        const int q = layout.size[b];
        double* const out = s.factors.data + layout.inverse_start[b];
        double small[9];
        const Reason status =
            q == 3 ? factor_block(3, system, b, out, small) : factor_block(q, system, b, out, scratch);
        if (status == kConverged) continue;
        piece.bad_block = b;
        piece.bad_status = status;
        return;
    }
}

void scale_blocks(GaussSeidel& s, const System& system) {
    const Layout& layout = system.layout();
    const Uses* uses = s.uses.data;
    for (int p = 0; p < system.parts; ++p) {
        const Structure& structure = *system.structures[p];
        for (int g = 0; g < structure.group_count; ++g) {
            const Group& group = structure.groups[g];
            const int r = group.rows, c = group.cols;
            const Range share = piece(group.count, omp_get_thread_num(), omp_get_num_threads());
            for (long e = share.begin; e < share.end; ++e) {
                const long b = group.first_block + e;
                const int row = structure.row[b], col = structure.col[b];
                if (row == col) continue;
                const double* const h = system.values[p] + group.first_value + e * r * c;
                const double* const wi = s.factors.data + layout.inverse_start[row];
                const double* const wj = s.factors.data + layout.inverse_start[col];
                if (!is_swept(group, p)) {
                    scale_any(h, r, c, wi, wj, s.others.data + s.other_products[uses[b].turned].block,
                              s.others.data + s.other_products[uses[b].straight].block);
                    continue;
                }
                d4 rows[3];
                scale_three(h, wi, wj, rows);
                // `straight` is y[col] += transpose(h) x[row], whose columns are the rows of h.
                float* const straight = s.blocks.data + 9L * uses[b].straight;
                for (int i = 0; i < 3; ++i) store_three(straight + 3 * i, rows[i]);
                float* const turned = s.blocks.data + 9L * uses[b].turned;
                for (int i = 0; i < 3; ++i) store_three(turned + 3 * i, d4{rows[0][i], rows[1][i], rows[2][i], 0});
            }
        }
        uses += structure.blocks;
    }
}

void apply_inverse_factor(const GaussSeidel& s, const Layout& layout, const Piece& piece, double* v) {
    for (long b = piece.blocks.begin; b < piece.blocks.end; ++b) {
        const int q = layout.size[b], stride = padded_size(q);
        const double* const w = s.factors.data + layout.inverse_start[b];
        double* const x = v + layout.padded_start[b];
        for (int i = q - 1; i >= 0; --i) {
            double sum = 0;
            for (int k = 0; k <= i; ++k) sum += w[k * stride + i] * x[k];
            x[i] = sum;
        }
    }
}

void apply_inverse_factor_transposed(const GaussSeidel& s, const Layout& layout, const Piece& piece, double* v) {
    for (long b = piece.blocks.begin; b < piece.blocks.end; ++b) {
        const int q = layout.size[b], stride = padded_size(q);
        const double* const w = s.factors.data + layout.inverse_start[b];
        double* const x = v + layout.padded_start[b];
        for (int i = 0; i < q; ++i) {
            double sum = 0;
            for (int k = i; k < q; ++k) sum += w[i * stride + k] * x[k];
            x[i] = sum;
        }
    }
}

void solve_upper_early(const GaussSeidel& s, long k, double* v) {
    solve_in_turn(s, s.fixed.up[k].early, s.moving.up[k].early, s.up_stops[k].early, v);
}

void solve_upper_late(const GaussSeidel& s, long k, double* v) {
    multiply_list<-1>(s, s.fixed.up[k].cross, v, v);
    multiply_list<-1>(s, s.moving.up[k].cross, v, v);
    solve_in_turn(s, s.fixed.up[k].late, s.moving.up[k].late, s.up_stops[k].late, v);
}

void solve_lower_early(const GaussSeidel& s, long k, double* v) {
    solve_in_turn(s, s.fixed.down[k].early, s.moving.down[k].early, s.down_stops[k].early, v);
}
void solve_lower_late(const GaussSeidel& s, long k, const double* other, double* v) {
    multiply_list<-1>(s, s.fixed.down[k].cross, other, v);
    multiply_list<-1>(s, s.moving.down[k].cross, other, v);
    solve_in_turn(s, s.fixed.down[k].late, s.moving.down[k].late, s.down_stops[k].late, v);
}

void add_between(const GaussSeidel& s, long k, const double* t, double* v) {
    multiply_list<1>(s, s.fixed.between[k], t, v);
    multiply_list<1>(s, s.moving.between[k], t, v);
    multiply_others(s, s.other[k], t, v);
}

void add_lower(const GaussSeidel& s, long k, const double* x, double* v) {
    for (const Lists* lists : {&s.fixed, &s.moving}) {
        const Sweep& down = lists->down[k];
        multiply_list<1>(s, {down.early.begin, down.late.end}, x, v);
        multiply_list<1>(s, down.cross, x, v);
    }
}

}  // namespace yasps
