"""What lies behind the inputs of an energy or Jacobian: pulled back to the targets, written once for both languages.

On a processor `pull` takes a matrix of n packs of 8 columns, on a device one vector; so what it takes and gives is
written by `columns`, `times` and `part_of_w`, which know what n is for. The rest is the same: entries of UNIONs and
Jacobians, the gradient behind slots, and curvature, which is added to a packed upper triangle in which leaves with one
place are merged: row r of a source is row to[r] of the triangle, and entry k stands at packed[k * step].
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from xdsl.ir import SSAValue

from yasps.backend.codegen.object_text import ObjectText, c_type, size_of
from yasps.backend.codegen.scene_view import SceneView, Slot
from yasps.backend.codegen.slots import SlotRange, block, each, place, ranges_of
from yasps.dialects.rel import (
    ApplyOp,
    AttributeOp,
    CurvatureOp,
    DerivativeOp,
    JacobianOp,
    ProjectOp,
    YieldCurvatureOp,
    YieldDerivativeOp,
    YieldPullbackOp,
    name_of,
)

SIGNATURES: dict[str, tuple[str, str]] = {
    "value": ("void", "{}* out"),
    "second": ("void", "const double* v, double* out"),
    "curve": ("void", "const double* v, double* packed, long step, long width, const int* to"),
}
"""As `ObjectText.signatures`, but for `pull`."""


@dataclass(frozen=True)
class LocalDerivative:
    """An energy's derivatives on one instance.

    n: entries of the gradient; capacity: leaves of kappa; derive: the call that computes `outputs`, arrays of these
    sizes by name; hessian: what is scattered, or None; project: the projection. It need not be on the way to the
    Hessian: that may be zero and read nothing.
    """

    slots: list[Slot]
    n: int
    capacity: int
    derive: ApplyOp
    outputs: dict[str, int]
    hessian: SSAValue | None
    project: ProjectOp | None
    curved: bool
    in_lanes: bool
    """Is something to be pulled back, and can that be done for several instances at once?"""

    @staticmethod
    def of(scene: SceneView, derivative: DerivativeOp) -> LocalDerivative:
        """What `derivative` says."""
        terminator = derivative.body.block.last_op
        assert isinstance(terminator, YieldDerivativeOp)
        slots = [slot for read in scene.wrt(derivative) for slot in scene.slots(read)]
        derive = terminator.gradient.owner
        assert isinstance(derive, ApplyOp)
        n = sum(slot.size for slot in slots)
        outputs = dict(zip(("energy", "gradient", "middle", "deformation"), map(size_of, derive.values), strict=False))
        outputs["gradient"] = n
        return LocalDerivative(
            slots,
            n,
            sum(slot.capacity for slot in slots),
            derive,
            outputs,
            terminator.hessian,
            next((op for op in derivative.body.block.ops if isinstance(op, ProjectOp)), None),
            derivative.curved is not None,
            scene.runs_in_lanes(derivative) and not all(slot.is_direct for slot in slots),
        )

    @property
    def pairs(self) -> int:
        """Blocks of an instance: pairs of leaves."""
        return self.capacity * (self.capacity + 1) // 2


class ExpandingText(ObjectText):
    """The text of one object whose inputs may be computed from the targets."""

    column: ClassVar[str]
    """Type of what `pull` has of each row."""

    # -- what n packs of columns mean in the language ------------------------------------------------------

    def columns(self, b: str, n: str) -> str:
        """Arguments that pass the matrix b."""
        return b

    def times(self, rows: str, n: str) -> str:
        """How many numbers, or packs, so many rows have."""
        return rows

    @abstractmethod
    def part_of_w(self, entry: str) -> str:
        """The rows of `w` from this one on, in the entry `pull`."""

    @abstractmethod
    def transposed(self, call: ApplyOp, cotangent: SSAValue, q: int, *, is_direct: bool) -> list[str]:
        """Statements of the entry `pull`: the q rows of J^T b, written to `out` if direct, else to `w`."""

    @property
    def reads_one_by_one(self) -> bool:
        """Does anything read numbers of other objects for single instances?"""
        return True

    @property
    def pulls_one_by_one(self) -> bool:
        """Does any energy pull back for single instances?"""
        return True

    # -- what else the languages do differently ------------------------------------------------------------

    @abstractmethod
    def batch(self, attribute: AttributeOp, scalar: str) -> None:
        """The entry `batch` of a computed attribute."""

    def batch_calls_value(self, attribute: AttributeOp) -> bool:
        """Whether that needs the entry `value`."""
        return True

    @abstractmethod
    def add_to_target(self, local: LocalDerivative, leaf: int, entry: int, size: int) -> str:
        """Statement that adds entries of `gradient` to the unknowns of a target."""

    def cotangent(self, entry: str, size: int) -> tuple[list[str], str]:
        """Entries of `gradient` as a matrix of one column: declarations, and a pointer to it."""
        return [], f"gradient + {entry}"

    @abstractmethod
    def expand_merged(self, slots: Sequence[Slot], triangle: str) -> list[str]:
        """Adds J^T H J to the packed triangle `packed`, for the H with this upper triangle; needs `at` and `to`."""

    @abstractmethod
    def declare_merged(self, rows: int) -> list[str]:
        """Declares `packed` and `step`, a merged triangle of at most so many rows, here `width`, that holds zeros."""

    @abstractmethod
    def project_merged(self) -> str:
        """Declares `changed`, what the projection of `packed` gives."""

    @abstractmethod
    def use_of_changed(self) -> list[str]:
        """Reports an instance that is not finite, or counts a projected one."""

    # -- entries -------------------------------------------------------------------------------------------

    def attribute(self, attribute: AttributeOp) -> None:
        scalar, name = c_type(attribute.matrix_type), attribute.symbol
        is_called = "call" in self.wanted and (self.reads_one_by_one or scalar == "int")
        if is_called or ("batch" in self.wanted and self.batch_calls_value(attribute)):
            self.function("value", self.value_body(attribute, scalar), scalar)
        if "batch" in self.wanted:
            self.batch(attribute, scalar)
        if self.scene.is_union(name) and self.scene.reaches_target(name) and self.pulls_one_by_one:
            pull = self.in_member(attribute, lambda source: f"return {self.pull_source(source, 'j', 'b', 'n', 'out')};")
            self.function("pull", [*pull, "return 0;"])
        if self.scene.is_union(name) and self.scene.is_curved(name):
            curve = self.in_member(attribute, lambda source: f"{self.curve_source(source, 'j', 'v', 'to')} return;")
            self.function("curve", curve)

    def jacobian(self, jacobian: JacobianOp) -> None:
        terminator = jacobian.body.block.last_op
        assert isinstance(terminator, YieldPullbackOp)
        call = terminator.cotangent.owner
        assert isinstance(call, ApplyOp)
        cotangent = jacobian.body.block.args[0]
        slots = [slot for read in self.scene.wrt(jacobian) for slot in self.scene.slots(read)]
        if self.pulls_one_by_one:
            self.pull(call, cotangent, slots)
        name = name_of(jacobian.attribute)
        if not self.scene.is_curved(name):
            return
        q = sum(slot.size for slot in slots)
        lines = self.row_starts(slots)
        if name in self.scene.curvatures:
            function, arguments = self.callee(self.scene.curvatures[name].symbol, "second")
            lines += [f"double second[{q * (q + 1) // 2}];", f"{function}({arguments}, i, v, second);"]
            lines += self.expand_merged(slots, "second")
        if behind := self.curve_behind(slots, "w"):
            compute = self.call(call, {**self.names(), cotangent: "v"}, ["w"], "double")
            lines += [*self.gather_scalar("double"), f"double w[{q}];", compute, *behind]
        self.function("curve", lines)

    def pull(self, call: ApplyOp, cotangent: SSAValue, slots: Sequence[Slot]) -> None:
        """The entry `pull` of an attribute whose J^T v is computed by `call` for the vector v = `cotangent`."""

        def of(same: SlotRange, k: str) -> list[str]:
            given = self.part_of_w(place(same.entry, k, same.slot.size))
            return self.pull_slot(same.slot, k, given, "n", f"out + {self.times('rows', 'n')}", into="rows +=")

        q, is_direct = sum(slot.size for slot in slots), all(slot.is_target for slot in slots)
        lines = self.transposed(call, cotangent, q, is_direct=is_direct)
        if not is_direct:
            lines += ["long rows = 0;", *(line for same in ranges_of(slots) for line in each(same, of))]
        self.function("pull", [*lines, f"return {q if is_direct else 'rows'};"])

    def curvature(self, curvature: CurvatureOp) -> None:
        terminator = curvature.body.block.last_op
        assert isinstance(terminator, YieldCurvatureOp)
        call = terminator.hessian.owner
        assert isinstance(call, ApplyOp)
        names = {**self.names(), curvature.body.block.args[0]: "v"}
        self.function("second", [*self.gather_scalar("double"), self.call(call, names, ["out"], "double")])

    # -- what lies behind a source, and behind a slot ------------------------------------------------------

    def pull_source(self, source: str, index: str, b: str, n: str, out: str) -> str:
        """Expression that writes the rows of J^T b behind `source` and says how many they are; without b they are only
        counted."""
        if source in self.scene.targets:
            return f"copy_rows({self.scene.size(source)}, {self.columns(b, n)}, {out})"
        if not self.scene.reaches_target(source):
            return "0"
        definition = self.scene.jacobians[source].symbol if source in self.scene.jacobians else source
        function, arguments = self.callee(definition, "pull")
        return f"{function}({arguments}, {index}, {self.columns(b, n)}, {out})"

    def curve_source(self, source: str, index: str, v: str, to: str) -> str:
        """Statement that adds the curvature behind `source`, contracted with v, to the triangle."""
        if not self.scene.is_curved(source):
            return ""
        definition = self.scene.jacobians[source].symbol if source in self.scene.jacobians else source
        function, arguments = self.callee(definition, "curve")
        return f"{function}({arguments}, {index}, {v}, packed, step, width, {to});"

    def over_connected(self, slot: Slot, lines: Sequence[str]) -> list[str]:
        """Runs `lines` for every connected instance j of a slot of variable arity; `connected` counts them."""
        here = f"{self.bind('indices', slot.connectivity or '')}[i * {slot.arity} + connected]"
        head = f"for (; connected < {slot.arity} && {here} >= 0; ++connected)"
        body = block(head, [f"const long j = {here};", *lines]) if lines else [f"{head} {{}}"]
        return ["long connected = 0;", *body]

    def pull_slot(self, slot: Slot, k: str, b: str, n: str, out: str, *, into: str) -> list[str]:
        """As pull_source for what the slot, or slot k of those that begin with it, reads.

        Of a sum every term gets b, of a mean its share. into: the left side of a statement that the number of rows is
        the right side of, such as `rows +=` or `const long height =`; empty where nobody asks.
        """
        if slot.reduction is None:
            return [f"{into} {self.pull_source(slot.source, self.slot_index(slot, k), b, n, out)};".lstrip()]
        lines = [f"const {self.column}* const from = {b};", f"{self.column}* const into = {out};", "long terms = 0;"]
        pull = self.pull_source(slot.source, "j", "from", n, f"into + {self.times('terms', n)}")
        lines += self.over_connected(slot, [f"terms += {pull};"])
        if slot.reduction == "mean":
            lines.append(f"for (long e = 0; from && e < {self.times('terms', n)}; ++e) into[e] /= (double)connected;")
        declared, name = into.removesuffix(" ="), into.rpartition("long ")[2]
        lines.append(f"{name} terms;" if into else "(void)terms;")
        return [*([f"{declared.removeprefix('const ')};"] if name != into else []), *block("", lines)]

    def curve_slot(self, slot: Slot, k: str, v: str, to: str) -> list[str]:
        """As curve_source for what the slot, or slot k of those that begin with it, reads."""
        if slot.reduction is None:
            return [self.curve_source(slot.source, self.slot_index(slot, k), v, to)]
        lines = [f"double share[{slot.size}];", "long reached = 0, terms = 1;"]
        if slot.reduction == "mean":
            lines += block("", [*self.over_connected(slot, []), "terms = connected;"])
        lines.append(f"for (long e = 0; e < {slot.size}; ++e) share[e] = ({v})[e] / (double)terms;")
        count = self.pull_source(slot.source, "j", f"(const {self.column}*)0", "0", f"({self.column}*)0")
        curve = self.curve_source(slot.source, "j", "share", f"{to} + reached")
        return block("", [*lines, *self.over_connected(slot, [curve, f"reached += {count};"])])

    # -- what lies behind all slots ------------------------------------------------------------------------

    def row_starts(self, slots: Sequence[Slot]) -> list[str]:
        """Declares `at`: where each slot's rows start when all slots are expanded to the targets, and their number."""

        def of(same: SlotRange, k: str) -> list[str]:
            into = f"at[{place(same.first + 1, k)}] = at[{place(same.first, k)}] +"
            return self.pull_slot(same.slot, k, f"(const {self.column}*)0", "0", f"({self.column}*)0", into=into)

        self.begin_with("backend/codegen/preludes/merge.h")
        lines = [f"long at[{len(slots) + 1}];", "at[0] = 0;"]
        return lines + [line for same in ranges_of(slots) for line in each(same, of)]

    def curve_behind(self, slots: Sequence[Slot], v: str) -> list[str]:
        """Adds the curvature behind all slots, contracted with their parts of v."""

        def of(same: SlotRange, k: str) -> list[str]:
            part = f"{v} + {place(same.entry, k, same.slot.size)}"
            return self.curve_slot(same.slot, k, part, f"to + at[{place(same.first, k)}]")

        curved = [same for same in ranges_of(slots) if self.scene.is_curved(same.slot.source)]
        return [line for same in curved for line in each(same, of)]

    def scatter_gradient(self, local: LocalDerivative) -> list[str]:
        """Statements that add `gradient` to the global one, at `kappa` of instance i."""

        def expanded(same: SlotRange, k: str) -> list[str]:
            slot = same.slot
            declared, b = self.cotangent(place(same.entry, k, slot.size), slot.size)
            pull = self.pull_slot(slot, k, b, "1", "rows", into="")
            begin, end = (place(leaf, k, slot.capacity) for leaf in (same.leaf, same.leaf + slot.capacity))
            add = f"add_gradient_rows(sink, kappa, i, {local.capacity}, {begin}, {end}, rows);"
            return [f"{self.column} rows[{slot.rows}];", *declared, *pull, add]

        lines: list[str] = []
        for same in ranges_of(local.slots):
            size = same.slot.size
            if same.slot.is_direct:
                for k in range(same.count):
                    leaf = same.leaf + k
                    add = self.add_to_target(local, leaf, same.entry + k * size, size)
                    lines.append(add if same.slot.is_target else f"if (kappa[{leaf}]) {add}")
            elif same.slot.rows:
                self.begin_with("backend/codegen/preludes/expand.h")
                lines += each(same, expanded, scope=True)
        return lines

    def merged_hessian(self, local: LocalDerivative, triangle: str | None, gradient: str) -> list[str]:
        """The local Hessian of an energy of nonlinear parameterisations: expanded to the targets, projected as a whole
        and scattered. triangle: of the Hessian with respect to the inputs, None if that is zero."""
        rows = max(1, sum(slot.rows for slot in local.slots))
        return [
            f"int leaf[{local.capacity}], start[{local.capacity + 1}], to[{rows}];",
            f"const long leaves = merge_leaves(sink, kappa, {local.capacity}, leaf, start, to), width = start[leaves];",
            *self.declare_merged(rows),
            *self.row_starts(local.slots),
            *(self.expand_merged(local.slots, triangle) if triangle else []),
            *self.curve_behind(local.slots, gradient),
            self.project_merged(),
            *self.use_of_changed(),
            f"scatter_merged(sink, position, {local.capacity}, leaves, leaf, start, packed, step);",
        ]
