"""The first end-to-end scene: free fall, contact without intersection, derivatives, files."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import h5py
import numpy as np
import pytest

from yasps import Scene
from yasps.backend.reference.interpreter import Interpreter, SceneData
from yasps.examples import two_bunnies as example
from yasps.meshes import TetrahedralMesh, rabbit, write_mesh

STEP = 0.01


@pytest.fixture(scope="module")
def shape() -> TetrahedralMesh:
    return rabbit(1500)


def relative(difference: np.ndarray, reference: np.ndarray) -> float:
    return float(np.abs(difference).max() / np.abs(reference).max())


def shifted(data: SceneData, targets: list[str], direction: np.ndarray, step: complex) -> SceneData:
    """The data with all targets moved along a direction."""
    storages = dict(data.storages)
    start = 0
    for name in targets:
        array = storages[name]
        part = direction[start : start + array.size].reshape(array.shape)
        storages[name] = array + step * part
        start += array.size
    return dataclasses.replace(data, storages=storages)


def test_free_fall_then_contact_without_intersection(shape: TetrahedralMesh) -> None:
    simulation = example.two_bunnies(shape, Scene("two_bunnies"))
    contact = simulation.contact
    assert contact is not None
    start = contact.positions()
    bodies = slice(0, sum(len(body.rest) for body in simulation.moving))
    energy = simulation.energy()
    in_flight, touched = True, 0
    for step in range(1, 12):
        simulation.step()
        positions = contact.positions()
        assert not contact.geometry.has_intersections(positions)
        in_flight = in_flight and len(contact.active) == 0
        if in_flight:  # backward Euler's own free fall
            fall = 9.8 * STEP**2 * step * (step + 1) / 2
            expected = start[bodies] - np.array([0.0, 0.0, fall])
            assert np.abs(positions[bodies] - expected).max() <= 1e-6 * fall
        else:
            touched += 1
        now = simulation.energy()
        assert now < energy
        energy = now
    assert touched >= 4
    np.testing.assert_array_equal(positions[bodies.stop :], start[bodies.stop :])  # the ground stays


def test_derivatives_of_the_whole_scene_against_complex_step(shape: TetrahedralMesh) -> None:
    scene = example.two_bunnies(shape, Scene("two_bunnies"))
    assert scene.contact is not None
    for _ in range(8):
        scene.step()
    assert len(scene.contact.active) > 20
    compiled = scene.scene.compile()
    rng = np.random.default_rng(0)
    for (
        target
    ) in scene.scene.minimize_targets:  # at equilibrium the gradient would be what rounding leaves of large terms
        target.update_value(target.value + 1e-5 * rng.standard_normal(target.value.shape))
    scene.contact.update()
    assert len(scene.contact.active) > 20
    data = compiled.data()
    targets = [compiled.emitter.symbol_of(target) for target in compiled.targets]
    unknowns = sum(data.storages[name].size for name in targets)
    gradient = compiled.assemble(project=False)
    hessian = compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()
    reference = Interpreter(compiled.module, data)
    expected_gradient, expected_hessian = reference.assemble()
    assert relative(gradient - expected_gradient, expected_gradient) <= 1e-10
    for _ in range(3):
        direction = rng.standard_normal(unknowns)
        terms = np.abs(gradient) @ np.abs(direction)
        moved = Interpreter(compiled.module, shifted(data, targets, direction, 1e-30j))
        assert abs(moved.total_energy().imag / 1e-30 - gradient @ direction) <= 1e-10 * terms
        product = moved.gradient().imag / 1e-30
        assert relative(hessian @ direction - product, product) <= 1e-10
    compiled.assemble()
    projected = compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()
    assert relative((projected - expected_hessian).toarray(), expected_hessian.toarray()) <= 1e-10


def test_runs_from_a_mesh_file_and_writes_a_series(shape: TetrahedralMesh, tmp_path: Path) -> None:
    path = tmp_path / "rabbit.vtu"
    write_mesh(path, shape)
    arguments = [
        "--frames",
        "2",
        "--mesh",
        str(path),
        "--headless",
        "--friction",
        "0",
        "--output",
        str(tmp_path / "out"),
    ]
    assert example.main(arguments) == 0
    with h5py.File(tmp_path / "out" / "two_bunnies.vtkhdf") as file:
        assert file["VTKHDF/Steps"].attrs["NSteps"] == 3


def test_second_start_compiles_nothing(shape: TetrahedralMesh) -> None:
    example.two_bunnies(shape, Scene("two_bunnies")).scene.compile()
    again = example.two_bunnies(shape, Scene("two_bunnies"))
    assert again.scene.compile_report.compiled == 0
    assert "0 modules compiled" in str(again.scene.compile_report)
