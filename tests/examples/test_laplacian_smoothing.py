"""The example checks its own final state."""

from __future__ import annotations

import pytest

from yasps.examples import laplacian_smoothing


def test_smooths_a_ball(capsys: pytest.CaptureFixture[str]) -> None:
    assert laplacian_smoothing.main(["--vertices", "1500"]) == 0
    assert "neighbours at most" in capsys.readouterr().out
