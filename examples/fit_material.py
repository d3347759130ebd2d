"""Young's modulus along a beam, found from the shape in which it hangs.

The beam is fixed at one end and bends under its weight. Each of its segments has a modulus of its own, whose logarithm
is what is looked for: a chain of attributes leads from it to the energy of each tetrahedron. A run with the true moduli
says where the vertices come to; from one modulus for all, `fit` finds them by the exact gradient through all steps.
What runs afterwards, with pictures, is the beam that was found.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from yasps import Attribute, Scene, materials
from yasps.bodies import SoftBody
from yasps.inverse import PRECISE, Squares, Trajectory, fit
from yasps.meshes import box
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation

LENGTH, SIDE = 0.3, 0.06  # m
DENSITY, POISSON_RATIO = 1000.0, 0.4  # kg/m^3
SEGMENTS = 4
TRUE_MODULI = (2e5, 4e5, 1e5, 3e5)  # Pa, from the fixed end on
GUESS = 2e5  # Pa, everywhere
STEPS = 10  # after which the beam hangs nearly still
FOUND = 1e-3  # relative error of a modulus
NEAR = 1e-5  # m, of a vertex from where it was seen

PROGRAM = SceneProgram("fit_material", __doc__, frames=STEPS, time_step=0.1, size=16, size_means="cells along the beam")


class Beam(SoftBody):
    """A beam along x whose `segments` have a `log_modulus` each [log Pa]."""

    def __init__(self, scene: Scene, cells: int) -> None:
        """So many cells along it, two each way across."""
        shape = box((LENGTH, SIDE, SIDE), (cells, 2, 2))
        super().__init__(scene, "beam", shape, density=DENSITY, youngs_modulus=GUESS, poisson_ratio=POISSON_RATIO)
        scene.remove_energy(self.energies.pop())  # of one modulus for all
        segments = self.mesh.add_primitive("segments", num_instances=SEGMENTS)
        self.log_modulus = segments.add_constant("log_modulus", 1, 1, value=[np.log(GUESS)] * SEGMENTS)
        middles = shape.vertices[shape.tets].mean(axis=1)[:, 0] / LENGTH + 0.5
        segment = self.tets.add_connectivity("segment", segments, np.floor(SEGMENTS * middles).astype(int), 1)
        modulus = self.tets.add_attribute("log_modulus", through=segment, source=self.log_modulus).exp()
        mu, lam = materials.stable_neo_hookean_parameters(modulus, POISSON_RATIO)
        elastic = materials.stable_neo_hookean(self.tets["deformation_gradient"], mu, lam, self.tets["rest_volume"])
        self.add_energy(self.tets.add_attribute("elastic_of_field", computed_attribute=elastic))

    def add_seen(self) -> Attribute:
        """Where the vertices are now is where they were seen; how far they are from there [m], 3x1."""
        seen = self.vertices.add_constant("seen", 3, 1, value=self.positions())
        return self.vertices.add_attribute("away", computed_attribute=self.position - seen)


def build(options: Options) -> Simulation:
    """The beam with the moduli that were found, before it bends."""
    scene = PROGRAM.scene(options)
    beam = Beam(scene, max(options.size, SEGMENTS))
    simulation = Simulation(scene, [beam], time_step=options.dt, contact=False, settings=PRECISE)
    simulation.pin(beam, np.flatnonzero(beam.rest[:, 0] < -0.499 * LENGTH))
    trajectory = Trajectory(simulation, STEPS)
    beam.log_modulus.update_value(np.log(TRUE_MODULI))
    trajectory.run()
    away = beam.add_seen()
    beam.log_modulus.update_value([np.log(GUESS)] * SEGMENTS)
    fit(trajectory, Squares(away), beam.log_modulus, method="trust-ncg", options={"gtol": 1e-9})
    trajectory.restart()
    return simulation


def check(simulation: Simulation, options: Options) -> str:
    """The moduli are the true ones, and the beam hangs where it was seen."""
    (beam,) = simulation.moving
    assert isinstance(beam, Beam)
    moduli = np.exp(beam.log_modulus.value)
    error = float(np.abs(moduli / TRUE_MODULI - 1).max())
    if error > FOUND:
        raise CheckFailedError(f"the moduli found are {moduli}, up to {100 * error:.2g} % off")
    found = f"the moduli found are {', '.join(f'{one:.5g}' for one in moduli)} Pa, within {error:.1g} of the true ones"
    if simulation.frame != STEPS:
        return found
    far = float(np.abs(beam.vertices["away"].value).max())
    if far > NEAR:
        raise CheckFailedError(f"a vertex is {far:.2g} m from where it was seen")
    sag = float((beam.rest - beam.positions())[:, 2].max())
    return f"{found}; the beam sags by {sag:.3g} m, and vertices are within {far:.1g} m of where they were seen"


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run fit_material`."""
    return PROGRAM.run(arguments, build, check, view_direction=(0.3, -1.0, 0.2))


if __name__ == "__main__":
    sys.exit(main())
