"""One object of a compiled scene as one C++ file: gather, derive, project, pull back, scatter (architecture, 5).

A file says nothing about the scene it is for: what it reads comes through `a`, an array of pointers filled when the
program is loaded, and it calls other objects by the hash of their text. So equal energies of two meshes, or of two
scenes, are one object file, and a cached object is found again under any name.

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

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

from xdsl.dialects.builtin import IntegerType
from xdsl.dialects.func import FuncOp
from xdsl.ir import SSAValue

from yasps.backend.cpp_curvature import curve_body
from yasps.backend.cpp_function import function_text, vector_function, words_used
from yasps.backend.scene_view import SceneView, Slot
from yasps.dialects.mat import Matrix, shape_of
from yasps.dialects.rel import (
    ApplyOp,
    AttributeOp,
    CurvatureOp,
    DataOp,
    DerivativeOp,
    JacobianOp,
    JoinOp,
    ObjectOp,
    ReadOp,
    RefOp,
    TargetIndexOp,
    UnionOp,
    YieldCurvatureOp,
    YieldJacobianOp,
    YieldOp,
    name_of,
)

SELF = "@SELF@"
PRELUDE = files("yasps.backend").joinpath("kernel_prelude.h").read_text(encoding="utf-8")


@dataclass(frozen=True)
class Binding:
    """What one entry of an object's pointer array points to.

    kind: "storage" (doubles), "indices" (a connectivity's int32), "offsets" (int64 prefix sums of a primitive union),
    "start" (one int64: where a target starts in the gradient) or "arguments" (the pointer array of another object).
    """

    kind: str
    name: str


@dataclass(frozen=True)
class ObjectCode:
    """One generated file."""

    name: str
    symbol: str
    text: str
    bindings: tuple[Binding, ...]
    entries: tuple[str, ...]


class ObjectEmitter:
    """Emits the objects of one scene, each once, callees first."""

    def __init__(self, scene: SceneView, has_vector_math: bool) -> None:
        self.scene = scene
        self.has_vector_math = has_vector_math
        self.codes: dict[str, ObjectCode] = {}
        """By the symbol of the definition."""

    def emit_all(self) -> list[ObjectCode]:
        for name in self.scene.objects:
            self.code_of(name)
        return list(self.codes.values())

    def code_of(self, name: str) -> ObjectCode:
        if name not in self.codes:
            self.codes[name] = _ObjectText(self, name, self.scene.objects[name]).finish()
        return self.codes[name]


def _c_type(type_: Matrix) -> str:
    return "int" if isinstance(type_.element_type, IntegerType) else "double"


def _size(value: SSAValue) -> int:
    rows, cols = shape_of(value)
    return rows * cols


class _ObjectText:
    def __init__(self, emitter: ObjectEmitter, name: str, container: ObjectOp) -> None:
        self.emitter = emitter
        self.scene = emitter.scene
        self.name = name
        self.wanted = [entry.data for entry in container.entries]
        ops = list(container.body.block.ops)
        self.definition = next(
            op for op in ops if isinstance(op, AttributeOp | DerivativeOp | JacobianOp | CurvatureOp)
        )
        self.functions = {op.sym_name.data: op for op in ops if isinstance(op, FuncOp)}
        self.bindings: list[Binding] = []
        self.externs: dict[str, None] = {}
        """Declarations of other objects' entries, and functions that several of its own share."""
        self.preludes: dict[str, None] = {PRELUDE: None}
        """What the file begins with."""
        self.parts: list[str] = []
        self.entries: list[str] = []

    # -- what the object reads -----------------------------------------------------------------------------

    def bind(self, kind: str, name: str) -> str:
        """C++ name of the pointer to this."""
        binding = Binding(kind, name)
        if binding not in self.bindings:
            self.bindings.append(binding)
        return f"p{self.bindings.index(binding)}"

    def pointers(self) -> str:
        """Declarations of all bound pointers, to stand at the start of each entry point."""
        types = {
            "storage": "const double*",
            "indices": "const int*",
            "offsets": "const long*",
            "start": "const long*",
            "arguments": "Arguments",
        }
        lines = [f"    {types[b.kind]} const p{k} = ({types[b.kind]})a[{k}];\n" for k, b in enumerate(self.bindings)]
        return "".join(lines)

    def callee(self, definition: str, entry: str) -> tuple[str, str]:
        """Function and argument pointer to call another object's entry."""
        code = self.emitter.code_of(definition)
        function = f"{code.symbol}_{entry}"
        parameters = {
            "value": f"{_c_type(self.scene.type_of(definition))}*" if entry == "value" else "",
            "pull": "const V*, long, V*",
            "second": "const double*, double*",
            "curve": "const double*, double*, long",
        }[entry]
        result = "void" if entry in {"value", "second"} else "long"
        signature = f"{result} {function}(Arguments, long, {parameters})"
        self.externs[f'extern "C" {signature};'] = None
        return function, self.bind("arguments", definition)

    def copy_source(self, source: str, index: str, out: str, scalar: str) -> str:
        """Statement that writes the entries of a source at an instance to `out`, an array of `scalar`."""
        size = self.scene.size(source)
        if source in self.scene.storages:
            pointer = self.bind("storage", source)
            return f"for (long e = 0; e < {size}; ++e) {out}[e] = {pointer}[{index} * {size} + e];"
        function, arguments = self.callee(source, "value")
        return f"{function}({arguments}, {index}, {out});"

    def read(self, op: ReadOp, out: str, scalar: str) -> list[str]:
        """Statements that write a boundary read on instance i to `out`."""
        if isinstance(op, DataOp):
            storage = self.scene.storages[name_of(op.storage)]
            own = storage.owner == self.definition.owner
            return [self.copy_source(storage.symbol, "i" if own else "0L", out, scalar)]
        if isinstance(op, JoinOp):
            source, connectivity = name_of(op.source), self.scene.connectivities[name_of(op.connectivity)]
            arity, size = connectivity.arity.value.data, self.scene.size(source)
            indices = self.bind("indices", connectivity.symbol)
            if connectivity.variable is not None:
                return self.read_variable(op, out, scalar, indices=indices, arity=arity)
            copy = self.copy_source(source, "j", f"({out} + s * {size})", scalar)
            return [
                f"for (long s = 0; s < {arity}; ++s) {{",
                f"    const long j = {indices}[i * {arity} + s];",
                f"    {copy}",
                "}",
            ]
        if isinstance(op, RefOp):
            return [self.copy_source(name_of(op.attribute), "i", out, scalar)]
        if isinstance(op, TargetIndexOp):
            target = self.scene.storages[name_of(op.target)]
            start = self.bind("start", target.symbol)
            own = target.owner == self.definition.owner
            offset = f" + {self.scene.size(target.symbol)} * i" if own else ""
            return [f"{out}[0] = (int)({start}[0]{offset} + 1);"]
        raise ValueError(f"{op.name} can't be gathered")

    def read_variable(self, op: JoinOp, out: str, scalar: str, *, indices: str, arity: int) -> list[str]:
        """A JOIN of variable arity: sum or mean of the values, or all placement indices padded with 0."""
        source = name_of(op.source)
        size = self.scene.size(source)
        lines = [f"for (long e = 0; e < {_size(op.result)}; ++e) {out}[e] = 0;", "{", "    long count = 0;"]
        lines += [f"    while (count < {arity} && {indices}[i * {arity} + count] >= 0) {{"]
        lines += [f"        const long j = {indices}[i * {arity} + count];"]
        if op.reduction is None:
            lines += [f"        {self.copy_source(source, 'j', f'({out} + count * {size})', scalar)}"]
        else:
            lines += [f"        {scalar} term[{size}];", f"        {self.copy_source(source, 'j', 'term', scalar)}"]
            lines += [f"        for (long e = 0; e < {size}; ++e) {out}[e] += term[e];"]
        lines += ["        ++count;", "    }"]
        if op.reduction == "mean":
            lines += [f"    for (long e = 0; e < {size}; ++e) {out}[e] /= count;"]
        return [*lines, "    (void)count;", "}"]

    # -- bodies --------------------------------------------------------------------------------------------

    def reads(self) -> list[ReadOp]:
        return [op for op in self.definition.body.block.ops if isinstance(op, ReadOp)]

    def read_sizes(self) -> list[int]:
        """Entries of each boundary read."""
        return [_size(op.result) for op in self.reads()]

    def declare(self, scalar: str) -> list[str]:
        return [f"{scalar} r{k}[{size}];" for k, size in enumerate(self.read_sizes())]

    def gather_scalar(self, scalar: str) -> list[str]:
        lines = self.declare(scalar)
        for k, op in enumerate(self.reads()):
            lines += self.read(op, f"r{k}", scalar)
        return lines

    def splat_gathered(self) -> list[str]:
        """Packs of what `gather_scalar` gathered, the same in all lanes."""
        lines = []
        for k, size in enumerate(self.read_sizes()):
            lines.append(f"V r{k}_pack[{size}];")
            lines.append(f"for (long e = 0; e < {size}; ++e) r{k}_pack[e] = splat(r{k}[e]);")
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
        size = _size(op.result)
        return [
            "for (long l = 0; l < 8; ++l) {",
            "    const long i = first + (l < lanes ? l : lanes - 1);",
            f"    double one[{size}];",
            *(f"    {line}" for line in self.read(op, "one", "double")),
            f"    for (long e = 0; e < {size}; ++e) {out}[e][l] = one[e];",
            "    (void)i;",
            "}",
        ]

    def names(self) -> dict[SSAValue, str]:
        return {op.result: f"r{k}" for k, op in enumerate(self.reads())}

    def define_function(self, call: ApplyOp, scalar: str) -> str:
        """Defines the function of the call for this scalar type; returns its C++ name."""
        function = self.functions[name_of(call.function)]
        word = name_of(call.function).rsplit(".", 1)[-1]
        suffix = {"V": "pack", "double": "one", "int": "index"}[scalar]
        inputs, outputs = [_size(v) for v in call.inputs], [_size(v) for v in call.values]
        text = function_text(function, f"{word}_{suffix}", scalar, inputs, outputs)
        if text not in self.parts:
            self.parts.append(text)
        return f"{word}_{suffix}"

    def call(self, call: ApplyOp, names: dict[SSAValue, str], outputs: Sequence[str], scalar: str) -> str:
        name = self.define_function(call, scalar)
        return f"{name}({', '.join([*(names[v] for v in call.inputs), *outputs])});"

    # -- entry points --------------------------------------------------------------------------------------

    def entry(self, name: str, signature: str, body: Sequence[str]) -> None:
        self.entries.append(name)
        text = "\n".join(f"    {line}" for line in body)
        self.parts.append(f'extern "C" {signature} {{\n{self.pointers()}{text}\n}}\n')

    def finish(self) -> ObjectCode:
        if isinstance(self.definition, DerivativeOp):
            self.derivative(self.definition)
        elif isinstance(self.definition, JacobianOp):
            self.jacobian(self.definition)
        elif isinstance(self.definition, CurvatureOp):
            self.curvature(self.definition)
        else:
            self.attribute(self.definition)
        words = words_used(list(self.functions.values())) if any("V*" in part for part in self.parts) else []
        helpers = [vector_function(word, self.emitter.has_vector_math) for word in words]
        text = "\n".join([*self.preludes, *helpers, *self.externs, *self.parts])
        symbol = "yasps_" + hashlib.sha256(text.encode()).hexdigest()[:20]
        return ObjectCode(self.name, symbol, text.replace(SELF, symbol), tuple(self.bindings), tuple(self.entries))

    def attribute(self, attribute: AttributeOp) -> None:
        c_type = _c_type(attribute.matrix_type)
        terminator = attribute.body.block.last_op
        assert isinstance(terminator, YieldOp)
        producer = terminator.value.owner
        size = _size(terminator.value)
        packs = isinstance(producer, ApplyOp) and c_type == "double"
        if "call" in self.wanted or ("batch" in self.wanted and not packs):
            body = self.value_body(attribute, c_type)
            self.entry("value", f"void {SELF}_value(Arguments a, long i, {c_type}* out)", body)
        if "batch" in self.wanted:
            signature = f"void {SELF}_batch(Arguments a, long begin, long end, {c_type}* out)"
            if packs:
                assert isinstance(producer, ApplyOp)
                body = ["for (long first = begin; first < end; first += 8) {"]
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
                self.union_pull(attribute),
            )

        if self.scene.is_union(attribute.symbol) and self.scene.is_curved(attribute.symbol):
            signature = f"long {SELF}_curve(Arguments a, long i, const double* v, double* out, long n)"
            self.entry("curve", signature, self.union_curve(attribute))

    def value_body(self, attribute: AttributeOp, c_type: str) -> list[str]:
        first, terminator = attribute.body.block.first_op, attribute.body.block.last_op
        assert isinstance(terminator, YieldOp)
        if isinstance(first, UnionOp):
            return self.union_value(attribute, c_type)
        producer = terminator.value.owner
        if isinstance(producer, ReadOp):
            return self.read(producer, "out", c_type)
        assert isinstance(producer, ApplyOp)
        return [*self.gather_scalar(c_type), self.call(producer, self.names(), ["out"], c_type)]

    def branches(self, attribute: AttributeOp) -> tuple[str, list[str]]:
        """Pointer to the union's prefix sums, and the members in order."""
        members = self.scene.union_members(attribute.symbol)
        return self.bind("offsets", name_of(attribute.owner)), members

    def union_value(self, attribute: AttributeOp, c_type: str) -> list[str]:
        offsets, members = self.branches(attribute)
        size = self.scene.size(attribute.symbol)
        lines = []
        for k, member in enumerate(members):
            copy = self.copy_source(member, "j", "out", c_type)
            padding = "".join(f" out[{e}] = 0;" for e in range(self.scene.size(member), size))
            lines.append(
                f"if (i < {offsets}[{k + 1}]) {{ const long j = i - {offsets}[{k}]; {copy}{padding} return; }}"
            )
        return lines

    def union_pull(self, attribute: AttributeOp) -> list[str]:
        offsets, members = self.branches(attribute)
        lines = []
        for k, member in enumerate(members):
            pull = self.pull_source(member, "j", "b", "n", "out")
            lines.append(
                f"if (i < {offsets}[{k + 1}]) {{ const long j = i - {offsets}[{k}]; (void)j; return {pull}; }}"
            )
        return [*lines, "return 0;"]

    def union_curve(self, attribute: AttributeOp) -> list[str]:
        offsets, members = self.branches(attribute)
        lines = []
        for k, member in enumerate(members):
            curve = self.curve_source(member, "j", "v", "out", "n")
            lines.append(
                f"if (i < {offsets}[{k + 1}]) {{ const long j = i - {offsets}[{k}]; (void)j; return {curve}; }}"
            )
        return [*lines, "return 0;"]

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

    def slot_index(self, slot: Slot) -> str:
        if slot.connectivity is None:
            own = (
                slot.source not in self.scene.storages
                or self.scene.storages[slot.source].owner == self.definition.owner
            )
            return "i" if own else "0L"
        indices = self.bind("indices", slot.connectivity)
        return f"(long){indices}[i * {slot.arity} + {slot.position}]"

    def jacobian(self, jacobian: JacobianOp) -> None:
        block = jacobian.body.block
        terminator = block.last_op
        assert isinstance(terminator, YieldJacobianOp)
        call = terminator.jacobian.owner
        assert isinstance(call, ApplyOp)
        cotangent = block.args[0]
        p, q = _size(cotangent), _size(terminator.jacobian)
        slots = [slot for read in self.scene.wrt(jacobian) for slot in self.scene.slots(read)]
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
        name = name_of(jacobian.attribute)
        if self.scene.is_curved(name):
            second = None
            if name in self.scene.curvatures:
                function, arguments = self.callee(self.scene.curvatures[name].symbol, "second")
                second = f"{function}({arguments}, i, v, second);"
            transposed = self.gather_scalar("double")
            transposed += [f"double w[{q}];", self.call(call, {**self.names(), cotangent: "v"}, ["w"], "double")]
            signature = f"long {SELF}_curve(Arguments a, long i, const double* v, double* out, long n)"
            self.entry("curve", signature, curve_body(self, slots, second, transposed))

    def curvature(self, curvature: CurvatureOp) -> None:
        block = curvature.body.block
        terminator = block.last_op
        assert isinstance(terminator, YieldCurvatureOp)
        call = terminator.hessian.owner
        assert isinstance(call, ApplyOp)
        names = {**self.names(), block.args[0]: "v"}
        lines = [*self.gather_scalar("double"), self.call(call, names, ["out"], "double")]
        self.entry("second", f"void {SELF}_second(Arguments a, long i, const double* v, double* out)", lines)

    def derivative(self, derivative: DerivativeOp) -> None:
        from yasps.backend.cpp_derivative import derivative_body

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
