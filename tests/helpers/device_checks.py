"""What a scene must give on a device: what it gives on the CPU.

`tests/gpu` runs these on a GPU where there is one, and always on a device that the host plays: so the checks are known
to work before they meet a GPU.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from layered_scenes import lever_scene, ring_scene
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from small_scenes import PAIRS, mixed_union, shared_targets, soft_tets

from yasps import ConnectivityError, DeviceMemoryError, Scene, Solution, materials
from yasps.examples.two_bunnies import two_bunnies
from yasps.meshes import box
from yasps.runtime.device.protocol import Device, DeviceArray
from yasps.simulation import Simulation
from yasps.stepping import MovingPart, NewtonSettings, TimeStepper

AGREEMENT = 1e-10
"""Relative, of the largest number of each array."""
# So small that solutions and trajectories agree as well as AGREEMENT asks for.
LINEAR_TOLERANCE = 1e-26
TIGHT = NewtonSettings(velocity_tolerance=1e-9, linear_tolerance=1e-24)
TIME_STEP = 0.01  # s
TOO_MANY = 1 << 37
"""Numbers that no device has room for: a terabyte."""

OpenDevice = Callable[[], Device]
MakeScene = Callable[[], Scene]
Array = NDArray[np.float64]


def on_device(scene: Scene, device: Device, *, deterministic: bool = False) -> Scene:
    """The scene, of which nothing was compiled yet, on this device."""
    assert scene._compiled is None
    scene._device_name, scene._deterministic = device, deterministic
    return scene


# -- scenes ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Block:
    """A soft cube in motion."""

    scene: Scene
    stepper: TimeStepper


def block(divisions: int) -> Block:
    """Stable Neo-Hookean tets, bent from their shape at rest, and inertia."""
    shape = box((0.2, 0.2, 0.2), (divisions, divisions, divisions))
    scene = Scene("block")
    mesh = scene.add_mesh("cube")
    vertices, tets = mesh.add_primitive("vertices", len(shape.vertices)), mesh.add_primitive("tets", len(shape.tets))
    bent = shape.vertices + 0.01 * np.sin(20.0 * shape.vertices[:, [1, 2, 0]])
    position = vertices.add_attribute("position", 3, 1, value=bent)
    mass = vertices.add_constant("mass", 1, 1, value=shape.vertex_masses(1000.0))
    predicted = vertices.add_constant("predicted", 3, 1, value=bent)
    inertia = materials.inertia(position, predicted, mass, TIME_STEP)
    scene.add_energy(vertices.add_attribute("inertia", computed_attribute=inertia))
    corners = tets.add_connectivity("corners", vertices, shape.tets, 4)
    x = tets.add_attribute("positions", through=corners, source=position)
    inverse, volume = materials.rest_shape(shape.vertices, shape.tets)
    f = materials.deformation_gradient(x, tets.add_constant("inverse", 3, 3, value=inverse))
    mu, lam = materials.stable_neo_hookean_parameters(1e4, 0.4)
    elastic = materials.stable_neo_hookean(f, mu, lam, tets.add_constant("volume", 1, 1, value=volume))
    scene.add_energy(tets.add_attribute("elastic", computed_attribute=elastic))
    scene.add_minimize_target(position)
    return Block(scene, TimeStepper(scene, [MovingPart(position, predicted, mass)], TIME_STEP, settings=TIGHT))


SCENES: dict[str, MakeScene] = {
    "soft_tets": soft_tets,
    "soft_tets, abs": partial(soft_tets, "abs"),
    "mixed_union": mixed_union,
    "mixed_union, no projection": partial(mixed_union, "none"),
    "no pairs": partial(mixed_union, pairs=[]),
    "shared_targets": shared_targets,
    "levers": partial(lever_scene, "clamp", False),
    "levers of levers": partial(lever_scene, "abs", True),
    "rings, sum": partial(ring_scene, "sum", False, "clamp"),
    "rings, mean": partial(ring_scene, "mean", True, "abs"),
}


# -- checks ------------------------------------------------------------------------------------------------


def check_agreement(make: MakeScene, device: Device, *, deterministic: bool = False) -> None:
    """Values, gradient, Hessian projected and exact, and the solution of the Newton system."""
    cpu, other = make(), on_device(make(), device, deterministic=deterministic)
    for name, values in cpu.energy_values().items():
        _check_close(f"the values of {name}", other.energy_values()[name], values)
    _check_close("the energy", np.array([other.total_energy()]), np.array([cpu.total_energy()]))
    _check_close("the gradient", np.concatenate(other.gradient()), np.concatenate(cpu.gradient()))
    for projected in (True, False):
        theirs, ours = (scene.hessian(projected=projected).to_scipy() for scene in (other, cpu))
        difference = abs(theirs - ours)
        assert difference.max() <= AGREEMENT * abs(ours).max(), f"the Hessian, projected: {projected}"
    # With what both have: sweeps find another step where the matrix is not positive definite.
    theirs, ours = (scene.solve(LINEAR_TOLERANCE, preconditioner="jacobi") for scene in (other, cpu))
    _check_solutions(theirs, ours)


def _check_solutions(theirs: Solution, ours: Solution) -> None:
    assert theirs.report.reason is ours.report.reason, f"{theirs.report}; on the CPU: {ours.report}"
    if ours.report.converged:  # what is not positive definite has no solution to compare
        _check_close("the solution", np.concatenate(theirs.directions), np.concatenate(ours.directions))


def check_every_run_is_the_same(make: MakeScene, open_device: OpenDevice) -> None:
    """Deterministic scenes: the same bits again, in a second run of one scene and in another scene."""
    scenes = [on_device(make(), open_device(), deterministic=True) for _ in range(2)]
    runs = [_bits(scene) for scene in (*scenes, scenes[0])]
    for run in runs[1:]:
        for first, again in zip(runs[0], run, strict=True):
            assert first.tobytes() == again.tobytes()


def check_two_levels(make: MakeScene, device: Device) -> None:
    """The coarse space gives the solution that it gives on the CPU."""
    cpu, other = make(), on_device(make(), device)
    theirs, ours = (scene.solve(LINEAR_TOLERANCE, preconditioner="two-level") for scene in (other, cpu))
    assert theirs.report.two_level
    assert ours.report.two_level
    _check_solutions(theirs, ours)


def _bits(scene: Scene) -> list[Array]:
    solution = scene.solve(LINEAR_TOLERANCE, 50)
    hessian = scene.hessian().to_scipy()
    return [*scene.gradient(), hessian.data, *solution.directions, np.array([scene.total_energy()])]


def check_steps(cells: int, device: Device, steps: int = 3) -> None:
    """Time steps of a soft cube end where they end on the CPU."""
    ours, theirs = block(cells), block(cells)
    on_device(theirs.scene, device)
    start = ours.scene.minimize_targets[0].value.copy()
    for _ in range(steps):
        for one in (ours, theirs):
            one.stepper.step()
        positions = ours.scene.minimize_targets[0].value
        _check_close("positions", theirs.scene.minimize_targets[0].value, positions)
    assert np.abs(positions - start).max() > 1e-4  # or nothing would have been shown


def _contact_positions(simulation: Simulation) -> np.ndarray:
    assert simulation.contact is not None
    return simulation.contact.positions()


def check_two_bunnies(device: Device, steps: int = 8) -> None:
    """Time steps with contact: a soft and a stiff body fall on the ground, where they arrive in the sixth step.

    Their cubes are turned. One that lies on an edge has several minima, mirror images of each other among them (all
    with forces of 1e-8 N, 0.66 mm apart), and rounding of 1e-12 decides in which of them Newton's method ends.
    """
    flat = box(divisions=(2, 2, 2))
    turned = flat.vertices @ Rotation.from_rotvec([0.2, -0.3, 0.4]).as_matrix().T
    shape = replace(flat, vertices=np.ascontiguousarray(turned))
    ours = two_bunnies(shape, Scene("two_bunnies", threads=1))
    theirs = two_bunnies(shape, Scene("two_bunnies", device=device))
    contacts = []
    for one in (ours, theirs):
        one.stepper.settings = replace(one.stepper.settings, velocity_tolerance=1e-9, linear_tolerance=1e-24)
    for _ in range(steps):
        reports = [one.stepper.step() for one in (ours, theirs)]
        contacts.append(reports[1].contacts)
        _check_close("positions", _contact_positions(theirs), _contact_positions(ours))
    assert min(contacts[5:]) > 0


def check_indices_of_the_device(device: Device) -> None:
    """Pairs of a dynamic energy from an array there, again with more of them, and refused where out of range."""
    scene = on_device(mixed_union(pairs=[]), device)
    ends: Any = scene.both.pp.ends
    for pairs in (PAIRS[:1], PAIRS):
        ends.update_value(DeviceArray(device, np.int32, "pairs").upload(np.array(pairs)))
        expected = mixed_union(pairs=pairs)
        _check_close("the gradient", np.concatenate(scene.gradient()), np.concatenate(expected.gradient()))
        difference = abs(scene.hessian().to_scipy() - expected.hessian().to_scipy())
        assert difference.max() <= AGREEMENT * abs(expected.hessian().to_scipy()).max()
    ends.update_value(DeviceArray(device, np.int32, "pairs").upload(np.array([[0, 1000]])))
    with pytest.raises(ConnectivityError, match="1000"):
        scene.gradient()
    ends.update_value(PAIRS)  # from the host again
    _check_close("the gradient", np.concatenate(scene.gradient()), np.concatenate(mixed_union().gradient()))


def check_out_of_memory(device: Device) -> None:
    """The error says what it was for; afterwards the device still works."""
    array = DeviceArray(device, np.float64, "the numbers of a test")
    with pytest.raises(DeviceMemoryError, match="the numbers of a test"):
        array.resize(TOO_MANY)
    assert array.size == 0
    numbers = np.random.default_rng(0).standard_normal(1000)
    assert np.array_equal(array.upload(numbers).download(), numbers)
    check_agreement(shared_targets, device)


def check_two_scenes(open_device: OpenDevice) -> None:
    """Two scenes that take turns: on one device object, then on two, as two scenes with device="cuda" have."""
    device = open_device()
    for second in (device, open_device()):
        first, other = on_device(mixed_union(), device), on_device(shared_targets(), second)
        for _ in range(2):
            theirs = [scene.solve(LINEAR_TOLERANCE) for scene in (first, other)]
        for their, make in zip(theirs, (mixed_union, shared_targets), strict=True):
            _check_solutions(their, make().solve(LINEAR_TOLERANCE))


def _check_close(what: str, theirs: Array, ours: Array) -> None:
    assert theirs.shape == ours.shape, what
    if ours.size:
        difference = np.abs(theirs - ours).max() / max(np.abs(ours).max(), np.finfo(float).tiny)
        assert difference <= AGREEMENT, f"{what} differs from the CPU's by {difference:.1e} of the largest"
