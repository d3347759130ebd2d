"""One step of a run, linearised: how its end follows from its beginning and from parameters."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from yasps import Attribute, FloatArray, PrimitiveUnion
from yasps.inverse.inputs import Layout, size_of
from yasps.inverse.kinks import kinks_of
from yasps.inverse.linear_solver import StepSolver
from yasps.inverse.trajectory import Frame, StepTaken, Trajectory
from yasps.stepping.driven import Driven
from yasps.stepping.integrators import Moment, weighted

Matrix = sparse.csr_array[np.float64]


class Linearizer:
    """Puts the scene at frames and steps of a run, and takes derivatives there.

    variables: stored attributes that positions and objectives are differentiated by: what frames consist of, and the
    parameters; constants: those that a step sets.
    """

    def __init__(self, trajectory: Trajectory, parameters: Sequence[Attribute]) -> None:
        self.trajectory, self.scene = trajectory, trajectory.scene
        self.stepper, self.contact = trajectory.simulation.stepper, trajectory.simulation.contact
        self.targets = Layout(self.scene.minimize_targets)
        self.starts = trajectory.starts
        self.parameters = list(parameters)
        self.constants = trajectory.constants_of_steps()
        self.variables = Layout([*self.targets.attributes, *self.starts.values(), *self.parameters])
        self.others = Layout([*self.constants, *self.starts.values(), *self.parameters])
        """All that energies are differentiated by, apart from targets."""
        self._acting: dict[Attribute, None] = {}
        self._moments: dict[int, Moment] = {}
        self._at: int | None = None
        self.warnings: list[str] = []
        """Steps whose derivatives are not unique, in words."""

    # -- where the scene is --------------------------------------------------------------------------------

    def forget(self) -> None:
        """Somebody else moved the scene."""
        self._at = None

    def _write(self, at: int, frame: Frame) -> None:
        """Sets the numbers of a frame."""
        if self._at == at:
            return
        self._at = None
        self.trajectory.set_schedules(at - 1)
        for attribute, value in zip(self.trajectory.moving_attributes, frame.values, strict=True):
            attribute.update_value(value)
        for obstacle in self.trajectory.obstacles:
            way = obstacle.vertices["way"]
            way.update_value(np.zeros(size_of(way)))
        self._at = at

    def show(self, at: int, frame: Frame) -> None:
        """Puts the scene at a frame, with the pairs that are close there."""
        self._write(at, frame)
        if self.contact is not None:
            self.contact.update()

    def _moment(self, at: int, frame: Frame) -> Moment:
        """Of a frame, as the stepper had it."""
        if at not in self._moments:
            self._write(at, frame)
            surface = None if self.contact is None else self.contact.positions()
            positions = [part.position.compute().array.reshape(-1, 3) for part in self.stepper.parts]
            carried = [one.attribute.value for one in self.stepper.carried]
            self._moments = {k: moment for k, moment in self._moments.items() if abs(k - at) <= 2}
            self._moments[at] = Moment(positions, [v.copy() for v in frame.velocities], surface, carried)
        return self._moments[at]

    def show_step(self, step: int, taken: StepTaken, frames: dict[int, Frame]) -> None:
        """Puts the scene at the end of a step, with the constants that the step had."""
        past = [self._moment(step - k, frames[step - k]) for k in range(len(taken.weights))]
        friction = None if self.contact is None else self.contact.friction
        if self.contact is not None and friction is not None and self.stepper.lagging == "once":
            self._write(step, frames[step])
            self.trajectory.set_schedules(step)
            self.contact.lag()
        self.trajectory.simulation.effective_step.update_value(taken.effective)
        self.stepper.set_constants(weighted(taken.weights, past), taken.effective)
        self.show(step + 1, frames[step + 1])
        if self.contact is not None and friction is not None and self.stepper.lagging == "converged":
            self.contact.lag()

    # -- derivatives ---------------------------------------------------------------------------------------

    def jacobian(self, attribute: Attribute) -> Matrix:
        """Of an attribute by the variables, where the scene is: [numbers, variables]."""
        if attribute in self.variables.slices:
            place = self.variables.slices[attribute]
            count = place.stop - place.start
            ones = (np.ones(count), (np.arange(count), np.arange(place.start, place.stop)))
            return sparse.csr_array(ones, shape=(count, self.variables.size))
        if self.contact is not None and attribute is self.contact.position:
            assert isinstance(attribute.owner, PrimitiveUnion)
            members = [self.jacobian(member["position"]) for member in attribute.owner.members]
            return sparse.csr_array(sparse.vstack(members))
        return self.scene.jacobian(attribute, self.variables.attributes)

    def step(self, step: int, taken: StepTaken, frames: dict[int, Frame]) -> LinearStep:
        """The linearised step; the scene is at its end then."""
        self.show_step(step, taken, frames)
        if self.contact is not None:
            self.warnings += [f"step {step + 1} sits on a kink: {kink}" for kink in kinks_of(self.contact)]
        for energy in self.scene.energies:
            if energy.owner is not None and energy.owner.num_instances:
                self._acting[energy] = None
        acting = [energy for energy in self.scene.energies if energy in self._acting]
        compiled = self.scene.compile_for([*self.targets.attributes, *self.others.attributes], energies=acting)
        compiled.assemble()
        whole = compiled.hessian().to_scipy()
        n = self.targets.size
        return LinearStep(self, step, taken, whole[:n, :n], whole[:n, n:])

    def fixed(self) -> tuple[NDArray[np.bool_], dict[Driven, NDArray[np.int64]]]:
        """Unknowns that were prescribed, bool [targets], and of exact pins their numbers, [n * 3]."""
        mask, of_pins = np.zeros(self.targets.size, np.bool_), {}
        for one in self.stepper.driven:
            if one.is_released or not one.is_exact or (stays := one.fixed()) is None:
                continue
            target, instances = stays
            entries = np.arange(target.size)
            numbers = self.targets.slices[target].start + (instances[:, None] * target.size + entries).reshape(-1)
            mask[numbers] = True
            if one not in self.starts:
                of_pins[one] = numbers
        return mask, of_pins


class LinearStep:
    """d(gradient) = A d(targets) + B d(others) = 0 at the end of a step.

    hessian: A, [targets, targets]; mixed: B, [targets, others] of the linearizer. With friction that is lagged to
    convergence the lag follows the targets, and A has what comes of that.
    """

    def __init__(self, linearizer: Linearizer, step: int, taken: StepTaken, hessian: Matrix, mixed: Matrix) -> None:
        self.linearizer, self.number, self.taken = linearizer, step, taken
        self.mixed = mixed
        self.prescribed, self.of_pins = linearizer.fixed()
        self.free = np.flatnonzero(~self.prescribed)
        self.lag_follows: Matrix | None = None
        """With friction lagged to convergence: of the lagged positions by the variables, at the end."""
        contact = linearizer.contact
        if contact is not None and contact.friction is not None and linearizer.stepper.lagging == "converged":
            self.lag_follows = linearizer.jacobian(contact.position)
            lagged = linearizer.others.slices[contact.parts.points["lagged_position"]]
            hessian = hessian + mixed[:, lagged] @ self.lag_follows[:, : linearizer.targets.size]
        self.hessian = sparse.csr_array(hessian)

    @cached_property
    def _solver(self) -> StepSolver:
        matrix = sparse.csc_array(self.hessian[self.free][:, self.free])
        return StepSolver(matrix, f"step {self.number + 1}", is_symmetric=self.lag_follows is None)

    def solve(self, b: FloatArray, *, transposed: bool = False) -> FloatArray:
        """x of A x = b on free unknowns, 0 on prescribed ones, [targets, columns]. Raises NotConvergedError."""
        x = np.zeros_like(b)
        if len(self.free) and b[self.free].any():
            x[self.free] = self._solver.solve(b[self.free], transposed=transposed)
        return x
