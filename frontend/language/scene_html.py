"""A scene as HTML, for notebooks: its meshes and primitives, what they hold, energies and targets."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING

from yasps.dialects.mat import spell
from yasps.frontend.language.attribute import Attribute
from yasps.frontend.language.connectivity import Connectivity
from yasps.frontend.language.nodes import Joined, Stored, United
from yasps.frontend.language.primitive import PrimitiveBase, PrimitiveUnion
from yasps.frontend.language.scene_numbers import entities_of

if TYPE_CHECKING:
    from yasps.frontend.language.entity import Entity
    from yasps.frontend.scene import Scene

MOST_OPEN = 3
"""Scenes with more meshes show these folded."""


def html_of(scene: Scene) -> str:
    """See `Scene._repr_html_`."""
    whole, *entities = entities_of(scene)
    meshes = {mesh.name: [mesh] for mesh in entities if mesh.path == mesh.name}
    for primitive in entities:
        if primitive.path != primitive.name:
            meshes[primitive.path.split(".")[0]].append(primitive)
    is_open = " open" if len(meshes) <= MOST_OPEN else ""
    unknowns = sum(target.value.size for target in scene.minimize_targets)
    return "".join(
        [
            f"<div><b>scene {escape(scene.name)}</b>: {len(meshes)} meshes, {len(scene.energies)} energies, "
            f"{unknowns:,} unknowns in {len(scene.minimize_targets)} targets",
            _table([whole], scene) if whole.attributes else "",
            *(
                f"<details{is_open}><summary>mesh {escape(name)}</summary>{_table(parts, scene)}</details>"
                for name, parts in meshes.items()
            ),
            "</div>",
        ]
    )


def _table(entities: list[Entity], scene: Scene) -> str:
    """What some of its parts hold."""
    rows = "".join(row for entity in entities for row in _rows(entity, scene))
    head = "".join(f"<th>{word}</th>" for word in ("where", "instances", "name", "shape", "what"))
    return f"<table><tr>{head}</tr>{rows}</table>"


def _rows(entity: Entity, scene: Scene) -> Iterator[str]:
    first = [entity.path or "scene", f"{entity.num_instances:,}"]
    held: list[Attribute | Connectivity] = [*entity.attributes.values()]
    if isinstance(entity, PrimitiveBase):
        held = [*entity.connectivities.values(), *held]
    if isinstance(entity, PrimitiveUnion) or (isinstance(entity, PrimitiveBase) and not held):
        what = f"union of {', '.join(m.path for m in entity.members)}" if isinstance(entity, PrimitiveUnion) else ""
        yield _row([*first, "", "", what])
        first = ["", ""]
    for one in held:
        if isinstance(one, Connectivity):
            arity = f"up to {one.arity}" if one.is_variable else str(one.arity)
            yield _row([*first, one.name, arity, f"connectivity to {one.target.path}"])
        else:
            yield _row([*first, one.name or "", spell(one.shape), _what(one, scene)])
        first = ["", ""]


def _row(cells: list[str]) -> str:
    return f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"


def _what(attribute: Attribute, scene: Scene) -> str:
    """What it is, and what for."""
    match attribute.node:
        case Stored(constant=True):
            kind = "constant"
        case Stored():
            kind = "target" if any(target is attribute for target in scene.minimize_targets) else "variable"
        case Joined(connectivity=through, source=source):
            kind = f"JOIN of {source.path} through {through.name}"
        case United():
            kind = "UNION"
        case _:
            kind = "computed"
    return f"{kind}, energy" if any(energy is attribute for energy in scene.energies) else kind
