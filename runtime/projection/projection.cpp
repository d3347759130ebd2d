// Projection of small symmetric matrices onto the positive semidefinite cone: those that fail the check
// (semidefinite_check.h) lose the negative part of their eigenvalues (negative_part.cpp).
#include "core/runtime.h"
#include "projection/semidefinite_check.h"

namespace yasps {
namespace {

// The most scratch, in bytes, that lies on the stack; width 15 needs no more.
constexpr long kLargestStack = 1 << 18;

long project(const Packs& packs, Mode mode, double* memory) {
    double* const scratch = memory + memory_size(packs);
    const auto decompose = [&](const Group& group) {
        alignas(64) double sizes[kCollected];
        NegativePart result = {0, sizes_of(group.matrices[0], packs.entries(), group.halves, sizes) & group.lanes};
        if (result.unfinished == 0)
            remove_negative_part(group.matrices[0], kCollected, sizes, packs.n, group.halves, mode == kAbsolute,
                                 scratch, &result);
        return result;
    };
    switch (packs.n) {
        case 3:
            return project_failing<3, kHalves>(packs, memory, mode == kLeave, decompose);
        case 6:
            return project_failing<6, kHalves>(packs, memory, mode == kLeave, decompose);
        case 9:
            return project_failing<9, kHalves>(packs, memory, mode == kLeave, decompose);
        case 12:
            return project_failing<12, kHalves>(packs, memory, mode == kLeave, decompose);
        default:
            return project_failing<0, kHalves>(packs, memory, mode == kLeave, decompose);
    }
}

}  // namespace
}  // namespace yasps

extern "C" {

// Projects `lanes` symmetric matrices in place. Eight are interleaved in a pack: packed[k * 8 + lane] is entry k of the
// upper triangle, row by row; packs follow each other, and the last may be partly filled. Give many packs at once where
// possible: only matrices that need it are decomposed, and sixteen of those cost hardly more than one.
// mode: 0 = negative eigenvalues become 0, 1 = their absolute value, 2 = nothing is changed. A matrix that is
// semidefinite up to rounding keeps every bit.
// Returns the number of matrices changed; -(1 + lane) for a matrix with an entry that is not finite (or whose
// eigenvalues cannot be found), when others before it may have been projected; YASPS_NO_MEMORY when memory for a wide
// matrix runs out.
long yasps_project(double* packed, int width, int lanes, int mode) {
    using namespace yasps;
    if (width <= 0) return 0;
    const Packs packs = {packed, nullptr, width, 0, lanes};
    const long size = negative_part_scratch(width) + memory_size(packs);
    if (size * static_cast<long>(sizeof(double)) <= kLargestStack) {
        void* const memory = __builtin_alloca_with_align(static_cast<size_t>(size) * sizeof(double), 8 * sizeof(d8));
        return project(packs, static_cast<Mode>(mode), static_cast<double*>(memory));
    }
    Buffer<double> buffer;
    if (!buffer.reserve(size)) return YASPS_NO_MEMORY;
    return project(packs, static_cast<Mode>(mode), buffer.data);
}
}
