"""Fewer scalar operations for the same values, once it is known what all of a graph's outputs need.

`ScalarGraph` simplifies each node as it is made, without knowing who will use it. With all users known:

    a / d, b / d            r = 1 / d, a r, b r         one division
    -(a - b)                b - a                       where a - b itself is not needed; so too inside products
    a (c b), c a number     c (a b)                     where c b itself is not needed: a b may be there already
    a x + b x + y           (a + b) x + y               where a x and b x themselves are not needed
    u (v b), -(u b)         (u v) b, (-u) b             where u and v are the same for all instances: computed once

Values change by rounding alone.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from yasps.dialects.scalar.graph import Node, ScalarGraph

Term = tuple[int, Node]
"""A sign and a node."""


def tidied(graph: ScalarGraph, outputs: Sequence[Node]) -> tuple[ScalarGraph, list[Node]]:
    """A new graph and its nodes for the same outputs. Inputs keep their positions."""
    work = _Tidying(graph, outputs)
    return work.graph, work.outputs


class _Tidying:
    def __init__(self, old: ScalarGraph, outputs: Sequence[Node]) -> None:
        self.old = old
        self.graph = ScalarGraph()
        self.order = [node for node in old.reachable(outputs) if old.kinds[node] != "neg"]
        self.users: Counter[Node] = Counter()
        """How often a node or its negative is an operand or an output."""
        self.divisions: Counter[Node] = Counter()
        for node in self.order:
            self.users.update(self.signed(argument)[1] for argument in old.arguments[node])
            if old.kinds[node] == "div":
                self.divisions[self.signed(old.arguments[node][1])[1]] += 1
        self.users.update(self.signed(output)[1] for output in outputs)
        self._can_flip: dict[Node, bool] = {}
        self.flipped = self._choose_signs(outputs)
        self.inner = self._inner_sums()
        self.made: dict[Node, Node] = {}
        for node in self.order:
            if node not in self.inner:
                self.made[node] = self._make(node)
        self.outputs = [self.get(output) for output in outputs]

    def signed(self, node: Node) -> Term:
        """The node without its outer minus signs."""
        sign = 1
        while self.old.kinds[node] == "neg":
            sign, node = -sign, self.old.arguments[node][0]
        return sign, node

    # -- signs ---------------------------------------------------------------------------------------------

    def _choose_signs(self, outputs: Sequence[Node]) -> set[Node]:
        """Nodes whose negative is made in their place: nobody needs them themselves, and it costs nothing."""
        wanted: dict[Node, set[int]] = {}

        def want(node: Node, factor: int = 1) -> None:
            sign, inner = self.signed(node)
            wanted.setdefault(inner, set()).add(factor * sign)

        for output in outputs:
            want(output)
        flipped = set()
        for node in reversed(self.order):  # users before what they use
            kind, arguments = self.old.kinds[node], self.old.arguments[node]
            carrier = None
            if wanted[node] == {-1} and self.can_flip(node):
                flipped.add(node)
                carrier = self._carrier(node) if kind != "sub" else None
            for argument in arguments:
                want(argument, -1 if argument == carrier else 1)
        return flipped

    def can_flip(self, node: Node) -> bool:
        """Is the negative of the node as cheap as the node?"""
        if node not in self._can_flip:
            kind = self.old.kinds[node]
            self._can_flip[node] = not self.old.is_uniform(node) and (
                kind == "sub"
                or (
                    kind in ("add", "mul", "div")
                    and (self._carrier(node) is not None or self._number_factor(node) is not None)
                )
            )
        return self._can_flip[node]

    def _carrier(self, node: Node) -> Node | None:
        """The operand whose negative makes the node's."""
        if self._number_factor(node) is not None:
            return None
        for argument in self.old.arguments[node]:
            sign, inner = self.signed(argument)
            if sign > 0 and self.users[inner] == 1 and self.can_flip(inner):
                return argument
        return None

    def _number_factor(self, node: Node) -> Node | None:
        first = self.old.arguments[node][0]
        return first if self.old.kinds[node] in ("mul", "div") and self.old.is_coefficient(first) else None

    def get(self, node: Node) -> Node:
        """The new node with the value of this old one."""
        sign, inner = self.signed(node)
        if inner in self.flipped:
            sign = -sign
        return self.made[inner] if sign > 0 else self.raw("neg", self.made[inner])

    # -- sums ----------------------------------------------------------------------------------------------

    def _inner_sums(self) -> set[Node]:
        """Sums that are terms of just one other sum."""
        inner = set()
        for node in self.order:
            if self.old.kinds[node] in ("add", "sub"):
                for argument in self.old.arguments[node]:
                    _, term = self.signed(argument)
                    is_sum = self.old.kinds[term] in ("add", "sub") and not self.old.is_uniform(term)
                    if is_sum and self.users[term] == 1:
                        inner.add(term)
        return inner

    def _terms(self, node: Node, sign: int) -> list[Term]:
        """Signed new nodes that add up to sign times the old node."""
        first, second = self.old.arguments[node]
        terms: list[Term] = []
        for argument, own in ((first, sign), (second, -sign if self.old.kinds[node] == "sub" else sign)):
            inner_sign, inner = self.signed(argument)
            if inner in self.inner:
                terms += self._terms(inner, own * inner_sign)
            else:
                flip = -1 if inner in self.flipped else 1
                terms.append((own * inner_sign * flip, self.made[inner]))
        return terms

    def _factored(self, terms: list[Term], single: set[Node]) -> list[Term]:
        """The same sum with common factors of its single-use products taken out, the commonest first."""
        while True:
            counts = Counter(
                factor for _, node in terms if node in single for factor in set(self.graph.arguments[node])
            )
            common, count = max(counts.items(), key=lambda item: (item[1], -item[0]), default=(0, 0))
            if count < 2:
                return terms
            inside: list[Term] = []
            outside: list[Term] = []
            for sign, node in terms:
                arguments = self.graph.arguments[node]
                if node in single and common in arguments:
                    inside.append((sign, arguments[1] if arguments[0] == common else arguments[0]))
                else:
                    outside.append((sign, node))
            lead = inside[0][0]
            product = self._product(common, self._sum([(lead * sign, node) for sign, node in inside]))
            terms = [*outside, (lead, product)]

    def _sum(self, terms: list[Term]) -> Node:
        """Positive terms first, so that the others are subtracted."""
        ordered = sorted(terms, key=lambda term: -term[0])
        (sign, total), rest = ordered[0], ordered[1:]
        if sign < 0 and rest:  # all negative
            return self.raw("neg", self._sum([(1, node) for _, node in ordered]))
        for sign, node in rest:
            total = self.raw("sub", total, node) if sign < 0 else self.raw("add", *sorted((total, node)))
        return total if ordered[0][0] > 0 else self.raw("neg", total)

    # -- nodes ---------------------------------------------------------------------------------------------

    def raw(self, kind: str, *arguments: Node, value: float = 0.0) -> Node:
        """Exactly this node."""
        return self.graph._node(kind, arguments, value)

    def _product(self, a: Node, b: Node) -> Node:
        if self.graph.is_coefficient(b):
            a, b = b, a
        return self.raw("mul", a, b) if self.graph.is_coefficient(a) else self.raw("mul", *sorted((a, b)))

    def _make(self, node: Node) -> Node:
        """The new node for an old one, or for its negative if it is flipped."""
        kind, arguments = self.old.kinds[node], self.old.arguments[node]
        if kind == "input":
            return self.graph.input(int(self.old.values[node]), uniform=self.old.is_uniform(node))
        if self.old.is_uniform(node):  # computed once: not worth the trouble
            return self.raw(kind, *[self.get(argument) for argument in arguments], value=self.old.values[node])
        if kind in ("add", "sub"):
            terms = self._terms(node, -1 if node in self.flipped else 1)
            single = {
                self.made[inner]
                for inner in self._leaves(node)
                if self.users[inner] == 1 and self.graph.kinds[self.made[inner]] == "mul"
            }
            return self._sum(self._factored(terms, single))
        if kind == "constant":
            return self.raw(kind, value=self.old.values[node])
        if kind == "mul":
            return self._make_product(node)
        if kind == "div":
            return self._make_quotient(node)
        return self.raw(kind, *[self.get(argument) for argument in arguments], value=self.old.values[node])

    def _leaves(self, node: Node) -> list[Node]:
        leaves = []
        for argument in self.old.arguments[node]:
            _, inner = self.signed(argument)
            leaves += self._leaves(inner) if inner in self.inner else [inner]
        return leaves

    def _signed_new(self, argument: Node) -> Term:
        sign, inner = self.signed(argument)
        return (-sign if inner in self.flipped else sign), self.made[inner]

    def _make_product(self, node: Node) -> Node:
        sign = -1 if node in self.flipped else 1
        number = 1.0
        uniform: list[Node] = []
        factors: list[Node] = []
        for argument in self.old.arguments[node]:
            own, new = self._signed_new(argument)
            sign *= own
            parts = [new]
            if self.users[self.signed(argument)[1]] == 1 and self._begins_with_coefficient(new):
                parts = list(self.graph.arguments[new])
            for part in parts:
                if self.graph.is_constant(part):
                    number *= self.graph.values[part]
                else:
                    (uniform if self.graph.is_uniform(part) else factors).append(part)
        if not factors or not math.isfinite(number):  # overflow is left to run time
            return self.raw("mul", *[self._signed_new(argument)[1] for argument in self.old.arguments[node]])
        product = factors[0] if len(factors) == 1 else self._product(*factors)
        if not uniform:
            return self._times(sign * number, product)
        coefficient = uniform[0] if len(uniform) == 1 else self._product(*uniform)
        return self._product(self._times(sign * number, coefficient), product)

    def _begins_with_coefficient(self, new: Node) -> bool:
        is_product = self.graph.kinds[new] == "mul" and not self.graph.is_uniform(new)
        return is_product and self.graph.is_coefficient(self.graph.arguments[new][0])

    def _times(self, number: float, new: Node) -> Node:
        if number == 1.0:
            return new
        return self.raw("neg", new) if number == -1.0 else self.raw("mul", self.graph.constant(number), new)

    def _make_quotient(self, node: Node) -> Node:
        above, below = self.old.arguments[node]
        (sign, dividend), (below_sign, divisor) = self._signed_new(above), self._signed_new(below)
        sign *= below_sign * (-1 if node in self.flipped else 1)
        if self.graph.is_constant(dividend) and sign < 0:
            sign, dividend = 1, self.graph.constant(-self.graph.values[dividend])
        elif self.graph.is_uniform(dividend) and sign < 0:
            sign, dividend = 1, self.raw("neg", dividend)
        if self.divisions[self.signed(below)[1]] > 1 and not self.graph.is_coefficient(divisor):
            reciprocal = self.raw("div", self.graph.one, divisor)
            if self.graph.is_constant(dividend):
                return self._times(self.graph.values[dividend], reciprocal)
            quotient = self._product(reciprocal, dividend)
        else:
            quotient = self.raw("div", dividend, divisor)
        return quotient if sign > 0 else self.raw("neg", quotient)
