"""Shells, rods and closed surfaces of many pieces: against closed forms, and what must not change an energy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from small_scenes import dense_assembly, emit

from yasps import Attribute, Primitive, Scene, SceneError, ShapeMismatchError, materials
from yasps.backend.reference.interpreter import Interpreter
from yasps.meshes import hinge_stiffness, hinges_of, triangle_areas
from yasps.passes.pipeline import run_pipeline

Array = NDArray[np.float64]


class Pieces:
    """Vertices, and a primitive whose instances are joined to them."""

    def __init__(self, points: Array, corners: Array) -> None:
        self.scene = Scene("pieces", threads=1)
        mesh = self.scene.add_mesh("m")
        self.vertices = mesh.add_primitive("v", len(points))
        self.x = self.vertices.add_attribute("x", 3, 1, value=points)
        self.pieces: Primitive = mesh.add_primitive("p", len(corners))
        joined = self.pieces.add_connectivity("corners", self.vertices, corners, corners.shape[1])
        self.positions = self.pieces.add_attribute("positions", through=joined, source=self.x)

    def constant(self, name: str, numbers: Array) -> Attribute:
        """One row of numbers for each piece."""
        return self.pieces.add_constant(name, *numbers.shape[1:], value=numbers)

    def energies(self, energy: Attribute) -> Array:
        """Of every piece."""
        self.scene.add_energy(self.pieces.add_attribute("energy", computed_attribute=energy), projection="none")
        self.scene.add_minimize_target(self.x)
        emitted = emit(self.scene)
        return Interpreter(emitted.module, emitted.data).value("m.p.energy").ravel()

    def gradient(self) -> Array:
        """Of the energy that was asked for, [vertices, 3]."""
        emitted = emit(self.scene)
        return dense_assembly(run_pipeline(emitted.module), emitted.data)[0].reshape(-1, 3)


def sheet(n: int) -> tuple[Array, Array]:
    """A square of side 1 cut into 2 n^2 right triangles."""
    xs, ys = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    points = np.stack([xs.ravel(), ys.ravel(), 0 * xs.ravel()], axis=1)
    at = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    return points, np.array([*zip(a, b, c, strict=True), *zip(a, c, d, strict=True)], np.int32)


def equilateral_sheet(n: int) -> tuple[Array, Array]:
    """A parallelogram of 2 n^2 equilateral triangles of side 1 / n."""
    points, triangles = sheet(n)
    return points @ np.array([[1.0, 0, 0], [-0.5, np.sqrt(0.75), 0], [0, 0, 1]]), triangles


def rolled(points: Array, curvature: float, direction: float = 0.0) -> Array:
    """The sheet on a cylinder, all distances along it kept; direction: of the curved lines."""
    along, across = np.array([np.cos(direction), np.sin(direction), 0]), [-np.sin(direction), np.cos(direction), 0]
    angle = points @ along * curvature
    up = np.stack([0 * angle, 0 * angle, (1 - np.cos(angle)) / curvature], axis=1)
    return np.outer(np.sin(angle) / curvature, along) + np.outer(points @ across, across) + up


def bent_sheet(points: Array, bent: Array, hinges: Array, kind: str) -> Array:
    """Bending energies of a sheet whose rigidity is 1."""
    pieces = Pieces(bent, hinges)
    if kind == "quadratic":
        weights = pieces.constant("weights", materials.quadratic_bending_weights(points, hinges)[:, :, None])
        return pieces.energies(materials.quadratic_bending(pieces.positions, weights, 1.0))
    rest = pieces.constant("rest", materials.hinge_angles(points, hinges)[:, None, None])
    stiffness = pieces.constant("stiffness", hinge_stiffness(points, hinges, 1 / 6)[:, None, None])
    return pieces.energies(materials.discrete_shell_bending(pieces.positions, rest, stiffness))


@pytest.mark.parametrize("kind", ["quadratic", "shell"])
@pytest.mark.parametrize("direction", [0.0, 0.3, 1.1])
def test_a_rolled_sheet_has_half_of_rigidity_times_squared_curvature(kind: str, direction: float) -> None:
    """Of equilateral triangles, whatever the direction; counted for a third of the triangles of each hinge.

    The hinges of a lattice have three directions, of which each has as many hinges inside, and one fewer at the rims.
    """
    points, triangles = equilateral_sheet(32)
    curvature = 0.7
    energies = bent_sheet(points, rolled(points, curvature, direction), hinges := hinges_of(triangles), kind)
    middle = points[hinges[:, :2]].mean(axis=1)
    place = np.round(middle @ np.linalg.inv(np.array([[1.0, 0, 0], [-0.5, np.sqrt(0.75), 0], [0, 0, 1]])) * 64)
    inside = ((place[:, :2] > 10) & (place[:, :2] <= 42)).all(axis=1)  # whole cells: 16 x 16
    area = 16**2 * 2 * np.sqrt(0.1875) / 32**2
    assert energies[inside].sum() == pytest.approx(0.5 * curvature**2 * area, rel=1e-3)


def test_right_triangles_are_stiffer_along_their_longest_edges() -> None:
    """As `discrete_shell_bending` warns: three times, and as the plate itself along the others."""
    points, triangles = sheet(32)
    hinges = hinges_of(triangles)
    middle = points[hinges[:, :2]].mean(axis=1)
    inside = ((middle[:, :2] > 0.25) & (middle[:, :2] <= 0.75)).all(axis=1)
    for direction, factor in ((0.0, 1.0), (np.pi / 4, 3.0), (-np.pi / 4, 1.0)):
        energies = bent_sheet(points, rolled(points, 0.7, direction), hinges, "quadratic")
        assert energies[inside].sum() == pytest.approx(factor * 0.5 * 0.7**2 * 0.25, rel=1e-2)


def test_rest_angles_are_the_angles_and_cost_nothing() -> None:
    points, triangles = sheet(4)
    hinges = hinges_of(triangles)
    curved = rolled(points, 0.9)
    pieces = Pieces(curved, hinges)
    angles = materials.hinge_angles(curved, hinges)
    rest = pieces.constant("rest", angles[:, None, None])
    energies = pieces.energies(materials.discrete_shell_bending(pieces.positions, rest, 2.0))
    np.testing.assert_allclose(energies, 0.0, atol=1e-28)
    assert np.abs(angles).max() > 0.2


@pytest.mark.parametrize("angle", [0.3, -0.3, 2.5, -3.0])
def test_a_hinge_is_folded_towards_its_normal(angle: float) -> None:
    """Rows 2 and 3 lie on both sides of the edge along x, row 3 turned up by the angle."""
    points = np.array([[0.0, 0, 0], [2, 0, 0], [1, 1, 0], [0.5, -np.cos(angle), np.sin(angle)]])
    assert materials.hinge_angles(points, [[0, 1, 2, 3]]) == pytest.approx([angle])


def test_quadratic_bending_sees_no_rigid_motion_and_no_flat_strain() -> None:
    """A hinge that lies flat, anyhow, is at rest."""
    points, triangles = sheet(3)
    hinges = hinges_of(triangles)
    weights = materials.quadratic_bending_weights(points, hinges)
    turn, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))
    flat = points @ np.diag([1.3, 0.8, 1.0]) @ turn.T + 5.0
    np.testing.assert_allclose(np.einsum("ha,hai->hi", weights, flat[hinges]), 0.0, atol=1e-13)


def test_pressure_pushes_along_normals_and_weighs_the_volume() -> None:
    """A closed box: the potential is -p V, the forces are p times a third of the area vectors around a vertex."""
    corners = np.array([[x, y, z] for x in (3.0, 5.0) for y in (-1.0, 0.0) for z in (2.0, 2.5)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([[q[i] for i in three] for q in quads for three in ((0, 1, 2), (0, 2, 3))], np.int32)
    pieces = Pieces(corners, triangles)
    energies = pieces.energies(materials.inner_pressure(pieces.positions, 3.0))
    assert energies.sum() == pytest.approx(-3.0 * 2.0 * 1.0 * 0.5, rel=1e-12)
    x = corners[triangles]
    areas = 0.5 * np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    wanted = np.zeros((8, 3))
    np.add.at(wanted, triangles.ravel(), np.repeat(3.0 * areas / 3, 3, axis=0))
    np.testing.assert_allclose(-pieces.gradient(), wanted, atol=1e-12)
    assert triangle_areas(corners, triangles).sum() == pytest.approx(2 * (2.0 + 1.0 + 0.5))


# -- rods ------------------------------------------------------------------------------------------------------


def inner(count: int) -> Array:
    """The vertices between the segments of an open rod through so many points, with their neighbours."""
    return np.arange(count - 2)[:, None] + np.arange(3)


def test_a_round_rod_on_a_circle() -> None:
    """Half of E I over R^2 for every metre of it; E I is 3."""
    n, radius = 60, 2.0
    angle = np.linspace(0, 1.5, n + 1)
    points = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    pieces = Pieces(points, inner(n + 1))
    length = 2 * np.linalg.norm(points[1] - points[0])
    energy = pieces.energies(materials.rod_bending(pieces.positions, length, 3.0)).sum()
    assert energy == pytest.approx(0.5 * 3.0 / radius**2 * (n - 1) * length / 2, rel=1e-3)


def rod_state(points: Array, directors: Array, angles: Array, twists: Array) -> tuple[Pieces, dict[str, Attribute]]:
    """A rod where a step began: what `rod_twist` and `material_curvature` take, the positions are unknowns."""
    pieces = Pieces(points, inner(len(points)))
    pairs = np.arange(len(points) - 2)[:, None] + np.arange(2)
    state = {
        "positions": pieces.positions,
        "previous": pieces.constant("previous", points[inner(len(points))]),
        "directors": pieces.constant("directors", directors[pairs]),
        "angles": pieces.constant("angles", angles[pairs][:, :, None]),
        "reference_twist": pieces.constant("reference_twist", twists[:, None, None]),
    }
    return pieces, state


def test_a_straight_rod_that_is_twisted_by_several_turns() -> None:
    """Half of G J over L times the squared angle, G J being 2: reference frames have no part in it."""
    n, turns = 10, 3.0
    points = np.linspace([0.0, 0, 0], [1, 2, 2], n + 1)
    angles = 2 * np.pi * turns * np.arange(n) / (n - 1)
    pieces, state = rod_state(points, materials.rod_directors(points), angles, np.zeros(n - 1))
    energy = pieces.energies(materials.rod_twisting(materials.rod_twist(**state), 0.0, 2 * 3.0 / n, 2.0)).sum()
    assert energy == pytest.approx(0.5 * 2.0 * (2 * np.pi * turns) ** 2 / (3.0 * (n - 1) / n), rel=1e-12)


def test_frames_carried_along_change_no_energy() -> None:
    """After a step the frames, the twists and the state begin anew, and twist and curvature are what they were."""
    random = np.random.default_rng(3)
    points = np.cumsum(random.uniform([0.1, -0.5, -0.5], [1.6, 1, 1], (7, 3)), axis=0)
    directors, angles = materials.rod_directors(points), random.uniform(-4, 4, 6)
    tangents = materials.rod_tangents(points)
    turned = random.uniform(-3, 3, 6)[:, None]  # any frames, of any number of turns, not only those without twist
    directors = np.cos(turned) * directors + np.sin(turned) * np.cross(tangents, directors)
    of_a_turn = materials.reference_twists(tangents, directors)
    twists = of_a_turn + 2 * np.pi * np.array([-2, -1, 0, 1, 3])
    np.testing.assert_allclose(materials.reference_twists(tangents, directors, twists + 3.0), twists)
    moved = points + 0.1 * random.standard_normal(points.shape)
    new = materials.rod_tangents(moved)
    carried = materials.transported_directors(directors, tangents, new)
    np.testing.assert_allclose(np.einsum("ij,ij->i", carried, new), 0.0, atol=1e-15)
    again = materials.reference_twists(new, carried, twists)

    def energies(start: Array, frames: Array, reference: Array) -> Array:
        pieces, state = rod_state(start, frames, angles, reference)
        pieces.x.update_value(moved)
        twisting = materials.rod_twisting(materials.rod_twist(**state), 0.0, 1.0, 1.0)
        del state["reference_twist"]
        curvature = materials.material_curvature(**state)
        bending = materials.rod_material_bending(
            curvature,
            pieces.constant("rest_curvature", np.zeros((5, 2, 1))),
            1.0,
            pieces.constant("stiffness", np.tile([[1.0], [5.0]], (5, 1, 1))),
        )
        return pieces.energies(twisting + 100.0 * bending)

    np.testing.assert_allclose(energies(moved, carried, again), energies(points, directors, twists), rtol=1e-11)
    assert np.abs(again - twists).max() > 1e-3  # the centre line's own writhe


def test_bending_about_the_axis_that_is_stiff() -> None:
    """A flat rod of two segments bends towards m_1 against the first stiffness, towards m_2 against the second."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1 + np.cos(0.4), np.sin(0.4), 0]])
    binormal = 2 * np.tan(0.2)
    for angle, wanted in ((0.0, 7.0), (np.pi / 2, 3.0)):  # the first axis is y, or z
        directors = np.array([[0.0, 1, 0], [-np.sin(0.4), np.cos(0.4), 0]])
        pieces, state = rod_state(points, directors, np.full(2, angle), np.zeros(1))
        del state["reference_twist"]
        stiffness = pieces.constant("stiffness", np.array([[[7.0], [3.0]]]))
        rest = pieces.constant("rest", np.zeros((1, 2, 1)))
        energy = materials.rod_material_bending(materials.material_curvature(**state), rest, 2.0, stiffness)
        assert pieces.energies(energy) == pytest.approx([wanted * binormal**2 / 2.0])


# -- wrong arguments -------------------------------------------------------------------------------------------


def attribute(rows: int, cols: int) -> Attribute:
    return Scene("s", threads=1).add_mesh("m").add_primitive("p", 1).add_attribute("a", rows, cols)


def test_wrong_shapes_are_named() -> None:
    nine, six = attribute(3, 3), attribute(3, 2)
    with pytest.raises(ShapeMismatchError, match=r"a solid has a 3x3 .* m\.p\.a .*deformation_gradient"):
        materials.neo_hookean(six, 1.0, 1.0, 1.0)
    with pytest.raises(ShapeMismatchError, match=r"a membrane has a 3x2 .* m\.p\.a .*triangle_deformation"):
        materials.neo_hookean_membrane(nine, 1.0, 1.0, 1.0)
    with pytest.raises(ShapeMismatchError, match="the strain of"):
        materials.strain_rate_damping(nine, six, 1.0, 1.0, 0.1)
    with pytest.raises(ShapeMismatchError, match="a spring has 2x3 positions"):
        materials.spring(nine, 1.0, 1.0)
    with pytest.raises(ShapeMismatchError, match="a triangle has 3x3 positions"):
        materials.inner_pressure(six, 1.0)
    with pytest.raises(ShapeMismatchError, match="a hinge has 4x3 positions"):
        materials.quadratic_bending(nine, attribute(4, 1), 1.0)
    with pytest.raises(ShapeMismatchError, match="two segments that meet have 3x3 positions"):
        materials.rod_bending(six, 1.0, 1.0)
    with pytest.raises(ShapeMismatchError, match="two segments have 2x3 directors"):
        materials.rod_twist(nine, nine, six, attribute(2, 1), 0.0)
    with pytest.raises(ShapeMismatchError, match="two segments have two angles"):
        materials.material_curvature(nine, nine, attribute(2, 3), attribute(3, 1))


def test_rods_without_frames_are_named() -> None:
    with pytest.raises(ShapeMismatchError, match=r"points \[n, 3\]"):
        materials.rod_tangents([[0.0, 0, 0]])
    with pytest.raises(SceneError, match="segment 1 of the rod has no length"):
        materials.rod_directors([[0.0, 0, 0], [1, 0, 0], [1, 0, 0]])
    with pytest.raises(SceneError, match="turned round"):
        materials.rod_directors([[0.0, 0, 0], [1, 0, 0], [0, 0, 0]])
    with pytest.raises(ShapeMismatchError, match=r"are \[m, 3\] each"):
        materials.transported_directors([[0.0, 0, 1]], [1.0, 0, 0], [[1.0, 0, 0]])
    with pytest.raises(SceneError, match="hinge 0 has a triangle of no area"):
        materials.quadratic_bending_weights([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2, 3]])
