"""Equilibria under a load that grows from nothing to all of it, without inertia."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from numpy.typing import ArrayLike

from yasps import Attribute, NotConvergedError, NotFiniteError, Scene, SceneError, YaspsError
from yasps.contact import BarrierContact
from yasps.frontend.language.arrays import positive_number
from yasps.output import TimeTable
from yasps.stepping.forces import Arms
from yasps.stepping.motion import Motion
from yasps.stepping.newton import minimize
from yasps.stepping.settings import NewtonReport, NewtonSettings

LOGGER = logging.getLogger("yasps")

EASY = 8
"""Newton iterations up to which a load step counts as easy; the next one is then larger."""
LARGER = 1.5


@dataclass(frozen=True)
class LoadStep:
    """An equilibrium: under which share of the load, and what Newton's method took to find it."""

    load: float
    newton: NewtonReport


def quasi_static(
    scene: Scene,
    positions: Sequence[Attribute],
    set_load: Callable[[float], None],
    *,
    contact: BarrierContact | None = None,
    settings: NewtonSettings = NewtonSettings(velocity_tolerance=None, relative_force_tolerance=1e-8, solver="direct"),
    first: float = 0.1,
    smallest: float = 1e-4,
    arms: Arms | None = None,
    fixed: Mapping[Attribute, ArrayLike] | None = None,
    after_step: Callable[[LoadStep], None] | None = None,
    times: TimeTable | None = None,
) -> list[LoadStep]:
    """Moves the scene's targets along equilibria from no load to the whole; returns these, the last of load 1.

    The scene has no inertia. set_load: gives the scene a share of the load, from 0 to 1: dead loads, gravity, places of
    what is held, stiffnesses; it may move fixed instances of targets. Each load begins at the equilibrium of the last
    one. A load step that fails with NotConvergedError or NotFiniteError is halved, and one that Newton's method found
    easy makes the next half as large again. first: the load step to begin with; smallest: the one with which it is
    given up. positions, contact, settings (a velocity tolerance is one of metres here), arms, fixed: see `minimize`.
    after_step: called at each equilibrium. Friction is lagged, and slips count, from load step to load step.

    Where a branch of equilibria ends, as a shallow arch does when it snaps, Newton's method goes downhill to another
    one. On the way there the Hessian may have nothing left in some direction once it is clamped: register such energies
    with projection="abs".

    Raises NotConvergedError, with the last load that held, whose equilibrium is kept; IntersectionError; SceneError for
    steps that can't be. After any error targets and load are those of the last equilibrium.
    """
    step = positive_number(first, "first", "of the load", SceneError)
    smallest = positive_number(smallest, "smallest", "of the load", SceneError)
    if step > 1 or smallest > step:
        raise SceneError(f"the first load step is at most 1 and at least the smallest, got {first} and {smallest}")
    found: list[LoadStep] = []
    with scene.lock:
        while not found or found[-1].load < 1.0:
            load = found[-1].load if found else 0.0
            tried = min(1.0, load + step) if found else 0.0
            motion, past = Motion(scene), None if contact is None else contact.save()
            try:
                if contact is not None:
                    contact.start_step()
                set_load(tried)
                report = minimize(
                    scene, positions, 1.0, contact=contact, settings=settings, times=times, arms=arms, fixed=fixed
                )
            except YaspsError as error:
                set_load(load)
                motion.write(motion.start)
                if contact is not None and past is not None:
                    contact.load(past)
                if not isinstance(error, NotConvergedError | NotFiniteError):
                    raise
                if not found or step <= smallest:
                    raise NotConvergedError(
                        f"no equilibrium under {tried:.6g} of the load: {error}. "
                        + (f"The last one is under {load:.6g}, {len(found)} load steps" if found else "It is the first")
                    ) from error
                step = max(0.5 * step, smallest)
                LOGGER.info("load step to %.6g failed; the next one is %.3g: %s", tried, step, error)
                continue
            found.append(LoadStep(tried, report))
            if after_step is not None:
                after_step(found[-1])
            if report.iterations <= EASY and tried > 0:
                step *= LARGER
    return found
