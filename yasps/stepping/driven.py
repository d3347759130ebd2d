"""Vertices whose positions are prescribed: moving obstacles, and pins.

`Driven` says where they shall be, `DrivenSurface` and `DrivenVertices` how they can be put there, held there and pushed
towards it; `Arrival` of `yasps.stepping.arrival` does that in every step.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, FloatArray, Primitive, PrimitiveBase, SceneError, ShapeMismatchError
from yasps.frontend.language.arrays import plain_array, real_numbers
from yasps.stepping.anchors import Anchors

Prescribed: TypeAlias = Callable[[float], ArrayLike] | ArrayLike
"""Positions [m]: a function of time [s] that gives [n, 3]; [steps + 1, n, 3], at time 0 and at the end of each time
step, the last ones from then on; or [n, 3], where to be at the end of the next step, and from then on."""

PUSH = 10.0
"""Stiffness of all that pushes one thing at first, in masses of all that moves over the squared time step."""
HOLD = 1e3
"""The same of each anchor that holds."""
AT_ONCE = 1e-9
"""Share of a time step that is rounding."""


class Driven(ABC):
    """Vertices that are where somebody says.

    name: for messages. position: of all vertices of their primitive, 3x1; vertices: which of them, [n]. spacing [s]:
    between the rows of a table of positions. multiplier: what holds them at their place, beside the stiffness;
    velocity: in the last step [m/s], [n, 3].
    """

    is_exact: bool
    """Whether they can be put at a place; else they are only pulled there."""

    def __init__(self, name: str, position: Attribute, vertices: NDArray[np.int64], spacing: float) -> None:
        """At rest."""
        self.name, self.position, self.vertices, self.spacing = name, position, vertices, spacing
        self.multiplier: FloatArray = np.zeros(1)
        self.velocity: FloatArray = np.zeros((len(vertices), 3))
        self.is_released = False

    # -- where to be ---------------------------------------------------------------------------------------

    @property
    @abstractmethod
    def motion(self) -> Prescribed | None:
        """What prescribes the positions; None: they stay."""

    @motion.setter
    @abstractmethod
    def motion(self, motion: Prescribed | None) -> None: ...

    def positions(self) -> FloatArray:
        """Where they are now [m], [n, 3]."""
        return np.asarray(self.position.compute().array.reshape(-1, 3)[self.vertices])

    def goal(self, start: float, end: float, until: float) -> FloatArray:
        """Where to be at time `end` [s] after a step from `start`, which is part of one until `until`; [n, 3].

        Raises DataError, ShapeMismatchError.
        """
        motion = self.motion
        if motion is None:
            return self.positions()
        what = f"the motion of {self.name}"
        if callable(motion):
            what = f"{what} at t = {end:.6g} s"
            try:
                asked = motion(end)
            except Exception as error:
                error.add_note(f"{what} raised this; nothing has moved in this step")
                raise
            return self.checked(asked, what)
        given = plain_array(motion, what)
        if given.ndim == 3 and len(given) == 0:
            raise ShapeMismatchError(f"{what} is a table of positions without a row")
        if given.ndim != 3:
            goal, share = self.checked(given, what), (end - start) / (until - start)
            return goal if share > 1 - AT_ONCE else self.positions() + share * (goal - self.positions())
        row = min(end / self.spacing, len(given) - 1.0)
        low = int(row + AT_ONCE * max(row, 1.0))
        share = max(row - low, 0.0)
        first = self.checked(given[low], f"{what}, row {low}")
        if share <= AT_ONCE * max(row, 1.0):
            return first
        return (1 - share) * first + share * self.checked(given[low + 1], f"{what}, row {low + 1}")

    def checked(self, positions: ArrayLike, what: str) -> FloatArray:
        """A copy of positions [n, 3]. Raises DataError, ShapeMismatchError."""
        values, wanted = real_numbers(positions, what), (len(self.vertices), 3)
        if values.shape != wanted:
            raise ShapeMismatchError(f"{what}: positions are {list(wanted)}, got {list(values.shape)}")
        return values.copy()

    def distance(self, goal: FloatArray) -> float:
        """How far the farthest vertex is from there [m]."""
        return float(np.linalg.norm(self.positions() - goal, axis=1).max(initial=0.0))

    # -- how to get there ----------------------------------------------------------------------------------

    @abstractmethod
    def begin(self, goal: FloatArray) -> None:
        """Before a step to there."""

    @abstractmethod
    def stiffness(self, goal: FloatArray, mass: float) -> float:
        """At first; mass: all that moves over the squared time step [N/m]."""

    @abstractmethod
    def pull(self, goal: FloatArray, stiffness: float) -> None:
        """Pulls there, with the force of the multiplier at the place itself: k/2 |x - x*|^2 - l . (x - x*) but for a
        constant, that is a spring to x* + l / k."""

    @abstractmethod
    def learn(self, goal: FloatArray, stiffness: float) -> None:
        """Adds to the multiplier what pulls at the present place."""

    @abstractmethod
    def let_go(self) -> None:
        """Pulls no more."""

    def put(self, goal: FloatArray) -> None:
        """Sets the positions; of exact ones alone."""
        raise NotImplementedError(f"{self.name} can't be put anywhere")

    def fixed(self) -> tuple[Attribute, NDArray[np.int64]] | None:
        """The target and its instances that stay while these vertices stay; None if there are none."""
        return None

    def save(self) -> tuple[Any, ...]:
        """All that a step changes, but for targets."""
        return self.multiplier.copy(), self.velocity.copy()

    def load(self, state: tuple[Any, ...]) -> None:
        """Puts it back."""
        self.multiplier, self.velocity = state[0].copy(), state[1].copy()


def checked_motion(motion: Prescribed | None, count: int, what: str) -> Prescribed | None:
    """A copy of the motion of so many vertices, of whose rows the first is looked at; functions are looked at when they
    are asked. Raises DataError, ShapeMismatchError."""
    if motion is None or callable(motion):
        return motion
    values = real_numbers(motion, what)
    shape = values.shape[1:] if values.ndim == 3 and len(values) else values.shape
    if shape != (count, 3):
        raise ShapeMismatchError(f"{what}: positions are {[count, 3]}, got {list(values.shape)}")
    return values.copy()


class Moved(Protocol):
    """A moving obstacle; `yasps.bodies.MovingObstacle` is one."""

    name: str
    motion: Prescribed | None
    vertices: PrimitiveBase
    course: Primitive
    progress: Attribute


class DrivenSurface(Driven):
    """A whole surface that moves along its way: one unknown says how far it has come, so that nothing bends it."""

    is_exact = True

    def __init__(self, obstacle: Moved, spacing: float) -> None:
        """Where the obstacle is."""
        vertices = obstacle.vertices
        super().__init__(obstacle.name, vertices["position"], np.arange(vertices.num_instances), spacing)
        self.obstacle = obstacle

    @property
    def motion(self) -> Prescribed | None:
        """The obstacle's."""
        return self.obstacle.motion

    @motion.setter
    def motion(self, motion: Prescribed | None) -> None:
        self.obstacle.motion = motion

    def _set(self, start: FloatArray, way: FloatArray, progress: float) -> None:
        self.obstacle.vertices["start"].update_value(start)
        self.obstacle.vertices["way"].update_value(way)
        self.obstacle.progress.update_value(progress)

    def begin(self, goal: FloatArray) -> None:
        """The way is from here to there."""
        here = self.positions()
        self._set(here, goal - here, 0.0)
        self.multiplier = np.zeros(1)

    def put(self, goal: FloatArray) -> None:
        """No way is left."""
        self._set(goal, np.zeros_like(goal), 0.0)

    def stiffness(self, goal: FloatArray, mass: float) -> float:
        """In joules: of progress."""
        way = self.obstacle.vertices["way"].value
        return PUSH * mass * max(float((way.reshape(-1, 3) ** 2).sum(axis=1).max(initial=0.0)), 1e-300)

    def pull(self, goal: FloatArray, stiffness: float) -> None:
        """To progress 1."""
        self.obstacle.course["pull"].update_value(stiffness)
        self.obstacle.course["aim"].update_value(1.0 + self.multiplier / stiffness)

    def learn(self, goal: FloatArray, stiffness: float) -> None:
        """In joules."""
        self.multiplier = self.multiplier - stiffness * (self.obstacle.progress.value - 1.0)

    def let_go(self) -> None:
        """Nothing pulls."""
        self.obstacle.course["pull"].update_value(0.0)

    def fixed(self) -> tuple[Attribute, NDArray[np.int64]]:
        """Progress."""
        return self.obstacle.progress, np.zeros(1, np.int64)

    def save(self) -> tuple[Any, ...]:
        """With the way."""
        vertices = self.obstacle.vertices
        way = (vertices["start"].value, vertices["way"].value, self.obstacle.progress.value)
        return (*super().save(), way)

    def load(self, state: tuple[Any, ...]) -> None:
        """With the way."""
        super().load(state)
        self._set(*state[2])
        self.let_go()


class DrivenVertices(Driven):
    """Vertices of a body, each for itself. They can be put where they shall be if their position is a target."""

    def __init__(
        self,
        name: str,
        position: Attribute,
        vertices: NDArray[np.int64],
        anchors: Anchors,
        motion: Prescribed | None,
        *,
        spacing: float,
        is_exact: bool,
    ) -> None:
        """Raises DataError, ShapeMismatchError for a motion of another shape."""
        super().__init__(name, position, vertices, spacing)
        self.anchors, self.is_exact = anchors, is_exact
        self.multiplier = np.zeros((len(vertices), 3))
        self._motion: Prescribed | None = None
        self.follow(motion)

    @property
    def motion(self) -> Prescribed | None:
        """As given last."""
        return self._motion

    @motion.setter
    def motion(self, motion: Prescribed | None) -> None:
        self._motion = motion

    def follow(self, motion: Prescribed | None) -> None:
        """Another motion, from the next step on; None stays. Raises DataError, ShapeMismatchError, SceneError for pins
        that were released."""
        self._check_held()
        self._motion = checked_motion(motion, len(self.vertices), f"the motion of {self.name}")

    def move_to(self, places: ArrayLike) -> None:
        """Other places [m], [n, 3], for the end of the next step. Raises DataError, ShapeMismatchError, SceneError for
        pins that were released."""
        self._check_held()
        self._motion = self.checked(places, f"the places of {self.name}")

    def _check_held(self) -> None:
        if self.is_released:
            raise SceneError(f"{self.name} was released: pin the vertices again")

    def release(self) -> None:
        """Lets go of them from the next step on; nothing is compiled again."""
        self.is_released = True
        self.anchors.let_go()

    def begin(self, goal: FloatArray) -> None:
        """What held them in the last step holds them still, if they can't be put."""
        if self.is_exact:
            self.multiplier = np.zeros_like(goal)

    def put(self, goal: FloatArray) -> None:
        """Sets the target."""
        values = self.position.value.reshape(-1, 3)
        values[self.vertices] = goal
        self.position.update_value(values)

    def stiffness(self, goal: FloatArray, mass: float) -> float:
        """Of each anchor [N/m]."""
        return PUSH * mass / max(len(self.vertices), 1) if self.is_exact else HOLD * mass

    def pull(self, goal: FloatArray, stiffness: float) -> None:
        """By springs."""
        self.anchors.hold(self.vertices, goal + self.multiplier / stiffness, stiffness)

    def learn(self, goal: FloatArray, stiffness: float) -> None:
        """In newtons."""
        self.multiplier = self.multiplier - stiffness * (self.positions() - goal)

    def let_go(self) -> None:
        """No springs."""
        self.anchors.let_go()

    def fixed(self) -> tuple[Attribute, NDArray[np.int64]] | None:
        """The vertices."""
        return (self.position, self.vertices) if self.is_exact else None

    def load(self, state: tuple[Any, ...]) -> None:
        """Without springs, if they are not needed."""
        super().load(state)
        if self.is_exact:
            self.let_go()
