"""One object of a compiled scene as one C++ file: gather, derive, project, pull back, scatter (architecture, 5).

Entry points of an object X:
- `X_value(a, i, out)`: the attribute on instance i;
- `X_batch(a, begin, end, out)`: the attribute on instances [begin, end);
- `X_pull(a, i, b, n, out)`: rows of J^T b for an attribute with Jacobian J on instance i and a matrix b of p rows and n
  packs of 8 columns, expanded down to the targets; returns how many rows there are;
- `X_second(a, i, v, out)`: packed Hessian of <v, h> of a nonlinear attribute h with respect to its boundary inputs;
- `X_curve(a, i, v, out, n)`: the same expanded down to the targets, with the curvature of all that is behind, added to
  the n x n matrix `out`;
- `X_derive(a, begin, end, sink)`: an energy's derivatives, added to the global gradient and Hessian.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from typing import ClassVar

from xdsl.ir import SSAValue

from yasps.backend.codegen.object_text import SELF, ObjectEmitter, ObjectText, c_type, size_of
from yasps.backend.codegen.scalar_function import vector_function, words_used
from yasps.backend.codegen.scene_view import SceneView, Slot
from yasps.backend.cpp.curvature import curve_body
from yasps.dialects.rel import (
    ApplyOp,
    AttributeOp,
    DataOp,
    DerivativeOp,
    JoinOp,
    ObjectOp,
    ReadOp,
    YieldOp,
    name_of,
)
from yasps.runtime.core import sink

PRELUDE = sink.TEXT + files("yasps.backend.cpp").joinpath("preludes", "kernel.h").read_text(encoding="utf-8")


class CppEmitter(ObjectEmitter):
    """Emits C++ for the processor."""

    def __init__(self, scene: SceneView, has_vector_math: bool) -> None:
        super().__init__(scene)
        self.has_vector_math = has_vector_math

    def text_of(self, name: str, container: ObjectOp) -> CppObjectText:
        """The text of one object."""
        return CppObjectText(self, name, container, self.has_vector_math)


class CppObjectText(ObjectText):
    """The text of one object, for packs of 8 instances."""

    linkage = 'extern "C"'
    local_linkage = "static inline"
    math_prefix = "__builtin_"
    signatures: ClassVar[dict[str, tuple[str, str]]] = {
        "value": ("void", "{}*"),
        "pull": ("long", "const V*, long, V*"),
        "second": ("void", "const double*, double*"),
        "curve": ("long", "const double*, double*, long"),
    }

    def __init__(self, emitter: ObjectEmitter, name: str, container: ObjectOp, has_vector_math: bool) -> None:
        super().__init__(emitter, name, container)
        self.has_vector_math = has_vector_math
        self.preludes[PRELUDE] = None

    def splat_gathered(self) -> list[str]:
        """Packs of what `gather_scalar` gathered, the same in all lanes."""
        sizes = {f"r{k}": size for k, size in enumerate(self.read_sizes())}
        sizes |= {f"u{k}": size_of(call.values[0]) for k, call in enumerate(self.uniform_calls())}
        lines = []
        for name, size in sizes.items():
            lines.append(f"V {name}_pack[{size}];")
            lines.append(f"for (long e = 0; e < {size}; ++e) {name}_pack[e] = splat({name}[e]);")
        return lines

    def gather_pack(self) -> list[str]:
        """Gathers 8 instances into the declared arrays; lanes past the end repeat the last one."""
        lines = ["long at[8];"]
        for k, op in enumerate(self.reads()):
            lines += self.read_pack(op, f"r{k}")
        return [*lines, "(void)at;"]

    def read_pack(self, op: ReadOp, out: str) -> list[str]:
        """Statements that write a boundary read on the instances first, ... to the packs `out`."""
        if isinstance(op, DataOp):
            storage = self.scene.storages[name_of(op.storage)]
            size, pointer = self.scene.size(storage.symbol), self.bind("storage", storage.symbol)
            if storage.owner != self.definition.owner:
                return [f"for (long e = 0; e < {size}; ++e) {out}[e] = splat({pointer}[e]);"]
            return [f"own_offsets(first, lanes, {size}, at);", f"gather({pointer}, at, {size}, {out});"]
        if isinstance(op, JoinOp) and name_of(op.source) in self.scene.storages and op.reduction is None:
            source, connectivity = name_of(op.source), self.scene.connectivities[name_of(op.connectivity)]
            if connectivity.variable is None:
                arity, size = connectivity.arity.value.data, self.scene.size(source)
                indices, pointer = self.bind("indices", connectivity.symbol), self.bind("storage", source)
                return [
                    f"for (long s = 0; s < {arity}; ++s) {{",
                    f"    connected_offsets({indices} + first * {arity} + s, {arity}, lanes, {size}, at);",
                    f"    gather({pointer}, at, {size}, {out} + s * {size});",
                    "}",
                ]
        size = size_of(op.result)
        return [
            "for (long l = 0; l < 8; ++l) {",
            "    const long i = first + (l < lanes ? l : lanes - 1);",
            f"    double one[{size}];",
            *(f"    {line}" for line in self.read(op, "one", "double")),
            f"    for (long e = 0; e < {size}; ++e) {out}[e][l] = one[e];",
            "    (void)i;",
            "}",
        ]

    def helpers(self) -> list[str]:
        """Mathematical functions of packs."""
        words = words_used(list(self.functions.values())) if any("V*" in part for part in self.parts) else []
        return [vector_function(word, self.has_vector_math) for word in words]

    def attribute(self, attribute: AttributeOp) -> None:
        scalar = c_type(attribute.matrix_type)
        terminator = attribute.body.block.last_op
        assert isinstance(terminator, YieldOp)
        producer = terminator.value.owner
        size = size_of(terminator.value)
        packs = isinstance(producer, ApplyOp) and scalar == "double"
        if "call" in self.wanted or ("batch" in self.wanted and not packs):
            body = self.value_body(attribute, scalar)
            self.entry("value", f"void {SELF}_value(Arguments a, long i, {scalar}* out)", body)
        if "batch" in self.wanted:
            signature = f"void {SELF}_batch(Arguments a, long begin, long end, {scalar}* out)"
            if packs:
                assert isinstance(producer, ApplyOp)
                body = [*self.compute_uniforms("V"), "for (long first = begin; first < end; first += 8) {"]
                body += ["    const long lanes = end - first < 8 ? end - first : 8;"]
                body += [f"    {line}" for line in [*self.declare("V"), *self.gather_pack()]]
                body += [f"    V y[{size}];", f"    {self.call(producer, self.names(), ['y'], 'V')}"]
                body += ["    for (long l = 0; l < lanes; ++l)"]
                body += [f"        for (long e = 0; e < {size}; ++e) out[(first + l) * {size} + e] = y[e][l];", "}"]
            else:
                body = [f"for (long i = begin; i < end; ++i) {SELF}_value(a, i, out + i * {size});"]
            self.entry("batch", signature, body)
        if self.scene.is_union(attribute.symbol) and self.scene.reaches_target(attribute.symbol):
            self.entry(
                "pull",
                f"long {SELF}_pull(Arguments a, long i, const V* b, long n, V* out)",
                [
                    *self.in_member(attribute, lambda name: f"return {self.pull_source(name, 'j', 'b', 'n', 'out')};"),
                    "return 0;",
                ],
            )

        if self.scene.is_union(attribute.symbol) and self.scene.is_curved(attribute.symbol):
            signature = f"long {SELF}_curve(Arguments a, long i, const double* v, double* out, long n)"
            body = self.in_member(attribute, lambda name: f"return {self.curve_source(name, 'j', 'v', 'out', 'n')};")
            self.entry("curve", signature, [*body, "return 0;"])

    def curve_source(self, source: str, index: str, v: str, out: str, n: str) -> str:
        """Expression that adds the curvature behind `source`, contracted with v, to `out`."""
        if not self.scene.is_curved(source):
            return "0"
        definition = self.scene.jacobians[source].symbol if source in self.scene.jacobians else source
        function, arguments = self.callee(definition, "curve")
        return f"{function}({arguments}, {index}, {v}, {out}, {n})"

    def over_connected(self, slot: Slot, body: str) -> str:
        """Statement: runs `body` for every connected instance j of a slot of variable arity; `count` is how many."""
        indices = self.bind("indices", slot.connectivity or "")
        here = f"{indices}[i * {slot.arity} + count]"
        return (
            f"long count = 0; while (count < {slot.arity} && {here} >= 0) "
            f"{{ const long j = {here}; (void)j; {body} ++count; }}"
        )

    def pull_slot(self, slot: Slot, b: str, n: str, out: str) -> str:
        """As pull_source for what a slot reads: of a sum every term gets b, of a mean its share."""
        if slot.reduction is None:
            return self.pull_source(slot.source, self.slot_index(slot), b, n, out)
        given = f"const V* const from = {b}; V* const into = {out}; const long beside = {n}; long reached = 0;"
        pull = self.pull_source(slot.source, "j", "from", "beside", "into + reached * beside")
        share = (
            "for (long e = 0; e < reached * beside; ++e) into[e] /= (double)count;" if slot.reduction == "mean" else ""
        )
        return f"({{ {given} {self.over_connected(slot, f'reached += {pull};')} {share} reached; }})"

    def curve_slot(self, slot: Slot, v: str, out: str, n: str) -> str:
        """As curve_source for what a slot reads."""
        if slot.reduction is None:
            return self.curve_source(slot.source, self.slot_index(slot), v, out, n)
        given = f"const double* const whole = {v}; double* const into = {out}; const long across = {n};"
        terms = f"double share[{slot.size}]; long reached = 0, terms = 1;"
        if slot.reduction == "mean":
            terms += f" {{ {self.over_connected(slot, '')} terms = count; }}"
        terms += f" for (long e = 0; e < {slot.size}; ++e) share[e] = whole[e] / terms;"
        rows = self.pull_source(slot.source, "j", "(const V*)0", "0", "(V*)0")
        curve = self.curve_source(slot.source, "j", "share", "into + reached * (across + 1)", "across")
        return f"({{ {given} {terms} {self.over_connected(slot, f'{curve}; reached += {rows};')} reached; }})"

    def pull_source(self, source: str, index: str, b: str, n: str, out: str) -> str:
        """Expression that writes the rows behind `source` and says how many they are."""
        if source in self.scene.targets:
            size = self.scene.size(source)
            self.externs[COPY_ROWS] = None
            return f"copy_rows({size}, {b}, {n}, {out})"
        if not self.scene.reaches_target(source):
            return "0"
        definition = self.scene.jacobians[source].symbol if source in self.scene.jacobians else source
        function, arguments = self.callee(definition, "pull")
        return f"{function}({arguments}, {index}, {b}, {n}, {out})"

    def pull(self, call: ApplyOp, cotangent: SSAValue, slots: Sequence[Slot]) -> None:
        p, q = size_of(cotangent), sum(slot.size for slot in slots)
        direct = all(slot.is_target for slot in slots)
        lines = self.gather_scalar("double")
        to = "out"
        if not direct:
            lines.append(f"V* const w = (V*)__builtin_alloca_with_align(sizeof(V) * {q} * n, 512);")
            to = "w"
        lines += self.splat_gathered()
        names = {value: f"{name}_pack" for value, name in self.names().items()} | {cotangent: "v"}
        lines += [
            f"V v[{p}], x[{q}];",
            "for (long c = 0; c < n; ++c) {",
            f"    for (long k = 0; k < {p}; ++k) v[k] = b[k * n + c];",
            f"    {self.call(call, names, ['x'], 'V')}",
            f"    for (long k = 0; k < {q}; ++k) {to}[k * n + c] = x[k];",
            "}",
        ]
        if direct:
            lines.append(f"return {q};")
        else:
            lines.append("long rows = 0;")
            start = 0
            for slot in slots:
                pull = self.pull_slot(slot, f"w + {start} * n", "n", "out + rows * n")
                lines.append(f"rows += {pull};")
                start += slot.size
            lines.append("return rows;")
        self.entry("pull", f"long {SELF}_pull(Arguments a, long i, const V* b, long n, V* out)", lines)

    def curve(self, slots: Sequence[Slot], second: str | None, transposed: Sequence[str]) -> None:
        signature = f"long {SELF}_curve(Arguments a, long i, const double* v, double* out, long n)"
        self.entry("curve", signature, curve_body(self, slots, second, transposed))

    def derivative(self, derivative: DerivativeOp) -> None:
        from yasps.backend.cpp.derivative import derivative_body

        self.entry(
            "derive",
            f"long {SELF}_derive(Arguments a, long begin, long end, const yasps_sink* sink)",
            derivative_body(self, derivative),
        )


COPY_ROWS = """static inline long copy_rows(long rows, const V* b, long n, V* out) {
    for (long k = 0; k < rows * n; ++k) out[k] = b[k];
    return rows;
}
"""
