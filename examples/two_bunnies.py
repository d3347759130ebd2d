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
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from yasps import Scene
from yasps.frontend import materials
from yasps.frontend.animation import Animation
from yasps.frontend.collision_geometry import CollisionGeometry
from yasps.frontend.contact import BarrierContact
from yasps.frontend.mesh import Mesh
from yasps.frontend.mesh_file import read_tetrahedral_mesh
from yasps.frontend.newton import BackwardEuler, MovingPart, NewtonSettings
from yasps.frontend.newton_system import SOLVERS, WHEN_TO_PROJECT
from yasps.frontend.pictures import DARK_PINK, LIGHT_BLUE, FramePictures, PicturesUnavailable, Surface
from yasps.frontend.primitive import Primitive
from yasps.frontend.progress import FrameProgress, TimeTable
from yasps.frontend.rabbit import rabbit
from yasps.frontend.shapes import ground
from yasps.frontend.tetrahedral_mesh import TetrahedralMesh
from yasps.frontend.vtkhdf import VtkHdfSeries

GRAVITY = 9.8  # m/s^2
DENSITY = 1000.0  # kg/m^3
SOFT_YOUNGS_MODULUS, SOFT_POISSON_RATIO = 2e4, 0.4  # Pa
STIFF_YOUNGS_MODULUS = 1e7  # Pa
CONTACT_FORCE = 10.0  # N, the scale of one pair's force; stiffness = force / distance^3 [J/m^4]
SIZE = 0.2  # m, height of a rabbit
FRAMES_PER_PICTURE = 3  # 100 steps of 0.01 s in a second, about 33 pictures


@dataclass(frozen=True)
class TwoBunnies:
    """The scene and what a driver needs to run and draw it."""

    scene: Scene
    stepper: BackwardEuler
    contact: BarrierContact
    soft: TetrahedralMesh
    stiff: TetrahedralMesh
    soft_vertices: slice
    stiff_vertices: slice


def add_soft_rabbit(scene: Scene, shape: TetrahedralMesh, time_step: float) -> tuple[Mesh, MovingPart]:
    """Free vertices; stable Neo-Hookean tets, inertia and gravity."""
    mesh = scene.add_mesh("soft")
    vertices = mesh.add_primitive("vertices", num_instances=len(shape.vertices))
    position = vertices.add_attribute("position", rows=3, cols=1, value=shape.vertices)
    predicted = vertices.add_constant("predicted", rows=3, cols=1, value=shape.vertices)
    mass = vertices.add_constant("mass", rows=1, cols=1, value=shape.vertex_masses(DENSITY))
    add_weight_and_inertia(scene, vertices, MovingPart(position, predicted, mass), time_step)

    tets = mesh.add_primitive("tets", num_instances=len(shape.tets))
    corners = tets.add_connectivity("corners", vertices, shape.tets, 4)
    inverse, volume = materials.rest_shape(shape.vertices, shape.tets)
    positions = tets.add_attribute("positions", through=corners, source=position)
    rest_edges_inverse = tets.add_constant("rest_edges_inverse", rows=3, cols=3, value=inverse)
    rest_volume = tets.add_constant("rest_volume", rows=1, cols=1, value=volume)
    mu, lam = materials.stable_neo_hookean_parameters(SOFT_YOUNGS_MODULUS, SOFT_POISSON_RATIO)
    deformation = materials.deformation_gradient(positions, rest_edges_inverse)
    elastic = materials.stable_neo_hookean(
        deformation,
        mesh.add_constant("mu", rows=1, cols=1, value=mu),
        mesh.add_constant("lambda", rows=1, cols=1, value=lam),
        rest_volume,
    )
    scene.add_energy(tets.add_attribute("stable_neo_hookean", computed_attribute=elastic))
    return mesh, MovingPart(position, predicted, mass)


def add_stiff_rabbit(scene: Scene, shape: TetrahedralMesh, time_step: float) -> tuple[Mesh, MovingPart]:
    """One affine body: every vertex is A r + t, and A stays nearly a rotation."""
    mesh = scene.add_mesh("stiff")
    body = mesh.add_primitive("body", num_instances=1)
    center = shape.vertices.mean(axis=0)
    matrix = body.add_attribute("affine_matrix", rows=3, cols=3, value=np.eye(3))
    translation = body.add_attribute("translation", rows=3, cols=1, value=center)
    stiffness = body.add_constant("stiffness", 1, 1, value=STIFF_YOUNGS_MODULUS * shape.volumes().sum())
    energy = materials.affine_orthogonality(matrix, stiffness)
    scene.add_energy(body.add_attribute("orthogonality", computed_attribute=energy))

    vertices = mesh.add_primitive("vertices", num_instances=len(shape.vertices))
    of_body = vertices.add_connectivity("of_body", body, np.zeros(len(shape.vertices), int), 1)
    rest = vertices.add_constant("rest_position", rows=3, cols=1, value=shape.vertices - center)
    own_matrix = vertices.add_attribute("affine_matrix", through=of_body, source=matrix).reshape(3, 3)
    own_translation = vertices.add_attribute("translation", through=of_body, source=translation).reshape(3, 1)
    position = vertices.add_attribute("position", computed_attribute=own_matrix * rest + own_translation)
    predicted = vertices.add_constant("predicted", rows=3, cols=1, value=shape.vertices)
    mass = vertices.add_constant("mass", rows=1, cols=1, value=shape.vertex_masses(DENSITY))
    part = MovingPart(position, predicted, mass)
    add_weight_and_inertia(scene, vertices, part, time_step)
    return mesh, part


def add_weight_and_inertia(scene: Scene, vertices: Primitive, part: MovingPart, time_step: float) -> None:
    """Gravity and the inertia of backward Euler on every vertex."""
    weight = materials.gravity(part.position, part.mass, (0.0, 0.0, -GRAVITY))
    inertia = materials.inertia(part.position, part.predicted, part.mass, time_step)
    scene.add_energy(vertices.add_attribute("gravity", computed_attribute=weight))
    scene.add_energy(vertices.add_attribute("inertia", computed_attribute=inertia))


def activation_distance(shape: TetrahedralMesh) -> float:
    """How near surfaces may come before they repel [m]: 1/200 of the size.

    Less, down to 1/1000, for a surface with narrower gaps or thinner triangles, so that it does not repel itself at
    rest.
    """
    largest, smallest = 5e-3 * SIZE, 1e-3 * SIZE
    geometry = CollisionGeometry(shape.vertices, shape.surface_triangles(), largest)
    gap = geometry.active_set(shape.vertices).minimum_distance
    return float(np.clip(0.8 * gap, smallest, largest))


def two_bunnies(
    shape: TetrahedralMesh,
    time_step: float = 0.01,
    threads: int | None = None,
    times: TimeTable | None = None,
    scene: Scene | None = None,
) -> TwoBunnies:
    """Builds the scene from one shape, about 1 high: a soft copy below, a stiff one above it, the ground at z = 0.

    scene: a new one to build it in, on a GPU for example; without it, one on the processor with so many threads.
    """
    size = np.ptp(shape.vertices[:, 2])
    shape = shape.centered((0.0, 0.0, 0.0)).scaled(SIZE / size)
    extent = shape.vertices.max(axis=0) - shape.vertices.min(axis=0)
    soft = shape.translated((0.0, 0.0, 0.5 * extent[2] + 0.1 * SIZE))
    stiff = shape.rotated((0.0, 0.0, 1.0), 0.9).translated((0.15 * SIZE, 0.1 * SIZE, 1.5 * extent[2] + 0.25 * SIZE))

    if scene is None:
        scene = Scene("two_bunnies", threads=threads)
    soft_mesh, soft_part = add_soft_rabbit(scene, soft, time_step)
    stiff_mesh, stiff_part = add_stiff_rabbit(scene, stiff, time_step)
    floor = ground((10 * SIZE, 10 * SIZE), 0.0, (1, 1))
    floor_vertices = scene.add_mesh("ground").add_primitive("vertices", num_instances=len(floor.vertices))
    floor_vertices.add_constant("position", rows=3, cols=1, value=floor.vertices)

    everything = scene.add_mesh("everything")
    union = everything.add_primitive_union("vertices", [soft_mesh.vertices, stiff_mesh.vertices, floor_vertices])
    union.add_attribute("position")
    starts = union.offsets()
    triangles = [
        part + start
        for part, start in zip(
            (soft.surface_triangles(), stiff.surface_triangles(), floor.triangles), starts, strict=False
        )
    ]
    distance = activation_distance(soft)
    fixed = np.zeros(union.num_instances, bool)
    fixed[starts[2] :] = True
    group = np.full(union.num_instances, -1)
    group[starts[1] : starts[2]] = 0  # a stiff body does not meet itself
    contact = BarrierContact(
        everything,
        union,
        np.concatenate(triangles),
        activation_distance=distance,
        stiffness=CONTACT_FORCE / distance**3,
        fixed=fixed,
        group=group,
        objects={"soft rabbit": len(soft.vertices), "stiff rabbit": len(stiff.vertices), "ground": len(floor.vertices)},
    )
    matrix, translation = stiff_mesh.body["affine_matrix"], stiff_mesh.body["translation"]
    scene.add_minimize_target([soft_part.position, matrix, translation])
    falling = np.array([0.0, 0.0, -GRAVITY])
    stepper = BackwardEuler(
        scene,
        [soft_part, stiff_part],
        time_step,
        contact,
        accelerations={soft_part.position: falling, translation: falling},
        # Newton stops well inside the activation distance, or contact forces would be left half-balanced.
        settings=NewtonSettings(velocity_tolerance=min(2e-3, 0.1 * distance / time_step), max_iterations=500),
        times=times,
    )
    slices = slice(starts[0], starts[1]), slice(starts[1], starts[2])
    return TwoBunnies(scene, stepper, contact, soft, stiff, *slices)


def mechanical_energy(example: TwoBunnies) -> float:
    """Kinetic, elastic, gravitational and contact energy together [J]."""
    potential = sum(float(v.sum()) for name, v in example.scene.energy_values().items() if not name.endswith("inertia"))
    return potential + example.stepper.kinetic_energy()


class Recorder:
    """Writes the ParaView series and, where the machine can draw, an animation and a picture."""

    def __init__(self, example: TwoBunnies, folder: Path, pictures: bool) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.example = example
        self.folder = folder
        soft, stiff = example.soft, example.stiff
        offset = len(soft.vertices)
        self.series = VtkHdfSeries(
            folder / "two_bunnies.vtkhdf",
            offset + len(stiff.vertices),
            {"tetra": np.concatenate([soft.tets, stiff.tets + offset])},
        )
        self.pictures: FramePictures | None = None
        self.animation: Animation | None = None
        if pictures:
            try:
                self._open_pictures()
            except PicturesUnavailable as reason:
                print(f"no pictures: {reason}", file=sys.stderr)

    def _open_pictures(self) -> None:
        soft, stiff = self.example.soft, self.example.stiff
        surfaces = [
            Surface("soft", soft.vertices, soft.surface_triangles(), LIGHT_BLUE),
            Surface("stiff", stiff.vertices, stiff.surface_triangles(), DARK_PINK),
        ]
        top = stiff.vertices[:, 2].max()
        bounds = np.array([[-1.2 * SIZE, -1.5 * SIZE, 0.0], [1.8 * SIZE, 1.5 * SIZE, top]])  # of the whole motion
        self.pictures = FramePictures(surfaces, ground_height=0.0, bounds=bounds, window_size=(960, 720))
        self.animation = Animation(self.folder / "two_bunnies.mp4")

    def record(self, positions: NDArray[np.float64]) -> None:
        """Adds a frame; positions of all vertices, [n, 3]."""
        example = self.example
        bodies = positions[: example.stiff_vertices.stop]
        self.series.write_frame(example.stepper.time, bodies)
        if self.pictures is not None and self.animation is not None:
            self.pictures.move("soft", positions[example.soft_vertices])
            self.pictures.move("stiff", positions[example.stiff_vertices])
            if (self.series.number_of_frames - 1) % FRAMES_PER_PICTURE == 0:
                self.animation.add(self.pictures.image())

    def close(self) -> list[Path]:
        """Finishes all files; returns what was written."""
        self.series.close()
        written = [self.folder / "two_bunnies.vtkhdf"]
        if self.pictures is not None and self.animation is not None:
            written.append(self.pictures.save(self.folder / "two_bunnies.png"))
            self.animation.close()
            written.append(self.animation.path)
            self.pictures.close()
        return written


def run(example: TwoBunnies, frames: int, folder: Path, pictures: bool, times: TimeTable) -> None:
    """Steps and records; raises IntersectionError should surfaces ever cross."""
    recorder = Recorder(example, folder, pictures)
    try:
        with FrameProgress(frames) as progress:
            recorder.record(example.contact.positions())
            for frame in range(1, frames + 1):
                begin = time.perf_counter()
                report = example.stepper.step()
                seconds = time.perf_counter() - begin
                positions = example.contact.positions()
                with times.stage("check: no intersection"):
                    example.contact.geometry.check_intersection_free(positions)
                with times.stage("output"):
                    recorder.record(positions)
                progress.update(
                    frame=frame,
                    newton_iterations=report.iterations,
                    cg_iterations=report.cg_iterations,
                    contacts=report.contacts,
                    milliseconds=1e3 * seconds,
                )
    finally:
        for path in recorder.close():
            print(f"wrote {path}", file=sys.stderr)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run two_bunnies`."""
    parser = argparse.ArgumentParser(prog="yasps run two_bunnies", description=__doc__)
    parser.add_argument("--frames", type=int, default=100, help="time steps of 0.01 s (default 100)")
    parser.add_argument(
        "--vertices", type=int, default=5000, help="vertices of each rabbit, 1500 or more (default about 5000)"
    )
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
    start = time.perf_counter()
    shape = read_tetrahedral_mesh(options.mesh) if options.mesh else rabbit(options.vertices)
    times = TimeTable()
    with times.stage("build, and compile positions"):
        scene = Scene("two_bunnies", device=options.device, threads=options.threads)
        example = two_bunnies(shape, times=times, scene=scene)
    settings = replace(example.stepper.settings, solver=options.solver, projection=options.projection)
    example.stepper.settings = settings
    print(f"{len(example.soft.vertices)} vertices and {len(example.soft.tets)} tets each", file=sys.stderr)
    with times.stage("compile"):
        report = example.scene.compile_report
    print(f"compile: {report}", file=sys.stderr)
    run(example, options.frames, options.output, not options.no_pictures, times)
    times.print(title=f"two_bunnies, {options.frames} frames, {time.perf_counter() - start:.1f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
