"""Time steps that fail are tried again in two halves, and these in halves again."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

from yasps import NotConvergedError, NotFiniteError
from yasps.stepping.settings import NewtonReport
from yasps.stepping.time_stepper import TimeStepper

LOGGER = logging.getLogger("yasps")


def step_or_halves(
    stepper: TimeStepper, set_time_step: Callable[[float], None], levels: int, until: float | None = None
) -> NewtonReport:
    """One time step of the stepper, or, where it fails with NotConvergedError or NotFiniteError, two of half the size,
    and so on: up to 2^levels. The report says how many it took.

    set_time_step: gives scene and stepper another step [s]; nothing compiles for it. until: see `TimeStepper.step`.
    Raises what `TimeStepper.step` raises, and what motions of the user's own raise, with everything as it was before
    the step.
    """
    before, seconds = stepper.save(), stepper.time_step
    until = stepper.time + seconds if until is None else until
    try:
        return stepper.step(until)
    except (NotConvergedError, NotFiniteError) as error:
        stepper.load(before)
        if levels == 0:
            raise
        LOGGER.warning(
            "the time step at t = %.6g s did not work out; it is tried in two of %.3g s: %s",
            stepper.time,
            0.5 * seconds,
            error,
        )
    except BaseException:
        stepper.load(before)
        raise
    try:
        set_time_step(0.5 * seconds)
        first = step_or_halves(stepper, set_time_step, levels - 1, until)
        second = step_or_halves(stepper, set_time_step, levels - 1, until)
        return replace(first.followed_by(second), substeps=first.substeps + second.substeps)
    except BaseException:
        stepper.load(before)
        raise
    finally:
        set_time_step(seconds)
