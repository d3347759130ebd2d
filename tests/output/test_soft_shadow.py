"""The shadow on the ground."""

import numpy as np
import pytest

from yasps.output.soft_shadow import soft_shadow

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


def shadow_of(*bodies):
    return soft_shadow([(body, TRIANGLES) for body in bodies], 0.0, np.zeros(2), 10.0, 4.0)


def middle(shadow):
    """Centre of darkness (x, y) in the unit of the vertices."""
    ticks = (np.arange(len(shadow)) + 0.5) / len(shadow) * 10 - 5
    return np.array([(shadow.sum(0) * ticks).sum(), (shadow.sum(1) * ticks).sum()]) / shadow.sum()


def test_a_plate_on_the_ground_darkens_what_it_covers_and_nothing_far_away():
    shadow = shadow_of(SQUARE + np.array([0.5, -1.5, 0.01]))
    np.testing.assert_allclose(middle(shadow), [0.5, -1.5], atol=0.03)
    assert shadow[179, 281] == pytest.approx(0.34, rel=0.02)  # no holes between samples
    assert shadow[460, 51] == 0.0
    # The blur keeps the total: darkness times covered area.
    assert shadow.sum() * (10 / 512) ** 2 == pytest.approx(0.34 * 4.0, rel=0.02)


def test_a_higher_plate_casts_a_softer_shadow_away_from_the_light():
    low, high = shadow_of(SQUARE + np.array([0, 0, 0.01])), shadow_of(SQUARE + np.array([0, 0, 2.0]))
    assert high.max() < 0.6 * low.max()
    np.testing.assert_allclose(middle(high), [0.6, 0.5], atol=0.05)


def test_what_lies_below_the_ground_casts_no_shadow():
    assert shadow_of(SQUARE - [0, 0, 0.5]).max() == 0.0


def test_the_shadow_is_the_same_every_time_and_bounded():
    bodies = [SQUARE + np.array([0, 0, height]) for height in (0.01, 0.3, 0.8, 2.0)]
    shadow = shadow_of(*bodies)
    np.testing.assert_array_equal(shadow, shadow_of(*bodies))
    assert 0.0 <= shadow.min() <= shadow.max() < 1.0
