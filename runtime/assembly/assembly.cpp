// Runs generated kernels over all instances and adds up what was found.
//
// The instances are cut into pieces, one or more for each thread, and nothing is atomic: where pieces meet, all but one
// write to private memory, which is then added in the order of the pieces. So the result is the same bit for bit
// whenever the pieces are. Gradient and matrix are cut into tiles of some kilobytes; which of them a piece touches
// follows from index arrays and is found once for as long as these stay (yasps_mark_tiles).
//
// A tile of the matrix belongs to the first piece that touches it, which writes straight to the matrix; other pieces
// that touch it, few where instances are in the order of their unknowns, get private tiles. Kernels ask for a tile
// when they first need it, and only then is it emptied: so it is in the cache when they add to it, and memory is
// written once and in order. Of the gradient, which is small, all pieces but the first have private copies.
#include <new>

#include "core/runtime.h"

namespace yasps {

// Private memory, kept between calls.
struct AssemblyWorkspace {
    Buffer<double> copies;              // [pieces - 1, whole tiles of the gradient]; zero between calls
    Buffer<double> private_tiles;       // for pieces one after another, as many as they may ask for
    Buffer<double*> tiles;              // [pieces, tiles of all parts]: where a piece writes, null: it has not yet
    Buffer<unsigned char> touched;      // [pieces, tiles of gradient and parts]
    Buffer<long> owner;                 // [tiles of all parts]: the first piece that touches it
    Buffer<long> start;                 // [1 + parts + 1]: first tile of the gradient (0), of each part, and the end
    Buffer<long> first_private;         // [pieces + 1]
    Buffer<long> first_bad, projected;  // [pieces, tasks]
    long private_size = 0;              // doubles of a private tile: blocks that start there may end in the next

    long gradient_tiles() const { return start[1]; }
};

namespace {

constexpr long kTile = 1L << kYaspsTileBits;  // doubles
long tiles_of(long count) { return (count + kTile - 1) >> kYaspsTileBits; }

// Layouts shared with runtime/assembly/assembler.py.
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
    const Structure* structure;
};
// Instances in chunk c belong to piece c % pieces. Several chunks a piece share a region of expensive instances out
// among threads, one chunk a piece keeps what pieces have in common small.
struct Cut {
    long pieces, chunks;
};

void mark_gradient(const Task& task, Range instances, const int* block_size_at, unsigned char* marks) {
    for (long k = instances.begin * task.capacity; k < instances.end * task.capacity; ++k) {
        const long offset = task.kappa[k] - 1;
        if (offset < 0) continue;
        const long last = (offset + block_size_at[offset] - 1) >> kYaspsTileBits;
        for (long tile = offset >> kYaspsTileBits; tile <= last; ++tile) marks[tile] = 1;
    }
}

void mark_blocks(const Task& task, Range instances, unsigned char* marks) {
    const long pairs = task.capacity * (task.capacity + 1) / 2;
    for (long k = instances.begin * pairs; k < instances.end * pairs; ++k)
        if (task.position[k] >= 0) marks[task.position[k] >> (kYaspsTileBits + kYaspsFlagBits)] = 1;
}

// Offset of the first block that starts at `offset` or later.
long first_block_from(const Structure& s, long offset) {
    for (int g = 0; g < s.group_count; ++g) {
        const Group& group = s.groups[g];
        const long size = static_cast<long>(group.rows) * group.cols, inside = offset - group.first_value;
        if (inside <= 0) return group.first_value;
        const long block = (inside + size - 1) / size;
        if (block < group.count) return group.first_value + block * size;
    }
    return s.values;
}

// What the blocks that start in a tile fill, counted from the tile's first double.
Range blocks_of_tile(const Structure& s, long tile) {
    const long offset = tile << kYaspsTileBits;
    return {first_block_from(s, offset) - offset, first_block_from(s, offset + kTile) - offset};
}

void empty(double* values, Range range) {
    memset(values + range.begin, 0, static_cast<size_t>(range.end - range.begin) * sizeof(double));
}

struct Destination {
    double* gradient;
    long scalars;
    const Part* parts;
    long part_count;
    const int* block_size_at;
};

// What a kernel writes to, and what opening a tile needs to know.
struct PieceSink : yasps_sink {
    const Part* part;
    const long* owner;  // of the part's tiles
    long piece;
    double** next_private;  // memory of the piece's next private tile
    long private_size;
};

double* open_tile(const yasps_sink* sink, long tile) {
    const PieceSink& own = *static_cast<const PieceSink*>(sink);
    double* values = own.part->values + (tile << kYaspsTileBits);
    if (own.owner[tile] != own.piece) {
        values = *own.next_private;
        *own.next_private += own.private_size;
    }
    empty(values, blocks_of_tile(*own.part->structure, tile));
    return own.tiles[tile] = values;
}

void run_task(const AssemblyWorkspace& w, const Task& task, const Destination& to, Cut cut, long piece_index,
              double** next_private, long* first_bad, long* projected) {
    const long gradient_tiles = w.gradient_tiles(), part_tiles = w.start[to.part_count + 1] - gradient_tiles;
    long counted = 0;  // on this thread's stack: kernels add to it often
    PieceSink sink = {};
    sink.gradient = to.gradient;
    if (piece_index > 0) sink.gradient = w.copies.data + (piece_index - 1) * gradient_tiles * kTile;
    sink.kappa = task.kappa;
    sink.position = task.position;
    sink.block_size_at = to.block_size_at;
    sink.project = yasps_project;
    sink.mode = static_cast<int>(task.mode);
    sink.projected = &counted;
    sink.project_isotropic = yasps_project_isotropic;
    sink.project_two_vectors = yasps_project_two_vectors;
    if (task.part >= 0) {
        const long first = w.start[task.part + 1] - gradient_tiles;
        sink.tiles = w.tiles.data + piece_index * part_tiles + first;
        sink.open_tile = open_tile;
        sink.part = to.parts + task.part;
        sink.owner = w.owner.data + first;
        sink.piece = piece_index;
        sink.next_private = next_private;
        sink.private_size = w.private_size;
    }
    for (long c = piece_index; c < cut.chunks && *first_bad == -1; c += cut.pieces) {
        const Range range = chunk_of(task.instances, c, cut.chunks);
        if (range.begin < range.end) *first_bad = task.kernel(task.args, range.begin, range.end, &sink);
    }
    *projected = counted;
}

// The tiles that a piece touches in any of its tasks.
void merge_marks(const AssemblyWorkspace& w, const Task* tasks, long task_count, const Destination& to,
                 long piece_index) {
    const long all = w.start[to.part_count + 1], gradient = w.gradient_tiles();
    unsigned char* const touched = w.touched.data + piece_index * all;
    memset(touched, 0, static_cast<size_t>(all));
    for (long k = 0; k < task_count; ++k) {
        if (tasks[k].marks == nullptr) continue;
        const long part = tasks[k].part;
        const long blocks = part >= 0 ? w.start[part + 2] - w.start[part + 1] : 0;
        const unsigned char* const marks = tasks[k].marks + piece_index * (gradient + blocks);
        for (long i = 0; i < gradient; ++i) touched[i] |= marks[i];
        if (part < 0) continue;
        unsigned char* const of_part = touched + w.start[part + 1];
        for (long i = 0; i < blocks; ++i) of_part[i] |= marks[gradient + i];
    }
}

// Who owns each tile of the parts, and how many private tiles each piece may need.
void find_owners(const AssemblyWorkspace& w, const Destination& to, long pieces) {
    const long all = w.start[to.part_count + 1], gradient = w.gradient_tiles();
    for (long tile = 0; tile < all - gradient; ++tile) w.owner.data[tile] = -1;
    for (long p = 0, needed = 0; p < pieces; ++p) {
        const unsigned char* const touched = w.touched.data + p * all + gradient;
        w.first_private.data[p] = needed;
        for (long tile = 0; tile < all - gradient; ++tile) {
            if (!touched[tile] && pieces > 1) continue;
            if (w.owner.data[tile] < 0)
                w.owner.data[tile] = p;
            else
                ++needed;
        }
        w.first_private.data[p + 1] = needed;
    }
}

// Calls what(values, count, tile) for this thread's share of the gradient's tiles; `count` doubles from `values` on.
template <class What>
void for_each_gradient_tile(const AssemblyWorkspace& w, const Destination& to, long thread, long threads,
                            const What& what) {
    const Range own = piece(w.gradient_tiles(), thread, threads);
    for (long tile = own.begin; tile < own.end; ++tile) {
        const long offset = tile << kYaspsTileBits, rest = to.scalars - offset;
        what(to.gradient + offset, rest < kTile ? rest : kTile, tile);
    }
}

// Empties what the first piece writes to and what nobody does.
void clear_gradient(const AssemblyWorkspace& w, const Destination& to, Cut cut, long thread, long threads) {
    const long all = w.start[to.part_count + 1];
    for_each_gradient_tile(w, to, thread, threads, [&](double* values, long count, long tile) {
        bool only_copies = false;
        for (long p = cut.pieces - 1; p > 0; --p) only_copies |= w.touched[p * all + tile] != 0;
        only_copies = only_copies && !w.touched[tile];
        if (!only_copies) empty(values, {0, count});
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

void add_gradients(const AssemblyWorkspace& w, const Destination& to, Cut cut, long thread, long threads) {
    const long all = w.start[to.part_count + 1];
    for_each_gradient_tile(w, to, thread, threads, [&](double* values, long count, long tile) {
        bool is_empty = !w.touched[tile];
        for (long p = 1; p < cut.pieces; ++p) {
            if (!w.touched[p * all + tile]) continue;
            double* const from = w.copies.data + ((p - 1) * w.gradient_tiles() + tile) * kTile;
            if (is_empty)
                take<false>(values, from, count);
            else
                take<true>(values, from, count);
            is_empty = false;
        }
    });
}

void add(double* to, const double* from, Range range) {
    long i = range.begin;
    for (; i + 4 <= range.end; i += 4)
        *reinterpret_cast<d4_unaligned*>(to + i) = load_unaligned(to + i) + load_unaligned(from + i);
    for (; i < range.end; ++i) to[i] += from[i];
}

// Adds private tiles of the matrices to this thread's share of all tiles; empties tiles that nobody asked for.
void add_tiles(const AssemblyWorkspace& w, const Destination& to, Cut cut, long thread, long threads) {
    const long gradient = w.gradient_tiles(), count = w.start[to.part_count + 1] - gradient;
    const Range own = piece(count, thread, threads);
    long part = 0;
    for (long tile = own.begin; tile < own.end; ++tile) {
        while (tile >= w.start[part + 2] - gradient) ++part;
        const long in_part = tile - (w.start[part + 1] - gradient);
        double* const values = to.parts[part].values + (in_part << kYaspsTileBits);
        bool is_empty = true;
        for (long p = 0; p < cut.pieces; ++p) is_empty = is_empty && w.tiles[p * count + tile] != values;
        if (!is_empty && cut.pieces == 1) continue;
        const Range range = blocks_of_tile(*to.parts[part].structure, in_part);
        if (is_empty) empty(values, range);
        for (long p = 0; p < cut.pieces; ++p) {
            const double* const from = w.tiles[p * count + tile];
            if (from == nullptr || from == values) continue;
            add(values, from, range);
        }
    }
}

// Memory for one call. False: out of memory.
bool reserve(AssemblyWorkspace& w, const Task* tasks, long task_count, const Destination& to, long pieces) {
    if (!w.start.reserve(to.part_count + 2) || !w.first_private.reserve(pieces + 1)) return false;
    w.start[0] = 0;
    w.start[1] = tiles_of(to.scalars);
    long largest = 0;
    for (long k = 0; k < to.part_count; ++k) {
        const Structure& s = *to.parts[k].structure;
        w.start[k + 2] = w.start[k + 1] + tiles_of(s.values);
        for (int g = 0; g < s.group_count; ++g) {
            const long size = static_cast<long>(s.groups[g].rows) * s.groups[g].cols;
            largest = size > largest ? size : largest;
        }
    }
    const long all = w.start[to.part_count + 1], gradient = w.gradient_tiles();
    if (!w.copies.reserve_zero((pieces - 1) * gradient * kTile) || !w.touched.reserve(pieces * all) ||
        !w.tiles.reserve(pieces * (all - gradient)) || !w.owner.reserve(all - gradient) ||
        !w.first_bad.reserve(task_count * pieces) || !w.projected.reserve(task_count * pieces))
        return false;
    for (long p = 0; p < pieces; ++p) merge_marks(w, tasks, task_count, to, p);
    find_owners(w, to, pieces);
    w.private_size = kTile + (largest + 7) / 8 * 8;
    return w.private_tiles.reserve(w.first_private[pieces] * w.private_size);
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
    const long tiles = gradient_tiles + (part != nullptr ? yasps::tiles_of(part->structure->values) : 0);
#pragma omp parallel for num_threads(threads) schedule(static)
    for (long p = 0; p < pieces; ++p) {
        unsigned char* const of_piece = marks + p * tiles;
        memset(of_piece, 0, static_cast<size_t>(tiles));
        for (long c = p; c < chunks; c += pieces) {
            const yasps::Range range = yasps::chunk_of(task->instances, c, chunks);
            yasps::mark_gradient(*task, range, block_size_at, of_piece);
            if (part != nullptr) yasps::mark_blocks(*task, range, of_piece + gradient_tiles);
        }
    }
}

// Overwrites the gradient and the values of all parts with the sum over all instances of all tasks.
int yasps_assemble(yasps::AssemblyWorkspace* w, yasps::Task* tasks, long task_count, const yasps::Part* parts,
                   long part_count, double* gradient, long scalars, const int* block_size_at, long pieces, long chunks,
                   int threads) {
    const yasps::Destination to = {gradient, scalars, parts, part_count, block_size_at};
    const yasps::Cut cut = {pieces, chunks};
    if (!yasps::reserve(*w, tasks, task_count, to, pieces)) return yasps::kOutOfMemory;
    for (long k = 0; k < task_count * pieces; ++k) w->first_bad[k] = -1, w->projected[k] = 0;
    const long part_tiles = w->start[part_count + 1] - w->gradient_tiles();
#pragma omp parallel num_threads(threads)
    {
        const long thread = omp_get_thread_num(), team = omp_get_num_threads();
        yasps::clear_gradient(*w, to, cut, thread, team);
#pragma omp barrier
        for (long p = thread; p < pieces; p += team) {
            double** const tiles = w->tiles.data + p * part_tiles;
            memset(tiles, 0, static_cast<size_t>(part_tiles) * sizeof(double*));
            double* next_private = w->private_tiles.data + w->first_private[p] * w->private_size;
            for (long k = 0; k < task_count; ++k)
                yasps::run_task(*w, tasks[k], to, cut, p, &next_private, &w->first_bad[p * task_count + k],
                                &w->projected[p * task_count + k]);
        }
#pragma omp barrier
        yasps::add_gradients(*w, to, cut, thread, team);
        if (part_count > 0) yasps::add_tiles(*w, to, cut, thread, team);
    }
    for (long k = 0; k < task_count; ++k) {
        tasks[k].first_bad = -1;
        tasks[k].projected = 0;
        for (long p = 0; p < pieces; ++p) {
            const long bad = w->first_bad[p * task_count + k];
            if (bad == YASPS_NO_MEMORY) return yasps::kOutOfMemory;
            if (bad >= 0 && (tasks[k].first_bad < 0 || bad < tasks[k].first_bad)) tasks[k].first_bad = bad;
            tasks[k].projected += w->projected[p * task_count + k];
        }
    }
    return yasps::kOk;
}
}
