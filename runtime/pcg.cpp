// Preconditioned conjugate gradients with block Jacobi for (sum of parts) x = g (paper, section 8, appendix D).
//
// The whole solve is one parallel region. Sums are made per thread and added in thread order, so that the result
// is the same bit for bit in every run with the same number of threads.
#include <new>

#include "runtime.h"

namespace yasps {

// Memory of the solver, kept between solves.
struct Workspace {
    Buffer<double> x, g, residual, direction, product, preconditioned;  // padded vectors
    Buffer<double> partial;  // products of threads 1, 2, ...; zero between uses
    Buffer<double> inverse;  // inverted diagonal blocks
    Buffer<double> scratch;  // one diagonal block per thread
    Buffer<double> sums;     // [threads, kSumStride]
    Buffer<Range> touched;   // [parts, threads]
    Buffer<long> bad_block;  // [threads]: the first block that cannot be inverted, or -1
    Buffer<int> bad_status;  // [threads]
};

namespace {

enum Reason { kConverged = 0, kMaxIterations = 1, kNotPositiveDefinite = 2, kNotFinite = 3 };

constexpr long kSumStride = 16;  // two cache lines a thread; two sums each

// Layout shared with runtime/solver.py.
struct SolveResult {
    long iterations;
    double relative_residual;
    long reason;
    long block;  // scalar offset of the diagonal block to blame, or -1
};

struct System {
    int parts;
    const Structure* const* structures;
    const double* const* values;

    const Layout& layout() const { return structures[0]->layout; }
};

// What each thread knows about its share of the work.
struct Team {
    int thread, threads;
    Range blocks;  // dof blocks
    Range padded;  // the same in padded vectors
};

Team team_of(const Layout& layout) {
    Team team = {omp_get_thread_num(), omp_get_num_threads(), {}, {}};
    team.blocks = layout.blocks_of_part(team.thread, team.threads);
    team.padded = {layout.padded_start[team.blocks.begin], layout.padded_start[team.blocks.end]};
    return team;
}

double* partial_of(Workspace& w, const Layout& layout, int thread) {
    return thread == 0 ? w.product.data : w.partial.data + (thread - 1L) * layout.padded;
}

void find_touched(Workspace& w, const System& system, const Team& team) {
    for (int p = 0; p < system.parts; ++p)
        w.touched[static_cast<long>(p) * team.threads + team.thread] =
            touched_by_part(*system.structures[p], team.thread, team.threads);
}

// product += H x; complete once gather_product has run after a barrier. product must be zero before.
void scatter_product(Workspace& w, const System& system, const Team& team, const double* x) {
    for (int p = 0; p < system.parts; ++p)
        multiply_part(*system.structures[p], system.values[p], team.thread, team.threads, x,
                      partial_of(w, system.layout(), team.thread));
}

// Adds what the other threads found for this thread's share, in thread order, and empties their vectors.
void gather_product(Workspace& w, const System& system, const Team& team) {
    for (int t = 1; t < team.threads; ++t) {
        double* const from = partial_of(w, system.layout(), t);
        long begin = team.padded.end, end = team.padded.begin;
        for (int p = 0; p < system.parts; ++p) {
            const Range touched = w.touched[static_cast<long>(p) * team.threads + t];
            if (touched.begin == touched.end) continue;
            if (touched.begin < begin) begin = touched.begin;
            if (touched.end > end) end = touched.end;
        }
        if (begin < team.padded.begin) begin = team.padded.begin;
        if (end > team.padded.end) end = team.padded.end;
        for (long i = begin; i < end; i += 4) {
            store(&w.product[i], load(&w.product[i]) + load(from + i));
            store(from + i, d4{});
        }
    }
}

double dot(Range range, const double* a, const double* b) {
    d4 first = {}, second = {};
    long i = range.begin;
    for (; i + 8 <= range.end; i += 8) {
        first += load(a + i) * load(b + i);
        second += load(a + i + 4) * load(b + i + 4);
    }
    for (; i < range.end; i += 4) first += load(a + i) * load(b + i);
    return sum_of(first + second);
}

double total(const Workspace& w, const Team& team, int which) {
    double sum = 0;
    for (int t = 0; t < team.threads; ++t) sum += w.sums[t * kSumStride + which];
    return sum;
}

// z = M^-1 r for this thread's blocks; returns its share of r^T z.
double precondition(const Workspace& w, const Layout& layout, Range blocks, const double* r, double* z) {
    double sum = 0;
    d4 sums = {};
    for (long b = blocks.begin; b < blocks.end; ++b) {
        const int q = layout.size[b];
        const double* inverse = &w.inverse[layout.inverse_start[b]];
        const long at = layout.padded_start[b];
        if (q == 3) {
            const d4 z3 = load(inverse) * r[at] + load(inverse + 4) * r[at + 1] + load(inverse + 8) * r[at + 2];
            store(z + at, z3);
            sums += z3 * load(r + at);
            continue;
        }
        const int stride = padded_size(q);
        for (int v = 0; v < stride; v += 4) {
            d4 column = {};
            for (int i = 0; i < q; ++i) column += load(inverse + static_cast<long>(i) * stride + v) * r[at + i];
            store(z + at + v, column);
            sums += column * load(r + at + v);
        }
    }
    sum += sum_of(sums);
    return sum;
}

// Inverts the diagonal blocks; true when all of them could be.
void invert_share(Workspace& w, const System& system, const Team& team) {
    const long size = system.layout().largest;
    w.bad_block[team.thread] = -1;
    long bad = -1;
    const InversionStatus status = invert_diagonal(system.parts, system.structures, system.values, team.blocks,
                                                   w.inverse.data, w.scratch.data + team.thread * size * size, &bad);
    w.bad_status[team.thread] = status;
    if (status != kInverted) w.bad_block[team.thread] = bad;
}

struct Options {
    double tolerance;
    long max_iterations;
    double* history;  // [max_iterations + 1] or null
};

// The body of the parallel region. Every thread takes the same decisions from the same sums.
void iterate(Workspace& w, const System& system, const Options& options, const double* g, const double* x0, double* x,
             SolveResult* result) {
    const Layout& layout = system.layout();
    const Team team = team_of(layout);
    const Range own = team.padded;
    double* const sums = &w.sums[team.thread * kSumStride];
    const bool reports = team.thread == 0;
    const auto stop = [&](long iterations, double residual, Reason reason, long block) {
        if (reports) *result = {iterations, residual, reason, block};
    };

    find_touched(w, system, team);
    invert_share(w, system, team);
    pack(layout, team.blocks, g, w.g.data);
    if (x0 != nullptr) pack(layout, team.blocks, x0, w.x.data);
    for (long i = own.begin; i < own.end; i += 4) {
        if (x0 == nullptr) store(&w.x[i], d4{});
        store(&w.product[i], d4{});
    }
    double largest = 0;
    bool finite = true;
    for (long i = own.begin; i < own.end; ++i) {
        const double magnitude = fabs(w.g[i]);
        finite = finite && magnitude < INFINITY;
        if (magnitude > largest) largest = magnitude;
    }
    sums[0] = finite ? 0 : 1;
    sums[1] = largest;
#pragma omp barrier
    if (total(w, team, 0) > 0) {
        unpack(layout, team.blocks, w.x.data, x);
        return stop(0, NAN, kNotFinite, -1);
    }
    if (total(w, team, 1) == 0) {
        for (long i = own.begin; i < own.end; ++i) w.x[i] = 0;
        unpack(layout, team.blocks, w.x.data, x);
        return stop(0, 0, kConverged, -1);
    }
    for (int t = 0; t < team.threads; ++t) {
        if (w.bad_block[t] < 0) continue;
        unpack(layout, team.blocks, w.x.data, x);
        return stop(0, NAN, w.bad_status[t] == kNonFinite ? kNotFinite : kNotPositiveDefinite,
                    layout.start[w.bad_block[t]]);
    }

    if (x0 != nullptr) scatter_product(w, system, team, w.x.data);
#pragma omp barrier
    if (x0 != nullptr) gather_product(w, system, team);
    for (long i = own.begin; i < own.end; i += 4) {
        store(&w.residual[i], load(&w.g[i]) - load(&w.product[i]));
        store(&w.product[i], d4{});
    }
    sums[0] = precondition(w, layout, team.blocks, w.g.data, w.preconditioned.data);
    sums[1] = precondition(w, layout, team.blocks, w.residual.data, w.preconditioned.data);
    for (long i = own.begin; i < own.end; i += 4) store(&w.direction[i], load(&w.preconditioned[i]));
#pragma omp barrier
    const double reference = total(w, team, 0);
    double squared = total(w, team, 1);

    for (long iteration = 0;; ++iteration) {
        const double relative = squared / reference;
        if (reports && options.history != nullptr) options.history[iteration] = relative;
        bool done = true;
        if (!(relative < INFINITY))
            stop(iteration, relative, kNotFinite, -1);
        else if (relative <= options.tolerance)
            stop(iteration, relative, kConverged, -1);
        else if (iteration == options.max_iterations)
            stop(iteration, relative, kMaxIterations, -1);
        else
            done = false;
        if (done) break;

        scatter_product(w, system, team, w.direction.data);
#pragma omp barrier
        gather_product(w, system, team);
        sums[0] = dot(own, w.direction.data, w.product.data);
#pragma omp barrier
        const double curvature = total(w, team, 0);
        if (!(curvature > 0 && curvature < INFINITY)) {
            const bool indefinite = curvature <= 0 && curvature > -INFINITY;
            stop(iteration, relative, indefinite ? kNotPositiveDefinite : kNotFinite, -1);
            break;
        }
        const double step = squared / curvature;
        for (long i = own.begin; i < own.end; i += 4) {
            store(&w.x[i], load(&w.x[i]) + step * load(&w.direction[i]));
            store(&w.residual[i], load(&w.residual[i]) - step * load(&w.product[i]));
            store(&w.product[i], d4{});
        }
        sums[1] = precondition(w, layout, team.blocks, w.residual.data, w.preconditioned.data);
#pragma omp barrier
        const double next = total(w, team, 1);
        const double mix = next / squared;
        squared = next;
        for (long i = own.begin; i < own.end; i += 4)
            store(&w.direction[i], load(&w.preconditioned[i]) + mix * load(&w.direction[i]));
#pragma omp barrier
    }
    unpack(layout, team.blocks, w.x.data, x);
}

bool reserve(Workspace& w, const Layout& layout, int parts, long threads) {
    const long n = layout.padded + 8;
    return w.x.reserve(n) && w.g.reserve(n) && w.residual.reserve(n) && w.direction.reserve(n) &&
           w.product.reserve(n) && w.preconditioned.reserve(n) && w.partial.reserve_zero((threads - 1) * n) &&
           w.inverse.reserve(layout.inverse_start[layout.blocks]) &&
           w.scratch.reserve(threads * layout.largest * layout.largest) && w.sums.reserve(threads * kSumStride) &&
           w.touched.reserve(parts * threads) && w.bad_block.reserve(threads) && w.bad_status.reserve(threads);
}

}  // namespace
}  // namespace yasps

extern "C" {

yasps::Workspace* yasps_workspace_new() { return new (std::nothrow) yasps::Workspace; }
void yasps_workspace_free(yasps::Workspace* w) { delete w; }

// Solves (sum of parts) x = g. All parts have the same layout. x0 and history may be null.
int yasps_solve(yasps::Workspace* w, int parts, const yasps::Structure* const* structures, const double* const* values,
                const double* g, const double* x0, double* x, double tolerance, long max_iterations, double* history,
                int threads, yasps::SolveResult* result) {
    const yasps::System system = {parts, structures, values};
    if (!yasps::reserve(*w, system.layout(), parts, threads)) return yasps::kOutOfMemory;
    const yasps::Options options = {tolerance, max_iterations, history};
#pragma omp parallel num_threads(threads)
    yasps::iterate(*w, system, options, g, x0, x, result);
    return yasps::kOk;
}

// y = H x for compact vectors.
int yasps_multiply(yasps::Workspace* w, const yasps::Structure* structure, const double* values, const double* x,
                   double* y, int threads) {
    const yasps::System system = {1, &structure, &values};
    const yasps::Layout& layout = system.layout();
    if (!yasps::reserve(*w, layout, 1, threads)) return yasps::kOutOfMemory;
#pragma omp parallel num_threads(threads)
    {
        const yasps::Team team = yasps::team_of(layout);
        yasps::find_touched(*w, system, team);
        yasps::pack(layout, team.blocks, x, w->x.data);
        for (long i = team.padded.begin; i < team.padded.end; ++i) w->product[i] = 0;
#pragma omp barrier
        yasps::scatter_product(*w, system, team, w->x.data);
#pragma omp barrier
        yasps::gather_product(*w, system, team);
        yasps::unpack(layout, team.blocks, w->product.data, y);
    }
    return yasps::kOk;
}
}
