"""Things that are moved: a press, a turntable, a plate at 100 m/s; and moves that can't be made."""

from __future__ import annotations

import numpy as np
import pytest
from intersection_checks import surfaces_intersect
from scene_shapes import block, disc, outside, turned

from yasps import Scene, YaspsError
from yasps.bodies import AffineBody, Body, HalfSpace, MovingObstacle, Obstacle, SoftBody
from yasps.contact import ContactTable
from yasps.meshes import TriangleMesh
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

SIZE = 0.1  # m, of a cube
DT = 0.01  # s
EPS_V = 1e-3  # m/s
UP = np.array([0.0, 0.0, 1.0])
SETTINGS = NewtonSettings(velocity_tolerance=0.1 * EPS_V, solver="direct", max_iterations=500)


def simulate(scene: Scene, bodies: list[Body], friction: float, gravity: float = 9.8) -> Simulation:
    return Simulation(
        scene,
        bodies,
        time_step=DT,
        gravity=(0.0, 0.0, -gravity),
        activation_distance=1e-3,
        contacts=ContactTable(friction=friction),
        eps_v=EPS_V,
        settings=SETTINGS,
    )


def plate(height: float, size: float = 0.3, thickness: float = 0.02) -> TriangleMesh:
    """A level plate, its lower face at that height."""
    return outside(block((size, size, thickness)).translated((0.0, 0.0, height)))


# ---- the press ----


def press(speed: float, steps: int) -> None:
    """A plate comes down on a soft block on the ground, however the block resists; nothing ever crosses."""
    scene = Scene("press", threads=1)
    cube = block((SIZE,) * 3, (2, 2, 2)).translated((0.0, 0.0, 9.5e-4))
    body = SoftBody(scene, "block", cube, youngs_modulus=1e5, poisson_ratio=0.3)
    start = plate(SIZE + 2e-3)
    above = MovingObstacle(scene, "plate", start, motion=lambda time: start.vertices - speed * time * UP)
    simulation = simulate(scene, [body, above, HalfSpace(scene, "ground")], 0.3)
    for step in range(1, steps + 1):
        simulation.step()
        assert not surfaces_intersect(simulation)
        np.testing.assert_allclose(above.positions(), above.rest - speed * DT * step * UP, atol=1e-12)
    lowest = above.positions()[:, 2].min()
    top = body.positions()[:, 2].max()
    assert lowest - 1e-3 < top < lowest
    assert top < 0.8 * SIZE


def test_a_press_comes_down_on_a_soft_block() -> None:
    press(0.5, 5)


@pytest.mark.nightly
@pytest.mark.parametrize("speed", [0.1, 1.0, 4.0])
def test_the_press(speed: float) -> None:
    press(speed, round(0.04 / (speed * DT)) if speed < 4 else 1)


# ---- the turntable ----

RATE, RADIUS = 2.0, 0.5  # rad/s, m: 2 m/s^2 towards the axis


def turntable(friction: float, seconds: float) -> list[float]:
    """Distances of the cube from the axis, step by step; it starts at the table's speed."""
    scene = Scene("turntable", threads=1)
    shape = block((SIZE,) * 3).translated((RADIUS, 0.0, 9.9e-4))
    body = AffineBody(scene, "block", shape, youngs_modulus=1e7)
    start = disc(1.5)
    table = MovingObstacle(scene, "table", start, motion=lambda time: turned(start.vertices, RATE * time))
    simulation = simulate(scene, [body, table], friction)
    simulation.set_velocity(body, (0.0, RATE * RADIUS, 0.0), angular=(0.0, 0.0, RATE))
    found = []
    for step in range(round(seconds / DT)):
        simulation.step()
        if step % 10 == 9:
            assert not surfaces_intersect(simulation)
        middle = body.positions().mean(axis=0)
        found.append(float(np.hypot(middle[0], middle[1])))
    return found


def test_a_turntable_carries_a_cube_and_loses_it() -> None:
    """2 m/s^2 are 0.41 of what friction of 0.5 holds and 4 times what 0.05 does."""
    carried, lost = turntable(0.5, 0.3), turntable(0.05, 0.3)
    assert abs(carried[-1] - RADIUS) < 0.3 * EPS_V + 1e-3
    assert lost[-1] - RADIUS > 0.05


@pytest.mark.nightly
def test_the_turntable() -> None:
    """A whole turn; creep is slower than eps_v."""
    carried, lost = turntable(0.5, np.pi), turntable(0.05, 0.6)
    assert abs(carried[-1] - RADIUS) < np.pi * EPS_V
    assert lost[-1] - RADIUS > 0.2


# ---- very fast ----


@pytest.mark.parametrize("kind", ["affine", pytest.param("soft", marks=pytest.mark.nightly)])
def test_a_plate_at_100_metres_a_second_takes_a_cube_along(kind: str) -> None:
    """One step moves it by ten cubes. Nothing crosses, and the cube is ahead of it afterwards."""
    scene = Scene("fast", threads=1)
    shape = block((SIZE,) * 3).translated((0.0, 0.0, 0.5))
    body: Body = (
        AffineBody(scene, "block", shape, youngs_modulus=1e8)
        if kind == "affine"
        else SoftBody(scene, "block", shape, youngs_modulus=1e8)
    )
    start = plate(0.3)
    wall = MovingObstacle(scene, "plate", start, motion=lambda time: start.vertices + 100.0 * time * UP)
    simulation = simulate(scene, [body, wall], 0.3, gravity=0.0)
    for step in range(1, 4):
        simulation.step()
        assert not surfaces_intersect(simulation)
        np.testing.assert_allclose(wall.positions(), wall.rest + 100.0 * DT * step * UP, rtol=1e-12)
        assert body.positions()[:, 2].min() > wall.positions()[:, 2].max()


# ---- moves that can't be made ----


def coming_down(scene: Scene, height: float) -> MovingObstacle:
    """A plate that comes down at 5 m/s."""
    start = plate(height)
    return MovingObstacle(scene, "plate", start, motion=lambda time: start.vertices - 5.0 * time * UP)


def check_refused(simulation: Simulation, bodies: list[Body], words: tuple[str, ...]) -> None:
    """One of the first steps fails with an error that names these, and nothing moved in it."""
    for _ in range(20):
        before = [body.positions().copy() for body in bodies]
        try:
            simulation.step()
        except YaspsError as error:
            text = str(error)
            break
    else:
        pytest.fail("every step was taken")
    assert all(word in text for word in words), text
    for body, positions in zip(bodies, before, strict=True):
        np.testing.assert_array_equal(body.positions(), positions)
    assert not surfaces_intersect(simulation)


def test_an_obstacle_that_presses_through_a_body_into_another_obstacle_is_refused() -> None:
    """A stiff cube between a plate that comes down and an anvil can't yield."""
    scene = Scene("jammed", threads=1)
    shape = block((SIZE,) * 3).translated((0.0, 0.0, 9.5e-4))
    body = AffineBody(scene, "block", shape, youngs_modulus=1e8)
    above, anvil = coming_down(scene, SIZE + 2e-3), Obstacle(scene, "anvil", plate(-0.02))
    simulation = simulate(scene, [body, above, anvil], 0.0)
    check_refused(simulation, [body, above], ("plate",))


def test_an_obstacle_that_runs_into_another_is_refused() -> None:
    """Nothing is between them; they are obstacles, and neither yields."""
    scene = Scene("obstacles", threads=1)
    body = AffineBody(scene, "block", block((SIZE,) * 3).translated((0.0, 0.0, 1.0)), youngs_modulus=1e8)
    above, anvil = coming_down(scene, 0.1), Obstacle(scene, "anvil", plate(-0.02))
    simulation = simulate(scene, [body, above, anvil], 0.0)
    check_refused(simulation, [body, above], ("plate", "anvil"))


def test_a_pin_that_is_pulled_into_a_wall_is_refused() -> None:
    scene = Scene("pin", threads=1)
    body = SoftBody(scene, "block", block((SIZE,) * 3).translated((0.0, 0.0, 0.01)), youngs_modulus=1e5)
    wall = Obstacle(scene, "wall", plate(-0.02))
    simulation = simulate(scene, [body, wall], 0.0)
    pins = simulation.pin(body, range(8))
    pins.move_to(body.positions() - 0.05 * UP)
    check_refused(simulation, [body], ("block", "wall"))
