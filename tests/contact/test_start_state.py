"""What is wrong with a start state is said by body, piece and depth, and small overlaps are taken away."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np
import pytest

from yasps import IntersectionError, Scene, SceneError
from yasps.bodies import AffineBody, Body, Cloth, Ground, HalfSpace, MovingObstacle, Obstacle, SoftBody
from yasps.contact import ContactTable, check_start, separate, start_state
from yasps.contact.solid_geometry import closest_on_triangles, ray_lengths, shortest_exits, winding_numbers
from yasps.meshes import TriangleMesh, box, cloth_grid, sphere
from yasps.simulation import Simulation

CUBE = box((0.1, 0.1, 0.1), (2, 2, 2))
BALL = sphere(0.1, 300)


def state_of(bodies: list[Body]) -> list[np.ndarray]:
    return [body.positions() for body in bodies]


def on_ground(scene: Scene) -> list[Body]:
    return [SoftBody(scene, "cube", CUBE.translated((0.01, 0.02, 0.045))), Ground(scene)]


def stiff_on_ground(scene: Scene) -> list[Body]:
    return [AffineBody(scene, "cube", CUBE.translated((0.01, 0.02, 0.045))), Ground(scene)]


def two_stiff(scene: Scene) -> list[Body]:
    return [AffineBody(scene, "low", CUBE), AffineBody(scene, "high", CUBE.translated((0.02, 0.01, 0.095)))]


def balls(scene: Scene) -> list[Body]:
    return [SoftBody(scene, "left", BALL), AffineBody(scene, "right", BALL.translated((0.19, 0.01, 0.0)))]


def cloth_in_cube(scene: Scene) -> list[Body]:
    return [Cloth(scene, "cloth", cloth_grid((0.3, 0.3), (9, 9), 0.046)), SoftBody(scene, "cube", CUBE)]


def crossed_cloths(scene: Scene) -> list[Body]:
    """The middle of one cloth bulges through the other."""
    grid = cloth_grid((0.3, 0.3), (12, 12))
    bulge = grid.vertices + 0.012 * np.exp(-400 * (grid.vertices**2).sum(axis=1))[:, None] * [0.0, 0.0, 1.0]
    lower = TriangleMesh(bulge - [0.0, 0.0, 0.007], grid.triangles)
    return [Cloth(scene, "lower", lower), Cloth(scene, "upper", cloth_grid((0.3, 0.3), (11, 11)))]


def touching_cubes(scene: Scene) -> list[Body]:
    return [SoftBody(scene, "low", CUBE), AffineBody(scene, "high", CUBE.translated((0.0, 0.02, 0.1)))]


SMALL: list[tuple[Callable[[Scene], list[Body]], float]] = [
    (on_ground, 0.005),
    (stiff_on_ground, 0.005),
    (two_stiff, 0.005),
    (balls, 0.0078),
    (cloth_in_cube, 0.004),
    (crossed_cloths, 0.005),
    (touching_cubes, 0.0),
]


@pytest.mark.parametrize(("make", "depth"), SMALL)
def test_small_overlaps_are_measured_and_taken_away(make: Callable[[Scene], list[Body]], depth: float) -> None:
    bodies = make(Scene("overlap", threads=1))
    before = state_of(bodies)
    (overlap,) = start_state(bodies).overlaps
    assert overlap.bodies == (bodies[0].name, bodies[1].name)
    assert overlap.depth == pytest.approx(depth, rel=0.1, abs=1e-12)
    with pytest.raises(IntersectionError, match=rf"'{bodies[0].name}' and '{bodies[1].name}' overlap, .* m deep: "):
        check_start(bodies)
    gap = 2e-4
    separation = separate(bodies, gap=gap)
    state = start_state(bodies)
    assert state.is_apart
    assert not state.flipped
    ways = [np.linalg.norm(new - old, axis=1).max() for new, old in zip(state_of(bodies), before, strict=True)]
    assert separation.moved == {b.name: pytest.approx(w) for b, w in zip(bodies, ways, strict=True) if w > 0}
    # No solution is shorter than the depth and the gap; a bent one is hardly longer.
    assert depth + 0.9 * gap <= sum(ways) <= 1.5 * depth + 2 * gap
    assert not separation.bent
    assert str(separate(bodies, gap=0.99 * gap)) == "all bodies were 0.000198 m apart already"


def test_of_two_stiff_bodies_the_lighter_goes_farther_and_none_turns() -> None:
    scene = Scene("shares", threads=1)
    low, high = AffineBody(scene, "low", CUBE), AffineBody(scene, "high", CUBE.translated((0, 0, 0.096)), density=250.0)
    before = state_of([low, high])
    separate([low, high], gap=1e-3)
    ways = [new - old for new, old in zip(state_of([low, high]), before, strict=True)]
    for way in ways:
        np.testing.assert_allclose(way, np.broadcast_to(way[0], way.shape), atol=1e-15)
    assert ways[1][0, 2] == pytest.approx(-4 * ways[0][0, 2], rel=1e-6)
    assert ways[1][0, 2] - ways[0][0, 2] == pytest.approx(0.005, rel=0.02)


def test_cloth_is_bent_where_no_translation_does() -> None:
    """One tip pokes through it from above, another from below."""
    scene = Scene("tips", threads=1)
    cone = np.array([[0.0, 0.0, 0.0], [0.05, 0.04, 0.08], [-0.05, 0.04, 0.08], [0.0, -0.06, 0.08]])
    sides = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]], np.int32)
    above = Obstacle(scene, "above", TriangleMesh(cone + np.array([-0.1, 0.01, -0.002]), sides))
    below = Obstacle(scene, "below", TriangleMesh(np.array([0.1, 0.01, 0.002]) - cone, sides))
    bodies = [Cloth(scene, "cloth", cloth_grid((0.4, 0.2), (16, 8))), above, below]
    assert {overlap.bodies for overlap in start_state(bodies).overlaps} == {("cloth", "above"), ("cloth", "below")}
    separation = separate(bodies, gap=5e-4)
    assert separation.bent
    assert start_state(bodies).is_apart
    assert 2.5e-3 < separation.moved["cloth"] < 6e-3
    assert str(separation).startswith("moved and bent 'cloth' by up to")
    z = bodies[0].positions()[:, 2]
    assert z.min() < -1e-3 < 1e-3 < z.max()


def test_what_crosses_itself_is_refused() -> None:
    scene = Scene("fold", threads=1)
    cloth = Cloth(scene, "cloth", cloth_grid((1.0, 1.0), (4, 4)))
    positions = cloth.positions()
    positions[-1] = [-0.3, -0.3, -0.1]
    positions[-2] = [-0.31, -0.2, 0.1]
    cloth.position.update_value(positions)
    assert "'cloth' crosses itself" in str(start_state([cloth]))
    with pytest.raises(IntersectionError, match=r"nothing was moved: 'cloth' crosses itself, .* by hand"):
        separate([cloth], largest_share=1.0)


def test_a_body_wholly_inside_another_is_noticed() -> None:
    scene = Scene("inside", threads=1)
    bodies = [SoftBody(scene, "shell", BALL), AffineBody(scene, "core", sphere(0.02, 100))]
    with pytest.raises(IntersectionError, match=r"'core' lies wholly inside 'shell', 0\.0[78]\d* m deep"):
        Simulation(scene, bodies)
    with pytest.raises(IntersectionError, match=r"nothing was moved: 'core' lies wholly .* no small overlap"):
        separate(bodies)


def test_a_closed_surface_without_inside_may_be_a_room() -> None:
    scene = Scene("room", threads=1)
    room = Obstacle(scene, "room", TriangleMesh(CUBE.vertices * 4, CUBE.surface_triangles()))
    assert start_state([room, SoftBody(scene, "ball", BALL)]).is_apart


def test_too_large_an_overlap_leaves_everything_as_it_was() -> None:
    scene = Scene("large", threads=1)
    bodies = [SoftBody(scene, "low", CUBE), AffineBody(scene, "high", CUBE.translated((0.01, 0.0, 0.06)))]
    before = state_of(bodies)
    with pytest.raises(IntersectionError, match=r"nothing was moved: 'low' and 'high' overlap, 0\.04 m deep"):
        separate(bodies)
    # The way, too, is bounded: this gap is a fifth of the body.
    far = [AffineBody(scene, "a", CUBE.translated((1, 0, 0))), AffineBody(scene, "b", CUBE.translated((1, 0, 0.101)))]
    with pytest.raises(IntersectionError, match=r"'a' would have to go .* more than 0\.1 of its size"):
        separate(far, gap=0.05)
    assert all(np.array_equal(a, b) for a, b in zip(state_of(bodies), before, strict=True))


def test_the_simulation_can_be_made_after_separating() -> None:
    scene = Scene("again", threads=1)
    bodies = on_ground(scene)
    with pytest.raises(IntersectionError, match=r"'cube' and 'ground' overlap, 0\.005 m deep: 18 edges") as caught:
        Simulation(scene, bodies)
    assert "yasps.contact.separate(bodies)" in str(caught.value)
    assert "edge 0-1 of 'cube' and triangle 1 of 'ground'" in str(caught.value)
    separate(bodies)
    simulation = Simulation(scene, bodies)
    with pytest.raises(IntersectionError, match="'cube' and 'late' overlap"):
        simulation.add(AffineBody(scene, "late", CUBE.translated((0.03, 0.02, 0.145))))
    assert simulation.bodies == bodies


def test_a_half_space_is_left_too() -> None:
    scene = Scene("slope", threads=1)
    slope = HalfSpace(scene, "slope", normal=(0.0, -0.6, 0.8))
    bodies = [SoftBody(scene, "cube", CUBE.translated((0.0, 0.0, 0.0825)), radius=1e-3), slope]
    (overlap,) = start_state(bodies).overlaps
    assert overlap.bodies == ("cube", "slope")
    # The lowest edge of the cube is at n . x = 0.8 (0.0825 - 0.05) - 0.6 0.05 = -0.004, and 0.001 thick.
    assert overlap.depth == pytest.approx(0.005)
    with pytest.raises(IntersectionError, match=r"3 vertices are in the half-space or touch it, the deepest: vertex"):
        Simulation(scene, bodies)
    separate(bodies, gap=1e-3)
    assert (bodies[0].positions() @ slope.plane.normal).min() == pytest.approx(2e-3, rel=0.05)
    Simulation(scene, bodies, activation_distance=1e-3)


def test_bodies_thicker_than_their_distance_are_parted() -> None:
    scene = Scene("thick", threads=1)
    low = SoftBody(scene, "low", CUBE, radius=2e-3)
    cloth = Cloth(scene, "cloth", cloth_grid((0.2, 0.2), (7, 7), 0.054), radius=3e-3)
    (thick,) = start_state([low, cloth]).touching
    assert thick.bodies == ("low", "cloth")
    assert thick.distance == pytest.approx(0.004)
    assert thick.thickness == pytest.approx(0.005)
    with pytest.raises(
        IntersectionError, match=r"'low' and 'cloth' are too thick, 0\.004 m apart where their radii are "
    ):
        check_start([low, cloth])
    separate([low, cloth], gap=1e-3)
    assert start_state([low, cloth]).is_apart
    top = low.positions()[:, 2].max()
    over = np.abs(cloth.positions()[:, :2]).max(axis=1) < 0.05
    assert 0.0058 < cloth.positions()[over, 2].min() - top < 0.007


def test_a_thick_sheet_is_bent_between_what_can_not_move() -> None:
    """One block is too near from above, another from below, so no translation helps; radii count where it is bent."""
    scene = Scene("bent", threads=1)
    cloth = Cloth(scene, "cloth", cloth_grid((0.2, 0.2), (7, 7)), radius=3e-3)
    block = box((0.04, 0.04, 0.02), (1, 1, 1))
    placed = {"above": block.translated((-0.07, 0.0, 0.013)), "below": block.translated((0.07, 0.0, -0.013))}
    blocks = [
        Obstacle(scene, name, TriangleMesh(shape.vertices, shape.surface_triangles()), radius=2e-3)
        for name, shape in placed.items()
    ]
    assert {finding.bodies for finding in start_state([cloth, *blocks]).touching} == {
        ("cloth", "above"),
        ("cloth", "below"),
    }
    separation = separate([cloth, *blocks], gap=1e-3)
    assert separation.bent
    assert start_state([cloth, *blocks]).is_apart
    x = cloth.positions()
    for side in (-1.0, 1.0):
        near = (np.abs(x[:, 0] - side * 0.07) < 0.02) & (np.abs(x[:, 1]) < 0.02)
        np.testing.assert_allclose(side * x[near, 2], 0.003, atol=4e-4)  # 3 + 2 + 1 mm from what was 3 mm away


@pytest.mark.parametrize("other", ["half-space", "obstacle", "moving obstacle"])
def test_a_moving_obstacle_has_to_be_apart_from_all_that_stands_still(other: str) -> None:
    """It meets them while it moves; what never moves may overlap. The scene is as before after the error."""
    scene = Scene("sunk", threads=1)
    surface, shifted = (
        TriangleMesh(part.vertices, part.surface_triangles()) for part in (CUBE, CUBE.translated((0.03, 0.02, -0.07)))
    )
    body, plate = AffineBody(scene, "body", CUBE.translated((0, 0, 1.0))), MovingObstacle(scene, "plate", surface)
    ground: HalfSpace | Obstacle | MovingObstacle
    if other == "half-space":
        ground = HalfSpace(scene, "ground")
    else:
        ground = (Obstacle if other == "obstacle" else MovingObstacle)(scene, "ground", shifted)
    still = Obstacle(scene, "still", surface)
    assert start_state([body, still, *([] if other == "moving obstacle" else [ground])]).is_apart
    (overlap,) = start_state([body, plate, ground]).overlaps
    assert set(overlap.bodies) == {"plate", "ground"}
    with pytest.raises(IntersectionError, match="'plate' and 'ground' overlap"):
        Simulation(scene, [body, plate, ground])
    assert "time_step" not in scene
    table = ContactTable().set("plate", "ground", enabled=False)
    assert start_state([body, plate, ground], table).is_apart


def test_what_are_no_bodies_is_said() -> None:
    scene = Scene("none", threads=1)
    space = HalfSpace(scene, "space")
    for look in (start_state, separate):
        for bodies, words in (([], "no body with vertices"), ([space], "no body with vertices"), (space, "list of")):
            with pytest.raises(SceneError, match=words):
                look(bodies)  # type: ignore[operator]
        with pytest.raises(SceneError, match="a list of bodies"):
            look(["space"])  # type: ignore[operator]
        with pytest.raises(SceneError, match="the table is a ContactTable"):
            look([space], table={})  # type: ignore[operator]


def test_bodies_that_do_not_meet_may_overlap() -> None:
    scene = Scene("apart", threads=1)
    bodies = on_ground(scene)
    table = ContactTable().set("cube", "ground", enabled=False)
    assert start_state(bodies, table).is_apart
    before = state_of(bodies)
    assert separate(bodies, table=table).moved == {}
    assert all(np.array_equal(a, b) for a, b in zip(state_of(bodies), before, strict=True))


def test_touching_is_named_with_pieces_and_distance() -> None:
    scene = Scene("touching", threads=1)
    shift = 0.1 + 4e-17
    bodies = [AffineBody(scene, "low", CUBE.translated((0, 0, 0.3))), Obstacle(scene, "tip", _tip(0.25 - shift + 0.1))]
    (touching,) = start_state(bodies).touching
    assert touching.bodies == ("low", "tip")
    assert 0 < touching.distance < 1e-15
    assert "vertex 0 of 'tip'" in touching.where
    separate(bodies, gap=1e-3)
    assert start_state(bodies).is_apart


def _tip(height: float) -> TriangleMesh:
    """A triangle that stands on its head's opposite: one corner up."""
    return TriangleMesh(
        np.array([[0.01, 0.02, height], [0.05, 0.02, height - 0.1], [-0.05, 0.02, height - 0.1]]),
        np.array([[0, 1, 2]], np.int32),
    )


def test_flipped_elements_are_named_with_their_volumes(caplog: pytest.LogCaptureFixture) -> None:
    scene = Scene("flipped", threads=1)
    cube = SoftBody(scene, "cube", box((0.1, 0.1, 0.1), (1, 1, 1)))
    positions = cube.positions()
    positions[0] = -3 * positions[0]
    cube.position.update_value(positions)
    corners = positions[cube.cells["tetra"]]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6
    (flipped,) = start_state([cube]).flipped
    np.testing.assert_array_equal(flipped.elements, np.flatnonzero(volumes <= 0))
    np.testing.assert_allclose(flipped.sizes, volumes[volumes <= 0])
    positions = cube.rest.copy()
    positions[:, 2] *= -1
    cube.position.update_value(positions)
    with caplog.at_level(logging.WARNING, "yasps"):
        check_start([cube])
    assert "6 tetrahedra of 'cube' are flipped or flat: 0 (-0.000167 m^3)" in caplog.text


def test_triangles_without_area_are_named() -> None:
    scene = Scene("flat", threads=1)
    cloth = Cloth(scene, "cloth", cloth_grid((1.0, 1.0), (2, 2)))
    positions = cloth.positions()
    positions[cloth.triangles[0, 0]] = positions[cloth.triangles[0, 1]]
    cloth.position.update_value(positions)
    (flat,) = start_state([cloth]).flipped
    assert flat.kind == "triangles"
    assert 0 in flat.elements


def test_wrong_arguments_are_refused() -> None:
    scene = Scene("wrong", threads=1)
    ground = Ground(scene)
    with pytest.raises(SceneError, match="all bodies are fixed"):
        separate([ground])
    cube = SoftBody(scene, "cube", CUBE)
    with pytest.raises(SceneError, match="largest_share"):
        separate([cube, ground], largest_share=0.0)
    with pytest.raises(SceneError, match="gap"):
        separate([cube, ground], gap=-1.0)


def test_winding_numbers_and_nearest_points_of_a_ball() -> None:
    rng = np.random.default_rng(5)
    corners = BALL.vertices[BALL.surface_triangles()]
    points = rng.normal(size=(60, 3)) * 0.08
    inner = np.array([np.linalg.norm(p) for p in points]) < 0.09
    outer = np.linalg.norm(points, axis=1) > 0.101
    winding = winding_numbers(points, corners)
    np.testing.assert_allclose(winding[inner], 1.0, atol=1e-12)
    np.testing.assert_allclose(winding[outer], 0.0, atol=1e-12)
    distance, number, weights = closest_on_triangles(points, corners)
    places = np.einsum("kc,kcd->kd", weights, corners[number])
    np.testing.assert_allclose(np.linalg.norm(points - places, axis=1), distance)
    assert (weights >= 0).all()
    # No place of a fine sample of all triangles is nearer.
    shares = rng.dirichlet([1.0, 1.0, 1.0], size=40)
    sample = np.einsum("sc,mcd->smd", np.concatenate([shares, np.eye(3)]), corners).reshape(-1, 3)
    sampled = np.linalg.norm(points[:, None] - sample[None], axis=2).min(axis=1)
    assert (distance <= sampled + 1e-15).all()
    assert (sampled - distance < 0.01).all()


def test_rays_end_at_the_first_triangle() -> None:
    corners = CUBE.vertices[CUBE.surface_triangles()]
    points = np.array([[0.0, 0.0, 0.0], [0.01, -0.02, 0.03], [0.0, 0.0, -0.07], [0.2, 0.0, 0.0]])
    directions = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    expected = [[0.05, 0.05], [0.02, 0.04], [0.02, np.inf], [np.inf, np.inf]]
    np.testing.assert_allclose(ray_lengths(points, directions, corners), expected, atol=1e-15)


def test_the_shortest_exit_is_a_way_out_and_no_shorter_way_is() -> None:
    rng = np.random.default_rng(6)
    triangles = rng.normal(size=(200, 3, 3))
    place = np.einsum("kc,kcd->kd", rng.dirichlet([1.0, 1.0, 1.0], size=200), triangles)
    along = rng.normal(size=(200, 3))
    edges = np.stack([place - rng.uniform(0, 2, (200, 1)) * along, place + rng.uniform(0, 2, (200, 1)) * along], axis=1)
    length, direction = shortest_exits(edges, triangles)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1.0)
    highest = np.einsum("kcd,kd->kc", triangles, direction).max(axis=1)
    lowest = np.einsum("kcd,kd->kc", edges, direction).min(axis=1)
    np.testing.assert_allclose(highest - lowest, length, atol=1e-12)  # so far, and they lie on two sides of a plane
    for _ in range(200):  # a shorter translation in any direction leaves a crossing
        n = rng.normal(size=(200, 3))
        shift = 0.999 * length * (n / np.linalg.norm(n, axis=1, keepdims=True)).T
        assert _crosses(edges + shift.T[:, None], triangles).all()


def _crosses(edges: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Moller and Trumbore's test."""
    a, u, v = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    d, s = edges[:, 1] - edges[:, 0], edges[:, 0] - a
    p, q = np.cross(d, v), np.cross(s, u)
    det = (u * p).sum(axis=1)
    x, y, t = ((s * p).sum(axis=1) / det, (d * q).sum(axis=1) / det, (v * q).sum(axis=1) / det)
    e = 1e-9
    return np.asarray((x >= -e) & (y >= -e) & (x + y <= 1 + e) & (t >= -e) & (t <= 1 + e))
