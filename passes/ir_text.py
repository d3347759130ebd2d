"""The IR as text, as dumps have it."""

from __future__ import annotations

from io import StringIO

from xdsl.dialects.builtin import UnknownLoc
from xdsl.ir import Operation
from xdsl.printer import Printer


class LocationPrinter(Printer):
    """Prints `loc("file":line:column)` behind every operation whose place is known, and nothing behind others.

    xDSL's `print_debuginfo` writes `loc(unknown)` behind each of the others. Either parses back.
    """

    def print_op(self, op: Operation) -> None:
        """Prints the operation, its regions and its place."""
        super().print_op(op)
        if not isinstance(op.location, UnknownLoc):
            self.print_string(" ")
            self.print_attribute(op.location)


def text_of(module: Operation, *, locations: bool = False) -> str:
    """The operation as text that parses back, with or without places; ends with a line break."""
    stream = StringIO()
    printer = LocationPrinter(stream) if locations else Printer(stream)
    printer.print_op(module)
    return stream.getvalue() + "\n"
