"""The scalar graph: simplifications keep values, and equal expressions are one node."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mat_bodies import run_graph

from yasps.dialects.scalar.graph import BINARY_FUNCTIONS, COMPARISONS, UNARY_FUNCTIONS, Node, ScalarGraph

SETTINGS = settings(max_examples=200, deadline=None, derandomize=True, database=None)
INPUTS = [Fraction(3, 2), Fraction(-7, 3), Fraction(5), Fraction(1, 9)]

Tree = tuple[Any, ...]
LEAVES = st.one_of(
    st.tuples(st.just("input"), st.integers(0, len(INPUTS) - 1)),
    st.tuples(st.just("constant"), st.sampled_from((-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 3.0))),
)


def _grow(children: st.SearchStrategy[Tree]) -> st.SearchStrategy[Tree]:
    return st.one_of(
        st.tuples(st.sampled_from(("add", "sub", "mul")), children, children),
        st.tuples(st.just("neg"), children),
        st.tuples(st.just("power"), children, st.sampled_from((0.0, 1.0, 2.0, 3.0, 5.0))),
        st.tuples(st.just("div"), children, st.sampled_from((-4.0, -1.0, 0.25, 1.0, 2.0))),
        st.tuples(st.just("abs"), children),
        st.tuples(st.sampled_from(("min", "max", *COMPARISONS)), children, children),
        st.tuples(st.just("select"), children, children, children),
        st.tuples(st.just("reciprocal"), st.integers(0, len(INPUTS) - 1), children),
    )


TREES = st.recursive(LEAVES, _grow, max_leaves=12)


def _exact(tree: Tree) -> Fraction:
    """What the expression means."""
    kind = tree[0]
    if kind == "input":
        return INPUTS[tree[1]]
    if kind == "constant":
        return Fraction(tree[1])
    if kind == "neg":
        return -_exact(tree[1])
    if kind == "power":
        return _exact(tree[1]) ** int(tree[2])
    if kind == "div":
        return _exact(tree[1]) / Fraction(tree[2])
    if kind == "reciprocal":
        return _exact(tree[2]) / -INPUTS[tree[1]]
    if kind == "abs":
        return abs(_exact(tree[1]))
    if kind == "select":
        return _exact(tree[2]) if _exact(tree[1]) != 0 else _exact(tree[3])
    a, b = _exact(tree[1]), _exact(tree[2])
    if kind in ("min", "max"):
        return min(a, b) if kind == "min" else max(a, b)
    if kind in ("lt", "le", "ne"):
        return Fraction({"lt": a < b, "le": a <= b, "ne": a != b}[kind])
    return a + b if kind == "add" else a - b if kind == "sub" else a * b


def _node(graph: ScalarGraph, tree: Tree) -> Node:
    kind = tree[0]
    if kind == "input":
        return graph.input(tree[1])
    if kind == "constant":
        return graph.constant(tree[1])
    if kind == "neg":
        return graph.neg(_node(graph, tree[1]))
    if kind == "power":
        return graph.power(_node(graph, tree[1]), tree[2])
    if kind == "div":
        return graph.div(_node(graph, tree[1]), graph.constant(tree[2]))
    if kind == "reciprocal":
        return graph.div(_node(graph, tree[2]), graph.neg(graph.input(tree[1])))
    if kind == "abs":
        return graph.unary("abs", _node(graph, tree[1]))
    if kind == "select":
        return graph.select(*(_node(graph, part) for part in tree[1:]))
    if kind in COMPARISONS:
        return graph.compare(kind, _node(graph, tree[1]), _node(graph, tree[2]))
    if kind in BINARY_FUNCTIONS:
        return graph.binary(kind, _node(graph, tree[1]), _node(graph, tree[2]))
    operation = {"add": graph.add, "sub": graph.sub, "mul": graph.mul}[kind]
    return operation(_node(graph, tree[1]), _node(graph, tree[2]))


@SETTINGS
@given(TREES)
def test_simplifications_keep_the_value(tree: Tree) -> None:
    """Exactly: constants are dyadic, so folding them rounds nothing."""
    graph = ScalarGraph()
    assert run_graph(graph, [_node(graph, tree)], INPUTS, Fraction) == [_exact(tree)]


@SETTINGS
@given(TREES)
def test_an_expression_made_twice_is_one_node(tree: Tree) -> None:
    graph = ScalarGraph()
    first = _node(graph, tree)
    size = len(graph)
    assert _node(graph, tree) == first
    assert len(graph) == size


@SETTINGS
@given(TREES)
def test_nodes_come_after_their_operands_and_none_is_trivial(tree: Tree) -> None:
    graph = ScalarGraph()
    root = _node(graph, tree)
    for node in graph.reachable([root]):
        kind, operands = graph.kinds[node], graph.arguments[node]
        assert all(operand < node for operand in operands)
        if kind in ("add", "sub", "mul"):
            assert graph.zero not in operands
        if kind in ("mul", "div"):
            assert operands[-1] != graph.one
            assert not (kind == "mul" and operands[0] == graph.one)
        if operands:
            assert not all(graph.is_constant(operand) for operand in operands), "a constant was not folded"


POSITIVE = [0.7, 1.3, 2.9]
POSITIVE_TREES = st.recursive(
    st.one_of(
        st.tuples(st.just("input"), st.integers(0, 2)), st.tuples(st.just("constant"), st.floats(0.5, 2.0, width=32))
    ),
    lambda children: st.one_of(
        st.tuples(st.sampled_from(("add", "mul", "div")), children, children),
        st.tuples(st.just("sqrt"), children),
        st.tuples(st.just("power"), children, st.sampled_from((-1.0, 0.5, 1.5, -2.0, 0.3))),
    ),
    max_leaves=6,
)


def _python(tree: Tree) -> float:
    kind = tree[0]
    if kind == "input":
        return POSITIVE[tree[1]]
    if kind == "constant":
        return float(tree[1])
    if kind == "sqrt":
        return math.sqrt(_python(tree[1]))
    if kind == "power":
        return float(_python(tree[1]) ** tree[2])
    a, b = _python(tree[1]), _python(tree[2])
    return a + b if kind == "add" else a * b if kind == "mul" else a / b


def _positive_node(graph: ScalarGraph, tree: Tree) -> Node:
    kind = tree[0]
    if kind == "input":
        return graph.input(tree[1])
    if kind == "constant":
        return graph.constant(tree[1])
    if kind == "sqrt":
        return graph.unary("sqrt", _positive_node(graph, tree[1]))
    if kind == "power":
        return graph.power(_positive_node(graph, tree[1]), tree[2])
    operation = {"add": graph.add, "mul": graph.mul, "div": graph.div}[kind]
    return operation(_positive_node(graph, tree[1]), _positive_node(graph, tree[2]))


@SETTINGS
@given(POSITIVE_TREES)
def test_floats_agree_to_rounding_where_nothing_cancels(tree: Tree) -> None:
    graph = ScalarGraph()
    (found,) = run_graph(graph, [_positive_node(graph, tree)], POSITIVE)
    assert found == pytest.approx(_python(tree), rel=1e-13)


# -- single rules ------------------------------------------------------------------------------------------


@pytest.fixture
def graph() -> ScalarGraph:
    """An empty graph."""
    return ScalarGraph()


def test_sums_and_products_commute(graph: ScalarGraph) -> None:
    x, y = graph.input(0), graph.input(1)
    assert graph.add(x, y) == graph.add(y, x)
    assert graph.mul(x, y) == graph.mul(y, x)


def test_differences_share_a_node(graph: ScalarGraph) -> None:
    x, y = graph.input(0), graph.input(1)
    forward, backward = graph.sub(x, y), graph.sub(y, x)
    assert graph.neg(forward) == backward
    assert graph.sub(x, x) == graph.zero


def test_signs_are_carried_outwards(graph: ScalarGraph) -> None:
    x, y = graph.input(0), graph.input(1)
    assert graph.mul(graph.neg(x), graph.neg(y)) == graph.mul(x, y)
    assert graph.mul(graph.neg(x), y) == graph.neg(graph.mul(x, y))
    assert graph.div(graph.neg(x), graph.neg(y)) == graph.div(x, y)
    assert graph.add(x, graph.neg(y)) == graph.sub(x, y)
    assert graph.mul(graph.constant(-2.0), x) == graph.neg(graph.mul(graph.constant(2.0), x))


def test_constant_factors_are_collected(graph: ScalarGraph) -> None:
    x = graph.input(0)
    assert graph.mul(graph.constant(3.0), graph.mul(x, graph.constant(4.0))) == graph.mul(graph.constant(12.0), x)


def test_division_by_a_power_of_two_is_a_product(graph: ScalarGraph) -> None:
    x = graph.input(0)
    assert graph.div(x, graph.constant(4.0)) == graph.mul(graph.constant(0.25), x)
    assert graph.kinds[graph.div(x, graph.constant(3.0))] == "div"  # 1/3 would round


def test_zero_and_minus_zero_are_one_constant(graph: ScalarGraph) -> None:
    assert graph.constant(-0.0) == graph.zero
    assert math.copysign(1.0, graph.values[graph.zero]) == 1.0


def test_integer_powers_are_products(graph: ScalarGraph) -> None:
    x = graph.input(0)
    assert graph.power(x, 0.0) == graph.one
    assert graph.power(x, 1.0) == x
    assert graph.power(x, 2.0) == graph.mul(x, x)
    assert graph.power(x, 3.0) == graph.mul(graph.mul(x, x), x)
    assert graph.power(x, -1.0) == graph.div(graph.one, x)
    assert graph.power(x, 0.5) == graph.unary("sqrt", x)
    assert "power" not in graph.kinds
    assert graph.kinds[graph.power(x, 2.5)] == "power"


@pytest.mark.parametrize("word", UNARY_FUNCTIONS)
def test_functions_of_constants_are_computed(graph: ScalarGraph, word: str) -> None:
    assert graph.unary(word, graph.constant(0.5)) == graph.constant(UNARY_FUNCTIONS[word](0.5))


@pytest.mark.parametrize(("word", "value"), [("log", 0.0), ("log", -1.0), ("sqrt", -1.0), ("acos", 2.0)])
def test_functions_outside_their_domain_are_left_to_run_time(graph: ScalarGraph, word: str, value: float) -> None:
    node = graph.unary(word, graph.constant(value))
    assert graph.kinds[node] == word


def test_overflow_is_left_to_run_time(graph: ScalarGraph) -> None:
    """exp(1000) is infinite at run time; Python's math raises OverflowError."""
    assert graph.kinds[graph.unary("exp", graph.constant(1000.0))] == "exp"
    huge, x = graph.constant(1e200), graph.input(0)
    assert graph.kinds[graph.mul(huge, huge)] == "mul"
    assert graph.kinds[graph.div(huge, graph.constant(1e-200))] == "div"
    largest = graph.constant(1.7e308)
    assert graph.kinds[graph.add(largest, largest)] == "add"
    assert graph.kinds[graph.sub(graph.neg(largest), largest)] in ("sub", "neg")
    graph.mul(huge, graph.mul(huge, x))
    graph.div(x, graph.constant(2.0**-1074))  # 1 / 2^-1074 overflows
    assert all(math.isfinite(value) for value in graph.values)


def test_a_choice_by_a_comparison_is_one_selection(graph: ScalarGraph) -> None:
    """No 0 or 1 on the way, also for "and", "or" and "not"."""
    x, y, z = graph.input(0), graph.input(1), graph.input(2)
    first, second = graph.compare("lt", x, y), graph.compare("le", y, z)
    chosen = graph.select(first, x, z)
    assert [graph.kinds[n] for n in graph.reachable([chosen])] == ["input"] * 3 + ["lt", "select"]
    for condition in (
        graph.select(first, second, graph.zero),
        graph.select(first, graph.one, second),
        graph.select(first, graph.zero, second),
        graph.mul(first, second),
        graph.mul(second, graph.sub(graph.one, first)),
        graph.binary("min", first, second),
        graph.binary("max", second, first),
    ):
        chosen = graph.select(condition, x, z)
        reached = graph.reachable([chosen])
        assert sorted(graph.kinds[n] for n in reached) == ["input"] * 3 + ["le", "lt", "select", "select"]
        assert not any(graph.is_constant(n) for n in reached)
    assert graph.select(graph.select(first, graph.zero, graph.one), x, z) == graph.select(first, z, x)


def test_a_choice_made_already_is_not_made_again(graph: ScalarGraph) -> None:
    x, y, z = graph.input(0), graph.input(1), graph.input(2)
    condition = graph.compare("lt", x, y)
    assert graph.select(condition, graph.select(condition, x, y), z) == graph.select(condition, x, z)
    assert graph.select(condition, x, graph.select(condition, y, z)) == graph.select(condition, x, z)
    assert graph.select(condition, x, x) == x
    assert graph.select(graph.one, x, y) == x
    assert graph.select(graph.zero, x, y) == y
    assert graph.select(condition, graph.neg(x), graph.neg(y)) == graph.neg(graph.select(condition, x, y))
    assert graph.select(condition, graph.neg(x), graph.zero) == graph.neg(graph.select(condition, x, graph.zero))


def test_comparisons_of_negatives_are_those_of_positives(graph: ScalarGraph) -> None:
    x, y = graph.input(0), graph.input(1)
    assert graph.compare("lt", graph.neg(x), graph.neg(y)) == graph.compare("lt", y, x)
    assert graph.compare("lt", graph.neg(x), graph.constant(-2.0)) == graph.compare("lt", graph.constant(2.0), x)
    assert graph.compare("lt", x, x) == graph.zero
    assert graph.kinds[graph.compare("le", x, x)] == "select"  # 0 where x is NaN


def test_absolute_values_forget_signs(graph: ScalarGraph) -> None:
    x, y = graph.input(0), graph.input(1)
    assert graph.unary("abs", graph.neg(x)) == graph.unary("abs", x)
    assert graph.unary("abs", graph.unary("abs", x)) == graph.unary("abs", x)
    assert graph.binary("min", x, y) == graph.binary("min", y, x)
    assert graph.binary("max", x, x) == x
    assert graph.binary("atan2", x, y) != graph.binary("atan2", y, x)
    assert graph.binary("atan2", graph.one, graph.one) == graph.constant(math.pi / 4)


def test_division_by_zero_is_left_to_run_time(graph: ScalarGraph) -> None:
    assert graph.kinds[graph.div(graph.one, graph.zero)] == "div"


def test_only_what_outputs_need_is_reachable(graph: ScalarGraph) -> None:
    x, y = graph.input(0), graph.input(1)
    graph.mul(x, y)
    needed = graph.mul(x, x)
    assert graph.reachable([needed]) == [x, needed]


def test_dot_products_skip_zeros(graph: ScalarGraph) -> None:
    x = graph.input(0)
    assert graph.dot([graph.zero, x, graph.one], [x, graph.one, graph.zero]) == x
