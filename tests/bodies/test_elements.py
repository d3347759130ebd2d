"""Bodies of hexahedra and quadratic tetrahedra: the patch test, a cantilever, a drop on the ground."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from yasps import Attribute, Scene, materials
from yasps.backend.codegen.scene_view import SceneView
from yasps.bodies import ElementBody, Ground
from yasps.meshes import ElementMesh, MeshError, TetrahedralMesh, box, cloth_grid, hex_box, quadratic
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings, minimize, quasi_static

EXACT = NewtonSettings(velocity_tolerance=1e-13, solver="direct")
RNG = np.random.default_rng(11)
SIDE = 2


def moved_inside(vertices: NDArray[np.float64], half: float, by: float) -> NDArray[np.float64]:
    """Vertices that are not on the boundary of the cube, or square, of this half side, moved."""
    inside = (np.abs(vertices[:, np.ptp(vertices, axis=0) > 0]) < half - 1e-9).all(axis=1)
    moves = by * RNG.uniform(-1, 1, vertices.shape) * (np.ptp(vertices, axis=0) > 0)
    return vertices + inside[:, None] * moves


def patch(kind: str) -> ElementMesh:
    """A cube of uneven elements."""
    if kind == "hexahedron":
        grid = hex_box((1.0, 1.0, 1.0), (3, 3, 3))
        return ElementMesh(kind, moved_inside(grid.vertices, 0.5, 0.08), grid.cells)
    grid4 = box((1.0, 1.0, 1.0), (2, 2, 2))
    return quadratic(TetrahedralMesh(moved_inside(grid4.vertices, 0.5, 0.08), grid4.tets))


def held_boundary(rest: NDArray[np.float64], position: Attribute, f: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Puts the boundary where F says and all else somewhere near; which vertices are the boundary."""
    flat = rest[:, np.ptp(rest, axis=0) > 0]
    boundary = (np.abs(flat) > 0.5 - 1e-9).any(axis=1)
    noise = 0.02 * RNG.uniform(-1, 1, rest.shape) * (np.ptp(rest, axis=0) > 0)
    position.update_value(rest @ f.T + noise * ~boundary[:, None])
    return boundary


@pytest.mark.parametrize("kind", ["hexahedron", "tetra10"])
def test_the_patch_test_is_exact(kind: str) -> None:
    """Where the boundary is deformed homogeneously, all is, in uneven elements too."""
    scene = Scene("patch", threads=1)
    body = ElementBody(scene, "cube", patch(kind), poisson_ratio=0.3)
    scene.add_minimize_target(body.position)
    f = np.eye(3) + 0.1 * RNG.standard_normal((3, 3))
    boundary = held_boundary(body.rest, body.position, f)
    assert 0 < np.count_nonzero(~boundary) < len(body.rest)
    minimize(scene, [body.position], 1.0, settings=EXACT, fixed={body.position: boundary})
    np.testing.assert_allclose(body.positions(), body.rest @ f.T, atol=1e-11)
    # One kernel for all Gauss points, whose Hessian is projected as 9x9 and not as 24x24 or 30x30.
    (derivative,) = SceneView(scene.compile().module).derivatives
    assert derivative.projects is not None
    assert "9x9" in derivative.projects.data, derivative.projects.data


def test_the_patch_test_of_quadratic_triangles_is_exact() -> None:
    cloth = cloth_grid((1.0, 1.0), (3, 3))
    vertices = cloth.vertices - 0.5 * (cloth.vertices.min(axis=0) + cloth.vertices.max(axis=0))
    mesh = quadratic(type(cloth)(moved_inside(vertices, 0.5, 0.08), cloth.triangles))
    scene = Scene("membrane", threads=1)
    points = mesh.points()
    nodes = scene.add_mesh("m").add_primitive("nodes", len(mesh.vertices))
    position = nodes.add_attribute("position", 3, 1, value=mesh.vertices)
    gauss = scene.m.add_primitive("gauss", len(points.volumes))
    x = gauss.add_attribute("x", through=gauss.add_connectivity("nodes", nodes, points.nodes, 6), source=position)
    f_of = materials.gauss_deformation(x, gauss.add_constant("gradients", 6, 2, value=points.gradients))
    area = gauss.add_constant("area", 1, 1, value=points.volumes)
    scene.add_energy(
        gauss.add_attribute("membrane", computed_attribute=materials.baraff_witkin(f_of, 50.0, 20.0, area))
    )
    scene.add_minimize_target(position)
    f = np.eye(3)
    plane = np.flatnonzero(np.ptp(mesh.vertices, axis=0) > 0)
    f[np.ix_(plane, plane)] = [[1.2, 0.05], [-0.02, 1.1]]  # stretched, so that nothing buckles
    boundary = held_boundary(mesh.vertices, position, f)
    minimize(scene, [position], 1.0, settings=EXACT, fixed={position: boundary})
    np.testing.assert_allclose(position.value.reshape(-1, 3), mesh.vertices @ f.T, atol=1e-11)


# -- a cantilever ------------------------------------------------------------------------------------------

LENGTH, HEIGHT, MODULUS = 1.0, 0.1, 1e6


def tip_deflection(shape: ElementMesh, poisson_ratio: float = 0.0) -> float:
    """Of a cantilever under a small dead load on its end, over that of beam theory with shear (Timoshenko).

    Theory lets the clamped end grow thinner and wider; a clamp does not, which without contraction makes no
    difference."""
    scene = Scene("cantilever", threads=1)
    body = ElementBody(scene, "beam", shape, youngs_modulus=MODULUS, poisson_ratio=poisson_ratio)
    scene.add_minimize_target(body.position)
    x = body.rest
    clamped, end = x[:, 0] < x[:, 0].min() + 1e-9, x[:, 0] > x[:, 0].max() - 1e-9
    triangles = body.triangles[end[body.triangles].all(axis=1)]
    a, b, c = (x[triangles[:, k]] for k in range(3))
    share = np.bincount(triangles.ravel(), np.repeat(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6, 3), len(x))
    inertia = HEIGHT**4 / 12
    load = 1e-3 * 3 * MODULUS * inertia / LENGTH**2  # a deflection of a thousandth of the length
    force = body.vertices.add_constant("force", 3, 1)
    pull = materials.dead_load(body.position, force)
    body.add_energy(body.vertices.add_attribute("load", computed_attribute=pull))

    def set_load(part: float) -> None:
        force.update_value(np.outer(share / share.sum(), [0.0, 0.0, -part * load]))

    settings = NewtonSettings(velocity_tolerance=None, relative_force_tolerance=1e-9, solver="direct")
    quasi_static(scene, [body.position], set_load, settings=settings, first=1.0, fixed={body.position: clamped})
    sunk = float((share @ (x - body.positions())[:, 2]) / share.sum())
    shear = load * LENGTH / (5 / 6 * MODULUS / (2 * (1 + poisson_ratio)) * HEIGHT**2)
    return sunk / (load * LENGTH**3 / (3 * MODULUS * inertia) + shear)


def test_a_cantilever_of_quadratic_tetrahedra_bends_as_theory_says() -> None:
    found = tip_deflection(quadratic(box((LENGTH, HEIGHT, HEIGHT), (10, 1, 1))))
    print(f"Tet10, 10 x 1 x 1 cells: {found:.4f} of theory")
    assert found == pytest.approx(1.0, abs=2e-3)


@pytest.mark.nightly
def test_cantilevers_of_all_kinds() -> None:
    """Linear tetrahedra lock; hexahedra lock less and less with the number of them through the height."""
    size = (LENGTH, HEIGHT, HEIGHT)
    linear = box(size, (20, 2, 2))
    found = {
        "tetra 20x2x2": tip_deflection(ElementMesh("tetra", linear.vertices, linear.tets)),
        "tetra10 10x1x1": tip_deflection(quadratic(box(size, (10, 1, 1)))),
        "tetra10 20x2x2": tip_deflection(quadratic(linear)),
        "tetra10 20x2x2, Poisson's ratio 0.3": tip_deflection(quadratic(linear), 0.3),
        **{f"hexahedron {10 * n}x{n}x{n}": tip_deflection(hex_box(size, (10 * n, n, n))) for n in (2, 4, 6)},
    }
    print(found)
    assert found["tetra 20x2x2"] < 0.8
    assert found["tetra10 20x2x2"] == pytest.approx(1.0, abs=3e-4)
    assert found["tetra10 20x2x2, Poisson's ratio 0.3"] == pytest.approx(1.0, abs=0.02)  # 0.991 in the limit
    assert found["hexahedron 20x2x2"] < found["hexahedron 40x4x4"] < found["hexahedron 60x6x6"]
    assert found["hexahedron 60x6x6"] == pytest.approx(1.0, abs=0.02)


# -- in a simulation ---------------------------------------------------------------------------------------


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["hexahedron", "tetra10"])
def test_a_block_falls_on_the_ground_and_rests(kind: str) -> None:
    scene = Scene("drop", threads=1)
    grid = hex_box((0.2, 0.2, 0.1), (2, 2, 1))
    mesh = grid if kind == "hexahedron" else quadratic(box((0.2, 0.2, 0.1), (2, 2, 1)))
    shape = ElementMesh(kind, mesh.vertices + np.array([0.0, 0.0, 0.06]), mesh.cells)
    body = ElementBody(scene, "block", shape, youngs_modulus=2e5)
    simulation = Simulation(scene, [body, Ground(scene)], time_step=0.02)
    simulation.run(60)
    weight = 9.8 * float(body.mass.value.sum())
    assert simulation.contact_forces().on_bodies("normal")[0, 2] == pytest.approx(weight, rel=0.02)


def test_surfaces_are_no_soft_bodies() -> None:
    scene = Scene("wrong", threads=1)
    with pytest.raises(MeshError, match="has no volume"):
        ElementBody(scene, "cloth", quadratic(cloth_grid((1.0, 1.0), (2, 2))))
    with pytest.raises(MeshError, match="cloth: a body of elements is made of an ElementMesh"):
        ElementBody(scene, "cloth", box())  # type: ignore[arg-type]
    ElementBody(scene, "cloth", hex_box((1.0, 1.0, 1.0), (1, 1, 1)))
