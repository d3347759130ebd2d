"""Which systems of a minimisation are tried unprojected with projection="auto"."""

from __future__ import annotations

import numpy as np

from yasps import NewtonSolution, SolveOptions
from yasps.runtime.solvers.pcg import SolveReport, StopReason
from yasps.stepping.projection_choice import LONGEST_PAUSE, ProjectionChoice

AUTO = SolveOptions(projection="auto")
SOLVED = SolveReport(StopReason.CONVERGED, 1, 0.0, None, None)


def asked_for(fails: str, steps: str) -> str:
    """a or p: which systems are tried as they are ("auto") or projected at once. fails: x where a try fails; steps: >
    where the step after the system is longer than 1."""
    choice, asked, lengths = ProjectionChoice(), "", []
    for fail, step in zip(fails, steps, strict=True):
        options = choice.options(AUTO, lengths)
        asked += {"auto": "a", "always": "p"}[options.projection]
        projected = options.projection == "always" or fail == "x"
        choice.learn(options, NewtonSolution(np.zeros(1), np.zeros(1), SOLVED, projected))
        lengths.append(2.0 if step == ">" else 1.0)
    return asked


def test_all_are_tried_while_none_fails() -> None:
    assert asked_for("....", "....") == "aaaa"


def test_a_failure_is_followed_by_projection_until_a_step_is_too_short() -> None:
    assert asked_for(".x.....", "....>..") == "aapppaa"


def test_pauses_double_until_a_try_succeeds() -> None:
    assert asked_for("x" * 18, ">" * 18) == "apappappppappppppp"
    assert asked_for("x.x...x..", ">" * 9) == "apappaapa"  # the third try succeeds, and the pause is 1 again
    many = asked_for("x" * 200, ">" * 200)
    assert max(map(len, many.split("a"))) == LONGEST_PAUSE


def test_other_projections_are_left_alone() -> None:
    for name in ("always", "on-demand"):
        options = SolveOptions(projection=name)
        choice = ProjectionChoice()
        assert choice.options(options, [2.0]) is options
        choice.learn(options, NewtonSolution(np.zeros(1), np.zeros(1), SOLVED, True))
        assert choice == ProjectionChoice()
