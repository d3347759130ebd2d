"""The words of the textual IR that `mat` and `rel` share: types as `3x1`, numbers, operands without a type.

A matrix of f64 is written by its shape, one of placement indices as `3x1xi32`; any other type in full. Operands need no
type: bodies have one block, where every value is defined above its uses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from xdsl.dialects.builtin import Float64Type, IntegerType, TensorType, f64
from xdsl.ir import Attribute, SSAValue
from xdsl.parser import Parser, UnresolvedOperand
from xdsl.printer import Printer
from xdsl.utils.mlir_lexer import MLIRTokenKind


def spell_type(type_: Attribute) -> str:
    """`3x1` for `tensor<3x1xf64>`, `3x1xi32` for `tensor<3x1xi32>`, other types in full."""
    if isinstance(type_, TensorType) and len(type_.get_shape()) == 2 and min(type_.get_shape()) >= 0:
        element = type_.element_type
        if isinstance(element, Float64Type | IntegerType):
            rows, cols = type_.get_shape()
            return f"{rows}x{cols}" if element == f64 else f"{rows}x{cols}x{element}"
    return str(type_)


def print_type(printer: Printer, type_: Attribute) -> None:
    """Prints a type as `spell_type` writes it."""
    printer.print_string(spell_type(type_))


def parse_type(parser: Parser) -> Attribute:
    """Parses what `print_type` prints."""
    if parser._current_token.kind is not MLIRTokenKind.INTEGER_LIT:
        return parser.parse_type()
    position = parser.pos
    shape = parser.parse_dimension_list()
    if len(shape) != 2:
        parser.raise_error("a matrix has a type ROWSxCOLUMNS", position, parser.pos)
    element: Attribute = f64
    if parser._current_token.text.startswith("x"):  # glued to the shape, as in 3x1xi32
        parser.parse_shape_delimiter()
        element = parser.parse_type()
    return TensorType(cast(Any, element), shape)


def print_values(printer: Printer, values: Sequence[SSAValue]) -> None:
    """Prints operands, separated by commas."""
    printer.print_list(values, printer.print_ssa_value)


def parse_value(parser: Parser) -> SSAValue:
    """Parses an operand; raises ParseError unless it is defined above."""
    return _defined(parser, parser.parse_unresolved_operand())


def parse_values(parser: Parser) -> list[SSAValue]:
    """Parses operands that are separated by commas; there may be none."""
    values: list[SSAValue] = []
    operand = parser.parse_optional_unresolved_operand()
    while operand is not None:
        values.append(_defined(parser, operand))
        operand = parser.parse_unresolved_operand() if parser.parse_optional_punctuation(",") else None
    return values


def _defined(parser: Parser, operand: UnresolvedOperand) -> SSAValue:
    known = parser.ssa_values.get(operand.operand_name)
    if known is None or operand.index >= len(known):
        parser.raise_error(f"{operand.span.text} is not defined above", operand.span)
    return known[operand.index]


def print_numbers(printer: Printer, entries: NDArray[Any]) -> None:
    """Prints the entries [rows, columns] as `[[1.0, 0.0], [0.0, 2.0]]`, or as one number if they are all the same."""
    rows = [[spelled(entry) for entry in row] for row in entries.tolist()]
    if len({word for row in rows for word in row}) == 1:
        printer.print_string(rows[0][0])
    else:
        printer.print_string("[" + ", ".join(f"[{', '.join(row)}]" for row in rows) + "]")


def spelled(number: float) -> str:
    """A number as the lexer reads it; the shortest text that gives the same number."""
    if isinstance(number, int):
        return str(number)
    if not math.isfinite(number):
        return "nan" if math.isnan(number) else "inf" if number > 0 else "-inf"
    text = repr(number)
    if "e" in text and "." not in text:
        text = text.replace("e", ".0e")
    return text


def parse_numbers(parser: Parser) -> NDArray[Any]:
    """Parses what `print_numbers` prints: [rows, columns], or [1, 1] for one number."""
    position = parser.pos
    if parser.parse_optional_punctuation("[") is None:
        return np.array([[parse_number(parser)]], object)
    rows = [parser.parse_comma_separated_list(parser.Delimiter.SQUARE, lambda: parse_number(parser))]
    while parser.parse_optional_punctuation(","):
        rows.append(parser.parse_comma_separated_list(parser.Delimiter.SQUARE, lambda: parse_number(parser)))
    parser.parse_punctuation("]")
    if not rows[0] or any(len(row) != len(rows[0]) for row in rows):
        parser.raise_error("rows need equally many numbers, at least one", position, parser.pos)
    return np.array(rows, object)


def parse_number(parser: Parser) -> float:
    """Parses one number, which may be `inf` or `nan`."""
    if parser.parse_optional_keyword("nan"):
        return math.nan
    if parser.parse_optional_keyword("inf"):
        return math.inf
    if parser._current_token.text == "-":
        parser.parse_punctuation("-")
        return -parse_number(parser)
    return parser.parse_number()


def parse_integers(parser: Parser) -> list[int]:
    """Parses `[1, 0]`."""
    return parser.parse_comma_separated_list(parser.Delimiter.SQUARE, parser.parse_integer)
