"""The pass that writes smooth functions of norms without them: what it makes, and that derivatives at 0 are right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from small_scenes import emit
from xdsl.dialects.builtin import ModuleOp

from yasps import Attribute, Scene, atan2, concat_cols, stumpff
from yasps.backend.reference.interpreter import Interpreter, SceneData
from yasps.dialects.mat import MatOp
from yasps.dialects.rel import AttributeOp
from yasps.passes.pipeline import run_pipeline

SMOOTH: dict[str, tuple[Callable[[Attribute], Attribute], float, float]] = {
    "a square": (lambda d: d.norm() ** 2, 0.0, 2.0),
    "a product": (lambda d: 3.0 * d.norm() * d.norm(), 0.0, 6.0),
    "a cosine": (lambda d: d.norm().cos(), 1.0, -1.0),
    "a bell": (lambda d: (-(d.norm() ** 2)).exp(), 1.0, -2.0),
    "an angle": (lambda d: atan2(d.norm(), 0.5) ** 2, 0.0, 8.0),
    "a cube": (lambda d: d.norm() ** 3, 0.0, 0.0),
    "a root": (lambda d: d.dot(d).sqrt() ** 4 + d.dot(d) ** 1.5 + d.norm() / d.norm(), 1.0, 0.0),
    "sin(2 n) / n": (lambda d: (2 * d.norm()).sin() / d.norm(), 2.0, -8 / 3),
    "tan(n) / n": (lambda d: d.norm().tan() / d.norm(), 1.0, 2 / 3),
    "(1 - cos n) / n^2": (lambda d: (1 - d.norm().cos()) / d.norm() ** 2, 0.5, -1 / 12),
    "(n - sin n) / n^3": (lambda d: (d.norm() - d.norm().sin()) / d.norm() ** 3, 1 / 6, -1 / 60),
    "n / sin n": (lambda d: d.norm() / d.norm().sin(), 1.0, 1 / 3),
    "the user's own": (lambda d: stumpff(2, d.dot(d)), 0.5, -1 / 12),
}
"""Functions of a vector, their value and the multiple of the identity that is their Hessian where it is 0."""


@cache
def _modules_of(write: Callable[[Attribute], Attribute], size: int) -> tuple[dict[str, ModuleOp], SceneData]:
    """The module after every pass, and the data of one vector of ones."""
    scene = Scene("s")
    points = scene.add_mesh("m").add_primitive("v", 1)
    x = points.add_attribute("x", size, 1, value=np.ones(size))
    scene.add_energy(points.add_attribute("e", computed_attribute=write(x)), projection="none")
    scene.add_minimize_target(x)
    emitted = emit(scene)
    modules: dict[str, ModuleOp] = {}
    run_pipeline(emitted.module, None, lambda name, module: modules.update({name: module.clone()}))
    return modules, emitted.data


def after_passes(write: Callable[[Attribute], Attribute], at: Any) -> tuple[dict[str, ModuleOp], Interpreter]:
    """The module after every pass, and the last one at this value of a vector."""
    modules, data = _modules_of(write, np.size(at))
    moved = replace(data, storages={**data.storages, "m.v.x": np.reshape(at, (1, -1, 1))})
    return modules, Interpreter(modules["outline-modules"], moved)


def words(module: ModuleOp) -> list[str]:
    """Operations of the energy."""
    (energy,) = [op for op in module.walk() if isinstance(op, AttributeOp) and op.symbol == "m.v.e"]
    return [op.word() for op in energy.walk() if isinstance(op, MatOp) and op.word() != "constant"]


@pytest.mark.parametrize("name", SMOOTH)
def test_smooth_functions_at_zero_and_beside_it(name: str) -> None:
    write, value, curvature = SMOOTH[name]
    for x in (np.zeros(3), np.array([0.6e-160, -0.8e-160, 0.0]), np.array([0.6e-8, -0.8e-8, 0.0])):
        with np.errstate(all="ignore"):
            _, interpreter = after_passes(write, x)
            found, (gradient, hessian) = interpreter.value("m.v.e").item(), interpreter.assemble()
        assert found == pytest.approx(value, abs=1e-15)
        cubic = 2e-7 if name in ("a cube", "a root") else 0.0  # that is how much the third derivatives do
        np.testing.assert_allclose(gradient, curvature * x, rtol=1e-12, atol=1e-22 + 1e-8 * cubic)
        np.testing.assert_allclose(hessian.toarray(), curvature * np.eye(3), rtol=1e-14, atol=1e-14 + cubic)


@pytest.mark.parametrize(
    ("write", "wanted"),
    [
        (lambda x: x.norm() ** 2, ["dot"]),
        (lambda x: x.norm() * x.norm(), ["dot"]),
        (lambda x: x[0] * x.norm() * x.norm(), ["block", "dot", "scale"]),
        (lambda x: (x.T * x).sqrt() ** 2, ["dot"]),
        (lambda x: 1 / x.norm() ** 4, ["dot", "pow", "divide"]),
        (lambda x: (x * x.norm() / x.norm()).sum(), ["sum"]),
        (lambda x: x.dot(x) ** 1.5, ["norm", "pow"]),
        (lambda x: x.norm().sin() / x.norm(), ["dot", "stumpff"]),
        (lambda x: (x.norm().cos() - 1) / x.norm() / x.norm(), ["dot", "stumpff", "neg"]),
        (lambda x: concat_cols([x.norm().sin() * (x / x.norm()), x]).sum(), ["dot", "stumpff", "scale", "sum"]),
    ],
)
def test_what_is_made(write: Callable[[Attribute], Attribute], wanted: list[str]) -> None:
    """Operations that are left, but for those that nothing uses."""
    modules, _ = after_passes(write, np.ones(3))
    used = words(modules["fold-norms"])
    assert [word for word in wanted if word in used] == wanted
    assert "norm" in wanted or "sqrt" not in used


@pytest.mark.parametrize(
    "write",
    [
        lambda x: (x.norm() - 2) ** 2,
        lambda x: x.norm().cos(),
        lambda x: (1 - x.norm().cos()) * x[0],
        lambda x: x.norm().sin() / x[0],
        lambda x: (x / x.norm())[0],
        lambda x: 1 / x.norm() ** 3,
        lambda x: (x.norm().sin() + x.norm()) / x.norm(),
    ],
)
def test_other_bodies_stay_as_they_are(write: Callable[[Attribute], Attribute]) -> None:
    modules, _ = after_passes(write, np.ones(3))
    assert words(modules["fold-norms"]) == words(modules["cse"])


@pytest.mark.parametrize("name", SMOOTH)
def test_meanings_are_kept_elsewhere(name: str) -> None:
    """In value; derivatives by complex steps."""
    write, _, _ = SMOOTH[name]
    x = np.array([0.3, -0.4, 0.5])
    modules, last = after_passes(write, x)
    plain = Interpreter(modules["frontend"], last.data)
    assert last.value("m.v.e").item() == pytest.approx(plain.value("m.v.e").item(), rel=1e-14)
    for k in range(3):
        stepped = x.astype(complex).reshape(1, 3, 1)
        stepped[0, k, 0] += 1e-30j
        moved = Interpreter(modules["frontend"], type(last.data)({"m.v.x": stepped}, {}, last.data.sizes))
        assert last.gradient()[k] == pytest.approx(moved.value("m.v.e").item().imag / 1e-30, rel=1e-12)
