"""One object of a compiled scene as one C++ file: gather, derive, project, pull back, scatter (architecture, 5).

Entry points of an object X:
- `X_value(a, i, out)`: the attribute on instance i;
- `X_batch(a, begin, end, out)`: the attribute on instances [begin, end);
- `X_pull(a, i, b, n, out)`: rows of J^T b for an attribute with Jacobian J on instance i and a matrix b of p rows and n
  packs of 8 columns, expanded down to the targets; returns how many rows there are;
- `X_second(a, i, v, out)`: packed Hessian of <v, h> of a nonlinear attribute h with respect to its boundary inputs;
- `X_curve(a, i, v, packed, step, width, to)`: the same expanded down to the targets, with the curvature of all that is
  behind, added to a packed triangle as expanding_text says;
- `X_derive(a, begin, end, sink)`: an energy's derivatives, added to the global gradient and Hessian.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from xdsl.ir import SSAValue

from yasps.backend.codegen.expanding_text import SIGNATURES, ExpandingText, LocalDerivative
from yasps.backend.codegen.object_text import SELF, ObjectEmitter, c_type, size_of
from yasps.backend.codegen.scalar_function import vector_function, words_used
from yasps.backend.codegen.scene_view import SceneView, Slot
from yasps.backend.codegen.slots import block
from yasps.backend.cpp.expand import NO_MEMORY, expand
from yasps.backend.cpp.lanes import (
    SCRATCH,
    branches_entry,
    pull_lanes_of_jacobian,
    pull_lanes_of_union,
    value_lanes,
)
from yasps.dialects.rel import (
    ApplyOp,
    AttributeOp,
    DataOp,
    DerivativeOp,
    JacobianOp,
    JoinOp,
    ObjectOp,
    ReadOp,
    RefOp,
    YieldOp,
    name_of,
)
from yasps.runtime.core.sink import LANES

LARGEST_STACK = 1 << 17
"""Bytes of an array of packs that lies on the stack: a thread may have as little as 2 MiB, for some dozens of them."""
BYTES_OF_A_PACK = 8 * LANES
OF_LANES = {
    "value_lanes": ("void", "V* out"),
    "pull_lanes": ("long", "const V* b, long n, V* out, int* sizes"),
}
"""Of each entry for any 8 instances, the result's type and the parameters after `a` and `own`."""


class CppEmitter(ObjectEmitter):
    """Emits C++ for the processor."""

    def __init__(self, scene: SceneView, has_vector_math: bool) -> None:
        super().__init__(scene)
        self.has_vector_math = has_vector_math

    def text_of(self, name: str, container: ObjectOp) -> CppObjectText:
        """The text of one object."""
        return CppObjectText(self, name, container, self.has_vector_math)


class CppObjectText(ExpandingText):
    """The text of one object, for packs of 8 instances."""

    linkage = 'extern "C"'
    local_linkage = "static inline"
    math_prefix = "__builtin_"
    longest_function = 3000  # beyond, compilers take time that grows with the square of a function's length
    column = "V"
    signatures: ClassVar = {**SIGNATURES, "pull": ("long", "const V* b, long n, V* out")}

    def __init__(self, emitter: ObjectEmitter, name: str, container: ObjectOp, has_vector_math: bool) -> None:
        super().__init__(emitter, name, container)
        self.has_vector_math = has_vector_math
        self.begin_with("runtime/core/sink.h", "backend/cpp/preludes/kernel.h")

    def splat_gathered(self) -> list[str]:
        """Packs of what `gather_scalar` gathered, the same in all lanes."""
        sizes = {f"r{k}": size for k, size in enumerate(self.read_sizes())}
        sizes |= {f"u{k}": size_of(call.values[0]) for k, call in enumerate(self.uniform_calls())}
        lines = []
        for name, size in sizes.items():
            lines.append(f"V {name}_pack[{size}];")
            lines.append(f"for (long e = 0; e < {size}; ++e) {name}_pack[e] = splat({name}[e]);")
        return lines

    def gather_pack(self, own: str | None = None) -> list[str]:
        """Gathers 8 instances into the declared arrays: those in the array `own`, else first, ...; lanes past the end
        repeat the last one."""
        lines = [*SCRATCH]
        for k, op in enumerate(self.reads()):
            lines += self.read_pack(op, f"r{k}", own)
        return [*lines, f"(void)of, (void)at{f', (void){own}' if own else ''};"]

    def read_pack(self, op: ReadOp, out: str, own: str | None = None) -> list[str]:
        """Statements that write a boundary read on the instances of `gather_pack` to the packs `out`."""
        own_instances = "own_instances(first, lanes, of);"
        if own is not None:
            own_instances = f"for (long l = 0; l < 8; ++l) of[l] = {own}[l];"
        if isinstance(op, DataOp):
            storage = self.scene.storages[name_of(op.storage)]
            if storage.owner != self.definition.owner:
                size, pointer = self.scene.size(storage.symbol), self.bind("storage", storage.symbol)
                return [f"for (long e = 0; e < {size}; ++e) {out}[e] = splat({pointer}[e]);"]
            return [own_instances, *self.gather(storage.symbol, out)]
        if isinstance(op, RefOp):
            return [own_instances, *self.gather(name_of(op.attribute), out)]
        if isinstance(op, JoinOp) and op.reduction is None:
            source, connectivity = name_of(op.source), self.scene.connectivities[name_of(op.connectivity)]
            if connectivity.variable is None:
                arity, size = connectivity.arity.value.data, self.scene.size(source)
                indices = self.bind("indices", connectivity.symbol)
                connected = f"connected_instances({indices} + first * {arity} + s, {arity}, lanes, of);"
                if own is not None:
                    connected = f"instances_from({indices} + s, {arity}, {own}, of);"
                gather = self.gather(source, f"{out} + s * {size}")
                return block(f"for (long s = 0; s < {arity}; ++s)", [connected, *gather])
        size = size_of(op.result)
        instance = "first + (l < lanes ? l : lanes - 1)" if own is None else f"{own}[l]"
        lines = [f"const long i = {instance};", f"double one[{size}];"]
        lines += self.read(op, "one", "double")
        lines += [f"for (long e = 0; e < {size}; ++e) {out}[e][l] = one[e];", "(void)i;"]
        return block("for (long l = 0; l < 8; ++l)", lines)

    def gather(self, source: str, out: str) -> list[str]:
        """Statements that write the numbers of the instances of[0], ..., of[7] of a source to the packs `out`."""
        if not self.scene.is_stored(source):
            function, arguments = self.callee(source, "value_lanes")
            return [f"{function}({arguments}, of, {out});"]
        return [
            "#pragma GCC unroll 8",
            f"for (long l = 0; l < 8; ++l) at[l] = {self.stored_row(source, 'of[l]')};",
            f"gather(at, {self.scene.size(source)}, {out});",
        ]

    def helpers(self) -> list[str]:
        """Mathematical functions of packs."""
        words = words_used(list(self.functions.values())) if any("V*" in part for part in self.parts) else []
        return [vector_function(word, self.has_vector_math) for word in words]

    # -- entries for any 8 instances -----------------------------------------------------------------------

    def signature(self, symbol: str, entry: str, scalar: str) -> str:
        if entry in OF_LANES:
            result, parameters = OF_LANES[entry]
            return f"{result} {symbol}(Arguments a, const long* own, {parameters})"
        return super().signature(symbol, entry, scalar)

    def attribute(self, attribute: AttributeOp) -> None:
        super().attribute(attribute)
        name = attribute.symbol
        if "call" in self.wanted and c_type(attribute.matrix_type) == "double":
            value_lanes(self, attribute)
        if self.scene.is_union(name) and self.scene.branches(name) and self.scene.pulled_in_lanes:
            pull_lanes_of_union(self, attribute)

    def jacobian(self, jacobian: JacobianOp) -> None:
        super().jacobian(jacobian)
        if self.scene.branches(name_of(jacobian.attribute)) and self.scene.pulled_in_lanes:
            pull_lanes_of_jacobian(self, jacobian)

    @property
    def reads_one_by_one(self) -> bool:
        return self.scene.read_one_by_one

    @property
    def pulls_one_by_one(self) -> bool:
        return self.scene.pulled_one_by_one

    # -- n packs of columns --------------------------------------------------------------------------------

    def columns(self, b: str, n: str) -> str:
        return f"{b}, {n}"

    def times(self, rows: str, n: str) -> str:
        if n == "1" or rows == "0":
            return rows
        return f"({rows}) * {n}" if " + " in rows else f"{rows} * {n}"

    def part_of_w(self, entry: str) -> str:
        return f"w + {self.times(entry, 'n')}"

    def transposed(self, call: ApplyOp, cotangent: SSAValue, q: int, *, is_direct: bool) -> list[str]:
        p, to = size_of(cotangent), "out" if is_direct else "w"
        names = {value: f"{name}_pack" for value, name in self.names().items()} | {cotangent: "v"}
        lines = self.gather_scalar("double")
        if not is_direct:
            lines.append(f"V* const w = (V*)__builtin_alloca_with_align(sizeof(V) * {q} * n, 512);")
        columns = [
            f"for (long k = 0; k < {p}; ++k) v[k] = b[k * n + c];",
            self.call(call, names, ["x"], "V"),
            f"for (long k = 0; k < {q}; ++k) {to}[k * n + c] = x[k];",
        ]
        return [
            *lines,
            *self.splat_gathered(),
            f"V v[{p}], x[{q}];",
            *block("for (long c = 0; c < n; ++c)", columns),
        ]

    def cotangent(self, entry: str, size: int) -> tuple[list[str], str]:
        fill = f"for (long e = 0; e < {size}; ++e) b[e] = splat(gradient[{entry} + e][l]);"
        return [f"V b[{size}];  // one column; the others are not looked at", fill], "b"

    def add_to_target(self, local: LocalDerivative, leaf: int, entry: int, size: int) -> str:
        return f"add_gradient(sink.gradient + kappa[{leaf}] - 1, gradient + {entry}, l, {size});"

    def array(self, name: str, count: int, or_else: str = NO_MEMORY) -> list[str]:
        """Declares so many packs, on the heap where they are many; or_else: the statement where memory runs out."""
        if count * BYTES_OF_A_PACK <= LARGEST_STACK:
            return [f"V {name}[{count}];"]
        return [*self.scratch(name, str(count), or_else), f"V* const {name} = memory_of_{name}.data;"]

    def scratch(self, name: str, count: str, or_else: str = NO_MEMORY) -> list[str]:
        """Declares `memory_of_` a name, so many packs on the heap."""
        return [f"const Scratch memory_of_{name}({count});", f"if (!memory_of_{name}.data) {or_else}"]

    # -- curvature, for one lane ---------------------------------------------------------------------------

    def expand_merged(self, slots: Sequence[Slot], triangle: str) -> list[str]:
        def add(s: int, t: int) -> str:
            rows = f"to, at[{t}], r, at[{s}], height{s}, block + r * across"
            return f"for (long r = 0; r < height; ++r) add_merged_row(packed, step, width, {rows});"

        # The entry `curve` returns nothing: there it shows as an instance that is not finite.
        nowhere = '{ packed[0] = __builtin_nan(""); return; }'
        or_else = NO_MEMORY if isinstance(self.definition, DerivativeOp) else nowhere
        return expand(self, slots, triangle, add, or_else=or_else)

    def declare_merged(self, rows: int) -> list[str]:
        if rows * (rows + 1) // 2 * BYTES_OF_A_PACK <= LARGEST_STACK:
            declared = [f"V triangle_of_lanes[{rows * (rows + 1) // 2}];"]
        else:  # mostly many rows are merged
            declared = [
                *self.scratch("triangle_of_lanes", "width * (width + 1) / 2"),
                "V* const triangle_of_lanes = memory_of_triangle_of_lanes.data;",
            ]
        return [
            *declared,
            "// Lanes that nobody reads hold nothing that is slow.",
            "for (long k = 0; k < width * (width + 1) / 2; ++k) triangle_of_lanes[k] = splat(0.0);",
            "double* const packed = (double*)triangle_of_lanes;",
            f"const long step = {LANES};",
        ]

    def project_merged(self) -> str:
        return "const long changed = sink.project(packed, (int)width, 1, sink.mode);"

    def use_of_changed(self) -> list[str]:
        return ["if (changed < 0) return changed == YASPS_NO_MEMORY ? changed : i;", "*sink.projected += changed;"]

    # -- entries -------------------------------------------------------------------------------------------

    def batch_calls_value(self, attribute: AttributeOp) -> bool:
        return _producer(attribute) is None

    def batch(self, attribute: AttributeOp, scalar: str) -> None:
        size, producer = self.scene.size(attribute.symbol), _producer(attribute)
        if producer is None:
            body = [f"for (long i = begin; i < end; ++i) {SELF}_value(a, i, out + i * {size});"]
        else:
            uniforms = self.compute_uniforms("V")
            pack = [*self.declare("V"), *self.gather_pack(), f"V y[{size}];"]
            pack += [self.call(producer, self.names(), ["y"], "V"), "for (long l = 0; l < lanes; ++l)"]
            pack.append(f"    for (long e = 0; e < {size}; ++e) out[(first + l) * {size} + e] = y[e][l];")
            body = [*uniforms, *over_packs(pack)]
        self.entry("batch", f"void {SELF}_batch(Arguments a, long begin, long end, {scalar}* out)", body)

    def derivative(self, derivative: DerivativeOp) -> None:
        from yasps.backend.cpp.derivative import derivative_body

        signature = f"long {SELF}_derive(Arguments a, long begin, long end, const yasps_sink* results)"
        local = LocalDerivative.of(self.scene, derivative)
        body = derivative_body(self, local)
        self.entry("derive", signature, ["const yasps_sink& sink = *results;", *body])
        if local.in_lanes:
            branches_entry(self, local)


def _producer(attribute: AttributeOp) -> ApplyOp | None:
    """The call that computes an attribute 8 instances at a time; None where they are read one by one."""
    terminator = attribute.body.block.last_op
    assert isinstance(terminator, YieldOp)
    producer = terminator.value.owner
    return producer if isinstance(producer, ApplyOp) and c_type(attribute.matrix_type) == "double" else None


def over_packs(lines: Sequence[str]) -> list[str]:
    """Runs the lines for packs of the instances [begin, end); `first` is the first, `lanes` their number."""
    lanes = "const long lanes = end - first < 8 ? end - first : 8;"
    return block("for (long first = begin; first < end; first += 8)", [lanes, *lines])
