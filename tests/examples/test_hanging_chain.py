"""The smallest example: what it computes is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from yasps.examples import hanging_chain


@pytest.mark.parametrize("beads", [1, 5])
def test_finds_the_rest(beads: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert hanging_chain.main(["--size", str(beads)]) == 0
    assert "at rest after" in capsys.readouterr().out


def test_notices_a_wrong_result(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(hanging_chain, "rest_positions", lambda beads: np.zeros((beads, 3)))
    assert hanging_chain.main([]) == 1
    assert "not where they must hang" in capsys.readouterr().err


def test_rest_is_a_balance_of_forces() -> None:
    """The closed form itself: no force is left on any bead."""
    scene, position = hanging_chain.build(hanging_chain.PROGRAM.options(["--size", "4"]))
    position.update_value(hanging_chain.rest_positions(4))
    (force,) = scene.gradient()
    assert np.abs(force).max() < 1e-12
