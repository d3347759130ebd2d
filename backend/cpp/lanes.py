"""What lies behind an energy's inputs, pulled back for the 8 instances of a pack at once.

Instances of a pack may read different members of a UNION. So the lanes are taken in turn, those of the same branches
together; the frontend sorts instances by their branches (the entry `branches`), so that most packs need one turn.
`X_value_lanes` and `X_pull_lanes` are `X_value` and `X_pull` for the instances own[0], ..., own[7]. The former takes
any; the latter those of one branch, which have the same leaves, and the columns of b are its packs.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from xdsl.ir import SSAValue

from yasps.backend.codegen.branches import branch_number, branch_of, may_be_direct
from yasps.backend.codegen.object_text import SELF, ObjectCode, object_code, size_of
from yasps.backend.codegen.preludes import PRELUDES
from yasps.backend.codegen.scene_view import Slot
from yasps.backend.codegen.slots import SlotRange, block, each, place, ranges_of
from yasps.dialects.rel import ApplyOp, AttributeOp, JacobianOp, ReadOp, UnionOp, YieldOp, YieldPullbackOp, name_of

if TYPE_CHECKING:
    from yasps.backend.codegen.expanding_text import LocalDerivative
    from yasps.backend.cpp.object import CppObjectText


ADDING_OBJECT = "_lanes"
"""Name of the object that adds what was derived for packs; names of users begin with a letter."""
ADDING = {
    "gradient": "const yasps_sink& sink, const LaneSlot* slots, long count, const int* kappa, long capacity, "
    "unsigned lanes, const V* gradient, const LaneRoom& room",
    "hessian": "const yasps_sink& sink, LaneSlot* slots, long count, const long* position, long capacity, "
    "unsigned lanes, const V* h, long n, const LaneRoom& room",
}
"""Its entries, and their parameters."""


# -- kernels of energies -----------------------------------------------------------------------------------


def declare_slots(text: CppObjectText, local: LocalDerivative) -> list[str]:
    """Declares `slots`, with what is the same for all packs, and `room`."""
    text.begin_with("backend/cpp/preludes/lanes.h")
    n = local.n
    lines = [f"LaneSlot slots[{len(local.slots)}] = {{}};"]
    for same in ranges_of(local.slots):
        slot = same.slot
        pull = []
        if not slot.is_direct:
            function, arguments = text.callee(_definition(text, slot.source), "pull_lanes")
            pull = [f"slot.pull = {function};", f"slot.arguments = {arguments};"]
        body = [
            f"LaneSlot& slot = slots[{same.first} + k];",
            *pull,
            f"slot.size = {slot.size};",
            f"slot.entry = {same.entry} + k * {slot.size};",
            f"slot.leaf = {same.leaf} + k * {slot.capacity};",
        ]
        lines += block(f"for (long k = 0; k < {same.count}; ++k)", body)
    heights = [max(slot.rows, slot.size) for slot in local.slots]
    entries = [sum(slot.size for slot in local.slots[:s]) for s in range(len(local.slots))]
    across = [sum(heights[: t + 1]) for t in range(len(heights))]
    largest = max(_largest_leaf(text, slot) for slot in local.slots)
    sizes = {
        "rows": max(slot.size * (n - entry) for slot, entry in zip(local.slots, entries, strict=True)),
        "left": sum(height * (n - entry) for height, entry in zip(heights, entries, strict=True)),
        "right": max(slot.size * width for slot, width in zip(local.slots, across, strict=True)),
        "both": max(height * width for height, width in zip(heights, across, strict=True)),
        "block": 2 * largest**2,
    }
    for name, size in sizes.items():
        lines += text.array(f"room_{name}", size)
    lines.append(f"int room_sizes[{local.capacity}];")
    lines.append(f"const LaneRoom room = {{{', '.join(f'room_{name}' for name in sizes)}, room_sizes}};")
    return lines


def fill_slots(text: CppObjectText, local: LocalDerivative) -> list[str]:
    """Statements that write to `slots` what the pack's instances first, ... read."""
    lines = []
    for same in ranges_of(local.slots):
        slot = same.slot
        body = ["LaneSlot& slot = slots[" + place(same.first, "k") + "];"]
        if slot.connectivity is None:
            is_own = text.slot_index(slot) == "i"
            body.append("own_instances(first, lanes, slot.of);" if is_own else "for (long& one : slot.of) one = 0;")
        else:
            indices = f"{text.bind('indices', slot.connectivity)} + first * {slot.arity} + {slot.position} + k"
            body.append(f"connected_instances({indices}, {slot.arity}, lanes, slot.of);")
        branch, _ = branch_of(text, slot.source, "slot.of[l]", 1)
        body.append(f"for (long l = 0; l < 8; ++l) slot.branch[l] = {branch};")
        lines += block(f"for (long k = 0; k < {same.count}; ++k)", body)
    return lines


def in_branches(local: LocalDerivative, lines: list[str]) -> list[str]:
    """Runs the lines for the lanes `same` of a pack that are of the same branches, those of all slots in turn."""
    count = len(local.slots)
    take = [
        f"LaneSlot taken[{count}];",
        f"const unsigned same = take_branches(slots, {count}, left, taken);",
        "left &= ~same;",
    ]
    return block("for (unsigned left = (1u << lanes) - 1; left;)", [*take, *lines])


def add_gradient(text: CppObjectText, local: LocalDerivative) -> list[str]:
    """Statements that add `gradient` of a pack to the global one."""
    count, capacity = len(local.slots), local.capacity
    kappa = f"sink.kappa + first * {capacity}, {capacity}"
    add = f"{_adding(text, 'gradient')}(sink, taken, {count}, {kappa}, same, gradient, room);"
    return [*fill_slots(text, local), *in_branches(local, [add])]


def add_hessian(text: CppObjectText, local: LocalDerivative, packed: str, direct: list[str]) -> list[str]:
    """Statements that add all blocks of a pack; direct: those that do so where all slots of all lanes are direct."""
    count = len(local.slots)
    place_of = f"sink.position + first * {local.pairs}, {local.capacity}"
    add = [f"{_adding(text, 'hessian')}(sink, taken, {count}, {place_of}, same, {packed}, {local.n}, room);"]
    if all(may_be_direct(text, slot.source) for slot in local.slots):
        head = f"if (same == (1u << lanes) - 1 && all_direct(taken, {count}))"
        add = [*block(head, direct), *block("else", add)]
    return [*fill_slots(text, local), *in_branches(local, add)]


def adding_object() -> ObjectCode:
    """What adds gradients and Hessians of packs: the same file for all kernels of all scenes."""
    paths = ("runtime/core/sink.h", *(f"backend/cpp/preludes/{name}.h" for name in ("kernel", "scatter", "lanes")))
    functions = [
        f'extern "C" void {SELF}_{entry}({parameters}) {{ add_{entry}_of_lanes({_names(parameters)}); }}\n'
        for entry, parameters in ADDING.items()
    ]
    texts = [PRELUDES[path] for path in (*paths, "backend/cpp/preludes/add_lanes.h")]
    return object_code(ADDING_OBJECT, "\n".join([*texts, *functions]), (), tuple(ADDING))


def _adding(text: CppObjectText, entry: str) -> str:
    """The function that adds gradients or Hessians of packs, declared."""
    code = text.emitter.codes.setdefault(ADDING_OBJECT, adding_object())
    function = f"{code.symbol}_{entry}"
    text.externs[f'extern "C" void {function}({ADDING[entry]});'] = None
    return function


def _names(parameters: str) -> str:
    """Of the parameters in a declaration."""
    return ", ".join(re.split(r"[ *&]", parameter)[-1] for parameter in parameters.split(", "))


def branches_entry(text: CppObjectText, local: LocalDerivative) -> None:
    """The entry `branches`: for each instance a number, the same for all that are of the same branches."""
    lines, count = branch_number(text, local.slots)
    if count == 1:
        return
    body = block("for (long i = begin; i < end; ++i)", [*lines, "out[i - begin] = (long)number;"])
    text.entry("branches", f"void {SELF}_branches(Arguments a, long begin, long end, long* out)", body)


def _definition(text: CppObjectText, source: str) -> str:
    """The object that pulls back to what is behind a source."""
    return text.scene.jacobians[source].symbol if source in text.scene.jacobians else source


def _largest_leaf(text: CppObjectText, slot: Slot) -> int:
    """Most unknowns of a block behind the slot."""
    sources = text.scene.branches(slot.source)
    assert sources is not None
    leaves = [size for source in sources for size in text.scene.leaf_sizes(source) or []]
    return max(slot.size, *leaves) if leaves else slot.size


# -- entries that they call --------------------------------------------------------------------------------


def value_lanes(text: CppObjectText, attribute: AttributeOp) -> None:
    """The entry `value_lanes` of a computed attribute."""
    first, terminator = attribute.body.block.first_op, attribute.body.block.last_op
    assert isinstance(terminator, YieldOp)
    producer = terminator.value.owner
    if isinstance(first, UnionOp):
        lines = _union_value(text, attribute)
    elif isinstance(producer, ReadOp):
        lines = [*SCRATCH, *text.read_pack(producer, "out", own="own"), *UNUSED]
    else:
        assert isinstance(producer, ApplyOp)
        gather = [*text.compute_uniforms("V"), *text.declare("V"), *text.gather_pack(own="own")]
        lines = [*gather, text.call(producer, text.names(), ["out"], "V")]
    text.function("value_lanes", lines)


SCRATCH = ("long of[8];", "const double* at[8];")
UNUSED = ("(void)of, (void)at, (void)own;",)


def _union_value(text: CppObjectText, attribute: AttributeOp) -> list[str]:
    """Statements that write the value of the member that each lane belongs to."""
    size = text.scene.size(attribute.symbol)
    offsets = text.bind("offsets", name_of(attribute.owner))
    lines = [*SCRATCH, f"V part[{size}];"]
    for k, member in enumerate(text.scene.union_members(attribute.symbol)):
        if text.scene.is_stored(member):
            read = text.gather(member, "part")
        else:
            function, arguments = text.callee(member, "value_lanes")
            read = [f"{function}({arguments}, of, part);"]
        head = f"if (const unsigned in = lanes_within(own, {offsets}[{k}], {offsets}[{k + 1}], of))"
        lines += block(head, [*read, f"take_lanes(in, part, {size}, out);"])
    return [*lines, *UNUSED]


def pull_lanes_of_union(text: CppObjectText, attribute: AttributeOp) -> None:
    """The entry `pull_lanes` of a UNION."""
    size = text.scene.size(attribute.symbol)
    offsets = text.bind("offsets", name_of(attribute.owner))
    copy = [f"copy_rows({size}, b, n, out);", f"sizes[0] = {size};", "return 1;"]
    lines = ["long of[8];"]
    for k, member in enumerate(text.scene.union_members(attribute.symbol)):
        pull = copy
        if not text.scene.is_direct(member) and not text.scene.is_constant(member):
            function, arguments = text.callee(_definition(text, member), "pull_lanes")
            inside = f"for (long l = 0; l < 8; ++l) of[l] = own[l] - {offsets}[{k}];"
            pull = [inside, f"return {function}({arguments}, of, b, n, out, sizes);"]
        lines += block(f"if (own[0] < {offsets}[{k + 1}])", pull)
    text.function("pull_lanes", [*lines, "(void)of;", "return 0;"])


def pull_lanes_of_jacobian(text: CppObjectText, jacobian: JacobianOp) -> None:
    """The entry `pull_lanes` of an attribute."""
    terminator = jacobian.body.block.last_op
    assert isinstance(terminator, YieldPullbackOp)
    call = terminator.cotangent.owner
    assert isinstance(call, ApplyOp)
    cotangent: SSAValue = jacobian.body.block.args[0]
    slots = [slot for read in text.scene.wrt(jacobian) for slot in text.scene.slots(read)]
    p, q, is_direct = size_of(cotangent), sum(slot.size for slot in slots), all(slot.is_direct for slot in slots)
    to = "out" if is_direct else "w"
    lines = [*text.compute_uniforms("V"), *text.declare("V"), *text.gather_pack(own="own")]
    if not is_direct:
        lines.append(f"V* const w = (V*)__builtin_alloca_with_align(sizeof(V) * {q} * n, 512);")
    column = [
        f"for (long k = 0; k < {p}; ++k) v[k] = b[k * n + c];",
        text.call(call, {**text.names(), cotangent: "v"}, ["x"], "V"),
        f"for (long k = 0; k < {q}; ++k) {to}[k * n + c] = x[k];",
    ]
    lines += [f"V v[{p}], x[{q}];", *block("for (long c = 0; c < n; ++c)", column)]
    rows = leaves = 0
    for same in ranges_of(slots):
        behind = text.scene.leaf_sizes(same.slot.source)
        assert behind is not None
        lines += _pull_range(text, same, behind, rows, leaves, is_copied=not is_direct)
        rows += same.count * sum(behind)
        leaves += same.count * len(behind)
    text.function("pull_lanes", [*lines, f"return {leaves};"])


def _pull_range(
    text: CppObjectText, same: SlotRange, behind: list[int], rows: int, leaves: int, *, is_copied: bool
) -> list[str]:
    """Statements that pull w back through the slots of a range, to rows and leaves of `out` from these on."""
    slot = same.slot

    def of(_: SlotRange, k: str) -> list[str]:
        given = f"w + ({place(same.entry, k, slot.size)}) * n"
        into = f"out + ({place(rows, k, sum(behind))}) * n"
        leaf = place(leaves, k, len(behind))
        if slot.is_direct:
            copy = [f"copy_rows({slot.size}, {given}, n, {into});"] if is_copied else []
            return [*copy, f"sizes[{leaf}] = {slot.size};"]
        function, arguments = text.callee(_definition(text, slot.source), "pull_lanes")
        if slot.connectivity is None:
            is_own = text.slot_index(slot) == "i"
            index = "for (long l = 0; l < 8; ++l) of[l] = " + ("own[l];" if is_own else "0;")
        else:
            indices = f"{text.bind('indices', slot.connectivity)} + {place(slot.position, k)}"
            index = f"instances_from({indices}, {slot.arity}, own, of);"
        return [index, f"{function}({arguments}, of, {given}, n, {into}, sizes + {leaf});"]

    return each(same, of)
