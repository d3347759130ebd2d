"""Folding keeps values: what `MatBuilder` makes equals what was asked for."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from mat_bodies import run_block
from mat_examples import ALL, Example
from xdsl.dialects import test as xdsl_test
from xdsl.dialects.builtin import IntegerType, ModuleOp
from xdsl.ir import Block, Operation, SSAValue
from xdsl.transforms.canonicalize import CanonicalizePass

from yasps.dialects.mat import Batch, MatBuilder, Shape, matrix_type, shape_of
from yasps.dialects.mat.algebra import DetOp, TransposeOp
from yasps.dialects.mat.base import constant_value
from yasps.dialects.mat.structure import ConstantOp, constant_of
from yasps.passes.pipeline import make_context

FILLINGS = ("argument", "zeros", "ones", "identity", "numbers")


def _filled(b: MatBuilder, argument: SSAValue, filling: str) -> SSAValue:
    rows, cols = shape = shape_of(argument)
    if filling == "zeros":
        return b.zeros(shape)
    if filling == "ones":
        return b.constant(np.ones(shape))
    if filling == "identity":
        return b.identity(rows) if rows == cols else argument
    if filling == "numbers":
        return b.constant(np.arange(1.0, rows * cols + 1).reshape(shape) ** 2 / 4)
    return argument


@pytest.mark.parametrize("example", [e for e in ALL if 1 <= len(e.shapes) <= 2], ids=lambda e: e.label)
def test_folding_keeps_the_value(example: Example) -> None:
    """Every operand in turn zero, one, the identity, numbers, or unknown; also both operands the same value."""
    inputs = example.draw(20)
    for fillings in product(FILLINGS, repeat=len(example.shapes)):
        if example.op_class.word() == "divide" and fillings[1] == "zeros":
            continue  # 0 / 0 and x / 0: left to run time unless the numerator is 0
        block, op = example.build()
        block.detach_op(op)
        b = MatBuilder(block)
        operands = [_filled(b, a, f) for a, f in zip(block.args, fillings, strict=True)]
        plain = example.op_class(operands, matrix_type(shape_of(op.result)), example.properties)
        block.add_op(plain)
        made = b.emit(example.op_class, operands, example.properties)
        assert made.type == plain.result.type
        values = run_block(block, inputs)
        wanted, found = np.broadcast_arrays(values[plain.result], values[made])
        scale = max(1.0, np.abs(wanted[np.isfinite(wanted)]).max(initial=0.0))
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14 * scale, err_msg=str(fillings))


def _builder(*shapes: Shape) -> tuple[MatBuilder, list[SSAValue]]:
    block = Block(arg_types=[matrix_type(shape) for shape in shapes])
    return MatBuilder(block), list(block.args)


def test_constants_are_computed_while_compiling() -> None:
    b, _ = _builder()
    value = b.matmul(b.constant([[1.0, 2.0]]), b.constant([[3.0], [4.0]]))
    entries = constant_value(value)
    assert entries is not None
    assert entries.tolist() == [[11.0]]


def test_what_is_not_finite_is_left_to_run_time() -> None:
    b, _ = _builder()
    for value in (b.divide(b.number(1.0), b.number(0.0)), b.power(b.number(0.0), -1.0), b.power(b.number(-1.0), 0.5)):
        assert constant_value(value) is None


def test_double_negation_and_transposition_vanish() -> None:
    b, (a,) = _builder((2, 3))
    assert b.neg(b.neg(a)) is a
    assert b.transpose(b.transpose(a)) is a
    assert [op.name for op in b.body.ops] == ["mat.neg", "mat.transpose"]


def test_the_identity_is_no_factor() -> None:
    b, (a,) = _builder((3, 3))
    assert b.matmul(b.identity(3), a) is a
    assert b.matmul(a, b.constant(np.eye(3))) is a
    assert b.congruence(a, b.identity(3)) is a
    assert b.scale(b.number(1.0), a) is a
    assert b.divide(a, b.number(1.0)) is a


def test_zeros_are_no_terms() -> None:
    b, (a,) = _builder((3, 3))
    assert b.add(a, b.zeros((3, 3))) is a
    assert b.add(b.zeros((3, 3)), a) is a
    assert b.sub(a, b.zeros((3, 3))) is a


@pytest.mark.parametrize("along", ["rows", "columns"])
def test_a_part_taken_out_again_is_the_part(along: str) -> None:
    b, (x, y, z) = _builder((2, 2), (2, 2), (2, 2))
    whole = b.concat_rows([x, y, z]) if along == "rows" else b.concat_cols([x, y, z])
    corner = (2, 0) if along == "rows" else (0, 2)
    assert b.block(whole, *corner, 2, 2) is y
    partial = b.block(whole, *corner, 1, 2)
    assert partial is not y
    inputs = list(np.random.default_rng(0).standard_normal((3, 1, 2, 2)))
    assert np.array_equal(run_block(b.body, inputs)[partial], inputs[1][:, :1, :])


def test_a_block_across_two_parts_is_not_folded_to_one() -> None:
    b, (x, y) = _builder((2, 2), (2, 2))
    middle = b.block(b.concat_rows([x, y]), 1, 0, 2, 2)
    inputs = list(np.random.default_rng(0).standard_normal((2, 1, 2, 2)))
    wanted = np.concatenate([inputs[0][:, 1:], inputs[1][:, :1]], axis=1)
    assert np.array_equal(run_block(b.body, inputs)[middle], wanted)


def test_equal_operations_are_one_value() -> None:
    b, (x, y) = _builder((2, 2), (2, 2))
    assert b.matmul(x, y) is b.matmul(x, y)
    assert b.matmul(x, y) is not b.matmul(y, x)
    assert b.power(x, 2.0) is b.power(x, 2.0)
    assert b.power(x, 2.0) is not b.power(x, 3.0)
    assert b.block(x, 0, 0, 1, 2) is not b.block(x, 1, 0, 1, 2)
    assert b.constant([[1.0]]) is b.number(1.0)


def test_products_of_numbers_are_one_value_in_either_order() -> None:
    b, (x, y) = _builder((1, 1), (1, 1))
    assert b.scale(x, y) is b.scale(y, x)
    values = run_block(b.body, [np.full((1, 1, 1), 3.0), np.full((1, 1, 1), 5.0)])
    assert values[b.scale(y, x)].item() == 15.0


def test_integer_constants_stay_integers() -> None:
    i32 = IntegerType(32)
    b, _ = _builder()
    row = b.concat_cols([b.constant([[1]], i32), b.zeros((1, 2), i32)])
    assert row.type == matrix_type((1, 3), i32)
    entries = constant_value(row)
    assert entries is not None
    assert entries.tolist() == [[1, 0, 0]]


def test_upstream_canonicalize_folds_with_our_rules() -> None:
    """The pass makes the constants by the dialect's materialisation and drops what nobody uses."""
    numbers: Batch = np.array([[1.0, 2.0], [3.0, 4.0]])
    made = constant_of(numbers, matrix_type((2, 2)))
    block = Block([made])
    raw = MatBuilder(block)
    transposed = TransposeOp([made.result], matrix_type((2, 2)))
    determinant = DetOp([transposed.result], matrix_type((1, 1)))
    user = xdsl_test.TestOp([determinant.result])
    for op in (transposed, determinant, user):
        raw.append(op)
    module = ModuleOp(list(_detached(block)))
    CanonicalizePass().apply(make_context(), module)
    module.verify()
    producer = user.operands[0].owner
    assert isinstance(producer, ConstantOp)
    assert producer.entries().tolist() == [[-2.0]]
    assert [op.name for op in module.body.block.ops] == ["mat.constant", "test.op"]


def _detached(block: Block) -> list[Operation]:
    return [block.detach_op(op) for op in list(block.ops)]
