"""Fits parameters to an objective by the optimisers of SciPy, with gradients through runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from rich.console import Console

from yasps import DataError, FloatArray, SceneError, YaspsError
from yasps.frontend.language.arrays import checked_count, positive_number, real_numbers
from yasps.inverse.checks import checked_objectives, checked_parameters
from yasps.inverse.gradients import Gradient, gradient_of
from yasps.inverse.objectives import Squares
from yasps.inverse.parameters import Parameter, names_of
from yasps.inverse.sensitivities import gauss_newton_product
from yasps.inverse.trajectory import Trajectory
from yasps.simulation.state_files import read_arrays, write_arrays

METHODS = ("L-BFGS-B", "trust-constr", "SLSQP", "TNC", "BFGS", "CG", "Newton-CG", "trust-ncg", "trust-krylov")
"""Of `scipy.optimize.minimize`: those that take gradients."""
BOUNDED = ("L-BFGS-B", "trust-constr", "SLSQP", "TNC")
"""Those that keep bounds."""
BY_PRODUCTS = ("trust-constr", "Newton-CG", "trust-ncg", "trust-krylov")
"""Those that take products with the Hessian."""


@dataclass(frozen=True)
class Transform:
    """What an optimiser changes instead of a parameter: a monotone function of each number, and back."""

    to_free: Callable[[FloatArray], FloatArray]
    to_value: Callable[[FloatArray], FloatArray]
    slope: Callable[[FloatArray], FloatArray]
    """Derivative of `to_value` by what is free."""


LOG = Transform(np.log, np.exp, np.exp)
"""For what is positive and known to an order of magnitude: the optimiser sees its logarithm."""


def scaled(unit: float) -> Transform:
    """The optimiser sees multiples of a unit, about as large as what the parameter may change by. Raises DataError."""
    size = positive_number(unit, "the unit of a scaled parameter", "")
    return Transform(lambda x: x / size, lambda y: y * size, lambda y: np.full_like(y, size))


@dataclass(frozen=True)
class Iteration:
    """One of an optimiser: the objective, and the largest entry of its gradient by what is free."""

    number: int
    value: float
    slope: float
    runs: int
    """Of the trajectory so far."""


@dataclass(repr=False)
class Fit:
    """What a fit has come to: the objective, and the values of the parameters by name."""

    value: float
    values: dict[str, FloatArray]
    converged: bool
    reason: str
    """In the words of SciPy."""
    history: list[Iteration] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    """Of the gradient at the end."""

    def __repr__(self) -> str:
        runs = self.history[-1].runs if self.history else 0
        end = "converged" if self.converged else "not converged"
        return f"<Fit: {self.value:.6g} after {len(self.history)} iterations, {runs} runs; {end}: {self.reason}>"

    def __getitem__(self, parameter: object) -> FloatArray:
        """By a parameter, or its name. Raises SceneError."""
        for name in names_of(parameter):
            if name in self.values:
                return self.values[name]
        raise SceneError(f"the fit is of {', '.join(self.values)}, not of {parameter!r}")


def fit(
    trajectory: Trajectory,
    objective: object,
    parameters: object,
    *,
    method: str = "L-BFGS-B",
    bounds: Mapping[Any, tuple[ArrayLike, ArrayLike]] | None = None,
    transforms: Mapping[Any, Transform] | None = None,
    max_iterations: int = 100,
    options: Mapping[str, Any] | None = None,
    file: str | Path | None = None,
    resume: bool = False,
    progress: bool = True,
) -> Fit:
    """Makes an objective small by `scipy.optimize.minimize`, from where the parameters are now; they are at what was
    found afterwards, and so is the run.

    objective, parameters: as `gradient_of`. method: one of `METHODS`; where it takes products with the Hessian and all
    objectives are `Squares`, these are Gauss-Newton products. bounds: parameter -> lowest and highest numbers, each one
    for all or in the parameter's shape. transforms: parameter -> `LOG`, `scaled(unit)` or a `Transform` of yours.
    options: of the method, see SciPy. file: where values and history are written after each iteration; resume: begin
    with what is there, should there be something (an optimiser's memory of earlier steps is not in it). progress: a
    line for each iteration on stderr.

    Raises what a run raises, with a note that says the values it was tried with; SceneError, DataError.
    """
    from scipy import optimize

    if not isinstance(trajectory, Trajectory):
        raise SceneError(f"what is fitted is a Trajectory, got {trajectory!r}")
    if method not in METHODS:
        raise SceneError(f"method is one of {', '.join(METHODS)}, got {method!r}")
    chosen, objectives = checked_parameters(trajectory, parameters), checked_objectives(trajectory, objective)
    search = _Search(trajectory, objective, chosen, _by_name(chosen, transforms, "transforms"), progress)
    limits = _by_name(chosen, bounds, "bounds")
    if limits and method not in BOUNDED:
        raise SceneError(f"{method} knows no bounds: take one of {', '.join(BOUNDED)}")
    place = None if file is None else Path(file)
    if place is not None and resume and place.exists():
        search.restore(place)
    search.file = place
    start = search.free()
    if not np.isfinite(start).all():
        raise DataError("the parameters are outside of what their transforms are made for, such as LOG of 0")
    keywords: dict[str, Any] = {}
    if limits:
        keywords["bounds"] = optimize.Bounds(*search.free_bounds(limits))
    if method in BY_PRODUCTS and all(isinstance(one, Squares) for one in objectives):
        keywords["hessp"] = lambda x, d: search.product(objectives, x, d)
    limit = {"maxiter": checked_count(max_iterations, "max_iterations", 1)}
    minimize: Any = optimize.minimize  # its stubs know methods by their names, not by a variable
    found = minimize(
        search.value_and_slope,
        start,
        jac=True,
        method=method,
        callback=search.after_iteration,
        options={**limit, **(options or {})},
        **keywords,
    )
    gradient = search.at(np.asarray(found.x))
    values = {one.name: one.value(trajectory) for one in chosen}
    return Fit(gradient.value, values, bool(found.success), str(found.message), search.history, gradient.warnings)


def _by_name(chosen: list[Parameter], given: Mapping[Any, Any] | None, what: str) -> dict[str, Any]:
    """By the names of parameters. Raises SceneError for others."""
    if given is not None and not isinstance(given, Mapping):
        raise SceneError(f"{what} are a dictionary, parameter -> what is for it, got {given!r}")
    known, found = {one.name for one in chosen}, {}
    for parameter, value in (given or {}).items():
        names = known.intersection(names_of(parameter))
        if not names:
            raise SceneError(f"{what} are of parameters of the fit, {', '.join(known)}, got {parameter!r}")
        if what == "transforms" and not isinstance(value, Transform):
            raise SceneError(f"a transform is LOG, scaled(unit) or a Transform, got {value!r}")
        if what == "bounds" and (isinstance(value, str) or not isinstance(value, Sequence) or len(value) != 2):
            raise SceneError(f"bounds are a pair, the lowest and the highest number, got {value!r}")
        found[names.pop()] = value
    return found


class _Search:
    """The objective as a function of free numbers, one vector."""

    def __init__(
        self,
        trajectory: Trajectory,
        objective: object,
        parameters: list[Parameter],
        transforms: dict[str, Transform],
        progress: bool,
    ) -> None:
        self.trajectory, self.objective, self.parameters = trajectory, objective, parameters
        self.transforms = transforms
        self.console = Console(stderr=True) if progress else None
        self.file: Path | None = None
        self.history: list[Iteration] = []
        self.runs = 0
        self._x: FloatArray = np.empty(0)
        self._gradient: Gradient | None = None
        self._begin = time.perf_counter()

    def _split(self, x: FloatArray) -> list[FloatArray]:
        sizes = [one.size(self.trajectory) for one in self.parameters]
        return np.split(x, np.cumsum(sizes)[:-1])

    def free(self) -> FloatArray:
        """Where the parameters are now."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.concatenate([self._freed(one, one.value(self.trajectory)) for one in self.parameters])

    def _freed(self, parameter: Parameter, values: FloatArray) -> FloatArray:
        transform = self.transforms.get(parameter.name)
        return np.array(values if transform is None else transform.to_free(values), np.float64).reshape(-1)

    def free_bounds(self, limits: dict[str, tuple[ArrayLike, ArrayLike]]) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest free numbers. Raises DataError."""
        sides: tuple[list[FloatArray], list[FloatArray]] = ([], [])
        for one in self.parameters:
            value = one.value(self.trajectory)
            low, high = limits.get(one.name, (-np.inf, np.inf))
            for side, given, none in ((sides[0], low, -np.inf), (sides[1], high, np.inf)):
                numbers = np.broadcast_to(real_numbers(given, f"the bounds of {one.name}", finite=False), value.shape)
                with np.errstate(divide="ignore", invalid="ignore"):
                    freed = self._freed(one, numbers)
                side.append(np.where(np.isinf(numbers.reshape(-1)) | np.isnan(freed), none, freed))
        lowest, highest = np.concatenate(sides[0]), np.concatenate(sides[1])
        if not (lowest <= highest).all():
            raise DataError("bounds are the lowest and the highest number, in this order")
        return lowest, highest

    def at(self, x: FloatArray) -> Gradient:
        """The gradient with these free numbers."""
        if self._gradient is not None and np.array_equal(x, self._x):
            return self._gradient
        self.move_to(x)
        self.runs += 1
        try:
            self._gradient = gradient_of(self.trajectory, self.objective, self.parameters)
        except YaspsError as error:
            tried = {one.name: one.value(self.trajectory) for one in self.parameters}
            error.add_note(f"in run {self.runs} of a fit, with {tried}; bounds or another transform may keep it away")
            raise
        self._x = x.copy()
        return self._gradient

    def move_to(self, x: FloatArray) -> None:
        """Gives the parameters their values."""
        for one, part in zip(self.parameters, self._split(x), strict=True):
            transform = self.transforms.get(one.name)
            one.set(self.trajectory, part if transform is None else transform.to_value(part))

    def _slopes(self, x: FloatArray) -> FloatArray:
        """Derivatives of values by free numbers."""
        parts = zip(self.parameters, self._split(x), strict=True)
        return np.concatenate(
            [
                np.ones_like(part) if one.name not in self.transforms else self.transforms[one.name].slope(part)
                for one, part in parts
            ]
        )

    def value_and_slope(self, x: FloatArray) -> tuple[float, FloatArray]:
        """For the optimiser."""
        gradient = self.at(x)
        stacked = np.concatenate([gradient[one].reshape(-1) for one in self.parameters])
        return gradient.value, stacked * self._slopes(x)

    def product(self, objectives: list[Any], x: FloatArray, direction: FloatArray) -> FloatArray:
        """The Gauss-Newton Hessian along a direction."""
        self.at(x)
        slopes = self._slopes(x)
        parts = self._split(slopes * direction)
        along = dict(zip(self.parameters, parts, strict=True))
        found = gauss_newton_product(self.trajectory, objectives, along)
        return np.asarray(slopes * np.concatenate([found[one.name].reshape(-1) for one in self.parameters]))

    def after_iteration(self, x: FloatArray, *_: Any) -> None:
        """Notes an iteration; x: where it ended."""
        value, slope = self.value_and_slope(np.asarray(x))
        one = Iteration(len(self.history) + 1, value, float(np.abs(slope).max(initial=0.0)), self.runs)
        self.history.append(one)
        if self.console is not None:
            seconds = time.perf_counter() - self._begin
            self.console.print(
                f"iteration {one.number}: objective {one.value:.6g}, gradient {one.slope:.3g}, {one.runs} runs,"
                f" {seconds:.1f} s"
            )
        if self.file is not None:
            self.write(self.file)

    def write(self, file: Path) -> None:
        """Values and history, wholly or not at all. Raises SceneError if the system does not let it."""
        arrays = {f"values/{one.name}": one.value(self.trajectory) for one in self.parameters}
        table = [(one.number, one.value, one.slope, one.runs) for one in self.history]
        write_arrays(file, {"history": np.array(table, np.float64).reshape(-1, 4), **arrays})

    def restore(self, file: Path) -> None:
        """What `write` wrote. Raises SceneError for a file of another fit, DamagedStateError; nothing is set then."""
        arrays = read_arrays(file, of="fit")
        before = {one: one.value(self.trajectory).copy() for one in self.parameters}
        if arrays.keys() != {f"values/{one.name}" for one in self.parameters} | {"history"}:
            raise SceneError(f"{file} is of another fit: it has {', '.join(sorted(arrays))}")
        try:
            for one in self.parameters:
                one.set(self.trajectory, arrays[f"values/{one.name}"])
        except YaspsError as error:
            for one, value in before.items():
                one.set(self.trajectory, value)
            raise SceneError(f"{file} is of another fit: {error}") from error
        for number, value, slope, runs in arrays["history"]:
            self.history.append(Iteration(int(number), float(value), float(slope), int(runs)))
        self.runs = self.history[-1].runs if self.history else 0
