"""The lever on springs of angles."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import SceneError, UnsupportedSceneError
from yasps.examples import lever
from yasps.program import CheckFailedError, Options


def options(*flags: str) -> Options:
    return lever.PROGRAM.options(["--size", "4", "--frames", "2", *flags])


def test_springs_at_rest_hang_straight_and_the_lever_droops_on_both_sides() -> None:
    (mobile,) = lever.build(options()).moving
    assert isinstance(mobile, lever.Mobile)
    below = np.array([0.0, 0.0, 3 * lever.LINK * np.cos(lever.SLANT)])
    ends = [mobile.rest[link + 1] for link in (3, 4, 8, 9, 13)]
    np.testing.assert_allclose(ends[0], -below, atol=1e-15)
    for side, hook, mass in ((-1.0, 1, 2), (1.0, 3, 4)):
        arm = lever.ARM * np.array([side * np.cos(lever.DROOP), 0.0, -np.sin(lever.DROOP)])
        np.testing.assert_allclose(ends[hook], ends[0] + arm, atol=1e-15)
        np.testing.assert_allclose(ends[mass], ends[hook] - below, atol=1e-15)
    assert mobile.mass.value[[9, 14]] == pytest.approx(lever.MASSES)
    assert mobile.mass.value.sum() == pytest.approx(sum(lever.MASSES))


def test_a_zigzag_of_one_link_is_refused() -> None:
    with pytest.raises(SceneError, match="a zigzag has at least 2 links, got 1"):
        lever.build(options("--size", "1"))


def test_so_many_links_that_a_mass_reads_too_many_angles_are_refused() -> None:
    with pytest.raises(UnsupportedSceneError, match=r"61 instances .*vertices.links times up to 30 .*links.joints"):
        lever.build(options("--size", "30")).run(1)


@pytest.mark.slow
def test_moments_by_hand_are_the_gradient_and_the_check_sees_what_is_wrong() -> None:
    simulation = lever.build(options())
    assert lever.check(simulation, options()) == "nothing has moved yet"
    simulation.run(2)
    assert "all joints are in balance" in lever.check(simulation, options())
    (mobile,) = simulation.moving
    assert isinstance(mobile, lever.Mobile)
    here = mobile.angle.value
    mobile.angle.update_value(here + np.random.default_rng(0).normal(0.0, 0.1, here.shape))
    of_yasps = sum(forces["mobile.joints.angle"] for forces in simulation.forces_by_term().values())
    _, left = lever.out_of_balance(simulation)
    np.testing.assert_allclose(left, np.ravel(of_yasps), atol=1e-10 * np.abs(left).max())
    with pytest.raises(CheckFailedError, match=r"joint \d+ is out of balance"):
        lever.check(simulation, options())
    mobile.angle.update_value(here)
    mobile.rest = mobile.rest - [0.0, 0.0, 0.5]
    with pytest.raises(CheckFailedError, match="but only -"):
        lever.check(simulation, options())
