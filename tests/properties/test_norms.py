"""Random functions of a norm, where it is 0: their own second derivatives if their slope is 0 there, else a report."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples
from small_scenes import emit

from yasps import Attribute, Scene, atan2
from yasps.backend.reference.interpreter import Interpreter
from yasps.passes.pipeline import run_pipeline

Tree = tuple[Any, ...]
"""The word of an operation and its operands; ("n",) is the norm, ("number", k) a constant."""


@dataclass(frozen=True)
class Jet:
    """Value, first and second derivative by n at 0. exact: is a slope of 0 one without rounding?"""

    value: float
    slope: float = 0.0
    bend: float = 0.0
    exact: bool = True

    def through(self, f: float, first: float, second: float) -> Jet:
        """A function of it with these derivatives."""
        return Jet(f, first * self.slope, first * self.bend + second * self.slope**2, self.exact)

    def plus(self, other: Jet, sign: float = 1.0) -> Jet:
        exact = self.exact and other.exact and (self.slope == 0.0 or other.slope == 0.0)
        return Jet(
            self.value + sign * other.value, self.slope + sign * other.slope, self.bend + sign * other.bend, exact
        )

    def times(self, other: Jet) -> Jet:
        left, right = self.value * other.slope, self.slope * other.value
        bend = self.value * other.bend + 2 * self.slope * other.slope + self.bend * other.value
        exact = self.exact and other.exact and (left == 0.0 or right == 0.0)
        return Jet(self.value * other.value, left + right, bend, exact)


def _angle(a: Jet) -> Jet:
    y, d = a.value, 0.75
    return a.through(math.atan2(y, d), d / (d * d + y * y), -2 * d * y / (d * d + y * y) ** 2)


def _reciprocal(a: Jet) -> Jet:
    v = a.value
    below = 1.5 + v * v
    return a.through(1 / below, -2 * v / below**2, (8 * v * v - 2 * below) / below**3)


def _root(a: Jet) -> Jet:
    v = a.value
    root = math.sqrt(1 + v * v)
    return a.through(root, v / root, 1 / root**3)


UNARY: dict[str, tuple[Callable[[Attribute], Attribute], Callable[[Jet], Jet]]] = {
    "neg": (lambda a: -a, lambda a: a.through(-a.value, -1.0, 0.0)),
    "square": (lambda a: a**2, lambda a: a.times(a)),
    "cube": (lambda a: a**3, lambda a: a.through(a.value**3, 3 * a.value**2, 6 * a.value)),
    "sin": (lambda a: a.sin(), lambda a: a.through(math.sin(a.value), math.cos(a.value), -math.sin(a.value))),
    "cos": (lambda a: a.cos(), lambda a: a.through(math.cos(a.value), -math.sin(a.value), -math.cos(a.value))),
    "exp": (lambda a: (0.5 * a).exp(), lambda a: a.through(*(math.exp(0.5 * a.value) * f for f in (1.0, 0.5, 0.25)))),
    "abs": (abs, lambda a: a.through(abs(a.value), 1.0 if a.value >= 0 else -1.0, 0.0)),
    "angle": (lambda a: atan2(a, 0.75), _angle),
    "reciprocal": (lambda a: 1 / (1.5 + a * a), _reciprocal),
    "root": (lambda a: (1 + a * a).sqrt(), _root),
}
BINARY: dict[str, tuple[Callable[[Attribute, Attribute], Attribute], Callable[[Jet, Jet], Jet]]] = {
    "add": (lambda a, b: a + b, lambda a, b: a.plus(b)),
    "sub": (lambda a, b: a - b, lambda a, b: a.plus(b, -1.0)),
    "mul": (lambda a, b: a * b, lambda a, b: a.times(b)),
}
LEAVES = st.one_of(st.just(("n",)), st.sampled_from((0.5, 1.0, 2.0, -1.5)).map(lambda k: ("number", k)))
TREES: st.SearchStrategy[Tree] = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.tuples(st.sampled_from(sorted(UNARY)), inner), st.tuples(st.sampled_from(sorted(BINARY)), inner, inner)
    ),
    max_leaves=6,
)


def written(tree: Tree, n: Attribute) -> Any:
    """The function of n as a user writes it."""
    word, *operands = tree
    if word == "n":
        return n
    if word == "number":
        return n * 0 + operands[0]
    parts = [written(operand, n) for operand in operands]
    return UNARY[word][0](*parts) if word in UNARY else BINARY[word][0](*parts)


def jet(tree: Tree) -> Jet:
    word, *operands = tree
    if word == "n":
        return Jet(0.0, 1.0)
    if word == "number":
        return Jet(operands[0])
    parts = [jet(operand) for operand in operands]
    return UNARY[word][1](*parts) if word in UNARY else BINARY[word][1](*parts)


@examples(ci=30, nightly=1500)
@given(tree=TREES)
def test_functions_of_a_norm_of_zero(tree: Tree) -> None:
    """Never finite and wrong; finite wherever the slope is 0 without rounding."""
    wanted = jet(tree)
    scene = Scene("s")
    points = scene.add_mesh("m").add_primitive("v", 1)
    x, y = points.add_attribute("x", 3, 1), points.add_attribute("y", 3, 1)
    energy = points.add_attribute("e", computed_attribute=written(tree, (x - 2 * y).norm()) * 1.0)
    scene.add_energy(energy, projection="none")
    scene.add_minimize_target([x, y])
    emitted = emit(scene)
    run_pipeline(emitted.module)
    interpreter = Interpreter(emitted.module, emitted.data)
    if not interpreter.scene.derivatives:
        assert wanted.slope == wanted.bend == 0.0
        return
    with np.errstate(all="ignore"):
        gradient, sparse = interpreter.assemble()
    hessian = sparse.toarray()
    if abs(wanted.slope) > 1e-9:
        assert not np.isfinite(gradient).all()
        assert not np.isfinite(hessian).all()
    elif np.isfinite(hessian).all() or (wanted.exact and wanted.slope == 0.0):
        apart = np.array([[1.0, -2.0], [-2.0, 4.0]])
        np.testing.assert_allclose(gradient, np.zeros(6), atol=1e-9)
        scale = max(1.0, abs(wanted.bend))
        np.testing.assert_allclose(hessian, wanted.bend * np.kron(apart, np.eye(3)), atol=1e-11 * scale)
