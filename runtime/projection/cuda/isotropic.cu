// Projection of the Hessian of an isotropic energy onto the positive semidefinite cone: the method of
// runtime/projection/isotropic.cpp, where it is explained, with one matrix a thread.
//
// In the basis u_i v_j^T of a singular value decomposition F = U S V^T the Hessian falls apart into one block of the
// i = j and, for each i < j, a block [[a, b], [b, a]] of (i, j) and (j, i); of a 3x2 F, u_3 v_1^T and u_3 v_2^T remain.
// The Hessian stays where the caller has it and is read once for all blocks, and once for each negative eigenvalue.
#include "projection/cuda/isotropic.cuh"
#include "projection/cuda/projection.cuh"

namespace yasps {
namespace {

// The blocks. Those that an F of two columns does not have are zero, and so are those that an F of three does not have.
struct Blocks {
    Symmetric same;                  // of all u_i v_i^T
    Vector alike, across;            // of the pair without index x, y or z: [[alike, across], [across, alike]]
    double last_first, last_second;  // of u_3 v_1^T and u_3 v_2^T
};

// A 3 x cols matrix, row by row.
template <int cols>
struct Matrix {
    double at[3 * cols];
};
template <int cols>
__device__ inline void add_outer(Matrix<cols>& m, const Vector& a, const Vector& b) {
    const double left[3] = {a.x, a.y, a.z}, right[3] = {b.x, b.y, b.z};
    YASPS_UNROLLED
    for (int r = 0; r < 3; ++r) {
        YASPS_UNROLLED
        for (int c = 0; c < cols; ++c) m.at[r * cols + c] += left[r] * right[c];
    }
}
template <int cols>
__device__ inline Vector times(const Matrix<cols>& m, const Vector& b) {
    const auto row = [&](int r) {
        const double two = m.at[r * cols] * b.x + m.at[r * cols + 1] * b.y;
        return cols == 2 ? two : two + m.at[r * cols + cols - 1] * b.z;
    };
    return {row(0), row(1), row(2)};
}

// h x and h y.
template <int cols>
__device__ inline void multiply(const double* h, const Matrix<cols>& x, const Matrix<cols>& y, Matrix<cols>& hx,
                                Matrix<cols>& hy) {
    constexpr int n = 3 * cols;
    hx = hy = {};
    YASPS_UNROLLED
    for (int r = 0; r < n; ++r) {
        YASPS_UNROLLED
        for (int s = 0; s < n; ++s) {
            if (s < r) continue;
            const double entry = h[place_of<n>(r, s)];
            hx.at[r] += entry * x.at[s];
            hy.at[r] += entry * y.at[s];
            if (s == r) continue;
            hx.at[s] += entry * x.at[r];
            hy.at[s] += entry * y.at[r];
        }
    }
}

// h is known to consist of blocks, so its products with two matrices and its trace tell all of them.
__device__ inline Blocks blocks_of(const double* h, const Columns& u, const Columns& v, const Matrix<3>&) {
    Matrix<3> x = {}, y = {}, first, second;
    // u_1 v_1^T and, of each pair i < j, u_i v_j^T; u_2 v_2^T.
    add_outer(x, u.a, v.a + v.b + v.c);
    add_outer(x, u.b, v.c);
    add_outer(y, u.b, v.b);
    multiply(h, x, y, first, second);
    const Vector a = times(first, v.a), b = times(first, v.b), c = times(first, v.c);
    Blocks found = {};
    found.alike = {dot(u.b, c), dot(u.a, c), dot(u.a, b)};
    found.across = {dot(u.c, b), dot(u.c, a), dot(u.b, a)};
    found.same.xx = dot(u.a, a);
    found.same.xy = dot(u.b, b);
    found.same.xz = dot(u.c, c);
    found.same.yy = dot(u.b, times(second, v.b));
    found.same.yz = dot(u.c, times(second, v.c));
    const double trace = h[0] + h[9] + h[17] + h[24] + h[30] + h[35] + h[39] + h[42] + h[44];
    found.same.zz = trace - found.same.xx - found.same.yy - 2.0 * (found.alike.x + found.alike.y + found.alike.z);
    return found;
}
__device__ inline Blocks blocks_of(const double* h, const Columns& u, const Columns& v, const Matrix<2>&) {
    Matrix<2> x = {}, y = {}, first, second;
    // u_1 v_1^T, u_1 v_2^T and u_3 v_1^T; u_2 v_2^T and u_3 v_2^T.
    add_outer(x, u.a, v.a + v.b);
    add_outer(x, u.c, v.a);
    add_outer(y, u.b + u.c, v.b);
    multiply(h, x, y, first, second);
    const Vector a = times(first, v.a), b = times(first, v.b), other = times(second, v.b);
    Blocks found = {};
    found.same.xx = dot(u.a, a);
    found.same.xy = dot(u.b, b);
    found.same.yy = dot(u.b, other);
    found.alike.z = dot(u.a, b);
    found.across.z = dot(u.b, a);
    found.last_first = dot(u.c, a);
    found.last_second = dot(u.c, other);
    return found;
}

// Adds missing mode mode^T to the packed matrix.
template <int cols>
__device__ inline void add_mode(double missing, const Matrix<cols>& mode, double* h) {
    constexpr int n = 3 * cols;
    YASPS_UNROLLED
    for (int r = 0; r < n; ++r) {
        const double scaled = missing * mode.at[r];
        YASPS_UNROLLED
        for (int s = 0; s < n; ++s)
            if (s >= r) h[place_of<n>(r, s)] += scaled * mode.at[s];
    }
}

// An eigenvector of the Hessian, left.a v_1^T + left.b v_2^T + left.c v_3^T.
struct Mode {
    double eigenvalue, squared_norm;
    Columns left;
};
// Of [[alike, across], [across, alike]], with the eigenvalue `alike` minus or plus the size of `across`: a flip where
// that is negative, else a twist; or the other. left_i, left_j are what belongs to v_i and v_j.
__device__ inline double pair_mode(double alike, double across, bool smaller, const Vector& ui, const Vector& uj,
                                   Vector& left_i, Vector& left_j) {
    left_j = ui;
    left_i = (across < 0) == smaller ? uj : uj * -1.0;
    return smaller ? alike - fabs(across) : alike + fabs(across);
}
__device__ inline Mode mode_of(int index, const Blocks& blocks, const Columns& e, const Columns& u, bool two_columns) {
    Mode mode = {};
    mode.squared_norm = 1.0;
    if (index < 3) {
        const Vector& w = index == 0 ? e.a : index == 1 ? e.b : e.c;
        mode.eigenvalue = index == 0 ? blocks.same.xx : index == 1 ? blocks.same.yy : blocks.same.zz;
        mode.left = {u.a * w.x, u.b * w.y, u.c * w.z};
    } else if (two_columns && index > 4) {
        mode.eigenvalue = index == 5 ? blocks.last_first : blocks.last_second;
        (index == 5 ? mode.left.a : mode.left.b) = u.c;
    } else {
        const bool smaller = index % 2 != 0;
        mode.squared_norm = 2.0;
        Columns& left = mode.left;
        if (index < 5)
            mode.eigenvalue = pair_mode(blocks.alike.z, blocks.across.z, smaller, u.a, u.b, left.a, left.b);
        else if (index < 7)
            mode.eigenvalue = pair_mode(blocks.alike.y, blocks.across.y, smaller, u.a, u.c, left.a, left.c);
        else
            mode.eigenvalue = pair_mode(blocks.alike.x, blocks.across.x, smaller, u.b, u.c, left.b, left.c);
    }
    return mode;
}

// Bits of the negative eigenvalues, numbered as by mode_of.
template <int cols>
__device__ inline unsigned negative_modes(const Blocks& b, double* smallest) {
    double values[9] = {b.same.xx, b.same.yy, b.same.zz, b.alike.z - fabs(b.across.z), b.alike.z + fabs(b.across.z)};
    if (cols == 2) {
        values[5] = b.last_first;
        values[6] = b.last_second;
    } else {
        values[5] = b.alike.y - fabs(b.across.y);
        values[6] = b.alike.y + fabs(b.across.y);
        values[7] = b.alike.x - fabs(b.across.x);
        values[8] = b.alike.x + fabs(b.across.x);
    }
    unsigned negative = 0;
    YASPS_UNROLLED
    for (int k = 0; k < 9; ++k) {
        negative |= values[k] < 0.0 ? 1u << k : 0u;
        *smallest = fmin(*smallest, values[k]);
    }
    return negative;
}

// Columns of F by a factor.
template <int cols>
__device__ inline Columns columns_of(const double* f, double factor) {
    Columns columns = {
        Vector{f[0], f[cols], f[2 * cols]} * factor, Vector{f[1], f[cols + 1], f[2 * cols + 1]} * factor, {0, 0, 0}};
    if (cols == 3) columns.c = Vector{f[2], f[cols + 2], f[2 * cols + 2]} * factor;
    return columns;
}

// The same by eigenvalues: for matrices too large or small for sums and products of entries, or without a usable F.
__device__ __noinline__ int project_without_f(double* packed, int n, int mode) {
    double work[9 * (9 + 2)];
    return yasps_project(packed, n, mode, work);
}

// What is known of a matrix. It lies in local memory between the steps, which are functions of their own: so none of
// them spills where it may use all registers, and each at most 250 bytes where it may use 128.
struct Decomposition {
    Columns u, v;
    Columns e;      // eigenvectors of blocks.same
    Blocks blocks;  // `same` is diagonal in the end
};

template <int cols>
__device__ __noinline__ bool find_frames(const double* deformation, double factor, Decomposition& found) {
    return singular_frames<cols>(columns_of<cols>(deformation, factor), found.u, found.v);
}

template <int cols>
__device__ __noinline__ void find_blocks(const double* packed, Decomposition& found) {
    found.blocks = blocks_of(packed, found.u, found.v, Matrix<cols>{});
}

__device__ __noinline__ bool diagonalise_same(double size, Decomposition& found) {
    const Scales scale = scales_of(size);
    const Symmetric& given = found.blocks.same;
    Symmetric same = {given.xx * scale.down, given.yy * scale.down, given.zz * scale.down,
                      given.yz * scale.down, given.xz * scale.down, given.xy * scale.down};
    if (!diagonalise(same, found.e)) return false;
    found.blocks.same = {same.xx * scale.up, same.yy * scale.up, same.zz * scale.up, 0, 0, 0};
    return true;
}

// negative: bits of the eigenvalues to remove. Each thread takes its own next one, so that a warp takes as many turns
// as the thread with the most.
template <int cols>
__device__ __noinline__ void remove_modes(unsigned negative, const Decomposition& found, bool flip, double* packed) {
    YASPS_ROLLED
    for (; negative != 0; negative &= negative - 1) {
        const int index = __ffs(static_cast<int>(negative)) - 1;
        const Mode mode = mode_of(index, found.blocks, found.e, found.u, cols == 2);
        Matrix<cols> m = {};
        add_outer(m, mode.left.a, found.v.a);
        add_outer(m, mode.left.b, found.v.b);
        if (cols == 3) add_outer(m, mode.left.c, found.v.c);
        add_mode(mode.eigenvalue * (flip ? -2.0 : -1.0) / mode.squared_norm, m, packed);
    }
}

// factor: to scale F to about one. size: the sum of the absolute values of packed entries.
template <int cols>
__device__ __noinline__ int remove_negative(double* packed, const double* deformation, double factor, double size,
                                            bool flip) {
    constexpr int width = 3 * cols;
    Decomposition found;
    if (!find_frames<cols>(deformation, factor, found)) return kNotFinite;
    find_blocks<cols>(packed, found);
    if (!diagonalise_same(size, found)) return kNotFinite;
    double trace = 0.0, smallest = 0.0;
    YASPS_UNROLLED
    for (int r = 0; r < width; ++r) trace += fabs(packed[place_of<width>(r, r)]);
    const unsigned negative = negative_modes<cols>(found.blocks, &smallest);
    if (!(smallest < trace * -kProjectionShift)) return kUnchanged;
    remove_modes<cols>(negative, found, flip, packed);
    return kChanged;
}

template <int cols>
__device__ inline int project(double* packed, const double* deformation, int mode) {
    constexpr int width = 3 * cols;
    const Check check = check_of<width>(packed);
    const Outcome outcome = outcome_of(check, packed, width, mode);
    if (outcome != kUndecided) return outcome;
    double largest = 0.0;
    YASPS_UNROLLED
    for (int k = 0; k < width; ++k) largest = fmax(largest, fabs(deformation[k]));
    int result = kNotFinite;
    if (in_range(check.sum) && all_finite(deformation, width))
        result = remove_negative<cols>(packed, deformation, scales_of(largest).down, check.sum, mode == kAbsolute);
    return result == kNotFinite ? project_without_f(packed, width, mode) : result;
}

}  // namespace
}  // namespace yasps

extern "C" __device__ int yasps_project_isotropic(double* packed, const double* deformation, int n, int mode) {
    return n == 9 ? yasps::project<3>(packed, deformation, mode) : yasps::project<2>(packed, deformation, mode);
}
