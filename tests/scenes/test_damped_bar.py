"""A free bar of tetrahedra in its first mode of stretch, damped by strain rates: its decay against theory."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import Scene, ShapeMismatchError, materials
from yasps.bodies import SoftBody
from yasps.meshes import box
from yasps.simulation import Simulation
from yasps.stepping import BACKWARD_EULER, BDF2, Integrator, NewtonSettings

LENGTH, MODULUS, DENSITY = 1.0, 1e6, 1000.0
TIGHT = NewtonSettings(velocity_tolerance=1e-8, solver="direct")


def bar(viscosity: float, time_step: float, integrator: Integrator) -> tuple[Simulation, SoftBody]:
    """Without contraction, so that it only stretches along x."""
    scene = Scene("bar", threads=1)
    shape = box((LENGTH, 0.1, 0.1), (10, 1, 1))
    body = SoftBody(scene, "bar", shape, youngs_modulus=MODULUS, poisson_ratio=0.0, density=DENSITY)
    options = {"contact": False, "gravity": (0.0, 0.0, 0.0), "settings": TIGHT}
    simulation = Simulation(scene, [body], time_step=time_step, integrator=integrator, **options)
    f = body.tets["deformation_gradient"]
    strain = body.tets.add_attribute("strain", computed_attribute=materials.green_strain(f))
    before = body.tets.add_constant("strain_before", 3, 3)
    damping = materials.strain_rate_damping(f, before, viscosity, body.tets["rest_volume"], simulation.effective_step)
    body.add_energy(body.tets.add_attribute("damping", computed_attribute=damping))
    simulation.carry(before, strain)
    mode = np.sin(np.pi * body.rest[:, 0] / LENGTH)
    body.position.update_value(body.rest + 1e-4 * mode[:, None] * [1.0, 0.0, 0.0])
    return simulation, body


def decay_rate(viscosity: float, time_step: float, integrator: Integrator) -> float:
    """Of the first mode's amplitude [1/s], by least squares over its extremes."""
    simulation, body = bar(viscosity, time_step, integrator)
    mode = np.sin(np.pi * body.rest[:, 0] / LENGTH)
    mass = body.mass.value
    amplitudes = []
    for _ in range(round(0.25 / time_step)):
        simulation.step()
        amplitudes.append(float((mass * mode) @ (body.positions() - body.rest)[:, 0]))
    found = np.array(amplitudes)
    extremes = 1 + np.flatnonzero((np.diff(found)[:-1] * np.diff(found)[1:]) < 0)
    slope, _ = np.polyfit(time_step * (1 + extremes), np.log(np.abs(found[extremes])), 1)
    return float(-slope)


@pytest.mark.nightly
@pytest.mark.parametrize(("integrator", "time_step"), [(BACKWARD_EULER, 5e-4), (BDF2, 1e-3)])
def test_the_damping_of_the_first_mode(integrator: Integrator, time_step: float) -> None:
    """Stress c E' beside E_Y E damps a mode of frequency w by c w^2 / (2 E_Y); the integrator's own damping, without
    viscosity, is taken off. 100 Pa s: a damping ratio of half a per cent."""
    viscosity = 100.0
    own = decay_rate(0.0, time_step, integrator)
    found = decay_rate(viscosity, time_step, integrator) - own
    frequency = np.pi / LENGTH * np.sqrt(MODULUS / DENSITY)
    expected = viscosity * frequency**2 / (2 * MODULUS)
    print(f"{integrator.name}: {found:.4f} 1/s, theory {expected:.4f}, its own {own:.4f}")
    assert found == pytest.approx(expected, rel=0.02)


def test_what_is_carried_is_where_the_rate_counts_from() -> None:
    """With BDF2 (4 E_n - E_before) / 3 from the second step on; and a state goes on as if nothing had happened."""
    simulation, body = bar(100.0, 1e-3, BDF2)
    strains = [body.tets["strain"].value]
    for _ in range(3):
        simulation.step()
        strains.append(body.tets["strain"].value)
    np.testing.assert_array_equal(body.tets["strain_before"].value, 4 / 3 * strains[2] + (-1 / 3) * strains[1])
    state = simulation.state()
    simulation.step()
    expected = body.positions()
    simulation.step()
    simulation._set_state(state)
    simulation.step()
    np.testing.assert_array_equal(body.positions(), expected)
    with pytest.raises(ShapeMismatchError, match="a constant of its own primitive and shape"):
        simulation.carry(body.tets["rest_volume"], body.tets["strain"])
