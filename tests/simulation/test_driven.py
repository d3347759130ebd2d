"""What is driven is where it shall be at the end of each step, or nothing has moved and the error says why."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yasps import ConnectivityError, DataError, IntersectionError, Scene, SceneError, ShapeMismatchError
from yasps.bodies import AffineBody, Cloth, MovingObstacle, Obstacle, SoftBody
from yasps.meshes import TriangleMesh, box, cloth_grid
from yasps.output import FrameRecorder, read_series
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

CUBE = box((0.1, 0.1, 0.1), (1, 1, 1))
DT = 0.01
UP = np.array([0.0, 0.0, 1.0])
TIGHT = NewtonSettings(velocity_tolerance=1e-4, solver="direct", max_iterations=300)


def plate(height: float) -> TriangleMesh:
    """A level plate 2 cm thick, its lower face at that height."""
    shape = box((0.3, 0.3, 0.02), (1, 1, 1)).translated((0.0, 0.0, height + 0.01))
    return TriangleMesh(shape.vertices, shape.surface_triangles())


def lift(distance: float = 0.0) -> tuple[Simulation, AffineBody, MovingObstacle]:
    """A stiff cube half a millimetre above a plate that can be moved, and below another, `ceiling`."""
    scene = Scene("lift", threads=1)
    body = AffineBody(scene, "cube", CUBE.translated((0.0, 0.0, 0.0505)), youngs_modulus=1e10)
    below = MovingObstacle(scene, "plate", plate(-0.02 - distance))
    ceiling = MovingObstacle(scene, "ceiling", plate(0.2))
    return Simulation(scene, [body, below, ceiling], activation_distance=1e-3, settings=TIGHT), body, below


def test_a_lift_takes_up_what_lies_on_it_and_arrives_exactly() -> None:
    """Its first step is longer than the gap: the cube is pushed aside, that is, up."""
    simulation, body, below = lift()
    compiled = simulation.scene.compile()
    start, rest = below.positions(), body.positions()
    below.motion = lambda time: start + time * UP
    for _ in range(4):
        report = simulation.step()
        np.testing.assert_array_equal(below.positions(), start + simulation.time * UP)
        simulation.check_intersection_free()
    assert simulation.scene.compile() is compiled
    np.testing.assert_allclose(simulation.velocity_of(below), np.tile(UP, (8, 1)), rtol=1e-9)
    assert body.positions()[:, 2].min() > below.positions()[:, 2].max()
    assert np.abs(simulation.velocity_of(body)[:, 2].mean() - 1.0) < 0.1
    assert report.contacts > 0
    # It stops: what it carries flies on.
    below.motion = None
    simulation.step()
    np.testing.assert_array_equal(below.positions(), start + 4 * DT * UP)
    np.testing.assert_array_equal(simulation.velocity_of(below), 0.0)
    assert (body.positions() - rest)[:, 2].min() > 0.045


def test_motions_are_functions_tables_and_places() -> None:
    simulation, _, below = lift(0.5)
    start = below.positions()
    below.motion = np.array([start, start + 0.01 * UP, start + 0.03 * UP])
    heights = []
    for _ in range(3):
        simulation.step()
        heights.append((below.positions() - start)[0, 2])
    np.testing.assert_allclose(heights, [0.01, 0.03, 0.03], rtol=1e-12)
    below.move_to(start)
    simulation.step()
    np.testing.assert_array_equal(below.positions(), start)
    below.move_to(start[:3])
    with pytest.raises(ShapeMismatchError, match=r"the motion of plate: positions are \[8, 3\], got \[3, 3\]"):
        simulation.step()
    below.motion = lambda time: np.full((8, 3), np.nan)
    with pytest.raises(DataError, match=r"the motion of plate at t = 0\.05 s: entry 0 is nan"):
        simulation.step()
    np.testing.assert_array_equal(below.positions(), start)


def test_what_can_not_yield_is_named_and_nothing_moves() -> None:
    """The cube lies on a plate that rises, below one that stays; there is room for a flat cube, not for none."""
    simulation, _, below = lift()
    simulation.step()
    before = simulation.state()
    below.move_to(below.positions() + 0.21 * UP)
    said = r"plate can't get to .* t = 0\.02 s.*of 'plate'.*of 'ceiling'"
    with pytest.raises(IntersectionError, match=said) as caught:
        simulation.step()
    assert "Nothing was moved" in str(caught.value)
    after = simulation.state()
    for name, value in before.items():
        np.testing.assert_array_equal(after[name], value)
    below.move_to(below.positions() + 1e-4 * UP)  # and it goes on from there
    simulation.step()
    simulation.check_intersection_free()


def test_two_that_are_driven_into_each_other_are_refused() -> None:
    simulation, _, below = lift(0.5)
    above = simulation.bodies[2]
    assert isinstance(above, MovingObstacle)
    starts = below.positions(), above.positions()
    below.move_to(starts[0] + 0.4 * UP - np.array([0.4, 0.0, 0.0]))
    above.move_to(starts[1] - 0.4 * UP - np.array([0.4, 0.0, 0.0]))
    with pytest.raises(
        IntersectionError, match=r"(plate|ceiling) can't .* after 0 rounds.*'(plate|ceiling)'.*'(plate|ceiling)'"
    ):
        simulation.step()
    np.testing.assert_array_equal(below.positions(), starts[0])
    np.testing.assert_array_equal(above.positions(), starts[1])
    below.motion = None
    above.move_to(starts[1] + DT * UP)
    simulation.step()
    np.testing.assert_array_equal(above.positions(), starts[1] + DT * UP)


def test_pinned_vertices_are_where_they_are_told_and_nothing_compiles() -> None:
    scene = Scene("curtain", threads=1)
    cloth = Cloth(scene, "cloth", cloth_grid((0.2, 0.2), (2, 2)), bending=1e-4)
    simulation = Simulation(scene, [cloth], contact=False)
    pins = simulation.pin(cloth, [0, 2])
    simulation.run(3)
    np.testing.assert_array_equal(cloth.positions()[[0, 2]], cloth.rest[[0, 2]])
    assert cloth.positions()[8, 2] < cloth.rest[8, 2] - 1e-3
    compiled = scene.compile()
    pins.move_to(cloth.rest[[0, 2]] + 0.01 * UP)
    simulation.step()
    np.testing.assert_array_equal(cloth.positions()[[0, 2]], cloth.rest[[0, 2]] + 0.01 * UP)
    np.testing.assert_allclose(simulation.velocity_of(cloth)[[0, 2]], [UP, UP], rtol=1e-9)
    with pytest.raises(SceneError, match="pinned already"):
        simulation.pin(cloth, [2, 3])
    pins.release()
    simulation.run(2)
    assert (cloth.positions()[[0, 2], 2] > cloth.rest[[0, 2], 2] + 0.011).all()  # at 1 m/s, as they were moved
    assert scene.compile() is compiled
    with pytest.raises(ConnectivityError, match="cloth has vertices 0 to 8, got 9 to pin"):
        simulation.pin(cloth, [9])
    with pytest.raises(SceneError, match="springs have no motion"):
        simulation.pin(cloth, [1], 100.0, motion=cloth.rest[[1]])
    springs = simulation.pin(cloth, [1], 100.0)
    springs.move_to(cloth.rest[[1]])
    simulation.step()


@pytest.mark.nightly
def test_a_pin_follows_a_function_through_what_gives_way() -> None:
    """A corner of a soft cube is pushed into a free one, which is lighter and moves off."""
    scene = Scene("poke", threads=1)
    soft = SoftBody(scene, "soft", CUBE, youngs_modulus=1e5)
    free = AffineBody(scene, "free", CUBE.translated((0.0, 0.0, 0.1006)), density=100.0)
    simulation = Simulation(scene, [soft, free], activation_distance=1e-3, gravity=(0.0, 0.0, 0.0), settings=TIGHT)
    top = np.flatnonzero(soft.rest[:, 2] > 0.04)
    simulation.pin(soft, top, motion=lambda time: soft.rest[top] + 2.0 * time * UP)
    for _ in range(3):
        simulation.step()
        simulation.check_intersection_free()
        np.testing.assert_array_equal(soft.positions()[top], soft.rest[top] + 2.0 * simulation.time * UP)
    assert free.positions()[:, 2].min() > soft.positions()[:, 2].max()


def test_pins_of_a_stiff_body_come_to_their_places_and_carry_its_weight() -> None:
    """The multipliers are the forces: they sum to the weight once the body hangs still."""
    scene = Scene("hinge", threads=1)
    body = AffineBody(scene, "body", CUBE, youngs_modulus=1e8)
    simulation = Simulation(scene, [body], contact=False, settings=TIGHT)
    edge = [0, 1, 2]
    pins = simulation.pin(body, edge)
    for _ in range(6):
        simulation.step()
        assert np.abs(body.positions()[edge] - body.rest[edge]).max() <= 1e-6 * simulation.activation_distance
    weight = 9.8 * float(body.mass.value.sum())
    assert float(pins.multiplier[:, 2].sum()) == pytest.approx(weight, rel=1e-2)
    pins.move_to(body.rest[edge] + 0.02 * UP)
    simulation.step()
    assert np.abs(body.positions()[edge] - body.rest[edge] - 0.02 * UP).max() <= 1e-6 * simulation.activation_distance


def test_a_pin_of_a_stiff_body_in_a_wall_is_refused() -> None:
    simulation, body, _ = lift(0.01)
    before = body.positions()
    pins = simulation.pin(body, [0, 1])
    pins.move_to(before[[0, 1]] - 0.02 * UP)
    with pytest.raises(IntersectionError, match=r"a pin of cube can't get .*of 'cube' and .*of 'plate'"):
        simulation.step()
    np.testing.assert_array_equal(body.positions(), before)


def test_moving_obstacles_come_go_and_are_restored() -> None:
    scene = Scene("crowd", threads=1)
    body = SoftBody(scene, "soft", CUBE)
    below = MovingObstacle(scene, "below", plate(-0.5))
    simulation = Simulation(scene, [body, below], contact=False)
    other = MovingObstacle(scene, "other", plate(0.5), motion=lambda time: plate(0.5).vertices + time * UP)
    simulation.step()
    simulation.add(other)
    simulation.step()
    assert simulation.time == pytest.approx(2 * DT)
    np.testing.assert_allclose(other.positions(), other.rest + 2 * DT * UP, rtol=1e-12)
    below.move_to(below.rest + 0.01 * UP)
    state = simulation.state()
    simulation.step()
    there = [one.positions() for one in (body, below, other)]
    simulation._set_state(state)
    np.testing.assert_array_equal(below.positions(), below.rest)
    np.testing.assert_array_equal(simulation.velocity_of(below), 0.0)
    np.testing.assert_allclose(other.positions(), other.rest + 2 * DT * UP, rtol=1e-12)
    simulation.step()
    for one, positions in zip((body, below, other), there, strict=True):
        np.testing.assert_allclose(one.positions(), positions, rtol=0, atol=1e-12)
    simulation.remove(other)
    simulation.step()
    assert other.progress not in scene.minimize_targets
    np.testing.assert_array_equal(below.positions(), below.rest + 0.01 * UP)


def test_files_have_what_moves_and_what_does_not(tmp_path: Path) -> None:
    scene = Scene("shown", threads=1)
    body, below = SoftBody(scene, "soft", CUBE), MovingObstacle(scene, "below", plate(-0.5))
    still = Obstacle(scene, "still", plate(-1.0))
    simulation = Simulation(scene, [body, below, still], contact=False)
    below.move_to(below.rest + UP)
    with FrameRecorder(simulation, tmp_path, "shown", pictures=False) as recorder:
        simulation.run(1, recorder)
    series = read_series(tmp_path / "shown.vtkhdf")
    here = np.concatenate([body.positions(), below.rest + UP, still.rest])
    np.testing.assert_allclose(series.positions(1), here, rtol=0, atol=1e-12)
    assert [one.stands_still for one in series.bodies] == [False, False, True]
    velocity = series.field("velocity", 1)[series.body("below").vertices]
    np.testing.assert_allclose(velocity * DT, np.tile(UP, (8, 1)), rtol=0, atol=1e-6)
