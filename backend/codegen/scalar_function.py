"""Scalar functions (`func`, `arith`, `math`) as C++ text."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
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
OF_THE_PRELUDE = frozenset({"sqrt", "fabs"})
"""Instructions, whose packs backend/cpp/preludes/kernel.h has; everything else is a function of the C library."""
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
    longest: int | None = None,
) -> str:
    """A C++ function of the values `scalar` (V, double or int) for the operation.

    `inputs` and `outputs` cut its arguments and results into arrays of these lengths; `math_prefix` stands before the
    names of mathematical functions of numbers. One of more than `longest` statements calls functions of fewer in turn.
    No result may lie where an argument does.
    """
    writer = _FunctionWriter(scalar, math_prefix, op, inputs, outputs)
    parameters = [f"const {scalar}* x{n}" for n in range(len(inputs))]
    parameters += [f"{scalar}* __restrict y{n}" for n in range(len(outputs))]
    parts = _parts(writer.statements, longest)
    bodies, kept = writer.bodies(parts)
    if len(bodies) == 1:
        return _definition(linkage, name, parameters, bodies[0])
    of_part = [*parameters, f"{scalar}* __restrict w"]
    texts = [_definition(f"static {NOT_INLINE}", f"{name}_{k}", of_part, body) for k, body in enumerate(bodies)]
    passed = ", ".join(parameter.rpartition(" ")[2] for parameter in of_part)
    calls = [f"{scalar} w[{max(kept, 1)}];", *(f"{name}_{k}({passed});" for k in range(len(bodies)))]
    return "\n".join([*texts, _definition(linkage, name, parameters, calls)])


NOT_INLINE = "__attribute__((noinline))"


def _parts(statements: Sequence[Operation], longest: int | None) -> list[Sequence[Operation]]:
    """Cut into parts of about equal length, of at most `longest` statements each."""
    count = 1 if longest is None else max(1, -(-len(statements) // longest))
    ends = [len(statements) * k // count for k in range(count + 1)]
    return [statements[start:end] for start, end in pairwise(ends)]


def _definition(linkage: str, name: str, parameters: Sequence[str], lines: Sequence[str]) -> str:
    body = "".join(f"    {line}\n" for line in lines)
    return f"{linkage} void {name}({', '.join(parameters)}) {{\n{body}}}\n"


class _FunctionWriter:
    """Statements of a function, and the names of its values."""

    def __init__(
        self, scalar: str, math_prefix: str, op: func.FuncOp, inputs: Sequence[int], outputs: Sequence[int]
    ) -> None:
        self.scalar = scalar
        self.math_prefix = math_prefix
        self.names: dict[SSAValue, str] = {}
        self.statements: list[Operation] = []
        arguments = iter(op.body.block.args)
        for number, length in enumerate(inputs):
            for k in range(length):
                self.names[next(arguments)] = f"x{number}[{k}]"
        for inner in op.body.block.ops:
            if isinstance(inner, func.ReturnOp):
                places = [f"y{n}[{k}]" for n, length in enumerate(outputs) for k in range(length)]
                self.returned = list(zip(places, inner.arguments, strict=True))
            elif isinstance(inner, arith.ConstantOp):
                self.names[inner.result] = _literal(inner, scalar)
            else:
                self.names[inner.results[0]] = f"t{len(self.names)}"
                self.statements.append(inner)

    def statement(self, op: Operation) -> str:
        """The declaration of what the operation computes."""
        kind = "auto" if isinstance(op, arith.CmpfOp) else self.scalar  # a truth value or a mask
        return (
            f"const {kind} {self.names[op.results[0]]} = {_expression(op, self.names, self.scalar, self.math_prefix)};"
        )

    def bodies(self, parts: Sequence[Sequence[Operation]]) -> tuple[list[list[str]], int]:
        """Statements of each part, where what a later part needs is kept in the array `w`, and the length of `w`.

        Results are stored as soon as they are there, so that they keep no register, and later parts read them there.
        Comparisons, which are no numbers to keep, are made in each part that needs them.
        """
        own = [_with_comparisons(part) for part in parts]
        last_use = {value: k for k, ops in enumerate(own) for op in ops for value in op.operands}
        places: dict[SSAValue, list[str]] = {}
        for place, value in self.returned:
            places.setdefault(value, []).append(place)
        bodies: list[list[str]] = []
        free: list[str] = []
        freed_after: list[list[str]] = [[] for _ in own]
        length = 0
        for k, ops in enumerate(own):
            lines: list[str] = []
            kept: dict[SSAValue, str] = {}
            for op in ops:
                lines.append(self.statement(op))
                if isinstance(op, arith.CmpfOp):
                    continue
                value = op.results[0]
                to = places.pop(value, [])
                if last_use.get(value, k) > k:
                    if not to:
                        if not free:
                            free.append(f"w[{length}]")
                            length += 1
                        to = [free.pop()]
                        freed_after[last_use[value]] += to
                    kept[value] = to[0]
                lines += [f"{place} = {self.names[value]};" for place in to]
            self.names |= kept
            free += freed_after[k]
            bodies.append(lines)
        bodies[-1] += [f"{place} = {self.names[value]};" for value, left in places.items() for place in left]
        return bodies, length


def _with_comparisons(part: Sequence[Operation]) -> list[Operation]:
    """The statements of a part with the comparisons that it needs, each before its first use."""
    own: dict[Operation, None] = {}
    for op in part:
        if isinstance(op, arith.CmpfOp):
            continue
        for value in op.operands:
            if isinstance(value.owner, arith.CmpfOp):
                own[value.owner] = None
        own[op] = None
    return list(own)


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
    """Functions of the C library that these functions call."""
    called = {CALLS[type(inner)] for op in functions for inner in op.body.block.ops if type(inner) in CALLS}
    return sorted(called - OF_THE_PRELUDE)


def vector_function(word: str, has_vector_math: bool) -> str:
    """Definition of `v_<word>` on 8 lanes: libmvec where it is, else lane by lane."""
    arity = 2 if word in OF_TWO else 1
    parameters = ", ".join(f"V {p}" for p in "ab"[:arity])
    lanes = ", ".join(f"{p}[l]" for p in "ab"[:arity])
    call = f"__builtin_{word}({lanes})"
    by_lane = f"    V r;\n    for (int l = 0; l < 8; ++l) r[l] = {call};\n    return r;\n"
    if not has_vector_math:
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
