"""What a simulation was made of, by name: a state goes on only where all of it is the same."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from yasps import __version__

if TYPE_CHECKING:
    from yasps.simulation.simulation import Simulation

SHOWN = 4
"""Arrays of at most so many numbers are told by their numbers, others by a digest."""


def fingerprint_of(simulation: Simulation) -> dict[str, str]:
    """Name -> what it is: version, bodies, formulas, methods, and all numbers that are set now, but for those that
    contact sets by itself."""
    stepper, contact = simulation.stepper, simulation.contact
    parts = {"the version of yasps": __version__, "the scene": simulation.scene.name}
    parts["the list of bodies"] = ", ".join(body.name for body in simulation.bodies)
    for body in simulation.bodies:
        parts[f"body {body.name}"] = f"{type(body).__name__} of {len(body.rest)} vertices"
    parts |= {f"energy {path}": f"a formula of digest {digest}" for path, digest in simulation.scene.formulas().items()}
    parts["what is solved for"] = ", ".join(target.path for target in simulation.scene.minimize_targets)
    parts["the integrator"] = stepper.integrator.name
    parts["lagging"] = stepper.lagging
    parts["the settings of Newton's method"] = str(stepper.settings)
    parts["rescue"] = str(simulation.rescue)
    parts["the activation distance"] = "none" if contact is None else f"{simulation.activation_distance!r} m"
    return parts | {name: told(numbers) for name, numbers in own_numbers(simulation).items()}


def own_numbers(simulation: Simulation) -> dict[str, NDArray[Any]]:
    """All numbers and indices of the scene, by their paths, but for those that contact sets by itself."""
    numbers = simulation.scene.numbers()
    if simulation.contact is not None:
        for path in simulation.contact.paths_of_pairs():
            numbers.pop(path)
    return numbers


def told(numbers: NDArray[Any]) -> str:
    """Few numbers as they are; of others the shape, and a digest."""
    if numbers.size <= SHOWN:
        return np.array2string(numbers.reshape(-1), floatmode="unique", separator=", ")
    digest = hashlib.blake2b(np.ascontiguousarray(numbers).data, digest_size=8).hexdigest()
    return f"an array {list(numbers.shape)} of digest {digest}"


def difference(there: Mapping[str, str], here: Mapping[str, str]) -> str | None:
    """The first difference of two fingerprints, in words; None if there is none."""
    for name in [*there, *(name for name in here if name not in there)]:
        if name not in here:
            return f"it has {name}, which is not here"
        if name not in there:
            return f"{name} is not in it"
        if there[name] != here[name]:
            return f"{name} is {there[name]} there and {here[name]} here"
    return None
