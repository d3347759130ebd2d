"""Projections of the processor onto the positive semidefinite cone."""

from __future__ import annotations

from mutation import Mutation

GENERAL = "tests/runtime/projection/test_projection.py"
NUMPY = (f"{GENERAL}::test_agrees_with_numpy",)
MANY = (f"{GENERAL}::test_many_packs_of_which_some_matrices_fail", f"{GENERAL}::test_any_number_of_failing_matrices")
ISOTROPIC = "tests/runtime/projection/test_isotropic.py"
VECTORS = "tests/runtime/projection/test_two_vectors.py"
BY_SINGULAR_VALUES = (f"{ISOTROPIC}::test_agrees_with_numpy",)
TWO_VECTORS = (f"{VECTORS}::test_agrees_with_numpy",)
CODE, CHECK = "runtime/projection/negative_part.cpp", "runtime/projection/semidefinite_check.h"

MUTATIONS = (
    Mutation(
        "matrices with small negative eigenvalues pass",
        "runtime/projection/cone.h",
        "constexpr double kProjectionShift = 1e-13;",
        "constexpr double kProjectionShift = 1e-4;",
        NUMPY,
    ),
    Mutation(
        "clamp and abs exchanged",
        CODE,
        "s.e[j] = weight * (flip ? -2.0 : -1.0);",
        "s.e[j] = weight * (flip ? -1.0 : -2.0);",
        NUMPY,
    ),
    Mutation(
        "reduction: a sign in the update of the rest",
        "runtime/projection/tridiagonal.h",
        "p[i] = half * v[i] - p[i] * scale;",
        "p[i] = half * v[i] + p[i] * scale;",
        NUMPY,
    ),
    Mutation(
        "reflections are not undone",
        CODE,
        "* scale * -1.0, v, n - k - 1);",
        "* scale, v, n - k - 1);",
        NUMPY,
    ),
    Mutation(
        "rotations of eigenvectors turn the other way",
        CODE,
        "carried[j] = turn.cosine * upper - turn.sine * carried[j];",
        "carried[j] = turn.cosine * upper + turn.sine * carried[j];",
        NUMPY,
    ),
    Mutation(
        "rotations that did not fit into memory are forgotten",
        CODE,
        "    t->has_product = true;\n",
        "",
        ("tests/runtime/projection/test_projection_builds.py",),
    ),
    Mutation(
        "numbers are not scaled before they are squared",
        CODE,
        "s.a[i * n + j] = entry * down;",
        "s.a[i * n + j] = entry;",
        (f"{GENERAL}::test_huge_and_tiny_norms",),
    ),
    Mutation(
        "the last pivot is not looked at",
        CHECK,
        "for (int left = n; left > 0; --left) {",
        "for (int left = n; left > 1; --left) {",
        NUMPY,
    ),
    Mutation(
        "near the ends of the number range the check decides",
        CHECK,
        "return bits_of_eight(~(check.passed & safe));",
        "return bits_of_eight(~check.passed);",
        ("tests/runtime/projection/test_borderline_matrices.py::test_negative_numbers_next_to_the_smallest_there_are",),
    ),
    Mutation(
        "matrices of a second pack take the slots of the first",
        CHECK,
        "((1u << taken) - 1) << first};",
        "((1u << taken) - 1)};",
        MANY,
    ),
    Mutation(
        "the matrices of the last pack are not put back",
        CHECK,
        "r < half.run_count && !half.in_place; ++r)",
        "r + 1 < half.run_count && !half.in_place; ++r)",
        MANY,
    ),
    Mutation(
        "lanes after the last matrix are looked at",
        CHECK,
        "const unsigned valid = rest < kLanes ? (1u << rest) - 1 : 255u;",
        "const unsigned valid = 255u;",
        (*NUMPY, f"{GENERAL}::test_any_number_of_failing_matrices"),
    ),
    Mutation(
        "what shall be left is projected",
        CHECK,
        "        if (leave) {",
        "        if (false) {",
        (f"{GENERAL}::test_leave_changes_nothing",),
    ),
    Mutation(
        "a matrix that is not finite is named as if all lay in the first pack",
        CHECK,
        "const long matrix = run.pack * kLanes + (bad != 0",
        "const long matrix = (bad != 0",
        (f"{GENERAL}::test_not_finite_is_reported_among_matrices_that_fail",),
    ),
    Mutation(
        "matrices that wait at the end are forgotten",
        CHECK,
        "if (waiting.open->count != 0) take_open(&waiting);",
        "",
        NUMPY,
    ),
    Mutation(
        "by singular values: eigenvectors of pairs are not of unit length",
        "runtime/projection/isotropic.cpp",
        "eigenvalue * (-factor / squared_norm)",
        "eigenvalue * -factor",
        BY_SINGULAR_VALUES,
    ),
    Mutation(
        "by singular values: flip and twist exchanged",
        "runtime/projection/isotropic.cpp",
        "const Eight sign = with_sign(constant<Eight>(1), across);",
        "const Eight sign = with_sign(constant<Eight>(1), Eight{} - across);",
        BY_SINGULAR_VALUES,
    ),
    Mutation(
        "by singular values: entries beside the diagonal exchanged",
        "runtime/projection/isotropic_blocks.h",
        "same.opposite[0] = (y + z - x) * 0.5;",
        "same.opposite[0] = (x + z - y) * 0.5;",
        BY_SINGULAR_VALUES,
    ),
    Mutation(
        "by singular values: of a 3x2 F the last two eigenvalues are one",
        "runtime/projection/isotropic_blocks.h",
        "found.last[1] = dot(u.c[2], right[1]);",
        "found.last[1] = dot(u.c[2], right[0]);",
        BY_SINGULAR_VALUES,
    ),
    Mutation(
        "by singular values: abs is clamp",
        "runtime/projection/isotropic.cpp",
        "modes.factor = flip ? 2 : 1;",
        "modes.factor = 1;",
        BY_SINGULAR_VALUES,
    ),
    Mutation(
        "by singular values: the threshold is positive",
        "runtime/projection/isotropic.cpp",
        "less(smallest_eigenvalue(blocks[k]), trace * -kProjectionShift);",
        "less(smallest_eigenvalue(blocks[k]), trace * 0.1);",
        (
            f"{ISOTROPIC}::test_semidefinite_matrices_keep_every_bit",
            f"{ISOTROPIC}::test_packs_of_which_many_or_few_fail",
        ),
    ),
    Mutation(
        "two vectors: what moves along the normal is taken for what moves in the plane",
        "runtime/projection/two_vectors.cpp",
        "const Eight along = q.c[2].at[r] * normal[k];",
        "const Eight along = q.c[1].at[r] * normal[k];",
        TWO_VECTORS,
    ),
    Mutation(
        "two vectors: parallel ones have the plane that rounding says",
        "runtime/projection/two_vectors.cpp",
        "constexpr double kAcross = 1.6e-15 * 1.6e-15;",
        "constexpr double kAcross = 0.0;",
        TWO_VECTORS,
    ),
    Mutation(
        "two vectors: a short rest is not made orthogonal once more",
        "runtime/projection/two_vectors.cpp",
        "    rest = rest - q.c[0] * dot(rest, q.c[0]);  // of a short rest much is rounding",
        "",
        TWO_VECTORS,
    ),
    Mutation(
        "two vectors: vectors that are not finite make a frame",
        "runtime/projection/two_vectors.cpp",
        "*failed |= bits_of(finite) ^ 0xffu;",
        "*failed |= 0u;",
        (f"{VECTORS}::test_without_finite_vectors_projection_is_the_general_one",),
    ),
    Mutation(
        "singular values: the third column of U is the second",
        "runtime/projection/three_by_three.h",
        "u.c[2] = cross(u.c[0], u.c[1]);",
        "u.c[2] = u.c[1];",
        BY_SINGULAR_VALUES,
    ),
    Mutation(
        "singular values: V is not turned along",
        "runtime/projection/three_by_three.h",
        "    turn(v.c[kTurned], v.c[kTurned + 1], r);\n",
        "",
        BY_SINGULAR_VALUES,
    ),
    Mutation(
        "singular values: columns of next to no length are divided by it",
        "runtime/projection/three_by_three.h",
        "    if (any(thin)) replace_thin(a, thin, u);\n",
        "",
        (f"{ISOTROPIC}::test_agrees_with_numpy", f"{ISOTROPIC}::test_unusual_matrices_where_nearly_all_fail"),
    ),
)
