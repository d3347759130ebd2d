"""The kernel of an energy's derivatives: gather, derive, project, pull back, scatter, 8 instances at a time.

Local blocks go to the global matrix as they are made. A slot that is a target itself is written directly (cpp_scatter);
any other is expanded by its source's `pull` first (cpp_expand).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from yasps.backend.codegen.object_text import indented
from yasps.backend.codegen.scene_view import Slot
from yasps.backend.cpp.curvature import dense_hessian
from yasps.backend.cpp.scatter import scatter_gradient, scatter_hessian
from yasps.dialects.mat import shape_of
from yasps.dialects.rel import ApplyOp, DerivativeOp, ProjectOp, YieldDerivativeOp

if TYPE_CHECKING:
    from yasps.backend.cpp.object import CppObjectText


MOST_PACKS = 16
"""Packs whose Hessians are projected by one call: failing matrices of all of them are decomposed together."""
LARGEST_STACK = 1 << 17
"""Bytes of one kernel's arrays that hold several packs."""


def derivative_body(text: CppObjectText, derivative: DerivativeOp) -> list[str]:
    """Statements of the entry point `derive`."""
    terminator = derivative.body.block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    slots = [slot for read in text.scene.wrt(derivative) for slot in text.scene.slots(read)]
    n = sum(slot.size for slot in slots)
    capacity = sum(slot.capacity for slot in slots)
    derive = terminator.gradient.owner
    assert isinstance(derive, ApplyOp)
    entries = shape_of(derive.values[2])[0] if terminator.hessian is not None else 0
    project = _projection(derivative)
    curved = derivative.curved is not None
    if project is not None and not curved:
        return _in_batches(text, terminator, derive, project, slots)
    lines = _derive(text, derive, n, entries, [f"V middle[{entries}];"] if entries else [])
    scatter: list[str] = []
    if curved:
        scatter = dense_hessian(text, slots, capacity, "middle" if entries else None)
    elif entries:
        scatter = scatter_hessian(text, slots, n, capacity, "middle")
    if scatter:
        lines += ["if (sink->tiles) {", *indented(scatter), "}"]
    lines += scatter_gradient(text, slots, capacity)
    return [
        *text.compute_uniforms("V"),
        "for (long first = begin; first < end; first += 8) {",
        "    const long lanes = end - first < 8 ? end - first : 8;",
        *indented(text.declare("V")),
        *indented([*text.gather_pack(), *lines]),
        "}",
        "return -1;",
    ]


def _projection(derivative: DerivativeOp) -> ProjectOp | None:
    """The projection, if there is one. It need not be on the way to the Hessian: that may be zero and read nothing."""
    return next((op for op in derivative.body.block.ops if isinstance(op, ProjectOp)), None)


def _derive(
    text: CppObjectText, derive: ApplyOp, n: int, entries: int, declarations: list[str], *, is_projected: bool = False
) -> list[str]:
    """Energy, gradient and packed Hessian of one pack, and a return if they are not finite."""
    outputs = ["energy", "gradient", "middle", "deformation"][: len(derive.values)]
    lines = [f"V energy[1], gradient[{n}];", *declarations, text.call(derive, text.names(), outputs, "V")]
    lines.append(f"V check = sum_of_zeros(gradient, {n}) + energy[0] * 0.0;")
    if entries and not is_projected:  # projection looks at what it gets
        lines.append(f"check += sum_of_zeros(middle, {entries});")
    return [
        *lines,
        "if (any_not_finite(check))",
        "    for (long l = 0; l < lanes; ++l)",
        "        if (check[l] != 0.0) return first + l;",
    ]


def _in_batches(
    text: CppObjectText, terminator: YieldDerivativeOp, derive: ApplyOp, project: ProjectOp, slots: list[Slot]
) -> list[str]:
    """Derivatives of several packs, one projection of them all, then pull-back and scatter of each."""
    n, capacity = sum(slot.size for slot in slots), sum(slot.capacity for slot in slots)
    assert terminator.hessian is not None
    pull_back = terminator.hessian.owner
    entries = shape_of(project.packed)[0]
    names = {**text.names(), project.result: "middle"}
    sizes = {f"r{k}": size for k, size in enumerate(text.read_sizes())}
    kept = {names[v] for v in pull_back.inputs} & sizes.keys() if isinstance(pull_back, ApplyOp) else set()
    bytes_of_pack = 64 * (entries + sum(sizes[name] for name in kept))
    packs = max(1, min(MOST_PACKS, LARGEST_STACK // bytes_of_pack))
    width = project.width.value.data
    isotropic = project.deformation is not None
    scatter: list[str] = []
    packed = "middle"
    if isinstance(pull_back, ApplyOp):
        scatter += [f"V hessian[{shape_of(terminator.hessian)[0]}];", text.call(pull_back, names, ["hessian"], "V")]
        packed = "hessian"
    scatter += scatter_hessian(text, slots, n, capacity, packed)
    own = [f"V {name}[{size}];" for name, size in sizes.items() if name not in kept]
    shared = [f"V* const {name} = {name}_of[pack];" for name in sorted(kept)]
    middle = ["V* const middle = middle_of[pack];"]
    deformation = ["V* const deformation = deformation_of[pack];"] if isotropic else []
    lanes = "const long lanes = stop - first < 8 ? stop - first : 8;"
    entry = "project_isotropic((double*)middle_of, (const double*)deformation_of"
    entry = entry if isotropic else "project((double*)middle_of"
    each_pack = "for (long first = start, pack = 0; first < stop; first += 8, ++pack) {"
    return [
        *text.compute_uniforms("V"),
        f"V middle_of[{packs}][{entries}];",
        *([f"V deformation_of[{packs}][{width}];"] if isotropic else []),
        *(f"V {name}_of[{packs}][{sizes[name]}];" for name in sorted(kept)),
        # Where nothing is projected, one pack at a time: what it needs stays in the first-level cache.
        f"const long most = sink->mode == 2 ? 8 : {8 * packs};",
        "for (long start = begin; start < end; start += most) {",
        "    const long stop = end - start < most ? end : start + most;",
        f"    {each_pack}",
        *indented(
            indented(
                [
                    lanes,
                    *own,
                    *shared,
                    *text.gather_pack(),
                    *_derive(text, derive, n, entries, [*middle, *deformation], is_projected=True),
                ]
            )
        ),
        *indented(indented(scatter_gradient(text, slots, capacity))),
        "    }",
        "    if (!sink->tiles) continue;",
        f"    const long changed = sink->{entry}, {width}, (int)(stop - start), sink->mode);",
        "    if (changed < 0) return start - changed - 1;",
        "    *sink->projected += changed;",
        f"    {each_pack}",
        *indented(indented([lanes, *middle, *shared, *scatter])),
        "    }",
        "}",
        "return -1;",
    ]
