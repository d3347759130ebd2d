// The system of a solve, cut into pieces: what the files of conjugate gradients share.
#pragma once

#include "core/runtime.h"
#include "solvers/preconditioner.h"

namespace yasps {

// The parts of H, whose sum it is. All have the same layout.
struct System {
    int parts;
    const Structure* const* structures;
    const double* const* values;

    const Layout& layout() const { return structures[0]->layout; }
    const Aggregates& aggregates() const { return structures[0]->aggregates; }
};

// Consecutive dof blocks: their rows of the matrix, and their share of all vectors.
struct Piece {
    Range blocks;
    Range own;        // the same in padded vectors
    long reach;       // end of what the product of its rows writes; it begins with the own part
    double* product;  // of its rows alone; only [own.begin, reach) exists
    bool* touched;    // whether a stretch of it behind the own part is written; only those up to reach exist
    double sums[3];   // what the piece adds to sums over all unknowns
    long bad_block;   // the first block that cannot be inverted, or -1
    Reason bad_status;
    char distance[40];  // neighbours in the list are written by different threads
};

// Stretches behind the own part.
inline Range stretches_of(const Piece& p) { return {p.own.end / kStretch, (p.reach + kStretch - 1) / kStretch}; }

// Whether every dof block is one vector, as in most scenes.
inline bool has_threes_only(const Layout& layout) { return layout.classes == 1 && layout.largest == 3; }

}  // namespace yasps
