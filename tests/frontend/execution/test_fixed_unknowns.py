"""Unknowns that stay as they are: the system of the others, without anything compiled for it."""

from __future__ import annotations

import numpy as np
import pytest
from cuda_on_host import HostDevice

from yasps import Attribute, DataError, Scene, SceneError, UnsupportedSceneError, materials
from yasps.meshes import box
from yasps.runtime.device.protocol import Device

SHAPE = box((1.0, 1.0, 2.0), (2, 2, 4))
FLAT = 0.3
"""Share of its height at which the block's exact Hessian is indefinite."""


def block(stretch: float = 0.6, device: str | Device = "cpu") -> tuple[Scene, Attribute, Attribute]:
    """A soft block, of which ties, whose instances may change, hold some vertices by turning levers."""
    scene = Scene("block", device=device, threads=2 if device == "cpu" else None)
    vertices = scene.add_mesh("soft").add_primitive("vertices", len(SHAPE.vertices))
    x = vertices.add_attribute("position", 3, 1, value=SHAPE.vertices * [1.0, 1.0, stretch])
    mass = vertices.add_constant("mass", 1, 1, value=SHAPE.vertex_masses(10.0))
    inertia = materials.inertia(x, vertices.add_constant("start", 3, 1, value=SHAPE.vertices), mass, 0.1)
    scene.add_energy(vertices.add_attribute("inertia", computed_attribute=inertia))
    tets = scene.soft.add_primitive("tets", len(SHAPE.tets))
    corners = tets.add_connectivity("corners", vertices, SHAPE.tets, 4)
    inverse, volume = materials.rest_shape(SHAPE.vertices, SHAPE.tets)
    f = materials.deformation_gradient(
        tets.add_attribute("positions", through=corners, source=x), tets.add_constant("inverse", 3, 3, value=inverse)
    )
    elastic = materials.stable_neo_hookean(f, 100.0, 300.0, tets.add_constant("volume", 1, 1, value=volume))
    scene.add_energy(tets.add_attribute("elastic", computed_attribute=elastic))
    levers = scene.add_mesh("levers").add_primitive("levers", 2)
    angle = levers.add_attribute("angle", 1, 1, value=[0.2, -0.4])
    stiff = angle * angle
    scene.add_energy(levers.add_attribute("spring", computed_attribute=stiff * 50))
    ties = scene.soft.add_primitive("ties", 0, is_dynamic=True)
    end = ties.add_attribute("end", through=ties.add_connectivity("vertex", vertices, [], 1), source=x)
    turn = ties.add_attribute("turn", through=ties.add_connectivity("lever", levers, [], 1), source=angle)
    tie = 30.0 * (end.reshape(3, 1)[2] - turn.reshape(1, 1).sin()) ** 2
    scene.add_energy(ties.add_attribute("tie", computed_attribute=tie))
    ties.update(vertex=[[3], [7], [11]], lever=[[0], [1], [1]])
    scene.add_minimize_target([x, angle])
    return scene, x, angle


def some_fixed() -> tuple[np.ndarray, np.ndarray]:
    vertices = np.zeros(len(SHAPE.vertices), bool)
    vertices[[0, 3, 4, 11, 20]] = True
    return vertices, np.array([False, True])


@pytest.mark.parametrize(
    ("projection", "stretch"),
    [("always", FLAT), ("on-demand", FLAT), ("on-demand", 1.0)],
    ids=["always", "tried", "exact"],
)
@pytest.mark.parametrize("solver", ["pcg", "direct", "auto"])
def test_the_solution_is_that_of_the_reduced_system(solver: str, projection: str, stretch: float) -> None:
    scene, x, angle = block(stretch)
    of_vertices, of_levers = some_fixed()
    compiled = scene.compile()
    whole = scene.hessian().to_scipy().toarray()
    gradient = np.concatenate(scene.gradient())
    exact = scene.hessian(projected=False).to_scipy().toarray()
    fixed = np.concatenate([np.repeat(of_vertices, 3), of_levers])
    assert np.linalg.eigvalsh(exact[~fixed][:, ~fixed])[0] * (stretch - 0.9) > 0  # squeezed flat it is indefinite
    matrix = exact if (projection, stretch) == ("on-demand", 1.0) else whole
    expected = np.zeros(len(fixed))
    expected[~fixed] = np.linalg.solve(matrix[~fixed][:, ~fixed], gradient[~fixed])
    solution = scene.solve(1e-26, solver=solver, projection=projection, fixed={x: of_vertices, angle: of_levers})
    assert solution.report.converged
    found = np.concatenate(solution.directions)
    np.testing.assert_array_equal(found[fixed], 0.0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    np.testing.assert_array_equal(np.concatenate(solution.gradient), np.where(fixed, 0.0, gradient))
    # Then free again, with the same code.
    assert scene.compile() is compiled
    free = np.concatenate(scene.minimize_energy(1e-26, solver=solver))
    np.testing.assert_allclose(free, np.linalg.solve(whole, gradient), rtol=0, atol=1e-10 * np.abs(free).max())


def test_the_hessian_without_fixed_unknowns_is_as_before() -> None:
    scene, x, _ = block()
    before = scene.hessian().to_scipy().toarray()
    scene.solve(fixed={x: some_fixed()[0]})
    np.testing.assert_array_equal(scene.hessian().to_scipy().toarray(), before)


def test_all_may_be_fixed() -> None:
    scene, x, angle = block()
    everything = {x: np.ones(len(SHAPE.vertices), bool), angle: np.ones(2, bool)}
    for solver in ("pcg", "direct"):
        solution = scene.solve(solver=solver, fixed=everything)
        assert solution.report.converged
        assert not np.concatenate(solution.directions).any()


def test_what_can_not_be_fixed() -> None:
    scene, x, _ = block()
    with pytest.raises(DataError, match=r"fixed: soft\.vertices\.position has 45 instances .* got int64 \[1\]"):
        scene.solve(fixed={x: [1]})
    with pytest.raises(DataError, match=r"got bool \[3\]"):
        scene.solve(fixed={x: [True, False, True]})
    with pytest.raises(SceneError, match=r"fixed: 'soft\.vertices\.mass' is no minimisation target"):
        scene.solve(fixed={scene.soft.vertices["mass"]: np.ones(45, bool)})


def test_a_device_says_that_it_can_not() -> None:
    scene, x, _ = block(device=HostDevice())
    with pytest.raises(UnsupportedSceneError, match="fixed on the CPU only"):
        scene.solve(fixed={x: some_fixed()[0]})
