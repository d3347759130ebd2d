"""The kernel of an energy's derivatives: gather, derive, project, pull back, scatter, 8 instances at a time.

Local blocks go to the global matrix as they are made. A slot that is a target itself is written directly (scatter.py),
any other is expanded by its source's `pull` first (expand.py).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from yasps.backend.codegen.expanding_text import LocalDerivative
from yasps.backend.codegen.object_text import size_of
from yasps.backend.codegen.slots import block
from yasps.backend.cpp.expand import in_lanes
from yasps.backend.cpp.lanes import add_gradient, declare_slots
from yasps.backend.cpp.object import BYTES_OF_A_PACK, LARGEST_STACK, over_packs
from yasps.backend.cpp.scatter import scatter_hessian
from yasps.dialects.rel import ApplyOp, ProjectOp
from yasps.runtime.core.sink import LANES

if TYPE_CHECKING:
    from yasps.backend.cpp.object import CppObjectText

MOST_PACKS = 16
"""Packs whose Hessians are projected by one call: failing matrices of all of them are decomposed together."""


def derivative_body(text: CppObjectText, local: LocalDerivative) -> list[str]:
    """Statements of the entry point `derive`."""
    if local.project is not None and not local.curved:
        return _in_batches(text, local, local.project)
    uniforms = _before_packs(text, local)
    declared = text.array("middle", local.outputs["middle"]) if "middle" in local.outputs else []
    lines = [*text.declare("V"), *text.gather_pack(), *_derive(text, local, declared, is_projected=False)]
    scatter: list[str] = []
    if local.curved:
        scatter = in_lanes(local, _curved_hessian(text, local))
    elif "middle" in local.outputs:
        scatter = scatter_hessian(text, local, "middle")
    lines += block("if (sink.tiles)", scatter) if scatter else []
    lines += _add_gradient(text, local)
    return [*uniforms, *over_packs(lines), "return -1;"]


def _before_packs(text: CppObjectText, local: LocalDerivative) -> list[str]:
    """Statements that declare what all packs share."""
    return [*text.compute_uniforms("V"), *(declare_slots(text, local) if local.in_lanes else [])]


def _add_gradient(text: CppObjectText, local: LocalDerivative) -> list[str]:
    """Statements that add `gradient` of a pack to the global one."""
    return add_gradient(text, local) if local.in_lanes else in_lanes(local, text.scatter_gradient(local))


def _derive(text: CppObjectText, local: LocalDerivative, declared: list[str], *, is_projected: bool) -> list[str]:
    """Energy, gradient and packed Hessian of one pack, and a return if they are not finite."""
    lines = [f"V energy[1], gradient[{local.n}];", *declared]
    lines.append(text.call(local.derive, text.names(), list(local.outputs), "V"))
    lines.append(f"V check = sum_of_zeros(gradient, {local.n}) + energy[0] * 0.0;")
    if "middle" in local.outputs and not is_projected:  # projection looks at what it gets
        lines.append(f"check += sum_of_zeros(middle, {local.outputs['middle']});")
    return [
        *lines,
        "if (any_not_finite(check))",
        "    for (long l = 0; l < lanes; ++l)",
        "        if (check[l] != 0.0) return first + l;",
    ]


def _curved_hessian(text: CppObjectText, local: LocalDerivative) -> list[str]:
    """The Hessian of one lane of an energy of nonlinear parameterisations, projected and scattered."""
    lines = [f"double v[{local.n}];", f"for (long e = 0; e < {local.n}; ++e) v[e] = gradient[e][l];"]
    if entries := local.outputs.get("middle", 0):
        lines += text.array("triangle_of_lane", -(-entries // LANES))
        lines.append("double* const triangle = (double*)triangle_of_lane;")
        lines.append(f"for (long k = 0; k < {entries}; ++k) triangle[k] = middle[k][l];")
    return lines + text.merged_hessian(local, "triangle" if entries else None, "v")


def _in_batches(text: CppObjectText, local: LocalDerivative, project: ProjectOp) -> list[str]:
    """Derivatives of several packs, one projection of them all, then pull-back and scatter of each."""
    assert local.hessian is not None
    pull_back, entries, width = local.hessian.owner, size_of(project.packed), project.width.value.data
    names = {**text.names(), project.result: "middle"}
    sizes = {f"r{k}": size for k, size in enumerate(text.read_sizes())}
    kept = {names[v] for v in pull_back.inputs} & sizes.keys() if isinstance(pull_back, ApplyOp) else set()
    packs = max(1, min(MOST_PACKS, LARGEST_STACK // (BYTES_OF_A_PACK * (entries + sum(sizes[name] for name in kept)))))
    of_packs = {"middle": entries}
    call = "project((double*)middle_of"
    if project.deformation is not None:
        of_packs["deformation"] = width
        known = "isotropic" if project.vectors is None else "two_vectors"
        call = f"project_{known}((double*)middle_of, (const double*)deformation_of"
    of_packs |= {name: sizes[name] for name in sorted(kept)}
    of_pack = {name: f"V* const {name} = {name}_of[pack];" for name in of_packs}
    shared = [of_pack[name] for name in sorted(kept)]
    middle = ["V* const middle = middle_of[pack];"]
    scatter: list[str] = []
    if isinstance(pull_back, ApplyOp):
        scatter = [*text.array("hessian", size_of(local.hessian)), text.call(pull_back, names, ["hessian"], "V")]
    scatter += scatter_hessian(text, local, "hessian" if scatter else "middle")
    uniforms = _before_packs(text, local)
    lanes = "const long lanes = stop - first < 8 ? stop - first : 8;"
    derive = [
        *(f"V {name}[{size}];" for name, size in sizes.items() if name not in kept),
        *shared,
        *text.gather_pack(),
        *_derive(text, local, [of_pack[name] for name in of_packs if name not in kept], is_projected=True),
        *_add_gradient(text, local),
    ]
    each_pack = "for (long first = start, pack = 0; first < stop; first += 8, ++pack)"
    batch = [
        "const long stop = end - start < most ? end : start + most;",
        *block(each_pack, [lanes, *derive]),
        "if (!sink.tiles) continue;",
        f"const long changed = sink.{call}, {width}, (int)(stop - start), sink.mode);",
        "if (changed == YASPS_NO_MEMORY) return changed;",
        "if (changed < 0) return start - changed - 1;",
        "*sink.projected += changed;",
        *block(each_pack, [lanes, *middle, *shared, *scatter]),
    ]
    return [
        *uniforms,
        *(line for name, size in of_packs.items() for line in _of_packs(text, name, packs, size)),
        # Where nothing is projected, one pack at a time: what it needs stays in the first-level cache.
        f"const long most = sink.mode == 2 ? 8 : {8 * packs};",
        *block("for (long start = begin; start < end; start += most)", batch),
        "return -1;",
    ]


def _of_packs(text: CppObjectText, name: str, packs: int, size: int) -> list[str]:
    """Declares an array for each of several packs."""
    if packs * size * BYTES_OF_A_PACK <= LARGEST_STACK:
        return [f"V {name}_of[{packs}][{size}];"]
    scratch = text.scratch(f"{name}_of", str(packs * size))
    return [*scratch, f"V(*const {name}_of)[{size}] = (V(*)[{size}])memory_of_{name}_of.data;"]
