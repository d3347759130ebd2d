"""`lower-to-scalar`: what is computed, and nothing else; how much it costs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from small_scenes import emit
from xdsl.dialects import arith, func
from xdsl.dialects.builtin import FloatAttr, IntegerAttr, ModuleOp
from xdsl.ir import Operation

from yasps import Scene
from yasps.dialects.rel import DerivativeOp, ProjectOp, YieldDerivativeOp, packed_size
from yasps.passes.pipeline import run_pipeline
from yasps.passes.transforms.lower_to_scalar import BINARY, UNARY


def functions(module: ModuleOp) -> dict[str, func.FuncOp]:
    """Scalar functions by name."""
    return {op.sym_name.data: op for op in module.walk() if isinstance(op, func.FuncOp)}


def arithmetic(function: func.FuncOp) -> list[Operation]:
    """Operations that cost something."""
    return [op for op in function.body.block.ops if not isinstance(op, arith.ConstantOp | func.ReturnOp)]


def _is_constant(value: Any, number: float) -> bool:
    return (
        isinstance(value.owner, arith.ConstantOp)
        and isinstance(value.owner.value, FloatAttr | IntegerAttr)
        and value.owner.value.value.data == number
    )


OPERATIONS = {
    # energy and function: operations now; a change may make it fewer, and should then lower the number here
    "soft_tets": {"m.t.elastic.value": 144, "m.t.elastic.derive": 478, "m.t.elastic.pull_back": 951},
    "mixed_union": {
        "stiff.v.x.value": 18,
        "stiff.v.x.pull_back": 9,
        "both.pp.barrier.value": 15,
        "both.pp.barrier.derive": 126,
        "both.pp.barrier.pull_back": 6,
        "both.v.gravity.derive": 10,
    },
}


@pytest.mark.parametrize("scene", OPERATIONS)
def test_operation_counts_do_not_grow(scene: str, pipeline_run: Callable[[str, str], Any]) -> None:
    found = {name: len(arithmetic(op)) for name, op in functions(pipeline_run(scene, "clamp").last).items()}
    for name, most in OPERATIONS[scene].items():
        assert found[name] <= most, f"{name} takes {found[name]} operations, it took {most}"


def test_no_operation_is_trivial(run: Any) -> None:
    """Structural zeros and ones of Jacobians cost nothing."""
    for name, function in functions(run.last).items():
        for op in arithmetic(function):
            operands = list(op.operands)
            if isinstance(op, arith.SelectOp | arith.CmpfOp):  # 0 is an outcome, and what signs are told by
                continue
            if isinstance(op, arith.DivfOp) and _is_constant(op.operands[0], 1.0) and _is_constant(op.operands[1], 0.0):
                continue  # infinity, where the energy is not finite
            assert not any(_is_constant(v, 0.0) for v in operands), f"{name}: {op}"
            if isinstance(op, arith.MulfOp):
                assert not any(_is_constant(v, 1.0) for v in operands), f"{name}: {op}"
            assert not all(isinstance(v.owner, arith.ConstantOp) for v in operands), f"{name}: {op}"


def test_no_operation_is_made_twice_or_for_nothing(run: Any) -> None:
    for name, function in functions(run.last).items():
        seen = set()
        for op in arithmetic(function):
            key = (op.name, *(id(v) for v in op.operands))
            assert key not in seen, f"{name}: {op}"
            seen.add(key)
            assert op.results[0].first_use is not None, f"{name}: nobody uses {op}"


def test_only_scalar_operations_are_left(run: Any) -> None:
    known = {getattr(make, "name", "") for make in (*BINARY.values(), *UNARY.values())}
    known |= {"math.powf", "arith.cmpf", "arith.select"}
    for function in functions(run.last).values():
        assert {op.name for op in arithmetic(function)} <= known
    assert not [op.name for op in run.last.walk() if op.name.startswith("mat.")]


def test_only_upper_triangles_are_computed(run: Any) -> None:
    """A Hessian of n entries is n (n + 1) / 2 results, before and after the projection.

    The matrix that an energy is isotropic in is a result too, and the energy, which is looked at.
    """
    derivatives = [op for op in run.last.walk() if isinstance(op, DerivativeOp)]
    assert derivatives
    made = functions(run.last)
    for derivative in derivatives:
        terminator = derivative.body.block.last_op
        assert isinstance(terminator, YieldDerivativeOp)
        name = derivative.attribute.root_reference.data
        n = terminator.gradient.type.get_shape()[0]  # type: ignore[attr-defined]
        assert terminator.hessian is not None
        assert terminator.hessian.type.get_shape() == (packed_size(n), 1)  # type: ignore[attr-defined]
        projects = [op for op in derivative.body.block.ops if isinstance(op, ProjectOp)]
        if not projects:  # a constant Hessian is projected while compiling
            returned = made[f"{name}.derive"].body.block.last_op
            assert isinstance(returned, func.ReturnOp)
            assert all(isinstance(v.owner, arith.ConstantOp) for v in returned.arguments[1 + n :])
        width = projects[0].width.value.data if projects else n
        derive = made[f"{name}.derive"].function_type.outputs.data
        isotropic = bool(projects) and projects[0].deformation is not None
        assert len(derive) == 1 + n + packed_size(width) + (width if isotropic else 0)
        assert (f"{name}.pull_back" in made) == (width < n)
        if width < n:
            assert len(made[f"{name}.pull_back"].function_type.outputs.data) == packed_size(n)


def test_a_body_reads_only_what_its_function_uses() -> None:
    """e = a . x: the gradient needs a and not x."""
    scene = Scene("s")
    points = scene.add_mesh("m").add_primitive("v", 2)
    points.add_constant("a", 3, 1, value=np.ones((2, 3)))
    points.add_attribute("x", 3, 1)
    scene.add_energy(points.add_attribute("e", computed_attribute=points["a"].dot(points["x"])))
    scene.add_minimize_target(points["x"])
    emitted = emit(scene)
    run_pipeline(emitted.module)
    derive = functions(emitted.module)["m.v.e.derive"]
    assert len(derive.body.block.args) == 3
    assert arithmetic(derive) == []


def test_a_constant_jacobian_costs_nothing(pipeline_run: Callable[[str, str], Any]) -> None:
    """x + shift: J^T v is v twice."""
    pull = functions(pipeline_run("shared_targets", "clamp").last)["m.v.moved.pull_back"]
    assert arithmetic(pull) == []
    assert len(pull.body.block.args) == 3
    assert len(pull.function_type.outputs.data) == 6


def test_a_jacobian_applies_its_structure(pipeline_run: Callable[[str, str], Any]) -> None:
    """A r + t: A's part of J^T v is the outer product v r^T, 9 products and no sum."""
    pull = functions(pipeline_run("mixed_union", "clamp").last)["stiff.v.x.pull_back"]
    assert [op.name for op in arithmetic(pull)] == ["arith.mulf"] * 9
