"""Random expressions on one primitive: value, gradient and Hessian after every pass, against oracles of their own."""

from __future__ import annotations

import dataclasses
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from exact_numbers import Exact, HyperDual, array_of, fraction
from expression_words import ALL_WORDS, IR_WORDS
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from profiles import examples
from random_expressions import INSTANCES, Expression, drawn_words, expressions
from small_scenes import emit
from xdsl.dialects.builtin import ModuleOp

from yasps.backend.reference.interpreter import Interpreter, SceneData
from yasps.dialects.mat import Batch, shape_of
from yasps.dialects.rel import DataOp, StorageOp, YieldDerivativeOp, name_of
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
    count = len(gradient)
    whole_gradient = np.zeros((count, end), gradient.dtype)
    whole_gradient[:, places] = gradient
    whole_hessian = np.zeros((count, end, end), gradient.dtype if hessian is None else hessian.dtype)
    if hessian is not None:
        whole_hessian[np.ix_(range(count), places, places)] = hessian
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


@pytest.mark.parametrize("first", drawn_words(rational=True))
@examples(ci=4, nightly=125)
@given(data=st.data())
def test_rational_expressions_are_exact(data: st.DataObject, first: str) -> None:
    check_exactly(data.draw(expressions(True, first)))


def check_exactly(expression: Expression) -> None:
    """Every stage against hyper-dual numbers."""
    modules, data = stages(expression)
    names = [f"m.points.t{k}" for k in range(len(expression.inputs))]
    exact = {name: array_of(lambda e: Exact(Fraction(e)), x) for name, x in zip(names, expression.point(), strict=True)}
    moved = dataclasses.replace(data, storages=exact)
    n = sum(rows * cols for rows, cols in expression.inputs)
    u, w = directions(1, n), directions(2, n)
    wanted = [oracle(expression, instance, u, w) for instance in range(INSTANCES)]
    for stage, module in modules.items():
        interpreter = Interpreter(module, dataclasses.replace(moved, storages=exact | exact_numbers_of(module)))
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


def exact_numbers_of(module: ModuleOp) -> dict[str, Batch]:
    """The numbers of the formulas, with which code computes before it looks at any instance."""
    known = {op.symbol: op.known_numbers() for op in module.walk() if isinstance(op, StorageOp)}
    return {
        name: array_of(lambda e: Exact(Fraction(float(e))), numbers)
        for name, numbers in known.items()
        if numbers is not None
    }


@pytest.mark.parametrize("first", drawn_words(rational=False))
@examples(ci=3, nightly=50)
@given(data=st.data())
def test_smooth_expressions_agree_with_complex_steps(data: st.DataObject, first: str) -> None:
    check_by_complex_steps(data.draw(expressions(False, first)))


def check_by_complex_steps(expression: Expression) -> None:
    """Every stage against complex steps of the energy, and those of the gradient."""
    modules, data = stages(expression)
    names = [f"m.points.t{k}" for k in range(len(expression.inputs))]
    real = dict(zip(names, expression.point(), strict=True))
    by_hand = [
        expression.evaluate([x[instance] for x in real.values()], float)[-1].item() for instance in range(INSTANCES)
    ]
    moved = stepped(real, data)
    shape = (-1, INSTANCES)  # unknown stepped along, instance
    slope = Interpreter(modules["frontend"], moved).value(ENERGY)[:, 0, 0].reshape(shape).imag.T / STEP
    bent = derivatives(Interpreter(modules["differentiate"], moved), names)
    curvature = None if bent is None else bent[0].reshape(*shape, slope.shape[1]).imag.transpose(1, 2, 0) / STEP
    for stage, module in modules.items():
        interpreter = Interpreter(module, dataclasses.replace(data, storages=real))
        assert_close(interpreter.value(ENERGY)[:, 0, 0], np.array(by_hand), f"value after {stage}")
        found = derivatives(interpreter, names)
        if found is not None:
            assert_close(found[0], slope, f"gradient after {stage}")
            assert curvature is not None
            assert_close(found[1], curvature, f"Hessian after {stage}")
        elif stage == "outline-modules":
            assert not slope.any(), "derivatives are missing"


def stepped(real: dict[str, NDArray[np.float64]], data: SceneData) -> SceneData:
    """As many times the instances as there are unknowns, each time a complex step along one of them."""
    unknowns = [(name, place) for name, x in real.items() for place in np.ndindex(x.shape[1:])]
    storages = {name: np.tile(x.astype(complex), (len(unknowns), 1, 1)) for name, x in real.items()}
    for k, (name, place) in enumerate(unknowns):
        storages[name][INSTANCES * k : INSTANCES * (k + 1), *place] += 1j * STEP
    return dataclasses.replace(data, storages=storages, sizes={**data.sizes, "m.points": INSTANCES * len(unknowns)})


def assert_close(found: Batch, wanted: Batch, what: str, tolerance: float = 1e-12) -> None:
    """Equal, relative to the largest entry; to 1 where all are smaller, for what cancels."""
    scale = max(1.0, float(np.abs(wanted).max(initial=0.0)))
    error = float(np.abs(found - wanted).max(initial=0.0)) / scale
    assert error <= tolerance, f"{what}: off by {error:.1e} of the largest entry"


def test_every_operation_is_drawn() -> None:
    """A new operation must be added to `expression_words`, or named here."""
    made_by_the_compiler = {"identity", "over_norm", "congruence", "project_psd", "spectral", "spectral_tangent"}
    with_derivatives_of_the_users = {"given_derivative"}
    assert IR_WORDS | made_by_the_compiler | with_derivatives_of_the_users >= ALL_WORDS
