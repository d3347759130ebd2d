"""Tidied graphs: the same values, never more operations, and each rule on its own."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mat_bodies import run_graph

from yasps.dialects.scalar.graph import Node, ScalarGraph
from yasps.dialects.scalar.tidying import tidied

SETTINGS = settings(max_examples=200, deadline=None, derandomize=True, database=None)
INPUTS = [Fraction(3, 2), Fraction(-7, 3), Fraction(5), Fraction(1, 9)]
OPERATIONS = ("add", "sub", "mul", "div", "neg")
STEP = st.tuples(st.sampled_from(OPERATIONS), st.integers(0, 30), st.integers(0, 30))
FREE = ("constant", "input")


def graph_of(steps: list[tuple[str, int, int]]) -> tuple[ScalarGraph, list[Node]]:
    """A graph whose steps each work on earlier results; nothing is divided by a node, but by inputs."""
    graph = ScalarGraph()
    inputs = [graph.input(k) for k in range(len(INPUTS))]
    nodes = [*inputs, graph.constant(2.0), graph.constant(-0.5)]
    for kind, first, second in steps:
        a, b = nodes[first % len(nodes)], nodes[second % len(nodes)]
        if kind == "neg":
            nodes.append(graph.neg(a))
        elif kind == "div":
            divisor = inputs[second % len(inputs)]
            nodes.append(graph.div(a, graph.neg(divisor) if first % 2 else divisor))
        else:
            nodes.append(getattr(graph, kind)(a, b))
    return graph, nodes[6:]


def cost(graph: ScalarGraph, outputs: list[Node], free: tuple[str, ...] = FREE) -> int:
    return sum(graph.kinds[node] not in free for node in graph.reachable(outputs))


@SETTINGS
@given(st.lists(STEP, min_size=1, max_size=30), st.integers(1, 6))
def test_values_stay_and_operations_do_not_grow(steps: list[tuple[str, int, int]], count: int) -> None:
    """Exactly, in rationals. Sharing a reciprocal takes as many products as it saves divisions: one operation more."""
    graph, nodes = graph_of(steps)
    outputs = nodes[-count:]
    after, tidy = tidied(graph, outputs)
    assert run_graph(after, tidy, INPUTS, Fraction) == run_graph(graph, outputs, INPUTS, Fraction)
    divisions = sum(graph.kinds[node] == "div" for node in graph.reachable(outputs))
    reciprocals = sum(after.kinds[node] == "div" for node in after.reachable(tidy))
    assert reciprocals <= divisions
    assert cost(after, tidy) <= cost(graph, outputs) + reciprocals


@SETTINGS
@given(st.lists(STEP, min_size=1, max_size=30))
def test_tidying_is_repeatable(steps: list[tuple[str, int, int]]) -> None:
    graph, nodes = graph_of(steps)
    first, second = tidied(graph, nodes[-3:]), tidied(graph, nodes[-3:])
    assert first[0].kinds == second[0].kinds
    assert first[0].arguments == second[0].arguments
    assert first[1] == second[1]


@pytest.fixture
def graph() -> ScalarGraph:
    """An empty graph."""
    return ScalarGraph()


def kinds_of(graph: ScalarGraph, outputs: list[Node]) -> list[str]:
    """Operations of the tidied graph, sorted."""
    after, tidy = tidied(graph, outputs)
    return sorted(after.kinds[node] for node in after.reachable(tidy) if after.kinds[node] not in FREE)


def four(graph: ScalarGraph) -> Any:
    return [graph.input(k) for k in range(4)]


def test_divisions_by_one_number_share_its_reciprocal(graph: ScalarGraph) -> None:
    a, b, c, d = four(graph)
    assert kinds_of(graph, [graph.div(a, d), graph.div(b, d), graph.div(c, d)]) == ["div", "mul", "mul", "mul"]
    assert kinds_of(graph, [graph.div(a, d)]) == ["div"]
    assert kinds_of(graph, [graph.div(graph.one, d), graph.div(b, d)]) == ["div", "mul"]


def test_signs_are_absorbed(graph: ScalarGraph) -> None:
    a, b, c, d = four(graph)
    assert kinds_of(graph, [graph.neg(graph.sub(a, b))]) == ["sub"]
    assert kinds_of(graph, [graph.neg(graph.mul(c, graph.sub(a, b)))]) == ["mul", "sub"]
    assert kinds_of(graph, [graph.neg(graph.mul(graph.constant(2.0), c))]) == ["mul"]
    assert kinds_of(graph, [graph.neg(graph.add(graph.mul(c, graph.sub(a, b)), d))]) == ["mul", "sub", "sub"]


def test_a_sign_stays_where_both_are_needed(graph: ScalarGraph) -> None:
    a, b, _, _ = four(graph)
    difference = graph.sub(a, b)
    assert kinds_of(graph, [difference, graph.neg(difference)]) == ["neg", "sub"]


def test_numbers_move_out_of_products(graph: ScalarGraph) -> None:
    """a (2 b) = 2 (a b), which meets a b."""
    a, b, _, _ = four(graph)
    two = graph.constant(2.0)
    assert kinds_of(graph, [graph.mul(a, graph.mul(two, b)), graph.mul(a, b)]) == ["mul", "mul"]


def test_common_factors_are_taken_out(graph: ScalarGraph) -> None:
    a, b, c, d = four(graph)
    total = graph.sum([graph.mul(a, b), graph.mul(c, d), graph.mul(a, c)])
    assert kinds_of(graph, [total]) == ["add", "add", "mul", "mul"]
    shared = graph.mul(a, b)
    assert kinds_of(graph, [graph.add(shared, graph.mul(a, c)), shared]) == ["add", "mul", "mul"]


def test_overflow_is_left_to_run_time(graph: ScalarGraph) -> None:
    huge, x = graph.constant(1e200), graph.input(0)
    product = graph.mul(huge, graph.mul(huge, x))
    after, (tidy,) = tidied(graph, [product])
    assert run_graph(after, [tidy], [1e-300]) == [pytest.approx(1e100)]
