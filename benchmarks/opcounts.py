"""Scalar operations of gradient and Hessian of one element, beside SymPy with common sub-expressions taken out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
from xdsl.dialects import arith, func, math
from xdsl.dialects.builtin import ModuleOp

from benchmarks.energies import ENERGIES, Energy, Numbers
from benchmarks.measure import Report, Row, Settings
from yasps import Scene
from yasps.backend.reference.interpreter import Interpreter, SceneData
from yasps.frontend.execution.emit import SceneEmitter
from yasps.frontend.language.nodes import Stored
from yasps.passes.pipeline import run_pipeline

DESCRIPTION = "scalar operations of gradient and Hessian of one element, beside SymPy with its cse"
KINDS = {"additions": ("add",), "multiplications": ("mul",), "divisions": ("div",)}
AGREEMENT = 1e-9  # relative; SymPy's formulas cancel
NOTES = (
    "gradient and upper triangle of the Hessian in all unknowns. yasps: functions derive, pull_back of the projected "
    "code (default), which needs the Hessian in the linear cut too. SymPy: diff of each entry, then cse of them all.",
    "a - b is an addition; operations: everything, with sign changes, comparisons and choices, sqrt, log.",
    "x: differentiated by positions; F: by the deformation gradient.",
)


def run(settings: Settings) -> Report:
    """Counts all energies; with SymPy, checks first that both derive the same. Raises ValueError if they don't."""
    del settings  # nothing is timed
    sympy: ModuleType | None = None
    about_sympy = ""
    try:
        sympy = import_module("benchmarks.sympy_energies")
        about_sympy = f"SymPy {import_module('sympy').__version__}."
    except ImportError as error:
        about_sympy = f"No rows for SymPy, which is not installed ({error}); to have them: pip install sympy"
    rows = []
    for name, energy in ENERGIES.items():
        numbers = energy.numbers()
        module, _ = compiled(energy.scene(numbers))
        rows += _rows(name, "yasps", operations(module))
        if sympy is not None:
            replacements, reduced = sympy.derivatives(name)
            check_agreement(name, energy, numbers, replacements, reduced)
            expressions = [expression for _, expression in replacements] + reduced
            rows += _rows(name, "SymPy", sympy_operations(expressions))
    return Report(rows, [*NOTES, about_sympy])


def _rows(name: str, implementation: str, counts: Counter[str]) -> list[Row]:
    found = [Row(name, implementation, 1, float(counts.total()), "operations")]
    named = 0
    for unit, kinds in KINDS.items():
        value = sum(counts[kind] for kind in kinds)
        named += value
        found.append(Row(name, implementation, 1, float(value), unit))
    return [*found, Row(name, implementation, 1, float(counts.total() - named), "others")]


_KIND_OF: dict[type, str] = {
    arith.AddfOp: "add",
    arith.SubfOp: "add",
    arith.MulfOp: "mul",
    arith.DivfOp: "div",
    arith.NegfOp: "neg",
    math.SqrtOp: "sqrt",
    math.LogOp: "log",
    math.PowFOp: "pow",
}


def compiled(scene: Scene) -> tuple[ModuleOp, SceneData]:
    """The scene's scalar code, and its numbers."""
    emitter = SceneEmitter(scene.name)
    module = run_pipeline(emitter.emit(scene._energies, scene._targets, []))
    storages = {}
    for symbol, attribute in emitter.stored.items():
        assert isinstance(attribute.node, Stored)
        storages[symbol] = attribute.node.array
    sizes = {symbol: owner.num_instances for symbol, owner in emitter.owners.items()}
    return module, SceneData(storages, {}, sizes)


def operations(module: ModuleOp) -> Counter[str]:
    """Scalar operations that give gradient and Hessian, in the functions `derive` and `pull_back`.

    The first result of `derive` is the energy's value, which is only looked at: what it alone needs is not counted.
    """
    counts: Counter[str] = Counter()
    for op in module.walk():
        if isinstance(op, func.FuncOp) and op.sym_name.data.endswith((".derive", ".pull_back")):
            *body, result = op.body.block.ops
            wanted = set(result.operands[1 if op.sym_name.data.endswith(".derive") else 0 :])
            for inner in reversed(body):
                if not isinstance(inner, arith.ConstantOp) and not wanted.isdisjoint(inner.results):
                    counts[_KIND_OF.get(type(inner), inner.name)] += 1
                    wanted.update(inner.operands)
    return counts


def sympy_operations(expressions: Sequence[Any]) -> Counter[str]:
    """Scalar operations of these expressions, which share nothing, written as straight-line code."""
    sp = import_module("sympy")
    counts: Counter[str] = Counter()

    def power(exponent: Any) -> None:
        """What x ** exponent takes, exponent > 0."""
        if exponent.is_Integer:
            bits = bin(int(exponent))[2:]
            counts["mul"] += len(bits) - 1 + bits.count("1") - 1
        elif exponent == sp.Rational(1, 2):
            counts["sqrt"] += 1
        elif exponent.is_Rational and exponent.q == 2:
            counts["sqrt"] += 1  # x^(n + 1/2) = x^n sqrt(x)
            counts["mul"] += 1
            power(sp.Integer((exponent.p - 1) // 2))
        else:
            counts["pow"] += 1

    def visit(expression: Any) -> None:
        if expression.is_Atom:
            return
        if expression.is_Add:
            counts["add"] += len(expression.args) - 1
            negative = [term.could_extract_minus_sign() for term in expression.args]
            for term, is_negative in zip(expression.args, negative, strict=True):
                visit(-term if is_negative else term)
            counts["neg"] += all(negative)
        elif expression.is_Mul:
            coefficient, factors = expression.as_coeff_mul()
            above = [f for f in factors if not (f.is_Pow and f.exp.is_negative)]
            below = [1 / f for f in factors if f.is_Pow and f.exp.is_negative]
            if coefficient == -1:
                counts["neg"] += 1
            count_above = len(above) + (abs(coefficient) != 1)
            counts["mul"] += max(count_above - 1, 0) + max(len(below) - 1, 0)
            counts["div"] += bool(below)
            for factor in above + below:
                visit(factor)
        elif expression.is_Pow:
            visit(expression.base)
            if expression.exp.is_negative:
                counts["div"] += 1
            power(abs(expression.exp))
        else:
            counts[type(expression).__name__] += 1
            for argument in expression.args:
                visit(argument)

    for expression in expressions:
        visit(expression)
    return +counts


def check_agreement(name: str, energy: Energy, numbers: Numbers, replacements: Any, reduced: Any) -> None:
    """Compares SymPy's derivatives, and those of the scalar code, at some point. Raises ValueError if they differ."""
    sp = import_module("sympy")
    module, data = compiled(energy.scene(numbers, projection="none"))
    gradient, hessian = Interpreter(module, data).assemble()
    ours = np.concatenate([gradient, hessian.toarray()[np.triu_indices(len(gradient))]])
    shapes = energy.variables | energy.constants
    names = [f"{n}_{i}_{j}" for n, (rows, cols) in shapes.items() for i in range(rows) for j in range(cols)]
    values = dict(zip(names, np.concatenate([numbers[n].ravel() for n in shapes]), strict=True))
    for symbol, expression in replacements:
        arguments = sorted(expression.free_symbols, key=str)
        values[str(symbol)] = sp.lambdify(arguments, expression, "numpy")(*[values[str(a)] for a in arguments])
    theirs = []
    for expression in reduced:
        arguments = sorted(expression.free_symbols, key=str)
        theirs.append(sp.lambdify(arguments, expression, "numpy")(*[values[str(a)] for a in arguments]))
    error = np.abs(np.array(theirs, float) - ours).max() / np.abs(ours).max()
    if not error < AGREEMENT:
        raise ValueError(f"{name}: derivatives of yasps and SymPy differ by {error:.1e}; one energy is written wrongly")
