// What projections of groups of matrices by something that is known of them have in common.
#pragma once

#include "core/vectors.h"
#include "projection/semidefinite_check.h"

namespace yasps {
namespace {

// Entry k of a pack of matrices.
inline Eight load_entry(const double* h, int k) {
    Eight entry;
    load_lanes(h + k * kLanes, &entry);
    return entry;
}

// Bits of lanes whose Hessian is not too close to the ends of the number range for sums and products of its entries.
template <class V>
unsigned lanes_in_range(const V& size) {
    const auto tiny = less(size, constant<V>(kSmallestSum)) & less(V{}, size);
    return bits_of(less(size, constant<V>(kLargestSum))) & ~bits_of(tiny);
}

// Projects some lanes of a group by the eigenvalues of the whole matrices.
template <int width>
__attribute__((noinline)) NegativePart project_generally(const Group& group, unsigned lanes, bool flip) {
    constexpr int entries = width * (width + 1) / 2;
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

}  // namespace
}  // namespace yasps
