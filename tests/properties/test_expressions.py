"""Random expressions on one primitive: value, gradient and Hessian after every pass, against oracles of their own."""

from __future__ import annotations

import dataclasses
from fractions import Fraction
from typing import Any

import numpy as np
from exact_numbers import Exact, HyperDual, array_of, fraction
from hypothesis import given
from numpy.typing import NDArray
from profiles import examples
from random_expressions import ALL_WORDS, INSTANCES, IR_WORDS, Expression, expressions
from small_scenes import emit
from xdsl.dialects.builtin import ModuleOp

from yasps.backend.interpreter import Interpreter, SceneData
from yasps.dialects.mat import Batch, shape_of
from yasps.dialects.rel import DataOp, YieldDerivativeOp, name_of
from yasps.passes.pipeline import run_pipeline

STEP = 1e-30
ENERGY = "m.points.energy"


def stages(expression: Expression) -> tuple[dict[str, ModuleOp], SceneData]:
    """The module after every pass."""
    emitted = emit(expression.scene())
    modules: dict[str, ModuleOp] = {}
    run_pipeline(emitted.module, None, lambda name, module: modules.update({name: module.clone()}))
    return modules, emitted.data


def derivatives(interpreter: Interpreter, targets: list[str]) -> tuple[Batch, Batch] | None:
    """Gradients [instances, n] and Hessians [instances, n, n] by the entries of all targets in order."""
    if not interpreter.scene.derivatives:
        return None
    (derivative,) = interpreter.scene.derivatives
    gradient, hessian = interpreter.local_derivative(derivative)
    terminator = derivative.body.block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    starts, end = {}, 0
    for target in targets:
        starts[target] = end
        end += interpreter.scene.size(target)
    places: list[int] = []
    for value in terminator.wrt:
        assert isinstance(value.owner, DataOp)
        start = starts[name_of(value.owner.storage)]
        rows, cols = shape_of(value)
        places += range(start, start + rows * cols)
    whole_gradient = np.zeros((INSTANCES, end), gradient.dtype)
    whole_gradient[:, places] = gradient
    whole_hessian = np.zeros((INSTANCES, end, end), gradient.dtype)
    if hessian is not None:
        whole_hessian[np.ix_(range(INSTANCES), places, places)] = hessian
    return whole_gradient, whole_hessian


def raw_hessian(interpreter: Interpreter) -> Batch | None:
    """The Hessian as the module has it, lower triangle included."""
    (derivative,) = interpreter.scene.derivatives
    terminator = derivative.body.block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    return None if terminator.hessian is None else interpreter.run(derivative, {})[terminator.hessian]


def directions(seed: int, size: int) -> NDArray[np.int64]:
    """Whole numbers, none of them zero."""
    random = np.random.default_rng(seed)
    signs: NDArray[np.int64] = random.choice([-1, 1], size)
    return random.integers(1, 9, size) * signs


def oracle(expression: Expression, instance: int, u: Any, w: Any) -> HyperDual:
    """The energy of x + u e1 + w e2."""
    inputs, start = [], 0
    for entries in expression.point():
        size = entries[0].size
        along = [np.asarray(d[start : start + size]).reshape(entries[0].shape) for d in (u, w)]
        inputs.append(
            array_of(
                lambda e, a, b: HyperDual(Fraction(e), Fraction(int(a)), Fraction(int(b))), entries[instance], *along
            )
        )
        start += size
    result = expression.evaluate(inputs, lambda number: HyperDual(Fraction(number)))[-1].item()
    assert isinstance(result, HyperDual)
    return result


@examples(ci=150, nightly=4000)
@given(expressions(rational=True))
def test_rational_expressions_are_exact(expression: Expression) -> None:
    modules, data = stages(expression)
    names = [f"m.points.t{k}" for k in range(len(expression.inputs))]
    exact = {name: array_of(lambda e: Exact(Fraction(e)), x) for name, x in zip(names, expression.point(), strict=True)}
    moved = dataclasses.replace(data, storages=exact)
    n = sum(rows * cols for rows, cols in expression.inputs)
    u, w = directions(1, n), directions(2, n)
    wanted = [oracle(expression, instance, u, w) for instance in range(INSTANCES)]
    for stage, module in modules.items():
        interpreter = Interpreter(module, moved)
        values = [fraction(v) for v in interpreter.value(ENERGY).ravel()]
        assert values == [number.value for number in wanted], f"value after {stage}"
        found = derivatives(interpreter, names)
        if found is None:
            continue
        gradient, hessian = found
        slopes = [fraction(g @ u) for g in gradient]
        assert slopes == [number.first for number in wanted], f"gradient after {stage}"
        curvatures = [fraction(u @ h @ w) for h in hessian]
        assert curvatures == [number.both for number in wanted], f"Hessian after {stage}"
        if stage == "differentiate":
            raw = raw_hessian(interpreter)
            assert raw is None or (raw == raw.swapaxes(1, 2)).all(), "the Hessian's two triangles differ"
    if not Interpreter(modules["differentiate"], moved).scene.derivatives:
        assert all(number.first == 0 and number.both == 0 for number in wanted), "derivatives are missing"


@examples(ci=60, nightly=2000)
@given(expressions(rational=False))
def test_smooth_expressions_agree_with_complex_steps(expression: Expression) -> None:
    modules, data = stages(expression)
    names = [f"m.points.t{k}" for k in range(len(expression.inputs))]
    real = dict(zip(names, expression.point(), strict=True))
    by_hand = [
        expression.evaluate([x[instance] for x in real.values()], float)[-1].item() for instance in range(INSTANCES)
    ]
    slopes, curvatures = [], []
    for name, (rows, cols) in zip(names, expression.inputs, strict=True):
        for place in np.ndindex(rows, cols):
            stepped = real[name].astype(complex)
            stepped[:, *place] += 1j * STEP  # both instances at once: they know nothing of each other
            moved = dataclasses.replace(data, storages={**real, name: stepped})
            value = Interpreter(modules["frontend"], moved).value(ENERGY)
            slopes.append(value[:, 0, 0].imag / STEP)
            found = derivatives(Interpreter(modules["differentiate"], moved), names)
            if found is not None:
                curvatures.append(found[0].imag / STEP)
    slope = np.stack(slopes, axis=1)
    for stage, module in modules.items():
        interpreter = Interpreter(module, dataclasses.replace(data, storages=real))
        assert_close(interpreter.value(ENERGY)[:, 0, 0], np.array(by_hand), f"value after {stage}")
        found = derivatives(interpreter, names)
        if found is not None:
            assert_close(found[0], slope, f"gradient after {stage}")
            assert_close(found[1], np.stack(curvatures, axis=2), f"Hessian after {stage}")
        elif stage == "outline-modules":
            assert not slope.any(), "derivatives are missing"


def assert_close(found: Batch, wanted: Batch, what: str, tolerance: float = 1e-12) -> None:
    """Equal, relative to the largest entry; to 1 where all are smaller, for what cancels."""
    scale = max(1.0, float(np.abs(wanted).max(initial=0.0)))
    error = float(np.abs(found - wanted).max(initial=0.0)) / scale
    assert error <= tolerance, f"{what}: off by {error:.1e} of the largest entry"


def test_every_operation_is_drawn() -> None:
    """A new operation must be added to `random_expressions`, or named here."""
    made_by_the_compiler = {"identity", "congruence", "project_psd"}
    assert IR_WORDS | made_by_the_compiler >= ALL_WORDS - {"tan", "asin", "acos", "atan"}
