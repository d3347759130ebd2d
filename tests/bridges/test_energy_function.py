"""Energies as functions of arrays, and as objectives of SciPy."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from bridge_scenes import springs_over_a_union
from numpy.typing import NDArray
from scipy import optimize

from yasps import DataError, FloatArray, NotFiniteError, Scene, SceneError, ShapeMismatchError
from yasps.bridges import EnergyFunction
from yasps.bridges.scipy import Objective


def numbers_of(scene: Scene) -> dict[str, NDArray[np.float64]]:
    return {path: array.copy() for path, array in scene.numbers().items()}


def check_same(now: dict[str, NDArray[np.float64]], then: dict[str, NDArray[np.float64]]) -> None:
    assert now.keys() == then.keys()
    for path, array in now.items():
        np.testing.assert_array_equal(array, then[path])


def test_derivatives_with_respect_to_targets_and_parameters() -> None:
    """Against eighth-order differences of the value and the gradient; the scene stays as it is."""
    scene, inputs = springs_over_a_union()
    before = numbers_of(scene)
    objective = Objective(scene, inputs)
    x = objective.x0 + 0.01 * np.cos(np.arange(objective.x0.size))
    assert objective.fun(objective.x0) == scene.total_energy()
    gradient, hessian = objective.jac(x), objective.hess(x).toarray()
    weights, step = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}, 1e-2
    for k, unit in enumerate(np.eye(x.size)):
        ends = {m: step * m * unit for m in weights}
        slope = sum(w * (objective.fun(x + ends[m]) - objective.fun(x - ends[m])) for m, w in weights.items()) / step
        assert gradient[k] == pytest.approx(slope, rel=1e-9, abs=1e-9)
        column = sum(w * (objective.jac(x + ends[m]) - objective.jac(x - ends[m])) for m, w in weights.items()) / step
        np.testing.assert_allclose(hessian[:, k], column, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(hessian, hessian.T, rtol=1e-13, atol=1e-15)
    direction = np.sin(np.arange(x.size))
    np.testing.assert_allclose(objective.hessp(x, direction), hessian @ direction, rtol=1e-13, atol=1e-13)
    assert np.linalg.eigvalsh(hessian).min() < -0.1
    check_same(numbers_of(scene), before)
    mixed = scene.mixed_hessian(inputs[:3], inputs[3:]).toarray()
    np.testing.assert_allclose(objective.hess(objective.x0).toarray()[:21, 21:], mixed, rtol=1e-13, atol=1e-13)
    objective.store(x)
    np.testing.assert_array_equal(objective.x0, x)


def test_the_scene_is_as_it_was_after_an_error() -> None:
    scene = Scene("domain")
    points = scene.add_mesh("m").add_primitive("points", 2)
    height = points.add_attribute("height", 1, 1, value=[0.5, 0.25])
    scene.add_energy(points.add_attribute("barrier", computed_attribute=height - height.log()))
    function = EnergyFunction(scene, height)
    assert np.isnan(function.value([[-1.0], [1.0]]))
    assert function.value([0.0, 1.0]) == np.inf
    with pytest.raises(NotFiniteError, match=r"m\.points\.barrier"):
        function.gradient([[1.0], [-1.0]])
    with pytest.raises(NotFiniteError, match=r"m\.points\.barrier"):
        function.hessian([[0.0], [1.0]])
    with pytest.raises(DataError, match="not finite"):
        function.value([np.nan, 1.0])
    np.testing.assert_array_equal(height.value, [0.5, 0.25])
    objective = Objective(scene, height)
    assert objective.fun([-1.0, 1.0]) == np.inf
    # A trust region finds its way from the wall to the minimum at 1; the gradient is never asked for behind the wall.
    found = optimize.minimize(
        objective.fun, [0.01, 9.0], jac=objective.jac, hessp=objective.hessp, method="trust-ncg", tol=1e-10
    )
    np.testing.assert_allclose(found.x, 1.0, atol=1e-9)


def test_scipy_finds_the_minimum() -> None:
    """Every method with second derivatives that takes them another way; the projected Hessian is another one."""
    scene, inputs = springs_over_a_union()
    position = inputs[0]
    exact, projected = Objective(scene, position), Objective(scene, position, projected=True)
    assert np.linalg.eigvalsh(projected.hess(exact.x0).toarray()).min() > 0
    assert abs(projected.hess(exact.x0) - exact.hess(exact.x0)).max() > 0.1
    x0, jac = exact.x0, exact.jac
    found = [
        optimize.minimize(exact.fun, x0, jac=jac, method="L-BFGS-B", options={"gtol": 1e-9, "ftol": 0.0}),
        optimize.minimize(exact.fun, x0, jac=jac, hess=projected.hess, method="Newton-CG", options={"xtol": 1e-12}),
        optimize.minimize(exact.fun, x0, jac=jac, hessp=exact.hessp, method="trust-krylov", tol=1e-9),
        optimize.minimize(exact.fun, x0, jac=jac, hess=exact.hess, method="trust-constr", tol=1e-9),
    ]
    for one in found:
        assert np.abs(jac(one.x)).max() < 1e-7
        assert one.fun == pytest.approx(found[0].fun, abs=1e-12)


def test_products_know_what_was_set_between() -> None:
    """The kept Hessian is left when other numbers, connections or energies of the scene have changed."""
    scene, inputs = springs_over_a_union()
    function = EnergyFunction(scene, inputs[:3])
    arrays = function.numbers()
    directions: list[FloatArray] = [np.ones_like(array) for array in arrays]

    def product() -> FloatArray:
        return np.concatenate([part.ravel() for part in function.hessian_product(arrays, directions)])

    def fresh() -> FloatArray:
        return np.asarray(EnergyFunction(scene, inputs[:3]).hessian(*arrays).sum(axis=1))

    seen = [product()]
    np.testing.assert_allclose(seen[0], fresh(), atol=1e-13)
    inputs[4].update_value(0.7)
    seen.append(product())
    scene.mesh.springs.connectivities["ends"].update_value([[0, 1], [1, 2], [2, 3]])
    seen.append(product())
    scene.remove_energy(scene.mesh.free["weight"])
    seen.append(product())
    np.testing.assert_allclose(seen[3], fresh(), atol=1e-13)
    for one, other in pairwise(seen):
        assert np.abs(one - other).max() > 1e-3


def test_layouts_of_arguments() -> None:
    """Flat or with all axes, in any order in memory; derivatives come in the same shapes."""
    scene, inputs = springs_over_a_union()
    function = EnergyFunction(scene, inputs[:2])
    position, matrix = function.numbers()
    expected = function.gradient(position, matrix)
    views = [np.asfortranarray(position[:, :, 0]), matrix.swapaxes(1, 2).copy().swapaxes(1, 2)]
    assert not views[0].flags.c_contiguous
    for given in (views, [position.ravel(), matrix[0]]):
        found = function.gradient(*given)
        for part, array, same in zip(found, given, expected, strict=True):
            assert part.shape == array.shape
            np.testing.assert_array_equal(part.ravel(), same.ravel())
        products = function.hessian_product(given, given)
        assert [part.shape for part in products] == [array.shape for array in given]


def test_refuses_wrong_arguments() -> None:
    scene, inputs = springs_over_a_union()
    other, theirs = springs_over_a_union()
    energy = scene.mesh.springs["energy"]
    with pytest.raises(SceneError, match="same name but is another"):
        EnergyFunction(scene, theirs)
    with pytest.raises(SceneError, match="same name but is another"):
        EnergyFunction(scene, inputs, energies=other.mesh.springs["energy"])
    with pytest.raises(SceneError, match="named twice"):
        EnergyFunction(scene, [inputs[0], inputs[0]])
    with pytest.raises(SceneError, match="named twice"):
        EnergyFunction(scene, inputs, energies=[energy, energy])
    with pytest.raises(SceneError, match="computed"):
        EnergyFunction(scene, energy)
    with pytest.raises(SceneError, match="at least one stored"):
        EnergyFunction(scene, [])
    with pytest.raises(SceneError, match="at least one energy"):
        EnergyFunction(scene, inputs, energies=[])
    with pytest.raises(ShapeMismatchError, match="1x1"):
        EnergyFunction(scene, inputs, energies=scene.mesh.springs["both"])
    function = EnergyFunction(scene, inputs[:2], energies=energy)
    position, matrix = function.numbers()
    with pytest.raises(ShapeMismatchError, match=r"mesh\.free\.position, mesh\.body\.matrix, in this order; got 1"):
        function.value(position)
    with pytest.raises(DataError, match=r"argument 0 \(mesh\.free\.position\) needs 3 x 3x1 = 9 numbers"):
        function.value(position[:2], matrix)
    with pytest.raises(DataError, match=r"argument 0 \(mesh\.free\.position\) needs real numbers, got complex128"):
        function.value(1j * position, matrix)
    with pytest.raises(DataError, match=r"direction 1 \(mesh\.body\.matrix\)"):
        function.hessian_product([position, matrix], [position, position[:2]])
    objective = Objective(scene, inputs[:2])
    with pytest.raises(DataError, match=r"18 numbers \(9 of mesh\.free\.position, 9 of mesh\.body\.matrix\)"):
        objective.fun(np.zeros(17))


def test_an_energy_that_is_not_registered() -> None:
    """An objective of one's own, beside those that are minimised."""
    scene, inputs = springs_over_a_union()
    position = inputs[0]
    wish = scene.mesh.free.add_attribute(
        "wish", computed_attribute=0.5 * (position - [1, 2, 3]).dot(position - [1, 2, 3])
    )
    function = EnergyFunction(scene, position, energies=wish)
    (gradient,) = function.gradient(position.value)
    np.testing.assert_allclose(gradient.reshape(3, 3), position.value.reshape(3, 3) - [1, 2, 3], atol=1e-15)
    assert wish not in scene.energies
