"""Scalar functions (`func`, `arith`, `math`) as C++ text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from xdsl.dialects import arith, func, math
from xdsl.dialects.builtin import FloatAttr, IntegerAttr
from xdsl.ir import Operation, SSAValue

from yasps.dialects.scalar.functions import FUNCTIONS

INFIX: dict[type[Operation], str] = {
    arith.AddfOp: "+",
    arith.SubfOp: "-",
    arith.MulfOp: "*",
    arith.DivfOp: "/",
}
CALLS: dict[type[Operation], str] = {
    **{function.operation: function.name for function in FUNCTIONS},
    math.PowFOp: "pow",
    math.Atan2Op: "atan2",
    math.AbsFOp: "fabs",
}
CHOICES: dict[type[Operation], str] = {
    arith.SelectOp: "{0} ? {1} : {2}",
    arith.MinimumfOp: "{0} <= {1} ? {0} : ({1} < {0} ? {1} : {0} + {1})",
    arith.MaximumfOp: "{1} <= {0} ? {0} : ({0} < {1} ? {1} : {0} + {1})",
}
"""Valid on one number and on packs alike, where a comparison gives a mask; the sum is NaN where an operand is."""
COMPARISONS = {"olt": "{0} < {1}", "ole": "{0} <= {1}", "one": "({0} < {1}) | ({1} < {0})"}
BUILT_IN = frozenset({"sqrt", "fabs"})
"""Compiled to an instruction; everything else is a function of the C library."""
OF_TWO = frozenset({"pow", "atan2"})
"""Functions of two numbers."""


def function_text(
    op: func.FuncOp,
    name: str,
    scalar: str,
    inputs: Sequence[int],
    outputs: Sequence[int],
    *,
    linkage: str = "static inline",
    math_prefix: str = "__builtin_",
) -> str:
    """A C++ function of the values `scalar` (V, double or int) for the operation.

    `inputs` and `outputs` cut its arguments and results into arrays of these lengths; `math_prefix` stands before the
    names of mathematical functions of numbers.
    """
    names: dict[SSAValue, str] = {}
    arguments = iter(op.body.block.args)
    for number, length in enumerate(inputs):
        for k in range(length):
            names[next(arguments)] = f"x{number}[{k}]"
    parameters = [f"const {scalar}* x{n}" for n in range(len(inputs))] + [
        f"{scalar}* y{n}" for n in range(len(outputs))
    ]
    lines = [f"{linkage} void {name}({', '.join(parameters)}) {{"]
    for inner in op.body.block.ops:
        if isinstance(inner, func.ReturnOp):
            values = iter(inner.arguments)
            lines += [
                f"    y{n}[{k}] = {names[next(values)]};" for n, length in enumerate(outputs) for k in range(length)
            ]
        elif isinstance(inner, arith.ConstantOp):
            names[inner.result] = _literal(inner, scalar)
        else:
            result = inner.results[0]
            names[result] = f"t{len(names)}"
            kind = "auto" if isinstance(inner, arith.CmpfOp) else scalar  # a truth value or a mask
            lines.append(f"    const {kind} {names[result]} = {_expression(inner, names, scalar, math_prefix)};")
    lines.append("}")
    return "\n".join(lines) + "\n"


def _literal(op: arith.ConstantOp, scalar: str) -> str:
    if isinstance(op.value, IntegerAttr):
        return str(op.value.value.data)
    text = repr(float(cast("FloatAttr", op.value).value.data))
    return f"splat({text})" if scalar == "V" else f"{text}"


def _expression(op: Operation, names: dict[SSAValue, str], scalar: str, math_prefix: str) -> str:
    operands = [names[v] for v in op.operands]
    if type(op) in INFIX:
        return f"{operands[0]} {INFIX[type(op)]} {operands[1]}"
    if isinstance(op, arith.NegfOp):
        return f"-{operands[0]}"
    if isinstance(op, arith.CmpfOp):
        return COMPARISONS[arith.CMPF_COMPARISON_OPERATIONS[op.predicate.value.data]].format(*operands)
    if type(op) in CHOICES:
        return CHOICES[type(op)].format(*operands)
    word = CALLS.get(type(op))
    if word is None:
        raise ValueError(f"the C++ emitter does not know {op.name}")
    if scalar == "V":
        return f"v_{word}({', '.join(operands)})"
    return f"{math_prefix}{word}({', '.join(operands)})"


def words_used(functions: Sequence[func.FuncOp]) -> list[str]:
    """Mathematical functions that these functions call."""
    return sorted({CALLS[type(inner)] for op in functions for inner in op.body.block.ops if type(inner) in CALLS})


def vector_function(word: str, has_vector_math: bool) -> str:
    """Definition of `v_<word>` on 8 lanes: libmvec where it is, else lane by lane."""
    arity = 2 if word in OF_TWO else 1
    parameters = ", ".join(f"V {p}" for p in "ab"[:arity])
    lanes = ", ".join(f"{p}[l]" for p in "ab"[:arity])
    call = f"__builtin_{word}({lanes})"
    by_lane = f"    V r;\n    for (int l = 0; l < 8; ++l) r[l] = {call};\n    return r;\n"
    if word in BUILT_IN or not has_vector_math:
        return f"static inline V v_{word}({parameters}) {{\n{by_lane}}}\n"
    v = "v" * arity
    whole, half = f"_ZGVeN8{v}_{word}", f"_ZGVdN4{v}_{word}"
    halves = ", ".join(f"((const V4*)&{p})[h]" for p in "ab"[:arity])
    return (
        f"#if defined(__AVX512F__)\n"
        f'extern "C" V {whole}({parameters});\n'
        f"static inline V v_{word}({parameters}) {{ return {whole}({', '.join('ab'[:arity])}); }}\n"
        f"#elif defined(__AVX2__)\n"
        f"typedef double V4 __attribute__((vector_size(32), may_alias));\n"
        f'extern "C" V4 {half}({", ".join(["V4"] * arity)});\n'
        f"static inline V v_{word}({parameters}) {{\n"
        f"    V r;\n    for (int h = 0; h < 2; ++h) ((V4*)&r)[h] = {half}({halves});\n    return r;\n}}\n"
        f"#else\n"
        f"static inline V v_{word}({parameters}) {{\n{by_lane}}}\n"
        f"#endif\n"
    )
