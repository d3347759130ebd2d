"""Rigid bodies keep their shape through many turns; caged ones have the energy and the mass of their contents."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from yasps import Scene, SceneError, materials
from yasps.bodies import CagedBody, HalfSpace, RigidBody
from yasps.meshes import box, sphere
from yasps.parameterisations import rotation_matrix
from yasps.simulation import Simulation
from yasps.stepping import BDF2, NewtonSettings

TIGHT = NewtonSettings(velocity_tolerance=1e-8, solver="direct", projection="on-demand")
BLOCK = box((0.3, 0.2, 0.1), (1, 1, 1))


def test_rotation_matrices() -> None:
    directions = np.random.default_rng(2).standard_normal((6, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    vectors = np.concatenate([np.zeros((1, 3)), *(angle * directions for angle in (1e-9, 1e-3, 1.0, 3.1, 6.0))])
    turns = Scene("turns", threads=1).add_mesh("m").add_primitive("turns", len(vectors))
    vector = turns.add_attribute("vector", 3, 1, value=vectors)
    found = turns.add_attribute("matrix", computed_attribute=rotation_matrix(vector)).compute().array
    np.testing.assert_allclose(found, Rotation.from_rotvec(vectors).as_matrix(), atol=4e-15)


def spinning(integrator: object = BDF2) -> tuple[Simulation, RigidBody]:
    scene = Scene("spin", threads=1)
    body = RigidBody(scene, "block", BLOCK.translated((0.5, 0.0, 0.0)))
    simulation = Simulation(
        scene,
        [body],
        time_step=0.01,
        gravity=(0.0, 0.0, 0.0),
        contact=False,
        integrator=integrator,  # type: ignore[arg-type]
        settings=TIGHT,
    )
    simulation.set_velocity(body, (0.1, 0.2, -0.3), angular=(0.0, 0.0, 9.0))
    return simulation, body


def heading(body: RigidBody) -> float:
    """Angle of the block's long side in the plane in which it turns."""
    x = body.positions()
    side = x[BLOCK.vertices[:, 0] > 0].mean(axis=0) - x[BLOCK.vertices[:, 0] < 0].mean(axis=0)
    return float(np.arctan2(side[1], side[0]))


def test_a_block_turns_many_times_and_stays_rigid() -> None:
    simulation, body = spinning()
    distances, momentum = pdist(body.rest), simulation.stepper.momentum()
    angles, largest, is_bdf2 = [], 0.0, []
    for _ in range(160):  # twice around
        simulation.step()
        angles.append(heading(body))
        largest = max(largest, float(np.linalg.norm(body.rotation_vector.value)))
        is_bdf2.append(simulation.effective_step.value[0] < 0.007)
    np.testing.assert_allclose(pdist(body.positions()), distances, rtol=1e-13)
    np.testing.assert_allclose(simulation.stepper.momentum(), momentum, atol=1e-10 * np.linalg.norm(momentum))
    assert largest < 0.1  # it is put into the base rotation in every step
    assert is_bdf2 == [False] + [True] * 159  # which moves nothing
    turned = np.unwrap(angles)[-1]
    assert turned == pytest.approx(9.0 * 1.6, rel=0.05)
    assert turned > 4 * np.pi


def test_putting_the_vector_into_the_base_rotation_moves_nothing() -> None:
    simulation, body = spinning()
    simulation.run(3)
    before = body.positions()
    assert body.rotation_vector.value.any()
    body.start_step()
    assert not body.rotation_vector.value.any()
    np.testing.assert_allclose(body.positions(), before, atol=1e-15)


def test_a_state_has_the_base_rotation(tmp_path: Path) -> None:
    first, body = spinning()
    first.run(5)
    first.save(tmp_path / "state.npz")
    first.run(3)
    second, other = spinning()
    second.restore(tmp_path / "state.npz")
    second.run(3)
    np.testing.assert_array_equal(other.positions(), body.positions())


@pytest.mark.nightly
def test_a_rigid_block_rests_on_a_plane_and_bears_its_weight() -> None:
    scene = Scene("rest", threads=1)
    body = RigidBody(scene, "block", BLOCK.rotated((1.0, 0.3, 0.0), 0.2).translated((0.0, 0.0, 0.12)))
    simulation = Simulation(scene, [body, HalfSpace(scene)], time_step=0.01)
    simulation.run(150)
    weight = 9.8 * float(body.mass.value.sum())
    forces = simulation.contact_forces()
    assert forces.on_bodies("normal")[0, 2] == pytest.approx(weight, rel=1e-2)
    assert np.ptp(body.positions()[body.positions()[:, 2] < 0.05][:, 2]) < 1e-4


# -- caged bodies ------------------------------------------------------------------------------------------


def energy_density(f: NDArray[np.float64], mu: float, lam: float) -> float:
    """Of stable Neo-Hookean (Smith, de Goes and Kim 2018)."""
    ic, j = (f * f).sum(), np.linalg.det(f)
    return float(0.5 * mu * (ic - 3 - np.log(ic + 1)) + 0.5 * lam * (j - 1 - 0.75 * mu / lam) ** 2)


@pytest.mark.parametrize(("element", "points"), [("hexahedron", 8), ("tetra", 6)])
def test_a_cage_that_is_full_has_the_energy_and_the_mass_of_the_body(element: str, points: int) -> None:
    scene = Scene("full", threads=1)
    shape = box((0.2, 0.1, 0.1), (4, 2, 2))
    body = CagedBody(scene, "block", shape, divisions=2, element=element, youngs_modulus=1e5)
    assert len(body.cage.cells) == 2
    assert body.gauss_points.num_instances == 2 * points
    np.testing.assert_allclose(body.positions(), body.rest, atol=1e-15)
    f = np.eye(3) + 0.2 * np.random.default_rng(3).standard_normal((3, 3))
    corners = body.targets[0]
    corners.update_value(body.cage.vertices @ f.T)
    np.testing.assert_allclose(body.positions(), body.rest @ f.T, atol=1e-15)
    mu, lam = materials.stable_neo_hookean_parameters(1e5, 0.4)
    elastic = scene.energy_values()["block.gauss_points.elastic"].sum()
    assert elastic == pytest.approx(0.2 * 0.1 * 0.1 * energy_density(f, mu, lam), rel=1e-12)


def test_tetrahedra_of_a_cage_fill_its_cells() -> None:
    """Each of six in a cell with a cut through the body has the same share of the cell's contents, as in a box."""
    hexahedra, tets = (
        CagedBody(Scene(kind, threads=1), "ball", sphere(0.1, 300), divisions=4, element=kind)
        for kind in ("hexahedron", "tetra")
    )
    contents = hexahedra.gauss_points["volume"].value.reshape(-1, 8).sum(axis=1)
    in_tets = tets.gauss_points["volume"].value.reshape(-1, 6)
    np.testing.assert_allclose(in_tets, np.repeat(contents[:, None] / 6, 6, axis=1), rtol=1e-12)
    nodes = tets.gauss_points["positions"].compute().array.reshape(-1, 6, 4, 3)
    volumes = np.linalg.det(nodes[:, :, 1:] - nodes[:, :, :1]) / 6
    np.testing.assert_allclose(volumes, 0.05**3 / 6, rtol=1e-9)
    cells = hexahedra.cage.vertices[hexahedra.cage.cells]
    np.testing.assert_allclose(nodes.min(axis=(1, 2)), cells.min(axis=1), atol=1e-15)
    np.testing.assert_allclose(nodes.max(axis=(1, 2)), cells.max(axis=1), atol=1e-15)


def test_a_caged_ball_keeps_its_momentum_and_every_corner_is_held() -> None:
    scene = Scene("ball", threads=1)
    body = CagedBody(scene, "ball", sphere(0.1, 300), divisions=3)
    filled = body.gauss_points["volume"].value.reshape(-1, 8).sum(axis=1)
    assert filled.sum() == pytest.approx(np.pi * 4 / 3 * 0.1**3, rel=0.1)
    assert filled.min() > 0
    simulation = Simulation(scene, [body], gravity=(0.0, 0.0, 0.0), contact=False, settings=TIGHT)
    simulation.set_velocity(body, (0.1, 0.0, 0.2), angular=(3.0, 1.0, 0.0))
    momentum = simulation.stepper.momentum()
    for _ in range(5):
        simulation.step()
    np.testing.assert_allclose(simulation.stepper.momentum(), momentum, atol=1e-9 * np.linalg.norm(momentum))


def test_numbers_that_cannot_be_leave_nothing_behind() -> None:
    scene = Scene("wrong", threads=1)
    with pytest.raises(SceneError, match="density must be positive"):
        RigidBody(scene, "a", BLOCK, density=0.0)
    with pytest.raises(SceneError, match="Poisson"):
        CagedBody(scene, "a", BLOCK, poisson_ratio=0.5)
    with pytest.raises(SceneError, match="element is one of 'hexahedron', 'tetra', got 'hex8'"):
        CagedBody(scene, "a", BLOCK, element="hex8")
    with pytest.raises(SceneError, match="youngs_modulus must be positive"):
        RigidBody(scene, "a", BLOCK, youngs_modulus=-1.0)
    RigidBody(scene, "a", BLOCK)
