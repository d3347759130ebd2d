// Runs generated kernels over all instances and adds up what the threads found.
//
// Thread 0 writes straight to the destination, every other thread to a private copy; the copies are then added in
// thread order. So nothing is atomic and the result is the same bit for bit for a given number of threads.
// Private copies are all zero between calls, and of the Hessian only the tiles that a thread touched are visited.
#include <new>

#include "runtime.h"

namespace yasps {

// Private copies, kept between calls.
struct AssemblyWorkspace {
    Buffer<double> gradient, blocks;    // of threads 1, 2, ...; zero between calls
    Buffer<unsigned char> touched;      // [threads - 1, tiles]; zero between calls
    Buffer<long> part_start;            // [parts + 1]: offsets of the parts in a private copy, whole tiles
    Buffer<long> first_bad, projected;  // [threads, tasks]
};

namespace {

constexpr long kTileBits = 9;
constexpr long kTile = 1L << kTileBits;  // doubles
// Work is dealt out in this many chunks per thread, so that a region of expensive instances is shared.
constexpr long kChunksPerThread = 4;

// Layouts shared with runtime/assembly.py.
struct Task {
    yasps_energy_kernel kernel;
    const void* const* args;
    long instances;
    long capacity;
    long mode;
    const int* kappa;
    const long* position;
    long part;       // index of the matrix that receives the blocks, or -1: gradient only
    long first_bad;  // out: first instance with derivatives that are not finite, or -1
    long projected;  // out: instances whose Hessian had to be projected
};
struct Part {
    double* values;
    long count;
    long largest_block;  // doubles in the largest block
};

void mark_tiles(const Task& task, const Part& part, Range instances, long part_start, unsigned char* touched) {
    const long pairs = task.capacity * (task.capacity + 1) / 2;
    for (long k = instances.begin * pairs; k < instances.end * pairs; ++k) {
        if (task.position[k] < 0) continue;
        const long offset = task.position[k] >> 2;
        const long last = offset + part.largest_block < part.count ? offset + part.largest_block : part.count;
        for (long tile = offset >> kTileBits; tile <= (last - 1) >> kTileBits; ++tile)
            touched[(part_start >> kTileBits) + tile] = 1;
    }
}

// Chunk c of `chunks`; borders are multiples of the number of lanes.
Range chunk_of(long instances, long c, long chunks) {
    const long packs = (instances + kYaspsLanes - 1) / kYaspsLanes;
    const Range range = piece(packs, c, chunks);
    const long end = range.end * kYaspsLanes;
    return {range.begin * kYaspsLanes, end < instances ? end : instances};
}

void clear(double* values, Range range) {
    if (range.end > range.begin)
        memset(values + range.begin, 0, static_cast<size_t>(range.end - range.begin) * sizeof(double));
}

struct Destination {
    double* gradient;
    long scalars;
    const Part* parts;
    long part_count;
    const int* block_size_at;
};

void run_task(AssemblyWorkspace& w, Task& task, const Destination& to, long thread, long threads, long* first_bad,
              long* projected) {
    const bool direct = thread == 0;
    const long total = w.part_start[to.part_count];
    const bool with_blocks = task.part >= 0;
    double* blocks = nullptr;
    if (with_blocks)
        blocks = direct ? to.parts[task.part].values : w.blocks.data + (thread - 1) * total + w.part_start[task.part];
    long counted = 0;  // on this thread's stack: kernels add to it often
    const yasps_sink sink = {direct ? to.gradient : w.gradient.data + (thread - 1) * to.scalars,
                             blocks,
                             task.kappa,
                             task.position,
                             to.block_size_at,
                             yasps_project,
                             static_cast<int>(task.mode),
                             &counted};
    const long chunks = threads == 1 ? 1 : threads * kChunksPerThread;
    for (long c = thread; c < chunks && *first_bad < 0; c += threads) {
        const Range range = chunk_of(task.instances, c, chunks);
        if (range.begin >= range.end) continue;
        if (!direct && with_blocks)
            mark_tiles(task, to.parts[task.part], range, w.part_start[task.part],
                       w.touched.data + ((thread - 1) * total >> kTileBits));
        *first_bad = task.kernel(task.args, range.begin, range.end, &sink);
    }
    *projected = counted;
}

void reduce_gradient(AssemblyWorkspace& w, const Destination& to, long thread, long threads) {
    const Range own = piece(to.scalars, thread, threads);
    for (long t = 1; t < threads; ++t) {
        double* const from = w.gradient.data + (t - 1) * to.scalars;
        for (long i = own.begin; i < own.end; ++i) {
            to.gradient[i] += from[i];
            from[i] = 0;
        }
    }
}

void add_and_clear(double* to, double* from, long count) {
    long i = 0;
    for (; i + 4 <= count; i += 4) {
        d4_unaligned& sum = *reinterpret_cast<d4_unaligned*>(to + i);
        sum = sum + load_unaligned(from + i);
        *reinterpret_cast<d4_unaligned*>(from + i) = d4{};
    }
    for (; i < count; ++i) {
        to[i] += from[i];
        from[i] = 0;
    }
}

void reduce_blocks(AssemblyWorkspace& w, const Destination& to, long thread, long threads) {
    const long total = w.part_start[to.part_count];
    const Range own = piece(total >> kTileBits, thread, threads);
    long p = 0;
    for (long tile = own.begin; tile < own.end; ++tile) {
        const long at = tile << kTileBits;
        while (at >= w.part_start[p + 1]) ++p;
        const long offset = at - w.part_start[p];
        const long rest = to.parts[p].count - offset;
        for (long t = 1; t < threads; ++t) {
            unsigned char& touched = w.touched[((t - 1) * total >> kTileBits) + tile];
            if (!touched) continue;
            touched = 0;
            add_and_clear(to.parts[p].values + offset, w.blocks.data + (t - 1) * total + at,
                          rest < kTile ? rest : kTile);
        }
    }
}

bool reserve(AssemblyWorkspace& w, const Destination& to, long tasks, long threads) {
    if (!w.part_start.reserve(to.part_count + 1)) return false;
    w.part_start[0] = 0;
    for (long p = 0; p < to.part_count; ++p)
        w.part_start[p + 1] = w.part_start[p] + ((to.parts[p].count + kTile - 1) >> kTileBits << kTileBits);
    const long total = w.part_start[to.part_count];
    return w.gradient.reserve_zero((threads - 1) * to.scalars) && w.blocks.reserve_zero((threads - 1) * total) &&
           w.touched.reserve_zero((threads - 1) * (total >> kTileBits)) && w.first_bad.reserve(tasks * threads) &&
           w.projected.reserve(tasks * threads);
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

// Overwrites the gradient and the values of all parts with the sum over all instances of all tasks.
int yasps_assemble(yasps::AssemblyWorkspace* w, yasps::Task* tasks, long task_count, const yasps::Part* parts,
                   long part_count, double* gradient, long scalars, const int* block_size_at, int threads) {
    const yasps::Destination to = {gradient, scalars, parts, part_count, block_size_at};
    if (!yasps::reserve(*w, to, task_count, threads)) return yasps::kOutOfMemory;
    for (long k = 0; k < task_count * threads; ++k) w->first_bad[k] = -1, w->projected[k] = 0;
#pragma omp parallel num_threads(threads)
    {
        const long thread = omp_get_thread_num(), team = omp_get_num_threads();
        yasps::clear(gradient, yasps::piece(scalars, thread, team));
        for (long p = 0; p < part_count; ++p) yasps::clear(parts[p].values, yasps::piece(parts[p].count, thread, team));
#pragma omp barrier
        for (long k = 0; k < task_count; ++k)
            yasps::run_task(*w, tasks[k], to, thread, team, &w->first_bad[thread * task_count + k],
                            &w->projected[thread * task_count + k]);
#pragma omp barrier
        yasps::reduce_gradient(*w, to, thread, team);
        yasps::reduce_blocks(*w, to, thread, team);
    }
    for (long k = 0; k < task_count; ++k) {
        tasks[k].first_bad = -1;
        tasks[k].projected = 0;
        for (long t = 0; t < threads; ++t) {
            const long bad = w->first_bad[t * task_count + k];
            if (bad >= 0 && (tasks[k].first_bad < 0 || bad < tasks[k].first_bad)) tasks[k].first_bad = bad;
            tasks[k].projected += w->projected[t * task_count + k];
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
