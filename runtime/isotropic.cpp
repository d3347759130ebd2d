// Projection of the Hessians of isotropic energies onto the positive semidefinite cone, eight at a time.
//
// If an energy psi(F), F 3x3 or 3x2, does not change under F -> R F Q for rotations R and Q, and F = U S V^T with
// rotations U and V, then its Hessian falls apart in the basis of the matrices u_i v_j^T: into one block of the i = j,
// and for each i < j a block [[a, b], [b, a]] of (i, j) and (j, i), with eigenvalues a + b (flip) and a - b (twist);
// of a 3x2 F, u_3 v_1^T and u_3 v_2^T remain, each an eigenvector. So one 3x3 eigenproblem takes the place of a 9x9.
// (Smith, de Goes and Kim 2019, "Analytic eigensystems for isotropic distortion energies". Their derivatives by
// singular values are not needed: the blocks are read off the Hessian that is there.) U and V need not be unique: any
// singular value decomposition does, so equal, zero and negative singular values are no special cases.
#include "runtime.h"
#include "semidefinite_check.h"
#include "singular_values.h"

namespace yasps {
namespace {

// Lanes of a pack that must fail for it to be worth decomposing as it is, with the lanes that did not.
constexpr int kWorthAPack = 6;

// The blocks of h in the basis u_i v_j^T. Those that an F of two columns does not have are zero, and so are the blocks
// that an F of three columns does not have.
struct Blocks {
    Symmetric same;          // of all u_i v_i^T
    d8 alike[3], across[3];  // of the pair without index k: [[alike, across], [across, alike]]
    d8 last[2];              // of u_3 v_1^T and u_3 v_2^T, for an F of two columns
};

// a b^T, row by row.
template <int cols>
struct Matrix {
    d8 at[3 * cols];
};
template <int cols>
inline Matrix<cols> outer(const Vector& a, const Vector& b) {
    Matrix<cols> m;
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < cols; ++c) m.at[r * cols + c] = a.at[r] * b.at[c];
    return m;
}
template <int cols>
inline Matrix<cols> operator+(const Matrix<cols>& a, const Matrix<cols>& b) {
    Matrix<cols> m;
    for (int k = 0; k < 3 * cols; ++k) m.at[k] = a.at[k] + b.at[k];
    return m;
}
template <int cols>
inline Matrix<cols> operator-(const Matrix<cols>& a, const Matrix<cols>& b) {
    Matrix<cols> m;
    for (int k = 0; k < 3 * cols; ++k) m.at[k] = a.at[k] - b.at[k];
    return m;
}
template <int cols>
inline Vector times(const Matrix<cols>& m, const Vector& b) {
    Vector result = {};
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < cols; ++c) result.at[r] += m.at[r * cols + c] * b.at[c];
    return result;
}

// h x and h y.
template <int cols>
inline void multiply(const d8* h, const Matrix<cols>& x, const Matrix<cols>& y, Matrix<cols>* hx, Matrix<cols>* hy) {
    constexpr int n = 3 * cols;
    *hx = *hy = {};
#pragma GCC unroll 9
    for (int r = 0; r < n; ++r) {
        const d8 diagonal = *h++;
        d8 sum_x = hx->at[r] + diagonal * x.at[r], sum_y = hy->at[r] + diagonal * y.at[r];
#pragma GCC unroll 9
        for (int s = r + 1; s < n; ++s) {
            const d8 entry = *h++;
            sum_x += entry * x.at[s];
            sum_y += entry * y.at[s];
            hx->at[s] += entry * x.at[r];
            hy->at[s] += entry * y.at[r];
        }
        hx->at[r] = sum_x;
        hy->at[r] = sum_y;
    }
}

// h is known to consist of blocks, so its products with two matrices and its trace tell all of them.
template <int cols>
Blocks blocks_of(const d8* h, const Columns& u, const Columns& v) {
    constexpr int n = 3 * cols;
    Blocks found = {};
    d8 trace = {};
    for (int i = 0, k = 0; i < n; k += n - i, ++i) trace += h[k];
    Matrix<cols> first, second;
    if (cols == 3) {
        // u_1 v_1^T and, of each pair i < j, u_i v_j^T; u_2 v_2^T.
        const Vector all = v.c[0] + v.c[1] + v.c[2];
        multiply<cols>(h, outer<cols>(u.c[0], all) + outer<cols>(u.c[1], v.c[2]), outer<cols>(u.c[1], v.c[1]), &first,
                       &second);
        const Vector right[3] = {times(first, v.c[0]), times(first, v.c[1]), times(first, v.c[2])};
        for (int k = 0; k < 3; ++k) {
            const int i = k == 0 ? 1 : 0, j = k == 2 ? 1 : 2;
            found.alike[k] = dot(u.c[i], right[j]);
            found.across[k] = dot(u.c[j], right[i]);
        }
        found.same.diagonal[0] = dot(u.c[0], right[0]);
        found.same.opposite[2] = dot(u.c[1], right[1]);
        found.same.opposite[1] = dot(u.c[2], right[2]);
        found.same.diagonal[1] = dot(u.c[1], times(second, v.c[1]));
        found.same.opposite[0] = dot(u.c[2], times(second, v.c[2]));
        found.same.diagonal[2] = trace - found.same.diagonal[0] - found.same.diagonal[1] -
                                 2.0 * (found.alike[0] + found.alike[1] + found.alike[2]);
    } else {
        // u_1 v_1^T, u_1 v_2^T and u_3 v_1^T; u_2 v_2^T and u_3 v_2^T.
        multiply<cols>(h, outer<cols>(u.c[0], v.c[0] + v.c[1]) + outer<cols>(u.c[2], v.c[0]),
                       outer<cols>(u.c[1] + u.c[2], v.c[1]), &first, &second);
        const Vector right[2] = {times(first, v.c[0]), times(first, v.c[1])}, other = times(second, v.c[1]);
        found.same.diagonal[0] = dot(u.c[0], right[0]);
        found.same.opposite[2] = dot(u.c[1], right[1]);
        found.same.diagonal[1] = dot(u.c[1], other);
        found.alike[2] = dot(u.c[0], right[1]);
        found.across[2] = dot(u.c[1], right[0]);
        found.last[0] = dot(u.c[2], right[0]);
        found.last[1] = dot(u.c[2], other);
    }
    return found;
}

// What becomes of the negative eigenvalues of some lanes.
struct Remedy {
    l8 lanes;
    double factor;  // 1: they become zero; 2: they change their sign

    // How much is missing of an eigenvalue.
    d8 weight(d8 eigenvalue) const { return select(lanes & (eigenvalue < 0.0), -factor * eigenvalue, d8{}); }
};

// Eigenvectors with negative eigenvalues, and what is missing of each.
template <int cols>
struct Modes {
    Matrix<cols> mode[9];
    d8 weight[9];
    int count = 0;

    void add(d8 missing, const Matrix<cols>& eigenvector) {
        mode[count] = eigenvector;
        weight[count++] = missing;
    }
};
template <int cols>
void find_modes(const Blocks& blocks, const Columns& e, const Columns& u, const Columns& v, Remedy remedy,
                Modes<cols>* modes) {
    for (int k = 0; k < 3; ++k) {
        const d8 weight = remedy.weight(blocks.same.diagonal[k]);
        if (!any(weight > 0.0)) continue;
        Matrix<cols> mode = outer<cols>(e.c[k].at[0] * u.c[0], v.c[0]) + outer<cols>(e.c[k].at[1] * u.c[1], v.c[1]);
        if (cols == 3) mode = mode + outer<cols>(e.c[k].at[2] * u.c[2], v.c[2]);
        modes->add(weight, mode);
    }
    for (int i = 0; i < cols; ++i) {
        for (int j = i + 1; j < cols; ++j) {
            const int k = 3 - i - j;
            // Half of each: the squared norm of u_i v_j^T + u_j v_i^T is 2.
            const d8 flip = 0.5 * remedy.weight(blocks.alike[k] + blocks.across[k]);
            const d8 twist = 0.5 * remedy.weight(blocks.alike[k] - blocks.across[k]);
            if (any(flip > 0.0)) modes->add(flip, outer<cols>(u.c[i], v.c[j]) + outer<cols>(u.c[j], v.c[i]));
            if (any(twist > 0.0)) modes->add(twist, outer<cols>(u.c[i], v.c[j]) - outer<cols>(u.c[j], v.c[i]));
        }
    }
    if (cols == 3) return;
    for (int j = 0; j < cols; ++j) {
        const d8 weight = remedy.weight(blocks.last[j]);
        if (any(weight > 0.0)) modes->add(weight, outer<cols>(u.c[2], v.c[j]));
    }
}

// Adds weight mode mode^T of all modes to the packed matrix h.
template <int cols>
void add_modes(const Modes<cols>& modes, d8* h) {
    constexpr int n = 3 * cols;
#pragma GCC unroll 9
    for (int r = 0; r < n; ++r) {
        d8 row[n];
#pragma GCC unroll 9
        for (int s = r; s < n; ++s) row[s] = h[s - r];
        for (int k = 0; k < modes.count; ++k) {
            const d8* const mode = modes.mode[k].at;
            const d8 scaled = modes.weight[k] * mode[r];
#pragma GCC unroll 9
            for (int s = r; s < n; ++s) row[s] += scaled * mode[s];
        }
#pragma GCC unroll 9
        for (int s = r; s < n; ++s) h[s - r] = row[s];
        h += n - r;
    }
}

d8 smallest_eigenvalue(const Blocks& blocks) {
    d8 smallest = {};
    for (int k = 0; k < 3; ++k) {
        smallest = minimum(smallest, blocks.same.diagonal[k]);
        smallest = minimum(smallest, blocks.alike[k] - magnitude(blocks.across[k]));
    }
    return minimum(smallest, minimum(blocks.last[0], blocks.last[1]));
}

// Columns of eight deformations, scaled to about one by powers of two; zero and listed in `failed` where that is
// impossible.
template <int cols>
Columns scaled_columns(const d8_unaligned* deformation, l8* failed) {
    d8 largest = {}, down, up;
    l8 finite = ~l8{};
    for (int k = 0; k < 3 * cols; ++k) {
        finite &= magnitude(deformation[k]) <= DBL_MAX;
        largest = maximum(magnitude(deformation[k]), largest);
    }
    *failed = ~finite;
    find_scales(largest, &down, &up);
    Columns f = {};
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < cols; ++c) f.c[c].at[r] = select(finite, deformation[r * cols + c] * down, d8{});
    return f;
}

struct Outcome {
    l8 changed;
    l8 failed;  // left as they are
};

// Projects these lanes of a pack in their places. largest: absolute value of the largest entry of each matrix.
template <int cols>
Outcome project_lanes(d8_unaligned* packed, const d8_unaligned* deformation, d8 largest, l8 lanes, Mode mode) {
    constexpr int width = 3 * cols, entries = width * (width + 1) / 2;
    Columns u, v, e;
    l8 failed;
    const Columns f = scaled_columns<cols>(deformation, &failed);
    failed |= singular_frames<cols>(f, u, v);
    d8 down, up, trace = {}, scaled[entries];
    find_scales(largest, &down, &up);
    for (int k = 0; k < entries; ++k) scaled[k] = select(lanes, packed[k] * down, d8{});
    for (int i = 0, k = 0; i < width; k += width - i, ++i) trace += magnitude(scaled[k]);
    Blocks blocks = blocks_of<cols>(scaled, u, v);
    failed |= diagonalise(blocks.same, e);
    failed &= lanes;
    const l8 changed = lanes & ~failed & (smallest_eigenvalue(blocks) < -kShift * trace);
    if (any(changed)) {
        Modes<cols> modes;
        find_modes<cols>(blocks, e, u, v, {changed, mode == kAbsolute ? 2.0 : 1.0}, &modes);
        add_modes<cols>(modes, scaled);
        for (int k = 0; k < entries; ++k) packed[k] = select(changed, scaled[k] * up, packed[k]);
    }
    return {changed, failed};
}

// Copies lane `from` of some vectors to lane `to` of others.
inline void copy_lane(const double* source, int from, double* target, int to, int vectors) {
    for (int k = 0; k < vectors; ++k) target[k * kLanes + to] = source[k * kLanes + from];
}

template <int cols>
struct Projection {
    static constexpr int kWidth = 3 * cols, kEntries = kWidth * (kWidth + 1) / 2;
    double* packed;
    const double* deformation;
    Mode mode;
    long changed;  // so far
    // Matrices that failed the check, drawn together from several packs so that all lanes are busy.
    d8 hessians[kEntries], deformations[kWidth], largest;
    long source[kLanes];
    int count;

    double* pack_of(long matrix) { return packed + matrix / kLanes * kEntries * kLanes; }

    // Projects a matrix for which the singular value decomposition failed. False: it is not finite.
    bool project_alone(long matrix) {
        double alone[kEntries * kLanes] = {};
        copy_lane(pack_of(matrix), static_cast<int>(matrix % kLanes), alone, 0, kEntries);
        const long result = yasps_project(alone, kWidth, 1, mode);
        if (result < 0) return false;
        copy_lane(alone, 0, pack_of(matrix), static_cast<int>(matrix % kLanes), kEntries);
        changed += result;
        return true;
    }

    // Projects these lanes of the pack that begins with matrix `first`. Returns 0 or -(1 + matrix).
    long project_pack(long first, d8 largest_entries, l8 lanes) {
        const Outcome outcome = project_lanes<cols>(reinterpret_cast<d8_unaligned*>(pack_of(first)),
                                                    reinterpret_cast<const d8_unaligned*>(deformation + first * kWidth),
                                                    largest_entries, lanes, mode);
        for (int lane = 0; lane < kLanes; ++lane) {
            changed -= outcome.changed[lane];
            if (outcome.failed[lane] && !project_alone(first + lane)) return -(1 + first + lane);
        }
        return 0;
    }

    // Draws one lane of that pack to the others. Returns 0 or -(1 + matrix).
    long collect(long first, int lane, double largest_entry) {
        copy_lane(pack_of(first), lane, reinterpret_cast<double*>(hessians), count, kEntries);
        copy_lane(deformation + first * kWidth, lane, reinterpret_cast<double*>(deformations), count, kWidth);
        largest[count] = largest_entry;
        source[count] = first + lane;
        return ++count < kLanes ? 0 : flush();
    }

    // Projects what has been collected and puts it back. Returns 0 or -(1 + matrix).
    long flush() {
        const Outcome outcome =
            project_lanes<cols>(reinterpret_cast<d8_unaligned*>(hessians),
                                reinterpret_cast<d8_unaligned*>(deformations), largest, lanes_below(count), mode);
        for (int slot = 0; slot < count; ++slot) {
            const long matrix = source[slot];
            if (outcome.failed[slot] && !project_alone(matrix)) return -(1 + matrix);
            if (!outcome.changed[slot]) continue;
            copy_lane(reinterpret_cast<double*>(hessians), slot, pack_of(matrix), static_cast<int>(matrix % kLanes),
                      kEntries);
            ++changed;
        }
        count = 0;
        return 0;
    }
};

inline int count_of(l8 mask) {
    long count = 0;
    for (int lane = 0; lane < kLanes; ++lane) count -= mask[lane];
    return static_cast<int>(count);
}

template <int cols>
long project(double* packed, const double* deformation, long lanes, Mode mode) {
    using Work = Projection<cols>;
    Work work = {packed, deformation, mode, 0, {}, {}, {}, {}, 0};
    d8 scratch[Work::kEntries];
    for (long first = 0; first < lanes; first += kLanes) {
        const l8 valid = lanes_below(lanes - first);
        const Check check = check_pack(reinterpret_cast<d8_unaligned*>(work.pack_of(first)), Work::kWidth, scratch);
        const l8 not_finite = ~check.finite & valid;
        if (any(not_finite)) return -(1 + first + first_lane(not_finite));
        const l8 failed = check.failed & valid;
        if (mode == kLeave || !any(failed)) continue;
        long result = 0;
        if (count_of(failed) >= kWorthAPack) {
            result = work.project_pack(first, check.largest, failed);
        } else {
            for (int lane = 0; lane < kLanes && result == 0; ++lane)
                if (failed[lane]) result = work.collect(first, lane, check.largest[lane]);
        }
        if (result < 0) return result;
    }
    const long result = work.flush();
    return result < 0 ? result : work.changed;
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
