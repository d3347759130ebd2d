"""Shape laws: wrong shapes are refused with a message in rows and columns, by `infer` and by the verifier."""

from __future__ import annotations

import pytest
from mat_bodies import block_of
from mat_examples import ALL, integers
from xdsl.dialects.builtin import IntegerAttr, StringAttr, f64, i64
from xdsl.ir import Attribute, Block
from xdsl.utils.exceptions import VerifyException

from yasps.dialects.mat import OPERATIONS, MatOp, Shape, ShapeError, algebra, matrix_type
from yasps.dialects.mat.algebra import TransposeOp

PLACE: dict[str, Attribute] = {"place": integers(1, 1, 3, 3)}

WRONG: list[tuple[str, tuple[Shape, ...], dict[str, Attribute], str]] = [
    ("add", ((2, 3), (3, 2)), {}, "a sum needs equal shapes, got 2x3 and 3x2"),
    ("sub", ((2, 3), (2, 1)), {}, "a difference needs equal shapes, got 2x3 and 2x1"),
    ("hadamard", ((1, 3), (3, 1)), {}, "an entry-wise product needs equal shapes, got 1x3 and 3x1"),
    ("scale", ((2, 1), (2, 3)), {}, "the factor must be 1x1, got 2x1"),
    ("divide", ((2, 3), (1, 2)), {}, "the divisor must be 1x1, got 1x2"),
    ("matmul", ((2, 3), (2, 3)), {}, "a product of 2x3 and 2x3 does not exist: 3 != 2"),
    ("dot", ((3, 1), (1, 3)), {}, "a dot product needs equal shapes, got 3x1 and 1x3"),
    ("cross", ((2, 1), (2, 1)), {}, r"a cross product needs vectors of 3 entries \(3x1 or 1x3\), got 2x1"),
    ("cross", ((3, 1), (1, 3)), {}, "a cross product needs equal shapes, got 3x1 and 1x3"),
    ("trace", ((2, 3),), {}, "a trace needs a square matrix, got 2x3"),
    ("det", ((2, 3),), {}, "a determinant needs a square matrix, got 2x3"),
    ("det", ((5, 5),), {}, "a determinant is available up to 4x4, got 5x5"),
    ("cofactor", ((5, 5),), {}, "a cofactor matrix is available up to 4x4, got 5x5"),
    ("inverse", ((5, 5),), {}, "an inverse is available up to 4x4, got 5x5"),
    ("inverse", ((1, 2),), {}, "an inverse needs a square matrix, got 1x2"),
    ("eigenvalues", ((4, 4),), {}, "an eigenvalue needs a matrix of 2x2 or 3x3, got 4x4"),
    ("spectral", ((3, 2), (3, 1), (3, 1)), {}, "a spectral function needs a matrix of 2x2 or 3x3, got 3x2"),
    ("spectral", ((3, 3), (2, 1), (3, 1)), {}, "a 3x3 matrix has 3x1 eigenvalues, got 2x1"),
    ("spectral", ((3, 3), (3, 1), (1, 1)), {}, "3 eigenvalues have 3x1 divided differences, got 1x1"),
    ("spectral_tangent", ((2, 2), (1, 1), (3, 3)), {}, "the tangent of a 2x2 matrix has its shape, got 3x3"),
    ("polar", ((2, 2),), {}, "a polar decomposition needs a 3x3 matrix, got 2x2"),
    ("identity", (), {"size": integers(0)}, "an identity matrix has at least one row, got 0"),
    ("reshape", ((2, 3),), {"shape": integers(2, 2)}, "2x3"),
    ("reshape", ((2, 3),), {"shape": integers(-2, -3)}, "2x3"),
    ("block", ((2, 3),), {"block": integers(1, 0, 2, 3)}, r"rows 1\.\.2, columns 0\.\.2 are not inside a 2x3 matrix"),
    ("block", ((2, 3),), {"block": integers(-1, 0, 1, 1)}, "are not inside a 2x3 matrix"),
    ("block", ((2, 3),), {"block": integers(0, 0, 0, 1)}, "are not inside a 2x3 matrix"),
    ("embed", ((3, 1),), PLACE, r"3x1 at \(1, 1\) does not fit into 3x3"),
    ("concat_rows", ((1, 2), (1, 3)), {}, "parts need equally many columns, got 1x2, 1x3"),
    ("concat_cols", ((2, 1), (3, 1)), {}, "parts need equally many rows, got 2x1, 3x1"),
    ("concat_rows", (), {}, "nothing to put together"),
    ("congruence", ((2, 3), (3, 1)), {}, "a congruence needs a square matrix, got 2x3"),
    ("congruence", ((3, 3), (2, 3)), {}, "a congruence of 3x3 needs 3 rows, got 2x3"),
    ("project_psd", ((2, 3),), {"mode": StringAttr("clamp")}, "a projection needs a square matrix, got 2x3"),
    ("project_psd", ((2, 2),), {"mode": StringAttr("none")}, "mode must be one of clamp, abs, got 'none'"),
    ("atan2", ((2, 1), (1, 2)), {}, "an angle by atan2 needs equal shapes, got 2x1 and 1x2"),
    ("hypot", ((2, 1), (1, 2)), {}, "a length by hypot needs equal shapes, got 2x1 and 1x2"),
    ("over_norm", ((2, 1), (2, 1), (2, 1)), {}, "a norm must be 1x1, got 2x1"),
    ("over_norm", ((2, 1), (1, 1), (1, 2)), {}, "a quotient and its limit needs equal shapes, got 2x1 and 1x2"),
    ("stumpff", ((2, 1),), {"order": IntegerAttr(10, i64)}, "one of 0 to 9, got 10"),
    ("compare", ((2, 1), (1, 1)), {"predicate": StringAttr("lt")}, "a comparison needs equal shapes, got 2x1 and 1x1"),
    ("compare", ((1, 1), (1, 1)), {"predicate": StringAttr("eq")}, "predicate must be one of lt, le, got 'eq'"),
    ("select", ((1, 1), (2, 1), (1, 1)), {}, "a choice needs equal shapes, got 2x1 and 1x1"),
    ("select", ((2, 1), (2, 3), (2, 3)), {}, "the condition must be 1x1 or 2x3, got 2x1"),
    ("select", ((2, 1), (1, 1), (1, 1)), {}, "the condition must be 1x1, got 2x1"),
    ("min", ((2, 1), (1, 1)), {}, "a minimum needs equal shapes, got 2x1 and 1x1"),
    ("max", ((2, 1), (1, 1)), {}, "a maximum needs equal shapes, got 2x1 and 1x1"),
    ("given_derivative", ((1, 1), (1, 3)), {}, "it takes a value, its Jacobian and arguments, got 2 operands"),
    ("given_derivative", ((2, 1), (3, 2), (3, 1)), {}, "of 2x1 with respect to 3 entries is 2x3, got 3x2"),
    # properties with a wrong number of integers
    ("identity", (), {"size": integers(2, 2)}, "size takes 1 integer"),
    ("reshape", ((2, 3),), {"shape": integers(6)}, "shape takes 2 integers"),
    ("block", ((2, 3),), {"block": integers(0, 0)}, "block takes 4 integers"),
    ("embed", ((2, 1),), {"place": integers(1, 1, 3)}, "place takes 4 integers"),
]

ANY_SHAPE = {"neg", "transpose", "sum", "norm", "constant", "stop_gradient", "pow", "abs"} | {
    op.word() for op in OPERATIONS if hasattr(op, "FUNCTION")
}
"""Operations that take whatever they get."""

BY_WORD: dict[str, type[MatOp]] = {op.word(): op for op in OPERATIONS}


def test_every_operation_with_a_shape_law_is_refused_something() -> None:
    assert {word for word, *_ in WRONG} | ANY_SHAPE == set(BY_WORD)


@pytest.mark.parametrize(("word", "shapes", "properties", "message"), WRONG)
def test_wrong_shapes(word: str, shapes: tuple[Shape, ...], properties: dict[str, Attribute], message: str) -> None:
    op_class = BY_WORD[word]
    with pytest.raises(ShapeError, match=message):
        op_class.infer(shapes, properties)
    op = op_class(list(block_of(shapes).args), matrix_type((2, 2)), properties)
    with pytest.raises(VerifyException, match=f"mat.{word}: .*{message}"):
        op.verify()


@pytest.mark.parametrize("op_class", [op for op in OPERATIONS if op.ARITY is not None], ids=lambda op: op.word())
def test_a_wrong_number_of_operands_does_not_verify(op_class: type[MatOp]) -> None:
    example = next(e for e in ALL if e.op_class is op_class)
    arity = op_class.ARITY
    assert arity is not None
    block = block_of(((1, 1),) * (arity + 1))
    op = op_class(list(block.args), matrix_type((1, 1)), example.properties)
    with pytest.raises(VerifyException, match=f"mat.{op_class.word()} takes {arity} operands, got {arity + 1}"):
        op.verify()


def test_only_matrices_are_taken() -> None:
    block = Block(arg_types=[f64])
    op = TransposeOp(list(block.args), matrix_type((1, 1)))
    with pytest.raises(
        VerifyException, match="takes and gives matrices tensor<RxCxf64> of 1 to 1048576 entries, not f64"
    ):
        op.verify()


def test_the_largest_determinant_is_what_the_message_says() -> None:
    assert algebra.LARGEST_DETERMINANT == 4
