"""Values and derivatives where functions have kinks, as docs/language.md promises ("At kinks")."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from mat_bodies import run_block
from xdsl.dialects.builtin import StringAttr
from xdsl.ir import Block, SSAValue

from yasps.dialects.mat import Batch, MatBuilder, MatOp, matrix_type
from yasps.dialects.mat.comparison import AbsOp, CompareOp, MaxOp, MinOp, SelectOp
from yasps.dialects.mat.elementwise import TABLED
from yasps.passes.analysis.dependence import Dependence, DependenceMap
from yasps.passes.calculus.derivatives import jacobian, pull_back

NAN, INF = float("nan"), float("inf")
Written = Callable[[MatBuilder, SSAValue], SSAValue]


def value_and_derivatives(write: Written, at: list[float]) -> tuple[float, Batch, Batch]:
    """Value, gradient and Hessian of a 1x1 function of a column, by the passes' own traversals, at a point."""
    size = len(at)
    block = Block(arg_types=[matrix_type((size, 1))])
    b, x = MatBuilder(block), block.args[0]
    result = write(b, x)
    gradients = pull_back(b, DependenceMap(block, [x]), {result: b.number(1.0)}, [x])
    gradient = gradients.get(x, b.zeros((size, 1)))
    hessian = jacobian(b, [gradient], [x])
    forward = jacobian(b, [result], [x])
    values = run_block(block, [np.array(at).reshape(1, size, 1)])
    reverse = values[gradient][0, :, 0]
    np.testing.assert_array_equal(values[forward][0, 0], reverse)  # both modes, NaN and infinity included
    return values[result].item(), reverse, values[hessian][0]


def entry(b: MatBuilder, x: SSAValue, k: int) -> SSAValue:
    return b.block(x, k, 0, 1, 1)


def emit(b: MatBuilder, op_class: type[MatOp], *operands: SSAValue) -> SSAValue:
    return b.emit(op_class, operands)


def pair(op_class: type[MatOp]) -> Written:
    """Of the first two entries."""
    return lambda b, x: emit(b, op_class, entry(b, x, 0), entry(b, x, 1))


@pytest.mark.parametrize(
    ("write", "at", "value", "gradient"),
    [
        pytest.param(lambda b, x: b.sum(emit(b, AbsOp, x)), [0.0, -2.0, 3.0], 5.0, [1, -1, 1], id="abs"),
        pytest.param(lambda b, x: b.sum(emit(b, AbsOp, x)), [-0.0], 0.0, [1], id="abs of -0"),
        pytest.param(pair(MinOp), [1.0, 1.0], 1.0, [1, 0], id="min, a tie: the first"),
        pytest.param(pair(MaxOp), [1.0, 1.0], 1.0, [1, 0], id="max, a tie: the first"),
        pytest.param(pair(MinOp), [2.0, 1.0], 1.0, [0, 1], id="min"),
        pytest.param(pair(MaxOp), [1.0, 2.0], 2.0, [0, 1], id="max"),
        pytest.param(
            lambda b, x: b.select(b.less(x, b.number(1.0)), b.power(x, 2.0), b.scale(b.number(3.0), x)),
            [1.0],
            3.0,
            [3],
            id="select: the side taken",
        ),
    ],
)
def test_kinks(write: Written, at: list[float], value: float, gradient: list[float]) -> None:
    found, slope, curvature = value_and_derivatives(write, at)
    assert found == value
    np.testing.assert_array_equal(slope, gradient)
    np.testing.assert_array_equal(curvature, np.zeros((len(at), len(at))))


@pytest.mark.parametrize(
    ("op_class", "at", "slope"),
    [
        (TABLED["sqrt"], 0.0, INF),
        (TABLED["log"], 0.0, INF),
        (TABLED["log1p"], -1.0, INF),
        (TABLED["cbrt"], 0.0, INF),
        (TABLED["asin"], 1.0, INF),
        (TABLED["acos"], -1.0, -INF),
    ],
)
def test_infinite_slopes_stay_infinite(op_class: type[MatOp], at: float, slope: float) -> None:
    """They are reported as not finite when a scene is solved, never hidden."""
    _, gradient, _ = value_and_derivatives(lambda b, x: emit(b, op_class, x), [at])
    assert gradient.item() == slope


@pytest.mark.parametrize("op_class", [MinOp, MaxOp])
@pytest.mark.parametrize("at", [[NAN, 1.0], [1.0, NAN], [NAN, NAN]])
def test_nan_is_neither_smaller_nor_greater(op_class: type[MatOp], at: list[float]) -> None:
    assert np.isnan(value_and_derivatives(pair(op_class), at)[0])


@pytest.mark.parametrize("predicate", ["lt", "le"])
def test_comparisons_with_nan_are_false(predicate: str) -> None:
    def write(b: MatBuilder, x: SSAValue) -> SSAValue:
        return b.emit(CompareOp, [entry(b, x, 0), entry(b, x, 1)], {"predicate": StringAttr(predicate)})

    for at in ([NAN, 1.0], [1.0, NAN]):
        assert value_and_derivatives(write, at)[0] == 0.0


def test_nan_as_a_condition_is_false() -> None:
    write: Written = lambda b, x: b.select(x, b.number(1.0), b.number(2.0))  # noqa: E731
    assert [value_and_derivatives(write, [at])[0] for at in (NAN, 0.0, 0.5, -INF)] == [2.0, 2.0, 1.0, 1.0]


# -- the side not taken --------------------------------------------------------------------------------------


def _guarded(b: MatBuilder, x: SSAValue, outside: Written) -> SSAValue:
    """sqrt(x) where x > 0, else something else."""
    return b.select(b.less(b.number(0.0), x), b.sqrt(x), outside(b, x))


@pytest.mark.parametrize(
    ("write", "gradient", "hessian"),
    [
        pytest.param(lambda b, x: _guarded(b, x, lambda b, x: b.power(x, 2.0)), 0.0, 2.0, id="one choice"),
        pytest.param(
            lambda b, x: b.power(_guarded(b, x, lambda b, x: b.scale(b.number(3.0), x)), 2.0), 0.0, 18.0, id="inside"
        ),
        pytest.param(
            lambda b, x: b.select(
                b.less(x, b.number(1.0)),
                _guarded(b, x, lambda b, x: b.power(x, 2.0)),
                b.select(b.less(x, b.number(2.0)), b.apply("log", x), b.sqrt(x)),
            ),
            0.0,
            2.0,
            id="nested",
        ),
        pytest.param(
            lambda b, x: b.add(
                _guarded(b, x, lambda b, x: b.power(x, 2.0)),
                b.select(b.less(b.number(1.0), x), b.power(b.sqrt(x), 3.0), x),
            ),
            1.0,
            2.0,
            id="one root behind two choices",
        ),
        pytest.param(lambda b, x: emit(b, MaxOp, b.sqrt(x), b.apply("exp", x)), 1.0, 1.0, id="the lesser of max"),
        pytest.param(
            lambda b, x: emit(b, MinOp, b.apply("exp", x), b.add(b.number(2.0), b.sqrt(x))), 1.0, 1.0, id="min"
        ),
    ],
)
def test_the_side_not_taken_stays_out(write: Written, gradient: float, hessian: float) -> None:
    """sqrt and log have infinite derivatives at 0, and 0 times infinity would be NaN."""
    _, slope, curvature = value_and_derivatives(write, [0.0])
    assert (slope.item(), curvature.item()) == (gradient, hessian)


def test_both_sides_of_a_choice_share_one_pullback() -> None:
    """t is used on both sides: its cotangent is one choice, and its own derivative is taken once, without zeros."""
    block = Block(arg_types=[matrix_type((1, 1))])
    b, x = MatBuilder(block), block.args[0]
    t = b.apply("exp", x)
    result = b.select(b.less(x, b.number(1.0)), b.power(t, 2.0), b.power(t, 3.0))
    before = len(list(block.ops))
    pull_back(b, DependenceMap(block, [x]), {result: b.number(1.0)}, [x])
    made = [op.name for op in list(block.ops)[before:]]
    assert made.count("mat.hadamard") + made.count("mat.scale") <= 5
    assert sum(isinstance(op, SelectOp) for op in list(block.ops)[before:]) <= 2  # "not" of the condition, and t's


# -- linearity -------------------------------------------------------------------------------------------------


def test_conditions_are_constant_for_differentiation() -> None:
    block = Block(arg_types=[matrix_type((1, 1))])
    b, x = MatBuilder(block), block.args[0]
    condition = b.less(b.power(x, 2.0), b.number(1.0))
    affine = b.select(condition, x, b.neg(x))
    nonlinear = b.select(condition, x, b.power(x, 3.0))
    dependence = DependenceMap(block, [x])
    assert dependence[condition] is Dependence.CONSTANT
    assert dependence[affine] is Dependence.AFFINE
    assert dependence[nonlinear] is Dependence.NONLINEAR
