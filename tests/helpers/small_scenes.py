"""Small scenes that touch everything the compiler does, and what tests ask of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from xdsl.dialects.builtin import ModuleOp

from yasps import Attribute, Connectivity, Primitive, Scene, concat_rows
from yasps.backend.reference.interpreter import Interpreter, SceneData
from yasps.frontend.execution.emit import SceneEmitter
from yasps.frontend.language.nodes import Stored

STEP = 1e-30
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Emitted:
    """The compiler's input for a scene."""

    module: ModuleOp
    data: SceneData
    targets: list[str]


def emit(scene: Scene) -> Emitted:
    """The scene's IR before any pass, made anew, and its numbers."""
    emitter = SceneEmitter(scene.name)
    module = emitter.emit(scene._energies, scene._targets, [])
    storages = {}
    for symbol, attribute in emitter.stored.items():
        assert isinstance(attribute.node, Stored)
        storages[symbol] = attribute.node.array.copy()
    data = SceneData(
        storages,
        {symbol: c.indices for symbol, c in emitter.connected.items()},
        {symbol: owner.num_instances for symbol, owner in emitter.owners.items()},
    )
    return Emitted(module, data, [emitter.symbol_of(target) for target in scene.minimize_targets])


def along_each_unknown(module: ModuleOp, data: SceneData, targets: list[str], of: Callable[[Interpreter], Any]) -> Any:
    """Complex-step derivative of something the interpreter gives, by every unknown in turn."""
    columns = []
    for target in targets:
        for k in range(data.storages[target].size):
            stepped = data.storages[target].astype(complex)
            stepped.flat[k] += 1j * STEP
            moved = dataclasses.replace(data, storages={**data.storages, target: stepped})
            columns.append(np.asarray(of(Interpreter(module, moved))).imag / STEP)
    return np.array(columns)


def dense_assembly(module: ModuleOp, data: SceneData) -> tuple[Array, Array]:
    """Gradient and Hessian by the interpreter."""
    gradient, hessian = Interpreter(module, data).assemble()
    return gradient, hessian.toarray()


# -- energies ----------------------------------------------------------------------------------------------


def stable_neo_hookean(tets: Primitive, corners: Connectivity, position: Attribute, rest: Attribute) -> Attribute:
    """Smith, de Goes, Kim 2018, eq. 14 (without its constant), per unit of volume, with F written in x."""
    x = tets.add_attribute("positions", through=corners, source=position)
    r = tets.add_attribute("rest_positions", through=corners, source=rest)
    deformed = concat_rows([x.row(i) - x.row(0) for i in (1, 2, 3)]).T
    reference = concat_rows([r.row(i) - r.row(0) for i in (1, 2, 3)]).T
    f = deformed * reference.inverse()
    mu, la = 2.0, 3.0
    invariant, volume = f.dot(f), f.det()
    alpha = 1.0 + 0.75 * mu / la
    spread = volume - alpha
    return 0.5 * mu * (invariant - 3.0) - 0.5 * mu * (invariant + 1.0).log() + 0.5 * la * spread * spread


def point_point(positions: Attribute, reach: float = 2.5, stiffness: float = 10.0) -> Attribute:
    """A barrier between two points (paper, 10.4)."""
    between = positions.row(1) - positions.row(0)
    d = between.dot(between)
    log = (d / reach).log()
    gap = d - reach
    return stiffness * gap * gap * log * log


# -- scenes ------------------------------------------------------------------------------------------------

TETS = [[0, 1, 2, 3], [1, 2, 3, 4], [2, 3, 4, 5]]


def soft_tets(projection: str = "clamp", name: str = "soft", stretch: float = 0.3) -> Scene:
    """Three tetrahedra on six free vertices; stretched enough to have indefinite Hessians."""
    random = np.random.default_rng(1)
    scene = Scene(name)
    mesh = scene.add_mesh("m")
    vertices, tets = mesh.add_primitive("v", 6), mesh.add_primitive("t", 3)
    corners = tets.add_connectivity("corners", vertices, TETS, 4)
    rest = random.random((6, 3))
    vertices.add_constant("rest", 3, 1, value=rest)
    vertices.add_attribute("x", 3, 1, value=rest + stretch * random.standard_normal((6, 3)))
    energy = stable_neo_hookean(tets, corners, vertices["x"], vertices["rest"])
    scene.add_energy(tets.add_attribute("elastic", computed_attribute=energy), projection=projection)
    scene.add_minimize_target(vertices["x"])
    return scene


PAIRS = [[0, 7], [1, 9], [0, 1], [8, 3]]
"""Affine with soft, soft with affine, affine with itself."""


def mixed_union(projection: str = "clamp", pairs: list[list[int]] | None = None, name: str = "mixed") -> Scene:
    """An affine body (rigidity and springs) and a soft one, the union of their vertices, barriers, gravity on all."""
    random = np.random.default_rng(1)
    scene = Scene(name)
    stiff, soft, both = (scene.add_mesh(word) for word in ("stiff", "soft", "both"))
    body, points = stiff.add_primitive("body", 1), stiff.add_primitive("v", 5)
    body.add_attribute("A", 3, 3, value=np.eye(3) + 0.1 * random.standard_normal((3, 3)))
    body.add_attribute("t", 3, 1, value=[0.1, 0.2, 0.3])
    points.add_constant("rest", 3, 1, value=random.random((5, 3)))
    owner = points.add_connectivity("owner", body, [0] * 5, 1)
    a = points.add_attribute("A", through=owner, source=body["A"]).resize(3, 3)
    t = points.add_attribute("t", through=owner, source=body["t"]).resize(3, 1)
    points.add_attribute("x", computed_attribute=a * points["rest"] + t)
    shear = body["A"].T * body["A"] - np.eye(3)
    scene.add_energy(body.add_attribute("rigid", computed_attribute=5.0 * shear.dot(shear)), projection=projection)
    springs = stiff.add_primitive("s", 3)
    spring_ends = springs.add_connectivity("ends", points, [[0, 1], [1, 4], [3, 2]], 2)
    pair = springs.add_attribute("pair", through=spring_ends, source=points["x"])
    stretch = (pair.row(0) - pair.row(1)).norm() - 2.0
    scene.add_energy(springs.add_attribute("spring", computed_attribute=stretch * stretch), projection=projection)

    free, tets = soft.add_primitive("v", 6), soft.add_primitive("t", 3)
    rest = random.random((6, 3))
    free.add_constant("rest", 3, 1, value=rest)
    free.add_attribute("x", 3, 1, value=rest + 0.3 * random.standard_normal((6, 3)))
    soft_corners = tets.add_connectivity("corners", free, TETS, 4)
    corner = tets.add_attribute("positions", through=soft_corners, source=free["x"])
    excess = concat_rows([corner.row(i) - corner.row(0) for i in (1, 2, 3)]).det() - tets.add_constant(
        "volume", 1, 1, value=random.random(3)
    )
    scene.add_energy(tets.add_attribute("swell", computed_attribute=30.0 * excess * excess), projection=projection)

    union = both.add_primitive_union("v", [points, free])
    x = union.add_attribute("x")
    gravity = 9.8 * x[2] + x.dot(x)
    scene.add_energy(union.add_attribute("gravity", computed_attribute=gravity), projection=projection)
    contacts = both.add_primitive("pp", 0, is_dynamic=True)
    ends = contacts.add_connectivity("ends", union, [], 2)
    positions = contacts.add_attribute("positions", through=ends, source=x)
    barrier = contacts.add_attribute("barrier", computed_attribute=point_point(positions))
    scene.add_energy(barrier, projection=projection)
    ends.update_value(PAIRS if pairs is None else pairs)
    scene.add_minimize_target([free["x"], body["A"], body["t"]])
    return scene


def shared_targets(projection: str = "clamp", name: str = "shared") -> Scene:
    """Springs whose stiffness is a variable of the scene, on vertices shifted by a variable of their mesh.

    Energies live on a primitive, a mesh and the scene.
    """
    random = np.random.default_rng(3)
    scene = Scene(name)
    mesh = scene.add_mesh("m")
    vertices, springs = mesh.add_primitive("v", 4), mesh.add_primitive("s", 5)
    scene.add_attribute("k", 1, 1, value=[1.7])
    mesh.add_attribute("shift", 3, 1, value=[0.2, -0.1, 0.4])
    vertices.add_attribute("x", 3, 1, value=random.random((4, 3)))
    springs.add_constant("length", 1, 1, value=0.5 + random.random(5))
    ends = springs.add_connectivity("ends", vertices, [[0, 1], [1, 2], [2, 3], [3, 0], [1, 1]], 2)
    moved = vertices.add_attribute("moved", computed_attribute=vertices["x"] + mesh["shift"])
    pair = springs.add_attribute("pair", through=ends, source=moved)
    between = pair.row(1) - pair.row(0)
    excess = between.dot(between) - springs["length"]
    stretch = springs.add_attribute("stretch", computed_attribute=scene["k"] * scene["k"] * excess * excess)
    scene.add_energy(stretch, projection=projection)
    pull = vertices.add_attribute("pull", computed_attribute=moved.dot(mesh["shift"]) * scene["k"].exp())
    scene.add_energy(pull, projection=projection)
    scene.add_energy(
        mesh.add_attribute("anchor", computed_attribute=mesh["shift"].norm() * scene["k"]), projection=projection
    )
    scene.add_energy(scene.add_attribute("well", computed_attribute=scene["k"] ** 4 + scene["k"].cos()))
    scene.add_minimize_target([scene["k"], vertices["x"], mesh["shift"]])
    return scene


SCENES: dict[str, Callable[..., Scene]] = {
    "soft_tets": soft_tets,
    "mixed_union": mixed_union,
    "shared_targets": shared_targets,
}
