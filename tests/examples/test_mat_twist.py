"""The mat that is twisted."""

from __future__ import annotations

import numpy as np
import pytest

from yasps.examples import mat_twist
from yasps.program import CheckFailedError


def test_a_turn_is_about_the_x_axis_and_counter_clockwise() -> None:
    quarter = mat_twist.turned(np.array([[1.0, 2.0, 3.0]]), 0.5 * np.pi)
    np.testing.assert_allclose(quarter, [[1.0, -3.0, 2.0]], atol=1e-15)


@pytest.mark.slow
def test_the_check_sees_ends_that_turn_otherwise_and_a_mat_that_does_not_meet_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    options = mat_twist.PROGRAM.options(["--size", "16", "--frames", "1"])
    simulation = mat_twist.build(options)
    simulation.run(1)
    assert "turned by 0.04 rad against the other: it has not met itself" in mat_twist.check(simulation, options)
    with pytest.raises(CheckFailedError, match=r"an end is .* from where it was turned to"):
        mat_twist.check(simulation, mat_twist.PROGRAM.options(["--speed", "10"]))
    monkeypatch.setattr(mat_twist, "MEETS_ITSELF", 0.03)
    with pytest.raises(CheckFailedError, match=r"does not meet itself after a turn of 0\.04 rad"):
        mat_twist.check(simulation, options)
    monkeypatch.setattr(mat_twist, "OFF_AXIS", -1.0)
    with pytest.raises(CheckFailedError, match="the centre of the mat has moved"):
        mat_twist.check(simulation, options)
