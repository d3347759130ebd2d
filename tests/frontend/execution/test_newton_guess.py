"""Newton systems whose solution is known about: conjugate gradients start there, if that is of use."""

from __future__ import annotations

import numpy as np
import pytest
from cuda_on_host import HostDevice
from device_checks import on_device
from device_scenes import SCENES

from yasps import Scene
from yasps.frontend.execution.newton_system import solve_newton_system, solve_options


@pytest.fixture(params=["cpu", "device"])
def scene(request: pytest.FixtureRequest) -> Scene:
    """On the processor and on a device made of the host."""
    made = SCENES["soft_tets"]()
    return made if request.param == "cpu" else on_device(made, HostDevice())


@pytest.mark.parametrize("share", [0.25, -2.0])
def test_starts_at_the_best_multiple_of_a_guess(scene: Scene, share: float) -> None:
    compiled, options = scene.compile(), solve_options(1e-12)
    plain = solve_newton_system(compiled, options)
    assert plain.report.iterations > 3
    found = solve_newton_system(compiled, options, guess=share * plain.x)
    assert found.report.iterations == 0
    np.testing.assert_allclose(found.x, plain.x, rtol=1e-4)


@pytest.mark.parametrize("number", [0.0, np.inf])
def test_a_guess_without_a_best_multiple_changes_nothing(scene: Scene, number: float) -> None:
    compiled, options = scene.compile(), solve_options(1e-12)
    plain = solve_newton_system(compiled, options)
    with np.errstate(invalid="ignore"):
        found = solve_newton_system(compiled, options, guess=np.full_like(plain.x, number))
    assert found.report.iterations == plain.report.iterations
    np.testing.assert_allclose(found.x, plain.x, rtol=1e-12)
