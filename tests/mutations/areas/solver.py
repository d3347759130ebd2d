"""Linear solvers of the processor."""

from __future__ import annotations

from mutation import Mutation

SOLVER = "tests/runtime/solvers/test_pcg.py"
TEXTBOOK = (f"{SOLVER}::test_residuals_are_those_of_textbook_pcg",)
ONE_ITERATION = (f"{SOLVER}::test_block_diagonal_system_takes_one_iteration",)
TWO_LEVEL = "tests/runtime/solvers/test_two_level.py"
COARSE = "runtime/solvers/coarse_space.cpp"
DIRECT = "tests/runtime/solvers/test_direct.py"
WORKSPACE = "runtime/solvers/workspace.h"
SWEEPS = "runtime/solvers/gauss_seidel.cpp"
SWEPT = "runtime/solvers/swept_pcg.cpp"
GAUSS_SEIDEL = "tests/runtime/solvers/test_gauss_seidel.py"
CODE, PRECONDITIONER = "runtime/solvers/pcg.cpp", "runtime/solvers/preconditioner.cpp"
BARRIER = "runtime/core/team_barrier.h"
MEETING = "tests/runtime/core/test_team_barrier.py::test_nobody_goes_on_before_all_have_come"
INVERSE = "runtime/solvers/inverse.h"

MUTATIONS = (
    Mutation(
        "conjugate gradients: beta upside down",
        CODE,
        "const double mix = next / squared;",
        "const double mix = squared / next;",
        TEXTBOOK,
    ),
    Mutation(
        "conjugate gradients: x goes the other way",
        CODE,
        "load(&w.x[i]) + step * direction);\n            store(&w.direction.data[i], load(&w.preconditioned[i]) + mix",
        "load(&w.x[i]) - step * direction);\n            store(&w.direction.data[i], load(&w.preconditioned[i]) + mix",
        (f"{SOLVER}::test_solves_sum_of_parts",),
    ),
    Mutation(
        "conjugate gradients: the residual is absolute",
        CODE,
        "const double relative = damped / reference;",
        "const double relative = damped;",
        TEXTBOOK,
    ),
    Mutation(
        "conjugate gradients: the reference is that of the first residual",
        CODE,
        "const double reference = total(w, 0);",
        "const double reference = total(w, 1);",
        (f"{SOLVER}::test_exact_start_needs_no_iteration",),
    ),
    Mutation(
        "conjugate gradients: the first residual adds H x0",
        CODE,
        "load(&w.g[i]) - load(p.product + i));",
        "load(&w.g[i]) + load(p.product + i));",
        (f"{SOLVER}::test_exact_start_needs_no_iteration",),
    ),
    Mutation(
        "conjugate gradients: negative curvature is not noticed",
        CODE,
        "if (!(curvature > 0 && curvature < INFINITY)) {",
        "if (!(curvature < INFINITY)) {",
        (f"{SOLVER}::test_indefinite_matrix_with_definite_diagonal_blocks",),
    ),
    Mutation(
        "conjugate gradients: what other threads found for a row stays there",
        WORKSPACE,
        "            store(from->product + i, d4{});\n",
        "",
        TEXTBOOK,
    ),
    Mutation(
        "conjugate gradients: the end of a dot product is left out",
        WORKSPACE,
        "for (; i < range.end; i += 4) first += load(a + i) * load(b + i);",
        "",
        TEXTBOOK,
    ),
    Mutation(
        "preconditioner: a sign in the factorisation",
        INVERSE,
        "pivot -= a[j * q + k] * a[j * q + k];",
        "pivot += a[j * q + k] * a[j * q + k];",
        ONE_ITERATION,
    ),
    Mutation(
        "preconditioner: a sign in the inverse of the factor",
        INVERSE,
        "a[i * q + j] = -sum * a[i * q + i];",
        "a[i * q + j] = sum * a[i * q + i];",
        ONE_ITERATION,
    ),
    Mutation(
        "preconditioner: the inverse has a lower triangle only",
        PRECONDITIONER,
        "out[i * stride + j] = out[j * stride + i] = entry",
        "out[i * stride + j] = entry",
        TEXTBOOK,
    ),
    Mutation(
        "preconditioner: the last part's diagonal blocks are taken for the sum",
        "runtime/solvers/preconditioner.h",
        "sum[k] += part[k];",
        "sum[k] = part[k];",
        TEXTBOOK,
    ),
    Mutation(
        "preconditioner: a pivot of rounding errors counts as positive",
        INVERSE,
        "if (pivot <= 4e-16 * q * before || pivot <= 0) return kNotPositiveDefinite;",
        "if (pivot <= 0) return kNotPositiveDefinite;",
        (
            "tests/runtime/projection/test_borderline_matrices.py::test_projections_whose_last_pivot_is_a_rounding_error",
        ),
    ),
    Mutation(
        "preconditioner: a row of the inverse meets the wrong entry",
        CODE,
        "load(inverse + 4) * r[at + 1]",
        "load(inverse + 4) * r[at + 2]",
        TEXTBOOK,
    ),
    Mutation(
        "barrier: nobody waits",
        BARRIER,
        "+ 1 == team)",
        "+ 1 > 0)",
        (f"{MEETING}[2]",),
    ),
    Mutation(
        "barrier: sleepers are not woken",
        BARRIER,
        "if (sleepers_.load() > 0) wake_sleepers();",
        "",
        (f"{MEETING}[2]",),
    ),
    Mutation(
        "sweeps: contacts are not in them",
        SWEEPS,
        "if (moving[b] == taken) return;",
        "return;",
        (f"{GAUSS_SEIDEL}::test_iterations_are_those_of_textbook_pcg",),
    ),
    Mutation(
        "sweeps: what two pieces share is left out of the product",
        SWEEPS,
        "    multiply_list<-1>(s, s.fixed.down[k].cross, other, v);\n",
        "",
        (f"{GAUSS_SEIDEL}::test_solves_to_the_last_digits[2-False]",),
    ),
    Mutation(
        "sweeps: rows that the other piece is coupled with do not wait",
        SWEEPS,
        "if (shared(group, row, col)) late[col] = 1;",
        "if (shared(group, row, col)) late[col] = 0;",
        (f"{GAUSS_SEIDEL}::test_two_pieces_leave_nothing_out",),
    ),
    Mutation(
        "sweeps: the second piece runs down as well",
        SWEEPS,
        "return first % 2 == 0 || s.late[row] < s.late[col] ? kForwards : kBackwards;",
        "return kForwards;",
        (f"{GAUSS_SEIDEL}::test_solves_to_the_last_digits[2-False]",),
    ),
    Mutation(
        "sweeps: blocks of other shapes are left out",
        SWEEPS,
        "    multiply_others(s, s.other[k], t, v);\n",
        "",
        (f"{GAUSS_SEIDEL}::test_solves_to_the_last_digits[1-False]",),
    ),
    Mutation(
        "sweeps: the lists of a static part outlive its structure",
        "runtime/matrix/block_matrix.cpp",
        "    s->build = ++last_build;\n",
        "",
        (f"{GAUSS_SEIDEL}::test_lists_follow_the_structure[1]",),
    ),
    Mutation(
        "sweeps: the tolerance is compared in the swept system's own norm",
        SWEPT,
        "relative = total(w, 2) / reference;",
        "relative = swept / reference;",
        (f"{GAUSS_SEIDEL}::test_iterations_are_those_of_textbook_pcg",),
    ),
    Mutation(
        "sweeps: what float32 says of the residual is believed",
        SWEPT,
        "if (reason != kConverged) return stop(iteration, relative, reason, -1);",
        "return stop(iteration, relative, reason, -1);",
        (f"{GAUSS_SEIDEL}::test_solves_to_the_last_digits[1-False]",),
    ),
    Mutation(
        "sweeps: nobody takes over",
        SWEPT,
        "if (relative > kStagnant * before) return stop(iteration, relative, kTooFewDigits, -1);",
        "",
        (f"{GAUSS_SEIDEL}::test_block_jacobi_goes_on_where_float32_is_not_enough[1]",),
    ),
    Mutation(
        "two levels: contacts are left out of the coarse matrix",
        COARSE,
        "for (int p = 0; p < parts.count; ++p) add_part",
        "for (int p = 0; p < 1; ++p) add_part",
        (f"{TWO_LEVEL}::test_iterations_are_those_of_textbook_pcg",),
    ),
    Mutation(
        "two levels: diagonal blocks count twice",
        COARSE,
        "col == row ? 0.5 : 1);",
        "1);",
        (f"{TWO_LEVEL}::test_iterations_are_those_of_textbook_pcg",),
    ),
    Mutation(
        "two levels: what H has once, the coarse matrix has without its transpose",
        COARSE,
        "    fold(c, rows);\n",
        "",
        (f"{TWO_LEVEL}::test_iterations_are_those_of_textbook_pcg",),
    ),
    Mutation(
        "two levels: a copy of the restricted residual is left out",
        COARSE,
        "for (long k = 1; k < kCopies * pieces; ++k)",
        "for (long k = 2; k < kCopies * pieces; ++k)",
        (f"{TWO_LEVEL}::test_iterations_are_those_of_textbook_pcg",),
    ),
    Mutation(
        "two levels: fixed unknowns move with their aggregate",
        COARSE,
        "aggregate < 0 || identity ?",
        "aggregate < 0 ?",
        (f"{TWO_LEVEL}::test_fixed_unknowns_stay",),
    ),
    Mutation(
        "two levels: a pivot that is not positive is taken",
        COARSE,
        "if (!invert_lower(c, barrier)) return false;",
        "invert_lower(c, barrier);",
        (f"{TWO_LEVEL}::test_breakdown_is_said_and_block_jacobi_goes_on",),
    ),
    Mutation(
        "two levels: the coarse part is left out of r^T z",
        CODE,
        "next += coarse_product(w.coarse, system.aggregates());",
        "next += 0;",
        (f"{TWO_LEVEL}::test_iterations_are_those_of_textbook_pcg",),
    ),
    Mutation(
        "two levels: the tolerance is compared in the preconditioner's own norm",
        CODE,
        "            next += coarse_product(w.coarse, system.aggregates());\n",
        "            next += coarse_product(w.coarse, system.aggregates());\n            damped = next;\n",
        (f"{TWO_LEVEL}::test_iterations_are_those_of_textbook_pcg",),
    ),
    Mutation(
        "two levels: aggregates outlive their structure",
        "runtime/matrix/block_matrix.cpp",
        "    s->aggregates.known = false;\n",
        "",
        (f"{TWO_LEVEL}::test_aggregates_follow_the_structure",),
    ),
    Mutation(
        "two levels: more unknowns than there is room for",
        "runtime/solvers/aggregates.cpp",
        "unknowns + found.width[order[k]] <= kMostUnknowns",
        "unknowns < 2 * kMostUnknowns",
        (f"{TWO_LEVEL}::test_more_bodies_than_the_coarse_space_has_room_for",),
    ),
    Mutation(
        "two levels: auto never comes back to block Jacobi",
        "runtime/solvers/pcg.py",
        "before, self.two_level = self.two_level, self.lead > 0",
        "before, self.two_level = self.two_level, self.two_level or self.lead > 0",
        (f"{TWO_LEVEL}::test_auto_follows_systems_that_change",),
    ),
    Mutation(
        "two levels: auto compares iterations, whatever they cost",
        "runtime/solvers/pcg.py",
        "return self.SETUP + self.ITERATION * report.iterations if report.two_level else float(report.iterations)",
        "return float(report.iterations)",
        (f"{TWO_LEVEL}::test_auto_loses_little_to_the_better_one",),
    ),
    Mutation(
        "two levels: auto waits for block Jacobi for ever",
        "runtime/solvers/pcg.py",
        "most = min(options.max_iterations, self.PATIENCE) if is_new else options.max_iterations",
        "most = options.max_iterations",
        (f"{TWO_LEVEL}::test_auto_does_not_wait_for_block_jacobi_for_ever",),
    ),
    Mutation(
        "two levels: trials of auto stay frequent",
        "runtime/solvers/pcg.py",
        "longer = min(max(2 * self.wait, self.SHORTEST_WAIT), self.LONGEST_WAIT)",
        "longer = self.SHORTEST_WAIT",
        (f"{TWO_LEVEL}::test_auto_loses_little_to_the_better_one",),
    ),
    Mutation(
        "direct: SuperLU gets the upper triangle only",
        "runtime/solvers/direct.py",
        "sparse.csc_matrix(matrix + sparse.triu(matrix, 1).T)",
        "sparse.csc_matrix(matrix)",
        (f"{DIRECT}::test_solves_sum_of_parts",),
    ),
    Mutation(
        "direct: pivots that are not positive pass",
        "runtime/solvers/direct.py",
        "(factors.perm_r != order) | ~(pivots[order] > 0)",
        "(factors.perm_r != order)",
        (f"{DIRECT}::test_indefinite_matrix_names_a_block",),
    ),
    Mutation(
        "direct: of two symmetric blocks the lower one is left out",
        "runtime/solvers/direct.py",
        "np.repeat(i != j, r * c)",
        "np.repeat(i < j, r * c)",
        ("tests/runtime/matrix/test_reordering.py::test_solvers_work_in_any_order",),
    ),
    Mutation(
        "direct: another sparsity of the same size is not noticed",
        "runtime/solvers/direct.py",
        "a[2:] == b[2:] and np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1])",
        "a[2:] == b[2:] and len(a[0]) == len(b[0])",
        ("tests/runtime/projection/test_borderline_matrices.py::test_blocks_of_the_same_number_at_other_places",),
    ),
    Mutation(
        "auto: the direct solver gets one system too many",
        "runtime/solvers/choice.py",
        "self.direct_left = DIRECT_SOLVES - 1",
        "self.direct_left = DIRECT_SOLVES",
        ("tests/runtime/solvers/test_choice.py::test_auto_falls_back_and_comes_again",),
    ),
)
