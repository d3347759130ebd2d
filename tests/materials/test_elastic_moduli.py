"""At rest, stable Neo-Hookean elasticity has the moduli it was asked for: those of the linear theory."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from yasps import Scene, materials
from yasps.meshes import box

Floats = NDArray[np.float64]
MODULI = ((1e5, 0.3), (2.0, 0.0), (7e3, 0.45), (50.0, -0.4))
VOLUME = 1.7


@pytest.fixture(scope="module")
def element() -> Scene:
    """A deformation gradient as the unknown, the two parameters as constants."""
    scene = Scene("element")
    cell = scene.add_mesh("m").add_primitive("cell", 1)
    f = cell.add_attribute("f", 3, 3, value=np.eye(3))
    mu, lam = cell.add_constant("mu", 1, 1, value=1.0), cell.add_constant("lam", 1, 1, value=1.0)
    energy = materials.stable_neo_hookean(f, mu, lam, VOLUME)
    scene.add_energy(cell.add_attribute("elastic", computed_attribute=energy), projection="none")
    scene.add_minimize_target(f)
    return scene


def stiffness(element: Scene, youngs_modulus: float, poisson_ratio: float) -> tuple[Floats, Floats]:
    """Gradient [9] and Hessian [9, 9] at rest, of a unit volume, from the material's own parameters."""
    mu, lam = materials.stable_neo_hookean_parameters(youngs_modulus, poisson_ratio)
    element.m.cell["mu"].update_value(mu)
    element.m.cell["lam"].update_value(lam)
    (gradient,) = element.gradient()
    return gradient / VOLUME, element.hessian(projected=False).to_scipy().toarray() / VOLUME


@pytest.mark.parametrize(("youngs_modulus", "poisson_ratio"), MODULI)
def test_a_stretched_bar_has_youngs_modulus_and_poissons_ratio(
    element: Scene, youngs_modulus: float, poisson_ratio: float
) -> None:
    gradient, hessian = stiffness(element, youngs_modulus, poisson_ratio)
    np.testing.assert_allclose(gradient, 0.0, atol=1e-12 * youngs_modulus)
    stretched = np.diag([1.0, -poisson_ratio, -poisson_ratio])  # what a bar does that is pulled along x
    stress = (hessian @ stretched.ravel()).reshape(3, 3)
    np.testing.assert_allclose(stress, youngs_modulus * np.diag([1.0, 0, 0]), atol=1e-12 * youngs_modulus)


@pytest.mark.parametrize(("youngs_modulus", "poisson_ratio"), MODULI)
def test_shear_and_rotation(element: Scene, youngs_modulus: float, poisson_ratio: float) -> None:
    _, hessian = stiffness(element, youngs_modulus, poisson_ratio)
    shear = np.zeros((3, 3))
    shear[0, 1] = shear[1, 0] = 0.5
    stress = (hessian @ shear.ravel()).reshape(3, 3)
    expected = youngs_modulus / (1 + poisson_ratio) * shear  # 2 mu epsilon
    np.testing.assert_allclose(stress, expected, atol=1e-12 * youngs_modulus)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])
    np.testing.assert_allclose(hessian @ turn.ravel(), 0.0, atol=1e-12 * youngs_modulus)


def test_lames_parameters_by_the_bulk_modulus() -> None:
    for youngs_modulus, poisson_ratio in MODULI:
        mu, lam = materials.lame_parameters(youngs_modulus, poisson_ratio)
        assert mu == pytest.approx(youngs_modulus / (2 * (1 + poisson_ratio)))
        assert lam + 2 / 3 * mu == pytest.approx(youngs_modulus / (3 * (1 - 2 * poisson_ratio)))


def test_a_tetrahedron_that_is_not_regular() -> None:
    """F and volume by the affine map that the vertices are moved with."""
    rng = np.random.default_rng(0)
    rest = np.array([[0.0, 0, 0], [1, 0, 0], [0.2, 1.1, 0], [0.3, -0.1, 0.9]]) + 0.1 * rng.standard_normal((4, 3))
    order = [2, 0, 3, 1]
    if np.linalg.det(rest[order][1:] - rest[order][0]) < 0:
        order = [0, 2, 3, 1]
    map_to = np.eye(3) + 0.3 * rng.standard_normal((3, 3))
    scene = Scene("tet")
    mesh = scene.add_mesh("m")
    vertices, tets = mesh.add_primitive("v", 4), mesh.add_primitive("t", 1)
    x = vertices.add_attribute("x", 3, 1, value=rest @ map_to.T + [1.0, 2.0, 3.0])
    corners = tets.add_connectivity("corners", vertices, [order], 4)
    inverse, volume = materials.rest_shape(rest, [order])
    positions = tets.add_attribute("positions", through=corners, source=x)
    f = materials.deformation_gradient(positions, tets.add_constant("inverse", 3, 3, value=inverse))
    np.testing.assert_allclose(tets.add_attribute("f", computed_attribute=f).compute().array[0], map_to, atol=1e-12)
    assert volume[0] == pytest.approx(abs(np.linalg.det(np.c_[rest, np.ones(4)])) / 6)


def test_a_bar_whose_stiffness_is_a_field() -> None:
    """Young's modulus of each tetrahedron: halves of 1 and 3 units, one behind the other, stretch by 3 to 1.

    Without lateral contraction strain is even in each half, so that linear elements are exact.
    """
    shape = box((2.0, 1.0, 1.0), (4, 2, 2))
    inverse, volume = materials.rest_shape(shape.vertices, shape.tets)
    middle = shape.vertices[shape.tets].mean(axis=1)[:, 0]
    scene = Scene("bar", threads=1)
    mesh = scene.add_mesh("m")
    vertices, tets = mesh.add_primitive("v", len(shape.vertices)), mesh.add_primitive("t", len(shape.tets))
    x = vertices.add_attribute("x", 3, 1, value=shape.vertices)
    corners = tets.add_connectivity("corners", vertices, shape.tets, 4)
    positions = tets.add_attribute("positions", through=corners, source=x)
    f = materials.deformation_gradient(positions, tets.add_constant("inverse", 3, 3, value=inverse))
    youngs_modulus = tets.add_constant("youngs_modulus", 1, 1, value=np.where(middle < 0, 1.0, 3.0))
    mu, lam = materials.lame_parameters(youngs_modulus, mesh.add_constant("poisson_ratio", 1, 1, value=0.0))
    energy = materials.linear_elasticity(f, mu, lam, tets.add_constant("volume", 1, 1, value=volume))
    scene.add_energy(tets.add_attribute("elastic", computed_attribute=energy))
    scene.add_minimize_target(x)
    ends = np.abs(shape.vertices[:, 0]) == 1.0
    drawn = shape.vertices[:, :1] == 1.0
    x.update_value(shape.vertices + 0.1 * drawn * [1.0, 0, 0])
    solution = scene.solve(1e-26, fixed={x: ends})
    x.update_value(x.value - solution.directions[0])
    found = x.compute().array[:, 0, 0]
    at = shape.vertices[:, 0]
    wanted = at + np.where(at < 0, 0.075 * (at + 1), 0.075 + 0.025 * at)
    np.testing.assert_allclose(found, wanted, atol=1e-12)
