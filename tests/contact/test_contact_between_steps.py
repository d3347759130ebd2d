"""What contact does between and around steps: the last Newton direction, things moved from outside, rest positions,
who takes part, and what errors say."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np
import pytest
from contact_scenes import KINDS, Body, ContactScene, Floats, contact_scene

from yasps import (
    Attribute,
    ConnectivityError,
    DataError,
    IntersectionError,
    NameTakenError,
    NotConvergedError,
    Scene,
    SceneError,
    YaspsError,
)
from yasps.contact import BarrierContact, CollisionGeometry, Plane
from yasps.meshes import box, ground
from yasps.stepping import NewtonSettings, minimize

SIZE, DISTANCE = 0.1, 1e-3
CUBE = box((SIZE,) * 3, (1, 1, 1))
PLANE = Plane("p", (0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def on_ground(kind: str, gap: float = 0.75 * DISTANCE, speed: float = 0.0) -> ContactScene:
    """A cube just above two triangles, beside their common edge."""
    cube = CUBE.translated((0.0123, 0.031, SIZE / 2 + gap))
    settings = NewtonSettings(linear_tolerance=1e-8)  # what a solve leaves over pushes the cube
    return contact_scene(
        kind, [Body(cube, (speed, 0.0, 0.0))], [ground((4.0, 4.0))], distance=DISTANCE, settings=settings
    )


# -- the last direction --------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_a_cube_slides_without_friction(kind: str) -> None:
    scene = on_ground(kind, speed=1.0)
    for _ in range(50):
        scene.step()
    along, across, _ = scene.mean_velocity()
    assert abs(along - 1.0) < 1e-3
    assert abs(across) < 1e-3


def bowl() -> tuple[Scene, Attribute]:
    scene = Scene("bowl")
    points = scene.add_mesh("m").add_primitive("points", 1)
    x = points.add_attribute("x", 3, 1, value=[[1e-3, 0.0, 0.0]])
    scene.add_energy(points.add_attribute("bowl", computed_attribute=0.5 * x.dot(x)))
    scene.add_minimize_target(x)
    return scene, x


def test_the_last_direction_is_taken() -> None:
    scene, x = bowl()
    report = minimize(scene, [x], 1.0, settings=NewtonSettings(velocity_tolerance=1.0))
    assert report.iterations == 1
    assert report.step_lengths == [1.0]
    np.testing.assert_allclose(x.value, 0.0, atol=1e-15)
    assert report.energy == scene.total_energy() == 0.0


def test_no_step_along_the_last_direction_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, x = bowl()
    start = x.value
    energies = iter([0.0])
    monkeypatch.setattr(Scene, "total_energy", lambda self: next(energies, 1.0))  # whatever is tried, it grows
    report = minimize(scene, [x], 1.0, settings=NewtonSettings(velocity_tolerance=1.0))
    np.testing.assert_array_equal(x.value, start)
    assert report.energy == 0.0
    energies = iter([0.0])
    with pytest.raises(NotConvergedError, match="no step along the Newton direction"):
        minimize(scene, [x], 1.0, settings=NewtonSettings(velocity_tolerance=1e-9))
    np.testing.assert_array_equal(x.value, start)


# -- moved from outside --------------------------------------------------------------------------------------


def raised(positions: Floats, height: float) -> Floats:
    return np.asarray(positions.reshape(-1, 3) + np.array([0.0, 0.0, height]))


def state(scene: ContactScene) -> list[object]:
    stepper = scene.stepper
    arrays = [*(target.value for target in scene.scene.minimize_targets), *stepper.velocities]
    return [stepper.time, *(a.tobytes() for a in arrays), *(part.predicted.value.tobytes() for part in stepper.parts)]


@pytest.mark.parametrize("rise", [0.9e-3, 5e-3, 0.3])
@pytest.mark.parametrize("kind", KINDS)
def test_the_ground_does_not_rise_through_a_cube(kind: str, rise: float) -> None:
    """Also when it comes out at the other side, where nothing intersects."""
    scene = on_ground(kind)
    scene.step()
    before, here = state(scene), scene.still.value.reshape(-1, 3)
    scene.still.update_value(raised(here, rise))
    for _ in range(2):  # it is not taken for seen by trying
        with pytest.raises(IntersectionError, match=rf"'{kind} 0'.*'obstacle 0'.*reset\(\)"):
            scene.step()
        with pytest.raises(IntersectionError, match="straight way"):
            minimize(scene.scene, [], 0.01, contact=scene.contact)
    assert state(scene) == before
    scene.still.update_value(here)
    scene.step()
    assert not scene.intersects()


def test_small_motions_add_up_to_a_way_that_is_looked_at() -> None:
    scene = on_ground("soft")
    scene.step()
    for _ in range(4):
        scene.still.update_value(raised(scene.still.value, 3e-4))
        scene.contact.update()  # finding pairs accepts nothing
    with pytest.raises(IntersectionError, match="'soft 0'"):
        scene.step()


def test_the_ground_may_rise_by_less_than_the_gap_and_nearly_touch() -> None:
    """Steps are bounded to leave a tenth of each distance; a way that leaves less of it is no collision."""
    scene = on_ground("affine")
    scene.step()
    gap = scene.contact.active.minimum_distance
    scene.still.update_value(raised(scene.still.value, 0.97 * gap))
    scene.step()
    assert not scene.intersects()


def test_a_free_body_moved_by_the_user_is_looked_at_too() -> None:
    scene = on_ground("soft")
    scene.step()
    here = scene.moving.value.reshape(-1, 3)
    scene.moving.update_value(raised(here, -0.3))
    with pytest.raises(IntersectionError, match="'soft 0'"):
        scene.step()
    scene.moving.update_value(raised(here, 0.3))
    scene.step()


def test_reset_takes_a_jump_for_a_new_start() -> None:
    scene = on_ground("affine")
    scene.step()
    here = scene.still.value.reshape(-1, 3)
    scene.still.update_value(raised(here, 2 * SIZE))
    scene.contact.reset()
    scene.step()
    scene.still.update_value(raised(here, SIZE / 2))
    with pytest.raises(IntersectionError, match="cross or touch"):
        scene.contact.reset()
    scene.still.update_value(raised(here, -SIZE))  # through the cube
    with pytest.raises(IntersectionError, match="straight way"):
        scene.step()
    scene.contact.reset()
    scene.step()
    assert not scene.intersects()


def test_a_way_that_passes_near_many_things_is_free() -> None:
    """Each post is passed at a thousandth of its distance at first: the bound stops there, but nothing collides."""
    posts = np.concatenate([TRIANGLE * [0.01, 0.01, 0.0] + [x, 1e-3, 0.0] for x in (1.0, 2.0, 3.0, 4.0)])
    points = np.concatenate([posts, [[-0.1, 0.0, -0.5], [-0.1, 0.0, 0.5], [-0.2, -0.1, 0.0]]])
    way = np.zeros_like(points)
    way[12:, 0] = 6.0
    turned = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]  # so that no boxes are disjoint
    geometry = CollisionGeometry(points @ turned, np.arange(15).reshape(-1, 3), 1e-2)
    assert geometry.step_bound(points @ turned, (points + way) @ turned) < 0.5
    geometry.check_way(points @ turned, (points + way) @ turned)
    way[12:, 1] = 0.02
    with pytest.raises(IntersectionError, match=r"^(edge|vertex).*collide at 0\.[0-9]+ of the straight way"):
        geometry.check_way(points @ turned, (points + way) @ turned)


def test_steps_do_not_look_at_their_own_ways_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither after flight nor in contact: what a step accepted is where the next one starts."""
    scene = on_ground("soft", gap=2.5e-3)

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("nothing was moved from outside")

    monkeypatch.setattr(CollisionGeometry, "check_way", refuse)
    contacts = [scene.step().contacts for _ in range(4)]
    assert contacts[0] == 0 < contacts[-1]
    scene.still.update_value(raised(scene.still.value, 1e-9))
    with pytest.raises(AssertionError, match="nothing was moved"):
        scene.step()


@pytest.mark.parametrize(
    ("gap", "before", "down", "up"), [(0.75, 0.0, 0.45, 0.45), (2.5, 0.0, 3.0, 0.0), (0.75, 0.6, 0.3, 0.0)]
)
def test_short_ways_are_bounded_where_they_must_be(gap: float, before: float, down: float, up: float) -> None:
    """In activation distances: both sides move; nothing is close yet; the way starts elsewhere than the close pairs."""
    scene = on_ground("soft", gap=gap * DISTANCE)
    start = scene.contact.positions()
    cube = slice(0, len(CUBE.vertices))
    start[cube, 2] -= before * DISTANCE
    end = start.copy()
    end[cube, 2] -= down * DISTANCE
    end[-4:, 2] += up * DISTANCE
    step, _ = scene.contact.free_step(start, end)
    assert step == pytest.approx(scene.contact.geometry.step_bound(start, end), rel=1e-6)
    assert step < 1.0


# -- rest positions ------------------------------------------------------------------------------------------


def stretched_pair(rebuilt: bool, with_rest: bool) -> ContactScene:
    """Two cubes edge beside edge, nearly parallel, stretched to 1.6 times their length."""
    upper = CUBE.rotated((1.0, 0.0, 0.0), np.pi / 4).rotated((0.0, 0.0, 1.0), 0.01)
    upper = upper.translated((0.0, 0.0, -upper.vertices[:, 2].min() + 0.6 * DISTANCE))
    lower = CUBE.rotated((1.0, 0.0, 0.0), np.pi / 4)
    lower = lower.translated((0.0, 0.0, -lower.vertices[:, 2].max()))
    floor = ground((1.0, 1.0), -1.0)
    stretched = [shape.vertices * [1.6, 1.0, 1.0] for shape in (lower, upper)]
    at_rest = contact_scene("soft", [Body(lower), Body(upper)], [floor])
    if not rebuilt:
        at_rest.moving.update_value(np.concatenate(stretched))
        at_rest.contact.reset()
        return at_rest
    return contact_scene(
        "soft",
        [Body(shape, start=start) for shape, start in zip((lower, upper), stretched, strict=True)],
        [floor],
        rest_positions=at_rest.contact.positions() if with_rest else None,
    )


def test_a_scene_rebuilt_from_a_deformed_state_has_the_same_energies() -> None:
    deformed, rebuilt = stretched_pair(False, True), stretched_pair(True, True)
    np.testing.assert_array_equal(deformed.contact.positions(), rebuilt.contact.positions())
    wanted, found = deformed.scene.energy_values(), rebuilt.scene.energy_values()
    assert wanted["everything.mollified_edge_edge.barrier"].sum() > 0
    for name, values in wanted.items():
        if name.endswith("inertia"):  # of where the vertices were predicted to be
            continue
        np.testing.assert_array_equal(found[name], values)
    without = stretched_pair(True, False).scene.energy_values()
    name = "everything.mollified_edge_edge.barrier"
    assert without[name].sum() < 0.9 * wanted[name].sum()  # longer edges count as parallel sooner


# -- who takes part ------------------------------------------------------------------------------------------


def points_over_a_triangle(height: float) -> tuple[Scene, Callable[..., BarrierContact]]:
    scene = Scene("loose")
    mesh = scene.add_mesh("m")
    loose, floor = mesh.add_primitive("rod", 2), mesh.add_primitive("floor", 4)
    loose.add_attribute("position", 3, 1, value=[[0.2, 0.2, height], [0.2, 0.2, 1.0]])
    floor.add_constant("position", 3, 1, value=[*TRIANGLE.tolist(), [5.0, 5.0, 5.0]])
    union = mesh.add_primitive_union("points", [loose, floor])
    union.add_attribute("position")

    def build(**options: object) -> BarrierContact:
        arguments: dict[str, object] = {"activation_distance": 0.1, "stiffness": 1.0} | options
        return BarrierContact(mesh, union, [[2, 3, 4]], **arguments)  # type: ignore[arg-type]

    return scene, build


def test_an_object_of_loose_points_is_refused_and_a_rod_takes_part(caplog: pytest.LogCaptureFixture) -> None:
    scene, build = points_over_a_triangle(0.05)
    with pytest.raises(SceneError, match=r"none of the 2 vertices of 'm\.rod' is in a triangle or an edge"):
        build()
    assert scene.energies == ()
    assert "reach" not in scene.m.attributes
    with caplog.at_level(logging.INFO, logger="yasps"):
        contact = build(edges=[[0, 1]])
    assert len(contact.active.point_triangle) == 1
    assert "1 of 4 vertices of 'm.floor' are in no triangle or edge and take no part, first vertex 3" in caplog.text


# -- errors --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"activation_distance": -1.0}, DataError, r"activation_distance must be positive, .*got -1\.0 m"),
        ({"activation_distance": "1 mm"}, DataError, "activation_distance needs real numbers, got <U4"),
        ({"stiffness": np.inf}, SceneError, "stiffness must be positive, one finite number, got inf"),
        ({"edges": [[0, 9]]}, ConnectivityError, "edges must hold ids from 0 to 5"),
        ({"edges": [[0, 1], [1]]}, ConnectivityError, "edges needs numbers, got a ragged list"),
        ({"rest_positions": np.zeros((5, 3))}, DataError, r"rest_positions must have shape \[6, 3\]"),
        ({"rest_positions": np.full((6, 3), np.nan)}, DataError, "rest_positions: 6 vertices are NaN"),
        ({"fixed": [True]}, DataError, "fixed must be bool"),
        ({"group": np.zeros(6)}, DataError, "group must be integers"),
        ({"fixed": [True] + [False] * 5, "group": [0] * 6}, SceneError, "a group is all fixed or all free"),
        ({"objects": {"all": 5}}, DataError, "which sum to 6"),
        ({"objects": {"one": -1, "all": 7}}, DataError, "which sum to 6"),
        ({"projection": "clip"}, SceneError, "projection is one of 'clamp', 'abs', 'none', got 'clip'"),
        ({"table": {"all": 0.5}}, SceneError, "the table is a ContactTable"),
        ({"planes": ["floor"]}, SceneError, "planes are a list of Plane"),
        ({"objects": {"p": 6}, "planes": [PLANE]}, SceneError, "two of the objects and half-spaces are named 'p'"),
        ({"moduli": {"p": "soft"}}, SceneError, "the contact modulus of 'p' needs real numbers"),
        ({"moduli": {"p": -1.0}}, SceneError, "the contact modulus of 'p' must be positive, .* Pa"),
    ],
)
def test_wrong_arguments_are_errors_of_ours_and_add_nothing(
    options: dict[str, object], error: type[YaspsError], message: str
) -> None:
    scene, build = points_over_a_triangle(0.05)
    with pytest.raises(error, match=message) as caught:
        build(**{"edges": [[0, 1]]} | options)
    assert isinstance(caught.value, YaspsError)
    assert scene.energies == ()
    assert "reach" not in scene.m.attributes


@pytest.mark.parametrize("name", ["surface_edges", "point_triangle_friction", "reach"])
def test_names_that_contact_needs_are_asked_for_first(name: str) -> None:
    scene, build = points_over_a_triangle(0.05)
    scene.m.add_primitive(name, 1)
    with pytest.raises(NameTakenError, match=f"has a part named '{name}' already"):
        build(edges=[[0, 1]])
    assert scene.energies == ()
    assert "squared_reach" not in scene.m.attributes


def test_a_nearly_singular_block_names_contact_and_its_vertices() -> None:
    tilted = CUBE.rotated((1.0, 0.0, 0.0), 0.6).rotated((0.0, 1.0, 0.0), 0.5)
    cube = tilted.translated((0.1, 0.3, 1e-12 - tilted.vertices[:, 2].min()))
    scene = contact_scene("affine", [Body(cube)], [ground((4.0, 4.0))])
    where = r"stiff\.body\.affine_matrix, instance 0 is not positive definite"
    acting = r"everything\.point_triangle\.barrier on instance 0 \(vertices: stiff\.vertices \d, ground\.vertices \d"
    with pytest.raises(NotConvergedError, match=f"{where}.*{acting}.*larger gap"):
        scene.scene.minimize_energy()
    with pytest.raises(NotConvergedError, match=f"Newton iteration 1:.*{where}.*{acting}.*smallest distance in .* m"):
        scene.step()


def test_minimize_names_the_instance_that_nothing_holds() -> None:
    scene = Scene("unheld")
    points = scene.add_mesh("m").add_primitive("points", 3)
    x = points.add_attribute("x", 3, 1, value=np.ones((3, 3)))
    weight = points.add_constant("weight", 1, 1, value=[1.0, 0.0, 1.0])
    scene.add_energy(points.add_attribute("bowl", computed_attribute=weight * x.dot(x)))
    scene.add_minimize_target(x)
    with pytest.raises(
        NotConvergedError, match=r"block of m\.points\.x, instance 1 is not positive definite: does every"
    ):
        minimize(scene, [x], 1.0)
