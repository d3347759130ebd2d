"""What the texts of all generated objects have in common, whatever language they are in: reading, and finding others.

A file says nothing about the scene it is for: what it reads comes through `a`, an array of pointers filled when the
program is loaded, and it calls other objects by the hash of their text. So equal energies of two meshes, or of two
scenes, are one object file, and a cached object is found again under any name.
"""

from __future__ import annotations

import hashlib
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from xdsl.dialects.builtin import IntegerType
from xdsl.dialects.func import FuncOp
from xdsl.ir import SSAValue

from yasps.backend.codegen.preludes import PRELUDES
from yasps.backend.codegen.scalar_function import function_text
from yasps.backend.codegen.scene_view import SceneView, Slot
from yasps.backend.codegen.slots import block, indented, place
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
    YieldOp,
    name_of,
)

SELF = "@SELF@"


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
    """One generated file.

    On a device, workspace: doubles of global memory that a thread of the entry `derive` needs; branches: how many
    numbers the entry `branches` gives, 0 where there is none.
    """

    name: str
    symbol: str
    text: str
    bindings: tuple[Binding, ...]
    entries: tuple[str, ...]
    workspace: int = 0
    branches: int = 0


def object_code(
    name: str,
    text: str,
    bindings: tuple[Binding, ...],
    entries: tuple[str, ...],
    *,
    workspace: int = 0,
    branches: int = 0,
) -> ObjectCode:
    """The file with this text, where SELF stands for its symbol."""
    symbol = "yasps_" + hashlib.sha256(text.encode()).hexdigest()[:20]
    return ObjectCode(name, symbol, text.replace(SELF, symbol), bindings, entries, workspace, branches)


class ObjectEmitter(ABC):
    """Emits the objects of one scene, each once, callees first."""

    def __init__(self, scene: SceneView) -> None:
        self.scene = scene
        self.codes: dict[str, ObjectCode] = {}
        """By the symbol of the definition."""

    def emit_all(self) -> list[ObjectCode]:
        """The code of all objects that are run over all instances, and of those that they call."""
        for name, container in self.scene.objects.items():
            if any(entry.data == "batch" for entry in container.entries):
                self.code_of(name)
        return list(self.codes.values())

    def code_of(self, name: str) -> ObjectCode:
        """The code of the object that defines this symbol."""
        if name not in self.codes:
            self.codes[name] = self.text_of(name, self.scene.objects[name]).finish()
        return self.codes[name]

    @abstractmethod
    def text_of(self, name: str, container: ObjectOp) -> ObjectText:
        """The text of one object, in the emitter's language."""


def c_type(type_: Matrix) -> str:
    """The type of one entry."""
    return "int" if isinstance(type_.element_type, IntegerType) else "double"


def size_of(value: SSAValue) -> int:
    """Entries of a matrix."""
    rows, cols = shape_of(value)
    return rows * cols


class ObjectText(ABC):
    """The text of one object while it is written."""

    linkage: ClassVar[str]
    """What stands before functions that other files call."""
    local_linkage: ClassVar[str]
    """What stands before functions of this file alone."""
    math_prefix: ClassVar[str]
    """What stands before the names of mathematical functions of one number."""
    longest_function: ClassVar[int | None]
    """Statements of a function of numbers that are not divided among several, if there is a limit."""
    signatures: ClassVar[dict[str, tuple[str, str]]]
    """Of each kind of entry that other objects call, the result's type and the parameters after `a` and `i`."""

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
        self.preludes: dict[str, None] = {}
        """What the file begins with."""
        self.externs: dict[str, None] = {}
        """Declarations of other objects' entries, and functions that several of its own share."""
        self.parts: list[str] = []
        self.entries: list[str] = []
        self.workspace = self.branches = 0

    def begin_with(self, *paths: str) -> None:
        """Puts these of the PRELUDES at the beginning of the file, once."""
        self.preludes |= dict.fromkeys(PRELUDES[path] for path in paths)

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
        if entry not in code.entries:
            raise ValueError(f"@{definition} has no entry {entry!r}")
        function = f"{code.symbol}_{entry}"
        scalar = c_type(self.scene.type_of(definition)) if entry == "value" else ""
        self.externs[f"{self.linkage} {self.signature(function, entry, scalar)};"] = None
        return function, self.bind("arguments", definition)

    def copy_source(self, source: str, index: str, out: str, scalar: str) -> str:
        """Statement that writes the entries of a source at an instance to `out`, an array of `scalar`."""
        size = self.scene.size(source)
        if source in self.scene.storages:
            pointer = self.bind("storage", source)
            return f"for (long e = 0; e < {size}; ++e) {out}[e] = {pointer}[{index} * {size} + e];"
        if self.scene.is_stored(source):
            row = f"const double* const row = {self.stored_row(source, index)};"
            return f"{{ {row} for (long e = 0; e < {size}; ++e) {out}[e] = row[e]; }}"
        function, arguments = self.callee(source, "value")
        return f"{function}({arguments}, {index}, {out});"

    def stored_row(self, source: str, index: str) -> str:
        """Expression for where the numbers of a storage, or UNION of storages, are at an instance."""
        if source in self.scene.storages:
            return f"{self.bind('storage', source)} + {index} * {self.scene.size(source)}"
        offsets = self.bind("offsets", name_of(self.scene.attributes[source].owner))
        *members, last = [
            self.stored_row(member, f"({index} - {offsets}[{k}])" if k else index)
            for k, member in enumerate(self.scene.union_members(source))
        ]
        chosen = [f"{index} < {offsets}[{k}] ? {row} : " for k, row in enumerate(members, start=1)]
        return f"({''.join(chosen)}{last})"

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
            return block(f"for (long s = 0; s < {arity}; ++s)", [f"const long j = {indices}[i * {arity} + s];", copy])
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
        lines = [f"for (long e = 0; e < {size_of(op.result)}; ++e) {out}[e] = 0;", "{", "    long count = 0;"]
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
        """Boundary reads that differ from instance to instance, if anything uses them."""
        reads = [op for op in self.definition.body.block.ops if isinstance(op, ReadOp)]
        return [op for op in reads if any(use.operation not in self.uniform_calls() for use in op.result.uses)]

    def uniform_calls(self) -> list[ApplyOp]:
        """Calls whose results are the same for all instances."""
        ops = self.definition.body.block.ops
        return [op for op in ops if isinstance(op, ApplyOp) and op.uniform is not None]

    def compute_uniforms(self, scalar: str) -> list[str]:
        """Statements that declare what is the same for all instances and compute it: arrays u0, u1, ..., of V too."""
        lines = []
        for k, call in enumerate(self.uniform_calls()):
            pointers: dict[SSAValue, str] = {}
            for value in call.inputs:
                assert isinstance(value.owner, DataOp)
                pointers[value] = self.bind("storage", name_of(value.owner.storage))
            size, name = size_of(call.values[0]), f"u{k}_one" if scalar == "V" else f"u{k}"
            lines += [f"double {name}[{size}];", self.call(call, pointers, [name], "double")]
            if scalar == "V":
                lines += [f"V u{k}[{size}];", f"for (long e = 0; e < {size}; ++e) u{k}[e] = splat({name}[e]);"]
        return lines

    def read_sizes(self) -> list[int]:
        """Entries of each boundary read."""
        return [size_of(op.result) for op in self.reads()]

    def declare(self, scalar: str) -> list[str]:
        return [f"{scalar} r{k}[{size}];" for k, size in enumerate(self.read_sizes())]

    def gather_scalar(self, scalar: str) -> list[str]:
        lines = [*self.compute_uniforms(scalar), *self.declare(scalar)]
        for k, op in enumerate(self.reads()):
            lines += self.read(op, f"r{k}", scalar)
        return lines

    def names(self) -> dict[SSAValue, str]:
        """Arrays of what calls take: r0, r1, ... read for the instance, u0, u1, ... the same for all."""
        read: dict[SSAValue, str] = {op.result: f"r{k}" for k, op in enumerate(self.reads())}
        return read | {call.values[0]: f"u{k}" for k, call in enumerate(self.uniform_calls())}

    def define_function(self, call: ApplyOp, scalar: str) -> str:
        """Defines the function of the call for this scalar type; returns its C++ name."""
        function = self.functions[name_of(call.function)]
        word = name_of(call.function).rsplit(".", 1)[-1]
        suffix = {"V": "pack", "double": "one", "int": "index"}[scalar]
        inputs, outputs = [size_of(v) for v in call.inputs], [size_of(v) for v in call.values]
        text = function_text(
            function,
            f"{word}_{suffix}",
            scalar,
            inputs=inputs,
            outputs=outputs,
            linkage=self.local_linkage,
            math_prefix=self.math_prefix,
            longest=self.longest_function,
        )
        if text not in self.parts:
            self.parts.append(text)
        return f"{word}_{suffix}"

    def call(self, call: ApplyOp, names: dict[SSAValue, str], outputs: Sequence[str], scalar: str) -> str:
        name = self.define_function(call, scalar)
        return f"{name}({', '.join([*(names[v] for v in call.inputs), *outputs])});"

    # -- entry points --------------------------------------------------------------------------------------

    def signature(self, symbol: str, entry: str, scalar: str) -> str:
        """The head of a function that other objects call."""
        result, parameters = self.signatures[entry]
        return f"{result} {symbol}(Arguments a, long i, {parameters.format(scalar)})"

    def function(self, entry: str, body: Sequence[str], scalar: str = "") -> None:
        """Adds an entry that other objects call."""
        self.entry(entry, self.signature(f"{SELF}_{entry}", entry, scalar), body)

    def entry(self, name: str, signature: str, body: Sequence[str], linkage: str | None = None) -> None:
        """Adds a function; `signature` without what stands before."""
        self.entries.append(name)
        text = "\n".join(indented(body))
        self.parts.append(f"{linkage or self.linkage} {signature} {{\n{self.pointers()}{text}\n}}\n")

    def finish(self) -> ObjectCode:
        """The whole file."""
        if isinstance(self.definition, DerivativeOp):
            self.derivative(self.definition)
        elif isinstance(self.definition, JacobianOp):
            self.jacobian(self.definition)
        elif isinstance(self.definition, CurvatureOp):
            self.curvature(self.definition)
        else:
            self.attribute(self.definition)
        text = "\n".join([*self.preludes, *self.helpers(), *self.externs, *self.parts])
        bindings, entries = tuple(self.bindings), tuple(self.entries)
        return object_code(self.name, text, bindings, entries, workspace=self.workspace, branches=self.branches)

    @abstractmethod
    def helpers(self) -> list[str]:
        """Functions that the file's own functions call, known when those are written."""

    @abstractmethod
    def attribute(self, attribute: AttributeOp) -> None:
        """Entries of a computed attribute."""

    @abstractmethod
    def jacobian(self, jacobian: JacobianOp) -> None:
        """Entries of an attribute's Jacobian."""

    @abstractmethod
    def curvature(self, curvature: CurvatureOp) -> None:
        """Entries of a nonlinear attribute's second derivatives."""

    @abstractmethod
    def derivative(self, derivative: DerivativeOp) -> None:
        """Entries of an energy's derivatives."""

    def value_body(self, attribute: AttributeOp, scalar: str) -> list[str]:
        """Statements that write the value on instance i to `out`."""
        first, terminator = attribute.body.block.first_op, attribute.body.block.last_op
        assert isinstance(terminator, YieldOp)
        if isinstance(first, UnionOp):
            return self.union_value(attribute, scalar)
        producer = terminator.value.owner
        if isinstance(producer, ReadOp):
            return self.read(producer, "out", scalar)
        assert isinstance(producer, ApplyOp)
        return [*self.gather_scalar(scalar), self.call(producer, self.names(), ["out"], scalar)]

    def in_member(self, attribute: AttributeOp, statement: Callable[[str], str]) -> list[str]:
        """Runs what `statement` gives for the member of a UNION that instance i belongs to, as instance j."""
        offsets = self.bind("offsets", name_of(attribute.owner))
        lines = []
        for k, member in enumerate(self.scene.union_members(attribute.symbol)):
            text = statement(member)
            index = f"const long j = i - {offsets}[{k}]; " if re.search(r"\bj\b", text) else ""
            lines.append(f"if (i < {offsets}[{k + 1}]) {{ {index}{text} }}")
        return lines

    def union_value(self, attribute: AttributeOp, scalar: str) -> list[str]:
        """Statements that write the value of the member that instance i belongs to, filled up with zeros."""
        size = self.scene.size(attribute.symbol)

        def of(member: str) -> str:
            padding = "".join(f" out[{e}] = 0;" for e in range(self.scene.size(member), size))
            return f"{self.copy_source(member, 'j', 'out', scalar)}{padding} return;"

        return self.in_member(attribute, of)

    def slot_index(self, slot: Slot, k: str = "") -> str:
        """Which instance the slot, or slot k of those that begin with it, reads."""
        if slot.connectivity is None:
            own = (
                slot.source not in self.scene.storages
                or self.scene.storages[slot.source].owner == self.definition.owner
            )
            return "i" if own else "0L"
        indices = self.bind("indices", slot.connectivity)
        return f"(long){indices}[i * {slot.arity} + {place(slot.position, k)}]"
