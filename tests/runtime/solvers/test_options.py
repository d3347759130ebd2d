"""The options of a linear solve."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from yasps.runtime.solvers.options import SolveOptions


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": float("nan")}, "tolerance of the linear solver must be a finite number >= 0, got nan"),
        ({"tolerance": -1e-4}, "tolerance of the linear solver must be a finite number >= 0, got -0.0001"),
        ({"tolerance": float("inf")}, "tolerance of the linear solver must be a finite number >= 0, got inf"),
        ({"tolerance": True}, "tolerance of the linear solver must be a finite number >= 0, got True"),
        ({"max_iterations": -1}, "max_iterations of the linear solver must be an integer >= 0, got -1"),
        ({"max_iterations": 1.5}, "max_iterations of the linear solver must be an integer >= 0, got 1.5"),
        ({"max_iterations": 2**31}, "max_iterations of the linear solver must be an integer >= 0, got 2147483648"),
        ({"solver": "cg"}, "solver must be one of pcg, direct, auto, got 'cg'"),
        ({"preconditioner": "ilu"}, "preconditioner must be one of auto, jacobi, gauss-seidel, two-level, got 'ilu'"),
        ({"projection": "never"}, "projection must be one of always, on-demand, auto, got 'never'"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        SolveOptions(**options)


def test_numbers_of_numpy_are_numbers() -> None:
    assert SolveOptions(np.float32(0.5), np.int32(3)) == SolveOptions(0.5, 3)  # type: ignore[arg-type]
