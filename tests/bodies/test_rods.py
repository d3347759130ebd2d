"""Rods: what they are made of, and how they hang, bend and lie on each other."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import Scene, YaspsError
from yasps.bodies import Rod
from yasps.contact import ContactTable
from yasps.simulation import Simulation

RADIUS, STIFFNESS, DENSITY = 0.01, 1e9, 1000.0  # m, Pa, kg/m^3
SECTION = np.pi * RADIUS**2  # m^2


def line(count: int, length: float = 1.0, *, height: float = 0.0) -> np.ndarray:
    """Points along x from the origin on."""
    return np.column_stack([np.linspace(0.0, length, count), np.zeros(count), np.full(count, height)])


def test_a_rod_has_what_its_name_says() -> None:
    scene = Scene("s", threads=1)
    rod = Rod(scene, "rod", line(11, 2.0), radius=RADIUS, density=DENSITY, youngs_modulus=STIFFNESS)
    assert scene.rod is rod.mesh
    assert rod.mass.value.sum() == pytest.approx(DENSITY * SECTION * 2.0)
    assert rod.mass.value[0] == pytest.approx(rod.mass.value[1] / 2)
    np.testing.assert_array_equal(rod.edges, np.column_stack([np.arange(10), np.arange(1, 11)]))
    np.testing.assert_array_equal(rod.radii(), RADIUS)
    assert (len(rod.triangles), rod.contact_modulus) == (0, STIFFNESS)
    values = scene.energy_values()
    assert set(values) == {"rod.segments.stretching", "rod.bends.bending"}
    assert sum(float(v.sum()) for v in values.values()) == pytest.approx(0.0, abs=1e-20)
    rod.position.update_value(rod.rest * [1.01, 1.0, 1.0])
    stretched = float(scene.energy_values()["rod.segments.stretching"].sum())
    assert stretched == pytest.approx(0.5 * STIFFNESS * SECTION * 0.01**2 * 2.0)
    # Around a circle: half of E I times the squared curvature, over the length between the first and the last bend.
    angle = np.linspace(0.0, 1.0, 11)
    rod.position.update_value(2.0 * np.column_stack([np.sin(angle), np.zeros(11), 1 - np.cos(angle)]))
    inertia = np.pi * RADIUS**4 / 4
    bent = float(scene.energy_values()["rod.bends.bending"].sum())
    assert bent == pytest.approx(0.5 * STIFFNESS * inertia / 2.0**2 * 1.8, rel=2e-3)


def test_several_rods_have_nothing_between_them() -> None:
    scene = Scene("s", threads=1)
    rods = Rod(scene, "rods", [line(3), line(2, height=1.0), line(4, height=2.0)], radius=RADIUS)
    np.testing.assert_array_equal(rods.edges, [[0, 1], [1, 2], [3, 4], [5, 6], [6, 7], [7, 8]])
    assert rods.bends.num_instances == 3
    np.testing.assert_array_equal(rods.bends.connectivities["corners"].indices.reshape(-1, 3)[0], [0, 1, 2])
    np.testing.assert_allclose(rods.bends["rest_length"].value, [1.0, 2 / 3, 2 / 3])
    alike = Rod(scene, "alike", np.stack([line(3), line(3, height=1.0)]), radius=RADIUS)
    assert (len(alike.rest), len(alike.edges)) == (6, 4)


def test_a_single_segment_can_not_bend() -> None:
    rod = Rod(Scene("s", threads=1), "rod", line(2), radius=RADIUS)
    assert [energy.name for energy in rod.energies] == ["stretching"]


@pytest.mark.parametrize(
    ("points", "numbers", "words"),
    [
        (line(3), {"radius": 0.0}, "b: radius must be positive"),
        (line(3), {"density": -1.0}, "b: density must be positive"),
        (line(3), {"youngs_modulus": np.nan}, "b: youngs_modulus must be positive"),
        (line(1), {}, r"at least two, got shape \(1, 3\)"),
        (np.zeros((3, 2)), {}, r"a rod goes through points \[n, 3\]"),
        ([line(3), np.zeros((2, 3))], {}, "segment 0 of the rod has no length"),
        ([], {}, "points are those of at least one rod, got none"),
        (5.0, {}, r"a rod goes through points \[n, 3\]"),
        ("long", {}, "points of a rod needs real numbers|points of a rod need real numbers"),
    ],
)
def test_wrong_rods_leave_the_scene_as_it_was(points: object, numbers: dict[str, float], words: str) -> None:
    scene = Scene("s", threads=1)
    with pytest.raises(YaspsError, match=words):
        Rod(scene, "b", points, **{"radius": RADIUS, **numbers})  # type: ignore[arg-type]
    assert not scene.energies
    scene.add_mesh("b")  # the name is free


@pytest.mark.slow
def test_a_clamped_rod_hangs_as_beam_theory_says() -> None:
    """Deflection q L^4 / (8 E I) of a cantilever under its weight; its clamp is in the middle of the first segment."""
    scene = Scene("cantilever", threads=1)
    rod = Rod(scene, "rod", line(41), radius=RADIUS, density=DENSITY, youngs_modulus=STIFFNESS)
    simulation = Simulation(scene, [rod], time_step=10.0, contact=False)
    simulation.pin(rod, [0, 1])
    for _ in range(6):
        simulation.step()
    free, inertia = 1.0 - 0.5 / 40, np.pi * RADIUS**4 / 4
    expected = DENSITY * SECTION * 9.8 * free**4 / (8 * STIFFNESS * inertia)
    assert -rod.positions()[-1, 2] == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_a_rod_that_falls_across_another_rests_on_its_thickness() -> None:
    scene = Scene("cross", threads=1)
    below = Rod(scene, "below", line(5, 0.2), radius=5e-3, youngs_modulus=1e7)
    across = line(6, 0.25)[:, [1, 0, 2]] + [0.1, -0.125, 0.0105]
    above = Rod(scene, "above", across, radius=5e-3, youngs_modulus=1e7)
    simulation = Simulation(
        scene, [below, above], activation_distance=5e-4, contacts=ContactTable(friction=0.5), time_step=0.01
    )
    simulation.pin(below, range(5))
    for _ in range(30):
        simulation.step()
        simulation.check_intersection_free()
    heights = above.positions()[:, 2]
    middle = 0.5 * (heights[2] + heights[3])  # the rods' axes cross there
    assert 1e-2 < middle < 1e-2 + 5e-4
    weight = 9.8 * above.mass.value.sum()
    assert simulation.contact_forces().on_bodies()[1, 2] == pytest.approx(weight, rel=0.01)
