"""Blocks of `mat` operations in tests: made by hand, run in NumPy, run as scalar code."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from xdsl.ir import Block, SSAValue

from yasps.dialects.mat import Batch, MatOp, Shape, matrix_type
from yasps.dialects.mat.comparison import is_less, is_less_equal, maximum, minimum
from yasps.dialects.mat.elementwise import TABLED
from yasps.dialects.mat.structure import ConstantOp, IdentityOp
from yasps.dialects.scalar.graph import Node, ScalarGraph


def block_of(shapes: Sequence[Shape]) -> Block:
    """A block with an argument of each shape."""
    return Block(arg_types=[matrix_type(shape) for shape in shapes])


def run_block(block: Block, inputs: Sequence[Batch], exact: bool = False) -> dict[SSAValue, Batch]:
    """Values of everything in the block; `exact` makes constants rationals."""
    values: dict[SSAValue, Batch] = dict(zip(block.args, inputs, strict=True))
    with np.errstate(all="ignore"):
        for op in block.ops:
            assert isinstance(op, MatOp)
            result = op.evaluate(*[values[operand] for operand in op.operands])
            if exact and isinstance(op, ConstantOp | IdentityOp):
                result = fractions(result)
            values[op.result] = result
    return values


def fractions(array: Batch) -> Batch:
    """The same numbers as exact rationals."""
    result = np.empty(array.shape, object)
    result.ravel()[:] = [Fraction(v) for v in array.ravel().tolist()]
    return result


def run_graph(
    graph: ScalarGraph,
    outputs: Sequence[Node],
    inputs: Sequence[Any],
    number: Callable[[float], Any] = float,
) -> list[Any]:
    """Values of the outputs for the values of the input nodes; numbers or arrays of any kind.

    number: what constants are made to, e.g. `Fraction`.
    """
    binary: dict[str, Callable[[Any, Any], Any]] = {
        "add": lambda a, b: a + b,
        "sub": lambda a, b: a - b,
        "mul": lambda a, b: a * b,
        "div": lambda a, b: a / b,
        "min": minimum,
        "max": maximum,
        "atan2": np.arctan2,
        "lt": is_less,
        "le": is_less_equal,
        "ne": lambda a, b: is_less(a, b) | is_less(b, a),
    }
    values: dict[Node, Any] = {}
    for node in graph.reachable(outputs):
        kind = graph.kinds[node]
        operands = [values[a] for a in graph.arguments[node]]
        if kind == "constant":
            values[node] = number(graph.values[node])
        elif kind == "input":
            values[node] = inputs[int(graph.values[node])]
        elif kind == "power":
            values[node] = operands[0] ** graph.values[node]
        elif kind == "neg":
            values[node] = -operands[0]
        elif kind == "select":
            values[node] = np.where(*operands)[()]
        elif kind in binary:
            values[node] = binary[kind](*operands)
        else:
            values[node] = (np.abs if kind == "abs" else TABLED[kind].FUNCTION.evaluate)(*operands)
    return [values[node] for node in outputs]


def lower_and_run(op: MatOp, inputs: Sequence[Batch], number: Callable[[float], Any] = float) -> Batch:
    """The operation through its scalar code, [instances, rows, columns]."""
    graph = ScalarGraph()
    flat: list[Any] = []
    nodes = []
    for values in inputs:
        entries = values.reshape(len(values), -1).T
        nodes.append([graph.input(len(flat) + k) for k in range(len(entries))])
        flat.extend(entries)
    outputs = op.lower(graph, *nodes)
    count = len(inputs[0]) if inputs else 1
    results = [np.broadcast_to(r, (count,)) for r in run_graph(graph, outputs, flat, number)]
    rows, cols = op.result.type.get_shape()  # type: ignore[attr-defined]
    return np.stack(results, axis=-1).reshape(count, rows, cols)


def largest(array: Batch) -> float:
    """Largest magnitude; at least the smallest positive number, to divide by."""
    return max(float(np.abs(array).max(initial=0.0)), np.finfo(float).tiny)


def relative_error(found: Batch, wanted: Batch) -> float:
    """Largest difference, relative to the largest entry; 0 if both are zero."""
    difference = float(np.abs(np.asarray(found) - np.asarray(wanted)).max(initial=0.0))
    return 0.0 if difference == 0.0 else difference / largest(np.asarray(wanted))
