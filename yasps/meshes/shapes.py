"""Simple shapes for scenes: boxes and spheres of tetrahedra, ground and cloth of triangles."""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from yasps.meshes.isosurface_stuffing import stuff_isosurface_with_vertex_count
from yasps.meshes.tetrahedral_mesh import Float64Array, Int32Array, MeshError, TetrahedralMesh

FEWEST_SPHERE_VERTICES = 100


class TriangleMesh(NamedTuple):
    """Vertices, float64 [n, 3], and triangles, int32 [m, 3], counter-clockwise when seen from the front."""

    vertices: Float64Array
    triangles: Int32Array


Corners = dict[tuple[int, ...], NDArray[np.int64]]


def grid_of_cells(size: tuple[float, float, float], divisions: tuple[int, int, int]) -> tuple[Float64Array, Corners]:
    """The vertices of a box of cells, its middle at the origin, [n, 3], and of each cell its corner at an offset of
    (0, 0, 0) to (1, 1, 1), as vertex numbers [cells]. Raises MeshError."""
    _check_size("box", size)
    _check_divisions("box", divisions)
    axes = (np.linspace(-0.5 * length, 0.5 * length, n + 1) for length, n in zip(size, divisions, strict=True))
    vertices = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(vertices)).reshape([n + 1 for n in divisions])
    return vertices, {
        offset: number[tuple(slice(o, o + n) for o, n in zip(offset, divisions, strict=True))].ravel()
        for offset in itertools.product((0, 1), repeat=3)
    }


def box(
    size: tuple[float, float, float] = (1.0, 1.0, 1.0), divisions: tuple[int, int, int] = (8, 8, 8)
) -> TetrahedralMesh:
    """A box of tetrahedra, its middle at the origin; every cell of the grid is cut into six tetrahedra (Kuhn, 1960).

    Args:
        size: lengths along x, y, z, positive.
        divisions: cells along x, y, z, at least 1.

    Raises:
        MeshError: a length is not positive or a number of cells is below 1.
    """
    vertices, corner = grid_of_cells(size, divisions)
    # Each path along three edges from the lowest to the highest corner of a cell spans one tetrahedron; all six share
    # the cell's diagonal, and neighbouring cells cut their common face alike.
    tets = []
    for first, second, third in itertools.permutations(range(3)):
        one, two = (tuple(int(axis in walked) for axis in range(3)) for walked in ((first,), (first, second)))
        path = [corner[0, 0, 0], corner[one], corner[two], corner[1, 1, 1]]
        is_even = (first, second, third) in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        tets.append(np.stack(path if is_even else [path[0], path[2], path[1], path[3]], axis=1))
    # Cell by cell rather than path by path, for locality.
    return TetrahedralMesh(vertices, np.stack(tets, axis=1).reshape(-1, 4).astype(np.int32))


def sphere(radius: float = 1.0, vertices: int = 1000) -> TetrahedralMesh:
    """A ball of tetrahedra, its middle at the origin.

    Args:
        radius: positive.
        vertices: the wished number of vertices, at least 100; the mesh comes within 5 % of it from 300 on and within
            20 % below, where so symmetric a shape fits the lattice in few ways only.

    Raises:
        MeshError: the radius is not positive, or fewer than 100 vertices are asked for.
    """
    _check_size("sphere", (radius,))
    if vertices < FEWEST_SPHERE_VERTICES:
        raise MeshError(
            f"A sphere of {vertices} vertices was asked for, but at least {FEWEST_SPHERE_VERTICES} make it round."
        )
    reach = (1.05 * radius,) * 3
    return stuff_isosurface_with_vertex_count(
        lambda points: np.linalg.norm(points, axis=1) - radius,
        tuple(-r for r in reach),
        reach,
        vertices,
        tolerance=0.05 if vertices >= 300 else 0.2,
    )


def ground(
    size: tuple[float, float] = (10.0, 10.0), z: float = 0.0, divisions: tuple[int, int] = (1, 1)
) -> TriangleMesh:
    """A level rectangle of triangles that faces up (+z), its middle above the origin.

    Args:
        size: lengths along x and y, positive.
        z: height.
        divisions: cells along x and y, at least 1; each is two triangles.

    Raises:
        MeshError: a length is not positive, a number of cells is below 1, or the height is not finite.
    """
    _check_size("ground", size)
    _check_divisions("ground", divisions)
    if not np.isfinite(z):
        raise MeshError(f"The height of the ground is {z}, but it must be a finite number.")
    return _level_grid(size, z, divisions)


def cloth_grid(
    size: tuple[float, float] = (1.0, 1.0), divisions: tuple[int, int] = (40, 40), z: float = 0.0
) -> TriangleMesh:
    """A level piece of cloth, its middle above the origin; the diagonals alternate, so that no direction is favoured.

    Args:
        size: lengths along x and y, positive.
        divisions: cells along x and y, at least 1; each is two triangles.
        z: height.

    Raises:
        MeshError: a length is not positive, a number of cells is below 1, or the height is not finite.
    """
    _check_size("cloth", size)
    _check_divisions("cloth", divisions)
    if not np.isfinite(z):
        raise MeshError(f"The height of the cloth is {z}, but it must be a finite number.")
    return _level_grid(size, z, divisions)


def _level_grid(size: tuple[float, float], z: float, divisions: tuple[int, int]) -> TriangleMesh:
    x, y = (np.linspace(-0.5 * length, 0.5 * length, n + 1) for length, n in zip(size, divisions, strict=True))
    vertices = np.stack([*np.meshgrid(x, y, indexing="ij"), np.full((len(x), len(y)), float(z))], axis=-1)
    number = np.arange(len(x) * len(y)).reshape(len(x), len(y))
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    odd = (np.indices(divisions).sum(axis=0) % 2 == 1)[..., None]
    rising = np.stack([a, b, c, a, c, d], axis=-1)
    falling = np.stack([a, b, d, b, c, d], axis=-1)
    triangles = np.where(odd, falling, rising).reshape(-1, 3)
    return TriangleMesh(vertices.reshape(-1, 3), triangles.astype(np.int32))


def _check_size(shape: str, size: tuple[float, ...]) -> None:
    if not all(np.isfinite(length) and length > 0 for length in size):
        raise MeshError(f"The size of the {shape} is {size}, but every length must be a positive number.")


def _check_divisions(shape: str, divisions: tuple[int, ...]) -> None:
    if not all(isinstance(n, int | np.integer) and n >= 1 for n in divisions):
        raise MeshError(
            f"The divisions of the {shape} are {divisions}, but there must be a whole number of cells, "
            "at least 1, along each side."
        )
