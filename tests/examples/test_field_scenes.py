"""Scenes of the field: what their checks refuse, and what they do at other coefficients of friction."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from yasps import SceneError
from yasps.examples import chain, cloth_on_sphere, erleben, gripper, noodles, rods_twist, turntable
from yasps.program import CheckFailedError
from yasps.simulation import Simulation


def ran(scene: ModuleType, *flags: str) -> tuple[Simulation, str]:
    """The simulation after its frames, and what its check says."""
    options = scene.PROGRAM.options([*flags, "--threads", "1"])
    simulation = scene.build(options)
    simulation.run(options.frames)
    return simulation, scene.check(simulation, options)


def refused(scene: ModuleType, *flags: str) -> str:
    """What the check says of a run that ends as it should not."""
    with pytest.raises(CheckFailedError) as error:
        ran(scene, *flags)
    return str(error.value)


def test_the_links_of_a_chain_are_wires_that_go_through_each_other() -> None:
    line = chain.centre_line()
    shape = chain.link()
    assert (shape.volumes() > 0).all()
    assert len(shape.surface_triangles()) == 2 * chain.AROUND * chain.ALONG
    length = 2 * (np.pi * chain.BEND + chain.STRAIGHT)
    assert shape.volumes().sum() == pytest.approx(np.pi * chain.WIRE**2 * length, rel=0.1)
    across = line[:, [0, 2, 1]]
    through = across + np.array([chain.SLACK * chain.TAUT, 0.0, 0.0])
    assert abs(chain.linking_number(line, through)) == pytest.approx(1.0, abs=1e-9)
    assert chain.linking_number(line, through[::-1]) == pytest.approx(-chain.linking_number(line, through))
    assert chain.linking_number(line, across + np.array([2 * chain.TAUT, 0.0, 0.0])) == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(SceneError, match="at least 3 links, got 2"):
        chain.build(chain.PROGRAM.options(["--size", "2"]))


def test_everything_in_the_ten_cases_is_closed_and_the_right_way_round() -> None:
    assert len(erleben.CASES) == 10
    for things in erleben.CASES.values():
        shape, _ = things()
        assert (shape.volumes() > 0).all()
    for name in erleben.SLIDING:
        shape, _ = erleben.CASES[name]()
        lowest = np.abs(shape.vertices[:, 2]) < 1e-9
        assert lowest.sum() >= 3, name  # it lies on a face


def test_the_sphere_speeds_up_evenly() -> None:
    times = np.linspace(0.0, 2.0, 401)
    angles = np.array([cloth_on_sphere.angle_of_sphere(time, 180.0) for time in times])
    speeds = np.gradient(angles, times)
    assert angles[times <= cloth_on_sphere.BEGINS].max() == 0.0
    assert speeds[times > cloth_on_sphere.REACHES + 0.01] == pytest.approx(np.pi)
    assert np.diff(speeds).min() > -1e-9


@pytest.mark.parametrize("count", [1, 5, 10, 25])
def test_noodles_are_apart_and_in_the_bowl(count: int) -> None:
    strands, radius = np.stack(noodles.strands(count)), noodles.bowl_radius(count)
    lower = strands[strands[:, :, 2] < 0.0]
    assert np.linalg.norm(lower, axis=1).max() < radius - 2 * noodles.RADIUS
    middles = strands[:, noodles.SEGMENTS // 2, :2]
    apart = np.linalg.norm(middles[:, None] - middles[None], axis=2) + np.eye(len(middles))
    assert apart.min() > 2 * noodles.RADIUS
    shape = noodles.bowl(radius)
    corners = shape.vertices[shape.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((normals * corners.mean(axis=1)).sum(axis=1) < 0).all()  # inwards


@pytest.mark.nightly
def test_little_friction_lets_the_ball_slip() -> None:
    simulation, told = ran(gripper, "--size", "100", "--frames", "100", "--friction", "0.1")
    assert "slipped out" in told
    assert simulation.moving[0].positions()[:, 2].min() < gripper.DISTANCE


@pytest.mark.nightly
@pytest.mark.parametrize(("friction", "carried"), [(0.05, 0), (0.5, 1), (1.0, 2)])
def test_the_turntable_carries_what_friction_holds(friction: float, carried: int) -> None:
    _, told = ran(turntable, "--size", "2", "--frames", "30", "--friction", str(friction))
    assert f"{carried} are carried, {2 - carried} slid off" in told


@pytest.mark.nightly
def test_a_cloth_without_friction_does_not_turn() -> None:
    simulation, _ = ran(cloth_on_sphere, "--size", "16", "--frames", "130", "--friction", "0")
    assert abs(cloth_on_sphere.turned(simulation)) < np.radians(5.0)
    simulation, _ = ran(cloth_on_sphere, "--size", "16", "--frames", "130")
    assert cloth_on_sphere.turned(simulation) > np.radians(70.0)


@pytest.mark.nightly
@pytest.mark.parametrize("kind", [(), ("--soft",), ("--friction", "0.5"), ("--soft", "--friction", "0.5")])
def test_the_ten_cases_with_friction_and_soft(kind: tuple[str, ...]) -> None:
    _, told = ran(erleben, *kind)
    assert told.startswith("energy fell from")


@pytest.mark.nightly
def test_runs_that_are_too_short_are_refused() -> None:
    assert "the run ended at 0.20 s" in refused(gripper, "--size", "100", "--frames", "20")
    assert "the run ended at 0.05 s" in refused(chain, "--size", "3", "--frames", "5")
    assert "the run ended at 0.05 s" in refused(noodles, "--size", "1", "--frames", "10")
    assert "the run ended at 0.10 s" in refused(cloth_on_sphere, "--size", "8", "--frames", "10")


@pytest.mark.nightly
def test_bars_are_twisted_around_each_other() -> None:
    _, told = ran(rods_twist, "--size", "1", "--frames", "200")
    assert "every bar presses on another" in told
