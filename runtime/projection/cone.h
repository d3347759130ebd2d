// What counts as negative and what becomes of it, for packs of matrices and for one.
#pragma once

namespace yasps {

// What negative eigenvalues become: zero, their absolute value, or what they are.
enum Mode { kClamp = 0, kAbsolute = 1, kLeave = 2 };

// Eigenvalues above -kProjectionShift * (sum of |diagonal|) count as zero: rigid motions leave that rounding error.
constexpr double kProjectionShift = 1e-13;

// Beyond these, sums and products of the entries of a matrix whose absolute values have this sum may overflow or
// vanish.
constexpr double kLargestSum = 1e290, kSmallestSum = 1e-290;

}  // namespace yasps
