// Runs generated kernels that compute values, and adds values up.
#include "core/runtime.h"

namespace yasps {
namespace {

// Adds x to the sum high + low, keeping in low what rounding takes away from high (Knuth's two-sum).
template <class V>
void add_exactly(V x, V& high, V& low) {
    const V sum = high + x;
    const V other = sum - high;
    low += (high - (sum - other)) + (x - other);
    high = sum;
}

}  // namespace
}  // namespace yasps

extern "C" {

// Runs a kernel that computes one value per instance; `out` is passed on as it is.
void yasps_evaluate(yasps_value_kernel kernel, const void* const* args, long instances, double* out, int threads) {
#pragma omp parallel num_threads(threads)
    {
        const yasps::Range range = yasps::chunk_of(instances, omp_get_thread_num(), omp_get_num_threads());
        if (range.begin < range.end) kernel(args, range.begin, range.end, out);
    }
}

// Compensated sum in a fixed order. An infinite or NaN sum is what plain addition would give.
double yasps_sum(const double* values, long count) {
    yasps::d8 high = {}, low = {};
    long i = 0;
    for (; i + 8 <= count; i += 8) {
        yasps::d8 x;
        memcpy(&x, values + i, sizeof(x));
        yasps::add_exactly(x, high, low);
    }
    double sum = 0, lost = 0;
    for (; i < count; ++i) yasps::add_exactly(values[i], sum, lost);
    for (int lane = 0; lane < 8; ++lane) {
        yasps::add_exactly(static_cast<double>(high[lane]), sum, lost);
        lost += low[lane];
    }
    return fabs(sum) < INFINITY ? sum + lost : sum;
}
}
