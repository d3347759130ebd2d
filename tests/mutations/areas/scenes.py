"""Compiled scenes: what is found again when something changed, and what users get."""

from __future__ import annotations

from mutation import Mutation

ORDER = "tests/frontend/execution/test_instance_order.py"
PRIMITIVE = "tests/frontend/language/test_primitive.py"
RESIZING = "tests/frontend/language/test_resizing.py"

MUTATIONS = (
    Mutation(
        "a refused resize leaves the new sizes",
        "frontend/language/resizing.py",
        "    except BaseException:\n        _set_sizes(before)\n        raise\n    kept",
        "    except ZeroDivisionError:\n        raise\n    kept",
        (f"{RESIZING}::test_a_refused_change_leaves_every_bit",),
    ),
    Mutation(
        "indices of a union are not renumbered",
        "frontend/language/resizing.py",
        "        moved[there] += (starts - old_starts)[of_leaf]\n",
        "",
        (f"{RESIZING}::test_one_primitive_by_names_and_indices_of_others_in_a_union",),
    ),
    Mutation(
        "what leads to a primitive of another size may keep its indices",
        "frontend/language/resizing.py",
        "            if leaves[k] in self._old:\n",
        "            if False:\n",
        (f"{RESIZING}::test_a_refused_change_leaves_every_bit",),
    ),
    Mutation(
        "numbers on a union need not follow its members",
        "frontend/language/resizing.py",
        "if any(leaf in old for leaf in _leaves(one))]",
        "if one in old]",
        (f"{RESIZING}::test_a_refused_change_leaves_every_bit",),
    ),
    Mutation(
        "a scene is not told of other sizes",
        "frontend/language/resizing.py",
        "            scene.size_changed(owner)\n",
        "            pass\n",
        (f"{RESIZING}::test_a_target_that_nothing_leads_to",),
    ),
    Mutation(
        "new indices of static energies keep the old sparsity",
        "frontend/execution/compiled_scene.py",
        "if connectivity in self._static_reads.connectivities:",
        "if False:",
        (f"{ORDER}::test_new_numbers_and_new_indices_are_seen", "tests/frontend/language/test_connectivity.py"),
    ),
    Mutation(
        "pairs that come and go keep the old sparsity",
        "frontend/execution/compiled_scene.py",
        "            return\n        self._bound = False\n        self._dynamic_valid = False\n        if connectivity",
        "            return\n        self._bound = False\n        if connectivity",
        ("tests/frontend/test_changes.py::test_as_many_pairs_at_other_places",),
    ),
    Mutation(
        "a target that grows keeps its place in the gradient",
        "frontend/execution/compiled_scene.py",
        "or any(target.owner is owner for target in self.targets):",
        "or owner is None:",
        ("tests/frontend/test_changes.py::test_a_target_that_grows_moves_those_after_it",),
    ),
    Mutation(
        "new arrays are not pointed to",
        "frontend/language/primitive.py",
        "        self.scene.arrays_moved(self)\n\n    @one_thread_at_a_time\n    def resize",
        "\n    @one_thread_at_a_time\n    def resize",
        ("tests/frontend/test_changes.py::test_numbers_of_the_same_count_alone",),
    ),
    Mutation(
        "a failed update of several parts changes the first ones",
        "frontend/language/primitive.py",
        "indices[part] = part.checked_parts(value)\n                counts",
        "indices[part] = part.checked_parts(value)\n"
        "                part._replace(indices[part])\n                counts",
        ("tests/frontend/test_changes.py::test_a_refused_update_of_several_parts_changes_none",),
    ),
    Mutation(
        "an instance is named in the order of the kernel",
        "frontend/execution/cpu_scene.py",
        "int(placement.ordered.order[bad])",
        "bad",
        (f"{ORDER}::test_an_error_names_the_instance_of_the_user",),
    ),
    Mutation(
        "new numbers are not seen where instances have another order",
        "frontend/execution/cpu_scene.py",
        "                placement.ordered.refresh()\n",
        "                pass\n",
        (f"{ORDER}::test_new_numbers_and_new_indices_are_seen",),
    ),
    Mutation(
        "a JOIN from a primitive to itself is put in another order",
        "frontend/execution/instance_order.py",
        "if _contains(connectivity.target, owner):",
        "if False:",
        ("tests/frontend/test_changes.py::test_only_instances_that_do_not_read_each_other_have_another_order",),
    ),
    Mutation(
        "what an ordered kernel reads of its own primitive is copied once",
        "frontend/execution/instance_order.py",
        "if array is not stored.array or version != stored.version:",
        "if array is not stored.array:",
        ("tests/frontend/test_changes.py::test_only_instances_that_do_not_read_each_other_have_another_order",),
    ),
    Mutation(
        "what is connected to a primitive that shrinks is not looked at",
        "frontend/execution/compiled_scene.py",
        "self._owners if owner in self._followed else {owner}",
        "{owner}",
        ("tests/frontend/test_errors.py::test_a_dynamic_target_that_shrank_is_an_error_not_a_memory_fault",),
    ),
    Mutation(
        "unions do not follow their members",
        "frontend/execution/compiled_scene.py",
        "stack += entity.members if isinstance(entity, PrimitiveUnion) else ()",
        "pass",
        ("tests/frontend/test_errors.py::test_stale_numbers_on_a_union_are_told",),
    ),
    Mutation(
        "a pointer that led to a copy is not put back",
        "backend/codegen/program.py",
        "            pointers[k] = bound.ctypes.data\n",
        "            pass\n",
        (f"{ORDER}::test_new_numbers_and_new_indices_are_seen",),
    ),
    Mutation(
        "static and dynamic part have dof blocks in different orders",
        "frontend/execution/cpu_scene.py",
        "self.dynamic_matrix.build(boundaries, block_sizes, kappas, order=self.static_matrix.order)",
        "self.dynamic_matrix.build(boundaries, block_sizes, kappas)",
        ("tests/frontend/execution/test_reordering.py",),
    ),
    Mutation(
        "on demand is always",
        "frontend/execution/compiled_scene.py",
        "return self.mode if wanted else Projection.NONE",
        "return self.mode",
        ("tests/frontend/execution/test_solver_choice.py",),
    ),
    Mutation(
        "the second half of a Hessian is missing",
        "frontend/execution/hessian.py",
        "rows += [i.ravel(), j[above].ravel()]",
        "rows += [i.ravel(), i[above].ravel()]",
        ("tests/frontend/execution/test_hessian.py",),
    ),
    Mutation(
        "blocks that the solver's order put below the diagonal are not transposed",
        "frontend/execution/hessian.py",
        "group.values[~above].transpose(0, 2, 1).copy()",
        "group.values[~above].copy()",
        ("tests/frontend/execution/test_reordering.py",),
    ),
    Mutation(
        "mixed derivatives: rows and columns exchanged",
        "frontend/scene.py",
        "whole[:count, count:]",
        "whole[count:, :count]",
        ("tests/frontend/execution/test_hessian.py::test_mixed_hessian_against_differences",),
    ),
    Mutation(
        "an unknown is named as one of the target before",
        "frontend/execution/compiled_scene.py",
        "if unknown < start + target.node.array.size:",
        "if unknown <= start + target.node.array.size:",
        ("tests/frontend/execution/test_solver_choice.py", "tests/frontend/test_errors.py"),
    ),
    Mutation(
        "rows of variable arity that get shorter are filled up with instance 0",
        "frontend/language/connectivity.py",
        "constant_values=-1))",
        "constant_values=0))",
        ("tests/frontend/test_changes.py::test_rows_of_variable_arity_that_get_shorter",),
    ),
    Mutation(
        "an index may be the number of instances",
        "frontend/language/connectivity.py",
        "if rows.size and (rows.min() < lowest or rows.max() >= count):",
        "if rows.size and (rows.min() < lowest or rows.max() > count):",
        ("tests/frontend/test_changes.py::test_the_number_of_instances_is_no_index",),
    ),
    Mutation(
        "on demand keeps what conjugate gradients made of an indefinite matrix",
        "frontend/execution/newton_system.py",
        "if solution.report.reason is StopReason.NOT_POSITIVE_DEFINITE:\n        return True",
        "if solution.report.reason is StopReason.NOT_POSITIVE_DEFINITE:\n        return False",
        ("tests/frontend/execution/test_solver_choice.py",),
    ),
)
