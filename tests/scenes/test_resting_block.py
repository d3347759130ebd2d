"""A block at rest: its gap is that at which the barrier bears its weight, whatever the mesh, d_hat and the time step.

Contact weighs a vertex with a third of the areas of all triangles around it. At the rim of a face that includes
triangles of the sides, so the rim bears more than its share, the more the larger the cells there are: the mean pressure
of the closed form is the weight over the areas of all lower vertices.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from closed_forms import pressure_over_stiffness, relative_gap
from intersection_checks import contact_forces_on
from scene_shapes import block, lower_areas, outside, point_areas

from yasps import Scene
from yasps.bodies import AffineBody, Body, HalfSpace, Obstacle, SoftBody
from yasps.meshes import TetrahedralMesh, ground
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

SIZE = (0.2, 0.2, 0.1)  # m
DENSITY, GRAVITY = 1000.0, 9.8
PRESSURE = DENSITY * GRAVITY * SIZE[2]  # Pa, below the block
WEIGHT = PRESSURE * SIZE[0] * SIZE[1]  # N
MESHES = {
    "one cell": block(SIZE),
    "2 x 2": block(SIZE, (2, 2, 1)),
    "3 x 2": block(SIZE, (3, 2, 2)),
    "uneven 4 x 4": block(SIZE, (4, 4, 3), seed=1),
    "uneven 6 x 5": block(SIZE, (6, 5, 2), seed=2),
}
DISTANCES = (5e-4, 1e-3, 2e-3)  # m, of activation
STEPS = (0.01, 0.002)  # s
SPREADS = {1e-3: 2e-3, 1e-2: 5e-3, 0.1: 1.5e-2, 1.0: 5e-2}  # pressure over stiffness, and how far meshes differ


def resting(
    shape: TetrahedralMesh, *, ratio: float, on: str = "half-space", distance: float = 1e-3, dt: float = 0.01
) -> tuple[Simulation, Body, float]:
    """A stiff block after it came to rest, from 0.9 d_hat; the largest force that was left over [N].

    on: "half-space", "triangles" (two large ones), "block" (a fixed one of another mesh).
    """
    scene = Scene("resting", threads=1)
    start = shape.translated((0.0, 0.0, 0.9 * distance))
    body = AffineBody(scene, "block", start, density=DENSITY, youngs_modulus=1e8)
    keep_from_drifting(body)
    below: Body
    if on == "half-space":
        below = HalfSpace(scene, "below")
    elif on == "triangles":
        below = Obstacle(scene, "below", ground((2.0, 2.0)))
    else:
        below = Obstacle(scene, "below", outside(block(SIZE, (5, 5, 3), seed=3).translated((0.0, 0.0, -SIZE[2]))))
    simulation = Simulation(
        scene,
        [body, below],
        time_step=dt,
        gravity=(0.0, 0.0, -GRAVITY),
        activation_distance=distance,
        contact_stiffness=PRESSURE / ratio,
        settings=NewtonSettings(velocity_tolerance=1e-7, force_tolerance=1e-7 * WEIGHT, solver="direct"),
    )
    still = 0
    for _ in range(1000):
        left = simulation.step().residual_force
        still = still + 1 if np.abs(simulation.velocity_of(body)).max() < 2e-5 * GRAVITY * dt else 0
        if still == 3:
            return simulation, body, left
    raise AssertionError("it does not come to rest")


def keep_from_drifting(body: Body) -> None:
    """Weak springs that hold the vertices aside, as there is no friction."""
    place = body.vertices.add_constant("held_at", 3, 1, value=body.positions())
    aside = (body.position - place).block(0, 0, 2, 1)
    body.add_energy(body.vertices.add_attribute("held", computed_attribute=50.0 * aside.dot(aside)))


def relative_gaps(simulation: Simulation, body: Body, shape: TetrahedralMesh) -> np.ndarray:
    """Heights of the vertices of the lower face over d_hat."""
    return np.asarray(body.positions()[lower_areas(shape) > 0, 2] / simulation.activation_distance)


def check_gap(shape: TetrahedralMesh, ratio: float, distance: float, dt: float) -> float:
    """Holds the gap against the closed form; returns it over d_hat."""
    simulation, body, _ = resting(shape, ratio=ratio, distance=distance, dt=dt)
    areas = point_areas(shape)[lower_areas(shape) > 0]
    found = relative_gaps(simulation, body, shape)
    # A stiff block whose corners are weighed unevenly leans a little: all vertices together bear the weight.
    borne = areas @ [pressure_over_stiffness(float(gap)) for gap in found] * PRESSURE / ratio
    assert borne == pytest.approx(WEIGHT, rel=2e-4)
    mean = float(areas @ found / areas.sum())
    assert mean == pytest.approx(relative_gap(WEIGHT / areas.sum(), PRESSURE / ratio), rel=1e-3)
    return mean


@pytest.mark.parametrize(("name", "ratio", "distance"), [("uneven 4 x 4", 0.1, 1e-3), ("2 x 2", 1e-2, 2e-3)])
def test_the_gap_on_a_half_space_is_the_closed_form(name: str, ratio: float, distance: float) -> None:
    check_gap(MESHES[name], ratio, distance, 0.01)


@pytest.mark.nightly
@pytest.mark.parametrize("ratio", SPREADS)
def test_gap_over_distance_is_a_function_of_the_pressure_alone(ratio: float) -> None:
    """On five meshes, at three d_hat and two time steps, which make no difference above 1e-4.

    The pressure on what contact weighs decides, and `check_gap` holds every gap against the closed form of that, within
    0.1 %. As functions of the weight over the lower face the gaps of the five meshes differ by 0.10 % at a pressure of
    1e-3 of the stiffness, 0.33 % at 1e-2, 1.1 % at 0.1 and 4.4 % at 1: rims count triangles of the sides, so
    that one cell and 2 x 2 x 1 cells weigh the lower face with twice its area, 4 x 4 x 3 cells with 1.33 times.
    """
    found = {
        name: [check_gap(shape, ratio, distance, dt) for distance, dt in itertools.product(DISTANCES, STEPS)]
        for name, shape in MESHES.items()
    }
    for gaps in found.values():
        assert np.ptp(gaps) < 1e-4
    of_meshes = [np.mean(gaps) for gaps in found.values()]
    print(f"pressure / stiffness {ratio:g}: gap / d_hat {min(of_meshes):.5f} to {max(of_meshes):.5f}")
    assert np.ptp(of_meshes) < SPREADS[ratio] * np.mean(of_meshes)


@pytest.mark.nightly
@pytest.mark.parametrize(("on", "pressures"), [("triangles", 2.0), ("block", 1.0)])
def test_the_gap_on_other_surfaces(on: str, pressures: float) -> None:
    """On a fixed block of another mesh it is that on a half-space: half of the integral is over each of both surfaces.
    On two triangles far larger than the block no vertex of theirs is near: half of it is missing, and the other half
    bears twice the pressure. Pairs of edges at the rim bear a little, too."""
    shape = MESHES["uneven 4 x 4"]
    simulation, body, _ = resting(shape, ratio=0.1, on=on)
    areas = point_areas(shape)[lower_areas(shape) > 0]
    found = float(areas @ relative_gaps(simulation, body, shape) / areas.sum())
    print(f"on {on}: gap / d_hat {found:.5f}")
    assert found == pytest.approx(relative_gap(pressures * WEIGHT / areas.sum(), 10 * PRESSURE), rel=1e-2)


@pytest.mark.parametrize(
    "on", ["half-space", *(pytest.param(k, marks=pytest.mark.nightly) for k in ("triangles", "block"))]
)
def test_contact_forces_bear_the_weight(on: str) -> None:
    """Their sum is m (g + a) within 1e-6 of the weight, at a force tolerance of a tenth of that."""
    simulation, body, left = resting(MESHES["uneven 4 x 4"], ratio=0.1, on=on)
    before = simulation.velocity_of(body)
    left = simulation.step().residual_force
    acceleration = (simulation.velocity_of(body) - before) / 0.01
    expected = body.mass.value @ (acceleration - simulation.gravity.value)
    assert left < 1e-6 * WEIGHT
    # Up; aside there are the springs.
    assert abs(contact_forces_on(simulation, body).sum(axis=0)[2] - expected[2]) < 1e-6 * WEIGHT


# ---- an unstructured interface ----


def pressed(upper: TetrahedralMesh, lower: TetrahedralMesh | None, *, pressure: float = 1e3) -> tuple[Simulation, Body]:
    """A soft block under an even load on its top, without gravity, on a half-space or on another soft block there.

    Poisson's ratio is 0: in what the mesh can represent exactly, the stress is the same everywhere.
    """
    distance = 5e-5
    scene = Scene("pressed", threads=1)
    bodies: list[Body] = []
    height = 0.9 * distance
    for name, shape in (("lower", lower), ("upper", upper)):
        if shape is None:
            continue
        placed = shape.translated((0.0, 0.0, height))
        body = SoftBody(scene, name, placed, density=DENSITY, youngs_modulus=1e6, poisson_ratio=0.0)
        keep_from_drifting(body)
        bodies.append(body)
        height = placed.vertices[:, 2].max() + 0.9 * distance
    simulation = Simulation(
        scene,
        [*bodies, HalfSpace(scene, "below")],
        time_step=0.1,
        gravity=(0.0, 0.0, 0.0),
        activation_distance=distance,
        contact_stiffness=1e5,
        settings=NewtonSettings(velocity_tolerance=1e-7, force_tolerance=1e-9, solver="direct", max_iterations=500),
    )
    top = lower_areas(TetrahedralMesh(upper.vertices * [1, 1, -1], upper.tets[:, [0, 2, 1, 3]]))
    simulation.add_force(bodies[-1], np.column_stack([0 * top, 0 * top, -pressure * top]))
    for _ in range(200):
        simulation.step()
        if max(np.abs(simulation.velocity_of(body)).max() for body in bodies) < 1e-7:
            return simulation, bodies[-1]
    raise AssertionError("they do not come to rest")


def pressures(simulation: Simulation, body: Body, shape: TetrahedralMesh) -> np.ndarray:
    """Upward contact force on each vertex of the lower face, over its area in that face [Pa]."""
    areas = lower_areas(shape)
    return np.asarray(contact_forces_on(simulation, body)[areas > 0, 2] / areas[areas > 0])


@pytest.mark.nightly
def test_pressure_on_a_half_space_is_even() -> None:
    shape = block((0.2, 0.2, 0.1), (5, 4, 3), seed=5)
    simulation, body = pressed(shape, None)
    found = pressures(simulation, body, shape)
    print(f"half-space: pressure {found.min():.2f} to {found.max():.2f} Pa of 1000")
    np.testing.assert_allclose(found, 1e3, rtol=1e-2)


def pressed_meshes() -> tuple[np.ndarray, np.ndarray]:
    """Pressures on the upper of two soft blocks of different meshes, and which of these vertices are not at the rim."""
    upper, lower = block((0.2, 0.2, 0.1), (5, 4, 3), seed=5), block((0.2, 0.2, 0.1), (4, 6, 3), seed=6)
    simulation, body = pressed(upper, lower)
    found = pressures(simulation, body, upper)
    inside = (np.abs(upper.vertices[lower_areas(upper) > 0, :2]) < 0.075).all(axis=1)
    print(f"rim {found[~inside].min():.0f} to {found[~inside].max():.0f} Pa of 1000")
    print(f"inside {found[inside].min():.0f} to {found[inside].max():.0f} Pa")
    return found, inside


@pytest.mark.nightly
def test_pressure_between_two_meshes_is_nearly_even_inside() -> None:
    """2.2 % off: vertices are the points of a quadrature, and a load that is even is not quite even in its points. With
    twice as many cells each way it is 7.9 %: they integrate the other mesh's hat functions with an error that stays."""
    found, inside = pressed_meshes()
    np.testing.assert_allclose(found[inside], 1e3, rtol=0.05)


@pytest.mark.nightly
@pytest.mark.xfail(strict=True, reason="one point a vertex is too coarse a quadrature, and rims count side faces")
def test_pressure_between_two_meshes_is_even() -> None:
    """Within 1 % everywhere; it is 869 to 1220 Pa of 1000 at the rim, 978 to 1021 Pa inside."""
    found, _ = pressed_meshes()
    np.testing.assert_allclose(found, 1e3, rtol=1e-2)
