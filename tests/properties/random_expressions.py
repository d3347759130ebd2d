"""Random expressions: programs of Python lines that build an attribute, and what they mean on numbers of any kind.

Floats are drawn away from kinks, by a complex step's accuracy. Rationals may lie on them: comparisons of rationals are
exact, and the derivatives there are those that the language promises.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from expression_words import (
    COMPARISONS,
    FITTING,
    ONE_SHAPE,
    OPERATIONS,
    SQUARE,
    WORDS,
    Numbers,
    Shape,
    apart,
)
from hypothesis import strategies as st
from matrix_meaning import Matrix, determinant
from numpy.typing import NDArray

from yasps import Scene

SHAPES: tuple[Shape, ...] = ((1, 1), (2, 1), (3, 1), (1, 3), (2, 2), (3, 3), (2, 3), (1, 4), (4, 4))
MOST_UNKNOWNS = 18
INSTANCES = 2
"""Two points; a denominator that is the same number at both might be folded, with rounding, and is not drawn."""
LARGEST = {True: 1e9, False: 30.0}
MOST_BITS = 160


# -- programs ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Step:
    """One line."""

    word: str
    operands: tuple[int, ...]
    numbers: Numbers = ()
    entries: tuple[tuple[float, ...], ...] = ()
    """Of a constant."""

    def evaluate(self, values: Sequence[Matrix], number: Callable[[float], Any]) -> Matrix:
        """Its value for the values of all lines before."""
        if self.word == "constant":
            found = np.empty((len(self.entries), len(self.entries[0])), type(number(0.0)))
            for i, j in np.ndindex(found.shape):
                found[i, j] = number(self.entries[i][j])
            return found
        return OPERATIONS[self.word].meaning(*(values[k] for k in self.operands), *self.numbers)

    def is_smooth(self, values: Sequence[Matrix]) -> bool:
        """Has it derivatives at these values?"""
        return self.word == "constant" or OPERATIONS[self.word].is_smooth(*(values[k] for k in self.operands))


@dataclass(frozen=True)
class Expression:
    """Inputs t0, t1, ... and a line for each further value; the last is 1x1."""

    inputs: tuple[Shape, ...]
    steps: tuple[Step, ...]
    seed: int

    @property
    def lines(self) -> list[str]:
        """The program."""
        made = [f't{k} = points.add_attribute("t{k}", {r}, {c})' for k, (r, c) in enumerate(self.inputs)]
        for k, step in enumerate(self.steps, len(self.inputs)):
            operands = [f"t{j}" for j in step.operands]
            if step.word == "constant":
                text = f"constant({[list(row) for row in step.entries]})"
            else:
                text = OPERATIONS[step.word].written(operands, step.numbers)
            made.append(f"t{k} = {text}")
        return made

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """What hypothesis prints when the test fails."""
        del cycle
        printer.text("\n" + "\n".join([*self.lines, f"# at the point of seed {self.seed}"]))

    def scene(self) -> Scene:
        """A scene of one primitive whose energy is the last value; it may be no more than an input."""
        scene = Scene("s")
        points = scene.add_mesh("m").add_primitive("points", INSTANCES)
        names: dict[str, Any] = {"points": points, **WORDS}
        exec("\n".join(self.lines), names)
        last = names[f"t{len(self.inputs) + len(self.steps) - 1}"]
        scene.add_energy(points.add_attribute("energy", computed_attribute=last), projection="none")
        scene.add_minimize_target([names[f"t{k}"] for k in range(len(self.inputs))])
        return scene

    def point(self) -> list[NDArray[np.float64]]:
        """Each input on all instances: quarters, and regular square matrices."""
        random = np.random.default_rng(self.seed)
        made = []
        for rows, cols in self.inputs:
            entries = random.integers(-6, 7, (INSTANCES, rows, cols)) / 4
            made.append(entries + (2.25 * np.eye(rows) if rows == cols else 0.125))
        return made

    def evaluate(self, inputs: Sequence[Matrix], number: Callable[[float], Any]) -> list[Matrix]:
        """All values for matrices of inputs."""
        values = list(inputs)
        for step in self.steps:
            values.append(step.evaluate(values, number))
        return values


def _bits(entry: Any) -> int:
    return entry.numerator.bit_length() + entry.denominator.bit_length() if isinstance(entry, Fraction) else 0


class _Drawing:
    """An expression in the making, and its values at its points: rationals or floats."""

    def __init__(self, draw: st.DrawFn, rational: bool, first: str) -> None:
        self.draw = draw
        self.rational = rational
        shapes: list[Shape] = []
        words = [word for word in drawn_words(rational) if word not in COMPARISONS[1:]]
        k = words.index(COMPARISONS[0] if first in COMPARISONS else first)
        self.words = [*words[k:], "constant", *words[:k]]  # equal draws become other programs for another first word
        self.first = first
        fitting = FITTING.get(self.first, ())
        for shape in [*fitting, *draw(st.lists(st.sampled_from(SHAPES), min_size=not fitting, max_size=3))]:
            if sum(r * c for r, c in [*shapes, shape]) <= MOST_UNKNOWNS:
                shapes.append(shape)
        self.expression = Expression(tuple(shapes), (), draw(st.integers(0, 999)))
        number: Callable[[float], Any] = Fraction if rational else float
        self.number = number
        self.values: list[list[Matrix]] = []
        for instance in range(INSTANCES):
            point: list[Matrix] = []
            for entries in self.expression.point():
                matrix = np.empty(entries.shape[1:], object if rational else float)
                matrix.ravel()[:] = [number(e) for e in entries[instance].ravel()]
                point.append(matrix)
            self.values.append(point)
        self.steps: list[Step] = []
        self.used: set[int] = set()
        self.truths: set[int] = set()
        """Values whose entries are 0 or not for sure."""

    @property
    def count(self) -> int:
        return len(self.values[0])

    def shape(self, k: int) -> Shape:
        rows, cols = self.values[0][k].shape
        return rows, cols

    def pick(self, allowed: Callable[[Shape], bool] = lambda shape: True) -> int | None:
        """One of the values whose shape is allowed, of the newest most likely when shrunk."""
        return self.one_of([k for k in reversed(range(self.count)) if allowed(self.shape(k))])

    def one_of(self, candidates: Sequence[int]) -> int | None:
        return self.draw(st.sampled_from(candidates)) if candidates else None

    def partner(self, k: int) -> int | None:
        """A value of the same shape; itself last, with which it ties."""
        equal = [j for j in reversed(range(self.count)) if self.shape(j) == self.shape(k)]
        return self.one_of(sorted(equal, key=lambda j: j == k))

    def condition(self, shape: Shape) -> int | None:
        """For a choice of this shape: truth values most likely; else a number that rounding can't make 0 or not 0."""
        fitting = [k for k in reversed(range(self.count)) if self.shape(k) in ((1, 1), shape)]
        truths = [k for k in fitting if k in self.truths]
        others = [k for k in fitting if self.rational or all(apart(values[k], 0.0) for values in self.values)]
        return self.one_of([*truths * 3, *others])

    def append(self, step: Step, tame: bool = True) -> bool:
        """Adds the line if its values are tame at both points, or need not be."""
        made = []
        for values in self.values:
            try:
                if not self.rational and not step.is_smooth(values):
                    return False
                result = step.evaluate(values, self.number)
            except ZeroDivisionError:
                return False
            entries = list(result.ravel())
            if tame and not all(abs(e) <= LARGEST[self.rational] and _bits(e) <= MOST_BITS for e in entries):
                return False
            made.append(result)
        for values, result in zip(self.values, made, strict=True):
            values.append(result)
        self.steps.append(step)
        self.used.update(step.operands)
        if step.word in (*COMPARISONS, "constant"):
            self.truths.add(self.count - 1)
        return True

    def is_denominator(self, k: int, whole: Callable[[Matrix], Any]) -> bool:
        """Far from zero and not a constant."""
        numbers = [whole(values[k]) for values in self.values]
        return bool(numbers[0] != numbers[1] and min(abs(n) for n in numbers) > 0.3)

    def step(self) -> None:
        """One random line, or none if the drawn operation does not fit what there is."""
        word = self.first
        if self.steps:
            word = self.draw(st.sampled_from(self.words))
            if word == COMPARISONS[0]:  # which one is drawn now, lest there be four times as many as of others
                word = self.draw(st.sampled_from(COMPARISONS))
        if word == "constant":
            rows, cols = self.draw(st.sampled_from(SHAPES[:-1]))
            entry = st.sampled_from((1.0, 2.0, -1.0, 0.5, 0.0))
            row = st.lists(entry, min_size=cols, max_size=cols).map(tuple)
            self.append(Step(word, (), (), tuple(self.draw(st.lists(row, min_size=rows, max_size=rows)))))
            return
        made = self.operands(word)
        if made is not None:
            self.append(Step(word, *made))

    def operands(self, word: str) -> tuple[tuple[int, ...], Numbers] | None:
        """Operands and numbers that fit the operation."""

        def integers(low: int, high: int) -> int:
            return self.draw(st.integers(low, high))

        if word in ("scale", "divide"):
            number, matrix = self.pick(lambda s: s == (1, 1)), self.pick()
            if number is None or matrix is None:
                return None
            if word == "scale":
                return (number, matrix), ()
            return ((matrix, number), ()) if self.is_denominator(number, lambda m: m[0, 0]) else None
        if word in SQUARE:
            first = self.pick(lambda s: s[0] == s[1] and s[0] in SQUARE[word])
            if first is None or (word == "inverse" and not self.is_denominator(first, determinant)):
                return None
            return (first,), ()
        allowed = {"cross": lambda s: sorted(s) == [1, 3], "shielded": lambda s: s == (1, 1)}
        first = self.pick(allowed.get(word, lambda s: True))
        if first is None:
            return None
        rows, cols = self.shape(first)
        if word in ("select", "choose"):
            other = self.pick(lambda s: s == (rows, cols))
            condition = (
                self.condition((rows, cols)) if word == "select" else self.pick(lambda s: s in ((1, 1), (rows, cols)))
            )
            assert other is not None
            if condition is None:
                return None
            if word == "select":
                return (condition, first, other), ()
            bound = self.partner(condition)
            assert bound is not None
            return (condition, bound, first, other), ()
        if word in (*ONE_SHAPE, "cross"):
            second = self.partner(first)
        elif word == "matmul":
            second = self.pick(lambda s: s[0] == cols and rows * s[1] <= 16)
        elif word == "concat_rows":
            second = self.pick(lambda s: s[1] == cols and (rows + s[0]) * cols <= 16)
        elif word == "concat_cols":
            second = self.pick(lambda s: s[0] == rows and (cols + s[1]) * rows <= 16)
        elif word == "reshape":
            heights = [r for r in range(1, rows * cols + 1) if rows * cols % r == 0]
            height = self.draw(st.sampled_from(heights))
            return (first,), (height, rows * cols // height)
        elif word == "block":
            row, col = integers(0, rows - 1), integers(0, cols - 1)
            return (first,), (row, col, integers(1, rows - row), integers(1, cols - col))
        elif word == "embed":
            row, col = integers(0, 4 - min(rows, 4)), integers(0, 4 - min(cols, 4))
            return (first,), (row, col, max(rows + row, 2), max(cols + col, 2))
        elif word == "pow":
            exponent = integers(-2, 4)
            safe = exponent >= 2 or all(
                self.is_denominator(first, lambda m, i=i, j=j: m[i, j])  # type: ignore[misc]
                for i, j in np.ndindex(rows, cols)
            )
            return ((first,), (exponent,)) if safe else None
        elif (word == "gram" and cols * cols > 16) or (
            word == "norm" and not self.is_denominator(first, lambda m: (m * m).sum())
        ):
            return None
        else:
            return (first,), ()
        return None if second is None else ((first, second), ())

    def finished(self) -> Expression:
        """The sum of all that nothing else uses, made to numbers."""
        ends = [k for k in range(self.count) if k not in self.used]
        total: int | None = None
        for end in ends:
            word = "sum" if self.shape(end) == (1, 1) else self.draw(st.sampled_from(("dot", "sum")))
            if not self.append(Step(word, (end, end) if word == "dot" else (end,))):
                self.append(Step("sum", (end,)), tame=False)
            last = self.count - 1
            if total is not None:
                self.append(Step("add", (total, last)), tame=False)
            total = self.count - 1
        return Expression(self.expression.inputs, tuple(self.steps), self.expression.seed)


def drawn_words(rational: bool) -> list[str]:
    """Operations of rational programs, or of smooth ones."""
    if rational:
        return [word for word, operation in OPERATIONS.items() if operation.rational]
    return [word for word in OPERATIONS if word != "stop_gradient"]  # complex steps see through it


def expressions(rational: bool, first: str) -> st.SearchStrategy[Expression]:
    """Programs of up to 8 operations that begin with this one; rational ones can be computed without rounding."""

    @st.composite
    def strategy(draw: st.DrawFn) -> Expression:
        drawing = _Drawing(draw, rational, first)
        for _ in range(draw(st.integers(1, 8))):
            drawing.step()
        return drawing.finished()

    return strategy()
