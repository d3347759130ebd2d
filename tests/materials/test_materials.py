"""Cloth and bending: energies by hand at simple deformations, invariance, derivatives by complex step."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from small_scenes import along_each_unknown, dense_assembly, emit

from yasps import Attribute, Scene, SceneError, ShapeMismatchError, materials
from yasps.passes.pipeline import run_pipeline

Array = NDArray[np.float64]
STRETCH, SHEAR = 7.0, 3.0


def cloth(vertices: Array, compression: float = 1.0, rest: Array | None = None, warp: Array | None = None) -> Scene:
    """Two triangles of cloth over a unit square, or over other vertices."""
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) if rest is None else rest
    triangles = [[0, 1, 2], [0, 2, 3]]
    inverse, area = materials.rest_triangles(flat, triangles, (1.0, 0.0, 0.0) if warp is None else warp)
    scene = Scene("cloth", threads=1)
    mesh = scene.add_mesh("m")
    points, faces = mesh.add_primitive("v", 4), mesh.add_primitive("t", 2)
    x = points.add_attribute("x", 3, 1, value=vertices)
    corners = faces.add_connectivity("corners", points, triangles, 3)
    f = materials.triangle_deformation(
        faces.add_attribute("positions", through=corners, source=x),
        faces.add_constant("inverse", 2, 2, value=inverse),
    )
    area_of = faces.add_constant("area", 1, 1, value=area)
    energy = materials.baraff_witkin(f, STRETCH, SHEAR, area_of, compression=compression)
    scene.add_energy(faces.add_attribute("energy", computed_attribute=energy), projection="none")
    scene.add_minimize_target(x)
    return scene


SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def energy_of(scene: Scene) -> float:
    (values,) = scene.energy_values().values()
    return float(values.sum())


@pytest.mark.parametrize("factor", [1.25, 0.8])
def test_stretch_and_compression_along_the_warp(factor: float) -> None:
    """The square's area is 1; strain is factor - 1."""
    moved = SQUARE * [factor, 1, 1]
    expected = STRETCH * (factor - 1) ** 2
    assert energy_of(cloth(moved)) == pytest.approx(expected, rel=1e-12)
    softened = expected * (0.01 if factor < 1 else 1.0)
    assert energy_of(cloth(moved, compression=0.01)) == pytest.approx(softened, rel=1e-12)


def test_shear() -> None:
    """v = (s, 1, 0): |v| - 1 and u . v = s."""
    slope = 0.3
    moved = SQUARE + np.outer(SQUARE[:, 1], [slope, 0, 0])
    expected = STRETCH * (np.hypot(1, slope) - 1) ** 2 + SHEAR * slope**2
    assert energy_of(cloth(moved)) == pytest.approx(expected, rel=1e-12)


def rotation() -> Array:
    q, _ = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))
    return q * np.sign(np.linalg.det(q))


def test_cloth_does_not_feel_rigid_motions() -> None:
    moved = SQUARE + 0.2 * np.random.default_rng(1).standard_normal((4, 3))
    before = energy_of(cloth(moved))
    assert energy_of(cloth(moved @ rotation().T + [3.0, -1.0, 2.0])) == pytest.approx(before, rel=1e-10)
    assert energy_of(cloth(SQUARE @ rotation().T)) == pytest.approx(0.0, abs=1e-25)


def test_rest_triangles_may_stand_anyhow_in_space() -> None:
    """Rotating the rest shape and the warp with it changes nothing."""
    turned, warp = SQUARE @ rotation().T, rotation() @ [1.0, 0.0, 0.0]
    moved = SQUARE * [1.3, 0.9, 1]
    assert energy_of(cloth(moved, rest=turned, warp=warp)) == pytest.approx(energy_of(cloth(moved)), rel=1e-10)


def hinge(vertices: Array, energy: str = "k") -> Scene:
    """Two triangles (0, 1, 2) and (1, 0, 3)."""
    scene = Scene("hinge", threads=1)
    mesh = scene.add_mesh("m")
    points, hinges = mesh.add_primitive("v", 4), mesh.add_primitive("h", 1)
    x = points.add_attribute("x", 3, 1, value=vertices)
    corners = hinges.add_connectivity("corners", points, [[0, 1, 2, 3]], 4)
    positions = hinges.add_attribute("positions", through=corners, source=x)
    stiffness = hinges.add_constant(energy, 1, 1, value=2.5)
    bending = materials.hinge_bending(positions, stiffness)
    scene.add_energy(hinges.add_attribute("energy", computed_attribute=bending), projection="none")
    scene.add_minimize_target(x)
    return scene


def folded(angle: float) -> Array:
    """A hinge on the x axis, its right side turned up by the angle."""
    return np.array([[0.0, 0, 0], [2, 0, 0], [1, 1, 0], [0.5, -np.cos(angle), np.sin(angle)]])


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.5, -1.5, 3.0])
def test_bending_energy_by_its_angle(angle: float) -> None:
    expected = 2.5 * 4 * np.sin(angle / 2) ** 2
    assert energy_of(hinge(folded(angle))) == pytest.approx(expected, rel=1e-12, abs=1e-25)


def test_a_flat_hinge_is_smooth_and_at_rest() -> None:
    scene = hinge(folded(0.0))
    emitted = emit(scene)
    gradient, hessian = dense_assembly(run_pipeline(emitted.module), emitted.data)
    assert np.abs(gradient).max() < 1e-15
    values = np.linalg.eigvalsh(hessian)
    assert values.min() > -1e-12
    assert np.sum(values > 1e-9) == 1  # bending alone resists


def deformed_square() -> Array:
    return SQUARE * [1.2, 0.7, 1] + 0.05 * np.random.default_rng(2).standard_normal((4, 3))


@pytest.mark.parametrize(
    "scene",
    [cloth(deformed_square()), cloth(deformed_square(), compression=0.01), hinge(folded(0.7)), hinge(folded(-2.0))],
    ids=["cloth", "cloth, compression 0.01", "hinge", "hinge, other way"],
)
def test_derivatives_by_complex_step(scene: Scene) -> None:
    emitted = emit(scene)
    derived = run_pipeline(emit(scene).module)
    gradient, hessian = dense_assembly(derived, emitted.data)
    numbers = emitted.module, emitted.data, emitted.targets
    by_step = along_each_unknown(*numbers, lambda interpreter: interpreter.total_energy())
    assert np.allclose(gradient, by_step, rtol=1e-12, atol=1e-13)
    numbers = derived, emitted.data, emitted.targets
    by_step = along_each_unknown(*numbers, lambda interpreter: interpreter.gradient())
    assert np.allclose(hessian, by_step, rtol=1e-12, atol=1e-12)
    kernel = scene.compile().assemble(project=False)
    assert np.allclose(kernel, gradient, rtol=1e-12, atol=1e-13)


def element(rows: int, cols: int) -> Attribute:
    return Scene("s", threads=1).add_mesh("m").add_primitive("p", 1).add_attribute("a", rows, cols)


def test_wrong_shapes_are_named() -> None:
    with pytest.raises(ShapeMismatchError, match=r"cloth has a 3x2 .* m\.p\.a .*triangle_deformation"):
        materials.baraff_witkin(element(3, 3), 1.0, 1.0, 1.0)
    with pytest.raises(ShapeMismatchError, match="a triangle has 3x3 positions"):
        materials.triangle_deformation(element(4, 3), element(2, 2))
    with pytest.raises(ShapeMismatchError, match="a hinge has 4x3 positions"):
        materials.hinge_bending(element(3, 3), 1.0)
    with pytest.raises(ShapeMismatchError, match=r"triangles \[m, 3\]"):
        materials.rest_triangles(SQUARE, [[0, 1, 2, 3]])


def test_unusable_rest_triangles_are_named() -> None:
    with pytest.raises(SceneError, match="triangle 1 has no area at rest"):
        materials.rest_triangles(SQUARE, [[0, 1, 2], [0, 1, 1]])
    with pytest.raises(SceneError, match="normal to triangle 0"):
        materials.rest_triangles(SQUARE, [[0, 1, 2]], (0.0, 0.0, 1.0))


def test_affine_bodies() -> None:
    """s/2 |A^T A - I|^2: by hand for scaled axes and shear, nothing for rotations."""
    scene = Scene("body")
    bodies = scene.add_mesh("m").add_primitive("bodies", 1)
    a = bodies.add_attribute("a", 3, 3, value=np.eye(3))
    energy = materials.affine_orthogonality(a, 40.0)
    scene.add_energy(bodies.add_attribute("stiff", computed_attribute=energy), projection="none")
    scene.add_minimize_target(a)
    stretched, sheared = np.diag([1.1, 0.9, 1.3]), np.eye(3)
    sheared[0, 1] = 0.2
    by_hand = {0.0: rotation(), 20.0 * sum((s * s - 1) ** 2 for s in (1.1, 0.9, 1.3)): rotation() @ stretched}
    by_hand[20.0 * (2 * 0.2**2 + 0.2**4)] = sheared
    for expected, matrix in by_hand.items():
        a.update_value(matrix)
        assert energy_of(scene) == pytest.approx(expected, rel=1e-12, abs=1e-25)


def test_weft_turns_left_from_the_warp() -> None:
    """At rest F's columns are the warp and what comes a quarter turn after it, seen against the triangle's normal."""
    for warp, weft in (([1.0, 0, 0], [0.0, 1, 0]), ([0.0, 2, 0], [-1.0, 0, 0])):
        inverse, _ = materials.rest_triangles(SQUARE, [[0, 1, 2]], warp)
        edges = (SQUARE[1:3] - SQUARE[0]).T
        expected = np.column_stack([np.array(warp) / np.linalg.norm(warp), weft])
        np.testing.assert_allclose(edges @ inverse[0], expected, atol=1e-14)
