"""`mat` operations that stand for steps of the derivative computation itself."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
from xdsl.dialects.builtin import StringAttr
from xdsl.ir import Attribute, SSAValue
from xdsl.irdl import irdl_op_definition, prop_def
from xdsl.parser import Parser
from xdsl.printer import Printer

from yasps.dialects.mat.base import (
    Batch,
    MatOp,
    Shape,
    ShapeError,
    constant_value,
    is_identity,
    is_zero,
    same_shapes,
    shape_of,
    spell,
    square,
)
from yasps.dialects.mat.syntax import parse_value, print_values
from yasps.dialects.scalar.graph import Node, ScalarGraph

if TYPE_CHECKING:
    from yasps.dialects.mat.builder import MatBuilder

PROJECTION_MODES = ("clamp", "abs")
ISOTROPIC_WIDTHS = (9, 6)
"""Of Hessians with respect to a 3x3 or 3x2 matrix, which can be projected by its singular values."""
TWO_VECTORS = (2, 3)
"""Shape of two vectors of space, one a row, in whose frame their Hessian can be projected."""


@irdl_op_definition
class StopGradientOp(MatOp):
    """The same value, held constant by differentiation."""

    name = "mat.stop_gradient"
    ARITY: ClassVar = 1
    HELD_CONSTANT: ClassVar = True

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return shapes[0]

    def evaluate(self, *inputs: Batch) -> Batch:
        return inputs[0]

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return list(inputs[0])


@irdl_op_definition
class GivenDerivativeOp(MatOp):
    """A value, of which the derivative is given and not found by looking into it.

    Operands: the value, r x c; its Jacobian, (r c) x m, rows and columns in row-major order of the entries; and the
    arguments that this is with respect to, m entries together. The second derivative is that of the Jacobian, which may
    be a value of this kind itself. It means the value, and `differentiate` leaves nothing else of it.
    """

    name = "mat.given_derivative"
    DIFFERENTIABLE: ClassVar = False
    """Not by what it means: any Jacobian will do."""
    HELD_OPERANDS: ClassVar = (0, 1)

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        if len(shapes) < 3:
            raise ShapeError(f"it takes a value, its Jacobian and arguments, got {len(shapes)} operands")
        (rows, cols), jacobian, *arguments = shapes
        entries = sum(height * width for height, width in arguments)
        if jacobian != (rows * cols, entries):
            raise ShapeError(
                f"the Jacobian of {spell((rows, cols))} with respect to {entries} entries is "
                f"{spell((rows * cols, entries))}, got {spell(jacobian)}"
            )
        return rows, cols

    def evaluate(self, *inputs: Batch) -> Batch:
        return inputs[0]

    def is_linear(self, active: Sequence[bool]) -> bool:
        return not active[1]

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        arguments, moved = self.operands[2:], tangents[2:]
        if all(tangent is None for tangent in moved):
            return None
        parts = [b.zeros(shape_of(a)) if t is None else t for a, t in zip(arguments, moved, strict=True)]
        direction = b.concat_rows([b.flat(part) for part in parts])
        return b.reshape(b.matmul(self.operands[1], direction), shape_of(self.result))

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        column, start = b.matmul(b.transpose(self.operands[1]), b.flat(cotangent)), 0
        parts: list[SSAValue | None] = [None, None]
        for argument in self.operands[2:]:
            rows, cols = shape_of(argument)
            parts.append(b.reshape(b.block(column, start, 0, rows * cols, 1), (rows, cols)))
            start += rows * cols
        return parts

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return list(inputs[0])


@irdl_op_definition
class OverNormOp(MatOp):
    """slope / n for a norm n, entry by entry: by what the vector is multiplied in the gradient of a function of n.

    That gradient is f'(n) x / n. Where n is 0, it and the second derivative exist if f'(0) is exactly 0; then f'(n) / n
    tends to f''(0), the third operand. For any other slope the quotient is infinite, which is reported.
    """

    name = "mat.over_norm"
    ARITY: ClassVar = 3
    HELD_OPERANDS: ClassVar = (2,)

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        if shapes[1] != (1, 1):
            raise ShapeError(f"a norm must be 1x1, got {spell(shapes[1])}")
        return same_shapes("a quotient and its limit", [shapes[0], shapes[2]])

    def simplify(self) -> SSAValue | None:
        slope, _, limit = self.operands
        return slope if is_zero(slope) and is_zero(limit) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        slope, norm, limit = inputs
        at_limit = (np.real(norm) == 0) & (np.real(slope) == 0)
        return np.where(at_limit, limit, slope / np.where(at_limit, 1, norm))

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        dslope, dnorm, _ = tangents
        norm = self.operands[1]
        if dnorm is None:
            return dslope and b.over_norm(dslope, norm)
        # (f'(n) / n)' x tends to 0 with x, whatever the quotient does; but where n itself has no tangent (NaN, see
        # passes/analysis/norms.py) there is none. A constant one is not that of a direction: n is a variable of its
        # own.
        change = cast(SSAValue, b.difference(dslope, b.scale(dnorm, self.result)))
        at_zero = b.zeros(shape_of(change))
        if constant_value(dnorm) is None:
            at_zero = b.scale(dnorm, b.constant(np.ones(shape_of(change))))
        return b.select(b.less_equal(norm, b.number(0.0)), at_zero, b.divide(change, norm))

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        to_slope = b.over_norm(cotangent, self.operands[1])
        return (to_slope, b.neg(b.dot(to_slope, self.result)), None)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        norm = inputs[1][0]
        is_origin = s.compare("le", norm, s.zero)
        quotients = []
        for slope, limit in zip(inputs[0], inputs[2], strict=True):
            quotient = s.div(slope, norm)
            vanishes = s.compare("le", s.unary("abs", slope), s.zero)
            quotients.append(s.select(is_origin, s.select(vanishes, limit, quotient), quotient))
        return quotients


@irdl_op_definition
class CongruenceOp(MatOp):
    """l^T s l for a symmetric s: how a Hessian is pulled back through a linear map (eq. 3, first term)."""

    name = "mat.congruence"
    ARITY: ClassVar = 2
    DIFFERENTIABLE: ClassVar = False

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        size, _ = square("a congruence", shapes[0])
        if shapes[1][0] != size:
            raise ShapeError(f"a congruence of {spell(shapes[0])} needs {size} rows, got {spell(shapes[1])}")
        return shapes[1][1], shapes[1][1]

    def simplify(self) -> SSAValue | None:
        return self.operands[0] if is_identity(self.operands[1]) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        return inputs[1].swapaxes(1, 2) @ inputs[0] @ inputs[1]

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        inner, outer = shape_of(self.operands[1])
        middle, linear = inputs
        symmetric = [[middle[min(i, j) * inner + max(i, j)] for j in range(inner)] for i in range(inner)]
        columns = [linear[j::outer] for j in range(outer)]
        dependent = _columns_that_complete_zero(s, columns)
        # Of two columns s is applied to the one that begins lower: if l is made of blocks, whole blocks are never
        # needed.
        starts = [next((i for i, node in enumerate(column) if node != s.zero), inner) for column in columns]
        applied = s.products(columns, symmetric)

        @cache
        def entry(i: int, j: int) -> Node:
            for a, b in ((i, j), (j, i)):
                if a in dependent:
                    return s.neg(s.sum([entry(*sorted((k, b))) for k in dependent[a]]))
            a, b = sorted((i, j), key=lambda k: (starts[k], k))
            return s.dot(columns[a], applied[b])

        return [entry(min(i, j), max(i, j)) for i in range(outer) for j in range(outer)]


def _columns_that_complete_zero(s: ScalarGraph, columns: Sequence[Sequence[Node]]) -> dict[int, list[int]]:
    """Columns that are minus the sum of others, and those others: a map that sees no translation has three.

    Looked for among columns that are connected by rows, of each such family the fullest; not if it is but signs, which
    cost no more than the sum.
    """
    signs = (s.zero, s.one, s.constant(-1.0))
    families: list[tuple[set[int], list[int]]] = []
    for j, column in enumerate(columns):
        rows = {i for i, node in enumerate(column) if node != s.zero}
        met = [family for family in families if family[0] & rows]
        families = [family for family in families if not family[0] & rows]
        families.append((rows.union(*[r for r, _ in met]), [*[k for _, members in met for k in members], j]))
    found = {}
    for rows, members in families:
        if len(members) > 1 and all(_adds_up_to_zero(s, [columns[j][i] for j in members]) for i in rows):
            fullest = max(members, key=lambda j: sum(node != s.zero for node in columns[j]))
            if any(node not in signs for node in columns[fullest]):
                found[fullest] = [j for j in members if j != fullest]
    return found


def _adds_up_to_zero(s: ScalarGraph, nodes: Sequence[Node]) -> bool:
    total: dict[Node, float] = {}
    for node in nodes:
        for atom, factor in s.linear_terms(node).items():
            total[atom] = total.get(atom, 0.0) + factor
    return not any(total.values())


@irdl_op_definition
class ProjectPsdOp(MatOp):
    """A symmetric matrix made positive semi-definite: negative eigenvalues to 0 ("clamp") or to |.| ("abs").

    Solved at run time by the projection kernel; paper, section 5.4. A second operand f does not change what the result
    is: it says that the matrix is the Hessian of an energy isotropic in f, by f's entries, row by row. f is a matrix
    (3x3 or 3x2) of which the energy sees the singular values, or two vectors (2x3, one a row) of which it sees the
    lengths and the angle between them.
    """

    name = "mat.project_psd"
    DIFFERENTIABLE: ClassVar = False
    mode = prop_def(StringAttr)

    def print_inner(self, printer: Printer) -> None:
        """`mat.project_psd %h mode "clamp" isotropic in %f : 9x9`."""
        print_values(printer, self.operands[:1])
        printer.print_string(" mode ")
        printer.print_string_literal(self.mode.data)
        if len(self.operands) > 1:
            printer.print_string(" isotropic in ")
            print_values(printer, self.operands[1:])

    @classmethod
    def parse_inner(cls, parser: Parser) -> tuple[list[SSAValue], dict[str, Any]]:
        operands = [parse_value(parser)]
        parser.parse_keyword("mode")
        mode = StringAttr(parser.parse_str_literal())
        if parser.parse_optional_keyword("isotropic"):
            parser.parse_keyword("in")
            operands.append(parse_value(parser))
        return operands, {"mode": mode}

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        mode = cast(StringAttr, properties["mode"]).data
        if mode not in PROJECTION_MODES:
            raise ShapeError(f"mode must be one of {', '.join(PROJECTION_MODES)}, got {mode!r}")
        if len(shapes) not in (1, 2):
            raise ShapeError(f"a projection takes a matrix, and what it is isotropic in, got {len(shapes)} operands")
        size, _ = square("a projection", shapes[0])
        if len(shapes) == 2 and (size not in ISOTROPIC_WIDTHS or shapes[1][0] * shapes[1][1] != size):
            raise ShapeError(
                f"a 9x9 matrix can be isotropic in 9 entries and a 6x6 in 6, got {spell(shapes[0])} and "
                f"{spell(shapes[1])}"
            )
        return size, size

    def fold(self) -> None:
        """Never: whether to project is chosen again at run time (see `CompiledScene.assemble`)."""

    def evaluate(self, *inputs: Batch) -> Batch:
        upper = np.triu(inputs[0])
        values, vectors = np.linalg.eigh(upper + np.triu(upper, 1).swapaxes(1, 2))
        values = np.abs(values) if self.mode.data == "abs" else np.maximum(values, 0.0)
        return cast(Batch, (vectors * values[:, None, :]) @ vectors.swapaxes(1, 2))

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        raise ValueError("mat.project_psd is no scalar code; lower-to-scalar splits the function here")


OPS = (StopGradientOp, GivenDerivativeOp, OverNormOp, CongruenceOp, ProjectPsdOp)
