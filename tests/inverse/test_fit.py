"""Fits: what made a motion is found again, with bounds and transforms; what is kept in files; what is refused."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inverse_runs import Chain, chain

from yasps import DataError, NotConvergedError, SceneError
from yasps.inverse import LOG, InitialVelocity, Squares, Trajectory, fit, scaled
from yasps.stepping import BDF2

STEPS = 6


def wanted_motion() -> tuple[Trajectory, Chain, Squares]:
    """A run, and how far it is from the one with a stiffness of 5 N/m and other velocities."""
    simulation, body = chain(5.0, integrator=BDF2)
    trajectory = Trajectory(simulation, STEPS)
    trajectory.set(InitialVelocity(body), [0.5, -1.0, 2.0])
    trajectory.run()
    goal = body.vertices.add_constant("goal", 3, 1, value=body.positions())
    away = body.vertices.add_attribute("away", computed_attribute=body.position - goal)
    body.stiffness.update_value(2.0)
    trajectory.set(InitialVelocity(body), [0.0, 0.0, 0.0])
    return trajectory, body, Squares(away)


@pytest.mark.parametrize("method", ["L-BFGS-B", "trust-ncg"])
def test_what_made_a_motion_is_found(method: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trajectory, body, away = wanted_motion()
    velocity = InitialVelocity(body)
    chosen: dict[str, Any] = {"transforms": {body.stiffness: LOG, velocity: scaled(2.0)}}
    if method == "L-BFGS-B":
        chosen |= {"bounds": {body.stiffness: (1.0, 20.0)}, "options": {"ftol": 1e-20, "gtol": 1e-12}}
    else:
        chosen |= {"options": {"gtol": 1e-12}}
    file = tmp_path / "fit.npz"
    found = fit(trajectory, away, [body.stiffness, velocity], method=method, file=file, **chosen)
    assert found.value < 1e-15
    np.testing.assert_allclose(found[body.stiffness], 5.0, rtol=1e-6)
    np.testing.assert_allclose(found[velocity], [0.5, -1.0, 2.0], rtol=1e-6)
    assert found.history[0].value > 1e3 * found.value
    assert len(capsys.readouterr().err.splitlines()) == len(found.history)
    if method == "trust-ncg":
        assert len(found.history) < 12  # Gauss-Newton converges fast where the residual goes to 0
    body.stiffness.update_value(3.0)
    again = fit(trajectory, away, [body.stiffness, velocity], file=file, resume=True, progress=False, **chosen)
    assert len(again.history) >= len(found.history)
    assert again.value <= found.value


def test_bounds_hold() -> None:
    trajectory, body, away = wanted_motion()
    found = fit(trajectory, away, body.stiffness, bounds={body.stiffness: (1.0, 2.5)}, progress=False)
    assert found[body.stiffness] == pytest.approx(2.5)
    assert found.converged
    assert re.match(r"<Fit: \S+ after \d+ iterations, \d+ runs; converged", repr(found))
    assert trajectory.value(body.stiffness) == found[body.stiffness]


def test_refusals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trajectory, body, away = wanted_motion()
    k = body.stiffness
    with pytest.raises(SceneError, match="method is one of"):
        fit(trajectory, away, k, method="Nelder-Mead")
    with pytest.raises(SceneError, match="knows no bounds"):
        fit(trajectory, away, k, method="BFGS", bounds={k: (1.0, 2.0)})
    with pytest.raises(SceneError, match="bounds are of parameters of the fit"):
        fit(trajectory, away, k, bounds={body.mass: (1.0, 2.0)})
    for wrong, words in (
        ({"bounds": 3}, "bounds are a dictionary"),
        ({"transforms": 3}, "transforms are a dictionary"),
        ({"bounds": {k: 3}}, "bounds are a pair"),
        ({"transforms": {k: "log"}}, "a transform is LOG"),
    ):
        with pytest.raises(SceneError, match=words):
            fit(trajectory, away, k, **wrong)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="a list of attributes"):
        fit(trajectory, away, {k: (0.0, 1.0)})
    with pytest.raises(SceneError, match="a Trajectory"):
        fit(3, away, k)  # type: ignore[arg-type]
    with pytest.raises(DataError, match="in this order"):
        fit(trajectory, away, k, bounds={k: (2.0, 1.0)})
    with pytest.raises(SceneError, match="not of"):
        fit(trajectory, away, k, max_iterations=1, progress=False)["mass"]
    file = tmp_path / "fit.npz"
    fit(trajectory, away, k, max_iterations=1, file=file, progress=False)
    with pytest.raises(SceneError, match="of another fit"):
        fit(trajectory, away, body.mass, file=file, resume=True)
    file.write_bytes(file.read_bytes()[:-40])
    with pytest.raises(SceneError, match=r"fit\.npz holds no state of a fit"):
        fit(trajectory, away, k, file=file, resume=True)
    path = k.path
    np.savez(file, **{f"values/{path}": np.ones((2, 1, 1)), "history": np.zeros((0, 4))})  # type: ignore[arg-type]
    before = k.value.copy()
    with pytest.raises(SceneError, match="of another fit"):
        fit(trajectory, away, k, file=file, resume=True)
    assert np.array_equal(k.value, before)
    k.update_value(0.0)
    with pytest.raises(DataError, match="LOG of 0"):
        fit(trajectory, away, k, transforms={k: LOG})

    def fails() -> None:
        raise NotConvergedError("no step")

    monkeypatch.setattr(trajectory, "up_to_date", fails)
    with pytest.raises(NotConvergedError, match="no step") as caught:
        fit(trajectory, away, k)
    assert "in run 1 of a fit, with {'chain.stiffness'" in caught.value.__notes__[0]
