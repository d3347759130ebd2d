"""Hash-consed scalar expressions: what `lower-to-scalar` builds before it writes `arith` and `math` ops.

A node is an integer. Equal expressions are one node (global value numbering), and the constructors simplify:
zeros, ones, negations and constants are folded as they are made, so structural zeros of Jacobians cost nothing.
What would fold to NaN or infinity is left to run time. Coefficients, which are constants or the same for all instances,
are gathered in front of products, so that they are multiplied with each other once and not for every instance.
Building a node here costs about a microsecond, an xDSL operation ten to twenty.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Collection, Sequence

from yasps.dialects.scalar.functions import FUNCTIONS

Node = int

UNARY_FUNCTIONS: dict[str, Callable[[float], float]] = {
    **{function.name: function.of_float for function in FUNCTIONS},
    "abs": abs,
}
BINARY_FUNCTIONS: dict[str, Callable[[float, float], float]] = {"min": min, "max": max, "atan2": math.atan2}
"""On numbers that are no NaN; min and max of NaN and anything are NaN."""
COMPARISONS: dict[str, Callable[[float, float], bool]] = {"lt": operator.lt, "le": operator.le, "ne": operator.ne}
"""All are false on NaN, "ne" too."""


class ScalarGraph:
    """An arena of scalar nodes. `kinds[n]` names the operation of node n, `arguments[n]` its operand nodes."""

    def __init__(self) -> None:
        self.kinds: list[str] = []
        self.arguments: list[tuple[Node, ...]] = []
        self.values: list[float] = []
        """Value of a constant node or power's exponent; position of an input node; 0 for all others."""
        self._known: dict[tuple[object, ...], Node] = {}
        self._truths: set[Node] = set()
        """Nodes that are 0 or 1 by a choice; as conditions they need no comparison with 0."""
        self._uniform: set[Node] = set()
        self.zero = self.constant(0.0)
        self.one = self.constant(1.0)

    def __len__(self) -> int:
        return len(self.kinds)

    def _node(self, kind: str, arguments: tuple[Node, ...] = (), value: float = 0.0) -> Node:
        key = (kind, arguments, value)
        found = self._known.get(key)
        if found is None:
            found = len(self.kinds)
            self._known[key] = found
            self.kinds.append(kind)
            self.arguments.append(arguments)
            self.values.append(value)
            if (
                kind not in COMPARISONS
                and any(argument in self._uniform for argument in arguments)
                and all(self.is_coefficient(argument) for argument in arguments)
            ):
                self._uniform.add(found)
        return found

    # -- leaves --------------------------------------------------------------------------------------------

    def constant(self, value: float) -> Node:
        return self._node("constant", (), float(value) + 0.0)  # + 0.0 turns -0.0 into 0.0

    def input(self, position: int, *, uniform: bool = False) -> Node:
        """An input; a `uniform` one is the same for all instances, as is what is computed from such alone."""
        node = self._node("input", (), float(position))
        if uniform:
            self._uniform.add(node)
        return node

    def is_constant(self, a: Node) -> bool:
        return self.kinds[a] == "constant"

    def is_uniform(self, a: Node) -> bool:
        """Is it computed from uniform inputs? Then it is computed once for all instances, and costs nothing.

        Truth values, which are no numbers, are not.
        """
        return a in self._uniform

    def is_coefficient(self, a: Node) -> bool:
        """Is it a constant, or uniform? Products have their coefficients in front, gathered to one."""
        return a in self._uniform or self.kinds[a] == "constant"

    def remade(self, node: Node, arguments: Sequence[Node]) -> Node:
        """The operation of this node on other arguments, as it is."""
        return self._node(self.kinds[node], tuple(arguments), self.values[node])

    # -- arithmetic ----------------------------------------------------------------------------------------

    def add(self, a: Node, b: Node) -> Node:
        if a == self.zero:
            return b
        if b == self.zero:
            return a
        kind_a, kind_b = self.kinds[a], self.kinds[b]
        if kind_a == "constant" and kind_b == "constant":
            value = self.values[a] + self.values[b]
            if math.isfinite(value):
                return self.constant(value)
        if kind_b == "neg":
            return self.sub(a, self.arguments[b][0])
        if kind_a == "neg":
            return self.sub(b, self.arguments[a][0])
        if a == b and kind_a != "constant":  # as a product, so that constant factors meet
            return self.mul(self.constant(2.0), a)
        return self._node("add", (a, b) if a < b else (b, a))

    def sub(self, a: Node, b: Node) -> Node:
        if b == self.zero:
            return a
        if a == b:
            return self.zero
        if a == self.zero:
            return self.neg(b)
        if a == self.one and b in self._truths:
            return self.select(b, self.zero, self.one)
        if self.kinds[a] == "constant" and self.kinds[b] == "constant":
            value = self.values[a] - self.values[b]
            if math.isfinite(value):
                return self.constant(value)
        if self.kinds[b] == "neg":
            return self.add(a, self.arguments[b][0])
        if self.kinds[a] == "neg":
            return self.neg(self.add(self.arguments[a][0], b))
        if b < a:  # one node for a - b and b - a, so that both signs share it
            return self.neg(self._node("sub", (b, a)))
        return self._node("sub", (a, b))

    def neg(self, a: Node) -> Node:
        if self.kinds[a] == "constant":
            return self.constant(-self.values[a])
        if self.kinds[a] == "neg":
            return self.arguments[a][0]
        return self._node("neg", (a,))

    def mul(self, a: Node, b: Node) -> Node:
        if self.zero in (a, b):
            return self.zero
        if a == self.one:
            return b
        if b == self.one:
            return a
        if a in self._truths and b in self._truths:
            return self.select(a, b, self.zero)
        kind_a, kind_b = self.kinds[a], self.kinds[b]
        if kind_a == "constant" and kind_b == "constant":
            value = self.values[a] * self.values[b]
            if math.isfinite(value):
                return self.constant(value)
        if kind_a == "neg":
            return self.neg(self.mul(self.arguments[a][0], b))
        if kind_b == "neg":
            return self.neg(self.mul(a, self.arguments[b][0]))
        if kind_b == "constant" or (kind_a != "constant" and self.is_uniform(b) and not self.is_uniform(a)):
            a, b, kind_a = b, a, kind_b
            kind_b = self.kinds[b]
        if kind_a == "constant" and self.values[a] < 0.0:
            return self.neg(self.mul(self.constant(-self.values[a]), b))
        if kind_b == "mul":
            first, second = self.arguments[b]
            if kind_a == "constant" and self.is_constant(first):
                value = self.values[a] * self.values[first]
                if math.isfinite(value):
                    return self.mul(self.constant(value), second)
            elif self.is_coefficient(a) and self.is_coefficient(first) and not self.is_uniform(b):
                return self.mul(self.mul(a, first), second)
        if kind_a == "constant" or (self.is_uniform(a) and not self.is_uniform(b)):
            return self._node("mul", (a, b))
        return self._node("mul", (a, b) if a < b else (b, a))

    def div(self, a: Node, b: Node) -> Node:
        if a == self.zero:
            return self.zero
        if b == self.one:
            return a
        if self.kinds[b] == "constant" and self.values[b] != 0.0:
            if self.kinds[a] == "constant":
                value = self.values[a] / self.values[b]
                if math.isfinite(value):
                    return self.constant(value)
            elif math.frexp(self.values[b])[0] in (0.5, -0.5) and math.isfinite(1.0 / self.values[b]):
                # a power of two: exact as a product
                return self.mul(self.constant(1.0 / self.values[b]), a)
        if self.kinds[a] == "neg":
            return self.neg(self.div(self.arguments[a][0], b))
        if self.kinds[b] == "neg":
            return self.neg(self.div(a, self.arguments[b][0]))
        if self.is_uniform(b) and not self.is_coefficient(a):
            return self.mul(self.div(self.one, b), a)
        return self._node("div", (a, b))

    def power(self, a: Node, exponent: float) -> Node:
        """`a ** exponent` for a constant exponent; small integers by multiplication."""
        if exponent == 0.0:
            return self.one
        if exponent == 1.0:
            return a
        if exponent == 0.5:
            return self.unary("sqrt", a)
        if exponent == int(exponent) and abs(exponent) <= 64:
            if exponent < 0:
                return self.div(self.one, self.power(a, -exponent))
            half = self.power(a, exponent // 2)
            square = self.mul(half, half)
            return self.mul(square, a) if exponent % 2 else square
        return self._node("power", (a,), exponent)

    def unary(self, kind: str, a: Node) -> Node:
        """One of `UNARY_FUNCTIONS`."""
        if kind == "abs" and self.kinds[a] in ("neg", "abs"):
            return self.unary("abs", self.arguments[a][0])
        if self.kinds[a] == "constant":
            try:
                return self.constant(UNARY_FUNCTIONS[kind](self.values[a]))
            except (ValueError, OverflowError):
                pass  # outside its domain: left to run time, where it gives NaN or infinity and is reported
        return self._node(kind, (a,))

    def binary(self, kind: str, a: Node, b: Node) -> Node:
        """One of `BINARY_FUNCTIONS`."""
        if self.is_constant(a) and self.is_constant(b):
            return self.constant(BINARY_FUNCTIONS[kind](self.values[a], self.values[b]))
        if kind == "atan2":
            return self._node(kind, (a, b))
        if a in self._truths and b in self._truths:
            return self.select(a, b, self.zero) if kind == "min" else self.select(a, self.one, b)
        return a if a == b else self._node(kind, (a, b) if a < b else (b, a))

    # -- choices -------------------------------------------------------------------------------------------
    # Truth values (`COMPARISONS`) are nodes of their own kind that stand only as a select's first argument.

    def compare(self, kind: str, a: Node, b: Node) -> Node:
        """1 or 0 for one of `COMPARISONS`."""
        if self.is_constant(a) and self.is_constant(b):
            return self.one if COMPARISONS[kind](self.values[a], self.values[b]) else self.zero
        if a == b and kind != "le":
            return self.zero
        if self._is_negative(a) and self._is_negative(b):  # one comparison for a < b and -b < -a
            a, b = self.neg(b), self.neg(a)
        return self._choice(self._node(kind, (a, b)), self.one, self.zero)

    def _is_negative(self, a: Node) -> bool:
        return self.kinds[a] == "neg" or (self.is_constant(a) and self.values[a] <= 0.0)

    def select(self, condition: Node, a: Node, b: Node) -> Node:
        """a where the condition is a number other than 0, else b."""
        if a == b:
            return a
        if self.is_constant(condition):
            return a if self.values[condition] != 0.0 else b
        if self.kinds[condition] == "neg":
            return self.select(self.arguments[condition][0], a, b)
        if self.kinds[condition] == "select":
            truth, first, second = self.arguments[condition]
            if self.is_constant(first) or self.is_constant(second) or condition in self._truths:
                return self._choice(truth, self.select(first, a, b), self.select(second, a, b))
        return self._choice(self._node("ne", (condition, self.zero)), a, b)

    def _choice(self, truth: Node, a: Node, b: Node) -> Node:
        if self.kinds[a] == "select" and self.arguments[a][0] == truth:
            a = self.arguments[a][1]
        if self.kinds[b] == "select" and self.arguments[b][0] == truth:
            b = self.arguments[b][2]
        if a == b:
            return a
        negative = [self.kinds[x] == "neg" for x in (a, b)]
        if all(negative) or (any(negative) and self.zero in (a, b)):
            return self.neg(self._choice(truth, self.neg(a), self.neg(b)))
        chosen = self._node("select", (truth, a, b))
        if all(x in (self.zero, self.one) or x in self._truths for x in (a, b)):
            self._truths.add(chosen)
        return chosen

    # -- sums ----------------------------------------------------------------------------------------------

    def sum(self, terms: Sequence[Node]) -> Node:
        total = self.zero
        for term in terms:
            total = self.add(total, term)
        return total

    def dot(self, left: Sequence[Node], right: Sequence[Node]) -> Node:
        return self.sum([self.mul(a, b) for a, b in zip(left, right, strict=True)])

    def products(self, rows: Sequence[Sequence[Node]], columns: Sequence[Sequence[Node]]) -> list[list[Node]]:
        """Dot products of each row with each column, a list for each row; zeros are not visited one by one."""
        of_columns = [self._nonzero(column) for column in columns]
        result: list[list[Node]] = []
        for row in rows:
            of_row = self._nonzero(row)
            result.append([])
            for column, of_column in zip(columns, of_columns, strict=True):
                if len(of_row) <= len(of_column):
                    terms = [self.mul(a, column[k]) for k, a in of_row if column[k] != self.zero]
                else:
                    terms = [self.mul(row[k], b) for k, b in of_column if row[k] != self.zero]
                result[-1].append(self.sum(terms))
        return result

    def _nonzero(self, entries: Sequence[Node]) -> list[tuple[int, Node]]:
        return [(k, node) for k, node in enumerate(entries) if node != self.zero]

    def linear_terms(self, a: Node) -> dict[Node, float]:
        """The node as a sum of multiples of nodes that are no sums themselves; a number is a multiple of one."""
        terms: dict[Node, float] = {}
        stack = [(a, 1.0)]
        while stack:
            node, factor = stack.pop()
            kind, arguments = self.kinds[node], self.arguments[node]
            if kind == "add":
                stack += [(arguments[0], factor), (arguments[1], factor)]
            elif kind == "sub":
                stack += [(arguments[0], factor), (arguments[1], -factor)]
            elif kind == "neg":
                stack.append((arguments[0], -factor))
            elif kind == "mul" and self.is_constant(arguments[0]):
                stack.append((arguments[1], factor * self.values[arguments[0]]))
            elif kind == "constant":
                terms[self.one] = terms.get(self.one, 0.0) + factor * self.values[node]
            else:
                terms[node] = terms.get(node, 0.0) + factor
        return terms

    def reachable(self, outputs: Sequence[Node], given: Collection[Node] = ()) -> list[Node]:
        """Nodes needed for the outputs, operands before users; of `given` ones not what they are computed from."""
        needed = set()
        stack = list(outputs)
        while stack:
            node = stack.pop()
            if node not in needed:
                needed.add(node)
                if node not in given:
                    stack.extend(self.arguments[node])
        return sorted(needed)  # a node is made after its operands

    def uniform_values(self, outputs: Sequence[Node]) -> list[Node]:
        """Uniform nodes that are outputs, or that others which are not uniform are computed from."""
        found = {node for node in outputs if self.is_uniform(node)}
        for node in self.reachable(outputs):
            if not self.is_uniform(node):
                found.update(argument for argument in self.arguments[node] if self.is_uniform(argument))
        return sorted(found)
