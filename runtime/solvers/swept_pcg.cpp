// Conjugate gradients with symmetric Gauss-Seidel as preconditioner; gauss_seidel.h says what is computed.
//
// H' has fewer digits than H. So when the residual of the scaled system is small, or has lost as many digits as H' has,
// the true one is computed from H, and where that is not small the iteration begins anew with it (iterative refinement:
// Higham 2002, Accuracy and Stability of Numerical Algorithms, ch. 12).
#include "core/runtime.h"
#include "solvers/workspace.h"

namespace yasps {
namespace {

// The iteration aims at this share of the tolerance, so that rounding of H' does not leave the true residual just
// above.
constexpr double kAim = 0.99;
// After so much less of the squared residual the true one is looked at.
constexpr double kDigits = 1e-10;
// Refinement that leaves more than this of the squared residual does not pay.
constexpr double kStagnant = 0.25;
// What rounding of H' may change of t^T H' t, as share of |t|^2.
constexpr double kRounding = 1e-5;
// |r'|^2 costs half an iteration: it is computed when this times as much is expected, and every so many iterations.
constexpr double kEarly = 1.3;
constexpr long kSeldom = 16;

// What was found goes from x to `start`.
void take_solution(Workspace& w, const Layout& layout, const Piece& p) {
    apply_inverse_factor_transposed(w.sweeps, layout, p, w.x.data);
    for (long i = p.own.begin; i < p.own.end; i += 4) {
        store(&w.start.data[i], load(&w.start[i]) + load(&w.x[i]));
        store(&w.x.data[i], d4{});
    }
}

// Visits the vectors of a piece, (place, what to keep of the vector there): gaps of padded vectors, in which sweeps
// leave numbers without a meaning, become zero.
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

double squared(const Piece& p, const double* v) { return dot(p.own, v, v); }

// r' of `start`, in `residual`. `product` is that of H and `start`, and is empty then.
void find_residual(Workspace& w, const Layout& layout, const Piece& p) {
    for (long i = p.own.begin; i < p.own.end; i += 4) {
        store(&w.residual.data[i], load(&w.g[i]) - load(p.product + i));
        store(p.product + i, d4{});
    }
    apply_inverse_factor(w.sweeps, layout, p, w.residual.data);
}

// x += step t; direction = residual + mix direction; t = (I + L)^-T direction, the early part.
void begin_direction(Workspace& w, const Piece& p, long k, double step, double mix) {
    double *const x = w.x.data, *const t = w.preconditioned.data, *const direction = w.direction.data;
    const double* const residual = w.residual.data;
    for (long i = p.own.begin; i < p.own.end; i += 4) {
        store(x + i, load(x + i) + step * load(t + i));
        const d4 way = load(residual + i) + mix * load(direction + i);
        store(direction + i, way);
        store(t + i, way);
    }
    solve_upper_early(w.sweeps, k, t);
}

// product = (I + L)^-1 (direction - t + E t), the early part.
void begin_product(Workspace& w, const Piece& p, long k) {
    double *const product = p.product, *const t = w.preconditioned.data;
    const double* const direction = w.direction.data;
    for (long i = p.own.begin; i < p.own.end; i += 4) store(product + i, load(direction + i) - load(t + i));
    add_between(w.sweeps, k, t, product);
    solve_lower_early(w.sweeps, k, product);
}

// The rest of it; image = t + product. Returns direction^T image.
double end_product(Workspace& w, const Layout& layout, const Piece& p, long k) {
    double* const image = w.image.data;
    const double *const product = p.product, *const t = w.preconditioned.data, *const direction = w.direction.data;
    solve_lower_late(w.sweeps, k, k > 0 ? w.pieces[k - 1].product : nullptr, p.product);
    d4 sums = {};
    for_each_vector(layout, p, [&](long i, auto keep) {
        const d4 swept = keep(load(t + i) + load(product + i));
        store(image + i, swept);
        sums += swept * load(direction + i);
    });
    return sum_of(sums);
}

// residual -= step image; returns its square.
double step_residual(Workspace& w, const Piece& p, double step) {
    double* const residual = w.residual.data;
    d4 sums = {};
    for (long i = p.own.begin; i < p.own.end; i += 4) {
        const d4 left = load(residual + i) - step * load(&w.image[i]);
        store(residual + i, left);
        sums += left * left;
    }
    return sum_of(sums);
}

// |(I + L) residual|^2; the product is lost.
double squared_true_residual(Workspace& w, const Layout& layout, const Piece& p, long k) {
    double* const scratch = p.product;
    for (long i = p.own.begin; i < p.own.end; i += 4) store(scratch + i, load(&w.residual[i]));
    add_lower(w.sweeps, k, w.residual.data, scratch);
    d4 sums = {};
    for_each_vector(layout, p, [&](long i, auto keep) {
        const d4 entries = keep(load(scratch + i));
        sums += entries * entries;
    });
    return sum_of(sums);
}

// Calls a function for each piece of a thread, (piece, its number), and waits for the other threads.
template <class Do>
void on_pieces(Workspace& w, const ThreadShare& share, Do act) {
    for (Piece& p : share) act(p, &p - w.pieces.data);
    w.barrier.wait();
}

}  // namespace

void iterate_swept(Workspace& w, const System& system, const Options& options, const double* g, const double* x0,
                   double* x, SolveResult* result) {
    const Layout& layout = system.layout();
    const ThreadShare share = share_of_thread(w);
    const bool reports = omp_get_thread_num() == 0;
    const auto stop = [&](long iterations, double residual, Reason reason, long block) {
        if (reports) *result = {iterations, residual, reason, block, 0, 1};
        for (const Piece& p : share) unpack(layout, p.blocks, w.start.data, x);
    };

    on_pieces(w, share, [&](Piece& p, long k) {
        start_vectors(w, system, g, x0, w.start.data, p);
        clear(w.x.data, p.own.begin, p.own.end);
        factor_diagonal(w.sweeps, system, p, w.scratch.data + k * layout.largest * layout.largest);
    });
    if (total(w, 0) > 0) return stop(0, NAN, kNotFinite, -1);
    if (total(w, 1) == 0) {
        for (const Piece& p : share) clear(w.start.data, p.own.begin, p.own.end);
        return stop(0, 0, kConverged, -1);
    }
    if (const Piece* const bad = first_bad(w)) return stop(0, NAN, bad->bad_status, layout.start[bad->bad_block]);

    scale_blocks(w.sweeps, system);
    if (x0 != nullptr)
        for (const Piece& p : share) multiply_piece(system, p, w.start.data);
    w.barrier.wait();
    double reference = 0, before = INFINITY;
    for (long iteration = 0;;) {
        on_pieces(w, share, [&](Piece& p, long) {
            gather(w, p);
            find_residual(w, layout, p);
            p.sums[0] = squared(p, w.residual.data);
            if (reference > 0) return;
            apply_inverse_factor(w.sweeps, layout, p, w.g.data);
            p.sums[1] = squared(p, w.g.data);
            pack(layout, p.blocks, g, w.g.data);
        });
        const double damped = total(w, 0);  // |r'|^2 = r^T D^-1 r
        if (reference == 0) reference = total(w, 1);
        double relative = damped / reference;
        if (reports && options.history != nullptr) options.history[iteration] = relative;
        if (!(relative < INFINITY)) return stop(iteration, relative, kNotFinite, -1);
        if (relative <= options.tolerance) return stop(iteration, relative, kConverged, -1);
        if (iteration == options.max_iterations) return stop(iteration, relative, kMaxIterations, -1);
        if (relative > kStagnant * before) return stop(iteration, relative, kTooFewDigits, -1);
        before = relative;

        double* const residual = w.residual.data;
        on_pieces(w, share, [&](Piece&, long k) { solve_lower_early(w.sweeps, k, residual); });
        on_pieces(w, share, [&](Piece&, long k) { solve_lower_late(w.sweeps, k, residual, residual); });
        on_pieces(w, share, [&](Piece& p, long) {
            clear(w.direction.data, p.own.begin, p.own.end);
            clear(w.preconditioned.data, p.own.begin, p.own.end);
            for_each_vector(layout, p, [&](long i, auto keep) { store(residual + i, keep(load(residual + i))); });
            p.sums[2] = squared(p, residual);
        });
        double swept = total(w, 2), step = 0, mix = 0;
        double ratio = damped / swept;
        const double aim = fmax(kAim * options.tolerance, kDigits * relative);
        Reason reason = kConverged;
        for (long since = 1; relative > aim && iteration < options.max_iterations; ++since) {
            on_pieces(w, share, [&](Piece& p, long k) { begin_direction(w, p, k, step, mix); });
            on_pieces(w, share, [&](Piece&, long k) { solve_upper_late(w.sweeps, k, w.preconditioned.data); });
            on_pieces(w, share, [&](Piece& p, long k) { begin_product(w, p, k); });
            on_pieces(w, share, [&](Piece& p, long k) { p.sums[0] = end_product(w, layout, p, k); });
            const double curvature = total(w, 0);
            if (!(curvature > 0 && curvature < INFINITY)) {
                step = 0;
                if (curvature <= 0 && curvature > -INFINITY) {
                    on_pieces(w, share, [&](Piece& p, long) { p.sums[1] = squared(p, w.preconditioned.data); });
                    reason = curvature < -kRounding * total(w, 1) ? kNotPositiveDefinite : kTooFewDigits;
                } else {
                    reason = kNotFinite;
                }
                break;
            }
            step = swept / curvature;
            on_pieces(w, share, [&](Piece& p, long) { p.sums[1] = step_residual(w, p, step); });
            const double next = total(w, 1);
            mix = next / swept;
            swept = next;
            ++iteration;
            relative = ratio * swept / reference;
            if (relative > kEarly * aim && options.history == nullptr && since % kSeldom != 0) continue;
            on_pieces(w, share, [&](Piece& p, long k) { p.sums[2] = squared_true_residual(w, layout, p, k); });
            relative = total(w, 2) / reference;
            ratio = relative * reference / swept;
            if (reports && options.history != nullptr) options.history[iteration] = relative;
        }
        on_pieces(w, share, [&](Piece& p, long) {
            for (long i = p.own.begin; i < p.own.end; i += 4)
                store(&w.x.data[i], load(&w.x[i]) + step * load(&w.preconditioned[i]));
            take_solution(w, layout, p);
            clear(p.product, p.own.begin, p.own.end);
        });
        if (reason != kConverged) return stop(iteration, relative, reason, -1);
        for (const Piece& p : share) multiply_piece(system, p, w.start.data);
        w.barrier.wait();
    }
}

}  // namespace yasps
