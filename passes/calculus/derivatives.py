"""Derivatives inside one body, at the level of matrices: memoised traversals, not rewriting patterns."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush

from xdsl.ir import SSAValue

from yasps.dialects.mat import MatBuilder, MatOp, shape_of
from yasps.dialects.mat.algebra import NormOp
from yasps.dialects.mat.base import is_zero
from yasps.dialects.mat.spectral import EigenvaluesOp
from yasps.passes.analysis.dependence import DependenceMap, size_of
from yasps.passes.analysis.norms import divisors, inverse_for_tangents, smooth_norms
from yasps.passes.calculus.divided_differences import divided_differences
from yasps.passes.calculus.scalar_chains import ScalarChains


def pull_back(
    b: MatBuilder, dependence: DependenceMap, seeds: Mapping[SSAValue, SSAValue], stop_at: Sequence[SSAValue]
) -> dict[SSAValue, SSAValue]:
    """Reverse mode: cotangents of the values `stop_at` for the cotangents `seeds`.

    The block must hold the primal operations already; the cotangents are appended to it. Values that the seeds
    don't reach are missing from the result.
    """
    guards, divided = _Guards(b), divisors(list(seeds))
    parts: dict[SSAValue, list[_Part]] = {value: [_Part(None, seed)] for value, seed in seeds.items()}
    stops = set(stop_at)
    for op in reversed([op for op in dependence.block.ops if isinstance(op, MatOp)]):
        if op.result not in parts or op.result in stops or not dependence.is_active(op.result):
            continue
        whole = guards.sum(parts.pop(op.result))
        choice = op.chosen_by(b)
        if isinstance(op, NormOp) and op.result not in divided:
            pulled = [(0, _Part(whole.guard, _gradient_through(b, op, whole.value)))]
        elif isinstance(op, EigenvaluesOp):
            differences = divided_differences(b, op.result, whole.value, _derivative_along)
            pulled = [(0, _Part(whole.guard, b.spectral(op.operands[0], whole.value, differences)))]
        elif choice is not None:
            first, second, condition = choice
            guard_first, guard_second = guards.split(whole.guard, condition)
            pulled = [(first, _Part(guard_first, whole.value)), (second, _Part(guard_second, whole.value))]
        else:
            pulled = [
                (k, _Part(whole.guard, part)) for k, part in enumerate(op.pullback(b, whole.value)) if part is not None
            ]
        for k, part in pulled:
            if dependence.is_active(op.operands[k]):
                parts.setdefault(op.operands[k], []).append(part)
    return {value: guards.applied(guards.sum(parts[value])) for value in stop_at if value in parts}


def _gradient_through(b: MatBuilder, norm: NormOp, slope: SSAValue) -> SSAValue:
    """slope / n x: what a norm n of x adds to the cotangent of x, with its limit at x = 0 where that exists.

    `slope` is that of the final value with respect to n, itself a function of n. Where both are 0, slope / n is its
    derivative with respect to n, all else held.
    """
    limit = PushForward(b, {norm.result: b.number(1.0)})[slope]
    return b.scale(b.over_norm(slope, norm.result, limit), norm.operands[0])


def _derivative_along(b: MatBuilder, value: SSAValue, of: SSAValue, direction: SSAValue) -> SSAValue | None:
    """Derivative of a value with respect to another one along a direction of that, all else held."""
    return PushForward(b, {of: direction})[value]


@dataclass(frozen=True)
class _Part:
    """A cotangent that counts where the 1x1 truth value `guard` holds, everywhere if it is None.

    Elsewhere it is zero, and `value` may be anything, NaN too: what lies behind a choice not taken is pulled back like
    all the rest, but never multiplied with a zero, which would let its NaN and infinity through.
    """

    guard: SSAValue | None
    value: SSAValue


class _Guards:
    """Truth values made of the conditions of nested choices."""

    def __init__(self, b: MatBuilder) -> None:
        self.b = b
        self._choices: dict[tuple[SSAValue, SSAValue], tuple[SSAValue | None, SSAValue]] = {}
        """For the guards of a choice's two sides: the guard of the choice itself, and its condition."""

    def split(self, guard: SSAValue | None, condition: SSAValue) -> tuple[SSAValue, SSAValue]:
        """Guards of the two sides of a choice that is itself guarded."""
        b, zero = self.b, self.b.number(0.0)
        if guard is None:
            sides = condition, b.select(condition, zero, b.number(1.0))
        else:
            sides = b.select(condition, guard, zero), b.select(condition, zero, guard)
        self._choices[sides] = (guard, condition)
        return sides

    def sum(self, parts: Sequence[_Part]) -> _Part:
        """One part of several: of equal guards, of the sides of one choice, of any others, in this order."""
        left: list[_Part] = []
        for part in parts:
            self._join(left, part)
        total, *others = left
        for other in others:
            if total.guard is None or other.guard is None:
                guard = None
            else:
                guard = self.b.select(total.guard, self.b.number(1.0), other.guard)
            total = _Part(guard, self.b.add(self.applied(total), self.applied(other)))
        return total

    def _join(self, parts: list[_Part], new: _Part) -> None:
        """Adds a part to the others, to one of them if both can be one without a zero."""
        for k, part in enumerate(parts):
            if part.guard is new.guard:
                del parts[k]
                self._join(parts, _Part(new.guard, self.b.add(part.value, new.value)))
                return
            for first, second in ((part, new), (new, part)):
                if first.guard is None or second.guard is None:
                    continue
                choice = self._choices.get((first.guard, second.guard))
                if choice is not None:
                    del parts[k]
                    self._join(parts, _Part(choice[0], self.b.select(choice[1], first.value, second.value)))
                    return
        parts.append(new)

    def applied(self, part: _Part) -> SSAValue:
        """The cotangent with its zeros."""
        if part.guard is None:
            return part.value
        return self.b.select(part.guard, part.value, self.b.zeros(shape_of(part.value)))


class PushForward:
    """Forward mode along one direction: tangents of values for the tangents of a few, made on demand.

    What is older than all values with a tangent has none, and is not looked at.
    """

    def __init__(self, b: MatBuilder, seeds: Mapping[SSAValue, SSAValue | None]) -> None:
        self.b = b
        self._tangents: dict[SSAValue, SSAValue | None] = dict(seeds)
        self._oldest = min((b.age(value) for value, tangent in seeds.items() if tangent is not None), default=0)

    def __getitem__(self, value: SSAValue) -> SSAValue | None:
        """Tangent of the value; None stands for zero."""
        stack = [value]
        while stack:
            current = stack[-1]
            op = current.owner
            if current in self._tangents or not isinstance(op, MatOp) or self.b.age(current) < self._oldest:
                self._tangents.setdefault(current, None)
                stack.pop()
                continue
            missing = [operand for operand in _differentiated(op) if operand not in self._tangents]
            if missing:
                stack.extend(missing)
                continue
            tangents = [self._tangents.get(operand) for operand in op.operands]
            some = any(tangent is not None for tangent in tangents)
            self._tangents[current] = op.pushforward(self.b, tangents) if some else None
            stack.pop()
        return self._tangents[value]


class _ForwardMode:
    """Forward mode along many directions, of the same outputs and seeds: each visits only what it changes.

    inverses: of norms, as `norms.inverse_for_tangents` makes them.
    """

    def __init__(
        self,
        b: MatBuilder,
        outputs: Sequence[SSAValue],
        seeded: Collection[SSAValue],
        chains: ScalarChains,
        inverses: Mapping[SSAValue, SSAValue],
    ) -> None:
        self.b = b
        self._chains = chains
        self._inverses = inverses
        self._values: list[SSAValue] = []
        """All between the seeds and the outputs whose tangents may be needed, operands first."""
        self._users: dict[SSAValue, list[int]] = {value: [] for value in seeded}
        """Positions in that list of those computed from a value."""
        stack = list(outputs)
        while stack:
            value = stack[-1]
            if value in self._users or not isinstance(value.owner, MatOp):
                self._users.setdefault(value, [])
                stack.pop()
                continue
            sources = self._sources(value)
            missing = [source for source in sources if source not in self._users]
            if missing:
                stack.extend(missing)
                continue
            for source in sources:
                self._users[source].append(len(self._values))
            self._users[value] = []
            self._values.append(value)
            stack.pop()

    def _sources(self, value: SSAValue) -> list[SSAValue]:
        """Values whose tangents make that of this one."""
        slopes = self._chains.slopes(value)
        if slopes is not None:
            return [u for u, _ in slopes]
        assert isinstance(value.owner, MatOp)
        return list(dict.fromkeys(_differentiated(value.owner)))

    def along(self, seeds: Mapping[SSAValue, SSAValue | None]) -> dict[SSAValue, SSAValue]:
        """Tangents that are not zero, of all values between."""
        tangents: dict[SSAValue, SSAValue] = {}
        waiting: list[int] = []
        listed: set[int] = set()

        def note(value: SSAValue, tangent: SSAValue | None) -> None:
            if tangent is None or is_zero(tangent):
                return
            tangents[value] = tangent
            for user in self._users.get(value, ()):
                if user not in listed:
                    listed.add(user)
                    heappush(waiting, user)

        for value, tangent in seeds.items():
            note(value, tangent)
        while waiting:
            value = self._values[heappop(waiting)]
            note(value, self._tangent(value, tangents))
        return tangents

    def _tangent(self, value: SSAValue, tangents: Mapping[SSAValue, SSAValue]) -> SSAValue | None:
        b, op, slopes = self.b, value.owner, self._chains.slopes(value)
        if slopes is not None:
            parts = [(slope, tangents.get(u)) for u, slope in slopes]
            return b.total([slope and tangent and b.scale(slope, tangent) for slope, tangent in parts])
        assert isinstance(op, MatOp)
        if value in self._inverses:
            (vector,) = op.operands
            return b.scale(self._inverses[value], b.dot(vector, tangents[vector]))
        return op.pushforward(b, [tangents.get(operand) for operand in op.operands])


def _differentiated(op: MatOp) -> list[SSAValue]:
    """Operands whose tangents the operation's rule asks for."""
    return [operand for k, operand in enumerate(op.operands) if k not in op.HELD_OPERANDS]


def directional(
    b: MatBuilder, outputs: Sequence[SSAValue], directions: Sequence[Mapping[SSAValue, SSAValue | None]]
) -> SSAValue:
    """Tangents of the outputs along each direction: all entries as one column, the columns side by side.

    Every direction seeds the same values; a seed of None holds a value constant.
    """
    pushes: dict[tuple[SSAValue, frozenset[SSAValue]], PushForward] = {}

    def partial(value: SSAValue, u: SSAValue, front: Collection[SSAValue]) -> SSAValue | None:
        key = (u, frozenset(front))
        if key not in pushes:
            pushes[key] = PushForward(b, {**dict.fromkeys(front), u: b.number(1.0)})
        return pushes[key][value]

    seeded = directions[0].keys()
    norms = smooth_norms(outputs, seeded)
    held = dict.fromkeys((*seeded, *(norm.result for norm in norms)))
    chains = ScalarChains(held.keys(), partial)
    inverses: dict[SSAValue, SSAValue] = {}
    if norms:
        wanted = (*outputs, *(norm.operands[0] for norm in norms))
        between = _ForwardMode(b, wanted, held.keys(), chains, inverses)
        for norm in norms:
            slopes = between.along({norm.result: b.number(1.0)})
            inverses[norm.result] = inverse_for_tangents(b, norm.result, [slopes.get(value) for value in wanted])
    forward = _ForwardMode(b, outputs, seeded, chains, inverses)
    columns = []
    for seeds in directions:
        tangents = forward.along(seeds)
        columns.append(
            b.concat_rows([b.flat(tangents[v]) if v in tangents else b.zeros((size_of(v), 1)) for v in outputs])
        )
    return b.concat_cols(columns)


def jacobian(b: MatBuilder, outputs: Sequence[SSAValue], inputs: Sequence[SSAValue]) -> SSAValue:
    """Jacobian of the outputs' entries (rows) with respect to the inputs' entries (columns), column by column.

    Inputs count as independent of each other, also where one is computed from another (the values of a cut may be).
    """
    held: dict[SSAValue, SSAValue | None] = dict.fromkeys(inputs)
    return directional(
        b,
        outputs,
        [{**held, value: b.unit(shape_of(value), position)} for value in inputs for position in range(size_of(value))],
    )


def stacked(b: MatBuilder, values: Sequence[SSAValue], parts: Mapping[SSAValue, SSAValue]) -> SSAValue:
    """One column of all entries of the parts of these values; a missing part is zero."""
    return b.concat_rows([b.flat(parts[v]) if v in parts else b.zeros((size_of(v), 1)) for v in values])
