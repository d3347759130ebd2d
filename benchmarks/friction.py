"""What friction takes beside the barrier that it belongs to, per close pair; and what the improved max operator takes
of the search for these pairs."""

from __future__ import annotations

import time
from functools import partial

import numpy as np

from benchmarks.kernel_problem import on_cpu
from benchmarks.measure import Peer, Report, Row, Settings, measure
from yasps import FloatArray, Scene
from yasps.contact import BarrierContact, CollisionGeometry, ContactTable
from yasps.frontend.commands.environment_report import cpu_model
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.meshes import ground
from yasps.runtime.core.library import available_processors

DESCRIPTION = "energies, gradients and Hessians of friction beside those of its barrier; improved max in the search"
WITHOUT = "no improved max"
DEFAULT_SIZE = 40_000
PAIRS_PER_CELL = 22
SLIP_LENGTH = 1e-5  # m
UNIT = "ns/pair"
NOTES = (
    "Two rough sheets of triangles over each other, all vertices free, barrier with areas: pairs of all kinds as they "
    "come, the same for both. Slips are from 0 to some slip lengths.",
    "energy; gradient; gradient and projected Hessian, added to the global ones. The pairs have their places already.",
    "search, bound: the close pairs among candidates, and the step that is free of collisions; friction needs neither. "
    "whole search: with the candidates. Both also without the improved max operator, per pair with it: equal pairs are "
    "merged then, and are fewer.",
    "a Newton iteration: energy, gradient and Hessian, search and bound, once each. Processor time, one thread.",
    "lag: giving friction other pairs and positions, and these their places; once in a step.",
)


def sheets(size: int, *, friction: float) -> tuple[BarrierContact, CpuScene]:
    """About `size` close pairs, with the barrier as their only energy, or with friction alone."""
    cells = max(2, round((size / PAIRS_PER_CELL) ** 0.5))
    cell, random = 1.0 / cells, np.random.default_rng(0)
    sheet = ground((1.0, 1.0), divisions=(cells, cells))
    noise = [0.2 * cell, 0.2 * cell, 0.004 * cell] * random.uniform(-1, 1, (2, *sheet.vertices.shape))
    upper = sheet.vertices + noise[1] + [0.31 * cell, 0.17 * cell, 0.1 * cell]
    points = np.concatenate([sheet.vertices + noise[0], upper])
    triangles = np.concatenate([sheet.triangles, sheet.triangles[:, ::-1] + len(upper)])
    scene = Scene("sheets", threads=1)
    mesh = scene.add_mesh("sheets")
    vertices = mesh.add_primitive("vertices", len(points))
    position = vertices.add_attribute("position", 3, 1, value=points)
    contact = BarrierContact(
        mesh,
        vertices,
        triangles,
        activation_distance=0.2 * cell,
        stiffness=1e5,
        table=ContactTable(friction),
        slip_length=SLIP_LENGTH,
    )
    scene.add_minimize_target(position)
    if contact.friction is not None:
        for pairs in contact.primitives.values():
            scene.remove_energy(pairs.primitive["barrier"])
        scene.remove_energy(contact.ahead.energy)
    position.update_value(points + 2 * SLIP_LENGTH * random.uniform(-1, 1, points.shape))
    compiled = on_cpu(scene.compile())
    compiled.update_structure()
    return contact, compiled


def lag(contact: BarrierContact, compiled: CpuScene, positions: FloatArray) -> None:
    """Friction of other pairs than before, all of them again, and their places in gradient and Hessian."""
    assert contact.friction is not None
    kinds = contact.active.kinds()
    laws = {name: contact.laws_of_pairs(name, pairs) for name, pairs in kinds.items()}
    nobody = {name: pairs.chosen(np.zeros(len(pairs), np.bool_)) for name, pairs in kinds.items()}
    contact.friction.take(positions + 1e-9, nobody, {name: laws[name][:0] for name in kinds})
    contact.friction.take(positions, kinds, laws)
    compiled.update_structure()


def run(settings: Settings) -> Report:
    """Times both in turn."""
    barrier, pushing = sheets(settings.size, friction=0.0)
    _, sliding = sheets(settings.size, friction=0.5)
    lagged, lagging = sheets(settings.size, friction=0.5)
    count = len(barrier.active)
    positions = barrier.positions()
    peers = []
    for name, compiled in (("barrier", pushing), ("friction", sliding)):
        works = {
            "energy": compiled.total_energy,
            "gradient": partial(compiled.assemble, hessian=False),
            "gradient and Hessian": compiled.assemble,
        }
        peers += [Peer(case, name, 1, work, 1e9 / count, UNIT) for case, work in works.items()]
    reach = barrier.geometry.activation_distance
    way = positions + 0.1 * reach * np.random.default_rng(1).uniform(-1, 1, positions.shape)
    candidates = barrier.geometry.candidates(positions, way)
    search = partial(barrier.geometry.active_set, positions, candidates)
    plain = CollisionGeometry(positions, barrier.geometry.triangles, reach)
    plain_search = partial(plain.active_set, positions, plain.candidates(positions, way))
    bound = partial(barrier.geometry.step_bound, positions, way, candidates, start_is_free=True)
    peers += [
        Peer("search", "barrier", 1, search, 1e9 / count, UNIT),
        Peer("search", WITHOUT, 1, plain_search, 1e9 / count, UNIT),
        Peer("whole search", "barrier", 1, partial(barrier.geometry.active_set, positions), 1e9 / count, UNIT),
        Peer("whole search", WITHOUT, 1, partial(plain.active_set, positions), 1e9 / count, UNIT),
        Peer("bound", "barrier", 1, bound, 1e9 / count, UNIT),
        Peer("lag", "friction", 1, partial(lag, lagged, lagging, positions), 1e9 / count, UNIT),
    ]
    rows = measure(peers, settings.repeats, time.process_time)
    for name in ("barrier", "friction"):
        once = ("energy", "gradient and Hessian", "search", "bound")
        total = sum(row.value for row in rows if row.implementation == name and row.case in once)
        rows.append(Row("a Newton iteration", name, 1, total, UNIT))
    kinds = ", ".join(f"{len(pairs):,} {name}" for name, pairs in barrier.active.kinds().items() if len(pairs))
    about = [
        f"{count:,} pairs: {kinds}; least and median of {settings.repeats} rounds, in which all take turns.",
        f"{cpu_model()}, {available_processors()} processors; {pushing.runtime.compiler.version}.",
    ]
    return Report(rows, [*about, *NOTES])
