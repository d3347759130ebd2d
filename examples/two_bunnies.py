"""A soft rabbit and a stiff one fall on each other and on the ground.

The soft rabbit is stable Neo-Hookean, each vertex free; the stiff one is an affine body (9 + 3 unknowns). Contact is
IPC's barrier, written once over the union of all vertices. Writes a ParaView series, a picture and a short animation,
and checks that nothing intersects after every step.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from yasps import SOLVERS, WHEN_TO_PROJECT, Scene
from yasps.bodies import AffineBody, Ground, SoftBody
from yasps.contact import narrowest_gap
from yasps.meshes import TetrahedralMesh, rabbit, read_tetrahedral_mesh
from yasps.output import FrameRecorder, TimeTable
from yasps.simulation import Simulation

SIZE = 0.2  # m, height of a rabbit


def two_bunnies(shape: TetrahedralMesh, scene: Scene | None = None, times: TimeTable | None = None) -> Simulation:
    """A soft copy of the shape, made 0.2 m high, a stiff one above it, and the ground at z = 0."""
    shape = shape.centered((0.0, 0.0, 0.0)).scaled(SIZE / np.ptp(shape.vertices[:, 2]))
    height = np.ptp(shape.vertices[:, 2])
    low = shape.translated((0.0, 0.0, 0.5 * height + 0.1 * SIZE))
    high = shape.rotated((0.0, 0.0, 1.0), 0.9).translated((0.15 * SIZE, 0.1 * SIZE, 1.5 * height + 0.25 * SIZE))
    scene = scene or Scene("two_bunnies")
    soft = SoftBody(scene, "soft", low, youngs_modulus=2e4, poisson_ratio=0.4)
    stiff = AffineBody(scene, "stiff", high, youngs_modulus=1e7)
    # Surfaces repel when they are nearer than 1/200 of the size, or less where the rabbit itself is narrower.
    distance = float(np.clip(0.8 * narrowest_gap(low, 5e-3 * SIZE), 1e-3 * SIZE, 5e-3 * SIZE))
    bodies = [soft, stiff, Ground(scene, size=10 * SIZE)]
    return Simulation(scene, bodies, activation_distance=distance, barrier="paper", times=times)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run two_bunnies`."""
    parser = argparse.ArgumentParser(prog="yasps run two_bunnies", description=__doc__)
    parser.add_argument("--frames", type=int, default=100, help="time steps of 0.01 s (default 100)")
    parser.add_argument("--vertices", type=int, default=5000, help="of each rabbit, 1500 or more (default about 5000)")
    parser.add_argument("--mesh", type=Path, help="a tetrahedral mesh file to use instead of the rabbit")
    parser.add_argument("--output", type=Path, default=Path("output/two_bunnies"), help="folder for files and pictures")
    parser.add_argument("--no-pictures", action="store_true", help="no picture and no animation")
    parser.add_argument("--device", default="cpu", help="cpu (default), cuda, or cuda:N for the GPU number N")
    parser.add_argument("--threads", type=int, help="threads of the CPU (default: one for each processor)")
    parser.add_argument("--solver", choices=SOLVERS, default="pcg", help="of the linear systems (default pcg)")
    parser.add_argument("--projection", choices=WHEN_TO_PROJECT, default="always", help="of Hessians (default always)")
    options = parser.parse_args(arguments)
    if options.frames < 0:
        parser.error(f"--frames is a number of time steps, 0 or more, got {options.frames}")
    start, times = time.perf_counter(), TimeTable()
    shape = read_tetrahedral_mesh(options.mesh) if options.mesh else rabbit(options.vertices)
    with times.stage("build, and compile positions"):
        scene = Scene("two_bunnies", device=options.device, threads=options.threads)
        simulation = two_bunnies(shape, scene, times)
    stepper = simulation.stepper
    stepper.settings = replace(stepper.settings, solver=options.solver, projection=options.projection)
    print(f"{len(shape.vertices)} vertices and {len(shape.tets)} tets each", file=sys.stderr)
    with times.stage("compile"):
        print(f"compile: {scene.compile_report}", file=sys.stderr)
    with FrameRecorder(simulation, options.output, "two_bunnies", pictures=not options.no_pictures) as files:
        simulation.run(options.frames, files)
    times.print(title=f"two_bunnies, {options.frames} frames, {time.perf_counter() - start:.1f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
