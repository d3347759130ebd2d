"""`mat` operations as text: each writes its type once, and what is read is what was written."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from mat_bodies import block_of
from mat_examples import ALL, Example
from xdsl.dialects.builtin import FloatAttr, ModuleOp, StringAttr, f64, i32
from xdsl.dialects.func import FuncOp, ReturnOp
from xdsl.ir import Block, Operation, Region
from xdsl.parser import Parser
from xdsl.utils.exceptions import ParseError

from yasps.dialects.mat import MatOp, matrix_type
from yasps.dialects.mat.base import dense
from yasps.dialects.mat.elementwise import PowOp
from yasps.dialects.mat.structure import ConstantOp
from yasps.passes.pipeline import make_context


def text_in_function(block: Block) -> str:
    """The module whose only function has this body."""
    block.add_op(ReturnOp())
    return str(ModuleOp([FuncOp("f", ([argument.type for argument in block.args], []), Region(block))]))


def read_back(text: str) -> tuple[str, Operation]:
    """The module's text once more, and the first operation of the function."""
    module = Parser(make_context(), text).parse_module()
    module.verify()
    function = module.body.block.first_op
    assert isinstance(function, FuncOp)
    first = function.body.block.first_op
    assert first is not None
    return str(module), first


@pytest.mark.parametrize("example", ALL, ids=lambda example: example.label)
def test_what_is_written_is_read(example: Example) -> None:
    block, op = example.build()
    op.attributes["note"] = StringAttr("kept")
    text = text_in_function(block)
    again, read = read_back(text)
    assert again == text
    assert (type(read), read.properties, read.attributes) == (type(op), op.properties, op.attributes)
    (line,) = [line for line in text.splitlines() if "mat." in line]
    assert len(re.findall(r"\b\d+x\d+\b", line)) == 1
    assert "tensor" not in line
    assert "array<" not in line
    assert "dense<" not in line


def constant(entries: list[list[float]]) -> ConstantOp:
    values = np.array(entries)
    return ConstantOp([], matrix_type(values.shape), {"value": dense(values, matrix_type(values.shape))})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("entries", "text"),
    [
        ([[0.5]], "0.5"),
        ([[3.0]], "3.0"),
        ([[0.1, 1e-300], [-2.0, 1e22]], "[[0.1, 1.0e-300], [-2.0, 1.0e+22]]"),
        ([[1.0, 1.0]], "1.0"),
        ([[0.0, -0.0]], "[[0.0, -0.0]]"),
        ([[math.inf, -math.inf]], "[[inf, -inf]]"),
        ([[math.nan]], "nan"),
    ],
)
def test_numbers_are_short_and_exact(entries: list[list[float]], text: str) -> None:
    op = constant(entries)
    written = text_in_function(Block([op]))
    assert f"mat.constant {text} : {len(entries)}x{len(entries[0])}\n" in written
    _, read = read_back(written)
    assert isinstance(read, ConstantOp)
    np.testing.assert_array_equal(read.entries(), np.array(entries))
    np.testing.assert_array_equal(np.signbit(read.entries()), np.signbit(np.array(entries)))


def test_placement_indices_say_their_type() -> None:
    type_ = matrix_type((1, 2), i32)
    written = text_in_function(Block([ConstantOp([], type_, {"value": dense(np.array([[0, 7]]), type_)})]))
    assert "mat.constant [[0, 7]] : 1x2xi32\n" in written
    assert read_back(written)[0] == written


def test_exponents_are_exact() -> None:
    block = block_of(((1, 1),))
    block.add_op(PowOp(list(block.args), matrix_type((1, 1)), {"exponent": FloatAttr(1 / 3, f64)}))
    written = text_in_function(block)
    assert f"mat.pow %0 exponent {1 / 3!r} : 1x1" in written
    _, read = read_back(written)
    assert isinstance(read, PowOp)
    assert read.power == 1 / 3


def parse(line: str) -> MatOp:
    _, first = read_back(f"func.func @f(%a: tensor<2x3xf64>) {{\n  %b = {line}\n  func.return\n}}")
    assert isinstance(first, MatOp)
    return first


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("mat.neg %c : 2x3", "%c is not defined above"),
        ("mat.neg %a#1 : 2x3", "%a is not defined above"),
        ("mat.neg %a : 2x3x4", "a matrix has a type ROWSxCOLUMNS"),
        ("mat.neg %a : f64", "mat.neg gives a matrix of 1 to 1048576 entries"),
        ("mat.neg %a : 0x3", "mat.neg gives a matrix of 1 to 1048576 entries"),
        ("mat.constant [[1.0, 2.0], [3.0]] : 2x2", "rows need equally many numbers"),
        ("mat.constant [[1.0, 2.0]] : 2x2", "numbers for 1x2, but a type of 2x2"),
        ("mat.constant [[]] : 1x1", "rows need equally many numbers, at least one"),
        ("mat.block %a[0] : 1x1", "a row and a column are needed"),
    ],
)
def test_what_cannot_be_read(line: str, message: str) -> None:
    with pytest.raises(ParseError, match=re.escape(message)):
        parse(line)


def test_a_type_may_be_written_in_full() -> None:
    assert str(parse("mat.neg %a : tensor<2x3xf64>")) == str(parse("mat.neg %a : 2x3"))
