"""What one instance of every part of the kit costs: gradient and projected Hessian, and the width of the projection.

Each part is put on a piece of matter that has it: solids on a box of tetrahedra, sheets on a cloth, rods on a helix. A
new part is a row of PARTS.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from xdsl.dialects.builtin import ModuleOp

from benchmarks.kernel_problem import UNIT
from benchmarks.measure import Peer, Report, Row, Settings, measure
from yasps import Attribute, Scene, constant, materials
from yasps.dialects.rel import DerivativeOp, ProjectOp
from yasps.frontend.commands.environment_report import cpu_model
from yasps.meshes import box, cloth_grid, hinge_stiffness, hinges_of
from yasps.runtime.core.library import available_processors

DESCRIPTION = "every energy of the kit: width of the projection, nanoseconds an instance of gradient and Hessian"
DEFAULT_SIZE = 20_000
NOISE = 0.05  # of the size of a cell: by how much vertices are moved from rest

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Matter:
    """Instances of an energy over vertices: what it is given, by name."""

    scene: Scene
    instances: int
    given: Mapping[str, Attribute]


@dataclass(frozen=True)
class PartRow:
    """A part, as a function of the matter it is put on."""

    name: str
    matter: Callable[[int], Matter]
    energy: Callable[..., Attribute]

    def scene(self, size: int) -> tuple[Scene, int]:
        """A scene of this part alone, of about so many instances, and how many they are."""
        matter = self.matter(size)
        first = next(iter(matter.given.values()))
        energy = first.owner.add_attribute("energy", computed_attribute=self.energy(**matter.given))
        matter.scene.add_energy(energy)
        return matter.scene, matter.instances


def _over_vertices(
    vertices: FloatArray, corners: NDArray[np.int32], constants: Mapping[str, Any], cell: float
) -> Matter:
    """Instances joined to vertices, which are the unknowns and not quite at rest."""
    scene = Scene("part", threads=1)
    mesh = scene.add_mesh("m")
    points = mesh.add_primitive("vertices", len(vertices))
    moved = vertices + NOISE * cell * np.random.default_rng(0).uniform(-1, 1, vertices.shape)
    position = points.add_attribute("position", 3, 1, value=moved)
    scene.add_minimize_target(position)
    pieces = mesh.add_primitive("pieces", len(corners))
    joined = pieces.add_connectivity("corners", points, corners, corners.shape[1])
    given = {"positions": pieces.add_attribute("positions", through=joined, source=position)}
    for name, values in constants.items():
        numbers = np.asarray(values, float)
        given[name] = pieces.add_constant(name, *(numbers.shape[1:] or (1, 1)), value=numbers)
    return Matter(scene, len(corners), given)


def _solid(size: int) -> Matter:
    cells = max(1, round((size / 6) ** (1 / 3)))
    mesh = box(divisions=(cells, cells, cells))
    inverse, volume = materials.rest_shape(mesh.vertices, mesh.tets)
    constants = {
        "inverse": inverse,
        "volume": volume,
        "direction": np.tile([[0.6], [0.8], [0.0]], (len(volume), 1, 1)),
        "previous_strain": np.zeros((len(volume), 3, 3)),
    }
    return _over_vertices(mesh.vertices, mesh.tets, constants, 1 / cells)


def _sheet(size: int) -> Matter:
    cells = max(2, round((size / 2) ** 0.5))
    cloth = cloth_grid(divisions=(cells, cells))
    inverse, area = materials.rest_triangles(cloth.vertices, cloth.triangles)
    return _over_vertices(cloth.vertices, cloth.triangles, {"inverse": inverse, "area": area}, 1 / cells)


def _hinges(size: int) -> Matter:
    cells = max(2, round((size / 3) ** 0.5))
    cloth = cloth_grid(divisions=(cells, cells))
    hinges = hinges_of(cloth.triangles)
    constants = {
        "rest_angle": materials.hinge_angles(cloth.vertices, hinges),
        "weights": materials.quadratic_bending_weights(cloth.vertices, hinges)[:, :, None],
        "stiffness": hinge_stiffness(cloth.vertices, hinges, 1.0),
    }
    return _over_vertices(cloth.vertices, hinges, constants, 1 / cells)


def _helix(size: int) -> FloatArray:
    along = np.linspace(0.0, 0.1 * size, size)
    return np.stack([np.cos(along), np.sin(along), 0.1 * along], axis=1)


def _segments(size: int) -> Matter:
    points = _helix(size + 1)
    ends = np.arange(size, dtype=np.int32)[:, None] + np.arange(2, dtype=np.int32)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return _over_vertices(points, ends, {"rest_length": lengths}, 0.1)


def _rod(size: int) -> Matter:
    """The vertices between segments, with frames and an angle for each segment."""
    points = _helix(size + 2)
    triples = np.arange(size, dtype=np.int32)[:, None] + np.arange(3, dtype=np.int32)
    pairs = triples[:, :2]
    directors, tangents = materials.rod_directors(points), materials.rod_tangents(points)
    constants = {
        "previous": points[triples],
        "directors": directors[pairs],
        "reference_twist": materials.reference_twists(tangents, directors),
        "rest_length": np.linalg.norm(np.diff(points, axis=0), axis=1)[pairs].sum(axis=1),
        "rest_curvature": np.zeros((size, 2, 1)),
        "stiffness": np.tile([[1.0], [2.0]], (size, 1, 1)),
    }
    matter = _over_vertices(points, triples, constants, 0.1)
    pieces = matter.given["positions"].owner
    segments = matter.scene.m.add_primitive("segments", size + 1)
    angle = segments.add_attribute("angle", 1, 1, value=np.linspace(0.0, 1.0, size + 1))
    matter.scene.add_minimize_target(angle)
    joined = pieces.add_connectivity("segments", segments, pairs, 2)
    angles = pieces.add_attribute("angles", through=joined, source=angle)
    return Matter(matter.scene, size, {**matter.given, "angles": angles})


def _joints(size: int) -> Matter:
    """Between tetrahedra and the next ones, each a frame in the middle of its own."""
    solid = box(divisions=(max(1, round((size / 6) ** (1 / 3))),) * 3)
    pairs = np.hstack([solid.tets, np.roll(solid.tets, 1, axis=0)])
    system = np.concatenate([solid.vertices[solid.tets].swapaxes(1, 2), np.ones((len(solid.tets), 1, 4))], axis=1)
    right = np.broadcast_to(np.vstack([np.hstack([np.zeros((3, 1)), np.eye(3)]), [[1, 0, 0, 0]]]), (len(system), 4, 4))
    right = right.copy()
    right[:, :3, 0] = solid.vertices[solid.tets].mean(axis=1)
    weights = np.linalg.solve(system, right).swapaxes(1, 2)
    constants = {"first_weights": weights, "second_weights": np.roll(weights, 1, axis=0)}
    return _over_vertices(solid.vertices, pairs, constants, len(pairs) ** (-1 / 3))


def _of_frames(energy: Callable[..., Attribute]) -> Callable[..., Attribute]:
    """The energy of two frames."""

    def of(positions: Attribute, first_weights: Attribute, second_weights: Attribute) -> Attribute:
        corners = positions.block(0, 0, 4, 3), positions.block(4, 0, 4, 3)
        return energy(materials.frame_of(corners[0], first_weights), materials.frame_of(corners[1], second_weights))

    return of


def _of_solid(energy: Callable[..., Attribute], *numbers: float, **more: float | str) -> Callable[..., Attribute]:
    """The energy of a deformation gradient, with these numbers, or names of constants, beside the volume."""

    def of(positions: Attribute, inverse: Attribute, volume: Attribute, **others: Attribute) -> Attribute:
        constants = {key: others[value] if isinstance(value, str) else value for key, value in more.items()}
        return energy(materials.deformation_gradient(positions, inverse), *numbers, volume=volume, **constants)

    return of


def _of_sheet(energy: Callable[..., Attribute], *numbers: float, **more: float) -> Callable[..., Attribute]:
    """The same of a triangle."""
    return lambda positions, inverse, area: energy(
        materials.triangle_deformation(positions, inverse), *numbers, area=area, **more
    )


ROD_STATE = ("positions", "previous", "directors", "angles")


def _material_bending(**given: Attribute) -> Attribute:
    curvature = materials.material_curvature(*[given[name] for name in ROD_STATE])
    return materials.rod_material_bending(curvature, given["rest_curvature"], given["rest_length"], given["stiffness"])


def _twisting(**given: Attribute) -> Attribute:
    twist = materials.rod_twist(*[given[name] for name in ROD_STATE], given["reference_twist"])
    return materials.rod_twisting(twist, 0.0, given["rest_length"], 1.0)


LAME = materials.lame_parameters(1e5, 0.3)
PARTS = (
    PartRow("linear_elasticity", _solid, _of_solid(materials.linear_elasticity, *LAME)),
    PartRow("st_venant_kirchhoff", _solid, _of_solid(materials.st_venant_kirchhoff, *LAME)),
    PartRow("fixed_corotated", _solid, _of_solid(materials.fixed_corotated, *LAME)),
    PartRow("neo_hookean", _solid, _of_solid(materials.neo_hookean, *LAME)),
    PartRow("stable_neo_hookean", _solid, _of_solid(materials.stable_neo_hookean, *LAME)),
    PartRow("mooney_rivlin", _solid, _of_solid(materials.mooney_rivlin, 1e4, 5e3, 1e5)),
    PartRow(
        "holzapfel_fibres",
        _solid,
        _of_solid(materials.holzapfel_fibres, direction="direction", stiffness=1e4, stiffening=2.0),
    ),
    PartRow(
        "strain_rate_damping",
        _solid,
        _of_solid(
            materials.strain_rate_damping, previous_strain="previous_strain", viscosity=10.0, effective_step=0.01
        ),
    ),
    PartRow("st_venant_membrane", _sheet, _of_sheet(materials.st_venant_membrane, *LAME, thickness=0.01)),
    PartRow("neo_hookean_membrane", _sheet, _of_sheet(materials.neo_hookean_membrane, LAME[0], thickness=0.01)),
    PartRow("strain_limiting", _sheet, _of_sheet(materials.strain_limiting, 0.01, 1e6, thickness=0.01)),
    PartRow("baraff_witkin", _sheet, _of_sheet(materials.baraff_witkin, 1e3, 1e2)),
    PartRow("inner_pressure", _sheet, lambda positions, inverse, area: materials.inner_pressure(positions, 1e3)),
    PartRow(
        "hinge_bending",
        _hinges,
        lambda positions, stiffness, **rest: materials.hinge_bending(positions, stiffness),
    ),
    PartRow(
        "discrete_shell_bending",
        _hinges,
        lambda positions, rest_angle, stiffness, weights: materials.discrete_shell_bending(
            positions, rest_angle, stiffness
        ),
    ),
    PartRow(
        "quadratic_bending",
        _hinges,
        lambda positions, weights, **rest: materials.quadratic_bending(positions, weights, 1.0),
    ),
    PartRow("spring", _segments, lambda positions, rest_length: materials.spring(positions, rest_length, 1e3)),
    PartRow(
        "rod_stretching",
        _segments,
        lambda positions, rest_length: materials.rod_stretching(positions, rest_length, 1e3),
    ),
    PartRow(
        "rod_bending",
        _rod,
        lambda positions, rest_length, **rest: materials.rod_bending(positions, rest_length, 1.0),
    ),
    PartRow("rod_material_bending", _rod, _material_bending),
    PartRow("rod_twisting", _rod, _twisting),
    PartRow("held_together", _joints, _of_frames(lambda e, f: materials.held_together(e, f, 1e3))),
    PartRow("aligned", _joints, _of_frames(lambda e, f: materials.aligned(e, f, constant([1.0, 2.0, 3.0])))),
    PartRow("on_the_axis", _joints, _of_frames(lambda e, f: materials.on_the_axis(e, f, 1e3))),
    PartRow(
        "motor",
        _joints,
        _of_frames(lambda e, f: materials.motor(materials.joint_angle(e, f, 0.0), 0.1, 10.0, 5.0)),
    ),
    PartRow(
        "angle_limits",
        _joints,
        _of_frames(lambda e, f: materials.angle_limits(materials.joint_angle(e, f, 0.0), -0.01, 0.01, 1e3)),
    ),
)


def run(settings: Settings) -> Report:
    """Times all parts on one thread, one after the other."""
    rows: list[Row] = []
    for part in PARTS:
        scene, instances = part.scene(settings.size)
        compiled = scene.compile()
        rows.append(Row(part.name, "width of projection", 1, float(projected_width(compiled.module)), "unknowns"))
        peer = Peer(part.name, "yasps", 1, compiled.assemble, 1e9 / instances, UNIT)
        rows += measure([peer], settings.repeats)
    return Report(
        rows, [f"{cpu_model()}, {available_processors()} processors; about {settings.size:,} instances.", *NOTES]
    )


def projected_width(module: ModuleOp) -> int:
    """Rows of the matrices that a scene's one energy has projected; 0 if there is nothing to project.

    module: the scene's IR after all passes.
    """
    (derivative,) = (op for op in module.walk() if isinstance(op, DerivativeOp))
    widths = [op.width.value.data for op in derivative.walk() if isinstance(op, ProjectOp)]
    return int(widths[0]) if widths else 0


NOTES = (
    f"Gradient and Hessian, projected where that is needed and added to the matrix, vertices {NOISE:.0%} of a cell "
    "away from rest; how many of the Hessians are indefinite there differs from part to part.",
)
