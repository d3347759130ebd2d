"""Newton's method and time steps on a device made of the host, against the processor."""

from __future__ import annotations

import numpy as np
import pytest
from cuda_on_host import HostDevice
from numpy.typing import NDArray

from yasps import Scene, materials
from yasps.contact import BarrierContact
from yasps.meshes import box, ground
from yasps.runtime.device.protocol import Device
from yasps.stepping import MovingPart, NewtonReport, NewtonSettings, TimeStepper, minimize

STEP = 0.01
TIGHT = NewtonSettings(velocity_tolerance=1e-7, linear_tolerance=1e-18)


def falling_block(device: str | Device, deterministic: bool = False) -> TimeStepper:
    """A tilted soft block just above the ground, with contact, gravity and inertia."""
    shape = box((0.1, 0.1, 0.1), (1, 1, 2)).rotated((1.0, 0.3, 0.0), 0.05)
    start = shape.vertices - [0.0, 0.0, shape.vertices[:, 2].min() - 0.004]
    scene = Scene("block", device=device, deterministic=deterministic)
    mesh = scene.add_mesh("soft")
    vertices, tets = mesh.add_primitive("vertices", len(start)), mesh.add_primitive("tets", len(shape.tets))
    x = vertices.add_attribute("position", 3, 1, value=start)
    predicted = vertices.add_constant("predicted", 3, 1, value=start)
    mass = vertices.add_constant("mass", 1, 1, value=shape.vertex_masses(1000.0))
    for name, energy in (
        ("gravity", materials.gravity(x, mass, (0.0, 0.0, -9.8))),
        ("inertia", materials.inertia(x, predicted, mass, STEP)),
    ):
        scene.add_energy(vertices.add_attribute(name, computed_attribute=energy))
    corners = tets.add_connectivity("corners", vertices, shape.tets, 4)
    inverse, volume = materials.rest_shape(shape.vertices, shape.tets)
    f = materials.deformation_gradient(
        tets.add_attribute("positions", through=corners, source=x), tets.add_constant("inverse", 3, 3, value=inverse)
    )
    mu, lam = materials.stable_neo_hookean_parameters(2e4, 0.4)
    elastic = materials.stable_neo_hookean(f, mu, lam, tets.add_constant("volume", 1, 1, value=volume))
    scene.add_energy(tets.add_attribute("elastic", computed_attribute=elastic))
    floor = ground((1.0, 1.0), 0.0, (1, 1))
    below = scene.add_mesh("ground").add_primitive("vertices", len(floor.vertices))
    below.add_constant("position", 3, 1, value=floor.vertices)
    both = scene.add_mesh("both")
    union = both.add_primitive_union("vertices", [vertices, below])
    union.add_attribute("position")
    contact = BarrierContact(
        both,
        union,
        np.concatenate([shape.surface_triangles(), floor.triangles + len(start)]),
        activation_distance=0.004,
        barrier="paper",
        stiffness=1.0 / 0.004**3,
        fixed=np.arange(union.num_instances) >= len(start),
    )
    scene.add_minimize_target(x)
    return TimeStepper(scene, [MovingPart(x, predicted, mass)], STEP, contact, settings=TIGHT)


def run(stepper: TimeStepper, steps: int) -> tuple[list[NewtonReport], NDArray[np.float64]]:
    return [stepper.step() for _ in range(steps)], stepper.parts[0].position.value


@pytest.mark.parametrize("deterministic", [False, True])
def test_a_block_falls_on_the_ground_as_on_the_processor(deterministic: bool) -> None:
    wanted_reports, wanted = run(falling_block("cpu"), 4)
    reports, found = run(falling_block(HostDevice(), deterministic), 4)
    assert wanted_reports[-1].contacts > 0
    assert np.abs(wanted - falling_block("cpu").parts[0].position.value).max() > 1e-3
    np.testing.assert_allclose(found, wanted, rtol=0, atol=5e-9)
    for report, other in zip(reports, wanted_reports, strict=True):
        assert abs(report.iterations - other.iterations) <= 1
        assert report.contacts == other.contacts
        assert report.energy == pytest.approx(other.energy, rel=1e-9)


@pytest.mark.parametrize("projection", ["on-demand", "auto"])
def test_projection_on_demand(projection: str) -> None:
    """The exact Hessian first: conjugate gradients on the device meet negative curvature, and say so."""

    def ends(device: str | Device) -> tuple[NewtonReport, NDArray[np.float64]]:
        scene = Scene("saddle", device=device)
        points = scene.add_mesh("m").add_primitive("points", 40)
        x = points.add_attribute("x", 3, 1, value=np.random.default_rng(0).standard_normal((40, 3)))
        well = (x.dot(x) - 1.0) ** 2 + 0.1 * x[0]
        scene.add_energy(points.add_attribute("well", computed_attribute=well))
        scene.add_energy(points.add_attribute("hold", computed_attribute=0.05 * x.dot(x)))
        scene.add_minimize_target(x)
        settings = NewtonSettings(velocity_tolerance=1e-9, linear_tolerance=1e-20, projection=projection)
        return minimize(scene, [x], 1.0, settings=settings), x.value

    (wanted_report, wanted), (report, found) = ends("cpu"), ends(HostDevice())
    assert wanted_report.projected > 0
    if projection == "on-demand":  # "auto" does not try again: no step is longer than 1
        assert wanted_report.projected < wanted_report.iterations
    assert (report.iterations, report.projected) == (wanted_report.iterations, wanted_report.projected)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-8)
