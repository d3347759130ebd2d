// The coarse space of the two-level preconditioner z = D^-1 r + P (P^T H P)^-1 P^T r, D the diagonal blocks of H.
//
// A column of P moves all dof blocks of an aggregate by the same amount in one of their scalars: block Jacobi damps
// what differs between neighbours, these take what whole regions have in common (Nicolaides 1987, Deflation of
// conjugate gradients, SIAM J. Numer. Anal. 24; added as in Smith, Bjorstad & Gropp 1996, Domain Decomposition,
// sec. 2.1). Aggregates follow from the sparsity of the static part and stay while it does; numbers are those of each
// system, contacts included.
#pragma once

#include "core/runtime.h"
#include "core/team_barrier.h"

namespace yasps {

// Neighbours add to different ones, so that they need not wait for each other.
constexpr long kCopies = 2;

struct CoarseSpace {
    long unknowns = 0;
    long length = 0;             // of padded vectors, without the place for blocks that take no part
    long stride = 0;             // between rows of the matrix
    long restricted_length = 0;  // of a copy of a piece's restricted residual: `length`, and a place for these blocks
    Buffer<int> place;           // [blocks]: where a block's aggregate begins in padded vectors, or `length`
    Buffer<double> matrix;       // [unknowns, stride]: P^T H P, and then minus its inverse
    Buffer<double> panel;        // columns that are being eliminated, as rows
    Buffer<double> idle;         // [threads, stride]: where rows without a meaning go
    Buffer<double> restricted;   // [pieces, kCopies, restricted_length]: P^T r of each piece, as sum of copies
    Buffer<double> sum;          // [threads, restricted_length]: their sum, for each thread
    Buffer<double> residual;     // [threads, stride]: the same without gaps
    Buffer<double> solution;     // padded, zero behind `length`
};

// The parts of H; as in a solve.
struct Parts {
    int count;
    const Structure* const* structures;
    const double* const* values;
};

// Groups the dof blocks by the couplings of this structure, unless that is done. False: out of memory.
bool find_aggregates(const Structure& structure);
// Memory for a system with these aggregates. False: there is none.
bool reserve_coarse_space(CoarseSpace& c, const Structure& structure, long pieces, long threads);

// Where these blocks take part. A diagonal block that is the identity stands for fixed unknowns: they stay out, so that
// nothing moves them. inverse: of the diagonal blocks.
void place_blocks(CoarseSpace& c, const Structure& structure, const double* inverse, Range blocks);

// What all threads of a region do together. The coarse matrix, after place_blocks of all blocks and a barrier; false
// where it is not positive definite or not finite, on all threads. Ends with a barrier.
bool make_coarse_matrix(CoarseSpace& c, const Parts& parts, TeamBarrier& barrier);
// This thread's share of the solution for the sum of `pieces` restricted residuals. After a barrier, coarse_product is
// residual^T (P^T H P)^-1 residual.
void solve_coarse(CoarseSpace& c, const Aggregates& aggregates, long pieces);
double coarse_product(const CoarseSpace& c, const Aggregates& aggregates);

}  // namespace yasps
