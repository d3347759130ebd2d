"""Generated kernels of the processor: gather, project in batches, pull back, scatter."""

from __future__ import annotations

from mutation import Mutation

SCENES = ("tests/properties/test_scenes.py::test_kernels",)
KERNELS = ("tests/backend/cpp/test_kernels.py",)
BLOCKS = (
    "tests/backend/cpp/test_kernels.py::test_blocks_of_other_sizes_than_3x3_are_turned_where_they_lie_below_the_diagonal",
)
DIVIDED = ("tests/backend/codegen/test_scalar_function.py",)
NOT_FINITE = "tests/backend/cpp/test_not_finite.py"

UNIONS = "tests/properties/test_unions.py"

MUTATIONS = (
    Mutation(
        "a UNION's gradient is added where there is no target",
        "backend/codegen/expanding_text.py",
        'add if same.slot.is_target else f"if (kappa[{leaf}]) {add}"',
        "add",
        (f"{UNIONS}::test_unions_of_targets_and_constants",),
    ),
    Mutation(
        "all members of a stored UNION start at 0",
        "backend/codegen/object_text.py",
        'f"({index} - {offsets}[{k}])" if k else index',
        "index",
        (f"{UNIONS}::test_unions_of_targets_and_constants",),
    ),
    Mutation(
        "a UNION with a computed member of targets is taken for direct",
        "backend/codegen/scene_view.py",
        "self.is_direct(member) or not self.reaches_target(member)",
        "True",
        SCENES,
    ),
    Mutation(
        "constants that a union leads back to are reordered",
        "frontend/execution/instance_order.py",
        "if _contains(connectivity.target, owner):",
        "if connectivity.target is owner:",
        (f"{UNIONS}::test_instances_keep_their_order_where_a_union_leads_back_to_them",),
    ),
    Mutation(
        "kernels: a target's placement index off by one instance's",
        "backend/codegen/object_text.py",
        'return [f"{out}[0] = (int)({start}[0]{offset} + 1);"]',
        'return [f"{out}[0] = (int)({start}[0]{offset} + 2);"]',
        SCENES,
    ),
    Mutation(
        "kernels: a union's branches all start at 0 in the pull-back",
        "backend/codegen/object_text.py",
        "const long j = i - {offsets}[{k}]; ",
        "const long j = i - {offsets}[0]; ",
        SCENES,
    ),
    Mutation(
        "kernels: large arrays lie on the stack",
        "backend/cpp/object.py",
        "if count * BYTES_OF_A_PACK <= LARGEST_STACK:",
        "if count >= 0:",
        ("tests/frontend/execution/test_wide_hessians.py::test_a_wide_hessian_needs_no_deep_stack",),
    ),
    Mutation(
        "kernels: transpose flag ignored in add_block",
        "backend/cpp/preludes/kernel.h",
        "} else if (position & kYaspsTurned) {",
        "} else if (position & 0) {",
        BLOCKS,
    ),
    Mutation(
        "curvature: what lies behind a nonlinear layer is dropped",
        "backend/codegen/expanding_text.py",
        'f"double w[{q}];", compute, *behind]',
        'f"double w[{q}];", compute]',
        SCENES,
    ),
    Mutation(
        "an instance is named wrongly from the second batch on",
        "backend/cpp/derivative.py",
        "return start - changed - 1;",
        "return begin - changed - 1;",
        (f"{NOT_FINITE}::test_an_infinite_hessian_names_the_instance_in_every_batch",),
    ),
    Mutation(
        "NaN in the last entries is not looked at",
        "backend/cpp/preludes/kernel.h",
        "for (; n > 0; --n, ++x) a += x[0] * 0.0;",
        "",
        (f"{NOT_FINITE}::test_every_entry_of_a_gradient_is_looked_at",),
    ),
    Mutation(
        "a Hessian that is not projected may be infinite",
        "backend/cpp/derivative.py",
        'if "middle" in local.outputs and not is_projected:',
        "if False:",
        (f"{NOT_FINITE}::test_every_entry_of_a_hessian_that_is_not_projected_is_looked_at",),
    ),
    Mutation(
        "the last instance of a pack is not scattered",
        "backend/cpp/expand.py",
        'block("for (long l = 0; l < lanes; ++l)"',
        'block("for (long l = 0; l + 1 < lanes; ++l)"',
        ("tests/backend/cpp/test_batches.py::test_counts_around_batches",),
    ),
    Mutation(
        "the last partial pack of values is left out",
        "backend/cpp/object.py",
        'block("for (long first = begin; first < end; first += 8)"',
        'block("for (long first = begin; first + 8 <= end; first += 8)"',
        ("tests/backend/cpp/test_batches.py::test_numbers_of_every_count_are_gathered",),
    ),
    Mutation(
        "packs of one batch are scattered as if they were the first",
        "backend/cpp/derivative.py",
        'middle = ["V* const middle = middle_of[pack];"]',
        'middle = ["V* const middle = middle_of[0]; (void)pack;"]',
        ("tests/backend/cpp/test_batches.py::test_counts_around_batches",),
    ),
    Mutation(
        "3x3 blocks: transpose flag ignored",
        "backend/cpp/preludes/scatter.h",
        "V sum = turned_if(where & kYaspsTurned, same);",
        "V sum = same;",
        ("tests/backend/cpp/test_batches.py::test_counts_around_batches",),
    ),
    Mutation(
        "3x3 blocks: the last entry of merged slots comes once",
        "backend/cpp/preludes/scatter.h",
        "last += last;",
        "",
        ("tests/backend/cpp/test_batches.py::test_counts_around_batches",),
    ),
    Mutation(
        "blocks of any shape: merged slots add a block twice, not it and its transpose",
        "backend/cpp/preludes/kernel.h",
        "b[r * cols + c] + b[c * cols + r]",
        "2 * b[r * cols + c]",
        SCENES,
    ),
    Mutation(
        "expansion: merged leaves add a block once",
        "backend/cpp/preludes/expand.h",
        "b[c * across + r] + b[r * across + c]",
        "b[c * across + r]",
        (f"{KERNELS[0]}::test_both_slots_on_one_affine_body",),
    ),
    Mutation(
        "expansion: the part of a row left of the diagonal comes from another row",
        "backend/cpp/preludes/expand.h",
        "to[c - begin] = triangle[upper_place(n, c, r)];",
        "to[c - begin] = triangle[upper_place(n, begin, r)];",
        KERNELS,
    ),
    Mutation(
        "expansion: transpose flag ignored",
        "backend/cpp/preludes/expand.h",
        "} else if (where & kYaspsTurned) {",
        "} else if (where & 0) {",
        SCENES,
    ),
    Mutation(
        "gather: pairs of numbers are all written to the first place",
        "backend/cpp/preludes/kernel.h",
        "gather_two(p + k, at, to + k);",
        "gather_two(p + k, at, to + k % 2);",
        ("tests/backend/cpp/test_batches.py::test_numbers_of_every_count_are_gathered",),
    ),
    Mutation(
        "a mean is a sum in the pull-back",
        "backend/codegen/expanding_text.py",
        'if slot.reduction == "mean":\n            lines.append(',
        'if slot.reduction == "sum":\n            lines.append(',
        SCENES,
    ),
    Mutation(
        "a mean is a sum in the value",
        "backend/codegen/object_text.py",
        'if op.reduction == "mean":',
        "if False:",
        ("tests/properties/test_scenes.py::test_kernels",),
    ),
    Mutation(
        "a UNION's placement indices are not filled up with 0",
        "backend/codegen/object_text.py",
        'padding = "".join(f" out[{e}] = 0;" for e in range(self.scene.size(member), size))',
        'padding = ""',
        SCENES,
    ),
    Mutation(
        "nonlinear layers: leaves with one place are not merged before they are projected",
        "backend/codegen/preludes/merge.h",
        "while (k < leaves && kappa[leaf[k]] != kappa[p]) ++k;",
        "k = leaves;",
        SCENES,
    ),
    Mutation(
        "nonlinear layers: transpose flag ignored",
        "backend/codegen/preludes/merge.h",
        "where & kYaspsTurned ? c * rows + r : r * cols + c",
        "r * cols + c",
        SCENES,
    ),
    Mutation(
        "comparisons of packs: < is >",
        "backend/codegen/scalar_function.py",
        '"olt": "{0} < {1}"',
        '"olt": "{0} > {1}"',
        ("tests/frontend/language/test_functions.py",),
    ),
    Mutation(
        "packed triangles: an entry below the diagonal is looked for as if it were above",
        "runtime/core/sink.h",
        "r <= c ? upper_place(n, r, c) : upper_place(n, c, r)",
        "upper_place(n, r, c)",
        ("tests/backend/codegen/test_agreement.py::test_a_packed_triangle_has_one_order",),
    ),
    Mutation(
        "divided functions: a place is used again by the part that still reads it",
        "backend/codegen/scalar_function.py",
        "freed_after[last_use[value]] += to",
        "freed_after[k] += to",
        DIVIDED,
    ),
)
