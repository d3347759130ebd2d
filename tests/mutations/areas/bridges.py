"""Energies as functions of arrays."""

from __future__ import annotations

from mutation import Mutation

FUNCTION = "tests/bridges/test_energy_function.py"
LAYERS = "tests/bridges/test_trajectory_layers.py"

MUTATIONS = (
    Mutation(
        "a call leaves its arguments in the scene",
        "yasps/bridges/energy_function.py",
        "                for attribute, array in zip(self.inputs, before, strict=True):\n"
        "                    attribute.update_value(array)\n",
        "                pass\n",
        (f"{FUNCTION}::test_the_scene_is_as_it_was_after_an_error",),
    ),
    Mutation(
        "a kept Hessian is used although other numbers have changed",
        "yasps/bridges/energy_function.py",
        "all(a is b and k == m for (a, k), (b, m) in",
        "all(a is b for (a, k), (b, m) in",
        (f"{FUNCTION}::test_products_know_what_was_set_between",),
    ),
    Mutation(
        "a kept Hessian is used although the arguments are others",
        "yasps/bridges/energy_function.py",
        "            and all(np.array_equal(a, b) for a, b in zip(arrays, self.arrays, strict=True))\n",
        "",
        (f"{FUNCTION}::test_derivatives_with_respect_to_targets_and_parameters",),
    ),
    Mutation(
        "connections are left out of what a Hessian was computed from",
        "frontend/execution/compiled_scene.py",
        "return [*arrays, *((connected.stored_indices, 0) for connected in self.emitter.connected.values())]",
        "return [*arrays]",
        (f"{FUNCTION}::test_products_know_what_was_set_between",),
    ),
    Mutation(
        "outside its domain an objective is NaN, and a trust region stays where it is",
        "yasps/bridges/scipy.py",
        "return np.inf if np.isnan(value) else value",
        "return value",
        (f"{FUNCTION}::test_the_scene_is_as_it_was_after_an_error",),
    ),
    Mutation(
        "energies that are named are left out of what a compiled scene is kept by",
        "frontend/execution/variants.py",
        "key = (tuple(inputs), tuple(chosen))",
        "key = (tuple(inputs), ())",
        (f"{FUNCTION}::test_scipy_finds_the_minimum", f"{FUNCTION}::test_an_energy_that_is_not_registered"),
    ),
    Mutation(
        "a run as a function keeps the parameters of its last call",
        "yasps/bridges/trajectory_function.py",
        "                for parameter, array in zip(self.parameters, before, strict=True):\n"
        "                    self.trajectory.set(parameter, array)\n",
        "                pass\n",
        (f"{LAYERS}::test_a_run_as_a_function",),
    ),
    Mutation(
        "slopes of all frames are taken for those of the first",
        "yasps/bridges/trajectory_function.py",
        "found.get(output, 0.0) + slope[k]",
        "found.get(output, 0.0) + slope[0]",
        (f"{LAYERS}::test_a_run_as_a_function",),
    ),
)
