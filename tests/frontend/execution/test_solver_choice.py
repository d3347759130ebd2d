"""Solvers, projection on demand and histories as users reach them."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import Attribute, DataError, NotConvergedError, Scene
from yasps.runtime.solvers.pcg import StopReason
from yasps.stepping import NewtonSettings


def saddle(hold: float, projection: str = "clamp", dynamic: bool = False) -> tuple[Scene, Attribute]:
    """E = sum of (x0^2 - x1^2) / 2 + hold |x|^2 / 2 + x0 + x1 on two instances: exact Hessian diag(1, -1) + hold."""
    scene = Scene("saddle")
    points = scene.add_mesh("m").add_primitive("points", 2)
    x = points.add_attribute("x", 2, 1, value=np.zeros((2, 2)))
    bowl = 0.5 * (x[0] * x[0] - x[1] * x[1])
    scene.add_energy(points.add_attribute("saddle", computed_attribute=bowl), dynamic, projection)
    kept = 0.5 * hold * x.dot(x) + x[0] + x[1]
    scene.add_energy(points.add_attribute("hold", computed_attribute=kept))
    scene.add_minimize_target(x)
    return scene, x


def step(hold: float, solver: str, projection: str, of_energy: str = "clamp", dynamic: bool = False) -> np.ndarray:
    scene, _ = saddle(hold, of_energy, dynamic)
    return scene.minimize_energy(1e-20, solver=solver, projection=projection)[0].reshape(2, 2)


@pytest.mark.parametrize("solver", ["pcg", "direct", "auto"])
def test_on_demand_takes_the_exact_hessian_where_it_is_definite(solver: str) -> None:
    np.testing.assert_allclose(step(3.0, solver, "on-demand"), [[1 / 4, 1 / 2]] * 2, rtol=1e-9)
    np.testing.assert_allclose(step(3.0, solver, "always"), [[1 / 4, 1 / 3]] * 2, rtol=1e-9)


@pytest.mark.parametrize("solver", ["pcg", "direct", "auto"])
def test_on_demand_projects_where_the_exact_hessian_is_indefinite(solver: str) -> None:
    np.testing.assert_allclose(step(0.5, solver, "on-demand"), [[1 / 1.5, 2.0]] * 2, rtol=1e-9)


def test_auto_projects_what_changes_its_instances_and_all_where_that_is_not_enough() -> None:
    np.testing.assert_allclose(step(3.0, "pcg", "auto"), [[1 / 4, 1 / 2]] * 2, rtol=1e-9)
    np.testing.assert_allclose(step(0.5, "pcg", "auto"), [[1 / 1.5, 2.0]] * 2, rtol=1e-9)
    np.testing.assert_allclose(step(3.0, "pcg", "auto", dynamic=True), [[1 / 4, 1 / 3]] * 2, rtol=1e-9)


@pytest.mark.parametrize("projection", ["always", "on-demand", "auto"])
def test_energies_registered_without_projection_stay_as_they_are(projection: str) -> None:
    np.testing.assert_allclose(step(3.0, "pcg", projection, "none"), [[1 / 4, 1 / 2]] * 2, rtol=1e-9)
    scene, _ = saddle(0.5, "none")
    for solver in ("pcg", "direct"):
        solution = scene.solve(solver=solver, projection=projection)
        assert solution.report.reason is StopReason.NOT_POSITIVE_DEFINITE


def test_direct_breakdown_names_the_target() -> None:
    scene, _ = saddle(0.5, "none")
    with pytest.raises(NotConvergedError, match=r"broke down at m\.points\.x, instance \d"):
        scene.minimize_energy(solver="direct")


def test_history_and_who_solved() -> None:
    scene, _ = saddle(3.0)
    report = scene.solve(1e-20, history=True).report
    assert report.history is not None
    assert len(report.history) == report.iterations + 1
    assert report.history[0] == pytest.approx(1.0)
    assert report.history[-1] <= 1e-20
    assert not report.direct
    assert scene.solve(1e-20).report.history is None
    direct = scene.solve(1e-20, solver="direct").report
    assert direct.direct
    assert direct.why == "asked for"


def test_names_that_do_not_exist_are_refused() -> None:
    scene, _ = saddle(3.0)
    with pytest.raises(DataError, match="solver must be one of pcg, direct, auto, got 'cg'"):
        scene.solve(solver="cg")
    with pytest.raises(DataError, match="projection must be one of always, on-demand, auto, got 'never'"):
        scene.minimize_energy(projection="never")
    with pytest.raises(DataError, match="projection must be one of"):
        NewtonSettings(projection="clamp")
    with pytest.raises(DataError, match="solver must be one of"):
        NewtonSettings(solver="PCG")
    with pytest.raises(DataError, match="tolerance of the linear solver must be a finite number >= 0, got -1"):
        NewtonSettings(linear_tolerance=-1.0)
