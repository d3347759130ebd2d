"""The IR as text, as dumps have it."""

from __future__ import annotations

from io import StringIO

from xdsl.dialects.builtin import UnknownLoc
from xdsl.ir import Operation, SSAValue
from xdsl.printer import Printer

from yasps.dialects.rel import DerivativeOp
from yasps.passes.analysis.derivative_summary import DerivativeSummary
from yasps.passes.analysis.names import value_name


class DumpPrinter(Printer):
    """Names values by what they are where nothing else names them, and opens derivatives with a line about them."""

    def print_ssa_value(self, value: SSAValue) -> str:
        """Prints the value's name, or a number."""
        name = value_name(value) if value.name_hint is None and value not in self._ssa_values else None
        if name is not None:
            count = self.ssa_names.get(name, 0)
            self.ssa_names[name] = count + 1
            self._ssa_values[value] = f"{name}_{count}" if count else name
        return super().print_ssa_value(value)

    def print_op(self, op: Operation) -> None:
        """Prints the operation and its regions."""
        if isinstance(op, DerivativeOp):
            self.print_string(f"// {DerivativeSummary.of(op).line()}")
            self._print_new_line()
        super().print_op(op)


class LocationPrinter(DumpPrinter):
    """Prints `loc("file":line:column)` behind every operation whose place is known, and nothing behind others.

    xDSL's `print_debuginfo` writes `loc(unknown)` behind each of the others. Either parses back.
    """

    def print_op(self, op: Operation) -> None:
        """Prints the operation, its regions and its place."""
        super().print_op(op)
        if not isinstance(op.location, UnknownLoc):
            self.print_string(" ")
            self.print_attribute(op.location)


class NumberPrinter(Printer):
    """Numbers all values, whatever they are called: what a key is made of."""

    def print_ssa_value(self, value: SSAValue) -> str:
        """Prints the value's number."""
        name = self._ssa_values.get(value)
        if name is None:
            name = self._ssa_values[value] = self._get_new_valid_name_id()
        self.print_string(f"%{name}")
        return name


def text_of(module: Operation, *, locations: bool = False) -> str:
    """The operation as text that parses back, with or without places; ends with a line break."""
    return _printed(module, LocationPrinter if locations else DumpPrinter)


def unnamed_text_of(module: Operation) -> str:
    """As `text_of`, with numbers for names and without comments: the same for all that differs in names of values."""
    return _printed(module, NumberPrinter)


def _printed(module: Operation, printer: type[Printer]) -> str:
    stream = StringIO()
    printer(stream).print_op(module)
    return stream.getvalue() + "\n"
