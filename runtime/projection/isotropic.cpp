// Projection of the Hessians of isotropic energies onto the positive semidefinite cone.
//
// If an energy psi(F), F 3x3 or 3x2, does not change under F -> R F Q for rotations R and Q, and F = U S V^T with
// rotations U and V, then its Hessian falls apart in the basis of the matrices u_i v_j^T: into one block of the i = j,
// and for each i < j a block [[a, b], [b, a]] of (i, j) and (j, i), with eigenvalues a + b (flip) and a - b (twist);
// of a 3x2 F, u_3 v_1^T and u_3 v_2^T remain, each an eigenvector. So one 3x3 eigenproblem takes the place of a 9x9.
// (Smith, de Goes and Kim 2019, "Analytic eigensystems for isotropic distortion energies". Their derivatives by
// singular values are not needed: the blocks are read off the Hessian that is there.) U and V need not be unique: any
// singular value decomposition does, so equal, zero and negative singular values are no special cases.
//
// What is a chain of operations that wait for each other is done for sixteen matrices at once, the rest for eight.
#include "core/runtime.h"
#include "core/vectors.h"
#include "projection/semidefinite_check.h"
#include "projection/singular_values.h"

namespace yasps {
namespace {

// The blocks of h in the basis u_i v_j^T. Those that an F of two columns does not have are zero, and so are the blocks
// that an F of three columns does not have.
template <class V>
struct Blocks {
    Symmetric<V> same;      // of all u_i v_i^T
    V alike[3], across[3];  // of the pair without index k: [[alike, across], [across, alike]]
    V last[2];              // of u_3 v_1^T and u_3 v_2^T, for an F of two columns
};

// A 3 x cols matrix, row by row.
template <int cols>
struct Matrix {
    Eight at[3 * cols];
};
// a b^T.
template <int cols>
inline Matrix<cols> outer(const Vector<Eight>& a, const Vector<Eight>& b) {
    Matrix<cols> m;
#pragma GCC unroll 9
    for (int k = 0; k < 3 * cols; ++k) m.at[k] = a.at[k / cols] * b.at[k % cols];
    return m;
}
template <int cols>
inline Matrix<cols> operator+(const Matrix<cols>& a, const Matrix<cols>& b) {
    Matrix<cols> m;
#pragma GCC unroll 9
    for (int k = 0; k < 3 * cols; ++k) m.at[k] = a.at[k] + b.at[k];
    return m;
}
template <int cols>
inline Matrix<cols> operator-(const Matrix<cols>& a, const Matrix<cols>& b) {
    Matrix<cols> m;
#pragma GCC unroll 9
    for (int k = 0; k < 3 * cols; ++k) m.at[k] = a.at[k] - b.at[k];
    return m;
}
template <int cols>
inline Vector<Eight> times(const Matrix<cols>& m, const Vector<Eight>& b) {
    Vector<Eight> result;
#pragma GCC unroll 3
    for (int r = 0; r < 3; ++r) {
        result.at[r] = m.at[r * cols] * b.at[0] + m.at[r * cols + 1] * b.at[1];
        if (cols == 3) result.at[r] = result.at[r] + m.at[r * cols + 2] * b.at[2];
    }
    return result;
}

// Entry k of a pack of matrices.
inline Eight load_entry(const double* h, int k) {
    Eight entry;
    load_lanes(h + k * kLanes, &entry);
    return entry;
}
// Where entry (r, s) of a matrix is, r <= s.
template <int cols>
constexpr int entry_at(int r, int s) {
    return r * 3 * cols - r * (r - 1) / 2 + s - r;
}

// h x.
template <int cols>
inline Matrix<cols> multiply(const double* h, const Matrix<cols>& x) {
    constexpr int n = 3 * cols;
    Matrix<cols> hx;
#pragma GCC unroll 9
    for (int r = 0; r < n; ++r) hx.at[r] = load_entry(h, r) * x.at[0];
#pragma GCC unroll 9
    for (int r = 0; r < n; ++r) {
#pragma GCC unroll 9
        for (int s = r > 0 ? r : 1; s < n; ++s) {
            const Eight entry = load_entry(h, entry_at<cols>(r, s));
            hx.at[r] = hx.at[r] + entry * x.at[s];
            if (r > 0 && s > r) hx.at[s] = hx.at[s] + entry * x.at[r];
        }
    }
    return hx;
}

// h is known to consist of blocks, so its product with one matrix and a few sums of its entries tell all of them.
template <int cols>
Blocks<Eight> blocks_of(const double* h, const Columns<Eight>& u, const Columns<Eight>& v) {
    Blocks<Eight> found = {};
    Symmetric<Eight>& same = found.same;
    if (cols == 3) {
        // u_i v_j^T of all i <= j.
        const Vector<Eight> two = v.c[1] + v.c[2];
        const Matrix<cols> image = multiply<cols>(
            h, outer<cols>(u.c[0], v.c[0] + two) + outer<cols>(u.c[1], two) + outer<cols>(u.c[2], v.c[2]));
        const Vector<Eight> right[3] = {times(image, v.c[0]), times(image, v.c[1]), times(image, v.c[2])};
        found.alike[0] = dot(u.c[1], right[2]), found.across[0] = dot(u.c[2], right[1]);
        found.alike[1] = dot(u.c[0], right[2]), found.across[1] = dot(u.c[2], right[0]);
        found.alike[2] = dot(u.c[0], right[1]), found.across[2] = dot(u.c[1], right[0]);
        // The sum of the 3x3 blocks of h on the diagonal has, for v_j, the sum of the entries of all u_i v_j^T.
        const auto sum = [h](int a, int b) {
            return load_entry(h, entry_at<cols>(a, b)) + load_entry(h, entry_at<cols>(3 + a, 3 + b)) +
                   load_entry(h, entry_at<cols>(6 + a, 6 + b));
        };
        const Symmetric<Eight> sums = {{sum(0, 0), sum(1, 1), sum(2, 2)}, {sum(1, 2), sum(0, 2), sum(0, 1)}};
        const Eight first = dot(v.c[0], times(sums, v.c[0])), second = dot(v.c[1], times(sums, v.c[1]));
        const Eight third = sums.diagonal[0] + sums.diagonal[1] + sums.diagonal[2] - first - second;
        same.diagonal[0] = first - found.alike[1] - found.alike[2];
        same.diagonal[1] = second - found.alike[0] - found.alike[2];
        same.diagonal[2] = third - found.alike[0] - found.alike[1];
        // Sums of the two entries beside the diagonal.
        const Eight x = dot(u.c[0], right[0]) - same.diagonal[0], y = dot(u.c[1], right[1]) - same.diagonal[1];
        const Eight z = dot(u.c[2], right[2]) - same.diagonal[2];
        same.opposite[0] = (y + z - x) * 0.5;
        same.opposite[1] = (x + z - y) * 0.5;
        same.opposite[2] = (x + y - z) * 0.5;
    } else {
        // All of u_i v_j^T but u_2 v_1^T.
        const Matrix<cols> image =
            multiply<cols>(h, outer<cols>(u.c[0] + u.c[2], v.c[0] + v.c[1]) + outer<cols>(u.c[1], v.c[1]));
        const Vector<Eight> right[2] = {times(image, v.c[0]), times(image, v.c[1])};
        found.alike[2] = dot(u.c[0], right[1]);
        found.across[2] = dot(u.c[1], right[0]);
        found.last[0] = dot(u.c[2], right[0]);
        found.last[1] = dot(u.c[2], right[1]);
        const Eight first = dot(u.c[0], right[0]), second = dot(u.c[1], right[1]);
        Eight both = found.alike[2] * -2.0 - found.last[0] - found.last[1];
#pragma GCC unroll 6
        for (int k = 0; k < 6; ++k) both = both + load_entry(h, entry_at<cols>(k, k));
        same.diagonal[0] = (both + first - second) * 0.5;
        same.diagonal[1] = (both + second - first) * 0.5;
        same.opposite[2] = first - same.diagonal[0];
    }
    return found;
}

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
    Matrix<cols> mode[9];
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
            const Matrix<cols> two = outer<cols>(u.c[0] * a, v.c[0]) + outer<cols>(u.c[1] * b, v.c[1]);
            return cols == 3 ? two + outer<cols>(u.c[2] * c, v.c[2]) : two;
        });
#pragma GCC unroll 3
    for (int i = 0; i < cols; ++i) {
#pragma GCC unroll 3
        for (int j = i + 1; j < cols; ++j) {
            const Eight alike = blocks.alike[3 - i - j], across = blocks.across[3 - i - j];
            // A flip where `across` is negative, else a twist; and the other.
            const Vector<Eight> turned = u.c[j] * with_sign(constant<Eight>(1), Eight{} - across);
            modes->add(alike - magnitude(across), 2,
                       [&] { return outer<cols>(u.c[i], v.c[j]) + outer<cols>(turned, v.c[i]); });
            modes->add(alike + magnitude(across), 2,
                       [&] { return outer<cols>(u.c[i], v.c[j]) - outer<cols>(turned, v.c[i]); });
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

// 2^(sign e), with numbers v of about 2^e; normal numbers, also where v is not.
template <class V>
inline V power_of_two(V v, int sign) {
    return each(
        [sign](Register x) {
            const RegisterMask biased = (RegisterMask(x) >> 52) & 0x7ff;
            const RegisterMask below = biased < 2 ? RegisterMask{} + 2 : biased;
            const RegisterMask exponent = below > 2044 ? RegisterMask{} + 2044 : below;
            return Register((1023 + sign * (exponent - 1023)) << 52);
        },
        v);
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
// Bits of lanes whose Hessian is not too close to the ends of the number range for sums and products of its entries.
inline unsigned lanes_in_range(const Sixteen& size) {
    const auto tiny = less(size, constant<Sixteen>(1e-290)) & less(Sixteen{}, size);
    return bits_of(less(size, constant<Sixteen>(1e290))) & ~bits_of(tiny);
}

// Projects some lanes of a group by the eigenvalues of the whole matrices.
template <int cols>
__attribute__((noinline)) NegativePart project_generally(const Group& group, unsigned lanes, bool flip) {
    constexpr int width = 3 * cols, entries = width * (width + 1) / 2;
    const size_t scratch = static_cast<size_t>(negative_part_scratch(width)) * sizeof(double);
    alignas(64) double whole[entries * kCollected], sizes[kCollected];
    const auto in_group = [&group](int k, int lane) -> double& {
        return group.matrices[lane / kLanes][k * kLanes + lane % kLanes];
    };
    for (int k = 0; k < entries; ++k)
        for (int lane = 0; lane < kCollected; ++lane)
            whole[k * kCollected + lane] = lanes >> lane & 1 ? in_group(k, lane) : 0.0;
    NegativePart result = {0, sizes_of(whole, entries, group.halves, sizes)};
    if (result.unfinished != 0) return result;
    remove_negative_part(whole, kCollected, sizes, width, group.halves, flip,
                         static_cast<double*>(__builtin_alloca_with_align(scratch, 8 * sizeof(d8))), &result);
    for (int k = 0; k < entries; ++k)
        for (int lane = 0; lane < kCollected; ++lane)
            if (lanes >> lane & 1) in_group(k, lane) = whole[k * kCollected + lane];
    return {result.changed & lanes, result.unfinished & lanes};
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
    for (int k = 0; k < group.halves; ++k) blocks[k] = blocks_of<cols>(group.matrices[k], half(u, k), half(v, k));
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
    if (failed != 0) result = project_generally<cols>(group, failed, flip);
    for (int k = 0; k < group.halves; ++k) {
        double* const h = group.matrices[k];
#pragma GCC unroll 3
        for (int i = 0; i < 3; ++i) blocks[k].same.diagonal[i] = half(same.diagonal[i] * up, k);
        Eight trace = {};
#pragma GCC unroll 9
        for (int i = 0; i < width; ++i) trace = trace + magnitude(load_entry(h, entry_at<cols>(i, i)));
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
