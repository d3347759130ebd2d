"""Placement indices and sparsity (paper, appendices A and B; figure 27), as nesting and unions grow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from benchmarks.kernel_problem import on_cpu
from benchmarks.measure import Peer, Report, Row, Settings, measure
from yasps import Attribute, Mesh, Primitive, PrimitiveBase, Scene
from yasps.frontend.commands.environment_report import cpu_model
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.runtime.core.library import available_processors

DESCRIPTION = "placement indices and sparsity for growing nesting and unions, ns per instance; peers NumPy, SciPy"
DEFAULT_SIZE = 80_000
DEPTHS = (1, 2, 3, 4)
MEMBERS = (1, 2, 4)
CORNERS = 4
UNIT = "ns/instance"
NOTES = (
    "indices: kappa, 1-based offsets of the unknowns that each instance's derivatives go to, from connectivities and "
    "unions. NumPy: the same table by fancy indexing, written by hand for each case.",
    "structure: from kappa to sorted, unique blocks and the place of each local block among them. NumPy: np.unique of "
    "row and column of every local block, with inverse. SciPy: coo_array of the same to CSR, which gives no places.",
    "both: what a change of connectivity costs: indices (always one thread), then structure.",
    "join of k: instances reach 4 vertices through k connectivities, each one-to-one but the last, shuffled. union of "
    "k: 4 vertices of a union of k meshes. affine: every other vertex belongs to one of 10 affine bodies (2 targets).",
    "yasps and NumPy give the same table but for the order within a row, and the same blocks.",
)


@dataclass(frozen=True)
class Case:
    """A scene whose only energy has these indices, and how to make them by hand.

    indices: kappa by hand, [n, c], 1-based, 0 for none.
    """

    name: str
    compiled: CpuScene
    indices: Callable[[], NDArray[np.int64]]

    @property
    def count(self) -> int:
        """Instances."""
        return self.compiled._terms[0].count

    def own_indices(self) -> NDArray[np.int32]:
        """yasps' kappa."""
        (term,) = self.compiled._terms
        assert term.kappa is not None
        return self.compiled.program.indices(term.kappa, term.count, term.capacity)

    def build(self, threads: int, kappa: NDArray[np.int32] | None = None) -> None:
        """yasps' structure, of these indices or those made anew."""
        matrix = self.compiled.static_matrix
        indices = self.own_indices() if kappa is None else kappa
        matrix.build(matrix.boundaries, matrix.block_sizes, [indices], threads)


def chain_case(depth: int, size: int) -> Case:
    """`depth` connectivities one behind another; the last joins 4 vertices."""
    random = np.random.default_rng(0)
    count = size // 5 + CORNERS
    scene = Scene("indices", threads=1)
    mesh = scene.add_mesh("mesh")
    vertices = mesh.add_primitive("vertices", count)
    position = vertices.add_attribute("position", 3, 1, value=random.random((count, 3)))
    corners = _corners(random, size, count)
    primitive = mesh.add_primitive("level_1", size)
    x = _joined(primitive, vertices, corners, position)
    tables = [corners]
    for level in range(2, depth + 1):
        upper = mesh.add_primitive(f"level_{level}", size)
        order = random.permutation(size).astype(np.int32)[:, None]
        x = _joined(upper, primitive, order, x).reshape(CORNERS, 3)
        primitive = upper
        tables.append(order)

    def by_hand() -> NDArray[np.int64]:
        kappa = 3 * tables[0].astype(np.int64) + 1
        for order in tables[1:]:
            kappa = kappa[order[:, 0]]
        return kappa

    return Case(f"join of {depth}", _compiled(scene, primitive, x, [position]), by_hand)


def union_case(members: int, size: int) -> Case:
    """4 vertices of a union of so many meshes."""
    random = np.random.default_rng(0)
    count = size // (5 * members) + CORNERS
    scene = Scene("indices", threads=1)
    parts, positions = [], []
    for k in range(members):
        vertices = scene.add_mesh(f"mesh_{k}").add_primitive("vertices", count)
        positions.append(vertices.add_attribute("position", 3, 1, value=random.random((count, 3))))
        parts.append(vertices)
    mesh = scene.add_mesh("everything")
    union = mesh.add_primitive_union("vertices", parts)
    corners = _corners(random, size, members * count)
    primitive = mesh.add_primitive("elements", size)
    x = _joined(primitive, union, corners, union.add_attribute("position"))

    def by_hand() -> NDArray[np.int64]:
        # Which member, then where in it: targets follow one another as the members do.
        member = corners // count
        return 3 * (member.astype(np.int64) * count + corners % count) + 1

    return Case(f"union of {members}", _compiled(scene, primitive, x, positions), by_hand)


def affine_case(size: int) -> Case:
    """4 vertices of a union of free ones and those of ten affine bodies."""
    random = np.random.default_rng(0)
    count, bodies = size // 10 + CORNERS, 10
    scene = Scene("indices", threads=1)
    free_mesh, affine_mesh = scene.add_mesh("free"), scene.add_mesh("affine")
    free = free_mesh.add_primitive("vertices", count)
    position = free.add_attribute("position", 3, 1, value=random.random((count, 3)))
    body, affine = _affine_bodies(affine_mesh, bodies, count, random)
    mesh = scene.add_mesh("everything")
    union = mesh.add_primitive_union("vertices", [free, affine])
    corners = _corners(random, size, 2 * count)
    primitive = mesh.add_primitive("elements", size)
    x = _joined(primitive, union, corners, union.add_attribute("position"))
    of_body = np.arange(count, dtype=np.int64) % bodies

    def by_hand() -> NDArray[np.int64]:
        slots = np.zeros((2 * count, 2), np.int64)
        slots[:count, 0] = 3 * np.arange(count) + 1
        slots[count:, 0] = 3 * count + 9 * of_body + 1
        slots[count:, 1] = 3 * count + 9 * bodies + 3 * of_body + 1
        return slots[corners].reshape(size, -1)

    unknowns = [position, body["matrix"], body["shift"]]
    return Case("union of free and affine", _compiled(scene, primitive, x, unknowns), by_hand)


def _affine_bodies(mesh: Mesh, bodies: int, count: int, random: np.random.Generator) -> tuple[Primitive, Primitive]:
    body, vertices = mesh.add_primitive("body", bodies), mesh.add_primitive("vertices", count)
    matrix = body.add_attribute("matrix", 3, 3, value=np.tile(np.eye(3), (bodies, 1, 1)))
    shift = body.add_attribute("shift", 3, 1, value=np.zeros((bodies, 3)))
    of_body = vertices.add_connectivity("of_body", body, np.arange(count) % bodies, 1)
    own_matrix = vertices.add_attribute("matrix", through=of_body, source=matrix).reshape(3, 3)
    own_shift = vertices.add_attribute("shift", through=of_body, source=shift).reshape(3, 1)
    rest = vertices.add_constant("rest", 3, 1, value=random.random((count, 3)))
    vertices.add_attribute("position", computed_attribute=own_matrix * rest + own_shift)
    return body, vertices


def _corners(random: np.random.Generator, size: int, count: int) -> NDArray[np.int32]:
    """Four different vertices near one another, as in a mesh."""
    first = random.integers(0, count, (size, 1))
    corners: NDArray[np.int32] = ((first + np.arange(CORNERS)) % count).astype(np.int32)
    return corners


def _joined(primitive: Primitive, of: PrimitiveBase, indices: NDArray[np.int32], source: Attribute) -> Attribute:
    connectivity = primitive.add_connectivity("of", of, indices, indices.shape[1])
    return primitive.add_attribute("positions", through=connectivity, source=source)


def _compiled(scene: Scene, primitive: Primitive, x: Attribute, unknowns: list[Attribute]) -> CpuScene:
    scene.add_energy(primitive.add_attribute("energy", computed_attribute=x.dot(x)))
    scene.add_minimize_target(unknowns)
    compiled = on_cpu(scene.compile())
    compiled.update_structure()
    return compiled


def block_keys(kappa: NDArray[np.int64], unknowns: int) -> NDArray[np.int64]:
    """row * unknowns + column of every local block of the upper triangle, -1 where there is none."""
    first, second = np.triu_indices(kappa.shape[1])
    a, b = kappa[:, first], kappa[:, second]
    keys = np.minimum(a, b) * (unknowns + 1) + np.maximum(a, b)
    return np.where((a > 0) & (b > 0), keys, -1).reshape(-1)


def numpy_structure(kappa: NDArray[np.int64], unknowns: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Sorted unique keys of the blocks, and the place of each local block among them."""
    unique, places = np.unique(block_keys(kappa, unknowns), return_inverse=True)
    return unique, places


def scipy_structure(kappa: NDArray[np.int64], unknowns: int) -> sparse.csr_array[np.int8]:
    """A pattern with an entry at the first row and column of every block."""
    keys = block_keys(kappa, unknowns)
    keys = keys[keys >= 0]
    rows, cols = keys // (unknowns + 1) - 1, keys % (unknowns + 1) - 1
    return sparse.coo_array((np.ones(len(keys), np.int8), (rows, cols)), shape=(unknowns, unknowns)).tocsr()


def check(case: Case) -> None:
    """Compares with the tables by hand. Raises ValueError."""
    ours, theirs = case.own_indices(), case.indices()
    # In which order an instance names its unknowns is the compiler's choice.
    if not np.array_equal(np.sort(ours, axis=1), np.sort(theirs, axis=1)):
        raise ValueError(f"{case.name}: yasps' placement indices are not those made by hand")
    matrix = case.compiled.static_matrix
    unique, _ = numpy_structure(theirs, matrix.size)
    # Which blocks there are, by their first entries; zeros are entries too.
    entries = matrix.to_scipy().tocoo()
    starts = np.zeros(matrix.size, np.bool_)
    starts[theirs[theirs > 0] - 1] = True
    first = starts[entries.row] & starts[entries.col] & (entries.row <= entries.col)
    found = (entries.row[first] + np.int64(1)) * (matrix.size + 1) + entries.col[first] + 1
    # yasps keeps every block of the diagonal, touched or not; here each unknown that is touched has one anyway.
    if not np.array_equal(np.sort(found), unique[unique >= 0]):
        raise ValueError(f"{case.name}: yasps' blocks are not those made by hand")


def run(settings: Settings) -> Report:
    """Times all cases. Raises ValueError if yasps and NumPy differ."""
    rows: list[Row] = []
    makers: list[Callable[[], Case]] = [
        *(partial(chain_case, depth, settings.size) for depth in DEPTHS),
        *(partial(union_case, members, settings.size) for members in MEMBERS),
        partial(affine_case, settings.size),
    ]
    for make in makers:
        case = make()
        check(case)
        rows += measure(_peers(case, sorted({1, settings.threads})), settings.repeats)
    about = (
        f"{settings.size:,} instances; {cpu_model()}, {available_processors()} processors; least and median of "
        f"{settings.repeats} rounds."
    )
    return Report(rows, [about, *NOTES])


def _peers(case: Case, thread_counts: list[int]) -> list[Peer]:
    scale = 1e9 / case.count
    kappa = case.indices()
    own = case.own_indices()
    unknowns = case.compiled.static_matrix.size

    def peer(what: str, who: str, threads: int, work: Callable[[], object]) -> Peer:
        return Peer(f"{case.name}: {what}", who, threads, work, scale, UNIT)

    return [
        peer("indices", "yasps", 1, case.own_indices),
        peer("indices", "NumPy", 1, case.indices),
        *(peer("structure", "yasps", threads, partial(case.build, threads, own)) for threads in thread_counts),
        peer("structure", "NumPy", 1, partial(numpy_structure, kappa, unknowns)),
        peer("structure", "SciPy", 1, partial(scipy_structure, kappa, unknowns)),
        *(peer("both", "yasps", threads, partial(case.build, threads)) for threads in thread_counts),
    ]
