// Preconditioned conjugate gradients with all scalars on the device (paper, section 8).
//
// One iteration, beside the kernels of the product q = H p: yasps_pcg_curvature, yasps_pcg_step, yasps_pcg_direction,
// and with a coarse space those of coarse_space.cu before the last. M^-1 is D^-1, D the diagonal blocks of H, or that
// and the coarse space. All of them do nothing once the state says that the iteration stopped. Sums over all unknowns
// are left as one number a block, which every block of the next kernel adds up in the same order; so no kernel waits
// for another, and sums do not depend on which block came first.
//
// Floor of bytes an iteration, n scalars in dof blocks of q: 16 n (curvature) + 32 n + 8 q n (step, with the inverted
// diagonal blocks) + 48 n (direction) + 24 n (x read, y read and written by the product) = (120 + 8 q) n, and each
// block of the matrix once, 8 r c + 8. A coarse space of m unknowns adds 16 n (residuals once more, and the unknown of
// each scalar twice) + 8 m^2.
#include "solvers/cuda/solver.cuh"

namespace {

// Row i of the inverted diagonal block times what `at` gives for each scalar of the dof block.
template <class At>
__device__ __forceinline__ double precondition(const yasps_place& place, const double* inverse, At at) {
    const double* const row = inverse + place.inverse;
    if (place.size == 3) return row[0] * at(place.first) + row[1] * at(place.first + 1) + row[2] * at(place.first + 2);
    double sum = 0;
    for (int j = 0; j < place.size; ++j) sum += row[j] * at(place.first + j);
    return sum;
}

// Whether an iteration stops before it begins, in the order in which the CPU's solver asks.
__device__ __forceinline__ long reason_at(double relative, long iteration, const yasps_pcg_settings* settings) {
    if (!is_finite(relative)) return kNotFinite;
    if (relative <= settings->tolerance) return kConverged;
    if (iteration == settings->max_iterations) return kMaxIterations;
    return settings->pause && iteration == 0 ? kPaused : kRunning;
}

}  // namespace

// x = x0 or 0, q = 0. Leaves for each block how many entries of g are not finite, and the largest magnitude.
extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_pcg_prepare(const double* g, const double* x0, long n, double* x, double* q, double* partial,
                      long long* worst) {
    __shared__ double largest_of[kWarps];
    double unusable = 0, largest = 0;
    for (long i = thread_of_grid(); i < n; i += threads_of_grid()) {
        const double magnitude = fabs(g[i]);
        if (!is_finite(magnitude)) unusable += 1;
        if (magnitude > largest) largest = magnitude;
        x[i] = x0 != nullptr ? x0[i] : 0.0;
        q[i] = 0;
    }
    unusable = block_sum(unusable);
    for (int by = 16; by > 0; by /= 2) largest = fmax(largest, __shfl_xor_sync(~0u, largest, by));
    if (threadIdx.x % 32 == 0) largest_of[threadIdx.x / 32] = largest;
    __syncthreads();
    if (threadIdx.x != 0) return;
    for (int warp = 1; warp < kWarps; ++warp) largest = fmax(largest, largest_of[warp]);
    partial[blockIdx.x] = unusable;
    partial[gridDim.x + blockIdx.x] = largest;
    if (blockIdx.x == 0) *worst = 0x7fffffffffffffffLL;
}

// r = g - q and p = D^-1 r. Leaves the shares of g^T D^-1 g and r^T D^-1 r.
extern "C" __global__ void __launch_bounds__(kThreads, 8)
    yasps_pcg_start(const double* g, const double* q, const yasps_run* runs, long run_count, const double* inverse,
                    long n, double* r, double* p, double* partial) {
    double reference = 0, squared = 0;
    for (long i = thread_of_grid(); i < n; i += threads_of_grid()) {
        const yasps_place place = place_of(runs, run_count, i);
        const double residual = g[i] - q[i];
        const double direction = precondition(place, inverse, [&](long k) { return g[k] - q[k]; });
        reference += g[i] * precondition(place, inverse, [&](long k) { return g[k]; });
        squared += residual * direction;
        r[i] = residual;
        p[i] = direction;
    }
    reference = block_sum(reference);
    squared = block_sum(squared);
    if (threadIdx.x != 0) return;
    partial[2 * (long)gridDim.x + blockIdx.x] = reference;
    partial[3 * (long)gridDim.x + blockIdx.x] = squared;
}

// The state before the first iteration, from what the two kernels above left of `count` blocks each; one block.
extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_pcg_begin(const double* partial, long count, const long long* worst, const yasps_pcg_settings* settings,
                    yasps_pcg_state* state) {
    const double unusable = sum_of(partial, count);
    const double largest = sum_of(partial + count, count);  // of what is not negative: 0 only if all are
    const double reference = sum_of(partial + 2 * count, count);
    const double squared = sum_of(partial + 3 * count, count);
    if (threadIdx.x != 0 || blockIdx.x != 0) return;
    yasps_pcg_state s = {squared, reference, squared / reference, 0, 0, kRunning, kRunning, -1};
    const double unknown = sqrt(-1.0);
    if (unusable > 0) {
        s.reason = kNotFinite, s.relative = unknown;
    } else if (largest == 0) {
        s.reason = kConverged, s.relative = 0, s.reference = 0;
    } else if (*worst != 0x7fffffffffffffffLL) {
        s.reason = (long)(*worst % 4), s.block = (long)(*worst / 4), s.relative = unknown;
    } else {
        s.reason = reason_at(s.relative, 0, settings);
        if (settings->history != nullptr) settings->history[0] = s.relative;
    }
    *state = s;
}

// Leaves the shares of p^T q.
extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_pcg_curvature(const yasps_pcg_state* now, const double* p, const double* q, long n, double* partial) {
    if (now->reason != kRunning) return;
    double sum = 0;
    for (long i = thread_of_grid(); i < n; i += threads_of_grid()) sum += p[i] * q[i];
    sum = block_sum(sum);
    if (threadIdx.x == 0) partial[blockIdx.x] = sum;
}

// r' = r - step q and z = D^-1 r', with the step that curvature's shares give. Leaves the shares of r'^T z. A thread
// computes r' of its whole dof block; so r' is another vector than r.
extern "C" __global__ void __launch_bounds__(kThreads, 8)
    yasps_pcg_step(yasps_pcg_state* now, const double* curvatures, const double* r, const double* q,
                   const yasps_run* runs, long run_count, const double* inverse, long n, double* next_r, double* z,
                   double* partial) {
    if (now->reason != kRunning) return;
    const double curvature = sum_of(curvatures, gridDim.x);
    const bool usable = is_finite(curvature) && curvature > 0;
    const double step = now->squared / curvature;
    if (thread_of_grid() == 0) {  // members that this kernel does not read
        now->step = step;
        now->verdict = usable ? kRunning : is_finite(curvature) ? kNotPositiveDefinite : kNotFinite;
    }
    if (!usable) return;
    double sum = 0;
    for (long i = thread_of_grid(); i < n; i += threads_of_grid()) {
        const yasps_place place = place_of(runs, run_count, i);
        const double residual = r[i] - step * q[i];
        const double direction = precondition(place, inverse, [&](long k) { return r[k] - step * q[k]; });
        sum += residual * direction;
        next_r[i] = residual;
        z[i] = direction;
    }
    sum = block_sum(sum);
    if (threadIdx.x == 0) partial[blockIdx.x] = sum;
}

// Conjugate gradients begin with the coarse space, after the pause: p = D^-1 r + P y. unknown_of: of each scalar the
// coarse unknown that moves it, or -1. coarse_partial: the shares of r^T P y.
extern "C" __global__ void __launch_bounds__(kThreads, 8)
    yasps_pcg_resume(yasps_pcg_state* state, const double* r, const yasps_run* runs, long run_count,
                     const double* inverse, long n, const int* unknown_of, const double* y,
                     const double* coarse_partial, long coarse_count, double* p) {
    const double product = sum_of(coarse_partial, coarse_count);
    for (long i = thread_of_grid(); i < n; i += threads_of_grid()) {
        const double damped = precondition(place_of(runs, run_count, i), inverse, [&](long k) { return r[k]; });
        p[i] = damped + (unknown_of[i] >= 0 ? y[unknown_of[i]] : 0.0);
    }
    if (thread_of_grid() != 0) return;
    state->squared += product;
    state->reason = kRunning;
}

// x += step p, p = z + P y + mix p, q = 0, and the state before the next iteration. unknown_of: as before, or null
// where there is no coarse space.
extern "C" __global__ void __launch_bounds__(kThreads, 10)
    yasps_pcg_direction(const yasps_pcg_state* now, yasps_pcg_state* next, const yasps_pcg_settings* settings,
                        const double* partial, const double* z, long n, double* x, double* p, double* q,
                        const int* unknown_of, const double* y, const double* coarse_partial, long coarse_count) {
    yasps_pcg_state s = *now;
    if (s.reason == kRunning) s.reason = s.verdict;
    if (s.reason != kRunning) {
        if (thread_of_grid() == 0) *next = s;
        return;
    }
    const double damped = sum_of(partial, gridDim.x);
    const double squared = unknown_of != nullptr ? damped + sum_of(coarse_partial, coarse_count) : damped;
    const double mix = squared / s.squared, step = s.step;
    for (long i = thread_of_grid(); i < n; i += threads_of_grid()) {
        const double direction = p[i];
        double residual = z[i];
        if (unknown_of != nullptr && unknown_of[i] >= 0) residual += y[unknown_of[i]];
        x[i] += step * direction;
        p[i] = residual + mix * direction;
        q[i] = 0;
    }
    if (thread_of_grid() != 0) return;
    s.squared = squared;
    s.relative = damped / s.reference;
    s.iteration += 1;
    s.reason = reason_at(s.relative, s.iteration, settings);
    if (settings->history != nullptr) settings->history[s.iteration] = s.relative;
    *next = s;
}
