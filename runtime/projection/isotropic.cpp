// Projection of the Hessians of isotropic energies onto the positive semidefinite cone, by their blocks
// (isotropic_blocks.h).
//
// What is a chain of operations that wait for each other is done for sixteen matrices at once, the rest for eight.
#include "core/runtime.h"
#include "core/vectors.h"
#include "projection/cone.h"
#include "projection/groups.h"
#include "projection/isotropic_blocks.h"

namespace yasps {
namespace {

Eight smallest_eigenvalue(const Blocks<Eight>& blocks) {
    const auto smaller = [](Eight a, Eight b) { return select(less(a, b), a, b); };
    Eight smallest = smaller(blocks.last[0], blocks.last[1]);
#pragma GCC unroll 3
    for (int k = 0; k < 3; ++k) {
        smallest = smaller(smallest, blocks.same.diagonal[k]);
        smallest = smaller(smallest, blocks.alike[k] - magnitude(blocks.across[k]));
    }
    return smallest;
}

// Eigenvectors with negative eigenvalues in any of some lanes, and what is missing of each eigenvalue.
template <int cols>
struct Modes {
    Mask<Eight> lanes;
    double factor;  // of a negative eigenvalue, missing to make it zero (1) or to change its sign (2)
    Matrix<cols, Eight> mode[9];
    Eight missing[9];
    int count;

    // make() gives the eigenvector, with the squared norm that is given.
    template <class Make>
    void add(Eight eigenvalue, double squared_norm, const Make& make) {
        const auto negative = less(eigenvalue, Eight{}) & lanes;
        if (bits_of(negative) == 0) return;
        missing[count] = select(negative, eigenvalue * (-factor / squared_norm), Eight{});
        mode[count++] = make();
    }
};
// The smaller eigenvalues of blocks come first, so that those that are negative in any lane are few.
template <int cols>
void find_modes(const Blocks<Eight>& blocks, const Columns<Eight>& e, const Columns<Eight>& u, const Columns<Eight>& v,
                Modes<cols>* modes) {
#pragma GCC unroll 3
    for (int k = cols - 1; k >= 0; --k)
        modes->add(blocks.same.diagonal[k], 1, [&] {
            const auto& [a, b, c] = e.c[k].at;
            const Matrix<cols, Eight> two = outer<cols>(u.c[0] * a, v.c[0]) + outer<cols>(u.c[1] * b, v.c[1]);
            return cols == 3 ? two + outer<cols>(u.c[2] * c, v.c[2]) : two;
        });
#pragma GCC unroll 3
    for (int i = 0; i < cols; ++i) {
#pragma GCC unroll 3
        for (int j = i + 1; j < cols; ++j) {
            const Eight alike = blocks.alike[3 - i - j], across = blocks.across[3 - i - j];
            // A flip where `across` is negative, else a twist; and the other.
            const Eight sign = with_sign(constant<Eight>(1), across);
            const auto mode = [&](Eight side) {
                return outer<cols>(u.c[i], v.c[j]) + outer<cols>(u.c[j] * side, v.c[i]);
            };
            modes->add(alike - magnitude(across), 2, [&] { return mode(Eight{} - sign); });
            modes->add(alike + magnitude(across), 2, [&] { return mode(sign); });
        }
    }
    for (int j = 0; j < 2 && cols == 2; ++j) modes->add(blocks.last[j], 1, [&] { return outer<cols>(u.c[2], v.c[j]); });
}

// Adds missing mode mode^T of all modes to a pack of matrices.
template <int cols>
void add_modes(const Modes<cols>& modes, double* h) {
    constexpr int n = 3 * cols;
#pragma GCC unroll 9
    for (int r = 0; r < n; ++r) {
        Eight row[n];
#pragma GCC unroll 9
        for (int s = r; s < n; ++s) row[s] = load_entry(h, s - r);
        for (int k = 0; k < modes.count; ++k) {
            const Eight* const mode = modes.mode[k].at;
            const Eight scaled = modes.missing[k] * mode[r];
#pragma GCC unroll 9
            for (int s = r; s < n; ++s) row[s] = row[s] + scaled * mode[s];
        }
#pragma GCC unroll 9
        for (int s = r; s < n; ++s, h += kLanes) store_lanes(h, select(modes.lanes, row[s], load_entry(h, 0)));
    }
}

// Columns of the deformations of a group, scaled to about one by powers of two. Those that are not finite are zero, and
// their bits are set in `failed`.
template <int cols>
Columns<Sixteen> scaled_columns(const Group& group, unsigned* failed) {
    const double* const second = group.companions[group.halves - 1];  // any numbers do if there is none
    Sixteen entries[3 * cols], sum = {};
#pragma GCC unroll 9
    for (int k = 0; k < 3 * cols; ++k) {
        entries[k] = pair(load_entry(group.companions[0], k), load_entry(second, k));
        sum = sum + magnitude(entries[k]);
    }
    const auto finite = less(sum, constant<Sixteen>(INFINITY));
    *failed = bits_of(finite) ^ 0xffffu;
    const Sixteen scale = power_of_two(sum, -1);
    Columns<Sixteen> f = {};
#pragma GCC unroll 3
    for (int r = 0; r < 3; ++r)
#pragma GCC unroll 3
        for (int c = 0; c < cols; ++c) f.c[c].at[r] = select(finite, entries[r * cols + c] * scale, Sixteen{});
    return f;
}

inline Eight half(const Sixteen& v, int k) { return k == 0 ? v.first : v.second; }
inline Columns<Eight> half(const Columns<Sixteen>& from, int k) {
    Columns<Eight> to;
#pragma GCC unroll 3
    for (int c = 0; c < 3; ++c)
#pragma GCC unroll 3
        for (int r = 0; r < 3; ++r) to.c[c].at[r] = half(from.c[c].at[r], k);
    return to;
}

// The sum of the absolute values of all blocks' entries, which is about the size of the matrix. Not finite where an
// entry of the matrix is not.
inline Eight size_of_blocks(const Blocks<Eight>& blocks) {
    Eight size = magnitude(blocks.last[0]) + magnitude(blocks.last[1]);
#pragma GCC unroll 3
    for (int k = 0; k < 3; ++k)
        size = size + (magnitude(blocks.same.diagonal[k]) + magnitude(blocks.same.opposite[k])) +
               (magnitude(blocks.alike[k]) + magnitude(blocks.across[k]));
    return size;
}
// Projects the matrices of a group.
template <int cols>
NegativePart project_group(const Group& group, bool flip) {
    constexpr int width = 3 * cols;
    unsigned failed;
    Columns<Sixteen> u, v, e;
    const Columns<Sixteen> f = scaled_columns<cols>(group, &failed);
    failed |= singular_frames<cols>(f, u, v);

    Blocks<Eight> blocks[2];
    if (group.halves == 1) blocks[1] = {};
    for (int k = 0; k < group.halves; ++k) {
        const double* const h = group.matrices[k];
        blocks[k] = blocks_of<cols>([h](int entry) { return load_entry(h, entry); }, half(u, k), half(v, k));
    }
    const Sixteen size = pair(size_of_blocks(blocks[0]), size_of_blocks(blocks[1]));
    failed |= ~lanes_in_range(size);
    const Sixteen down = power_of_two(size, -1), up = power_of_two(size, 1);
    Symmetric<Sixteen> same;
#pragma GCC unroll 3
    for (int i = 0; i < 3; ++i) {
        same.diagonal[i] = pair(blocks[0].same.diagonal[i], blocks[1].same.diagonal[i]) * down;
        same.opposite[i] = pair(blocks[0].same.opposite[i], blocks[1].same.opposite[i]) * down;
    }
    failed |= diagonalise<cols>(same, e);

    NegativePart result = {};
    failed &= group.lanes;
    if (failed != 0) result = project_generally<width>(group, failed, flip);
    for (int k = 0; k < group.halves; ++k) {
        double* const h = group.matrices[k];
#pragma GCC unroll 3
        for (int i = 0; i < 3; ++i) blocks[k].same.diagonal[i] = half(same.diagonal[i] * up, k);
        Eight trace = {};
#pragma GCC unroll 9
        for (int i = 0; i < width; ++i) trace = trace + magnitude(load_entry(h, place_of<width>(i, i)));
        Modes<cols> modes;
        mask_lanes((group.lanes & ~failed) >> k * kLanes, &modes.lanes);
        modes.lanes = modes.lanes & less(smallest_eigenvalue(blocks[k]), trace * -kProjectionShift);
        const unsigned changed = bits_of(modes.lanes);
        result.changed |= changed << (k * kLanes);
        if (changed == 0) continue;
        modes.factor = flip ? 2 : 1;
        modes.count = 0;
        find_modes<cols>(blocks[k], half(e, k), half(u, k), half(v, k), &modes);
        add_modes<cols>(modes, h);
    }
    return result;
}

template <int cols>
long project(double* packed, const double* deformation, long lanes, Mode mode) {
    constexpr int width = 3 * cols;
    const Packs packs = {packed, deformation, width, width, lanes};
    alignas(64) double memory[(width * (width + 1) / 2 + width) * kCollected];
    return project_failing<width, 1>(packs, memory, mode == kLeave, [mode](const Group& group) {
        return project_group<cols>(group, mode == kAbsolute);
    });
}

}  // namespace
}  // namespace yasps

extern "C" {

// As yasps_project, for Hessians with respect to the entries of F, row by row, of an energy that depends on F only
// through its singular values. width: 9 for an F of 3x3, 6 for one of 3x2; deformation[k * 8 + lane] is entry k of F,
// row by row, packs follow each other as those of `packed` do. The result is that of yasps_project up to rounding, and
// so is what is returned. A matrix whose F is not finite is projected without it.
long yasps_project_isotropic(double* packed, const double* deformation, int width, int lanes, int mode) {
    using namespace yasps;
    if (width == 9) return project<3>(packed, deformation, lanes, static_cast<Mode>(mode));
    if (width == 6) return project<2>(packed, deformation, lanes, static_cast<Mode>(mode));
    return yasps_project(packed, width, lanes, mode);
}
}
