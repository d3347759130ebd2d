"""What a UNION costs: cloth with pinned corners, contact with an affine body, and compile time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.codegrowth import Parameterisation, affine, cage, contact_scene, fixed, free, lever
from benchmarks.compile_growth import stages
from benchmarks.contact_problem import Pairs, add_barrier, close_pairs, union_scene
from benchmarks.element_problem import NOISY, Elements, add_energy, cloth_hinges, cloth_triangles
from benchmarks.kernel_problem import on_cpu, projected_share
from benchmarks.measure import Peer, Report, Row, Settings, measure
from yasps import PrimitiveBase, Scene
from yasps.frontend.commands.environment_report import cpu_model
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.core.library import available_processors, load_runtime

FloatArray = NDArray[np.float64]

DESCRIPTION = "energies with and without a UNION, ns an instance, and compile seconds of 1 to 5 parameterisations"
DEFAULT_SIZE = 20_000
PINNED = 4
"""Vertices of the union's second member."""
LAYERS: tuple[Parameterisation, ...] = (free, fixed, affine, cage, lever)
NOTES = (
    "Processor time of one thread. free: the energy reads targets through a JOIN. pinned: four vertices spread over "
    "the same mesh are constants in a primitive of their own, and the energy reads UNION(free, pinned). free and "
    "affine: the lower sheet is free, the upper one an affine body.",
    "gradient; derived (gradient and Hessian, no projection); projected (share of the instances that needed it): "
    "gathered, added to the global gradient and block-sparse matrix, zeroed first.",
    "over free: the time over that of the same row without a union.",
    "compile: point-triangle contact over the union of 1 to 5 kinds of vertices, with an empty cache but for the "
    "runtime; see `compile_growth` for what the stages are.",
)


def run(settings: Settings) -> Report:
    """Times all energies, then all compiles."""
    rows: list[Row] = []
    for name, kinds in problems(settings.size).items():
        rows += _rows_of(name, {kind: make() for kind, make in kinds.items()}, settings.repeats)
    runtime = load_runtime(find_compiler(), 1)
    for count in range(1, len(LAYERS) + 1):
        layers = LAYERS[:count]
        case = f"compile {count}: {', '.join(layer.__name__ for layer in layers)}"
        rows += stages(case, partial(contact_scene, layers), runtime, settings.threads)
    about = f"{cpu_model()}, {available_processors()} processors; least and median of {settings.repeats} rounds."
    return Report(rows, [about, *NOTES])


def problems(size: int) -> dict[str, dict[str, Callable[[], CpuScene]]]:
    """By energy, then by what its vertices are; the first is without a union."""
    pairs = close_pairs("point_triangle", size)
    elements = {"hinge": cloth_hinges(size), "Baraff-Witkin": cloth_triangles(size)}
    made: dict[str, dict[str, Callable[[], CpuScene]]] = {
        name: {"free": partial(_cloth, cloth, 0), "pinned": partial(_cloth, cloth, PINNED)}
        for name, cloth in elements.items()
    }
    made["point-triangle"] = {
        "free": partial(_contacts, pairs, 0),
        "pinned": partial(_contacts, pairs, PINNED),
        "free and affine": lambda: _compiled(union_scene(pairs, 1)),
    }
    return made


def _vertices(scene: Scene, positions: FloatArray, pinned: int) -> PrimitiveBase:
    """Vertices with a `position`, the last `pinned` of them constants."""
    count = len(positions) - pinned
    free_vertices = scene.add_mesh("free").add_primitive("vertices", count)
    scene.add_minimize_target(free_vertices.add_attribute("position", 3, 1, value=positions[:count]))
    if not pinned:
        return free_vertices
    pins = scene.add_mesh("pins").add_primitive("vertices", pinned)
    pins.add_constant("position", 3, 1, value=positions[count:])
    union = scene.add_mesh("all").add_primitive_union("vertices", [free_vertices, pins])
    union.add_attribute("position")
    return union


def _pins_last(count: int) -> NDArray[np.int64]:
    """An order of so many vertices whose last are PINNED ones spread over all."""
    pins = np.linspace(0, count - 1, PINNED).astype(np.int64)
    return np.concatenate([np.setdiff1d(np.arange(count), pins), pins])


def _cloth(elements: Elements, pinned: int) -> CpuScene:
    order = _pins_last(len(elements.vertices))
    scene = Scene("cloth", threads=1)
    vertices = _vertices(scene, elements.deformed(NOISY)[order], pinned)
    corners = np.argsort(order)[elements.corners].astype(np.int32)
    add_energy(scene.add_mesh("body"), vertices, replace(elements, corners=corners))
    return _compiled(scene)


def _contacts(pairs: Pairs, pinned: int) -> CpuScene:
    order = _pins_last(len(pairs.vertices))
    scene = Scene("contacts", threads=1)
    vertices = _vertices(scene, pairs.vertices[order], pinned)
    add_barrier(scene.add_mesh("sheets"), vertices, replace(pairs, pairs=np.argsort(order)[pairs.pairs]))
    return _compiled(scene)


def _compiled(scene: Scene) -> CpuScene:
    compiled = on_cpu(scene.compile())
    compiled.update_structure()
    return compiled


def _rows_of(name: str, scenes: Mapping[str, CpuScene], repeats: int) -> list[Row]:
    share = 100 * projected_share(next(iter(scenes.values())))
    rows: list[Row] = []
    for case, how in {"gradient": {"hessian": False}, "derived": {"project": False}, "projected": {}}.items():
        told = f" ({share:.0f} %)" if case == "projected" else ""
        peers = [
            Peer(
                f"{name}, {kind}: {case}{told}", "yasps", 1, partial(scene.assemble, **how), 1e9 / count, "ns/instance"
            )
            for kind, scene in scenes.items()
            for count in [scene._terms[0].count]
        ]
        found = measure(peers, repeats, time.process_time)
        alone = found[0].value
        rows += found
        rows += [Row(f"{row.case}, over free", "yasps", 1, row.value / alone, "times") for row in found[1:]]
    return rows
