"""Derivatives of attributes by parameters, forwards, and Gauss-Newton products of squares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from yasps import Attribute, DataError, FloatArray, SceneError
from yasps.inverse.adjoint import Adjoint
from yasps.inverse.checks import check_dependence, checked_objectives, checked_parameters
from yasps.inverse.gradients import prepared
from yasps.inverse.inputs import Inputs, size_of
from yasps.inverse.linear_step import Linearizer
from yasps.inverse.objectives import Frames, Squares
from yasps.inverse.parameters import Parameter
from yasps.inverse.tangent import Tangent
from yasps.inverse.trajectory import Frame, Trajectory


def sensitivities_of(
    trajectory: Trajectory, attribute: Attribute, parameters: object, frames: Frames = "last"
) -> FloatArray:
    """How an attribute of any shape changes with parameters, [frames, numbers of the attribute, numbers of the
    parameters, one parameter after the other]: one solution in each step for each number of the parameters, so for few
    of them and many numbers of the attribute.

    Raises what `gradient_of` raises.
    """
    chosen = checked_parameters(trajectory, parameters)
    watched = Squares(attribute, frames)
    (objective,) = checked_objectives(trajectory, watched)
    check_dependence(trajectory, chosen, [objective])
    wanted = {at: row for row, at in enumerate(watched.frames(trajectory.steps))}
    trajectory.up_to_date()
    sizes = [one.size(trajectory) for one in chosen]
    inputs = changes(trajectory, chosen, np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1]))
    linearizer = Linearizer(trajectory, [stored for one in chosen for stored in one.stored])
    found = np.zeros((len(wanted), size_of(attribute), sum(sizes)))

    def watch(at: int, frame: Frame, variables: FloatArray, velocities: dict[int, FloatArray]) -> None:
        if at in wanted:
            found[wanted[at]] = np.asarray(linearizer.jacobian(attribute) @ variables)

    Tangent(trajectory, linearizer, inputs, watch).run()
    trajectory.rewind()
    return found


def gauss_newton_product(
    trajectory: Trajectory, squares: Squares | Sequence[Squares], direction: Mapping[Any, ArrayLike]
) -> dict[str, FloatArray]:
    """J^T W J d for squares of residuals r, with J = dr/dp, their weights W and a direction d, parameter -> numbers.

    That is the Hessian of the objective along d, but for second derivatives of r, which do not count where r is small.
    By name of the parameter, in its shape. One sweep forwards and one backwards.

    Raises SceneError for objectives that are not `Squares`, and what `gradient_of` raises.
    """
    objectives = checked_objectives(trajectory, squares)
    if not all(isinstance(one, Squares) for one in objectives):
        raise SceneError("Gauss-Newton products are of objectives that are Squares(...)")
    chosen = checked_parameters(trajectory, list(direction))
    check_dependence(trajectory, chosen, objectives)
    trajectory.up_to_date()
    columns = [
        one.checked(trajectory, numbers).reshape(-1, 1) for one, numbers in zip(chosen, direction.values(), strict=True)
    ]
    linearizer = Linearizer(trajectory, [stored for one in chosen for stored in one.stored])
    seeds: dict[int, dict[Attribute, FloatArray]] = {}

    def watch(at: int, frame: Frame, variables: FloatArray, velocities: dict[int, FloatArray]) -> None:
        for one in objectives:
            if isinstance(one, Squares) and at in one.frames(trajectory.steps):
                of_frame = seeds.setdefault(at, {})
                moved = one.weight * np.asarray(linearizer.jacobian(one.attribute) @ variables)
                of_frame[one.attribute] = of_frame.get(one.attribute, 0.0) + moved

    def seed(at: int, frame: Frame) -> tuple[dict[Attribute, FloatArray], dict[int, FloatArray]]:
        return seeds.get(at, {}), {}

    Tangent(trajectory, linearizer, changes(trajectory, chosen, columns), watch).run()
    inputs = prepared(trajectory, chosen)
    Adjoint(trajectory, linearizer, inputs, seed).run()
    trajectory.rewind()
    return {one.name: np.array(one.gradient(inputs, trajectory)) for one in chosen}


def changes(trajectory: Trajectory, parameters: Sequence[Parameter], columns: Sequence[FloatArray]) -> Inputs:
    """Inputs of a tangent sweep: of each parameter [numbers, columns]."""
    widths = {one.shape[1] for one in columns}
    if len(widths) != 1:
        raise DataError(f"all parameters have as many columns, got {sorted(widths)}")
    inputs = prepared(trajectory, list(parameters), widths.pop())
    for parameter, one in zip(parameters, columns, strict=True):
        parameter.spread(inputs, trajectory, one)
    return inputs
