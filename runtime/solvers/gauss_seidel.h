// Symmetric block Gauss-Seidel as preconditioner: M = (D + L) D^-1 (D + L)^T, D the diagonal blocks of H. L is what
// lies below them in an order of its own, of 3x3 blocks and within a pair of pieces.
//
// In that order the first piece of a pair runs down to where it meets the second one, and the second runs up to there;
// last come those rows of the second that are coupled with the first, by contacts as well. So both are swept side by
// side and nothing between them is left out (a twisted factorisation: van der Vorst 1987, Large tridiagonal and block
// tridiagonal linear systems on vector and parallel computers, Parallel Computing 5). What couples pairs is not in L:
// there fewer are better.
//
// Conjugate gradients run on (D + L)^-1 H (D + L)^-T, of which a product takes two sweeps and no product with H
// (Eisenstat 1981, Efficient implementation of a class of preconditioned conjugate gradient methods, SIAM J. Sci. Stat.
// Comput. 2). With C C^T = D the system is first scaled to H' = C^-1 H C^-T, x' = C^T x, g' = C^-1 g. H' has unit
// diagonal blocks; in it L is part of a unit lower triangle and E all else that lies off the diagonal. So for
// t = (I + L)^-T p:
//     (I + L)^-1 H' (I + L)^-T p = t + (I + L)^-1 (p - t + E t).
// Vectors of that system are called swept. The residual r' is (I + L) times the swept one, and |r'|^2 = r^T D^-1 r.
//
// H' is stored as a list of products y += B x in the order in which they are needed, each block of the upper triangle
// twice. Sweeps scatter what they have found: when it is a row's turn, its number is complete. So a sweep is a loop
// without branches.
#pragma once

#include "core/runtime.h"
#include "solvers/pieces.h"

namespace yasps {

// y += B x for a 3x3 block; offsets into padded vectors.
struct Product {
    int from, to;
};

// The same for any other shape.
struct OtherProduct {
    int from, to, rows, cols;
    long block;  // where its rows begin in `others`
};

// The products that one block off the diagonal, and its transpose, are for; of the list for its shape.
struct Uses {
    int straight, turned;
};

// Products of L, or of its transpose, of a piece: first those that need nothing of the other piece of the pair, or that
// the other needs first; `cross` are those from the other piece.
struct Sweep {
    Range early, cross, late;
};

// What a part has of L, of its transpose, and of E, [pieces]; and where what comes from a dof block ends in the first
// two.
struct Lists {
    Buffer<Sweep> down, up;
    Buffer<Range> between;
    Buffer<int> down_end, up_end;  // [dof blocks]
};

// A sweep takes products of the static part up to the first, and then those of the moving part up to the second.
struct Stop {
    int fixed, moving;
};

// The stops of a piece.
struct Stops {
    Range early, late;
};

struct GaussSeidel {
    Buffer<double> factors;  // C^-T of each diagonal block, rows padded
    Buffer<int> piece_of;    // [dof blocks]
    Buffer<Product> products;
    Buffer<float> blocks;  // [products, 9], columns of B
    Buffer<OtherProduct> other_products;
    Buffer<float> others;
    Buffer<Uses> uses;  // of the blocks of all parts, one part after another
    Lists fixed, moving;
    Buffer<Stop> stops;
    Buffer<Stops> down_stops, up_stops;  // [pieces]
    Buffer<Range> other;                 // [pieces]: of other shapes, all parts
    Buffer<char> late, next_late;        // [dof blocks]: rows of a second piece that are coupled with the first
    Buffer<long> next;                   // scratch

    // What the lists of the static part were made for.
    long build = 0, piece_count = 0;
    long fixed_end = 0;  // of its products
};

// Whether the static part couples enough 3x3 blocks.
bool can_sweep(const Structure& structure);
// Lists all products, before the region. False: out of memory.
bool list_products(GaussSeidel& s, const System& system, const Piece* pieces, long piece_count);

// Finds C^-T of this piece's diagonal blocks. scratch: the square of the largest block.
void factor_diagonal(GaussSeidel& s, const System& system, Piece& piece, double* scratch);
// Fills in this thread's share of H', once all factors are there.
void scale_blocks(GaussSeidel& s, const System& system);

// v = C^-1 v and v = C^-T v for a piece's share.
void apply_inverse_factor(const GaussSeidel& s, const Layout& layout, const Piece& piece, double* v);
void apply_inverse_factor_transposed(const GaussSeidel& s, const Layout& layout, const Piece& piece, double* v);

// For the piece number k; numbers in gaps of padded vectors lose their meaning.
// v = (I + L)^-T v and v = (I + L)^-1 v: of all pieces first the early, then, after a barrier, the late part. other: v
// of the piece before.
void solve_upper_early(const GaussSeidel& s, long k, double* v);
void solve_upper_late(const GaussSeidel& s, long k, double* v);
void solve_lower_early(const GaussSeidel& s, long k, double* v);
void solve_lower_late(const GaussSeidel& s, long k, const double* other, double* v);
// v += E t
void add_between(const GaussSeidel& s, long k, const double* t, double* v);
// v += L x
void add_lower(const GaussSeidel& s, long k, const double* x, double* v);

}  // namespace yasps
