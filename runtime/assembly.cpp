// Runs generated kernels over all instances and adds up what was found.
//
// The instances are cut into pieces, one or more for each thread. The first piece is written straight to the
// destination, every other one to a private copy; the copies are then added in the order of the pieces. So nothing is
// atomic and the result is the same bit for bit whenever the pieces are. Private copies are all zero between calls. Of
// gradient and Hessian only the tiles that a piece touches are visited; which those are follows from index arrays and
// is found once for as long as these stay (yasps_mark_tiles).
#include <new>

#include "runtime.h"

namespace yasps {

// Private copies, kept between calls.
struct AssemblyWorkspace {
    Buffer<double> copies;              // [pieces - 1, whole tiles of gradient and parts]; zero between calls
    Buffer<unsigned char> touched;      // [pieces, tiles]
    Buffer<long> start;                 // [1 + parts + 1]: first tile of the gradient (0), of each part, and the end
    Buffer<long> first_bad, projected;  // [pieces, tasks]
};

namespace {

constexpr long kTileBits = 9;
constexpr long kTile = 1L << kTileBits;  // doubles
long tiles_of(long count) { return (count + kTile - 1) >> kTileBits; }

// Layouts shared with runtime/assembly.py.
struct Task {
    yasps_energy_kernel kernel;
    const void* const* args;
    long instances;
    long capacity;
    long mode;
    const int* kappa;
    const long* position;
    long part;                   // index of the matrix that receives the blocks, or -1: gradient only
    const unsigned char* marks;  // [pieces, tiles of the gradient, then of the part], or null when there is one piece
    long first_bad;              // out: first instance with derivatives that are not finite, or -1
    long projected;              // out: instances whose Hessian had to be projected
};
struct Part {
    double* values;
    long count;
    long largest_block;  // doubles in the largest block
};
// Instances in chunk c belong to piece c % pieces. Several chunks a piece share a region of expensive instances out
// among threads, one chunk a piece keeps what pieces have in common small.
struct Cut {
    long pieces, chunks;
};

void mark(unsigned char* marks, long begin, long end) {
    for (long tile = begin >> kTileBits; tile <= (end - 1) >> kTileBits; ++tile) marks[tile] = 1;
}

// Chunk c of `chunks`; borders are multiples of the number of lanes.
Range chunk_of(long instances, long c, long chunks) {
    const long packs = (instances + kYaspsLanes - 1) / kYaspsLanes;
    const Range range = piece(packs, c, chunks);
    const long end = range.end * kYaspsLanes;
    return {range.begin * kYaspsLanes, end < instances ? end : instances};
}

void mark_gradient(const Task& task, Range instances, const int* block_size_at, unsigned char* marks) {
    for (long k = instances.begin * task.capacity; k < instances.end * task.capacity; ++k) {
        const long offset = task.kappa[k] - 1;
        if (offset >= 0) mark(marks, offset, offset + block_size_at[offset]);
    }
}

void mark_blocks(const Task& task, const Part& part, Range instances, unsigned char* marks) {
    const long pairs = task.capacity * (task.capacity + 1) / 2;
    for (long k = instances.begin * pairs; k < instances.end * pairs; ++k) {
        if (task.position[k] < 0) continue;
        const long offset = task.position[k] >> 2;
        const long end = offset + part.largest_block < part.count ? offset + part.largest_block : part.count;
        mark(marks, offset, end);
    }
}

struct Destination {
    double* gradient;
    long scalars;
    const Part* parts;
    long part_count;
    const int* block_size_at;

    // The gradient comes first, then the parts.
    double* values(long which) const { return which == 0 ? gradient : parts[which - 1].values; }
    long count(long which) const { return which == 0 ? scalars : parts[which - 1].count; }
};

void run_task(const AssemblyWorkspace& w, const Task& task, const Destination& to, Cut cut, long piece_index,
              long* first_bad, long* projected) {
    const bool direct = piece_index == 0;
    const bool with_blocks = task.part >= 0;
    double* gradient = to.gradient;
    double* blocks = with_blocks ? to.parts[task.part].values : nullptr;
    if (!direct) {
        gradient = w.copies.data + (piece_index - 1) * (w.start[to.part_count + 1] << kTileBits);
        if (with_blocks) blocks = gradient + (w.start[task.part + 1] << kTileBits);
    }
    long counted = 0;  // on this thread's stack: kernels add to it often
    const yasps_sink sink = {gradient,
                             blocks,
                             task.kappa,
                             task.position,
                             to.block_size_at,
                             yasps_project,
                             static_cast<int>(task.mode),
                             &counted,
                             yasps_project_isotropic};
    for (long c = piece_index; c < cut.chunks && *first_bad < 0; c += cut.pieces) {
        const Range range = chunk_of(task.instances, c, cut.chunks);
        if (range.begin < range.end) *first_bad = task.kernel(task.args, range.begin, range.end, &sink);
    }
    *projected = counted;
}

// The tiles that a piece touches in any of its tasks.
void merge_marks(const AssemblyWorkspace& w, const Task* tasks, long task_count, const Destination& to,
                 long piece_index) {
    const long all = w.start[to.part_count + 1], gradient = w.start[1];
    unsigned char* const touched = w.touched.data + piece_index * all;
    memset(touched, 0, static_cast<size_t>(all));
    for (long k = 0; k < task_count; ++k) {
        if (tasks[k].marks == nullptr) continue;
        const long part = tasks[k].part;
        const long blocks = part >= 0 ? tiles_of(to.parts[part].count) : 0;
        const unsigned char* const marks = tasks[k].marks + piece_index * (gradient + blocks);
        for (long i = 0; i < gradient; ++i) touched[i] |= marks[i];
        if (part < 0) continue;
        unsigned char* const of_part = touched + w.start[part + 1];
        for (long i = 0; i < blocks; ++i) of_part[i] |= marks[gradient + i];
    }
}

// Calls what(values, count, tile) for this thread's share of all tiles; `count` doubles from `values` on.
template <class What>
void for_each_tile(const AssemblyWorkspace& w, const Destination& to, long thread, long threads, const What& what) {
    const Range own = piece(w.start[to.part_count + 1], thread, threads);
    long which = 0;
    for (long tile = own.begin; tile < own.end; ++tile) {
        while (tile >= w.start[which + 1]) ++which;
        const long offset = (tile - w.start[which]) << kTileBits;
        const long rest = to.count(which) - offset;
        what(to.values(which) + offset, rest < kTile ? rest : kTile, tile);
    }
}

// Empties what the first piece writes to and what nobody does.
void clear(const AssemblyWorkspace& w, const Destination& to, Cut cut, long thread, long threads) {
    const long all = w.start[to.part_count + 1];
    for_each_tile(w, to, thread, threads, [&](double* values, long count, long tile) {
        bool only_copies = false;
        for (long p = cut.pieces - 1; p > 0; --p) only_copies |= w.touched[p * all + tile] != 0;
        only_copies = only_copies && !w.touched[tile];
        if (!only_copies) memset(values, 0, static_cast<size_t>(count) * sizeof(double));
    });
}

// Moves a private tile to a destination that is empty (which need not hold zeros), or adds it.
template <bool kAdd>
void take(double* to, double* from, long count) {
    long i = 0;
    for (; i + 4 <= count; i += 4) {
        d4 v = load(from + i);
        if (kAdd) v += load_unaligned(to + i);
        *reinterpret_cast<d4_unaligned*>(to + i) = v;
        store(from + i, d4{});
    }
    for (; i < count; ++i) {
        to[i] = kAdd ? to[i] + from[i] : from[i];
        from[i] = 0;
    }
}

void add_copies(const AssemblyWorkspace& w, const Destination& to, Cut cut, long thread, long threads) {
    const long all = w.start[to.part_count + 1];
    for_each_tile(w, to, thread, threads, [&](double* values, long count, long tile) {
        bool empty = !w.touched[tile];
        for (long p = 1; p < cut.pieces; ++p) {
            if (!w.touched[p * all + tile]) continue;
            double* const from = w.copies.data + ((p - 1) * all + tile) * kTile;
            if (empty)
                take<false>(values, from, count);
            else
                take<true>(values, from, count);
            empty = false;
        }
    });
}

bool reserve(AssemblyWorkspace& w, const Destination& to, long tasks, long pieces) {
    if (!w.start.reserve(to.part_count + 2)) return false;
    w.start[0] = 0;
    for (long k = 0; k <= to.part_count; ++k) w.start[k + 1] = w.start[k] + tiles_of(to.count(k));
    const long all = w.start[to.part_count + 1];
    return w.copies.reserve_zero((pieces - 1) * all * kTile) && w.touched.reserve(pieces * all) &&
           w.first_bad.reserve(tasks * pieces) && w.projected.reserve(tasks * pieces);
}

// Adds x to the sum high + low, keeping in low what rounding takes away from high (Knuth's two-sum).
template <class V>
void add_exactly(V x, V& high, V& low) {
    const V sum = high + x;
    const V other = sum - high;
    low += (high - (sum - other)) + (x - other);
    high = sum;
}

}  // namespace
}  // namespace yasps

extern "C" {

yasps::AssemblyWorkspace* yasps_assembly_new() { return new (std::nothrow) yasps::AssemblyWorkspace; }
void yasps_assembly_free(yasps::AssemblyWorkspace* w) { delete w; }

// Finds the tiles of gradient and matrix that each piece of a task touches: marks is [pieces, tiles], see Task. They
// stay right as long as kappa, position, the size of the part and the cut do. part is null for the gradient alone.
void yasps_mark_tiles(const yasps::Task* task, const yasps::Part* part, long scalars, const int* block_size_at,
                      long pieces, long chunks, unsigned char* marks, int threads) {
    const long gradient_tiles = yasps::tiles_of(scalars);
    const long tiles = gradient_tiles + (part != nullptr ? yasps::tiles_of(part->count) : 0);
#pragma omp parallel for num_threads(threads) schedule(static)
    for (long p = 0; p < pieces; ++p) {
        unsigned char* const of_piece = marks + p * tiles;
        memset(of_piece, 0, static_cast<size_t>(tiles));
        for (long c = p; c < chunks; c += pieces) {
            const yasps::Range range = yasps::chunk_of(task->instances, c, chunks);
            yasps::mark_gradient(*task, range, block_size_at, of_piece);
            if (part != nullptr) yasps::mark_blocks(*task, *part, range, of_piece + gradient_tiles);
        }
    }
}

// Overwrites the gradient and the values of all parts with the sum over all instances of all tasks.
int yasps_assemble(yasps::AssemblyWorkspace* w, yasps::Task* tasks, long task_count, const yasps::Part* parts,
                   long part_count, double* gradient, long scalars, const int* block_size_at, long pieces, long chunks,
                   int threads) {
    const yasps::Destination to = {gradient, scalars, parts, part_count, block_size_at};
    const yasps::Cut cut = {pieces, chunks};
    if (!yasps::reserve(*w, to, task_count, pieces)) return yasps::kOutOfMemory;
    for (long k = 0; k < task_count * pieces; ++k) w->first_bad[k] = -1, w->projected[k] = 0;
#pragma omp parallel num_threads(threads)
    {
        const long thread = omp_get_thread_num(), team = omp_get_num_threads();
        for (long p = thread; p < pieces; p += team) yasps::merge_marks(*w, tasks, task_count, to, p);
#pragma omp barrier
        yasps::clear(*w, to, cut, thread, team);
#pragma omp barrier
        for (long p = thread; p < pieces; p += team)
            for (long k = 0; k < task_count; ++k)
                yasps::run_task(*w, tasks[k], to, cut, p, &w->first_bad[p * task_count + k],
                                &w->projected[p * task_count + k]);
#pragma omp barrier
        yasps::add_copies(*w, to, cut, thread, team);
    }
    for (long k = 0; k < task_count; ++k) {
        tasks[k].first_bad = -1;
        tasks[k].projected = 0;
        for (long p = 0; p < pieces; ++p) {
            const long bad = w->first_bad[p * task_count + k];
            if (bad >= 0 && (tasks[k].first_bad < 0 || bad < tasks[k].first_bad)) tasks[k].first_bad = bad;
            tasks[k].projected += w->projected[p * task_count + k];
        }
    }
    return yasps::kOk;
}

// Runs a kernel that computes one value per instance; `out` is passed on as it is.
void yasps_evaluate(yasps_value_kernel kernel, const void* const* args, long instances, double* out, int threads) {
#pragma omp parallel num_threads(threads)
    {
        const yasps::Range range = yasps::chunk_of(instances, omp_get_thread_num(), omp_get_num_threads());
        if (range.begin < range.end) kernel(args, range.begin, range.end, out);
    }
}

// Compensated sum in a fixed order. An infinite or NaN sum is what plain addition would give.
double yasps_sum(const double* values, long count) {
    yasps::d8 high = {}, low = {};
    long i = 0;
    for (; i + 8 <= count; i += 8) {
        yasps::d8 x;
        memcpy(&x, values + i, sizeof(x));
        yasps::add_exactly(x, high, low);
    }
    double sum = 0, lost = 0;
    for (; i < count; ++i) yasps::add_exactly(values[i], sum, lost);
    for (int lane = 0; lane < 8; ++lane) {
        yasps::add_exactly(static_cast<double>(high[lane]), sum, lost);
        lost += low[lane];
    }
    return fabs(sum) < INFINITY ? sum + lost : sum;
}
}
