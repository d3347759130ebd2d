"""Errors of the compiler about what a scene says, with the line of Python that made what they are about."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from xdsl.dialects.builtin import FileLineColLoc
from xdsl.ir import Operation
from xdsl.utils.exceptions import DiagnosticException

from yasps.dialects.mat import NotDifferentiableError, ShapeError

RULE_BROKEN = (DiagnosticException, NotDifferentiableError, ShapeError)
"""What verifiers, derivative rules and shape laws raise; they know the rule, but not whose attribute it is."""


class CompileError(DiagnosticException):
    """This module can't be compiled: which pass says so, of which attribute, made where, and why.

    during: what was done, e.g. "pass differentiate"; symbol: of the attribute; place: `file:line` of the Python that
    made it. Each is None as long as it is not known.
    """

    def __init__(
        self, reason: str, *, during: str | None = None, symbol: str | None = None, place: str | None = None
    ) -> None:
        super().__init__(reason)
        self.reason = reason
        self.during = during
        self.symbol = symbol
        self.place = place

    def __str__(self) -> str:
        reason = self.reason
        if self.symbol is not None:
            name = f"@{self.symbol}"
            described = name if self.place is None else f"{name} (made at {self.place})"
            said = reason == name or reason.startswith((f"{name} ", f"{name}:"))
            reason = reason.replace(name, described, 1) if said else f"{described}: {reason}"
        return reason if self.during is None else f"{self.during}: {reason}"


def place_of(op: Operation) -> str | None:
    """`file:line` of the Python that made the operation, if that is known."""
    location = op.location
    return f"{location.filename.data}:{location.line.data}" if isinstance(location, FileLineColLoc) else None


@contextmanager
def working_on(symbol: str, op: Operation) -> Iterator[None]:
    """Errors raised inside are about this attribute: they become a CompileError that names it and its place."""
    try:
        yield
    except RULE_BROKEN as error:
        if isinstance(error, CompileError) and error.symbol is not None:
            raise  # about something further inside
        raise CompileError(reason_of(error), symbol=symbol, place=place_of(op)) from error


def reason_of(error: Exception) -> str:
    """What an error says about a rule, and what to do about it where that is always the same."""
    if isinstance(error, CompileError):
        return error.reason
    if isinstance(error, NotDifferentiableError):
        return f"{error}; leave it out of what is minimised, or hold what it acts on constant by stop_gradient()"
    return str(error)
