// Conjugate gradients with symmetric Gauss-Seidel as preconditioner; gauss_seidel.h says what is computed.
//
// As in pcg.cpp, a solve is one parallel region, and the result is the same bit for bit whenever the number of pieces
// is. H' has fewer digits than H: when the swept residual is small, the true one is computed from H, and where that is
// not small the iteration begins anew with it.
#include "core/runtime.h"
#include "solvers/workspace.h"

namespace yasps {
namespace {

// The iteration aims at this share of the tolerance, so that rounding of H' does not leave the true residual just above.
constexpr double kAim = 0.99;
// |r'|^2 costs half an iteration: it is computed when this times as much is expected, and every so many iterations.
constexpr double kEarly = 1.3;
constexpr long kSeldom = 16;

// x - what was found since the start vector - goes to `start`, and x becomes zero.
void take_solution(Workspace& w, const Layout& layout, const Piece& p) {
    apply_inverse_factor_transposed(w.sweeps, layout, p, w.x.data);
    for (long i = p.own.begin; i < p.own.end; i += 4) {
        store(&w.start.data[i], load(&w.start[i]) + load(&w.x[i]));
        store(&w.x.data[i], d4{});
    }
}

double squared(Range range, const double* v) {
    d4 sums = {};
    for (long i = range.begin; i < range.end; i += 4) sums += load(v + i) * load(v + i);
    return sum_of(sums);
}

// Visits the vectors of a piece, (place, what to keep of the vector there): gaps of padded vectors, in which sweeps leave
// numbers without a meaning, become zero.
template <class Visit>
YASPS_ALWAYS_INLINE void for_each_vector(const Layout& layout, const Piece& p, Visit visit) {
    const auto three = [](d4 v) { return __builtin_shufflevector(v, d4{}, 0, 1, 2, 4); };
    if (has_threes_only(layout)) {
        for (long i = p.own.begin; i < p.own.end; i += 4) visit(i, three);
        return;
    }
    for (long b = p.blocks.begin; b < p.blocks.end; ++b) {
        const long first = layout.padded_start[b];
        if (layout.size[b] == 3)
            visit(first, three);
        else
            for (long i = first; i < layout.padded_start[b + 1]; i += 4) visit(i, [](d4 v) { return v; });
    }
}

// direction = residual + mix direction; t = (I + L)^-T direction.
void step_direction(Workspace& w, const Piece& p, long k, double mix) {
    for (long i = p.own.begin; i < p.own.end; i += 4) {
        const d4 way = load(&w.residual[i]) + mix * load(&w.direction[i]);
        store(&w.direction.data[i], way);
        store(&w.preconditioned.data[i], way);
    }
    solve_upper(w.sweeps, k, w.preconditioned.data);
}

// product = t + (I + L)^-1 (direction - t + E t); returns direction^T product.
double multiply_swept(Workspace& w, const Layout& layout, const Piece& p, long k) {
    double *const product = p.product, *const t = w.preconditioned.data, *const direction = w.direction.data;
    for (long i = p.own.begin; i < p.own.end; i += 4) store(product + i, load(direction + i) - load(t + i));
    add_between(w.sweeps, k, t, product);
    solve_lower(w.sweeps, k, product);
    d4 sums = {};
    for_each_vector(layout, p, [&](long i, auto keep) {
        const d4 swept = keep(load(t + i) + load(product + i));
        store(product + i, swept);
        sums += swept * load(direction + i);
    });
    return sum_of(sums);
}

// |(I + L) residual|^2; t is lost.
double squared_residual(Workspace& w, const Layout& layout, const Piece& p, long k) {
    double* const scratch = w.preconditioned.data;
    for (long i = p.own.begin; i < p.own.end; i += 4) store(scratch + i, load(&w.residual[i]));
    add_lower(w.sweeps, k, w.residual.data, scratch);
    d4 sums = {};
    for_each_vector(layout, p, [&](long i, auto keep) {
        const d4 entries = keep(load(scratch + i));
        sums += entries * entries;
    });
    return sum_of(sums);
}

}  // namespace

void iterate_swept(Workspace& w, const System& system, const Options& options, const double* g, const double* x0,
                   double* x, SolveResult* result) {
    const Layout& layout = system.layout();
    const ThreadShare share = share_of_thread(w);
    const bool reports = omp_get_thread_num() == 0;
    const auto number_of = [&](const Piece& p) { return &p - w.pieces.data; };
    const auto stop = [&](long iterations, double residual, Reason reason, long block) {
        if (reports) *result = {iterations, residual, reason, block, 0};
        for (const Piece& p : share) unpack(layout, p.blocks, w.start.data, x);
    };

    for (Piece& p : share) {
        pack(layout, p.blocks, g, w.g.data);
        if (x0 != nullptr)
            pack(layout, p.blocks, x0, w.start.data);
        else
            clear(w.start.data, p.own.begin, p.own.end);
        clear(w.x.data, p.own.begin, p.own.end);
        clear(p.product, p.own.begin, p.reach);
        double largest = 0;
        bool finite = true;
        for (long i = p.own.begin; i < p.own.end; ++i) {
            const double magnitude = fabs(w.g[i]);
            finite = finite && magnitude < INFINITY;
            if (magnitude > largest) largest = magnitude;
        }
        p.sums[0] = finite ? 0 : 1;
        p.sums[1] = largest;
        factor_diagonal(w.sweeps, system, p, w.scratch.data + number_of(p) * layout.largest * layout.largest);
    }
    w.barrier.wait();
    if (total(w, 0) > 0) return stop(0, NAN, kNotFinite, -1);
    if (total(w, 1) == 0) {
        for (const Piece& p : share) clear(w.start.data, p.own.begin, p.own.end);
        return stop(0, 0, kConverged, -1);
    }
    for (long k = 0; k < w.piece_count; ++k) {
        const Piece& p = w.pieces[k];
        if (p.bad_block < 0) continue;
        return stop(0, NAN, p.bad_status, layout.start[p.bad_block]);
    }

    scale_blocks(w.sweeps, system);
    w.barrier.wait();
    double reference = 0;
    for (long iteration = 0, begun = 0;; ++begun) {
        // The true residual.
        if (begun > 0 || x0 != nullptr) {
            for (const Piece& p : share) multiply_piece(system, p, w.start.data);
            w.barrier.wait();
        }
        for (Piece& p : share) {
            if (begun > 0 || x0 != nullptr) gather(w, p);
            for (long i = p.own.begin; i < p.own.end; i += 4) {
                store(&w.residual.data[i], load(&w.g[i]) - load(p.product + i));
                store(p.product + i, d4{});
            }
            apply_inverse_factor(w.sweeps, layout, p, w.residual.data);
            p.sums[0] = squared(p.own, w.residual.data);
            if (begun == 0) {
                apply_inverse_factor(w.sweeps, layout, p, w.g.data);
                p.sums[1] = squared(p.own, w.g.data);
                pack(layout, p.blocks, g, w.g.data);
            }
        }
        w.barrier.wait();
        double damped = total(w, 0);  // |r'|^2 = r^T D^-1 r
        if (begun == 0) reference = total(w, 1);
        const double truly = damped / reference;
        if (reports && options.history != nullptr) options.history[iteration] = truly;
        if (!(truly < INFINITY)) return stop(iteration, truly, kNotFinite, -1);
        if (truly <= options.tolerance) return stop(iteration, truly, kConverged, -1);
        if (iteration == options.max_iterations) return stop(iteration, truly, kMaxIterations, -1);
        for (Piece& p : share) {
            solve_lower(w.sweeps, number_of(p), w.residual.data);
            clear(w.direction.data, p.own.begin, p.own.end);
            d4 sums = {};
            for_each_vector(layout, p, [&](long i, auto keep) {
                const d4 entries = keep(load(&w.residual[i]));
                store(&w.residual.data[i], entries);
                sums += entries * entries;
            });
            p.sums[2] = sum_of(sums);
        }
        w.barrier.wait();
        double swept = total(w, 2), mix = 0;
        double ratio = damped / swept;
        double relative = truly;

        for (long since = 0; relative > kAim * options.tolerance; ++since) {
            if (iteration == options.max_iterations) break;
            for (const Piece& p : share) step_direction(w, p, number_of(p), mix);
            w.barrier.wait();
            for (Piece& p : share) p.sums[0] = multiply_swept(w, layout, p, number_of(p));
            w.barrier.wait();
            const double curvature = total(w, 0);
            if (!(curvature > 0 && curvature < INFINITY)) {
                const bool indefinite = curvature <= 0 && curvature > -INFINITY;
                for (const Piece& p : share) take_solution(w, layout, p);
                return stop(iteration, relative, indefinite ? kNotPositiveDefinite : kNotFinite, -1);
            }
            const double step = swept / curvature;
            for (Piece& p : share) {
                d4 sums = {};
                for (long i = p.own.begin; i < p.own.end; i += 4) {
                    store(&w.x.data[i], load(&w.x[i]) + step * load(&w.preconditioned[i]));
                    const d4 residual = load(&w.residual[i]) - step * load(p.product + i);
                    store(&w.residual.data[i], residual);
                    sums += residual * residual;
                }
                p.sums[1] = sum_of(sums);
            }
            w.barrier.wait();
            const double next = total(w, 1);
            mix = next / swept;
            swept = next;
            ++iteration;
            relative = ratio * swept / reference;
            const bool looks = relative <= kEarly * options.tolerance || options.history != nullptr ||
                               since % kSeldom == kSeldom - 1 || !(relative < INFINITY);
            if (looks) {
                for (Piece& p : share) p.sums[0] = squared_residual(w, layout, p, number_of(p));
                w.barrier.wait();
                relative = total(w, 0) / reference;
                if (!(relative < INFINITY)) {
                    for (const Piece& p : share) take_solution(w, layout, p);
                    return stop(iteration, relative, kNotFinite, -1);
                }
                ratio = relative * reference / swept;
                if (reports && options.history != nullptr) options.history[iteration] = relative;
            }
        }
        for (const Piece& p : share) {
            take_solution(w, layout, p);
            clear(p.product, p.own.begin, p.own.end);
        }
        w.barrier.wait();
    }
}

}  // namespace yasps
