"""Parts of `rel` assembly formats: matrix types written short, as in `mat` (dialects/mat/syntax.py)."""

from __future__ import annotations

from typing import cast

import numpy as np
from xdsl.dialects.builtin import DenseIntOrFPElementsAttr, Float64Type
from xdsl.irdl import IRDLOperation
from xdsl.irdl.declarative_assembly_format import (
    AttributeVariable,
    CustomDirective,
    ParsingState,
    PrintingState,
    TypeDirective,
    irdl_custom_directive,
)
from xdsl.parser import Parser
from xdsl.printer import Printer

from yasps.dialects.mat import Matrix
from yasps.dialects.mat.base import dense, is_matrix_type
from yasps.dialects.mat.syntax import parse_numbers, parse_type, print_numbers, print_type


@irdl_custom_directive
class ResultType(CustomDirective):
    """The type of the one result: `custom<ResultType>(type($result))`."""

    result: TypeDirective

    def parse(self, parser: Parser, state: ParsingState) -> None:
        self.result.set(state, (parse_type(parser),))

    def print(self, printer: Printer, state: PrintingState, op: IRDLOperation) -> None:
        state.print_whitespace(printer)
        print_type(printer, self.result.get(op)[0])


@irdl_custom_directive
class DeclaredType(CustomDirective):
    """A type that is a property: `custom<DeclaredType>($type)`."""

    type: AttributeVariable

    def parse(self, parser: Parser, state: ParsingState) -> None:
        self.type.set(state, parse_type(parser))

    def print(self, printer: Printer, state: PrintingState, op: IRDLOperation) -> None:
        state.print_whitespace(printer)
        type_ = self.type.get(op)
        assert type_ is not None
        print_type(printer, type_)


@irdl_custom_directive
class Numbers(CustomDirective):
    """Optional numbers of the declared type, as `mat.constant` writes them: `custom<Numbers>($numbers)`."""

    numbers: AttributeVariable

    def parse(self, parser: Parser, state: ParsingState) -> None:
        position = parser.pos
        entries, type_ = parse_numbers(parser), state.properties["type"]
        if not is_matrix_type(type_) or entries.shape not in ((1, 1), cast(Matrix, type_).get_shape()):
            parser.raise_error("the numbers do not fill the type", position, parser.pos)
        shape = cast(Matrix, type_).get_shape()
        self.numbers.set(state, dense(np.broadcast_to(entries, shape), cast(Matrix, type_)))

    def print(self, printer: Printer, state: PrintingState, op: IRDLOperation) -> None:
        state.print_whitespace(printer)
        numbers = cast("DenseIntOrFPElementsAttr[Float64Type]", self.numbers.get(op))
        print_numbers(printer, np.array(numbers.get_values()).reshape(numbers.get_shape()))

    def is_present(self, op: IRDLOperation) -> bool:
        return self.numbers.is_present(op)

    def is_anchorable(self) -> bool:
        return True
