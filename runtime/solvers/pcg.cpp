// Preconditioned conjugate gradients with block Jacobi, perhaps beside a coarse space, for (sum of parts) x = g (paper,
// section 8, appendix D).
//
// The whole solve is one parallel region. Rows are cut into pieces of about equal work, one or more for each thread;
// what depends on the order of additions is added per piece and then in the order of the pieces. So the result is the
// same bit for bit whenever the number of pieces is.
#include <new>

#include "core/runtime.h"
#include "solvers/workspace.h"

namespace yasps {
namespace {

// What the rows before this dof block cost, in doubles that pass through the processor.
long work_before(const System& system, long block) {
    constexpr long kVectorPasses = 8;  // over the padded vectors in each iteration, beside the product
    const long row = system.layout().padded_start[block];
    long work = kVectorPasses * row;
    for (int p = 0; p < system.parts; ++p) work += values_before(*system.structures[p], row);
    return work;
}

// Cuts the rows into pieces. False: out of memory.
bool cut_pieces(Workspace& w, const System& system, long pieces, const System& work) {
    const Layout& layout = system.layout();
    if (!w.pieces.reserve(pieces)) return false;
    w.piece_count = pieces;
    const long whole = work_before(work, layout.blocks);
    long products = 0, stretches = 0;
    for (long k = 0, begin = 0; k < pieces; ++k) {
        // The first block with at least this piece's share of the work before it.
        long end = begin, high = layout.blocks;
        while (end < high) {
            const long middle = (end + high) / 2;
            if (work_before(work, middle) < whole * (k + 1) / pieces)
                end = middle + 1;
            else
                high = middle;
        }
        Piece& p = w.pieces[k];
        p.blocks = {begin, end};
        p.own = {layout.padded_start[begin], layout.padded_start[end]};
        p.reach = p.own.end;
        p.bad_block = -1;
        for (int part = 0; part < system.parts; ++part) {
            const long reach = reach_of(*system.structures[part], p.own);
            if (reach > p.reach) p.reach = reach;
        }
        products += p.reach - p.own.begin;
        stretches += stretches_of(p).end - stretches_of(p).begin;
        begin = end;
    }
    if (!w.products.reserve(products) || !w.touched.reserve(stretches)) return false;
    double* next = w.products.data;
    bool* next_stretch = w.touched.data;
    for (long k = 0; k < pieces; ++k) {
        Piece& p = w.pieces[k];
        p.product = next - p.own.begin;
        p.touched = next_stretch - stretches_of(p).begin;
        next += p.reach - p.own.begin;
        next_stretch += stretches_of(p).end - stretches_of(p).begin;
    }
    return true;
}

// z = M^-1 r for some dof blocks; returns their share of r^T z.
double precondition(const Workspace& w, const Layout& layout, Range blocks, const double* r, double* z) {
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
    return sum_of(sums);
}

// The piece's place for P^T r.
double* restricted_of(const Workspace& w, const Piece& p) {
    return w.coarse.restricted.data + kCopies * (&p - w.pieces.data) * w.coarse.restricted_length;
}

void clear_restricted(const Workspace& w, const Piece& p) {
    clear(restricted_of(w, p), 0, kCopies * w.coarse.restricted_length);
}

// Adds P^T r of some dof blocks.
void restrict_to_coarse(const Workspace& w, const Layout& layout, Range blocks, double* restricted) {
    // In variables of their own, since a store of a vector could be one to what holds them.
    const int* const place = w.coarse.place.data;
    const double* const residual = w.residual.data;
    const long length = w.coarse.restricted_length;
    if (has_threes_only(layout)) {
        for (long b = blocks.begin; b < blocks.end; ++b) {
            double* const to = restricted + b % kCopies * length + place[b];
            store(to, load(to) + load(residual + 4 * b));
        }
        return;
    }
    for (long b = blocks.begin; b < blocks.end; ++b) {
        double* const to = restricted + b % kCopies * length + place[b];
        const double* const from = residual + layout.padded_start[b];
        for (int i = 0; i < padded_size(layout.size[b]); i += 4) store(to + i, load(to + i) + load(from + i));
    }
}

// residual -= step * product and its preconditioning, some blocks at a time, which then stay in the nearest cache; with
// a coarse space also P^T r. Returns the piece's share of r^T D^-1 r and leaves the product empty.
double step_residual(const Workspace& w, const Layout& layout, const Piece& p, double step, bool coarse) {
    constexpr long kBlocks = 64;
    double* const restricted = restricted_of(w, p);
    if (coarse) clear_restricted(w, p);
    double sum = 0;
    for (long begin = p.blocks.begin; begin < p.blocks.end; begin += kBlocks) {
        const long end = begin + kBlocks < p.blocks.end ? begin + kBlocks : p.blocks.end;
        for (long i = layout.padded_start[begin]; i < layout.padded_start[end]; i += 4) {
            store(&w.residual.data[i], load(&w.residual[i]) - step * load(p.product + i));
            store(p.product + i, d4{});
        }
        sum += precondition(w, layout, {begin, end}, w.residual.data, w.preconditioned.data);
        if (coarse) restrict_to_coarse(w, layout, {begin, end}, restricted);
    }
    return sum;
}

// x += step direction, direction = D^-1 r + P y + mix direction, y the solution in the coarse space.
void step_direction(const Workspace& w, const Layout& layout, const Piece& p, double step, double mix, bool coarse) {
    if (!coarse) {
        for (long i = p.own.begin; i < p.own.end; i += 4) {
            const d4 direction = load(&w.direction[i]);
            store(&w.x.data[i], load(&w.x[i]) + step * direction);
            store(&w.direction.data[i], load(&w.preconditioned[i]) + mix * direction);
        }
        return;
    }
    double *const x = w.x.data, *const direction = w.direction.data;
    const double *const damped = w.preconditioned.data, *const solution = w.coarse.solution.data;
    const int* const place = w.coarse.place.data;
    const auto step_at = [=](long i, const double* moved) {
        const d4 before = load(direction + i);
        store(x + i, load(x + i) + step * before);
        store(direction + i, (load(damped + i) + load(moved)) + mix * before);
    };
    if (has_threes_only(layout)) {
        for (long b = p.blocks.begin; b < p.blocks.end; ++b) step_at(4 * b, solution + place[b]);
        return;
    }
    for (long b = p.blocks.begin; b < p.blocks.end; ++b) {
        const double* const moved = solution + place[b];
        const long first = layout.padded_start[b], end = layout.padded_start[b + 1];
        for (long i = first; i < end; i += 4) step_at(i, moved + (i - first));
    }
}

void invert_diagonal_of(Workspace& w, const System& system, Piece& p) {
    const long size = system.layout().largest;
    long bad = -1;
    p.bad_status = invert_diagonal(system.parts, system.structures, system.values, p.blocks, w.inverse.data,
                                   w.scratch.data + (&p - w.pieces.data) * size * size, &bad);
    if (p.bad_status != kConverged) p.bad_block = bad;
}

// Makes the coarse space ready for this system, by all threads together. False where that is impossible.
bool start_coarse(Workspace& w, const System& system, const ThreadShare& share) {
    for (const Piece& p : share) place_blocks(w.coarse, *system.structures[0], w.inverse.data, p.blocks);
    w.barrier.wait();
    return make_coarse_matrix(w.coarse, {system.parts, system.structures, system.values}, w.barrier);
}

// The body of the parallel region. Every thread takes the same decisions from the same sums.
void iterate(Workspace& w, const System& system, const Options& options, const double* g, const double* x0, double* x,
             SolveResult* result) {
    const Layout& layout = system.layout();
    const ThreadShare share = share_of_thread(w);
    const bool reports = omp_get_thread_num() == 0;
    bool coarse = false, broke_down = false;
    const auto stop = [&](long iterations, double residual, Reason reason, long block) {
        if (reports) *result = {iterations, residual, reason, block, coarse ? 1 : broke_down ? -1 : 0, 0};
        for (const Piece& p : share) unpack(layout, p.blocks, w.x.data, x);
    };

    for (Piece& p : share) {
        start_vectors(w, system, g, x0, w.x.data, p);
        invert_diagonal_of(w, system, p);
    }
    w.barrier.wait();
    if (total(w, 0) > 0) return stop(0, NAN, kNotFinite, -1);
    if (total(w, 1) == 0) {
        for (const Piece& p : share) clear(w.x.data, p.own.begin, p.own.end);
        return stop(0, 0, kConverged, -1);
    }
    if (const Piece* const bad = first_bad(w)) return stop(0, NAN, bad->bad_status, layout.start[bad->bad_block]);

    if (x0 != nullptr)
        for (const Piece& p : share) multiply_piece(system, p, w.x.data);
    w.barrier.wait();
    for (Piece& p : share) {
        if (x0 != nullptr) gather(w, p);
        for (long i = p.own.begin; i < p.own.end; i += 4) {
            store(&w.residual[i], load(&w.g[i]) - load(p.product + i));
            store(p.product + i, d4{});
        }
        p.sums[0] = precondition(w, layout, p.blocks, w.g.data, w.preconditioned.data);
        p.sums[1] = precondition(w, layout, p.blocks, w.residual.data, w.preconditioned.data);
        for (long i = p.own.begin; i < p.own.end; i += 4) store(&w.direction[i], load(&w.preconditioned[i]));
    }
    w.barrier.wait();
    const double reference = total(w, 0);
    double damped = total(w, 1);  // r^T D^-1 r
    double squared = damped;      // r^T M^-1 r, with the coarse space in M

    if (options.coarse && damped > options.tolerance * reference && options.max_iterations > 0) {
        coarse = start_coarse(w, system, share);
        broke_down = !coarse;
    }
    if (coarse) {
        for (const Piece& p : share) {
            clear_restricted(w, p);
            restrict_to_coarse(w, layout, p.blocks, restricted_of(w, p));
        }
        w.barrier.wait();
        solve_coarse(w.coarse, system.aggregates(), w.piece_count);
        w.barrier.wait();
        squared += coarse_product(w.coarse, system.aggregates());
        for (const Piece& p : share) step_direction(w, layout, p, 0, 0, true);
        w.barrier.wait();
    }

    for (long iteration = 0;; ++iteration) {
        const double relative = damped / reference;
        if (reports && options.history != nullptr) options.history[iteration] = relative;
        if (!(relative < INFINITY)) return stop(iteration, relative, kNotFinite, -1);
        if (relative <= options.tolerance) return stop(iteration, relative, kConverged, -1);
        if (iteration == options.max_iterations) return stop(iteration, relative, kMaxIterations, -1);

        for (const Piece& p : share) multiply_piece(system, p, w.direction.data);
        w.barrier.wait();
        for (Piece& p : share) {
            gather(w, p);
            p.sums[0] = dot(p.own, w.direction.data, p.product);
        }
        w.barrier.wait();
        const double curvature = total(w, 0);
        if (!(curvature > 0 && curvature < INFINITY)) {
            const bool indefinite = curvature <= 0 && curvature > -INFINITY;
            return stop(iteration, relative, indefinite ? kNotPositiveDefinite : kNotFinite, -1);
        }
        const double step = squared / curvature;
        for (Piece& p : share) p.sums[1] = step_residual(w, layout, p, step, coarse);
        w.barrier.wait();
        damped = total(w, 1);
        double next = damped;
        if (coarse) {
            solve_coarse(w.coarse, system.aggregates(), w.piece_count);
            w.barrier.wait();
            next += coarse_product(w.coarse, system.aggregates());
        }
        const double mix = next / squared;
        squared = next;
        for (const Piece& p : share) step_direction(w, layout, p, step, mix, coarse);
        w.barrier.wait();
    }
}

bool reserve(Workspace& w, const System& system, long pieces, long threads, int preconditioner) {
    const bool coarse = preconditioner == kTwoLevel, swept = preconditioner == kGaussSeidel;
    // Sweeps follow the static part, so that their lists stay while it does.
    const System fixed = {1, system.structures, system.values};
    const Layout& layout = system.layout();
    const long n = layout.padded + 8;
    return w.x.reserve(n) && w.g.reserve(n) && w.residual.reserve(n) && w.direction.reserve(n) &&
           w.preconditioned.reserve(n) && (swept || w.inverse.reserve(layout.inverse_start[layout.blocks])) &&
           w.scratch.reserve(pieces * layout.largest * layout.largest) &&
           cut_pieces(w, system, pieces, swept ? fixed : system) &&
           (!swept ||
            (w.start.reserve(n) && w.image.reserve(n) && list_products(w.sweeps, system, w.pieces.data, pieces))) &&
           (!coarse || (find_aggregates(*system.structures[0]) &&
                        reserve_coarse_space(w.coarse, *system.structures[0], pieces, threads)));
}

}  // namespace
}  // namespace yasps

extern "C" {

yasps::Workspace* yasps_workspace_new() { return new (std::nothrow) yasps::Workspace; }
void yasps_workspace_free(yasps::Workspace* w) { delete w; }

// Solves (sum of parts) x = g. All parts have the same layout. x0 and history may be null. preconditioner: see
// Preconditioner; without anything to sweep, and where the sweeps have too few digits, block Jacobi takes over. Results
// are the same for the same number of pieces, whatever the number of threads.
int yasps_solve(yasps::Workspace* w, int parts, const yasps::Structure* const* structures, const double* const* values,
                const double* g, const double* x0, double* x, double tolerance, long max_iterations, int preconditioner,
                double* history, int threads, int pieces, yasps::SolveResult* result) {
    const yasps::System system = {parts, structures, values};
    const auto run = [&](int with, const double* start, long most, double* trace) {
        if (!yasps::reserve(*w, system, pieces, threads, with)) return false;
        const yasps::Options options = {tolerance, most, trace, with == yasps::kTwoLevel};
        const auto iterate = with == yasps::kGaussSeidel ? yasps::iterate_swept : yasps::iterate;
#pragma omp parallel num_threads(threads)
        iterate(*w, system, options, g, start, x, result);
        return true;
    };
    const bool idle = preconditioner == yasps::kGaussSeidel && !yasps::can_sweep(*structures[0]);
    if (!run(idle ? yasps::kJacobi : preconditioner, x0, max_iterations, history)) return yasps::kOutOfMemory;
    if (result->reason != yasps::kTooFewDigits) return yasps::kOk;
    const long done = result->iterations;
    if (!run(yasps::kJacobi, x, max_iterations - done, history != nullptr ? history + done : nullptr))
        return yasps::kOutOfMemory;
    result->iterations += done;
    result->sweeps = -1;
    return yasps::kOk;
}

// y = H x for compact vectors; pieces as in yasps_solve.
int yasps_multiply(yasps::Workspace* w, const yasps::Structure* structure, const double* values, const double* x,
                   double* y, int threads, int pieces) {
    const yasps::System system = {1, &structure, &values};
    const yasps::Layout& layout = system.layout();
    if (!w->x.reserve(layout.padded + 8) || !yasps::cut_pieces(*w, system, pieces, system)) return yasps::kOutOfMemory;
#pragma omp parallel num_threads(threads)
    {
        const yasps::ThreadShare share = yasps::share_of_thread(*w);
        for (const yasps::Piece& p : share) {
            yasps::pack(layout, p.blocks, x, w->x.data);
            yasps::start_product(system, p);
        }
        w->barrier.wait();
        for (const yasps::Piece& p : share) yasps::multiply_piece(system, p, w->x.data);
        w->barrier.wait();
        for (const yasps::Piece& p : share) {
            yasps::gather(*w, p);
            yasps::unpack(layout, p.blocks, p.product, y);
        }
    }
    return yasps::kOk;
}
}
