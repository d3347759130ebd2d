"""One small box for each parameterisation, and where its vertices are as a function of its unknowns in NumPy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from yasps import Attribute, Mesh, Primitive, Scene, materials
from yasps.meshes import box, hex_box
from yasps.parameterisations import (
    affine_position,
    ancestors,
    blended,
    caged_position,
    influences,
    modal_position,
    rotation_matrix,
    trilinear_weights,
    turned,
)

Array = NDArray[Any]
SIZE = 0.1  # m
SHAPE = box((SIZE,) * 3, (1, 1, 1)).rotated((1.0, 0.3, 0.2), 0.2)
DENSITY = 1000.0
ARM = np.array([[0.0, 0.0, 0.2], [0.1, 0.0, -0.1], [0.1, 0.0, 0.0]])  # m, of the links of the chain


@dataclass(frozen=True)
class Piece:
    """Vertices of a parameterised box."""

    vertices: Primitive
    targets: list[Attribute]
    positions: Callable[[list[Array]], Array]
    """[n, 3] of values of the targets, complex ones too."""


def cross(v: Array) -> Array:
    return np.array([[0 * v[0], -v[2], v[1]], [v[2], 0 * v[0], -v[0]], [-v[1], v[0], 0 * v[0]]])


def with_mass(mesh: Mesh, name: str = "vertices") -> Primitive:
    vertices = mesh.add_primitive(name, num_instances=len(SHAPE.vertices))
    vertices.add_constant("mass", 1, 1, value=SHAPE.vertex_masses(DENSITY))
    return vertices


def of_one(owner: Primitive, source: Attribute, name: str) -> Attribute:
    """A JOIN of every instance with the only one of the source's primitive."""
    assert isinstance(source.owner, Primitive)
    to_one = owner.add_connectivity(f"to_{name}", source.owner, np.zeros(owner.num_instances, int), 1)
    return owner.add_attribute(name, through=to_one, source=source)


def rigid(mesh: Mesh, at: Array) -> Piece:
    base = expm(cross(np.array([0.4, -1.0, 0.3])))
    body = mesh.add_primitive("body", 1)
    vector = body.add_attribute("vector", 3, 1, value=[0.3, 0.2, -0.1])
    place = body.add_attribute("place", 3, 1, value=at)
    turn = rotation_matrix(vector) * body.add_constant("base", 3, 3, value=base)
    rotation = body.add_attribute("rotation", computed_attribute=turn)
    vertices = with_mass(mesh)
    rest = vertices.add_constant("rest", 3, 1, value=SHAPE.vertices)
    x = affine_position(of_one(vertices, rotation, "own_rotation"), of_one(vertices, place, "own_place"), rest)
    vertices.add_attribute("position", computed_attribute=x)
    return Piece(vertices, [vector, place], lambda q: SHAPE.vertices @ (expm(cross(q[0])) @ base).T + q[1])


def affine(mesh: Mesh, at: Array) -> Piece:
    body = mesh.add_primitive("body", 1)
    matrix = body.add_attribute("matrix", 3, 3, value=np.eye(3))
    place = body.add_attribute("place", 3, 1, value=at)
    stiff = materials.affine_orthogonality(matrix, 100.0)
    mesh.scene.add_energy(body.add_attribute("orthogonality", computed_attribute=stiff))
    vertices = with_mass(mesh)
    rest = vertices.add_constant("rest", 3, 1, value=SHAPE.vertices)
    x = affine_position(of_one(vertices, matrix, "own_matrix"), of_one(vertices, place, "own_place"), rest)
    vertices.add_attribute("position", computed_attribute=x)
    return Piece(vertices, [matrix, place], lambda q: SHAPE.vertices @ q[0].reshape(3, 3).T + q[1])


def caged(mesh: Mesh, at: Array) -> Piece:
    cage = hex_box((2 * SIZE,) * 3, (1, 1, 1))
    corners = mesh.add_primitive("corners", 8)
    place = corners.add_attribute("position", 3, 1, value=cage.vertices + at)
    points = cage.points()
    gauss = mesh.add_primitive("gauss", 8)
    around = gauss.add_connectivity("nodes", corners, points.nodes, 8)
    f = materials.gauss_deformation(
        gauss.add_attribute("x", through=around, source=place), gauss.add_constant("g", 8, 3, value=points.gradients)
    )
    mu, lam = materials.stable_neo_hookean_parameters(1e5, 0.3)
    elastic = materials.stable_neo_hookean(f, mu, lam, gauss.add_constant("v", 1, 1, value=points.volumes))
    mesh.scene.add_energy(gauss.add_attribute("elastic", computed_attribute=elastic))
    cells, weights = trilinear_weights(SHAPE.vertices, cage.vertices, cage.cells)
    vertices = with_mass(mesh)
    of_cell = vertices.add_connectivity("of_cell", corners, cage.cells[cells], 8)
    x = caged_position(
        vertices.add_attribute("x", through=of_cell, source=place), vertices.add_constant("w", 8, 1, value=weights)
    )
    vertices.add_attribute("position", computed_attribute=x)
    order = cage.cells[cells]
    return Piece(vertices, [place], lambda q: np.einsum("nk,nkc->nc", weights, q[0].reshape(-1, 3)[order]))


def chain(mesh: Mesh, at: Array) -> Piece:
    """The box is fixed to the end of three links; the root is above it."""
    links = mesh.add_primitive("links", 3)
    angle = links.add_attribute("angle", 1, 1, value=[0.0, 0.2, -0.1])
    first, second = (mesh.add_constant(name, 3, 1, value=v) for name, v in (("u", [1.0, 0, 0]), ("v", [0, 0, 1.0])))
    way = links.add_connectivity("way", links, *ancestors([-1, 0, 1])[:1], counts=ancestors([-1, 0, 1])[1])
    direction = links.add_attribute("direction", through=way, source=angle, operation="sum")
    arm = turned(links.add_constant("rest_arm", 3, 1, value=ARM), direction, first, second)
    end = links.add_attribute(
        "end", through=way, source=links.add_attribute("arm", computed_attribute=arm), operation="sum"
    )
    vertices = with_mass(mesh)
    to_end = vertices.add_connectivity("to_end", links, np.full(len(SHAPE.vertices), 2), 1)
    own_direction = vertices.add_attribute("own_direction", through=to_end, source=direction)
    own_end = vertices.add_attribute("own_end", through=to_end, source=end).reshape(3, 1)
    rest = vertices.add_constant("rest", 3, 1, value=SHAPE.vertices)
    root = at - ARM.sum(axis=0)
    x = (
        turned(rest, own_direction, first, second)
        + own_end
        + vertices.add_constant("root", 3, 1, value=np.tile(root, (8, 1)))
    )
    vertices.add_attribute("position", computed_attribute=x)

    def turn(angle: Any) -> Array:
        c, s = np.cos(angle), np.sin(angle)
        return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])

    def positions(q: list[Array]) -> Array:
        total, place = 0.0, root.astype(q[0].dtype)
        for angle, arm in zip(q[0], ARM, strict=True):
            total = total + angle
            place = place + turn(total) @ arm
        return SHAPE.vertices @ turn(total).T + place

    return Piece(vertices, [angle], positions)


def skinned(mesh: Mesh, at: Array) -> Piece:
    """Two affine bones, the lower and the upper end."""
    height = (SHAPE.vertices[:, 2] - SHAPE.vertices[:, 2].min()) / np.ptp(SHAPE.vertices[:, 2])
    found = influences(np.column_stack([1 - height, height]))
    bones = mesh.add_primitive("bones", 2)
    matrix = bones.add_attribute("matrix", 3, 3, value=np.tile(np.eye(3), (2, 1, 1)))
    place = bones.add_attribute("place", 3, 1, value=[at, at])
    stiff = materials.affine_orthogonality(matrix, 100.0)
    mesh.scene.add_energy(bones.add_attribute("orthogonality", computed_attribute=stiff))
    spring = mesh.add_primitive("spring", 1)
    both = spring.add_connectivity("both", bones, [[0, 1]], 2)
    one, two = spring.add_attribute("places", through=both, source=place)
    turns = spring.add_attribute("matrices", through=both, source=matrix)
    difference = turns.row(0) - turns.row(1)
    tie = 0.5 * 1e4 * (one - two).dot(one - two) + 50.0 * difference.dot(difference)
    mesh.scene.add_energy(spring.add_attribute("tie", computed_attribute=tie))
    parts = mesh.add_primitive("influences", len(found.weights))
    to_bone = parts.add_connectivity("bone", bones, found.bones, 1)
    rest = parts.add_constant("rest", 3, 1, value=SHAPE.vertices[found.vertices])
    share = blended(
        parts.add_constant("weight", 1, 1, value=found.weights),
        parts.add_attribute("matrix", through=to_bone, source=matrix),
        parts.add_attribute("place", through=to_bone, source=place),
        rest,
    )
    part = parts.add_attribute("share", computed_attribute=share)
    vertices = with_mass(mesh)
    own = vertices.add_connectivity("own", parts, np.arange(len(found.weights)), counts=found.counts)
    vertices.add_attribute("position", through=own, source=part, operation="sum")

    def positions(q: list[Array]) -> Array:
        a, t = q[0].reshape(2, 3, 3), q[1].reshape(2, 3)
        by_bone = np.einsum("bij,nj->nbi", a, SHAPE.vertices) + t
        return np.einsum("nb,nbi->ni", np.column_stack([1 - height, height]), by_bone)

    return Piece(vertices, [matrix, place], positions)


def modal(mesh: Mesh, at: Array) -> Piece:
    """Three translations, a shear and a stretch."""
    z = SHAPE.vertices[:, 2]
    modes = np.zeros((8, 3, 5))
    modes[:, 0, 0] = modes[:, 1, 1] = modes[:, 2, 2] = 1.0
    modes[:, 0, 3] = modes[:, 2, 4] = z / SIZE
    body = mesh.add_primitive("body", 1)
    amplitudes = body.add_attribute("amplitudes", 5, 1, value=[0.0, 0.0, 0.0, 0.01, 0.005])
    stiff = 0.5 * 500.0 * (amplitudes[3] ** 2 + amplitudes[4] ** 2)
    mesh.scene.add_energy(body.add_attribute("elastic", computed_attribute=stiff))
    vertices = with_mass(mesh)
    rest = vertices.add_constant("rest", 3, 1, value=SHAPE.vertices + at)
    x = modal_position(rest, vertices.add_constant("modes", 3, 5, value=modes), of_one(vertices, amplitudes, "q"))
    vertices.add_attribute("position", computed_attribute=x)
    return Piece(vertices, [amplitudes], lambda q: SHAPE.vertices + at + modes @ q[0])


PIECES = {"rigid": rigid, "affine": affine, "caged": caged, "chain": chain, "skinned": skinned, "modal": modal}


def all_pieces(scene: Scene, height: float) -> dict[str, Piece]:
    """Beside each other, each with its lowest vertex at this height."""
    found = {}
    for k, (name, make) in enumerate(PIECES.items()):
        probe = make(Scene("probe").add_mesh(name), np.zeros(3))
        low = probe.positions([t.value for t in probe.targets])[:, 2].min()
        found[name] = make(scene.add_mesh(name), np.array([0.3 * k, 0.0, height - low]))
    return found
