"""What a kernel of derivatives computes to see whether the energy itself is finite."""

from __future__ import annotations

from collections.abc import Sequence

from yasps.dialects.scalar.graph import Node, ScalarGraph

TINY = 1e-300
"""Times any finite number less than 2e8, and infinite times infinity."""


def finite_check(graph: ScalarGraph, energy: Node, derivatives: Sequence[Node]) -> Node:
    """A number that is finite where the energy is, of about its size, and costs less.

    It is the energy, where each logarithm that the derivatives don't need is replaced by a number that is finite where
    it is, and as harmless: to compute it would take longer than all else that the derivatives don't need.
    """
    needed = set(graph.reachable(derivatives))
    made: dict[Node, Node] = {}
    for node in graph.reachable([energy]):
        kind, arguments = graph.kinds[node], graph.arguments[node]
        if node in needed:
            made[node] = node
        elif kind == "log":
            made[node] = _finite_logarithm(graph, made[arguments[0]])
        elif all(made[argument] == argument for argument in arguments):
            made[node] = node
        else:
            made[node] = graph.remade(node, [made[argument] for argument in arguments])
    return made[energy]


def _finite_logarithm(graph: ScalarGraph, a: Node) -> Node:
    infinite = graph.div(graph.one, graph.zero)
    return graph.select(graph.compare("lt", graph.zero, a), graph.mul(graph.constant(TINY), a), infinite)
