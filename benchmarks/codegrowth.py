"""How generated code grows with the number of parameterisations that one contact energy meets."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.measure import Report, Row, Settings
from yasps import Attribute, Mesh, Primitive, Scene, concat_rows
from yasps.backend.codegen.preludes import without_preludes
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.cpp.object import CppEmitter
from yasps.contact import paper_barrier, squared_point_plane
from yasps.frontend.execution.emit import SceneEmitter
from yasps.passes.pipeline import run_pipeline

DESCRIPTION = "generated lines, objects and local memory of point-triangle contact over 1 to 4 parameterisations"
VERTICES = 6
CONTROL_POINTS = 8
NOTES = (
    "One energy over a union of vertices: free, then also of an affine body, of a cage with 8 control points, and of "
    "levers that turn by an angle (nonlinear: curvature has objects of its own, the whole local Hessian is projected).",
    "lines: of all objects without the common preludes, counted before equal ones are shared; local array: the largest "
    "on the stack of any function, 8 instances wide.",
    "cages: the union of free vertices and several cages of the same kind.",
)


@dataclass(frozen=True)
class Growth:
    """lines, objects: generated; derivatives: energies' kernels among the objects; largest_array: bytes on a stack."""

    lines: int
    objects: int
    derivatives: int
    largest_array: int


def free(mesh: Mesh, random: np.random.Generator) -> tuple[Primitive, list[Attribute]]:
    """Vertices that are unknowns themselves."""
    vertices = mesh.add_primitive("vertices", VERTICES)
    return vertices, [vertices.add_attribute("position", 3, 1, value=random.random((VERTICES, 3)))]


def fixed(mesh: Mesh, random: np.random.Generator) -> tuple[Primitive, list[Attribute]]:
    """Vertices that stay where they are."""
    vertices = mesh.add_primitive("vertices", VERTICES)
    vertices.add_constant("position", 3, 1, value=random.random((VERTICES, 3)))
    return vertices, []


def affine(mesh: Mesh, random: np.random.Generator) -> tuple[Primitive, list[Attribute]]:
    """Vertices A r + t of one affine body."""
    body, vertices = mesh.add_primitive("body", 1), mesh.add_primitive("vertices", VERTICES)
    matrix = body.add_attribute("matrix", 3, 3, value=np.eye(3))
    shift = body.add_attribute("shift", 3, 1, value=np.zeros(3))
    of_body = vertices.add_connectivity("of_body", body, [0] * VERTICES, 1)
    own_matrix = vertices.add_attribute("matrix", through=of_body, source=matrix).reshape(3, 3)
    own_shift = vertices.add_attribute("shift", through=of_body, source=shift).reshape(3, 1)
    rest = vertices.add_constant("rest", 3, 1, value=random.random((VERTICES, 3)))
    vertices.add_attribute("position", computed_attribute=own_matrix * rest + own_shift)
    return vertices, [matrix, shift]


def cage(mesh: Mesh, random: np.random.Generator) -> tuple[Primitive, list[Attribute]]:
    """Vertices that are weighted means of eight control points."""
    control, vertices = mesh.add_primitive("control", CONTROL_POINTS), mesh.add_primitive("vertices", VERTICES)
    points = control.add_attribute("position", 3, 1, value=random.random((CONTROL_POINTS, 3)))
    corners = vertices.add_connectivity("corners", control, [range(CONTROL_POINTS)] * VERTICES, CONTROL_POINTS)
    of_cage = vertices.add_attribute("of_cage", through=corners, source=points)
    weights = random.dirichlet(np.ones(CONTROL_POINTS), VERTICES)
    own_weights = vertices.add_constant("weights", CONTROL_POINTS, 1, value=weights)
    vertices.add_attribute("position", computed_attribute=of_cage.T * own_weights)
    return vertices, [points]


def lever(mesh: Mesh, random: np.random.Generator) -> tuple[Primitive, list[Attribute]]:
    """Vertices at the ends of arms that turn about the z axis."""
    arms, vertices = mesh.add_primitive("arms", VERTICES), mesh.add_primitive("vertices", VERTICES)
    angle = arms.add_attribute("angle", 1, 1, value=random.random(VERTICES))
    of_arm = vertices.add_connectivity("of_arm", arms, range(VERTICES), 1)
    own_angle = vertices.add_attribute("angle", through=of_arm, source=angle)
    length = vertices.add_constant("length", 1, 1, value=1 + random.random(VERTICES))
    height = vertices.add_constant("height", 1, 1, value=random.random(VERTICES))
    ends = [length * own_angle.cos(), length * own_angle.sin(), height]
    vertices.add_attribute("position", computed_attribute=concat_rows(ends))
    return vertices, [angle]


Parameterisation = Callable[[Mesh, np.random.Generator], tuple[Primitive, list[Attribute]]]
PARAMETERISATIONS: tuple[Parameterisation, ...] = (free, affine, cage, lever)


def contact_scene(parameterisations: tuple[Parameterisation, ...]) -> Scene:
    """Point-triangle barriers over the union of the vertices of one body of each."""
    random = np.random.default_rng(0)
    scene = Scene("growth", threads=1)
    members, targets = [], []
    for k, parameterisation in enumerate(parameterisations):
        vertices, unknowns = parameterisation(scene.add_mesh(f"body_{k}"), random)
        members.append(vertices)
        targets += unknowns
    everything = scene.add_mesh("everything")
    union = everything.add_primitive_union("vertices", members)
    position = union.add_attribute("position")
    pairs = everything.add_primitive("pairs", 0, is_dynamic=True)
    corners = pairs.add_connectivity("corners", union, [], 4)
    x = pairs.add_attribute("positions", through=corners, source=position)
    reach, stiffness = (everything.add_constant(name, 1, 1, value=1.0) for name in ("reach", "stiffness"))
    energy = paper_barrier(squared_point_plane(x), reach, stiffness)
    scene.add_energy(pairs.add_attribute("barrier", computed_attribute=energy))
    scene.add_minimize_target(targets)
    return scene


def growth(parameterisations: tuple[Parameterisation, ...]) -> Growth:
    """What is generated for this union."""
    scene = contact_scene(parameterisations)
    module = run_pipeline(SceneEmitter(scene.name).emit(scene._energies, scene._targets, []))
    view = SceneView(module)
    codes = [code for code in CppEmitter(view, True).emit_all() if code.entries]
    bodies = [without_preludes(code.text) for code in codes]
    return Growth(
        sum(body.count("\n") for body in bodies),
        len(codes),
        sum(code.name.endswith(".derivative") for code in codes),
        max(_largest_array(body) for body in bodies),
    )


BYTES = {"V": 64, "double": 8, "long": 8, "int": 4}
_ARRAY = re.compile(r"^\s*(V|double|long|int) \w+((?:\[\d+\])+)(?: = .*)?;", re.MULTILINE)


def _largest_array(text: str) -> int:
    """Bytes of the largest array declared in a function."""
    entries = [(kind, [int(n) for n in re.findall(r"\d+", bounds)]) for kind, bounds in _ARRAY.findall(text)]
    return max((BYTES[kind] * math.prod(bounds) for kind, bounds in entries), default=0)


def run(settings: Settings) -> Report:
    """Generates the code of all unions; nothing is compiled."""
    del settings
    cases = {
        " + ".join(p.__name__ for p in PARAMETERISATIONS[:k]): PARAMETERISATIONS[:k]
        for k in range(1, len(PARAMETERISATIONS) + 1)
    }
    cases |= {f"free + {k} cages": (free, *[cage] * k) for k in (1, 2, 3)}
    rows = []
    for case, parameterisations in cases.items():
        found = growth(parameterisations)
        rows += [
            Row(case, "yasps", 1, float(found.lines), "lines"),
            Row(case, "yasps", 1, float(found.objects), "objects"),
            Row(case, "yasps", 1, float(found.derivatives), "energy kernels"),
            Row(case, "yasps", 1, float(found.largest_array), "bytes, largest local array"),
        ]
    return Report(rows, list(NOTES))
