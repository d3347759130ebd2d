"""Random expressions: programs of Python lines that build an attribute, and what they mean on numbers of any kind.

Meanings are those of `matrix_meaning`, not the compiler's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from hypothesis import strategies as st
from matrix_meaning import Matrix, cofactors, cross, determinant, embedded, frozen, one, product, total
from numpy.typing import NDArray
from xdsl.dialects.builtin import DenseArrayBase, FloatAttr, f64, i64

from yasps import Attribute, Scene, concat_cols, concat_rows
from yasps.dialects.mat import algebra, calculus, elementwise, structure
from yasps.frontend.attribute import combine, constant

Shape = tuple[int, int]
Numbers = tuple[int, ...]

SHAPES: tuple[Shape, ...] = ((1, 1), (2, 1), (3, 1), (1, 3), (2, 2), (3, 3), (2, 3), (1, 4), (4, 4))
MOST_UNKNOWNS = 18
INSTANCES = 2
"""Two points; a denominator that is the same number at both might be folded, with rounding, and is not drawn."""
LARGEST = {True: 1e9, False: 30.0}
MOST_BITS = 160


# -- names for the lines -----------------------------------------------------------------------------------


def embed(a: Attribute, row: int, col: int, rows: int, cols: int) -> Attribute:
    """The attribute inside a matrix of zeros; no user's word, but what differentiation makes of `block`."""
    place = DenseArrayBase.from_list(i64, [row, col, rows, cols])
    return combine(structure.EmbedOp, [a], {"place": place})


def cofactor(a: Attribute) -> Attribute:
    """Matrix of cofactors; what differentiation makes of `det`."""
    return combine(algebra.CofactorOp, [a])


def power(a: Attribute, exponent: float) -> Attribute:
    """Entry by entry."""
    return combine(elementwise.PowOp, [a], {"exponent": FloatAttr(float(exponent), f64)})


def positive(a: Attribute) -> Attribute:
    """1.5 + a^2, entry by entry."""
    return a.hadamard(a) + constant(np.full(a.shape, 1.5))


WORDS: dict[str, Any] = {
    "Scene": Scene,
    "concat_rows": concat_rows,
    "concat_cols": concat_cols,
    "constant": constant,
    "embed": embed,
    "cofactor": cofactor,
    "power": power,
    "positive": positive,
}


@dataclass(frozen=True)
class Operation:
    """How it is written (operands {0}, {1}; numbers {n}) and what it means."""

    text: str
    meaning: Callable[..., Matrix]
    ir: str
    """Name of the `mat` operation it becomes."""
    rational: bool = True

    def written(self, operands: Sequence[str], numbers: Numbers) -> str:
        return self.text.format(*operands, n=", ".join(map(str, numbers)))


OPERATIONS: dict[str, Operation] = {
    "add": Operation("{0} + {1}", lambda a, b: a + b, "add"),
    "sub": Operation("{0} - {1}", lambda a, b: a - b, "sub"),
    "neg": Operation("-{0}", lambda a: -a, "neg"),
    "hadamard": Operation("{0}.hadamard({1})", lambda a, b: a * b, "hadamard"),
    "scale": Operation("{0} * {1}", lambda s, m: m * s[0, 0], "scale"),
    "divide": Operation("{0} / {1}", lambda m, s: m / s[0, 0], "divide"),
    "matmul": Operation("{0} @ {1}", product, "matmul"),
    "gram": Operation("{0}.T @ {0}", lambda a: product(a.T, a), "matmul"),
    "transpose": Operation("{0}.T", lambda a: a.T, "transpose"),
    "dot": Operation("{0}.dot({1})", lambda a, b: one(total(list((a * b).ravel()))), "dot"),
    "cross": Operation("{0}.cross({1})", cross, "cross"),
    "trace": Operation("{0}.trace()", lambda a: one(total([a[k, k] for k in range(len(a))])), "trace"),
    "sum": Operation("{0}.sum()", lambda a: one(total(list(a.ravel()))), "sum"),
    "det": Operation("{0}.det()", lambda a: one(determinant(a)), "det"),
    "cofactor": Operation("cofactor({0})", cofactors, "cofactor"),
    "inverse": Operation("{0}.inverse()", lambda a: cofactors(a).T / determinant(a), "inverse"),
    "reshape": Operation("{0}.reshape({n})", lambda a, r, c: a.reshape(r, c), "reshape"),
    "block": Operation("{0}.block({n})", lambda a, i, j, r, c: a[i : i + r, j : j + c], "block"),
    "embed": Operation("embed({0}, {n})", embedded, "embed"),
    "concat_rows": Operation("concat_rows([{0}, {1}])", lambda a, b: np.concatenate([a, b], 0), "concat_rows"),
    "concat_cols": Operation("concat_cols([{0}, {1}])", lambda a, b: np.concatenate([a, b], 1), "concat_cols"),
    "pow": Operation("power({0}, {n})", lambda a, p: a**p, "pow"),
    "stop_gradient": Operation("{0}.stop_gradient()", frozen, "stop_gradient"),
    "sqrt": Operation("positive({0}).sqrt()", lambda a: (1.5 + a * a) ** 0.5, "sqrt", False),
    "log": Operation("positive({0}).log()", lambda a: np.log(1.5 + a * a), "log", False),
    "exp": Operation("(0.5 * {0}).exp()", lambda a: np.exp(0.5 * a), "exp", False),
    "sin": Operation("{0}.sin()", np.sin, "sin", False),
    "cos": Operation("{0}.cos()", np.cos, "cos", False),
    "norm": Operation("{0}.norm()", lambda a: one(np.sqrt((a * a).sum())), "norm", False),
    "root": Operation("power(positive({0}), -1.5)", lambda a: (1.5 + a * a) ** -1.5, "pow", False),
}
FITTING: dict[str, tuple[Shape, ...]] = {
    "cross": ((3, 1), (3, 1)),
    "divide": ((1, 1), (2, 1)),
    "matmul": ((2, 3), (3, 1)),
    **dict.fromkeys(("det", "cofactor", "inverse"), ((3, 3),)),
}
"""Inputs that an expression which begins with this operation surely has."""
_ONE_SHAPE = ("add", "sub", "hadamard", "dot")
_SQUARE = ("trace", "det", "cofactor", "inverse")


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

    def __init__(self, draw: st.DrawFn, rational: bool) -> None:
        self.draw = draw
        self.rational = rational
        shapes: list[Shape] = []
        self.words = [word for word, operation in OPERATIONS.items() if operation.rational or not rational]
        if not rational:
            self.words.remove("stop_gradient")  # complex steps see through it
        self.first = draw(st.sampled_from(self.words))
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

    @property
    def count(self) -> int:
        return len(self.values[0])

    def shape(self, k: int) -> Shape:
        rows, cols = self.values[0][k].shape
        return rows, cols

    def pick(self, allowed: Callable[[Shape], bool] = lambda shape: True) -> int | None:
        """One of the values whose shape is allowed, of the newest most likely when shrunk."""
        candidates = [k for k in reversed(range(self.count)) if allowed(self.shape(k))]
        return self.draw(st.sampled_from(candidates)) if candidates else None

    def append(self, step: Step, tame: bool = True) -> bool:
        """Adds the line if its values are tame at both points, or need not be."""
        made = []
        for values in self.values:
            try:
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
        return True

    def is_denominator(self, k: int, whole: Callable[[Matrix], Any]) -> bool:
        """Far from zero and not a constant."""
        numbers = [whole(values[k]) for values in self.values]
        return bool(numbers[0] != numbers[1] and min(abs(n) for n in numbers) > 0.3)

    def step(self) -> None:
        """One random line, or none if the drawn operation does not fit what there is."""
        word = self.draw(st.sampled_from(["constant", *self.words])) if self.steps else self.first
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
        if word in _SQUARE:
            first = self.pick(lambda s: s[0] == s[1])
            if first is None or (word == "inverse" and not self.is_denominator(first, determinant)):
                return None
            return (first,), ()
        first = self.pick((lambda s: sorted(s) == [1, 3]) if word == "cross" else lambda s: True)
        if first is None:
            return None
        rows, cols = self.shape(first)
        if word in (*_ONE_SHAPE, "cross"):
            second = self.pick(lambda s: s == (rows, cols))
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


def expressions(rational: bool) -> st.SearchStrategy[Expression]:
    """Programs of up to 8 operations; rational ones can be computed without rounding."""

    @st.composite
    def strategy(draw: st.DrawFn) -> Expression:
        drawing = _Drawing(draw, rational)
        for _ in range(draw(st.integers(1, 8))):
            drawing.step()
        return drawing.finished()

    return strategy()


IR_WORDS = {operation.ir for operation in OPERATIONS.values()} | {"constant"}
"""`mat` operations these programs reach; `identity` comes in with derivatives, `calculus` holds the compiler's own."""
ALL_WORDS = {op.word() for op in (*elementwise.OPS, *algebra.OPS, *structure.OPS, *calculus.OPS)}
