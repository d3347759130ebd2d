"""The bunny of four parts."""

from __future__ import annotations

import numpy as np
import pytest

from yasps.examples import mixed_material_bunny as example
from yasps.program import CheckFailedError


@pytest.mark.slow
def test_parts_move_as_they_should_and_the_check_sees_what_is_wrong() -> None:
    options = example.PROGRAM.options(["--size", "1500", "--frames", "3"])
    simulation = example.build(options)
    (mixed,) = simulation.moving
    assert isinstance(mixed, example.MixedBunny)
    np.testing.assert_allclose(mixed.positions(), mixed.rest, atol=1e-15)
    assert mixed.mass.value.sum() == pytest.approx(example.DENSITY * example.bunny(options).volumes().sum())
    simulation.run(3)
    assert "the middle has not moved" in example.check(simulation, options)
    x = mixed.positions()
    free, fixed = mixed.mesh.soft.num_instances, mixed.fixed.num_instances
    assert not np.isclose(x[:free], mixed.rest[:free], atol=1e-6).all(axis=1).any()
    np.testing.assert_array_equal(x[-fixed:], mixed.rest[-fixed:])
    stiff = slice(free, -fixed)
    for end in (mixed.rest[stiff, 2] < 0, mixed.rest[stiff, 2] > 0):  # one affine map each
        places = np.column_stack([mixed.rest[stiff][end], np.ones(int(end.sum()))])
        _, residual, rank, _ = np.linalg.lstsq(places, x[stiff][end])
        assert rank == 4
        assert residual.max() < 1e-20
    feet, ears = example.turns(mixed)
    expected = example.SPIN * simulation.time
    assert feet == pytest.approx(-expected, rel=0.1)
    assert 0.5 * expected < ears < 1.02 * expected

    matrices = mixed.matrix.value
    mixed.matrix.update_value(1.1 * matrices)
    with pytest.raises(CheckFailedError, match=r"an end is strained by 0\.21, though it is stiff"):
        example.check(simulation, options)
    mixed.matrix.update_value(matrices)
    soft = mixed.mesh.soft["position"]
    before = soft.value
    soft.update_value(-before)
    with pytest.raises(CheckFailedError, match=r"tetrahedron \d+ is inside out"):
        example.check(simulation, options)
    soft.update_value(before)
    simulation.stepper.velocities[0] *= 3.0
    with pytest.raises(CheckFailedError, match="but was given"):
        example.check(simulation, options)
    mixed.fixed["position"].update_value(mixed.rest[-fixed:] + 1e-3)
    with pytest.raises(CheckFailedError, match="the middle has moved"):
        example.check(simulation, options)
