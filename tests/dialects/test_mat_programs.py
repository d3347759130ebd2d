"""Random programs of rational `mat` operations on exact numbers, with zero tolerance.

The oracle of derivatives is arithmetic with hyper-dual numbers; it shares no code with the rules it tests.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from dual_numbers import Dual, dual_array, tangents_of, values_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mat_bodies import fractions, run_block, run_graph
from mat_examples import integers
from xdsl.dialects.builtin import FloatAttr, f64
from xdsl.ir import Attribute, Block, SSAValue

from yasps.dialects.mat import (
    Batch,
    MatBuilder,
    MatOp,
    Shape,
    ShapeError,
    algebra,
    elementwise,
    matrix_type,
    shape_of,
    structure,
)
from yasps.dialects.mat.structure import constant_of
from yasps.dialects.scalar.graph import ScalarGraph
from yasps.passes.analysis.dependence import DependenceMap, size_of
from yasps.passes.calculus.derivatives import PushForward, pull_back

INPUTS: tuple[Shape, ...] = ((3, 1), (3, 3), (1, 1), (2, 2))
SETTINGS = settings(
    max_examples=100, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow], database=None
)

SHAPED: tuple[type[MatOp], ...] = (
    elementwise.AddOp,
    elementwise.SubOp,
    elementwise.NegOp,
    elementwise.HadamardOp,
    elementwise.ScaleOp,
    algebra.MatmulOp,
    algebra.TransposeOp,
    algebra.DotOp,
    algebra.CrossOp,
    algebra.TraceOp,
    algebra.SumOp,
    algebra.DetOp,
    algebra.CofactorOp,
    structure.ConcatRowsOp,
    structure.ConcatColsOp,
)
"""Operations that need no property. Division comes in by inverse and pow, of inputs alone: those are regular."""


@st.composite
def programs(draw: st.DrawFn) -> tuple[Block, SSAValue]:
    """A block on `INPUTS` and a 1x1 result that uses what was made last."""
    block = Block(arg_types=[matrix_type(shape) for shape in INPUTS])
    values: list[SSAValue] = list(block.args)

    def append(op_class: type[MatOp], operands: list[SSAValue], properties: dict[str, Attribute]) -> SSAValue | None:
        try:
            shape = op_class.infer([shape_of(v) for v in operands], properties)
        except ShapeError:
            return None
        if shape[0] * shape[1] > 16:
            return None
        op = op_class(operands, matrix_type(shape), properties)
        block.add_op(op)
        values.append(op.result)
        return op.result

    for _ in range(draw(st.integers(1, 6))):
        kind = draw(st.integers(0, 9))
        if kind == 0:
            rows, cols = draw(st.sampled_from(((1, 1), (3, 1), (3, 3), (2, 2))))
            entries = draw(st.lists(st.sampled_from((-2.0, 0.0, 0.5, 1.0)), min_size=rows * cols, max_size=rows * cols))
            op = constant_of(np.array(entries).reshape(rows, cols), matrix_type((rows, cols)))
            block.add_op(op)
            values.append(op.result)
        elif kind == 1:
            append(algebra.InverseOp, [block.args[draw(st.sampled_from((1, 3)))]], {})
        elif kind == 2:
            exponent = FloatAttr(draw(st.sampled_from((-2.0, -1.0, 2.0, 3.0))), f64)
            append(elementwise.PowOp, [block.args[2]], {"exponent": exponent})
        elif kind == 3:
            append(elementwise.DivideOp, [draw(st.sampled_from(values)), block.args[2]], {})
        elif kind == 4:
            value = draw(st.sampled_from(values))
            (rows, cols) = shape_of(value)
            row, col = draw(st.integers(0, rows - 1)), draw(st.integers(0, cols - 1))
            size = (draw(st.integers(1, rows - row)), draw(st.integers(1, cols - col)))
            append(structure.BlockOp, [value], {"block": integers(row, col, *size)})
        elif kind == 5:
            value = draw(st.sampled_from(values))
            append(structure.ReshapeOp, [value], {"shape": integers(1, size_of(value))})
        else:
            op_class = draw(st.sampled_from(SHAPED))
            arity = op_class.ARITY or 2
            append(op_class, [draw(st.sampled_from(values)) for _ in range(arity)], {})
    last = values[-1]
    total = append(algebra.DotOp, [last, last], {})
    assert total is not None
    return block, total


def _inputs(seed: int) -> list[Batch]:
    """Rational, and regular: the diagonal outweighs the rest."""
    random = np.random.default_rng(seed)
    made = []
    for rows, cols in INPUTS:
        entries = random.integers(-3, 4, (1, rows, cols)).astype(float) / 2
        made.append(fractions(entries + (8 * np.eye(rows) if rows == cols else 0.0)))
    return made


def _directions(seed: int) -> list[Batch]:
    random = np.random.default_rng(seed)
    return [fractions(random.integers(-2, 3, (1, *shape)).astype(float)) for shape in INPUTS]


def _with_arguments(block: Block) -> list[SSAValue]:
    """Two more arguments of each input's shape: directions."""
    return [block.insert_arg(matrix_type(shape), len(block.args)) for _ in range(2) for shape in INPUTS]


@SETTINGS
@given(programs())
def test_first_and_second_derivatives_are_exact(program: tuple[Block, SSAValue]) -> None:
    block, total = program
    x, u, w = _inputs(0), _directions(1), _directions(2)
    inputs: list[SSAValue] = list(block.args)
    # f(x + u e1 + w e2): the e1 e2 part is u^T H w
    hyper = [dual_array(dual_array(a, b), dual_array(c, 0 * a)) for a, b, c in zip(x, u, w, strict=True)]
    result = run_block(block, hyper, exact=True)[total]
    slope, curvature = tangents_of(values_of(result)).item(), tangents_of(tangents_of(result)).item()

    given_directions = _with_arguments(block)
    b = MatBuilder(block)
    along_u = dict(zip(inputs, given_directions[: len(INPUTS)], strict=True))
    gradients = pull_back(b, DependenceMap(block, inputs), {total: b.number(1.0)}, inputs)
    forward = PushForward(b, along_u)[total]
    push_w = PushForward(b, dict(zip(inputs, given_directions[len(INPUTS) :], strict=True)))
    curvatures = {value: push_w[gradient] for value, gradient in gradients.items()}
    values = run_block(block, [*x, *u, *w], exact=True)

    def contracted(parts: dict[SSAValue, SSAValue | None]) -> Fraction:
        return sum(
            ((values[part] * values[along_u[value]]).sum() for value, part in parts.items() if part is not None),
            Fraction(0),
        )

    assert (values[forward].item() if forward is not None else 0) == slope
    assert contracted(dict(gradients)) == slope
    assert contracted(curvatures) == curvature


@SETTINGS
@given(programs())
def test_folding_and_value_numbering_are_exact(program: tuple[Block, SSAValue]) -> None:
    block, total = program
    x = _inputs(3)
    wanted = run_block(block, x, exact=True)[total].item()
    copy = Block(arg_types=[matrix_type(shape) for shape in INPUTS])
    b = MatBuilder(copy)
    made: dict[SSAValue, SSAValue] = dict(zip(block.args, copy.args, strict=True))
    for op in block.ops:
        assert isinstance(op, MatOp)
        made[op.result] = b.copy(op, [made[v] for v in op.operands])
    assert run_block(copy, x, exact=True)[made[total]].item() == wanted


@SETTINGS
@given(programs())
def test_scalar_code_is_exact(program: tuple[Block, SSAValue]) -> None:
    block, total = program
    x = _inputs(4)
    wanted = run_block(block, x, exact=True)[total].item()
    graph = ScalarGraph()
    flat = [entry for values in x for entry in values.ravel()]
    nodes: dict[SSAValue, list[int]] = {}
    for argument in block.args:
        start = sum(len(known) for known in nodes.values())
        nodes[argument] = [graph.input(start + k) for k in range(size_of(argument))]
    for op in block.ops:
        assert isinstance(op, MatOp)
        nodes[op.result] = op.lower(graph, *[nodes[v] for v in op.operands])
    assert run_graph(graph, nodes[total], flat, Fraction) == [wanted]


def test_the_oracle_itself() -> None:
    """f(x) = x^3 / (1 + x): f' and f'' by hand."""
    x = Dual(Dual(Fraction(2), Fraction(1)), Dual(Fraction(1), Fraction(0)))
    y = x**3 / (1 + x)
    f = Fraction(8, 3)
    first = Fraction(3 * 4 * 3 - 8, 9)  # (3 x^2 (1 + x) - x^3) / (1 + x)^2
    second = Fraction(2 * 2 * (3 + 3 * 2 + 4), 27)  # 2 x (3 + 3 x + x^2) / (1 + x)^3
    assert (y.value.value, y.value.tangent, y.tangent.value, y.tangent.tangent) == (f, first, first, second)
