"""Systems that the benchmark `solver` solves: one Newton system of four scenes that differ in what makes them hard."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.kernel_problem import on_cpu
from benchmarks.on_device import Where, new_scene
from yasps import Attribute, Mesh, Primitive, Scene, materials
from yasps.contact import BarrierContact
from yasps.frontend.execution.compiled_scene import CompiledScene
from yasps.meshes import TetrahedralMesh, box
from yasps.runtime.matrix.block_matrix import BlockMatrix

TIME_STEP = 0.01  # s
DENSITY = 1000.0  # kg/m^3
POISSON_RATIO = 0.4
GAP = 1e-3  # m, activation distance


@dataclass(frozen=True)
class SolverProblem:
    """Assembled H and g of H x = g, and how many pairs are in contact."""

    name: str
    compiled: CompiledScene
    gradient: NDArray[np.float64]
    contacts: int = 0

    @property
    def parts(self) -> list[BlockMatrix]:
        """Their sum is H. Not on a device."""
        compiled = on_cpu(self.compiled)
        return [compiled.static_matrix, compiled.dynamic_matrix]


def soft(unknowns: int, where: Where) -> SolverProblem:
    """A cube of rubber in motion: inertia outweighs stiffness."""
    return _cube("soft", unknowns, where, youngs_modulus=1e4)


def stiff(unknowns: int, where: Where) -> SolverProblem:
    """The same of a material 1e5 times stiffer."""
    return _cube("stiff", unknowns, where, youngs_modulus=1e9)


def quasi_static(unknowns: int, where: Where) -> SolverProblem:
    """A beam held at one end bends under its weight; there is no inertia."""
    n = max(1, round((unknowns / 3 / 16) ** (1 / 3)))
    shape = box((1.6, 0.1, 0.1), (16 * n, n, n))
    scene = new_scene("quasi_static", where)
    mesh = scene.add_mesh("beam")
    vertices, position = _add_vertices(mesh, shape, 0.0)
    mass = vertices.add_constant("mass", 1, 1, value=shape.vertex_masses(DENSITY))
    held = 1e7 * (np.abs(shape.vertices[:, 0] - shape.vertices[:, 0].min()) < 1e-9)
    offset = position - vertices.add_constant("rest", 3, 1, value=shape.vertices)
    hold = 0.5 * vertices.add_constant("held", 1, 1, value=held) * offset.dot(offset)
    scene.add_energy(vertices.add_attribute("hold", computed_attribute=hold))
    weight = materials.gravity(position, mass, (0.0, 0.0, -9.8))
    scene.add_energy(vertices.add_attribute("weight", computed_attribute=weight))
    _add_elastic(mesh, vertices, position, shape, 1e6)
    scene.add_minimize_target(position)
    return _assembled("quasi-static", scene)


def in_contact(unknowns: int, where: Where) -> SolverProblem:
    """Two slabs pressed together: barriers between all facing vertices and edges, far stiffer than the slabs.

    The right-hand side is what presses them, without the barriers' own forces: as close to rest, where these balance.
    """
    n = max(2, round((unknowns / 3 / 2 / 5) ** 0.5))
    lower = box((0.2, 0.2, 0.02), (n, n, 4)).translated((0.0, 0.0, -0.01))
    # Half a cell aside, so that no edges are parallel on top of each other and vertices face triangles.
    upper = box((0.2, 0.2, 0.02), (n, n, 4)).translated((0.05 / n, 0.03 / n, 0.01 + 0.2 * GAP))
    scene = new_scene("in_contact", where)
    members, loads = [], []
    for name, shape, pressure in (("lower", lower, -1.0), ("upper", upper, 1.0)):
        mesh = scene.add_mesh(name)
        vertices, position = _add_vertices(mesh, shape, 0.0)
        loads.append(shape.vertex_masses(DENSITY)[:, None] * pressure * np.array([3.0, 2.0, 10.0]))
        _add_inertia(vertices, position, shape)
        _add_elastic(mesh, vertices, position, shape, 1e5)
        scene.add_minimize_target(position)
        members.append(vertices)
    everything = scene.add_mesh("everything")
    union = everything.add_primitive_union("vertices", members)
    union.add_attribute("position")
    triangles = np.concatenate([lower.surface_triangles(), upper.surface_triangles() + len(lower.vertices)])
    # Inside a slab nothing meets.
    group = np.repeat([0, 1], [len(lower.vertices), len(upper.vertices)])
    contact = BarrierContact(
        everything, union, triangles, activation_distance=GAP, barrier="paper", stiffness=100.0 / GAP**3, group=group
    )
    return replace(_assembled("in contact", scene, len(contact.active)), gradient=np.concatenate(loads).reshape(-1))


MakeProblem: TypeAlias = Callable[[int, Where], SolverProblem]
"""Unknowns, about, and where."""
PROBLEMS: tuple[MakeProblem, ...] = (soft, stiff, quasi_static, in_contact)


def _cube(name: str, unknowns: int, where: Where, youngs_modulus: float) -> SolverProblem:
    n = max(1, round((unknowns / 3) ** (1 / 3)) - 1)
    shape = box((0.2, 0.2, 0.2), (n, n, n))
    scene = new_scene(name, where)
    mesh = scene.add_mesh("cube")
    vertices, position = _add_vertices(mesh, shape, 0.01)
    _add_inertia(vertices, position, shape)
    _add_elastic(mesh, vertices, position, shape, youngs_modulus)
    scene.add_minimize_target(position)
    return _assembled(name, scene)


def _add_vertices(mesh: Mesh, shape: TetrahedralMesh, bent: float) -> tuple[Primitive, Attribute]:
    """Vertices, smoothly off their places at rest by this share of the size."""
    vertices = mesh.add_primitive("vertices", len(shape.vertices))
    size = np.ptp(shape.vertices, axis=0).max()
    bend = bent * size * np.sin(2 * np.pi * shape.vertices[:, [1, 2, 0]] / size)
    return vertices, vertices.add_attribute("position", 3, 1, value=shape.vertices + bend)


def _add_inertia(vertices: Primitive, position: Attribute, shape: TetrahedralMesh) -> None:
    mass = vertices.add_constant("mass", 1, 1, value=shape.vertex_masses(DENSITY))
    predicted = vertices.add_constant("predicted", 3, 1, value=shape.vertices)
    inertia = materials.inertia(position, predicted, mass, TIME_STEP)
    vertices.scene.add_energy(vertices.add_attribute("inertia", computed_attribute=inertia))


def _add_elastic(
    mesh: Mesh, vertices: Primitive, position: Attribute, shape: TetrahedralMesh, youngs_modulus: float
) -> None:
    tets = mesh.add_primitive("tets", len(shape.tets))
    corners = tets.add_connectivity("corners", vertices, shape.tets, 4)
    x = tets.add_attribute("positions", through=corners, source=position)
    inverse, volume = materials.rest_shape(shape.vertices, shape.tets)
    f = materials.deformation_gradient(x, tets.add_constant("inverse", 3, 3, value=inverse))
    mu, lam = materials.stable_neo_hookean_parameters(youngs_modulus, POISSON_RATIO)
    elastic = materials.stable_neo_hookean(f, mu, lam, tets.add_constant("volume", 1, 1, value=volume))
    mesh.scene.add_energy(tets.add_attribute("elastic", computed_attribute=elastic))


def _assembled(name: str, scene: Scene, contacts: int = 0) -> SolverProblem:
    compiled = scene.compile()
    return SolverProblem(name, compiled, compiled.assemble(), contacts)
