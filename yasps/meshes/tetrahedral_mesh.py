"""A tetrahedral mesh that has been checked once, so that nothing after it needs to check again."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from yasps import YaspsError
from yasps.frontend.language.arrays import plain_array, real_numbers

Float64Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]
Vector = Sequence[float] | Float64Array

# The faces of a positively oriented tetrahedron; counter-clockwise when seen from outside. Face i is opposite vertex i.
TET_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
TET_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])

# A tetrahedron flatter than this (volume over the cube of its longest edge) has lost its shape to round-off.
# The regular one has 0.118.
FLATNESS_LIMIT = 1e-12


class MeshError(YaspsError, ValueError):
    """A mesh, or a file that should hold one, is not what its use requires."""


@dataclass(frozen=True, eq=False, repr=False)
class TetrahedralMesh:
    """A mesh of linear tetrahedra: every one positively oriented, every vertex used.

    Args:
        vertices: positions, real numbers [n, 3]; kept as float64.
        tets: vertex indices, integers [m, 4]; kept as int32. Tetrahedron (a, b, c, d) is positively oriented when
            (b - a) x (c - a) . (d - a) > 0, that is when a, b, c run counter-clockwise seen from d's far side.

    The arrays are copied and made read-only. Two meshes are equal only when they are the same object.

    Raises:
        MeshError: wrong shape or type of number, no tetrahedra, NaN or infinity, an index out of range, a flat or
            inverted tetrahedron, or a vertex that no tetrahedron uses. Vertices are refused here rather than
            dropped, because dropping renumbers the others behind the caller's back; `drop_unused_vertices` does it
            on request.
    """

    vertices: Float64Array
    tets: Int32Array

    def __post_init__(self) -> None:
        vertices = _checked_vertices(self.vertices)
        tets = _checked_tets(self.tets, len(vertices))
        _check_orientation(vertices, tets)
        unused = np.flatnonzero(np.bincount(tets.ravel(), minlength=len(vertices)) == 0)
        if len(unused):
            raise MeshError(
                f"{len(unused)} of {len(vertices)} vertices belong to no tetrahedron; the first is vertex {unused[0]}. "
                "Such a vertex would have no mass. Remove them: "
                "TetrahedralMesh(*drop_unused_vertices(vertices, tets))."
            )
        vertices.flags.writeable = False
        tets.flags.writeable = False
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "tets", tets)

    def __repr__(self) -> str:
        low, high = self.bounds
        corners = " to ".join("(" + ", ".join(f"{x:.3g}" for x in corner) + ")" for corner in (low, high))
        return (
            f"TetrahedralMesh({len(self.vertices)} vertices, {len(self.tets)} tets, "
            f"volume {self.volumes().sum():.3g}, from {corners})"
        )

    @property
    def bounds(self) -> tuple[Float64Array, Float64Array]:
        """The lowest and the highest corner [3] of the axis-aligned bounding box."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)

    @cached_property
    def edges(self) -> Int32Array:
        """All edges [k, 2], each once, with the smaller vertex first, in increasing order."""
        return _unique_edges(self.tets[:, TET_EDGES].reshape(-1, 2))

    def volumes(self) -> Float64Array:
        """The volume of each tetrahedron [m]; all are positive."""
        return signed_volumes(self.vertices, self.tets)

    def vertex_masses(self, density: float) -> Float64Array:
        """Lumped masses [n]: each tetrahedron gives a quarter of its mass to each of its vertices.

        Args:
            density: mass per volume, positive (kg/m^3 when lengths are metres).

        Raises:
            MeshError: the density is not a positive number.
        """
        if not (np.isfinite(density) and density > 0):
            raise MeshError(f"The density is {density}, but a mass per volume must be a positive number.")
        quarter = np.repeat(0.25 * density * self.volumes(), 4)
        masses: Float64Array = np.bincount(self.tets.ravel(), quarter, len(self.vertices)).astype(np.float64)
        return masses

    def surface_triangles(self) -> Int32Array:
        """The triangles [k, 3] that belong to one tetrahedron only, counter-clockwise when seen from outside.

        Raises:
            MeshError: more than two tetrahedra share a triangle, so that they overlap or appear twice.
        """
        faces = self.tets[:, TET_FACES].reshape(-1, 3)
        _, first, count = _unique_rows(np.sort(faces, axis=1))
        if count.max() > 2:
            worst = int(np.argmax(count > 2))
            face = faces[first[worst]].tolist()
            raise MeshError(
                f"{np.count_nonzero(count > 2)} triangles are shared by more than two tetrahedra; the first is "
                f"{face}, shared by {count[worst]}. Tetrahedra overlap or appear twice: "
                "remove the duplicates or mesh the shape again."
            )
        surface: Int32Array = faces[np.sort(first[count == 1])]
        return surface

    def surface_edges(self) -> Int32Array:
        """The edges [k, 2] of the surface triangles, each once, with the smaller vertex first, in increasing order."""
        return _unique_edges(self.surface_triangles()[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2))

    def surface_pinches(self) -> Int32Array:
        """The vertices [k] where the surface touches itself, increasing; empty for a closed 2-manifold.

        These are the ends of edges that more than two surface triangles share and the vertices whose surface triangles
        form several fans.
        """
        triangles = self.surface_triangles().astype(np.int64)
        start, end = triangles, np.roll(triangles, -1, axis=1)
        low, high = np.minimum(start, end).ravel(), np.maximum(start, end).ravel()
        keys, edge, count = np.unique(low << 32 | high, return_inverse=True, return_counts=True)
        if (count != 2).any():
            crowded = keys[count != 2]
            return np.unique(np.concatenate([crowded >> 32, crowded & 0xFFFFFFFF])).astype(np.int32)
        # One node for each corner of each triangle. The two triangles of an edge run along it in opposite directions:
        # the corner where one starts is joined to the corner where the other ends. A fan is then a component.
        corners = np.arange(triangles.size).reshape(-1, 3)
        first, second = np.argsort(edge, kind="stable").reshape(-1, 2).T
        starts, ends = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
        joined = np.concatenate([starts[first], ends[first]]), np.concatenate([ends[second], starts[second]])
        graph = coo_array((np.ones(len(joined[0]), dtype=np.int8), joined), shape=(triangles.size,) * 2)
        _, fan = connected_components(graph, directed=False)
        _, corner = np.unique(fan, return_index=True)
        fans = np.bincount(triangles.ravel()[corner])
        return np.flatnonzero(fans > 1).astype(np.int32)

    def translated(self, offset: Vector) -> "TetrahedralMesh":
        """The mesh moved by `offset` [3]."""
        return TetrahedralMesh(self.vertices + _vector(offset, "offset"), self.tets)

    def scaled(self, factor: float | Vector) -> "TetrahedralMesh":
        """The mesh scaled about the origin by one positive factor, or by one for each axis [3].

        Raises:
            MeshError: a factor is zero or negative (a mirror image would turn every tetrahedron inside out).
        """
        factors = np.full(3, float(factor)) if np.ndim(factor) == 0 else _vector(factor, "factor")  # type: ignore[arg-type]
        if not (np.isfinite(factors) & (factors > 0)).all():
            raise MeshError(f"The scale factor is {factor}, but every factor must be a positive number.")
        return TetrahedralMesh(self.vertices * factors, self.tets)

    def rotated(self, axis: Vector, angle: float) -> "TetrahedralMesh":
        """The mesh turned about an axis [3] through the origin by `angle` radians (right-hand rule).

        Raises:
            MeshError: the axis is zero.
        """
        direction = _vector(axis, "axis")
        length = float(np.linalg.norm(direction))
        if length == 0 or not np.isfinite(angle):
            raise MeshError(
                f"Cannot rotate about axis {direction.tolist()} by {angle} radians: "
                "the axis must not be zero and the angle must be a number."
            )
        rotation = Rotation.from_rotvec(direction * (angle / length)).as_matrix()
        return TetrahedralMesh(self.vertices @ rotation.T, self.tets)

    def centered(self, center: Vector = (0.0, 0.0, 0.0)) -> "TetrahedralMesh":
        """The mesh moved so that the middle of its bounding box is at `center` [3]."""
        low, high = self.bounds
        return self.translated(_vector(center, "center") - 0.5 * (low + high))

    def fitted(self, size: float = 1.0) -> "TetrahedralMesh":
        """The mesh scaled evenly, about the middle of its bounding box, until the box's longest side is `size`."""
        low, high = self.bounds
        middle = 0.5 * (low + high)
        return self.centered().scaled(size / float((high - low).max())).translated(middle)


def signed_volumes(vertices: Float64Array, tets: npt.NDArray[np.integer]) -> Float64Array:
    """det[b - a, c - a, d - a] / 6 of each tetrahedron (a, b, c, d) [m]; negative where it is inverted."""
    a, b, c, d = (vertices[tets[:, i]] for i in range(4))
    return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0)


def flip_inverted_tets(vertices: Float64Array, tets: npt.NDArray[np.integer]) -> tuple[npt.NDArray[np.integer], int]:
    """Make every tetrahedron positively oriented by swapping the last two vertices of the inverted ones.

    Right for meshes from tools with the other orientation convention; wrong for a mesh whose tetrahedra have been
    pushed through each other, which still overlap afterwards. Flat tetrahedra stay flat.

    Returns:
        The tetrahedra [m, 4] and how many were flipped. The arguments are unchanged.

    Raises:
        MeshError: an index out of range, or what are no indices.
    """
    tets = _checked_tets(tets, len(vertices))
    inverted = signed_volumes(vertices, tets) < 0
    flipped = tets.copy()
    flipped[inverted, 2], flipped[inverted, 3] = tets[inverted, 3], tets[inverted, 2]
    return flipped, int(np.count_nonzero(inverted))


def drop_unused_vertices(
    vertices: Float64Array, tets: npt.NDArray[np.integer]
) -> tuple[Float64Array, npt.NDArray[np.integer]]:
    """Remove the vertices that no tetrahedron uses and renumber the others, keeping their order.

    Raises:
        MeshError: an index out of range, or what are no indices.
    """
    tets = _checked_tets(tets, len(vertices))
    used = np.zeros(len(vertices), dtype=bool)
    used[tets] = True
    return vertices[used], (np.cumsum(used) - 1)[tets]


def _checked_vertices(given: npt.ArrayLike) -> Float64Array:
    array = plain_array(given, "vertices", MeshError)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
        raise MeshError(
            f"vertices is an array of shape {array.shape} of {array.dtype}, "
            "but positions are real numbers of shape [n, 3]."
        )
    vertices = np.array(array, dtype=np.float64, order="C")
    broken = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(broken):
        raise MeshError(
            f"{len(broken)} of {len(vertices)} vertices are not finite; the first is vertex {broken[0]}, at "
            f"{vertices[broken[0]].tolist()}. Repair the positions before making a mesh of them."
        )
    return vertices


def _checked_tets(given: npt.ArrayLike, vertex_count: int) -> Int32Array:
    array = plain_array(given, "tets", MeshError)
    if array.ndim != 2 or array.shape[1] != 4 or array.dtype.kind not in "iu":
        raise MeshError(
            f"tets is an array of shape {array.shape} of {array.dtype}, "
            "but vertex indices are integers of shape [m, 4]."
        )
    if len(array) == 0:
        raise MeshError("There are no tetrahedra: a mesh needs at least one.")
    if vertex_count > np.iinfo(np.int32).max:
        raise MeshError(f"There are {vertex_count} vertices, more than 32-bit indices can count. Use a coarser mesh.")
    outside = np.flatnonzero(((array < 0) | (array >= vertex_count)).any(axis=1))
    if len(outside):
        hint = " Indices start at 0." if array.min() > 0 else ""
        raise MeshError(
            f"{len(outside)} of {len(array)} tetrahedra use a vertex that does not exist; the first is tetrahedron "
            f"{outside[0]}, {array[outside[0]].tolist()}, but there are {vertex_count} vertices.{hint}"
        )
    return np.array(array, dtype=np.int32, order="C")


def _check_orientation(vertices: Float64Array, tets: Int32Array) -> None:
    volumes = signed_volumes(vertices, tets)
    corners = vertices[tets]
    longest = np.linalg.norm(corners[:, TET_EDGES[:, 0]] - corners[:, TET_EDGES[:, 1]], axis=2).max(axis=1)
    flat = np.flatnonzero(np.abs(volumes) <= FLATNESS_LIMIT * longest**3)
    if len(flat):
        raise MeshError(
            f"{len(flat)} of {len(tets)} tetrahedra are flat; the first is tetrahedron {flat[0]}, "
            f"{tets[flat[0]].tolist()}, of volume {volumes[flat[0]]:.3g}. "
            "A flat tetrahedron has no deformation to measure: remove it or mesh the shape again."
        )
    inverted = np.flatnonzero(volumes < 0)
    if len(inverted):
        raise MeshError(
            f"{len(inverted)} of {len(tets)} tetrahedra are inverted (negative volume); the first is tetrahedron "
            f"{inverted[0]}, {tets[inverted[0]].tolist()}, of volume {volumes[inverted[0]]:.3g}. If the file uses the "
            "other orientation, flip them: flip_inverted_tets(vertices, tets), "
            "or read_tetrahedral_mesh(path, flip_inverted=True)."
        )


def _vector(given: Vector, name: str) -> Float64Array:
    vector = real_numbers(given, f"the {name}", MeshError, finite=False)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise MeshError(f"The {name} is {given}, but it must be three finite numbers.")
    return vector


def _unique_edges(pairs: Int32Array) -> Int32Array:
    ordered = np.sort(pairs, axis=1).astype(np.int64)
    # Two indices of 31 bits fit in one key, and sorting keys is several times faster than sorting rows.
    keys = np.unique(ordered[:, 0] << 32 | ordered[:, 1])
    return np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=1).astype(np.int32)


def _unique_rows(rows: Int32Array) -> tuple[Int32Array, npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """The distinct rows, where each first occurs, and how often; in place of np.unique(axis=0), ten times slower."""
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    starts = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])
    begin = np.flatnonzero(starts)
    return ordered[begin], order[begin], np.diff(np.append(begin, len(rows)))
