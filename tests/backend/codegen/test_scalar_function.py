"""Long scalar functions are divided among several that do the same."""

from __future__ import annotations

import ctypes
import re

import numpy as np
import pytest
from xdsl.dialects import func
from xdsl.dialects.builtin import f64

from yasps.backend.codegen.scalar_function import function_text
from yasps.dialects.scalar.graph import Node, ScalarGraph
from yasps.passes.transforms.lower_to_scalar import _function
from yasps.runtime.build.toolchain import Source, compile_sources, find_compiler, link

INPUTS = 5
OUTPUTS = (4, 3)


def random_function(seed: int) -> func.FuncOp:
    """Sums, products and choices of earlier values; among the results an input, a constant and one value twice."""
    random = np.random.default_rng(seed)
    graph = ScalarGraph()
    nodes: list[Node] = [graph.input(k) for k in range(INPUTS)]
    arguments = list(nodes)
    for _ in range(60):
        a, b, c = (nodes[k] for k in random.integers(max(0, len(nodes) - 20), len(nodes), 3))
        make = random.integers(4)
        if make == 0:
            nodes.append(graph.select(graph.compare("lt", a, b), b, c))
        elif make == 1:
            nodes.append(graph.mul(a, graph.unary("cos", b)))
        else:
            nodes.append(graph.add(a, graph.mul(b, graph.constant(0.25 * make))))
    results = [*nodes[-3:], nodes[-20], nodes[-20], arguments[1], graph.constant(2.5)]
    return _function("f", graph, arguments, results, f64)


@pytest.fixture(scope="module")
def run() -> dict[int | None, np.ndarray]:
    """Results of eight functions on the same numbers, by the length of their parts."""
    lengths = (None, 1, 7, 25)
    functions = [random_function(seed) for seed in range(8)]
    texts = [
        function_text(function, f"f{k}_{n}", "double", [2, 3], OUTPUTS, linkage='extern "C"', longest=longest)
        for n, longest in enumerate(lengths)
        for k, function in enumerate(functions)
    ]
    compiler = find_compiler().for_generated()
    linked = link(compile_sources([Source("test.long", "\n".join(texts))], compiler), compiler)
    library = ctypes.CDLL(str(linked.path))
    x = np.random.default_rng(8).uniform(-1, 1, INPUTS)
    found: dict[int | None, np.ndarray] = {}
    for n, longest in enumerate(lengths):
        results = np.full((len(functions), sum(OUTPUTS)), np.nan)
        for k, row in enumerate(results):
            places = [x[:2], x[2:].copy(), row[: OUTPUTS[0]], row[OUTPUTS[0] :]]
            getattr(library, f"f{k}_{n}")(*[ctypes.c_void_p(place.ctypes.data) for place in places])
        found[longest] = results
    return found


@pytest.mark.parametrize("longest", [1, 7, 25])
def test_a_divided_function_computes_the_same(run: dict[int | None, np.ndarray], longest: int) -> None:
    assert np.isfinite(run[None]).all()
    assert np.allclose(run[longest], run[None], rtol=1e-13, atol=1e-13)  # sums and products are fused within a part
    assert np.ptp(run[None][:, 0]) > 0


def test_parts_are_short_and_keep_what_later_ones_need() -> None:
    text = function_text(random_function(0), "f", "double", [2, 3], OUTPUTS, longest=10)
    bodies = re.findall(r"void f_\d+\(.*?\n}", text, re.DOTALL)
    assert len(bodies) > 3
    assert all(body.count("const double t") <= 10 for body in bodies)
    (kept,) = re.findall(r"double w\[(\d+)\];", text)
    assert 0 < int(kept) < 40  # places of values that nobody needs any more are used again
    assert "w[" not in function_text(random_function(0), "f", "double", [2, 3], OUTPUTS, longest=1000)
