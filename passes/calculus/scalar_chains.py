"""Numbers computed from few other numbers: their derivatives are made once, not once for every direction.

Between an energy and its matrices there is often a chain of 1x1 values, as between a squared distance and its barrier.
Forward mode would walk the chain again for every direction; but a number v = f(u, w) has the tangent f_u u' + f_w w',
and f_u and f_w are the same for all directions.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

from xdsl.ir import SSAValue

from yasps.dialects.mat import MatOp, shape_of
from yasps.dialects.mat.calculus import OverNormOp

Slopes = tuple[tuple[SSAValue, SSAValue | None], ...]
WIDEST_FRONT = 2
"""More numbers than this are no bottleneck: the chain's own rules cost less."""
FARTHEST_FRONT = 6
"""A front is followed while it is no wider than this: beyond, it rarely narrows again."""
MOST_STEPS = 32
"""So many steps from bottleneck to bottleneck a front is followed, so that all chains together take linear time."""

Partial = Callable[[SSAValue, SSAValue, Collection[SSAValue]], SSAValue | None]


@dataclass(frozen=True)
class _Front:
    """Numbers that another is a function of, and the norms of the quotients between them."""

    numbers: tuple[SSAValue, ...]
    norms: frozenset[SSAValue]


class ScalarChains:
    """Slopes of 1x1 values with respect to the 1x1 values they are computed from.

    inputs: values whose tangents are given, where every chain ends. partial(v, u, front): derivative of v with respect
    to u, the others of the front held; None for zero.
    """

    def __init__(self, inputs: Collection[SSAValue], partial: Partial) -> None:
        self._inputs = frozenset(inputs)
        self._partial = partial
        self._known: dict[SSAValue, Slopes | None] = {}
        self._fronts: dict[SSAValue, _Front | None] = {}
        self._chained: dict[SSAValue, bool] = {}
        self._active: dict[SSAValue, bool] = dict.fromkeys(inputs, True)
        self._positions: dict[SSAValue, int] = {}

    def slopes(self, value: SSAValue) -> Slopes | None:
        """The front that `value` is computed from and its slopes; None where the operation's own rule does better."""
        if value not in self._known:
            front = self._front(value)
            self._known[value] = (
                None if front is None else tuple((u, self._partial(value, u, front.numbers)) for u in front.numbers)
            )
        return self._known[value]

    def _front(self, value: SSAValue) -> _Front | None:
        """The front of a number; first those of all numbers that it is computed from in chains."""
        stack = [value]
        while stack:
            current = stack[-1]
            if current in self._fronts:
                stack.pop()
                continue
            if not self._in_chain(current):
                self._fronts[current] = None
                continue
            missing = [u for u in self._operands(current) if u not in self._fronts]
            if missing:
                stack.extend(missing)
                continue
            self._fronts[current] = self._narrowest(current)
        return self._fronts[value]

    def _narrowest(self, value: SSAValue) -> _Front | None:
        """The narrowest set of numbers that value is a function of; of equally narrow ones the nearest to the inputs.

        It goes from one front to the next by putting in place of a number that number's own front, so that a long chain
        is not walked again for each of its numbers. One that has none ends it: what is computed from it can't have one
        that is narrower.
        """
        front, best = self._operands(value), None
        norms = _norms_taken_apart(value)
        for _ in range(MOST_STEPS):
            if (
                len(front) <= WIDEST_FRONT
                and (best is None or len(front) <= len(best.numbers))
                and all(u is norm for norm in norms for u in front)
            ):
                best = _Front(tuple(front), norms)
            inner = [u for u in front if self._in_chain(u)]
            if not inner or len(front) > FARTHEST_FRONT:
                break
            # The last made first: nothing that is still in the front can be computed from it.
            last = max(inner, key=self._height)
            behind = self._fronts[last]
            if behind is None:
                break
            norms = norms | behind.norms
            front = list(dict.fromkeys([*(u for u in front if u is not last), *behind.numbers]))
        return best

    def _in_chain(self, value: SSAValue) -> bool:
        """Is it a number computed from numbers alone, by a rule without choices?

        A choice is never differentiated as f' u': what lies behind the side not taken may be NaN, and 0 NaN is NaN.
        """
        if value not in self._chained:
            op = value.owner
            self._chained[value] = (
                value not in self._inputs
                and isinstance(op, MatOp)
                and not op.HELD_CONSTANT
                and shape_of(value) == (1, 1)
                and all(shape_of(operand) == (1, 1) for operand in op.operands)
                and type(op).chosen_by is MatOp.chosen_by
            )
        return self._chained[value]

    def _operands(self, value: SSAValue) -> list[SSAValue]:
        op = value.owner
        assert isinstance(op, MatOp)
        return [operand for operand in dict.fromkeys(op.operands) if self._is_active(operand)]

    def _is_active(self, value: SSAValue) -> bool:
        stack = [value]
        while stack:
            current = stack[-1]
            op = current.owner
            if current in self._active or not isinstance(op, MatOp) or op.HELD_CONSTANT:
                self._active.setdefault(current, False)
                stack.pop()
                continue
            missing = [operand for operand in op.operands if operand not in self._active]
            if missing:
                stack.extend(missing)
                continue
            self._active[current] = any(self._active[operand] for operand in op.operands)
            stack.pop()
        return self._active[value]

    def _height(self, value: SSAValue) -> int:
        """Length of the longest way from anything made before: larger than those of all it is computed from."""
        stack = [value]
        while stack:
            current = stack[-1]
            op = current.owner
            operands = op.operands if isinstance(op, MatOp) else ()
            missing = [operand for operand in operands if operand not in self._positions]
            if current not in self._positions and missing:
                stack.extend(missing)
                continue
            self._positions.setdefault(current, 1 + max((self._positions[v] for v in operands), default=0))
            stack.pop()
        return self._positions[value]


def _norms_taken_apart(value: SSAValue) -> frozenset[SSAValue]:
    """The norm n if the value is a quotient slope / n: then nothing but n may be its front.

    Where slope and n are both 0 the quotient has tangents, but its derivative with respect to anything else that the
    slope is computed from is infinite.
    """
    op = value.owner
    return frozenset({op.operands[1]}) if isinstance(op, OverNormOp) else frozenset()
