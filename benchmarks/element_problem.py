"""The problems of the benchmarks `elements` and `cloth`: elements of one kind, deformed as far as wanted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.kernel_problem import on_cpu, projected_share
from benchmarks.on_device import Where, new_scene
from yasps import Attribute, Connectivity, Mesh, PrimitiveBase, Scene, materials
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.meshes import TetrahedralMesh, box, cloth_grid, hinges_of

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

YOUNGS_MODULUS, POISSON_RATIO = 5e4, 0.4  # Pa
MU, LAMBDA = materials.stable_neo_hookean_parameters(YOUNGS_MODULUS, POISSON_RATIO)
STRETCH_STIFFNESS, SHEAR_STIFFNESS = 2e3, 1e3  # J/m^2
# Stretched evenly by this much every tet has a semidefinite Hessian; noise then makes some indefinite.
STRETCH = 1.05
LARGEST_NOISE = 1.0  # in cells
NOISY = 0.2  # in cells: nearly all elements of cloth need projection
BISECTIONS = 14


def _tet_energy(x: Attribute, constants: Mapping[str, Attribute]) -> Attribute:
    deformation = materials.deformation_gradient(x, constants["inverse"])
    return materials.stable_neo_hookean(deformation, constants["mu"], constants["lambda"], constants["volume"])


def _triangle_energy(x: Attribute, constants: Mapping[str, Attribute]) -> Attribute:
    deformation = materials.triangle_deformation(x, constants["inverse"])
    return materials.baraff_witkin(deformation, constants["stretch"], constants["shear"], constants["area"])


def _hinge_energy(x: Attribute, constants: Mapping[str, Attribute]) -> Attribute:
    return materials.hinge_bending(x, constants["stiffness"])


@dataclass(frozen=True)
class ElementKind:
    """One energy: of corner positions [arity, 3], of constants of each element, and of constants of all of them."""

    name: str
    energy: Callable[[Attribute, Mapping[str, Attribute]], Attribute]
    common: Mapping[str, float]


NEO_HOOKEAN = ElementKind("stable_neo_hookean", _tet_energy, {"mu": MU, "lambda": LAMBDA})
BARAFF_WITKIN = ElementKind("baraff_witkin", _triangle_energy, {"stretch": STRETCH_STIFFNESS, "shear": SHEAR_STIFFNESS})
HINGE = ElementKind("hinge_bending", _hinge_energy, {})


@dataclass(frozen=True)
class Elements:
    """Elements at rest and the noise that deforms them.

    vertices: [n, 3]; corners: int32 [m, arity]; constants: of each element, [m, ...]; noise: [n, 3], in -1 .. 1 times
    the length of a cell.
    """

    kind: ElementKind
    vertices: FloatArray
    corners: IntArray
    constants: dict[str, FloatArray]
    noise: FloatArray

    def __len__(self) -> int:
        return len(self.corners)

    def deformed(self, amplitude: float) -> FloatArray:
        """Positions [n, 3]: an even stretch, and noise of this amplitude, independent at each vertex."""
        return STRETCH * self.vertices + amplitude * self.noise

    def exploded(self) -> Elements:
        """The same elements, none of which share a vertex: assembling them stores each by itself, adds nothing up."""
        corners = self.corners.reshape(-1)
        own = np.arange(corners.size, dtype=np.int32).reshape(self.corners.shape)
        return replace(self, vertices=self.vertices[corners], corners=own, noise=self.noise[corners])


def _noise(vertices: FloatArray, cell: float) -> FloatArray:
    return np.random.default_rng(0).uniform(-1.0, 1.0, vertices.shape) * cell


def tets_of(mesh: TetrahedralMesh) -> Elements:
    """The tets of a mesh; a cell is the edge of a cube that holds six of the mean."""
    inverse, volume = materials.rest_shape(mesh.vertices, mesh.tets)
    cell = float((6 * volume.mean()) ** (1 / 3))
    constants = {"inverse": inverse, "volume": volume}
    return Elements(NEO_HOOKEAN, mesh.vertices, mesh.tets, constants, _noise(mesh.vertices, cell))


def box_of_tets(size: int) -> Elements:
    """A cube of about `size` tets, at least 6."""
    cells = max(1, round((size / 6) ** (1 / 3)))
    return tets_of(box(divisions=(cells, cells, cells)))


def cloth_triangles(size: int) -> Elements:
    """A square piece of cloth of about `size` triangles, at least 8."""
    cells = max(2, round((size / 2) ** 0.5))
    cloth = cloth_grid(divisions=(cells, cells))
    inverse, area = materials.rest_triangles(cloth.vertices, cloth.triangles)
    constants = {"inverse": inverse, "area": area}
    return Elements(BARAFF_WITKIN, cloth.vertices, cloth.triangles, constants, _noise(cloth.vertices, 1 / cells))


def cloth_hinges(size: int) -> Elements:
    """The hinges of a square piece of cloth, about `size` of them, at least 8."""
    cells = max(2, round((size / 3) ** 0.5))
    cloth = cloth_grid(divisions=(cells, cells))
    corners = hinges_of(cloth.triangles)
    edge = cloth.vertices[corners[:, 1]] - cloth.vertices[corners[:, 0]]
    sides = [cloth.vertices[corners[:, k]] - cloth.vertices[corners[:, 0]] for k in (2, 3)]
    area = sum(0.5 * np.linalg.norm(np.cross(edge, side), axis=1) for side in sides)
    stiffness = 3 * (edge * edge).sum(axis=1) / area
    return Elements(HINGE, cloth.vertices, corners, {"stiffness": stiffness}, _noise(cloth.vertices, 1 / cells))


def first_of(elements: Elements, most: int) -> Elements:
    """At most so many of the elements; all vertices stay."""
    constants = {name: np.ascontiguousarray(values[:most]) for name, values in elements.constants.items()}
    corners = np.ascontiguousarray(elements.corners[:most])
    return Elements(elements.kind, elements.vertices, corners, constants, elements.noise)


@dataclass(frozen=True)
class Problem:
    """The scene of these elements, with one energy and one target."""

    elements: Elements
    position: Attribute
    corners: Connectivity
    compiled: CpuScene
    threads: int

    def deform(self, amplitude: float) -> None:
        """Moves the vertices."""
        self.position.update_value(self.elements.deformed(amplitude))

    def projected_share(self) -> float:
        """Share of the elements whose Hessian the assembler has to project as they are deformed now."""
        return projected_share(self.compiled)

    def amplitude_for(self, share: float) -> float:
        """The amplitude of noise at which about this share of the elements needs projection."""
        if share == 0:
            return 0.0
        low, high = 0.0, LARGEST_NOISE
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            self.deform(middle)
            low, high = (middle, high) if self.projected_share() < share else (low, middle)
        return high


@dataclass(frozen=True)
class ElementsScene:
    """A scene of elements, nothing compiled yet."""

    scene: Scene
    position: Attribute
    corners: Connectivity


def elements_scene(elements: Elements, where: Where) -> ElementsScene:
    """The scene of these elements, with one energy and one target."""
    scene = new_scene("elements", where)
    position, corners = add_elements(scene, "body", elements)
    scene.add_minimize_target(position)
    return ElementsScene(scene, position, corners)


def add_elements(scene: Scene, name: str, elements: Elements) -> tuple[Attribute, Connectivity]:
    """Adds a mesh with these elements and their energy; returns the positions and the corners."""
    body = scene.add_mesh(name)
    vertices = body.add_primitive("vertices", num_instances=len(elements.vertices))
    position = vertices.add_attribute("position", rows=3, cols=1, value=elements.vertices)
    return position, add_energy(body, vertices, elements)


def add_energy(body: Mesh, vertices: PrimitiveBase, elements: Elements) -> Connectivity:
    """Adds these elements between vertices with a `position`, and their energy; returns the corners."""
    primitive = body.add_primitive("elements", num_instances=len(elements))
    corners = primitive.add_connectivity("corners", vertices, elements.corners, elements.corners.shape[1])
    x = primitive.add_attribute("positions", through=corners, source=vertices["position"])
    constants = {
        key: body.add_constant(key, rows=1, cols=1, value=value) for key, value in elements.kind.common.items()
    }
    for key, value in elements.constants.items():
        rows, cols = value.shape[1:] or (1, 1)
        constants[key] = primitive.add_constant(key, rows=rows, cols=cols, value=value)
    energy = elements.kind.energy(x, constants)
    body.scene.add_energy(primitive.add_attribute(elements.kind.name, computed_attribute=energy))
    return corners


def make_problem(elements: Elements, threads: int) -> Problem:
    """The scene, compiled and its structure built."""
    made = elements_scene(elements, threads)
    compiled = on_cpu(made.scene.compile())
    compiled.update_structure()
    return Problem(elements, made.position, made.corners, compiled, threads)
