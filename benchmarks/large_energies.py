"""Scenes whose energies are long, wide, curved or many: what the compiler must not grow out of hand with.

Each takes a number that says how large, and makes a few instances only: nothing here is about run time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np

from yasps import Attribute, Primitive, Scene, atan2, concat_rows, identity, materials

INSTANCES = 4


def _elements(name: str) -> tuple[Scene, Primitive]:
    scene = Scene(name, threads=1)
    return scene, scene.add_mesh("mesh").add_primitive("elements", INSTANCES)


def _points(elements: Primitive, arity: int, seed: int = 0) -> tuple[Attribute, Attribute]:
    """Positions of random points of their own, the target, and `arity` of them joined by each element."""
    random = np.random.default_rng(seed)
    points = elements.mesh.add_primitive("points", INSTANCES * arity)
    position = points.add_attribute("position", 3, 1, value=random.random((INSTANCES * arity, 3)))
    corners = elements.add_connectivity("corners", points, np.arange(INSTANCES * arity).reshape(-1, arity), arity)
    return position, elements.add_attribute("corner_positions", through=corners, source=position)


def scalar_chain(steps: int) -> Scene:
    """y = y x + 0.5, over and over, of one unknown x."""
    scene, elements = _elements("scalar_chain")
    x = elements.add_attribute("x", 1, 1, value=np.linspace(0.1, 0.9, INSTANCES))
    y = x
    for _ in range(steps):
        y = y * x + 0.5
    scene.add_energy(elements.add_attribute("energy", computed_attribute=y))
    scene.add_minimize_target(x)
    return scene


def all_springs(points: int) -> Scene:
    """Springs between any two of so many points, in one energy: its Hessian is dense, of 3 `points` unknowns."""
    scene, elements = _elements("all_springs")
    position, x = _points(elements, points)
    terms = [((x.row(j) - x.row(i)).norm() - 1.0) ** 2 for i, j in combinations(range(points), 2)]
    scene.add_energy(elements.add_attribute("energy", computed_attribute=sum(terms[1:], terms[0])))
    scene.add_minimize_target(position)
    return scene


def _transported(d: Attribute, old: Attribute, new: Attribute) -> Attribute:
    """d, at a right angle to the unit vector `old`, turned as `old` turns to `new` without twist (1x3 all)."""
    return d - d.dot(new) / (1 + old.dot(new)) * (old + new)


def rod(_: int) -> Scene:
    """A vertex of a rod between two edges: stretch, bend, and twist with material frames.

    Bergou et al. 2008 and 2010: reference frames are carried along from the last step in parallel, and turned by an
    angle each.
    """
    scene, elements = _elements("rod")
    random = np.random.default_rng(1)
    position, x = _points(elements, 3)
    edges = elements.mesh.add_primitive("edges", 2 * INSTANCES)
    angle = edges.add_attribute("angle", 1, 1, value=random.random(2 * INSTANCES))
    of_elements = elements.add_connectivity("edges", edges, np.arange(2 * INSTANCES).reshape(-1, 2), 2)
    theta = elements.add_attribute("angles", through=of_elements, source=angle)
    old_frames = [_frames(elements, f"old_{j}", random) for j in (0, 1)]
    rest = [elements.add_constant(f"rest_{j}", 2, 1, value=random.random((INSTANCES, 2, 1))) for j in (0, 1)]
    stiffness = elements.add_constant("stiffness", 2, 2, value=np.broadcast_to(np.eye(2), (INSTANCES, 2, 2)))
    length, twist, bar = (elements.add_constant(name, 1, 1, value=np.ones(INSTANCES)) for name in ("l", "m", "k"))
    e = [x.row(1) - x.row(0), x.row(2) - x.row(1)]
    tangents = [edge / edge.norm() for edge in e]
    energy = 0.5 * bar * ((e[0].norm() / length - 1) ** 2 + (e[1].norm() / length - 1) ** 2)
    binormal = 2 * e[0].cross(e[1]) / (e[0].norm() * e[1].norm() + e[0].dot(e[1]))
    frames = []
    for old, tangent in zip(old_frames, tangents, strict=True):
        first = _transported(old.row(1), old.row(0), tangent)
        frames.append((first, tangent.cross(first)))
    for (u, v), angle_of_edge, of_rest in zip(frames, theta, rest, strict=True):
        c, s = angle_of_edge.cos(), angle_of_edge.sin()
        bend = concat_rows([binormal.dot(c * v - s * u), -binormal.dot(c * u + s * v)]) - of_rest
        energy = energy + bend.dot(stiffness @ bend) / (2 * length)
    carried = _transported(frames[0][0], tangents[0], tangents[1])
    reference = atan2(carried.cross(frames[1][0]).dot(tangents[1]), carried.dot(frames[1][0]))
    energy = energy + (theta[1] - theta[0] + reference - twist) ** 2 / length
    scene.add_energy(elements.add_attribute("energy", computed_attribute=energy))
    scene.add_minimize_target([position, angle])
    return scene


def _frames(elements: Primitive, name: str, random: np.random.Generator) -> Attribute:
    """A tangent and a director for each, 2x3."""
    return elements.add_constant(name, 2, 3, value=np.linalg.qr(random.random((INSTANCES, 3, 3)))[0][:, :2])


def rotation(w: Attribute) -> Attribute:
    """The rotation of a rotation vector (3x1), by Rodrigues' formula."""
    zero = 0.0 * w[0]
    cross = concat_rows([zero, -w[2], w[1], w[2], zero, -w[0], -w[1], w[0], zero]).reshape(3, 3)
    n = w.norm()
    return identity(3) + n.sin() / n * cross + (1 - n.cos()) / (n * n) * cross @ cross


def rotation_vector(_: int) -> Scene:
    """Rigid bodies by rotation vectors: inertia of their vertices, and elastic tets between them."""
    scene, elements = _elements("rotation_vector")
    random = np.random.default_rng(2)
    mesh, count = elements.mesh, 4 * INSTANCES
    bodies, vertices = mesh.add_primitive("bodies", INSTANCES), mesh.add_primitive("vertices", count)
    turn = bodies.add_attribute("turn", 3, 1, value=random.random((INSTANCES, 3)))
    shift = bodies.add_attribute("shift", 3, 1, value=random.random((INSTANCES, 3)))
    of_body = vertices.add_connectivity("of_body", bodies, np.arange(count) % INSTANCES, 1)
    own = {
        name: vertices.add_attribute(name, through=of_body, source=source).reshape(3, 1)
        for name, source in {"turn": turn, "shift": shift}.items()
    }
    rest, target = (vertices.add_constant(n, 3, 1, value=random.random((count, 3))) for n in ("rest", "predicted"))
    position = vertices.add_attribute("position", computed_attribute=rotation(own["turn"]) @ rest + own["shift"])
    offset = position - target
    scene.add_energy(vertices.add_attribute("inertia", computed_attribute=0.5 * offset.dot(offset)))
    corners = elements.add_connectivity("corners", vertices, np.arange(count).reshape(-1, 4), 4)
    x = elements.add_attribute("corner_positions", through=corners, source=position)
    inverse = elements.add_constant("inverse", 3, 3, value=random.random((INSTANCES, 3, 3)))
    energy = materials.stable_neo_hookean(materials.deformation_gradient(x, inverse), 1.0, 1.0, 1.0)
    scene.add_energy(elements.add_attribute("elastic", computed_attribute=energy))
    scene.add_minimize_target([turn, shift])
    return scene


def nested_joins(depth: int) -> Scene:
    """Points each between two of the level before, pushed out nonlinearly; a spring to the origin on the last."""
    scene = Scene("nested_joins", threads=1)
    mesh = scene.add_mesh("mesh")
    random = np.random.default_rng(3)
    level = mesh.add_primitive("level_0", INSTANCES)
    target = position = level.add_attribute("position", 3, 1, value=random.random((INSTANCES, 3)))
    for k in range(1, depth + 1):
        above, level = level, mesh.add_primitive(f"level_{k}", INSTANCES)
        pairs = np.stack([np.arange(INSTANCES), (np.arange(INSTANCES) + 1) % INSTANCES], axis=1)
        through = level.add_connectivity("ends", above, pairs, 2)
        ends = level.add_attribute("end_positions", through=through, source=position)
        middle, edge = 0.5 * (ends.row(0) + ends.row(1)), ends.row(1) - ends.row(0)
        moved = middle.T + (0.1 * edge.dot(edge)).sin() * edge.T
        position = level.add_attribute("position", computed_attribute=moved)
    scene.add_energy(level.add_attribute("energy", computed_attribute=position.dot(position).sqrt()))
    scene.add_minimize_target(target)
    return scene


def many_energies(count: int) -> Scene:
    """So many energies of tets that are alike in form but for an exponent, so that each has code of its own."""
    scene, elements = _elements("many_energies")
    position, x = _points(elements, 4)
    inverse = elements.add_constant("inverse", 3, 3, value=np.broadcast_to(np.eye(3), (INSTANCES, 3, 3)))
    f = materials.deformation_gradient(x, inverse)
    stretch, volume = f.dot(f), f.det()
    for k in range(count):
        energy = (stretch + 1) ** (1 + (k + 1) / 64) + (volume - 1) ** 2
        scene.add_energy(elements.add_attribute(f"energy_{k}", computed_attribute=energy))
    scene.add_minimize_target(position)
    return scene


def _gradients(owner: Primitive, name: str) -> Attribute:
    """Gradients of the eight shape functions of a hexahedron at a Gauss point, 8x3."""
    random = np.random.default_rng(4)
    return owner.add_constant(name, 8, 3, value=random.normal(size=(owner.num_instances, 8, 3)))


def unrolled_hexahedron(gauss_points: int) -> Scene:
    """Neo-Hookean hexahedra, the energies at all Gauss points added up in one."""
    scene, elements = _elements("unrolled_hexahedron")
    position, x = _points(elements, 8)
    terms = [
        materials.stable_neo_hookean(x.T @ _gradients(elements, f"gradients_{g}"), 1.0, 1.0, 1.0)
        for g in range(gauss_points)
    ]
    scene.add_energy(elements.add_attribute("energy", computed_attribute=sum(terms[1:], terms[0])))
    scene.add_minimize_target(position)
    return scene


def hexahedron_by_gauss_points(_: int) -> Scene:
    """Neo-Hookean hexahedra, the Gauss points a primitive of their own."""
    scene, elements = _elements("hexahedron_by_gauss_points")
    position, x = _points(elements, 8)
    energy = materials.stable_neo_hookean(x.T @ _gradients(elements, "gradients"), 1.0, 1.0, 1.0)
    scene.add_energy(elements.add_attribute("energy", computed_attribute=energy))
    scene.add_minimize_target(position)
    return scene


@dataclass(frozen=True)
class LargeEnergy:
    """A scene by its name in tables, at several sizes; `scene` makes one."""

    name: str
    sizes: tuple[int, ...]
    make: Callable[[int], Scene]

    def scenes(self, largest: int) -> dict[str, Callable[[], Scene]]:
        """A maker of each size up to the largest."""
        return {self.name.format(size): partial(self.make, size) for size in self.sizes if size <= largest}


LARGE_ENERGIES = (
    LargeEnergy("chain of {} steps", (50, 100, 200, 500), scalar_chain),
    LargeEnergy("springs between {} points", (9, 18, 27), all_springs),
    LargeEnergy("rod", (1,), rod),
    LargeEnergy("rotation vector", (1,), rotation_vector),
    LargeEnergy("{} nested nonlinear JOINs", (2, 4, 6), nested_joins),
    LargeEnergy("{} energies", (10, 50), many_energies),
    LargeEnergy("hexahedron, {} Gauss points unrolled", (2, 4, 8), unrolled_hexahedron),
    LargeEnergy("hexahedron by Gauss points", (1,), hexahedron_by_gauss_points),
)
