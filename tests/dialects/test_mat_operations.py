"""One generated set of tests for every `mat` operation: text, meaning, scalar code, derivatives, linearity."""

from __future__ import annotations

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from dual_numbers import dual_array, tangents_of
from mat_bodies import fractions, largest, lower_and_run, relative_error, run_block
from mat_examples import ALL, Example, regular
from xdsl.context import Context
from xdsl.dialects import test as xdsl_test
from xdsl.dialects.builtin import ModuleOp
from xdsl.ir import SSAValue
from xdsl.parser import Parser
from xdsl.utils.exceptions import VerifyException

from yasps.dialects.mat import OPERATIONS, Batch, MatBuilder, NotDifferentiableError, matrix_type, shape_of
from yasps.dialects.mat.calculus import GivenDerivativeOp, ProjectPsdOp
from yasps.dialects.mat.spectral import SpectralOp
from yasps.dialects.scalar.graph import ScalarGraph
from yasps.passes.analysis.dependence import DependenceMap
from yasps.passes.calculus.derivatives import PushForward, pull_back
from yasps.passes.pipeline import make_context

STEP = 1e-30
"""Of the complex step: no difference is taken, so it may be as small as it likes."""


def _named(examples: list[Example]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("example", examples, ids=lambda example: example.label)


DIFFERENTIABLE = [e for e in ALL if e.op_class.DIFFERENTIABLE and e.shapes and not e.op_class.HELD_CONSTANT]
LABELS = [e.label for e in ALL]


def _subsets(count: int) -> list[tuple[bool, ...]]:
    """All choices of active operands but the empty one."""
    return [active for active in product((False, True), repeat=count) if any(active)]


def _stepped(inputs: list[Batch], directions: list[Batch], active: tuple[bool, ...]) -> list[Batch]:
    return [x + 1j * STEP * d if on else x for x, d, on in zip(inputs, directions, active, strict=True)]


def test_every_operation_has_an_example() -> None:
    assert {example.op_class for example in ALL} == set(OPERATIONS)


def test_examples_have_names_of_their_own() -> None:
    assert len(set(LABELS)) == len(LABELS)


@_named(ALL)
def test_text_parses_back(example: Example) -> None:
    operands = xdsl_test.TestOp(result_types=[matrix_type(shape) for shape in example.shapes])
    _, op = example.build()
    copy = op.clone(dict(zip(op.operands, operands.results, strict=True)))
    text = str(ModuleOp([operands, copy]))
    parsed = Parser(_context(), text).parse_module()
    parsed.verify()
    last = parsed.body.block.last_op
    assert isinstance(last, example.op_class)
    assert last.properties == op.properties
    assert last.result.type == op.result.type
    assert str(parsed) == text


def _context() -> Context:
    context = make_context()
    context.load_dialect(xdsl_test.Test)
    return context


@_named(ALL)
def test_a_wrong_result_type_does_not_verify(example: Example) -> None:
    _, op = example.build()
    op.verify()
    rows, cols = shape_of(op.result)
    wrong = example.op_class(op.operands, matrix_type((rows + 1, cols)), example.properties)
    with pytest.raises(VerifyException, match=f"{op.name} gives {rows}x{cols} here, but its type says {rows + 1}x"):
        wrong.verify()


@_named([e for e in ALL if e.op_class is not ProjectPsdOp])
def test_scalar_code_has_the_same_meaning(example: Example) -> None:
    _, op = example.build()
    inputs = example.draw(1)
    wanted = op.evaluate(*inputs)
    found = lower_and_run(op, inputs)
    assert relative_error(found, np.broadcast_to(wanted, found.shape)) < 1e-14 * 50


@_named([e for e in ALL if e.rational])
def test_scalar_code_is_exact_on_rationals(example: Example) -> None:
    block, op = example.build()
    inputs = [fractions(values) for values in example.draw(2)]
    wanted = run_block(block, inputs, exact=True)[op.result]
    found = lower_and_run(op, inputs, Fraction)
    assert np.all(found == wanted)


def test_a_projection_has_no_scalar_code() -> None:
    for example in (e for e in ALL if e.op_class is ProjectPsdOp):
        _, op = example.build()
        with pytest.raises(ValueError, match="lower-to-scalar splits the function here"):
            op.lower(ScalarGraph(), [])


# -- derivatives -------------------------------------------------------------------------------------------


@_named(DIFFERENTIABLE)
def test_pushforward_is_the_derivative(example: Example) -> None:
    count = len(example.shapes)
    inputs, directions = example.draw(3), example.draw(4)
    for active in _subsets(count):
        block, op = example.build(extra=example.shapes)
        given = block.args[count:]
        tangent = op.pushforward(MatBuilder(block), [t if on else None for t, on in zip(given, active, strict=True)])
        wanted = op.evaluate(*_stepped(inputs, directions, active)).imag / STEP
        found = np.zeros(wanted.shape) if tangent is None else run_block(block, [*inputs, *directions])[tangent]
        assert relative_error(found, wanted) < 1e-12, active


@_named(DIFFERENTIABLE)
def test_pullback_is_the_adjoint_of_pushforward(example: Example) -> None:
    count = len(example.shapes)
    _, probe = example.build()
    shape = shape_of(probe.result)
    block, op = example.build(extra=(*example.shapes, shape))
    b = MatBuilder(block)
    cotangent = block.args[-1]
    tangent = op.pushforward(b, list(block.args[count : 2 * count]))
    parts = op.pullback(b, cotangent)
    assert len(parts) == count
    inputs, directions = example.draw(5), example.draw(6)
    weights = np.random.default_rng(7).standard_normal((len(inputs[0]), *shape))
    values = run_block(block, [*inputs, *directions, weights])
    if tangent is None:
        assert all(part is None or np.all(values[part] == 0) for part in parts)
        return
    forward = (weights * values[tangent]).sum(axis=(1, 2))
    backward = np.zeros(len(forward))
    for part, operand, direction in zip(parts, op.operands, directions, strict=True):
        if part is not None:
            assert shape_of(part) == shape_of(operand)
            backward += (values[part] * direction).sum(axis=(1, 2))
    scale = np.abs(weights * values[tangent]).sum(axis=(1, 2))
    assert np.all(np.abs(forward - backward) <= 1e-13 * scale + 1e-13 * np.abs(backward))


def _reverse_graph(example: Example) -> tuple[MatBuilder, list[SSAValue], dict[SSAValue, SSAValue]]:
    """The operation, its pullback of one cotangent, and the tangents to push through it. Arguments: operands,
    tangents, cotangent."""
    count = len(example.shapes)
    _, probe = example.build()
    block, op = example.build(extra=(*example.shapes, shape_of(probe.result)))
    b = MatBuilder(block)
    primal: list[SSAValue] = list(block.args[:count])
    parts = pull_back(b, DependenceMap(block, primal), {op.result: block.args[-1]}, primal)
    return b, primal, parts


@_named(DIFFERENTIABLE)
def test_derivative_of_the_pullback(example: Example) -> None:
    """The rules of all operations that a rule is made of: second derivatives, forward over reverse."""
    count = len(example.shapes)
    b, primal, parts = _reverse_graph(example)
    inputs, directions = example.draw(8), example.draw(9)
    weights = np.random.default_rng(10).standard_normal((len(inputs[0]), *shape_of(b.body.args[-1])))
    stepped = run_block(b.body, [*_stepped(inputs, directions, (True,) * count), *directions, weights])
    push = PushForward(b, dict(zip(primal, b.body.args[count : 2 * count], strict=True)))
    for gradient in parts.values():
        tangent = push[gradient]
        wanted = stepped[gradient].imag / STEP
        found = run_block(b.body, [*inputs, *directions, weights])[tangent] if tangent is not None else 0.0 * wanted
        scale = max(largest(wanted), largest(stepped[gradient].real))
        assert np.abs(found - wanted).max() < 1e-12 * scale


def _quarters(array: Batch) -> Batch:
    """Near by: exact multiples of 1/4, none of them 0, where a divisor has no inverse and abs no derivative."""
    rounded = np.round(4 * array) / 4
    return fractions(np.where(rounded == 0, 1.0, rounded))


@_named([e for e in DIFFERENTIABLE if e.rational])
def test_derivatives_are_exact_on_rationals(example: Example) -> None:
    """Pushforward and pullback, and forward over reverse, against dual numbers with zero tolerance."""
    count = len(example.shapes)
    b, primal, parts = _reverse_graph(example)
    inputs, directions = [[_quarters(v) for v in example.draw(seed)] for seed in (11, 12)]
    if example.samplers[0] is regular:  # rounded, they might not be
        inputs = [fractions(np.round(64 * v) / 64) for v in example.draw(11)]
    shape = shape_of(b.body.args[-1])
    weights = fractions(np.random.default_rng(13).integers(-4, 5, (len(inputs[0]), *shape)).astype(float))
    duals = [dual_array(x, d) for x, d in zip(inputs, directions, strict=True)]
    wanted = run_block(b.body, [*duals, *directions, weights], exact=True)
    push = PushForward(b, dict(zip(primal, b.body.args[count : 2 * count], strict=True)))
    primal_result = next(iter(b.body.ops)).results[0]
    for value in (primal_result, *parts.values()):
        tangent = push[value]
        expected = tangents_of(wanted[value])
        if tangent is None:
            assert np.all(expected == 0)
        else:
            found = run_block(b.body, [*inputs, *directions, weights], exact=True)[tangent]
            assert np.all(found == expected)


@_named([e for e in ALL if not e.op_class.DIFFERENTIABLE and e.op_class is not GivenDerivativeOp])
def test_operations_without_a_rule_say_so(example: Example) -> None:
    block, op = example.build(extra=example.shapes)
    b = MatBuilder(block)
    if not isinstance(op, SpectralOp):  # a first derivative, which is pushed forward: tests/dialects/test_spectral.py
        with pytest.raises(NotDifferentiableError, match=f"{op.name} has no derivative rule"):
            op.pushforward(b, list(block.args[len(example.shapes) :]))
    with pytest.raises(NotDifferentiableError, match=f"{op.name} has no derivative rule"):
        op.pullback(b, op.result)


@_named([e for e in ALL if e.op_class is GivenDerivativeOp])
def test_a_given_derivative_is_the_jacobian_that_is_given(example: Example) -> None:
    """Forward and backward; the value itself and the Jacobian have no part in it."""
    block, op = example.build(extra=(*example.shapes, shape_of(example.build()[1].result)))
    b, count = MatBuilder(block), len(example.shapes)
    directions = list(block.args[count : 2 * count])
    tangent, parts = op.pushforward(b, directions), op.pullback(b, block.args[-1])
    assert op.pushforward(b, [*directions[:2], *[None] * (count - 2)]) is None
    assert tangent is not None
    assert list(parts[:2]) == [None, None]
    inputs, moved = example.draw(3), example.draw(4)
    weights = np.random.default_rng(5).standard_normal((len(inputs[0]), *shape_of(op.result)))
    values = run_block(block, [*inputs, *moved, weights])
    jacobian = inputs[1]
    direction = np.concatenate([part.reshape(len(part), -1, 1) for part in moved[2:]], axis=1)
    wanted = (jacobian @ direction).reshape(weights.shape)
    np.testing.assert_allclose(values[tangent], wanted, rtol=1e-13, atol=1e-13)
    pulled = np.concatenate([values[part].reshape(len(jacobian), -1) for part in parts if part is not None], axis=1)
    column = weights.reshape(len(jacobian), -1, 1)
    np.testing.assert_allclose(pulled, (jacobian.swapaxes(1, 2) @ column)[:, :, 0], rtol=1e-13, atol=1e-13)


@_named([e for e in ALL if e.op_class.HELD_CONSTANT or not e.shapes])
def test_what_is_held_constant_has_no_derivative(example: Example) -> None:
    block, op = example.build(extra=example.shapes)
    b = MatBuilder(block)
    assert op.pushforward(b, list(block.args[len(example.shapes) :])) is None
    assert all(part is None for part in op.pullback(b, op.result))


# -- linearity ---------------------------------------------------------------------------------------------


@_named([e for e in ALL if e.shapes])
def test_linearity_is_truthful(example: Example) -> None:
    """Where an operation says it is affine in some operands, its second difference along any line is exactly 0.

    Steps are too short to cross a kink from one integer to the next.
    """
    _, op = example.build()
    for active in _subsets(len(example.shapes)):
        if not op.is_linear(active) or op.DIFFERENTIABLE is False or op.HELD_CONSTANT:
            continue
        assert example.rational, f"{op.name} says it is linear and is not rational"
        random = np.random.default_rng(14)
        inputs, steps = [
            [fractions(random.integers(1, 9, x.shape).astype(float)) for x in example.draw()] for _ in range(2)
        ]
        steps = [step / 64 for step in steps]
        at = [
            op.evaluate(*[x + k * d if on else x for x, d, on in zip(inputs, steps, active, strict=True)])
            for k in (0, 1, 2)
        ]
        assert np.all(at[0] - 2 * at[1] + at[2] == 0), active


def test_products_of_active_operands_are_not_linear() -> None:
    """The other direction for the operations that contact and elasticity rely on: the cut must not pass them."""
    for example in ALL:
        word = example.op_class.word()
        _, op = example.build()
        if word in ("matmul", "dot", "hadamard", "scale", "cross"):
            assert not op.is_linear((True, True))
            assert op.is_linear((True, False))
            assert op.is_linear((False, True))
        elif word == "divide":
            assert [op.is_linear(active) for active in ((True, False), (False, True), (True, True))] == [1, 0, 0]
        elif word in ("sqrt", "exp", "log", "sin", "cos", "norm", "inverse") or (
            word in ("det", "cofactor") and example.shapes[0][0] >= 3
        ):
            assert not op.is_linear((True,))
