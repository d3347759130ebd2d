"""The problems of the benchmark `contacts`: two sheets of cloth, one close above the other, and their close pairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.kernel_problem import on_cpu
from benchmarks.on_device import Where, new_scene
from yasps import Attribute, Mesh, Primitive, PrimitiveBase, Scene
from yasps.contact import KINDS, mollifier, paper_barrier
from yasps.frontend.execution.cpu_scene import CpuScene

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

CELL = 0.01  # m
HEIGHT = 0.3 * CELL
REACH = CELL  # every pair of every kind is closer
STIFFNESS = 1e6  # J/m^4
PARALLEL = 1e-3  # of |U|^2 |V|^2: below, edges count as parallel and are mollified (Li et al. 2020)

CONTACTS = ("point_point", "point_edge", "point_triangle", "edge_edge", "mollified_edge_edge")


@dataclass(frozen=True)
class Pairs:
    """Close pairs of one kind between two sheets.

    vertices: [n, 3], of the lower sheet, then of the upper; lower: how many are of the lower; triangles: of both,
    [k, 3]; pairs: [m, arity], as the kind's distance wants them; threshold: [m] of mollified kinds, else None.
    """

    kind: str
    vertices: FloatArray
    lower: int
    triangles: IntArray
    pairs: IntArray
    threshold: FloatArray | None


def close_pairs(kind: str, size: int) -> Pairs:
    """About `size` pairs of a kind, at least 4. Each vertex of the upper sheet is in one pair or two.

    The upper sheet lies above the lower one, shifted by part of a cell such that the closest points of each pair are
    inside its edges and triangles; both have noise. For nearly parallel edges it zigzags by 1/50.
    """
    cells = max(2, round(size**0.5))
    n = cells + 2
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    grid = np.stack([i, j, np.zeros((n, n))], axis=-1).reshape(-1, 3) * CELL
    parallel = kind == "mollified_edge_edge"
    shift = np.array([0.3, 0.0 if parallel else 0.2, 0.0]) * CELL + [0.0, 0.0, HEIGHT]
    upper = grid + shift
    upper[:, 1] += 0.01 * CELL * np.where(i.reshape(-1) % 2 == 0, 1.0, -1.0)
    noise = (0.001 if parallel else 0.02) * CELL
    vertices = np.concatenate([grid, upper])
    vertices += np.random.default_rng(0).uniform(-noise, noise, vertices.shape)

    def number(di: int, dj: int) -> IntArray:
        numbers: IntArray = ((i + di) * n + j + dj)[:cells, :cells].reshape(-1).astype(np.int32)
        return numbers

    a, b, c, d, top, next_top = number(0, 0), number(1, 0), number(1, 1), number(0, 1), n * n, n * n + number(1, 0)
    columns = {
        "point_point": [top + a, a],
        "point_edge": [top + a, a, b],
        "point_triangle": [top + a, a, b, c],
        "edge_edge": [top + a, next_top, b, c],
        "mollified_edge_edge": [top + a, next_top, a, b],
    }[kind]
    cells_of_sheet = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    triangles = np.concatenate([cells_of_sheet, cells_of_sheet + top]).astype(np.int32)
    pairs = np.column_stack(columns).astype(np.int32)
    threshold = None
    edges = KINDS[kind].edges
    if edges is not None:
        first, second = (vertices[pairs[:, q]] - vertices[pairs[:, p]] for p, q in edges)
        threshold = PARALLEL * (first * first).sum(axis=1) * (second * second).sum(axis=1)
    return Pairs(kind, vertices, top, triangles, pairs, threshold)


@dataclass(frozen=True)
class ContactProblem:
    """The scene of these pairs, with one energy, compiled and its structure built."""

    pairs: Pairs
    compiled: CpuScene
    threads: int


def free_problem(pairs: Pairs, threads: int) -> ContactProblem:
    """All vertices are free."""
    scene = Scene("contacts", threads=threads)
    mesh = scene.add_mesh("sheets")
    vertices = mesh.add_primitive("vertices", len(pairs.vertices))
    position = vertices.add_attribute("position", 3, 1, value=pairs.vertices)
    add_barrier(mesh, vertices, pairs)
    scene.add_minimize_target(position)
    return _compiled(scene, pairs, threads)


def union_problem(pairs: Pairs, threads: int) -> ContactProblem:
    """The lower sheet is free, the upper one is an affine body."""
    return _compiled(union_scene(pairs, threads), pairs, threads)


def union_scene(pairs: Pairs, where: Where) -> Scene:
    """The lower sheet is free, the upper one is an affine body: x = A r + t. Nothing is compiled yet."""
    scene = new_scene("contacts", where)
    lower, upper = scene.add_mesh("lower"), scene.add_mesh("upper")
    free = lower.add_primitive("vertices", pairs.lower)
    position = free.add_attribute("position", 3, 1, value=pairs.vertices[: pairs.lower])
    affine, unknowns = _affine_vertices(upper, pairs.vertices[pairs.lower :])
    everything = scene.add_mesh("everything")
    union = everything.add_primitive_union("vertices", [free, affine])
    union.add_attribute("position")
    add_barrier(everything, union, pairs)
    scene.add_minimize_target([position, *unknowns])
    return scene


def _compiled(scene: Scene, pairs: Pairs, threads: int) -> ContactProblem:
    compiled = on_cpu(scene.compile())
    compiled.update_structure()
    return ContactProblem(pairs, compiled, threads)


def _affine_vertices(mesh: Mesh, positions: FloatArray) -> tuple[Primitive, list[Attribute]]:
    center = positions.mean(axis=0)
    body, vertices = mesh.add_primitive("body", 1), mesh.add_primitive("vertices", len(positions))
    matrix = body.add_attribute("matrix", 3, 3, value=np.eye(3))
    shift = body.add_attribute("shift", 3, 1, value=center)
    of_body = vertices.add_connectivity("of_body", body, np.zeros(len(positions), int), 1)
    own_matrix = vertices.add_attribute("matrix", through=of_body, source=matrix).reshape(3, 3)
    own_shift = vertices.add_attribute("shift", through=of_body, source=shift).reshape(3, 1)
    rest = vertices.add_constant("rest", 3, 1, value=positions - center)
    vertices.add_attribute("position", computed_attribute=own_matrix * rest + own_shift)
    return vertices, [matrix, shift]


def add_barrier(mesh: Mesh, vertices: PrimitiveBase, pairs: Pairs) -> None:
    """Adds the barrier energy as `frontend.contact` writes it, on pairs that never change."""
    kind = KINDS[pairs.kind]
    primitive = mesh.add_primitive("pairs", len(pairs.pairs))
    corners = primitive.add_connectivity("corners", vertices, pairs.pairs, kind.arity)
    x = primitive.add_attribute("positions", through=corners, source=vertices["position"])
    reach = mesh.add_constant("squared_reach", 1, 1, value=REACH**2)
    stiffness = mesh.add_constant("stiffness", 1, 1, value=STIFFNESS)
    weight = primitive.add_constant("weight", 1, 1, value=np.ones(len(pairs.pairs)))
    energy = weight * paper_barrier(kind.squared_distance(x), reach, stiffness)
    if kind.edges is not None:
        assert pairs.threshold is not None
        threshold = primitive.add_constant("threshold", 1, 1, value=pairs.threshold)
        (a, b), (c, d) = kind.edges
        energy = energy * mollifier(x.row(b) - x.row(a), x.row(d) - x.row(c), threshold)
    mesh.scene.add_energy(primitive.add_attribute("barrier", computed_attribute=energy))
