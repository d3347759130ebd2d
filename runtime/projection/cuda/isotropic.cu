// Projection of the Hessian of an isotropic energy onto the positive semidefinite cone by its blocks
// (isotropic_blocks.h), with one matrix a thread.
//
// Unlike the CPU's packs, which make all modes that any of their matrices needs, a thread makes one after another. The
// Hessian stays where the caller has it and is read for all blocks, and once for each negative eigenvalue.
#include "projection/cuda/projection.cuh"
#include "projection/isotropic_blocks.h"

namespace yasps {
namespace {

// Adds missing mode mode^T to the packed matrix.
template <int cols>
__device__ inline void add_mode(double missing, const Matrix<cols, double>& mode, double* h) {
    constexpr int n = 3 * cols;
    YASPS_UNROLLED
    for (int r = 0; r < n; ++r) {
        const double scaled = missing * mode.at[r];
        YASPS_UNROLLED
        for (int s = 0; s < n; ++s)
            if (s >= r) h[place_of<n>(r, s)] += scaled * mode.at[s];
    }
}

// An eigenvector of the Hessian, the sum of left_j v_j^T.
struct Mode {
    double eigenvalue, squared_norm;
    Columns<double> left;
};
// Of [[alike, across], [across, alike]], the block of (i, j) and (j, i), with the eigenvalue `alike` minus or plus the
// size of `across`: a flip where that is negative, else a twist; or the other.
template <int i, int j>
__device__ inline void pair_mode(const Blocks<double>& blocks, const Columns<double>& u, bool smaller, Mode& mode) {
    const double alike = blocks.alike[3 - i - j], across = blocks.across[3 - i - j];
    mode.eigenvalue = smaller ? alike - fabs(across) : alike + fabs(across);
    mode.left.c[j] = u.c[i];
    mode.left.c[i] = (across < 0) == smaller ? u.c[j] : u.c[j] * -1.0;
}
__device__ inline Mode mode_of(int index, const Blocks<double>& blocks, const Columns<double>& e,
                               const Columns<double>& u, bool two_columns) {
    Mode mode = {};
    mode.squared_norm = 1.0;
    if (index < 3) {
        const Vector<double>& w = index == 0 ? e.c[0] : index == 1 ? e.c[1] : e.c[2];
        const double* const same = blocks.same.diagonal;
        mode.eigenvalue = index == 0 ? same[0] : index == 1 ? same[1] : same[2];
        mode.left = {u.c[0] * w.at[0], u.c[1] * w.at[1], u.c[2] * w.at[2]};
    } else if (two_columns && index > 4) {
        mode.eigenvalue = index == 5 ? blocks.last[0] : blocks.last[1];
        (index == 5 ? mode.left.c[0] : mode.left.c[1]) = u.c[2];
    } else {
        const bool smaller = index % 2 != 0;
        mode.squared_norm = 2.0;
        if (index < 5)
            pair_mode<0, 1>(blocks, u, smaller, mode);
        else if (index < 7)
            pair_mode<0, 2>(blocks, u, smaller, mode);
        else
            pair_mode<1, 2>(blocks, u, smaller, mode);
    }
    return mode;
}

// Bits of the negative eigenvalues, numbered as by mode_of.
template <int cols>
__device__ inline unsigned negative_modes(const Blocks<double>& b, double* smallest) {
    double values[9] = {b.same.diagonal[0], b.same.diagonal[1], b.same.diagonal[2]};
    YASPS_UNROLLED
    for (int k = 0; k < (cols == 2 ? 1 : 3); ++k) {
        values[3 + 2 * k] = b.alike[2 - k] - fabs(b.across[2 - k]);
        values[4 + 2 * k] = b.alike[2 - k] + fabs(b.across[2 - k]);
    }
    if (cols == 2) {
        values[5] = b.last[0];
        values[6] = b.last[1];
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
__device__ inline Columns<double> columns_of(const double* f, double factor) {
    Columns<double> columns = {};
    YASPS_UNROLLED
    for (int r = 0; r < 3; ++r) {
        YASPS_UNROLLED
        for (int c = 0; c < cols; ++c) columns.c[c].at[r] = f[r * cols + c] * factor;
    }
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
    Columns<double> u, v;
    Columns<double> e;      // eigenvectors of blocks.same
    Blocks<double> blocks;  // `same` is diagonal in the end
};

template <int cols>
__device__ __noinline__ bool find_frames(const double* deformation, double factor, Decomposition& found) {
    return singular_frames<cols>(columns_of<cols>(deformation, factor), found.u, found.v) == 0;
}

template <int cols>
__device__ __noinline__ void find_blocks(const double* packed, Decomposition& found) {
    found.blocks = blocks_of<cols>([packed](int entry) { return packed[entry]; }, found.u, found.v);
}

template <int cols>
__device__ __noinline__ bool diagonalise_same(double size, Decomposition& found) {
    const double down = power_of_two(size, -1), up = power_of_two(size, 1);
    Symmetric<double>& same = found.blocks.same;
    YASPS_UNROLLED
    for (int k = 0; k < 3; ++k) {
        same.diagonal[k] *= down;
        same.opposite[k] *= down;
    }
    const bool done = diagonalise<cols>(same, found.e) == 0;
    YASPS_UNROLLED
    for (int k = 0; k < 3; ++k) same.diagonal[k] *= up;
    return done;
}

// negative: bits of the eigenvalues to remove. Each thread takes its own next one, so that a warp takes as many turns
// as the thread with the most.
template <int cols>
__device__ __noinline__ void remove_modes(unsigned negative, const Decomposition& found, bool flip, double* packed) {
    YASPS_ROLLED
    for (; negative != 0; negative &= negative - 1) {
        const int index = __ffs(static_cast<int>(negative)) - 1;
        const Mode mode = mode_of(index, found.blocks, found.e, found.u, cols == 2);
        Matrix<cols, double> m = outer<cols>(mode.left.c[0], found.v.c[0]) + outer<cols>(mode.left.c[1], found.v.c[1]);
        if (cols == 3) m = m + outer<cols>(mode.left.c[2], found.v.c[2]);
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
    if (!diagonalise_same<cols>(size, found)) return kNotFinite;
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
        result = remove_negative<cols>(packed, deformation, power_of_two(largest, -1), check.sum, mode == kAbsolute);
    return result == kNotFinite ? project_without_f(packed, width, mode) : result;
}

}  // namespace
}  // namespace yasps

extern "C" __device__ int yasps_project_isotropic(double* packed, const double* deformation, int n, int mode) {
    return n == 9 ? yasps::project<3>(packed, deformation, mode) : yasps::project<2>(packed, deformation, mode);
}
