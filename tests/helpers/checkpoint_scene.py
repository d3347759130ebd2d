"""A scene with much that a state must have: `python checkpoint_scene.py FOLDER FRAMES [THREADS]` runs or resumes it,
with a checkpoint after every frame."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from yasps import Scene
from yasps.bodies import AffineBody, HalfSpace, Joints, MovingObstacle, RigidBody, SoftBody
from yasps.contact import ContactTable
from yasps.meshes import TriangleMesh, box
from yasps.output import FrameRecorder
from yasps.simulation import Checkpoints, Simulation
from yasps.stepping import BDF2, NewtonSettings

CUBE = box((0.1, 0.1, 0.1), (1, 1, 1))
SURFACE = TriangleMesh(CUBE.vertices, CUBE.surface_triangles())
NAME = "crowd"


def crowd(threads: int = 1, *, deterministic: bool = True, solver: str = "pcg", time_step: float = 0.01) -> Simulation:
    """A soft cube slides on a moving plate against an affine one that hangs on a hinge with a motor; a rigid one turns
    in the air, a corner of another soft one is led about; wind."""
    scene = Scene(NAME, threads=threads, deterministic=deterministic)
    soft = SoftBody(scene, "soft", CUBE.translated((0.0, 0.0, 0.0515)), youngs_modulus=1e5)
    hung = AffineBody(scene, "hung", CUBE.translated((0.105, 0.0, 0.08)))
    rigid = RigidBody(scene, "rigid", CUBE.translated((0.0, 0.3, 0.3)))
    led = SoftBody(scene, "led", CUBE.translated((0.0, -0.3, 0.3)), youngs_modulus=1e5)
    start = SURFACE.vertices * (4.0, 2.0, 0.1) + (0.0, 0.0, -0.005)
    plate = MovingObstacle(
        scene,
        "plate",
        TriangleMesh(start, SURFACE.triangles),
        motion=lambda t: start + np.array([0.3 * t * t, 0.0, 0.02 * t]),
    )
    joints = Joints(scene, [hung])
    hinge = joints.hinge(None, hung, (0.105, 0.0, 0.2), (0.0, 1.0, 0.0), 1e5)
    hinge.drive(1.0, 1e-2)
    simulation = Simulation(
        scene,
        [soft, hung, rigid, led, plate, HalfSpace(scene, "ground", height=-0.1)],
        time_step=time_step,
        activation_distance=2e-3,
        contacts=ContactTable(friction=0.4),
        integrator=BDF2,
        settings=NewtonSettings(velocity_tolerance=1e-4, solver=solver),
    )
    simulation.attach(joints)
    simulation.set_velocity(rigid, (0.2, 0.0, 0.5), angular=(3.0, 2.0, 1.0))
    corner = led.rest[:1]
    simulation.pin(led, [0], motion=lambda t: corner + np.array([0.02 * np.sin(9 * t), 0.0, 0.0]))
    simulation.add_force(soft, lambda x, v, t: 0.01 * np.sin(30 * t) - 0.1 * v, "wind")
    return simulation


def main(folder: Path, frames: int, threads: int) -> None:
    """Runs it to that frame, from the last checkpoint if there is one."""
    simulation, checkpoints = crowd(threads), Checkpoints(folder, NAME, every=1)
    if checkpoints.file.exists() or checkpoints.earlier.exists():
        checkpoints.resume(simulation)
    with FrameRecorder(simulation, folder, NAME, pictures=False, resume=simulation.frame > 0) as files:
        print(simulation.frame, flush=True)
        simulation.run(frames - simulation.frame, files, checkpoints)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 1)
