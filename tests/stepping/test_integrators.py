"""Backward Euler and BDF2 against exact motions: their order, what they keep, and what a change does to BDF2."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.integrate
from numpy.typing import NDArray

from yasps import Attribute, NotConvergedError, Scene, SceneError, concat_rows, constant, materials
from yasps.bodies import MovingObstacle, SoftBody
from yasps.contact import ContactTable
from yasps.meshes import TriangleMesh, box
from yasps.simulation import Simulation
from yasps.stepping import BACKWARD_EULER, BDF2, Integrator, MovingPart, NewtonSettings, TimeStepper, step_or_halves

EXACT = NewtonSettings(velocity_tolerance=1e-9, linear_tolerance=1e-24, solver="direct")
ROUNDING = NewtonSettings(velocity_tolerance=None, relative_force_tolerance=1e-13, solver="direct")
GRAVITY = 9.81  # m/s^2

NODES, STIFFNESS, MASS = 9, 400.0, 0.1  # N/m of each spring, kg of each node


def elastic_bar(time_step: float, integrator: Integrator) -> tuple[TimeStepper, Attribute, NDArray[np.float64]]:
    """A free chain of springs along x, stretched in its first mode of vibration; and where its nodes are at rest."""
    scene = Scene("bar", threads=1)
    mesh = scene.add_mesh("m")
    rest = np.zeros((NODES, 3))
    rest[:, 0] = np.linspace(0.0, 1.0, NODES)
    points = mesh.add_primitive("points", NODES)
    mode = 0.02 * np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
    x = points.add_attribute("x", 3, 1, value=rest + mode[:, None] * [1.0, 0.0, 0.0])
    predicted = points.add_constant("predicted", 3, 1)
    mass = points.add_constant("mass", 1, 1, value=[MASS] * NODES)
    effective_step = mesh.add_constant("effective_step", 1, 1, value=time_step)
    inertia = materials.inertia(x, predicted, mass, effective_step)
    scene.add_energy(points.add_attribute("inertia", computed_attribute=inertia))
    springs = mesh.add_primitive("springs", NODES - 1)
    ends = springs.add_connectivity("ends", points, [[i, i + 1] for i in range(NODES - 1)], 2)
    first, second = springs.add_attribute("positions", through=ends, source=x)
    stretch = (second - first).norm() - 1.0 / (NODES - 1)
    scene.add_energy(springs.add_attribute("elastic", computed_attribute=0.5 * STIFFNESS * stretch**2))
    scene.add_minimize_target(x)
    part = MovingPart(x, predicted, mass)
    options = {"settings": EXACT, "integrator": integrator, "effective_step": effective_step}
    return TimeStepper(scene, [part], time_step, **options), x, rest


def bar_error(time_step: float, integrator: Integrator) -> float:
    """Of displacements after a quarter of a second [m], against the cosine that the first mode swings in."""
    end = 0.24
    stepper, x, rest = elastic_bar(time_step, integrator)
    start = x.value.reshape(-1, 3) - rest
    frequency = 2 * np.sqrt(STIFFNESS / MASS) * np.sin(0.5 * np.pi / NODES)
    for _ in range(round(end / time_step)):
        stepper.step()
    return float(np.abs(x.value.reshape(-1, 3) - rest - np.cos(frequency * end) * start).max())


LENGTH, START = 0.7, 2.0  # m, rad


def pendulum(time_step: float, integrator: Integrator) -> tuple[TimeStepper, Attribute]:
    """A bob whose one unknown is the angle of its rod: nothing is stiff."""
    scene = Scene("pendulum", threads=1)
    rods = scene.add_mesh("m").add_primitive("rods", 1)
    angle = rods.add_attribute("angle", 1, 1, value=START)
    bob = concat_rows([LENGTH * angle.sin(), constant(0.0), -LENGTH * angle.cos()])
    x = rods.add_attribute("x", computed_attribute=bob)
    predicted = rods.add_constant("predicted", 3, 1)
    mass = rods.add_constant("mass", 1, 1, value=0.3)
    effective_step = scene.add_constant("effective_step", 1, 1, value=time_step)
    energy = materials.inertia(x, predicted, mass, effective_step) + materials.gravity(x, mass, (0, 0, -GRAVITY))
    scene.add_energy(rods.add_attribute("energy", computed_attribute=energy))
    scene.add_minimize_target(angle)
    options = {"settings": EXACT, "integrator": integrator, "effective_step": effective_step}
    return TimeStepper(scene, [MovingPart(x, predicted, mass)], time_step, **options), angle


def pendulum_error(time_step: float, integrator: Integrator) -> float:
    """Of the angle after 0.6 s [rad], against the solution of its differential equation to 1e-12."""
    end = 0.6
    stepper, angle = pendulum(time_step, integrator)
    for _ in range(round(end / time_step)):
        stepper.step()
    solved = scipy.integrate.solve_ivp(
        lambda _, y: [y[1], -GRAVITY / LENGTH * np.sin(y[0])], (0.0, end), [START, 0.0], rtol=1e-12, atol=1e-12
    )
    return abs(float(angle.value[0] - solved.y[0, -1]))


def orders(error: Callable[[float, Integrator], float], integrator: Integrator, steps: list[float]) -> list[float]:
    """By how many powers of two the error falls from each step to its half."""
    errors = [error(step, integrator) for step in steps]
    print(f"{integrator.name}: errors {errors}")
    return [float(np.log2(first / second)) for first, second in itertools.pairwise(errors)]


@pytest.mark.parametrize("error", [bar_error, pendulum_error])
@pytest.mark.parametrize(("integrator", "order"), [(BACKWARD_EULER, 1), (BDF2, 2)])
def test_orders(error: Callable[[float, Integrator], float], integrator: Integrator, order: int) -> None:
    coarse = 4e-3  # s
    assert orders(error, integrator, [coarse, coarse / 2]) == pytest.approx([order], abs=0.1)


CUBE = box((0.1, 0.1, 0.1), (1, 1, 1))


def spinning_cube(integrator: Integrator) -> tuple[Simulation, SoftBody]:
    """A soft cube that turns and flies in empty space."""
    scene = Scene("spin", threads=1)
    soft = SoftBody(scene, "soft", CUBE, youngs_modulus=1e4)
    options = {"time_step": 0.01, "gravity": (0.0, 0.0, 0.0), "contact": False}
    simulation = Simulation(scene, [soft], integrator=integrator, settings=ROUNDING, **options)
    simulation.set_velocity(soft, (0.3, -0.2, 0.1), angular=(1.0, 2.0, 6.0))
    return simulation, soft


def angular_momentum(simulation: Simulation, soft: SoftBody) -> NDArray[np.float64]:
    """About the origin [kg m^2/s]."""
    moments = np.cross(soft.positions(), simulation.velocity_of(soft))
    return np.asarray(soft.mass.value @ moments)


def test_an_isolated_body_keeps_its_momentum() -> None:
    """Linear momentum to rounding with both; angular momentum is lost a step at a time, with BDF2 far less of it."""
    drifts = {}
    for integrator in (BACKWARD_EULER, BDF2):
        simulation, soft = spinning_cube(integrator)
        momentum, spin = simulation.stepper.momentum(), angular_momentum(simulation, soft)
        for _ in range(50):
            simulation.step()
        assert np.abs(simulation.stepper.momentum() - momentum).max() < 1e-10 * np.linalg.norm(momentum)
        drift = np.linalg.norm(angular_momentum(simulation, soft) - spin) / np.linalg.norm(spin)
        drifts[integrator.name] = float(drift)
    print(drifts)
    assert drifts["BDF2"] < 0.1 * drifts["backward Euler"]


# -- changes -----------------------------------------------------------------------------------------------


def is_bdf2(simulation: Simulation) -> bool:
    """Whether the last step was one."""
    return float(simulation.effective_step.value[0]) == pytest.approx(2 / 3 * simulation.stepper.time_step)


def falling(integrator: Integrator = BDF2) -> tuple[Simulation, SoftBody]:
    scene = Scene("fall", threads=1)
    soft = SoftBody(scene, "soft", CUBE.translated((0.0, 0.0, 1.0)))
    return Simulation(scene, [soft], time_step=0.01, contact=False, integrator=integrator), soft


def test_the_first_step_and_those_after_a_change_are_of_backward_euler() -> None:
    simulation, soft = falling()
    assert [(simulation.step(), is_bdf2(simulation))[1] for _ in range(3)] == [False, True, True]
    position, stepper = soft.position, simulation.stepper

    def move() -> None:
        position.update_value(position.value + 0.1)

    def change_velocity() -> None:
        simulation.set_velocity(soft, (0.0, 0.0, 1.0))

    def change_step() -> None:
        simulation._set_time_step(0.005)

    def restore_without_history() -> None:
        state = {name: x for name, x in simulation.state().items() if not name.startswith("past/")}
        simulation._set_state(state)

    for change in (move, change_velocity, change_step, restore_without_history):
        change()
        assert [(simulation.step(), is_bdf2(simulation))[1] for _ in range(2)] == [False, True], change.__name__
    heap = SoftBody(simulation.scene, "second", CUBE.translated((0.0, 0.0, 2.0)))
    simulation.add(heap)
    assert simulation.stepper is not stepper
    assert [(simulation.step(), is_bdf2(simulation))[1] for _ in range(2)] == [False, True]


def test_a_restored_state_goes_on_with_bdf2(tmp_path: Path) -> None:
    first, soft = falling()
    first.run(4)
    file = tmp_path / "state.npz"
    first.save(file)
    first.run(3)
    second, other = falling()
    second.restore(file)
    second.step()
    assert is_bdf2(second)
    second.run(2)
    np.testing.assert_array_equal(other.positions(), soft.positions())
    np.testing.assert_array_equal(second.velocity_of(other), first.velocity_of(soft))


def test_a_step_that_failed_leaves_what_bdf2_remembers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two halves in its place: the first of backward Euler, since it is shorter, the second of BDF2."""
    simulation, _ = falling()
    simulation.run(3)
    before, stepper = simulation.state(), simulation.stepper
    minimize, kinds = stepper.minimize, []

    def failing(fixed: object = None) -> object:
        kinds.append((stepper.time_step, is_bdf2(simulation)))
        if stepper.time_step > shortest:
            raise NotConvergedError("not today")
        return minimize(fixed)  # type: ignore[arg-type]

    monkeypatch.setattr(stepper, "minimize", failing)
    shortest = 0.0
    with pytest.raises(NotConvergedError):
        simulation.step()
    after = simulation.state()
    assert before.keys() == after.keys()
    for name, value in before.items():
        np.testing.assert_array_equal(after[name], value)
    shortest = 0.005
    kinds.clear()
    assert simulation.step().substeps == 2
    assert kinds == [(0.01, True), (0.005, False), (0.005, True)]
    shortest = 0.01
    assert [(simulation.step(), is_bdf2(simulation))[1] for _ in range(2)] == [False, True]


def test_a_second_half_that_fails_takes_back_what_the_first_is_remembered_by(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation, _ = falling()
    simulation.run(3)
    stepper, minimize = simulation.stepper, simulation.stepper.minimize
    before, start = stepper.past, simulation.time

    def failing(fixed: object = None) -> object:
        if stepper.time_step == 0.01 or stepper.time > start + 0.004:
            raise NotConvergedError("late")
        return minimize(fixed)  # type: ignore[arg-type]

    monkeypatch.setattr(stepper, "minimize", failing)
    with pytest.raises(NotConvergedError, match="late"):
        step_or_halves(stepper, simulation._set_time_step, 1)
    assert stepper.past is before


@pytest.mark.nightly
def test_an_obstacle_drags_with_its_own_velocity() -> None:
    scene = Scene("belt", threads=1)
    cube = SoftBody(scene, "cube", CUBE.translated((0.0, 0.0, 0.0501 + 0.05)), youngs_modulus=1e6)
    plate = box((1.0, 0.4, 0.02), (1, 1, 1)).translated((0.0, 0.0, -0.01 + 0.05 - 0.01))
    surface = TriangleMesh(plate.vertices, plate.surface_triangles())

    def motion(time: float) -> NDArray[np.float64]:
        return plate.vertices + np.array([0.1 * time, 0.0, 0.0])

    belt = MovingObstacle(scene, "belt", surface, motion=motion)
    bodies = [cube, belt]
    simulation = Simulation(scene, bodies, contacts=ContactTable(friction=0.5), integrator=BDF2, time_step=0.01)
    simulation.run(60)
    speed = cube.mass.value @ simulation.velocity_of(cube) / cube.mass.value.sum()
    np.testing.assert_allclose(speed, [0.1, 0.0, 0.0], atol=5e-4)
    assert simulation.contact_forces().friction.slides.sum() == 0


def test_what_cannot_be_an_integrator_is_refused() -> None:
    scene = Scene("wrong", threads=1)
    soft = SoftBody(scene, "soft", CUBE)
    with pytest.raises(SceneError, match=r"integrator is BACKWARD_EULER or BDF2 of yasps\.stepping, got 'bdf2'"):
        Simulation(scene, [soft], integrator="bdf2")  # type: ignore[arg-type]
    predicted = soft.vertices.add_constant("predicted", 3, 1)
    part = MovingPart(soft.position, predicted, soft.mass)
    with pytest.raises(SceneError, match="BDF2 changes the step that inertia counts in"):
        TimeStepper(scene, [part], 0.01, integrator=BDF2)
    with pytest.raises(SceneError, match="effective_step is a constant of the scene, 1x1"):
        TimeStepper(scene, [part], 0.01, integrator=BDF2, effective_step=predicted)
