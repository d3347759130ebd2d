"""A cloth that gets another mesh while it lies on a ball: what is carried over, what is conserved, what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

from yasps import ConnectivityError, DataError, IntersectionError, Scene, SceneError, ShapeMismatchError
from yasps.bodies import Cloth, Obstacle
from yasps.contact import ContactTable
from yasps.frontend.execution.scene_source import CompileRequest, watching_compiles
from yasps.meshes import MeshError, TriangleMesh, cloth_grid, edges_of, sphere, split_edges
from yasps.simulation import Simulation
from yasps.simulation.state_files import write_arrays
from yasps.stepping import BACKWARD_EULER, BDF2, DrivenVertices, Integrator

Floats = NDArray[np.float64]
BALL = sphere(0.1, 100)


def draped(
    shape: TriangleMesh | None = None, *, integrator: Integrator = BDF2, refinable: bool = True, **options: Any
) -> tuple[Simulation, Cloth]:
    """A cloth above a ball, which it touches after some steps."""
    scene = Scene("draped", threads=1, deterministic=True)
    shape = cloth_grid((0.3, 0.3), (4, 4), z=0.106) if shape is None else shape
    cloth = Cloth(scene, "cloth", shape, bending=1e-4, refinable=refinable, **options)
    ball = Obstacle(scene, "ball", TriangleMesh(BALL.vertices, BALL.surface_triangles()))
    # Of a stiffness of its own, since the contact modulus of a cloth is that of the mesh it was made with.
    table = ContactTable(0.3, stiffness=3e3).set("cloth", "ball", stiffness=2e3)
    return Simulation(
        scene, [cloth, ball], activation_distance=5e-3, contacts=table, integrator=integrator, rescue=0
    ), cloth


def finer(cloth: Cloth, every: int = 3) -> tuple[TriangleMesh, sparse.csr_array[np.float64]]:
    """Every third edge is cut."""
    shape = TriangleMesh(cloth.rest, cloth.triangles)
    return split_edges(shape, np.arange(len(edges_of(cloth.triangles)[0])) % every == 0)


def refuse(request: CompileRequest) -> None:
    raise AssertionError(f"compiled: {[term.attribute.path for term in request.energies]}, {request.outputs}")


def steps(simulation: Simulation, count: int) -> None:
    for _ in range(count):
        simulation.step()
        simulation.check_intersection_free()


@pytest.fixture(scope="module")
def touching() -> tuple[Simulation, Cloth, dict[str, Floats]]:
    """In contact and moving, with what brings it back there."""
    simulation, cloth = draped()
    steps(simulation, 6)
    assert simulation.contact is not None
    assert len(simulation.contact.active) > 5
    simulation.report()
    return simulation, cloth, simulation.state()


def test_a_cloth_goes_on_with_another_mesh_and_compiles_nothing() -> None:
    simulation, cloth = draped()
    steps(simulation, 6)
    simulation.report()
    for _ in range(2):
        shape, weights = finer(cloth)
        x, v = cloth.positions(), simulation.velocity_of(cloth)
        with watching_compiles(refuse):
            report = simulation.remesh(cloth, shape, weights)
            np.testing.assert_array_equal(cloth.positions(), weights @ x)
            np.testing.assert_array_equal(simulation.velocity_of(cloth), weights @ v)
            steps(simulation, 1)
            # BDF2 goes on from the step before, and so does friction.
            dt = float(simulation.time_step.value[0])
            assert simulation.effective_step.value[0] == BDF2.share * dt
            steps(simulation, 1)
        assert report.after.mass == pytest.approx(report.before.mass, rel=1e-14)
        np.testing.assert_allclose(report.after.momentum, report.before.momentum, rtol=1e-12, atol=1e-14)
        assert report.after.kinetic < report.before.kinetic
        assert report.after.energies["gravity"] == pytest.approx(report.before.energies["gravity"], rel=1e-12)
    assert len(cloth.rest) > 60


def test_the_simulation_is_then_one_of_the_new_mesh(touching: tuple[Simulation, Cloth, dict[str, Floats]]) -> None:
    """Made anew of that mesh, with its positions and velocities: the same pairs, energies and forces, to rounding."""
    simulation, cloth = draped(integrator=BACKWARD_EULER)
    steps(simulation, 6)
    shape, weights = finer(cloth)
    report = simulation.remesh(cloth, shape, weights)
    other, fresh = draped(shape, integrator=BACKWARD_EULER)
    # Not on its way, which the ball may be in.
    fresh.position.update_value(cloth.positions())
    assert simulation.contact is not None
    assert other.contact is not None
    other.contact.reset()
    other.contact.lag()
    other.set_velocity(fresh, simulation.velocity_of(cloth))
    for kind, pairs in simulation.contact.active.kinds().items():
        assert pairs.same_as(other.contact.active.kinds()[kind])
    np.testing.assert_array_equal(simulation.contact.laws.class_of, other.contact.laws.class_of)
    np.testing.assert_array_equal(simulation.contact.laws.stiffness, other.contact.laws.stiffness)
    ours, theirs = simulation.scene.energy_values(), other.scene.energy_values()
    for path, values in theirs.items():
        if not path.endswith((".inertia", ".potential")):  # which a step sets
            np.testing.assert_allclose(ours[path], values, rtol=1e-9, atol=1e-18)
    np.testing.assert_array_equal(cloth.mass.value, fresh.mass.value)
    assert report.after.momentum == pytest.approx(other.stepper.momentum(), rel=1e-14)
    membrane = "cloth.triangles.membrane"
    assert ours[membrane].sum() == pytest.approx(report.before.energies["elastic"], rel=0.5)
    steps(simulation, 1)
    steps(other, 1)
    np.testing.assert_allclose(cloth.positions(), fresh.positions(), atol=1e-6)


def test_stretch_stays_where_triangles_are_cut() -> None:
    """Linear elements that are cut have the same strain; nothing is bent, so that no energy jumps."""
    scene = Scene("flat", threads=1)
    cloth = Cloth(scene, "cloth", cloth_grid((1.0, 1.0), (3, 3)), compression=0.5, refinable=True)
    simulation = Simulation(scene, [cloth], contact=False, gravity=(0, 0, 0))
    cloth.position.update_value(cloth.rest * [1.1, 0.95, 1.0] + 0.02 * np.sin(9 * cloth.rest[:, [1, 0, 2]]))
    simulation.set_velocity(cloth, cloth.rest[:, [1, 2, 0]])
    report = simulation.remesh(cloth, *finer(cloth))
    assert report.before.energies["elastic"] > 1.0
    assert report.after.energies["elastic"] == pytest.approx(report.before.energies["elastic"], rel=1e-13)
    np.testing.assert_allclose(report.after.momentum, report.before.momentum, atol=1e-16)
    simulation.step()


def everything(simulation: Simulation) -> dict[str, Floats]:
    return {path: value.copy() for path, value in simulation.scene.numbers().items()} | simulation.state()


def test_what_is_refused_changes_nothing(touching: tuple[Simulation, Cloth, dict[str, Floats]]) -> None:
    simulation, cloth, _ = touching
    shape, weights = finer(cloth)
    before, rest = everything(simulation), cloth.rest
    into = np.asarray(weights @ cloth.positions()) - [0, 0, 0.05]
    wrong = weights.toarray()
    wrong[7, 0] += 0.1
    for arguments, error, match in (
        ({"positions": into}, IntersectionError, "cloth"),
        ({"positions": into[:5]}, ShapeMismatchError, "positions of cloth are"),
        ({"velocities": [0, 0, 0]}, ShapeMismatchError, "velocities of cloth are"),
        ({"velocities": np.full(into.shape, np.nan)}, DataError, "finite"),
        ({"weights": weights[:5]}, ShapeMismatchError, "new and old vertices"),
        ({"weights": wrong}, DataError, r"to 1\.1 for vertex 7"),
        ({"shape": BALL}, MeshError, "TriangleMesh"),
        ({"shape": TriangleMesh(shape.vertices, shape.triangles[:1])}, SceneError, "without hinges"),
    ):
        given = {"shape": shape, "weights": weights} | arguments
        with pytest.raises(error, match=match):
            simulation.remesh(cloth, **given)
        assert cloth.rest is rest
        after = everything(simulation)
        assert before.keys() == after.keys()
        for name, value in before.items():
            np.testing.assert_array_equal(after[name], value, err_msg=name)
    with pytest.raises(SceneError, match="only the mesh of a Cloth"):
        simulation.remesh(simulation.bodies[1], shape, weights)


def test_after_a_refused_mesh_the_next_step_is_the_same(touching: tuple[Simulation, Cloth, dict[str, Floats]]) -> None:
    simulation, cloth, state = touching
    ends = []
    for refused in (False, True):
        simulation._set_state(state)
        if refused:
            shape, weights = finer(cloth)
            with pytest.raises(IntersectionError):
                simulation.remesh(cloth, shape, weights, positions=weights @ cloth.positions() - [0, 0, 0.05])
        simulation.step()
        ends.append(cloth.positions())
    np.testing.assert_array_equal(*ends)


def test_pins_follow_and_what_a_user_added_is_asked_for() -> None:
    simulation, cloth = draped(integrator=BACKWARD_EULER)
    corners = [0, 4, 20]
    pins = simulation.pin(cloth, corners)
    assert isinstance(pins, DrivenVertices)
    simulation.add_force(cloth, lambda x, v, t: 0.01 * x, "draught")
    steps(simulation, 2)
    shape, weights = finer(cloth)
    order = np.random.default_rng(1).permutation(len(shape.vertices))
    shape = TriangleMesh(shape.vertices[order], np.argsort(order)[shape.triangles].astype(np.int32))
    places = cloth.positions()[corners]
    simulation.remesh(cloth, shape, weights[order])
    np.testing.assert_array_equal(pins.vertices, [np.flatnonzero(order == corner)[0] for corner in corners])
    np.testing.assert_array_equal(cloth.vertices["draught"].value.reshape(-1, 3), 0.01 * cloth.positions())
    steps(simulation, 2)
    np.testing.assert_array_equal(cloth.positions()[pins.vertices], places)

    gone = np.ones(len(cloth.rest), np.bool_)
    gone[pins.vertices[0]] = False
    fewer = sparse.eye_array(len(cloth.rest), format="csr")[gone]
    with pytest.raises(SceneError, match="pinned vertex of cloth"):
        simulation.remesh(cloth, TriangleMesh(cloth.rest[gone], np.array([[0, 1, 2], [2, 1, 3]], np.int32)), fewer)
    heat = cloth.vertices.add_constant("heat", 1, 1)
    shape, weights = finer(cloth)
    with pytest.raises(DataError, match=r"cloth\.vertices\.heat"):
        simulation.remesh(cloth, shape, weights)
    simulation.remesh(cloth, shape, weights, parts={heat: np.ones(len(shape.vertices))})
    steps(simulation, 1)


@pytest.mark.nightly  # two more unions are compiled
def test_bodies_that_came_and_went() -> None:
    """What former contacts left behind in the scene follows, too."""
    simulation, cloth = draped(integrator=BACKWARD_EULER)
    small = Cloth(simulation.scene, "small", cloth_grid((0.1, 0.1), (1, 1), z=0.3), refinable=True)
    simulation.add(small)
    steps(simulation, 5)
    simulation.remesh(small, *finer(small))
    simulation.remesh(cloth, *finer(cloth))
    steps(simulation, 1)
    simulation.remove(small)
    simulation.remesh(cloth, *finer(cloth, 9))
    steps(simulation, 1)
    with pytest.raises(SceneError, match="not in this simulation"):
        simulation.remesh(small, *finer(small))


def test_sizes_that_others_changed_are_noticed() -> None:
    """By the stepper, whose velocities are no longer those of the vertices; contact itself asks for its share."""
    simulation, cloth = draped(integrator=BACKWARD_EULER)
    shape, weights = finer(cloth)
    counts, parts = cloth.resized(shape)
    x = weights @ cloth.positions()
    own = {cloth.position: x, cloth.vertices["predicted"]: x}
    with pytest.raises(ConnectivityError, match=r"everything\.surface_points\.vertex leads to"):
        simulation.scene.resize(counts, parts | own)
    scene = Scene("alone", threads=1)
    alone = Cloth(scene, "cloth", cloth_grid((1.0, 1.0), (3, 3)))
    free = Simulation(scene, [alone], contact=False)
    shape, weights = finer(alone)
    counts, parts = alone.resized(shape)
    scene.resize(counts, parts | {alone.position: shape.vertices, alone.vertices["predicted"]: shape.vertices})
    with pytest.raises(SceneError, match=r"cloth\.vertices\.position has .* Simulation\.remesh"):
        free.step()


def test_a_state_has_its_mesh(tmp_path: Path) -> None:
    """It is restored in a simulation of any other mesh of the same cloth: to the last bit, with pins."""
    simulation, cloth = draped()
    pins = simulation.pin(cloth, [4, 20])
    steps(simulation, 3)
    simulation.save(tmp_path / "coarse.npz")
    coarse, ends = cloth.rest, []

    def goes_on(count: int) -> None:
        steps(simulation, count)
        ends.append((cloth.positions(), cloth.triangles))

    shape, weights = finer(cloth)
    order = np.roll(np.arange(len(shape.vertices)), 7)
    shape = TriangleMesh(shape.vertices[order], np.argsort(order)[shape.triangles].astype(np.int32))
    for _ in range(2):
        simulation.remesh(cloth, shape, weights[order])
        steps(simulation, 1)
        simulation.save(tmp_path / "fine.npz")
        goes_on(2)
        simulation.restore(tmp_path / "coarse.npz")
        np.testing.assert_array_equal(cloth.rest, coarse)
        np.testing.assert_array_equal(pins.vertices, [4, 20])
    simulation.restore(tmp_path / "fine.npz")
    goes_on(2)
    simulation, cloth = draped()
    simulation.pin(cloth, [4, 20])
    simulation.restore(tmp_path / "fine.npz")
    goes_on(2)
    for positions, triangles in ends[1:]:
        np.testing.assert_array_equal(triangles, ends[0][1])
        np.testing.assert_array_equal(positions, ends[0][0])

    arrays = dict(np.load(tmp_path / "coarse.npz"))
    simulation.save(tmp_path / "before.npz")
    before = everything(simulation)
    for name, wrong in (("velocity/cloth", np.zeros((3, 3))), ("target/cloth.vertices.position", np.zeros(75))):
        write_arrays(tmp_path / "wrong.npz", arrays | {f"state/{name}": wrong})
        with pytest.raises((SceneError, IntersectionError)):
            simulation.restore(tmp_path / "wrong.npz")
        after = everything(simulation)
        assert simulation.contact is not None
        for path in before.keys() - set(simulation.contact.paths_of_pairs()):  # which every step sets
            np.testing.assert_array_equal(after[path], before[path], err_msg=path)
    goes_on(1)
    simulation.restore(tmp_path / "before.npz")
    goes_on(1)
    np.testing.assert_array_equal(ends[-1][0], ends[-2][0])
