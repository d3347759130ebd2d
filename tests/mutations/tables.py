"""All mutations, by area."""

from __future__ import annotations

from areas import (
    assembly,
    bridges,
    contact,
    device,
    inverse,
    kernels,
    language,
    materials,
    parts,
    passes,
    projection,
    read_out,
    results,
    scenes,
    solver,
    states,
    stepping,
    structure,
)
from mutation import Mutation

AREAS: dict[str, tuple[Mutation, ...]] = {
    "language": language.MUTATIONS,
    "passes": passes.MUTATIONS,
    "kernels": kernels.MUTATIONS,
    "assembly": assembly.MUTATIONS,
    "structure": structure.MUTATIONS,
    "solver": solver.MUTATIONS,
    "projection": projection.MUTATIONS,
    "device": device.MUTATIONS,
    "scenes": scenes.MUTATIONS,
    "materials": materials.MUTATIONS,
    "parts": parts.MUTATIONS,
    "stepping": stepping.MUTATIONS,
    "contact": contact.MUTATIONS,
    "inverse": inverse.MUTATIONS,
    "read-out": read_out.MUTATIONS,
    "results": results.MUTATIONS,
    "bridges": bridges.MUTATIONS,
    "states": states.MUTATIONS,
}
