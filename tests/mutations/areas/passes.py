"""Passes: what is differentiated, where Hessians are projected, which indices blocks get."""

from __future__ import annotations

from mutation import Mutation

EXPRESSIONS = ("tests/properties/test_expressions.py",)
PASSES = ("tests/properties/test_scenes.py::test_passes",)
WIDTHS = ("tests/passes/transforms/test_project_psd.py", "tests/passes/transforms/test_projection_widths.py")
ISOTROPY = (
    "tests/passes/analysis/test_isotropy.py::test_not_proven",
    "tests/passes/analysis/test_isotropy.py::test_proven",
)
CHAINS = ("tests/passes/calculus/test_scalar_chains.py",)
DERIVATIVES = ("tests/passes/transforms/test_differentiate.py",)
WIDE = "tests/frontend/execution/test_wide_hessians.py"

SEEN_THROUGH = ("tests/passes/transforms/test_cut_seen_through.py",)

MUTATIONS = (
    Mutation(
        "derivatives that read what lies before the cut go unseen",
        "passes/transforms/differentiate.py",
        "if sees_beside(listed, values, inputs):",
        "if False:",
        SEEN_THROUGH,
    ),
    Mutation(
        "a choice between numbers: the guards of its sides exchanged",
        "passes/calculus/derivatives.py",
        "guard_first, guard_second = guards.split(",
        "guard_second, guard_first = guards.split(",
        EXPRESSIONS,
    ),
    Mutation(
        "reverse mode: cotangents of several uses not added",
        "passes/calculus/derivatives.py",
        "parts.setdefault(op.operands[k], []).append(part)",
        "parts[op.operands[k]] = [part]",
        EXPRESSIONS,
    ),
    Mutation(
        "infer-indices: a union's capacity is its smallest member's",
        "passes/transforms/infer_indices.py",
        "capacity = max(",
        "capacity = min(",
        PASSES,
    ),
    Mutation(
        "project-psd: abs and clamp exchanged in the scalar code",
        "passes/transforms/lower_to_scalar.py",
        "projection.mode.data",
        '("abs" if projection.mode.data == "clamp" else "clamp")',
        PASSES,
    ),
    Mutation(
        "linear cut: a value that an operation on its results bends counts as not bent",
        "passes/calculus/linear_cut.py",
        "if op.result in bent or not op.is_linear(",
        "if not op.is_linear(",
        WIDTHS,
    ),
    Mutation(
        "linear cut: the flow may not be as wide as the inputs",
        "passes/calculus/linear_cut.py",
        "edges += [(operand, op.result) for operand in affine]",
        "edges += [(operand, op.result) for operand in affine[:1]]",
        WIDTHS,
    ),
    Mutation(
        "project-psd: a larger matrix inside is projected",
        "passes/transforms/project_psd.py",
        "shape_of(middle)[0] > shape_of(value)[0]",
        "shape_of(middle)[0] < shape_of(value)[0]",
        WIDTHS,
    ),
    Mutation(
        "project-psd: the gradient's shared values are projected and the Hessian is not",
        "passes/transforms/project_psd.py",
        'named(hessian(terminator.hessian), "hessian"), wrt, cut))',
        "terminator.hessian, wrt, cut))",
        WIDTHS,
    ),
    Mutation(
        "isotropy: of a choice only the first side is looked at",
        "passes/analysis/isotropy.py",
        "return _both(operands[1], operands[2])",
        "return operands[1]",
        ISOTROPY,
    ),
    Mutation(
        "isotropy: vectors of space do not turn",
        "passes/analysis/isotropy.py",
        "VECTORS = {(3, 1): Spaces(Space.DEFORMED, Space.FIXED), (1, 3): Spaces(Space.FIXED, Space.DEFORMED)}",
        "VECTORS = {(3, 1): FIXED, (1, 3): FIXED}",
        ("tests/passes/analysis/test_isotropy.py::test_not_isotropic_in_two_vectors",),
    ),
    Mutation(
        "isotropy: the trace of a matrix between two spaces counts as unchanged",
        "passes/analysis/isotropy.py",
        "return FIXED if isinstance(a, AnySpace) or a.rows is a.cols else None",
        "return FIXED",
        ISOTROPY,
    ),
    Mutation(
        "isotropy: any matrix that scales axes counts as a multiple of the identity",
        "passes/analysis/isotropy.py",
        "bool(np.all(entries == entries[0, 0] * np.eye(rows)))",
        "bool(np.all(entries == np.diag(np.diag(entries))))",
        ISOTROPY,
    ),
    Mutation(
        "differentiate: of a UNION only the first member gets a Jacobian",
        "passes/transforms/differentiate.py",
        "            for member in read.members:",
        "            for member in list(read.members)[:1]:",
        DERIVATIVES,
    ),
    Mutation(
        "differentiate: a nonlinear layer behind an affine one is not known to be curved",
        "passes/transforms/differentiate.py",
        "return any(self.is_curved_read(value.owner) for value in terminator.wrt)",
        "return False",
        DERIVATIVES,
    ),
    Mutation(
        "differentiate: the curvature is that of the rows, not of the whole attribute",
        "passes/transforms/differentiate.py",
        "{value: cotangent}, inputs)\n        hessian = jacobian(",
        "{value: b.neg(cotangent)}, inputs)\n        hessian = jacobian(",
        DERIVATIVES,
    ),
    Mutation(
        "widths: a JOIN counts as one instance",
        "passes/analysis/local_width.py",
        "return _Width(times * behind.unknowns,",
        "return _Width(behind.unknowns,",
        (f"{WIDE}::test_a_sum_over_too_many_unknowns_is_refused",),
    ),
    Mutation(
        "widths: what is projected as a whole may be as wide as what is not",
        "passes/analysis/local_width.py",
        "most = WIDEST_CURVED if curved else WIDEST_EXPANDED",
        "most = WIDEST_EXPANDED",
        (f"{WIDE}::test_curvature_of_too_many_unknowns_is_refused",),
    ),
    Mutation(
        "inline-references: members of a UNION are dropped as if nobody needed them",
        "passes/transforms/inline_references.py",
        "stack.extend(name_of(member) for member in op.members)",
        "pass",
        ("tests/passes/transforms/test_inline_references.py",),
    ),
    Mutation(
        "forward mode: what two changed values make is visited with the first alone",
        "passes/calculus/derivatives.py",
        "heappush(waiting, user)",
        "waiting.insert(0, user)",
        EXPRESSIONS,
    ),
    Mutation(
        "forward mode: what is as old as the seeds counts as older",
        "passes/calculus/derivatives.py",
        "self.b.age(current) < self._oldest",
        "self.b.age(current) <= self._oldest + 1",
        CHAINS,
    ),
    Mutation(
        "scalar chains: a quotient slope / norm may have any front",
        "passes/calculus/scalar_chains.py",
        "and all(u is norm for norm in norms for u in front)",
        "",
        CHAINS,
    ),
    Mutation(
        "scalar chains: a front is not followed to the bottleneck before it",
        "passes/calculus/scalar_chains.py",
        "if not inner or len(front) > FARTHEST_FRONT:",
        "if best is not None:",
        CHAINS,
    ),
    Mutation(
        "verification: operations on operands of other shapes look the same",
        "passes/pipeline.py",
        "operands = [(type(operand), operand.type) for operand in op.operands]",
        "operands = [type(operand) for operand in op.operands]",
        (
            "tests/passes/test_pipeline.py::test_an_operation_that_a_pass_breaks_is_found_beside_equal_ones_that_are_whole",
        ),
    ),
    Mutation(
        "a given Jacobian is pushed forward only: backwards nothing comes of it",
        "dialects/mat/calculus.py",
        "parts.append(b.reshape(b.block(column, start, 0, rows * cols, 1), (rows, cols)))",
        "parts.append(None)",
        ("tests/frontend/test_given_derivatives.py",),
    ),
    Mutation(
        "a value with a given constant Jacobian counts as linear, and so does one with any",
        "dialects/mat/calculus.py",
        "return not active[1]",
        "return True",
        ("tests/frontend/test_given_derivatives.py::test_arguments_above_a_narrower_cut",),
    ),
    Mutation(
        "given eigenvalues are not what is projected",
        "passes/transforms/project_psd.py",
        "        if shape_of(middle)[0] > shape_of(value)[0]:\n",
        "        if shape_of(middle)[0] > shape_of(value)[0] or dependence.is_active(linear):\n",
        ("tests/frontend/test_given_derivatives.py::test_nothing_is_left_behind_differentiation",),
    ),
    Mutation(
        "a given Hessian by values that are no targets is taken for that of the targets alone",
        "passes/transforms/differentiate.py",
        "    if any(dependence[argument] is not Dependence.AFFINE for argument in arguments):\n        return None\n",
        "",
        ("tests/frontend/test_given_derivatives.py",),
    ),
    Mutation(
        "a given gradient may miss the arguments' neighbours",
        "frontend/execution/emit.py",
        "if stored in self.varied:",
        "if stored in self.varied and False:",
        ("tests/frontend/test_given_derivatives.py::test_given_derivatives_are_those_that_would_be_derived",),
    ),
    Mutation(
        "a wrong gradient is within the tolerance",
        "frontend/language/given_derivatives.py",
        "TOLERANCE = 1e-6",
        "TOLERANCE = 1e-2",
        ("tests/frontend/test_given_derivatives.py::test_wrong_derivatives_are_refused",),
    ),
)
