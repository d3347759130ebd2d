"""The state of a simulation in a few numbers, for a look after each step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from yasps import FloatArray, Scene
from yasps.contact import ContactForces
from yasps.stepping.settings import NewtonReport
from yasps.stepping.time_stepper import TimeStepper

ELASTIC = ("elastic", "membrane", "stretching", "bending", "orthogonality")
"""Names of the energies that bodies of `yasps.bodies` have of their material."""


@dataclass(frozen=True)
class StepReport:
    """What `Simulation.report` finds."""

    time: float
    """[s]"""
    frame: int
    newton: NewtonReport | None
    """Of the last step; None before the first."""
    energies: dict[str, float]
    """[J]: "kinetic", "elastic", "gravity", "contact", "friction" and "other" (pins, forces, energies of one's own).
    That of friction is the potential of the last step, not what it took from the motion."""
    momentum: FloatArray
    """[kg m/s], [3]."""
    reach: float
    """Activation distance [m]."""
    forces: ContactForces | None
    """None without contact."""

    @property
    def contacts(self) -> int:
        """Pairs that push."""
        return 0 if self.forces is None else len(self.forces.normal)

    @property
    def sliding(self) -> int:
        """Pairs that slide: friction has all of its force."""
        return 0 if self.forces is None else int(self.forces.friction.slides.sum())

    @property
    def sticking(self) -> int:
        """Pairs with friction that do not slide."""
        return 0 if self.forces is None else len(self.forces.friction) - self.sliding

    @property
    def smallest_gap(self) -> float:
        """Over the activation distance; infinite where nothing is near."""
        return float(self.forces.normal.gap.min()) / self.reach if self.forces and self.contacts else np.inf

    @property
    def largest_pressure(self) -> float:
        """[Pa]"""
        return 0.0 if self.forces is None else float(self.forces.pressures().max(initial=0.0))

    @property
    def between_bodies(self) -> dict[tuple[str, str], FloatArray]:
        """(a, b) -> the force on body a by body b [N], [3], friction included, of all that touch each other."""
        if self.forces is None:
            return {}
        table, names = self.forces.between_bodies(), self.forces.names
        rows, columns = np.nonzero(np.triu((table != 0).any(axis=2)))
        return {(names[i], names[j]): table[i, j] for i, j in zip(rows.tolist(), columns.tolist(), strict=True)}

    def __str__(self) -> str:
        lines = [f"step {self.frame}, t = {self.time:.6g} s"]
        if self.newton is not None:
            parts = f" in {self.newton.substeps} parts" if self.newton.substeps > 1 else ""
            left = f", residual force {self.newton.residual_force:.3g} N"
            lines.append(f"  Newton: {self.newton.iterations} iterations{parts}{left}")
        energies = ", ".join(f"{name} {value:.4g} J" for name, value in self.energies.items() if value)
        lines.append(f"  energy: {energies}")
        lines.append(f"  momentum: {_vector(self.momentum)} kg m/s")
        if self.forces is not None and self.contacts:
            lines.append(
                f"  contact: {self.contacts} pairs, smallest gap {self.smallest_gap:.3g} of the activation distance, "
                f"largest pressure {self.largest_pressure:.3g} Pa"
            )
            if self.sliding or self.sticking:
                lines.append(f"  friction: {self.sticking} pairs stick, {self.sliding} slide")
            lines += [f"  on {a!r} by {b!r}: {_vector(force)} N" for (a, b), force in self.between_bodies.items()]
        return "\n".join(lines)


def energies_by_kind(scene: Scene, stepper: TimeStepper) -> dict[str, float]:
    """Energies now [J]: "kinetic", "elastic", "gravity", "contact", "friction", "other", as `StepReport` has them.
    Gravity and what is elastic are known by the names that bodies and simulations give them."""
    friction = [] if stepper.contact is None or stepper.contact.friction is None else stepper.contact.friction.energies
    contact = [] if stepper.contact is None else stepper.contact.energies
    kinds = dict.fromkeys((energy.path for energy in contact), "contact")
    kinds |= dict.fromkeys((energy.path for energy in friction), "friction")
    inertia = {part.predicted.path.rpartition(".")[0] + ".inertia" for part in stepper.parts}  # no energy of the motion
    energies = dict.fromkeys(("kinetic", "elastic", "gravity", "contact", "friction", "other"), 0.0)
    energies["kinetic"] = stepper.kinetic_energy()
    for path, values in scene.energy_values().items():
        if path not in inertia:
            name = path.rpartition(".")[2]
            by_name = "elastic" if name in ELASTIC else "gravity" if name == "gravity" else "other"
            energies[kinds.get(path, by_name)] += float(values.sum())
    return energies


def step_report(
    scene: Scene,
    stepper: TimeStepper,
    *,
    frame: int,
    newton: NewtonReport | None,
    forces: ContactForces | None,
    reach: float,
) -> StepReport:
    """Looks at a scene of `yasps.simulation` as it is now; reach: the activation distance [m]."""
    energies = energies_by_kind(scene, stepper)
    return StepReport(stepper.time, frame, newton, energies, stepper.momentum(), reach, forces)


def _vector(values: FloatArray) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in values.tolist()) + ")"
