"""Another mesh for a body of a running simulation, with its state carried over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from yasps import Attribute, Connectivity, DataError, Primitive, SceneError, ShapeMismatchError
from yasps.bodies import Body, Cloth, HalfSpace
from yasps.frontend.language.arrays import real_numbers
from yasps.meshes import TriangleMesh
from yasps.meshes.tetrahedral_mesh import Float64Array
from yasps.simulation.contact_of_bodies import stands_still, surface_of
from yasps.stepping import energies_by_kind

if TYPE_CHECKING:
    from yasps.simulation.simulation import Simulation

Parts = dict[Attribute | Connectivity, Any]
Weights = sparse.csr_array[np.float64]

ROUNDING = 1e-12
"""Of weights that add up to one."""


@dataclass(frozen=True)
class Amounts:
    """What a body has of what is conserved: mass [kg], momentum [kg m/s], [3], kinetic energy [J]; and all energies of
    the scene by kind [J]."""

    mass: float
    momentum: Float64Array
    kinetic: float
    energies: Mapping[str, float]


@dataclass(frozen=True)
class RemeshReport:
    """A body before and after it got another mesh."""

    before: Amounts
    after: Amounts


def remesh(
    simulation: Simulation,
    body: Body,
    shape: TriangleMesh,
    weights: Any,
    *,
    positions: ArrayLike | None,
    velocities: ArrayLike | None,
    given: Mapping[Attribute | Connectivity, Any],
) -> RemeshReport:
    """See `Simulation.remesh`."""
    if not isinstance(body, Cloth):
        raise SceneError(f"{body.name} is no Cloth: only the mesh of a Cloth can be replaced")
    old_count = len(body.rest)
    counts, parts = body.resized(shape)
    count = len(shape.vertices)
    weights = _checked_weights(weights, count, old_count, body.name)
    x = _numbers(positions, weights, body.positions(), f"positions of {body.name}")
    v = _numbers(velocities, weights, simulation.velocity_of(body), f"velocities of {body.name}")
    radius = body.radius if body.radius.ndim == 0 else weights @ body.radius
    parts |= {body.position: x, simulation._predicted[body]: x}
    parts |= dict.fromkeys(simulation._forces.fields_on(body), np.zeros((count, 3)))
    carried_here = [carried for carried in simulation._carried if carried.constant.owner in counts]
    for carried in carried_here:
        assert isinstance(carried.constant.owner, Primitive)
        parts[carried.constant] = np.zeros((counts[carried.constant.owner], *carried.constant.shape))
    successor = _successors(weights)
    parts |= _renumbered(body, successor, {*parts, *given})
    pinned = [(one, _followed(one.vertices, successor)) for one in simulation.driven.on(body)]
    if any((vertices < 0).any() for _, vertices in pinned):
        raise SceneError(f"a pinned vertex of {body.name} is in the new mesh no more: release its pins first")
    for contact in simulation._former_contacts:
        former = contact.emptied()
        counts |= former[0]
        parts |= former[1]
    before = _amounts(simulation, body)
    _resize(simulation, body, (shape, radius), counts, {**parts, **given})

    body.take(shape, radius)
    for one, vertices in pinned:
        one.vertices = vertices
    for carried in carried_here:
        carried.constant.update_value(carried.attribute.value)
    first = _first_vertex(simulation, body)

    def of_surface(numbers: Float64Array) -> Float64Array:
        own = weights @ numbers[first : first + old_count]
        return np.concatenate([numbers[:first], own, numbers[first + old_count :]])

    simulation.stepper.follow_resize(
        body.position,
        lambda numbers: np.asarray(weights @ numbers),
        v,
        immovable=None if simulation.contact is None else stands_still(simulation.bodies),
        of_surface=of_surface,
    )
    simulation._forces.update()
    return RemeshReport(before, _amounts(simulation, body))


def _resize(
    simulation: Simulation,
    body: Cloth,
    mesh: tuple[TriangleMesh, Float64Array],
    counts: Mapping[Primitive, int],
    parts: Mapping[Attribute | Connectivity, Any],
    *,
    is_free: bool = False,
) -> None:
    """Resizes the scene, with contact if there is any; mesh: the new one, with the radius of its vertices. is_free: not
    looked at whether surfaces cross."""
    contact = simulation.contact
    if contact is None:
        simulation.scene.resize(counts, parts)
        return
    surfaces = [one for one in simulation.bodies if not isinstance(one, HalfSpace)]
    old = TriangleMesh(body.rest, body.triangles), body.radius
    body.take(*mesh)  # for as long as it is asked what its surface is
    try:
        surface = surface_of(surfaces)
        rest = np.concatenate([one.rest for one in surfaces])
    finally:
        body.take(*old)
    contact.resize(counts, parts, rest_positions=rest, is_free=is_free, **surface)


def take_meshes(simulation: Simulation, numbers: Mapping[str, NDArray[Any]]) -> None:
    """Gives each cloth the mesh that it has in numbers of the scene, by their paths, if that is another; surfaces may
    cross, and velocities are zero. All else is for the caller to set."""
    for body in simulation.bodies:
        if isinstance(body, Cloth):
            rest = numbers[f"{body.vertices.path}.rest_position"].reshape(-1, 3)
            triangles = numbers[f"{body.triangle_elements.path}.corners"]
            if not (np.array_equal(rest, body.rest) and np.array_equal(triangles, body.triangles)):
                _take_mesh(simulation, body, TriangleMesh(rest.copy(), triangles.copy()), numbers)


def _take_mesh(simulation: Simulation, body: Cloth, shape: TriangleMesh, numbers: Mapping[str, NDArray[Any]]) -> None:
    counts, parts = {}, Parts()
    for path in numbers:
        primitive, part = _part_of(body, path)
        if primitive is None or part is None:
            continue
        leads = isinstance(part, Connectivity) and part.target is body.vertices
        if primitive.mesh is body.mesh or leads:
            counts[primitive] = len(numbers[path])
    for path, value in numbers.items():
        primitive, part = _part_of(body, path)
        if primitive in counts and part is not None:
            is_variable = isinstance(part, Connectivity) and part.is_variable
            parts[part] = (value[value >= 0], (value >= 0).sum(axis=1)) if is_variable else value
    for former in simulation._former_contacts:
        of_former = former.emptied()
        counts |= of_former[0]
        parts |= of_former[1]
    radius, contact = body.radius, simulation.contact
    if radius.ndim:
        radius = np.zeros(len(shape.vertices))
        if contact is not None:
            first = _first_vertex(simulation, body)
            of_all = numbers[f"{contact.parts.points.path}.radius"].reshape(-1)
            radius = of_all[first : first + len(radius)].copy()
    _resize(simulation, body, (shape, radius), counts, parts, is_free=True)
    body.take(shape, radius)
    simulation.stepper.follow_resize(
        body.position,
        lambda _: np.zeros(shape.vertices.shape),
        immovable=None if contact is None else stands_still(simulation.bodies),
    )


def _part_of(body: Body, path: str) -> tuple[Primitive | None, Attribute | Connectivity | None]:
    """A primitive, and its stored attribute or connectivity of a path; None where it is of a mesh, a union or the
    scene."""
    *owner, name = path.split(".")
    if len(owner) < 2:
        return None, None
    primitive = getattr(getattr(body.scene, owner[0]), owner[1])
    if not isinstance(primitive, Primitive):
        return None, None
    return primitive, primitive.connectivities.get(name) or primitive.attributes.get(name)


def _first_vertex(simulation: Simulation, body: Body) -> int:
    """Of a body in the union of all vertices."""
    number = simulation.bodies.index(body)
    return sum(len(one.rest) for one in simulation.bodies[:number])


def _checked_weights(weights: Any, count: int, old_count: int, name: str) -> Weights:
    """Sparse weights [new, old]. Raises ShapeMismatchError, DataError."""
    what = f"the weights of the new vertices of {name}"
    found: Any = weights if sparse.issparse(weights) else real_numbers(weights, what)
    if found.shape != (count, old_count):
        raise ShapeMismatchError(f"{what} are [{count}, {old_count}], new and old vertices, got {list(found.shape)}")
    kept: Weights = sparse.csr_array(found).astype(np.float64)
    real_numbers(kept.data, what)
    totals: Float64Array = np.asarray(kept.sum(axis=1)).reshape(-1)
    if (wrong := np.abs(totals - 1.0) > ROUNDING).any():
        first = int(np.argmax(wrong))
        raise DataError(f"{what} add up to 1 for each of them, but to {totals[first]:.6g} for vertex {first}")
    return kept


def _numbers(given: ArrayLike | None, weights: Weights, old: Float64Array, what: str) -> Float64Array:
    """What is given for the new vertices, [n, 3], or else the weighted old numbers."""
    if given is None:
        return np.asarray(weights @ old, np.float64)
    values = real_numbers(given, what)
    if values.shape != (weights.shape[0], 3):
        raise ShapeMismatchError(f"{what} are [{weights.shape[0]}, 3], got {list(values.shape)}")
    return values.copy()


def _successors(weights: Weights) -> NDArray[np.int64]:
    """For each old vertex the first new one that is the same: all of its weight is on it; -1 if there is none."""
    found = np.full(weights.shape[1], -1, np.int64)
    entries = weights.tocoo()
    alone = entries.data == 1.0
    rows, columns = entries.coords[0][alone][::-1], entries.coords[1][alone][::-1]
    found[columns] = rows
    return found


def _followed(vertices: NDArray[np.integer], successor: NDArray[np.int64]) -> NDArray[np.int64]:
    """The new vertices in place of old ones; -1 stays, and stands for those that are gone."""
    return np.where(vertices < 0, -1, successor[vertices])


def _renumbered(body: Body, successor: NDArray[np.int64], known: set[Attribute | Connectivity]) -> Parts:
    """Indices of all that leads to vertices of the body which are in the new mesh, too. What leads to others is left
    out, so that the scene asks for it."""
    parts: Parts = {}
    for path in body.scene.numbers():
        _, connectivity = _part_of(body, path)
        leads = isinstance(connectivity, Connectivity) and connectivity.target is body.vertices
        if not isinstance(connectivity, Connectivity) or not leads or connectivity in known:
            continue
        old = connectivity.indices
        rows = _followed(old, successor)
        if ((rows < 0) == (old < 0)).all():
            there = rows >= 0
            parts[connectivity] = (rows[there], there.sum(axis=1)) if connectivity.is_variable else rows
    return parts


def _amounts(simulation: Simulation, body: Body) -> Amounts:
    mass, v = body.mass.value, simulation.velocity_of(body)
    kinetic = 0.5 * float(mass @ (v * v).sum(axis=1))
    return Amounts(float(mass.sum()), mass @ v, kinetic, energies_by_kind(simulation.scene, simulation.stepper))
