"""The state of a simulation: all that its next step depends on, in memory and in files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from yasps import SceneError, YaspsError
from yasps.meshes.tetrahedral_mesh import Float64Array
from yasps.simulation.fingerprint import difference, own_numbers
from yasps.simulation.remeshing import take_meshes
from yasps.simulation.state_files import DamagedStateError, read_arrays, write_arrays

if TYPE_CHECKING:
    from yasps.simulation.simulation import Simulation

PAST = "past/"
"""How names of what a state has of the step before it begin: a state may be without."""
MOTION = "motion/"
"""How names of places begin that driven vertices were told: a state may be without."""
STATE, NUMBERS, FINGERPRINT = "state/", "numbers/", "fingerprint"
"""Names in files: what `state_of` gives, numbers of the scene, and what the simulation was made of."""


def state_of(simulation: Simulation) -> dict[str, Float64Array]:
    """See `Simulation.state`."""
    stepper, contact = simulation.stepper, simulation.contact
    numbers = {f"target/{target.path}": target.value for target in simulation.scene.minimize_targets}
    numbers |= {f"target_velocity/{target.path}": v.copy() for target, v in stepper.velocities_of_targets()}
    numbers |= {f"history/{one.path}": one.value for one in simulation.history()}
    if (past := stepper.past) is not None:
        numbers |= {f"{PAST}{name}": value for name, value in past.start_numbers().items()}
    numbers |= {f"velocity/{body.name}": simulation.velocity_of(body) for body in simulation.moving}
    numbers |= simulation.driven.state()
    if contact is not None:
        numbers["accepted"] = contact.accepted
    compiled = simulation.scene.compile()
    numbers["direct_solves_left"] = np.array(float(compiled.direct_solves_left))
    numbers["preconditioner_choice"] = compiled.preconditioner_choice.numbers()
    return numbers | {"time": np.array(simulation.time), "frame": np.array(float(simulation.frame))}


def set_state(simulation: Simulation, state: Mapping[str, Float64Array]) -> None:
    """Sets what `state_of` has given. Raises IntersectionError if surfaces cross there."""
    stepper, contact = simulation.stepper, simulation.contact
    for target in simulation.scene.minimize_targets:
        target.update_value(state[f"target/{target.path}"])
    for one in simulation.history():
        one.update_value(state[f"history/{one.path}"])
    for number, body in enumerate(simulation.moving):
        stepper.velocities[number] = np.array(state[f"velocity/{body.name}"])
    simulation.driven.set_state(state)
    stepper.target_velocities = [
        np.array(state[f"target_velocity/{target.path}"]) for target in simulation.scene.minimize_targets
    ]
    stepper.time, simulation.frame = float(state["time"]), int(state["frame"])
    if contact is not None:
        contact.reset()
    past = {name.removeprefix(PAST): np.array(x) for name, x in state.items() if name.startswith(PAST)}
    stepper.remember(past)
    if contact is not None:
        contact.accept(state["accepted"])
    compiled = simulation.scene.compile()
    compiled.direct_solves_left = int(state["direct_solves_left"])
    compiled.preconditioner_choice.set_numbers(state["preconditioner_choice"])


def save(
    simulation: Simulation, file: Path, built: Mapping[str, str], state: Mapping[str, Float64Array] | None = None
) -> None:
    """Writes a state to a file, by default the present one, with all numbers of the scene; built: the fingerprint of
    the simulation when it was made. Raises SceneError."""
    state = state_of(simulation) if state is None else state
    arrays: dict[str, NDArray[Any]] = {FINGERPRINT: np.array(json.dumps(built))}
    arrays |= {f"{STATE}{name}": value for name, value in state.items()}
    arrays |= {f"{NUMBERS}{name}": value for name, value in own_numbers(simulation).items()}
    write_arrays(file, arrays)


def restore(simulation: Simulation, file: Path, built: Mapping[str, str]) -> None:
    """Sets the state to that of a file. Raises DamagedStateError, SceneError, IntersectionError; nothing has changed
    then."""
    arrays = read_arrays(file)
    if FINGERPRINT not in arrays:
        raise DamagedStateError(f"{file} holds no state of a simulation: it has {', '.join(arrays) or 'nothing'} in it")
    differs = difference(json.loads(str(arrays[FINGERPRINT])), built)
    if differs is not None:
        raise SceneError(f"{file} is a state of another simulation: {differs}")
    state, numbers = (_without(prefix, arrays) for prefix in (STATE, NUMBERS))
    here, numbers_here = state_of(simulation), own_numbers(simulation)
    # Of a dynamic primitive there may be another number of instances now; what does not fit is not set.
    differs = difference(dict.fromkeys(numbers, ""), dict.fromkeys(numbers_here, ""))
    if differs is not None:
        raise SceneError(f"{file} is a state of another simulation: {differs}")
    before = {name: value.copy() for name, value in numbers_here.items()}
    try:
        take_meshes(simulation, numbers)
        differs = difference(_shapes(state), _shapes(state_of(simulation)))
        if differs is not None:
            raise SceneError(f"{file} is a state of another simulation: {differs}")
        simulation.scene.set_numbers(numbers)
        set_state(simulation, state)
    except YaspsError:
        take_meshes(simulation, before)
        simulation.scene.set_numbers(before)
        set_state(simulation, here)
        raise


def _without(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    return {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}


def _shapes(arrays: Mapping[str, NDArray[Any]]) -> dict[str, str]:
    """Shapes of what a state must have, in words."""
    return {
        name: f"an array {list(value.shape)}" for name, value in arrays.items() if not name.startswith((PAST, MOTION))
    }
