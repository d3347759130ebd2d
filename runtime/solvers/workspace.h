// Memory of a solve and its pieces, shared by both forms of conjugate gradients.
#pragma once

#include "core/runtime.h"
#include "core/team_barrier.h"
#include "solvers/coarse_space.h"
#include "solvers/gauss_seidel.h"
#include "solvers/pieces.h"

namespace yasps {

// Memory of the solver, kept between solves.
struct Workspace {
    Buffer<double> x, g, residual, direction, preconditioned;  // padded vectors
    Buffer<double> products;                                   // of all pieces, one after another
    Buffer<bool> touched;                                      // the same for stretches
    Buffer<double> inverse;                                    // inverted diagonal blocks
    Buffer<double> scratch;                                    // one diagonal block per piece
    Buffer<Piece> pieces;
    CoarseSpace coarse;
    TeamBarrier barrier;
    GaussSeidel sweeps;
    Buffer<double> start, image;  // padded, with sweeps: the start vector and what was found since; H' direction, swept
    long piece_count = 0;
};

// Layout shared with runtime/solvers/pcg.py.
struct SolveResult {
    long iterations;
    double relative_residual;
    long reason;
    long block;   // scalar offset of the diagonal block to blame, or -1
    long coarse;  // 1: with the coarse space, -1: it was asked for and is not positive definite, else 0
    long sweeps;  // 1: with sweeps, -1: they had too few digits, else 0
};

// As _KINDS in runtime/solvers/pcg.py.
enum Preconditioner : int { kJacobi = 0, kTwoLevel = 1, kGaussSeidel = 2 };

struct Options {
    double tolerance;
    long max_iterations;
    double* history;  // [max_iterations + 1] or null
    bool coarse;      // with the coarse space
};

// The pieces of one thread.
struct ThreadShare {
    Piece *first, *last;
    Piece* begin() const { return first; }
    Piece* end() const { return last; }
};

inline ThreadShare share_of_thread(Workspace& w) {
    const Range range = piece(w.piece_count, omp_get_thread_num(), omp_get_num_threads());
    return {w.pieces.data + range.begin, w.pieces.data + range.end};
}

inline void clear(double* vector, long begin, long end) {
    if (end > begin) memset(vector + begin, 0, static_cast<size_t>(end - begin) * sizeof(double));
}

// Calls f(begin, end) for what the rows of a piece write in a range behind them.
template <class F>
void for_each_touched(const Piece& p, Range range, F f) {
    for (long stretch = range.begin / kStretch; stretch * kStretch < range.end; ++stretch) {
        if (!p.touched[stretch]) continue;
        const long begin = stretch * kStretch, end = begin + kStretch;
        f(begin < range.begin ? range.begin : begin, end < range.end ? end : range.end);
    }
}

// Makes the product ready for multiply_piece.
inline void start_product(const System& system, const Piece& p) {
    const Range stretches = stretches_of(p);
    for (long stretch = stretches.begin; stretch < stretches.end; ++stretch) p.touched[stretch] = false;
    for (int part = 0; part < system.parts; ++part) mark_stretches(*system.structures[part], p.own, p.touched);
    clear(p.product, p.own.begin, p.own.end);
    for_each_touched(p, {p.own.end, p.reach}, [&](long begin, long end) { clear(p.product, begin, end); });
}

// product += H x for the rows of a piece; complete once gather has run after a barrier.
inline void multiply_piece(const System& system, const Piece& p, const double* x) {
    for (int part = 0; part < system.parts; ++part)
        multiply_rows(*system.structures[part], system.values[part], p.own, x, p.product);
}

// Adds what the rows of earlier pieces found for this one, in their order, and empties that. Later pieces write only
// to the right of their first row, since only the upper triangle is stored.
inline void gather(const Workspace& w, const Piece& p) {
    for (const Piece* from = w.pieces.data; from != &p; ++from) {
        const long reach = from->reach < p.own.end ? from->reach : p.own.end;
        for_each_touched(*from, {p.own.begin, reach}, [&](long begin, long end) {
            for (long i = begin; i < end; i += 4) {
                store(p.product + i, load(p.product + i) + load(from->product + i));
                store(from->product + i, d4{});
            }
        });
    }
}

inline double total(const Workspace& w, int which) {
    double sum = 0;
    for (long k = 0; k < w.piece_count; ++k) sum += w.pieces[k].sums[which];
    return sum;
}

inline double dot(Range range, const double* a, const double* b) {
    d4 first = {}, second = {};
    long i = range.begin;
    for (; i + 8 <= range.end; i += 8) {
        first += load(a + i) * load(b + i);
        second += load(a + i + 4) * load(b + i + 4);
    }
    for (; i < range.end; i += 4) first += load(a + i) * load(b + i);
    return sum_of(first + second);
}

// Vectors of a piece before the first iteration, x in `to`; two of its sums become whether g is not finite, and its
// largest entry.
inline void start_vectors(Workspace& w, const System& system, const double* g, const double* x, double* to, Piece& p) {
    const Layout& layout = system.layout();
    pack(layout, p.blocks, g, w.g.data);
    if (x != nullptr)
        pack(layout, p.blocks, x, to);
    else
        clear(to, p.own.begin, p.own.end);
    start_product(system, p);
    double largest = 0;
    bool finite = true;
    for (long i = p.own.begin; i < p.own.end; ++i) {
        const double magnitude = fabs(w.g[i]);
        finite = finite && magnitude < INFINITY;
        if (magnitude > largest) largest = magnitude;
    }
    p.sums[0] = finite ? 0 : 1;
    p.sums[1] = largest;
}

// The first piece with a diagonal block that cannot be inverted, or null.
inline const Piece* first_bad(const Workspace& w) {
    for (const Piece* p = w.pieces.data; p != w.pieces.data + w.piece_count; ++p)
        if (p->bad_block >= 0) return p;
    return nullptr;
}

// The body of the parallel region with the sweeps as preconditioner; pcg.cpp has the one with block Jacobi.
void iterate_swept(Workspace& w, const System& system, const Options& options, const double* g, const double* x0,
                   double* x, SolveResult* result);

}  // namespace yasps
