"""Tetrahedra that fill an implicit surface, by isosurface stuffing (Labelle and Shewchuk, SIGGRAPH 2007).

The tetrahedra of a body-centred cubic lattice, of one size throughout, that lie inside are kept as they are; those
that the surface cuts are trimmed by a fixed stencil. Before that, every lattice point that the surface passes too
closely is moved onto it: this alone keeps all dihedral angles between 10.7 and 164.8 degrees, whatever the surface.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from yasps.frontend.language.arrays import real_numbers
from yasps.meshes.tetrahedral_mesh import TET_EDGES, Float64Array, MeshError, TetrahedralMesh, Vector

ImplicitSurface = Callable[[Float64Array], Float64Array]
IntArray = npt.NDArray[np.int64]

# A lattice point is moved onto the surface when the surface cuts one of its edges nearer to it than this fraction of
# the edge's length. Chosen by enumerating every way in which a tetrahedron can be warped and cut (the tests
# do it again): all dihedral angles stay between 10.77 and 164.71 degrees, within Labelle and Shewchuk's guarantee.
# More on long edges raises the largest angle; the smallest falls when the fraction on short edges goes either way.
ALPHA_LONG = 0.285
ALPHA_SHORT = 0.39875

FALSE_POSITION_STEPS = 4
SEARCH_STEPS = 16


class CoarseLatticeError(MeshError):
    """The lattice is too coarse for the surface: no point of it is inside, or the mesh touches itself."""


def stuff_isosurface(function: ImplicitSurface, lower: Vector, upper: Vector, spacing: float) -> TetrahedralMesh:
    """Fill the set where `function` is negative with well-shaped tetrahedra.

    Args:
        function: takes positions [n, 3], gives values [n]: negative inside, positive outside, continuous. A signed
            distance is not required.
        lower, upper: two corners [3] of a box that contains the surface.
        spacing: side of the lattice's cubes, in the units of the box. Edges come out between about 0.3 and 1.3 times
            this; features thinner than it are lost. There is a lattice point at the middle of the box's bottom.

    Returns:
        A mesh whose dihedral angles are between 10.7 and 164.8 degrees and whose surface is a closed 2-manifold.
        The same arguments give the same mesh.

    Raises:
        MeshError: the spacing is not positive or asks for too large a lattice, the function's values have the wrong
            shape or are not finite, nothing is inside, the surface leaves the box, or the spacing is so coarse that
            the surface touches itself.
    """
    lattice = Lattice.over_box(_corner(lower, "lower"), _corner(upper, "upper"), spacing)
    points = lattice.points()
    values = evaluate(function, points)
    lattice.check_contains(values)
    tets, right_handed = lattice.tets_touching(values < 0)
    signs = np.sign(values).astype(np.int8)

    cut = (signs[tets].min(axis=1) < 0) & (signs[tets].max(axis=1) > 0)
    cut_edges, edge_of_tet = lattice_edges_between_signs(tets[cut], signs)
    fraction = cut_fractions(function, points, values, cut_edges)
    warp_lattice(points, signs, lattice.colors(), cut_edges, fraction)
    start, end = points[cut_edges[:, 0]], points[cut_edges[:, 1]]
    nodes = np.concatenate([points, start + fraction[:, None] * (end - start)])

    # Each tetrahedron has ten nodes that a stencil may use: its corners and the cuts of its edges.
    node_table = np.full((len(tets), 10), -1, dtype=np.int64)
    node_table[:, :4] = tets
    node_table[cut, 4:] = len(points) + edge_of_tet
    filled = fill_stencils(node_table, signs[tets], right_handed)
    if not len(filled):
        raise CoarseLatticeError(
            f"No lattice point is inside the surface at spacing {spacing:g}: make the spacing smaller, "
            "and check that the function is negative inside."
        )
    used, numbered = np.unique(filled, return_inverse=True)
    mesh = TetrahedralMesh(nodes[used], numbered.reshape(-1, 4).astype(np.int32))
    pinched = mesh.surface_pinches()
    if len(pinched):
        raise CoarseLatticeError(
            f"At spacing {spacing:g} the surface touches itself at {len(pinched)} places, first near "
            f"{mesh.vertices[pinched[0]].round(4).tolist()}. A part or a gap there is about as thin as the lattice: "
            "make the spacing smaller (ask for more vertices), or the part thicker."
        )
    return mesh


def stuff_isosurface_with_vertex_count(
    function: ImplicitSurface, lower: Vector, upper: Vector, vertices: int, tolerance: float = 0.05
) -> TetrahedralMesh:
    """Like `stuff_isosurface`, with the spacing searched until the mesh has about `vertices` vertices.

    Args:
        vertices: the wished number of vertices.
        tolerance: how far, relatively, the number may be from the wish.

    Raises:
        MeshError: as `stuff_isosurface`; or no spacing was found, which happens for very small wishes.
    """
    low, high = _corner(lower, "lower"), _corner(upper, "upper")
    if vertices < 4:
        raise MeshError(f"A mesh of {vertices} vertices was asked for, but one tetrahedron alone has four.")
    # First guess: two lattice points per cube of the volume, which a coarse sampling of the box measures.
    samples = np.stack(np.meshgrid(*((np.arange(24) + 0.5) / 24,) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = np.count_nonzero(evaluate(function, low + samples * (high - low)) < 0) / len(samples)
    if inside == 0:
        raise MeshError("The function is nowhere negative in the box: there is nothing inside to fill.")
    spacing = float((2 * inside * np.prod(high - low) / vertices) ** (1 / 3))
    counts: list[int] = []
    for _ in range(SEARCH_STEPS):
        try:
            mesh = stuff_isosurface(function, low, high, spacing)
        except CoarseLatticeError:
            # Which lattice points come to lie on both sides of a narrow gap changes with the spacing.
            spacing *= 0.97
            continue
        counts.append(len(mesh.vertices))
        if abs(counts[-1] - vertices) <= tolerance * vertices:
            return mesh
        spacing *= (counts[-1] / vertices) ** (1 / 3)
    raise MeshError(
        f"No lattice spacing gave {vertices} vertices within {100 * tolerance:g} %: the search met {counts}. "
        "Ask for more vertices, or call stuff_isosurface with a spacing of your own."
    )


@dataclass(frozen=True)
class Lattice:
    """A body-centred cubic lattice: the corners of `cells` cubes of side `spacing`, then the centres of the cubes."""

    origin: Float64Array
    spacing: float
    cells: tuple[int, int, int]

    @staticmethod
    def over_box(lower: Float64Array, upper: Float64Array, spacing: float) -> "Lattice":
        if lower.shape != (3,) or upper.shape != (3,) or not (np.isfinite(upper - lower) & (lower < upper)).all():
            raise MeshError(
                f"The box reaches from {lower.tolist()} to {upper.tolist()}, but it must be given by its lowest and "
                "its highest corner, three finite numbers each."
            )
        if not (np.isfinite(spacing) and spacing > 0):
            raise MeshError(f"The lattice spacing is {spacing}, but a length must be a positive number.")
        size = upper - lower
        if float(np.prod(size / spacing)) > 2e8:
            raise MeshError(
                f"A spacing of {spacing:g} in a box of {size.tolist()} would need "
                f"{np.prod(size / spacing):.2g} cubes: make the spacing larger or the box smaller."
            )
        # An even number of cubes sideways puts a lattice point on the middle of the box, so that a symmetric surface
        # gets lattice points placed symmetrically; one cube more on every side keeps the surface off the border.
        half = np.ceil(size[:2] / (2 * spacing)).astype(int) + 1
        upward = int(np.ceil(size[2] / spacing)) + 2
        middle = 0.5 * (lower + upper)
        origin = np.array([*(middle[:2] - half * spacing), lower[2] - spacing])
        return Lattice(origin, spacing, (2 * int(half[0]), 2 * int(half[1]), upward))

    def points(self) -> Float64Array:
        """The corners, then the centres [n, 3]."""
        corners = np.indices([n + 1 for n in self.cells]).reshape(3, -1).T.astype(np.float64)
        centers = np.indices(self.cells).reshape(3, -1).T + 0.5
        return self.origin + self.spacing * np.concatenate([corners, centers])

    def colors(self) -> npt.NDArray[np.int8]:
        """A colour 0 to 3 for each point [n], such that no lattice edge joins two points of one colour."""
        corners = np.indices([n + 1 for n in self.cells]).sum(axis=0).ravel() % 2
        centers = np.indices(self.cells).sum(axis=0).ravel() % 2
        return np.concatenate([corners, centers + 2]).astype(np.int8)

    def check_contains(self, values: Float64Array) -> None:
        """Refuse a surface that reaches the border of the lattice, where it would be cut open."""
        corners = values[: int(np.prod([n + 1 for n in self.cells]))].reshape([n + 1 for n in self.cells])
        border = np.ones(corners.shape, dtype=bool)
        border[1:-1, 1:-1, 1:-1] = False
        leaving = np.count_nonzero(corners[border] <= 0)
        if leaving:
            raise MeshError(
                f"The surface leaves its box: the function is not positive at {leaving} of {border.sum()} lattice "
                "points around it. Give a larger box, and check that the function is positive outside."
            )

    def tets_touching(self, inside: npt.NDArray[np.bool_]) -> tuple[IntArray, npt.NDArray[np.bool_]]:
        """The lattice tetrahedra [m, 4] with a corner inside, and which of them are positively oriented [m].

        Each stands on an edge of a cube's face and has the centres of the two cubes of that face as its other corners.
        Its vertices are the two cube corners a0, a1 and the two centres b0, b1, so ordered that an even number
        of a0's coordinates exceed b0's. That is the parity on which the choice of diagonals rests.
        """
        corner_ids = np.arange(int(np.prod([n + 1 for n in self.cells]))).reshape([n + 1 for n in self.cells])
        center_ids = np.arange(int(np.prod(self.cells))).reshape(self.cells) + corner_ids.size
        tets, right_handed = [], []
        for axis in range(3):
            # The axes in cyclic order, so that counter-clockwise means the same for all three.
            cyclic = (axis, (axis + 1) % 3, (axis + 2) % 3)
            centers = center_ids.transpose(cyclic)
            corners = corner_ids.transpose(cyclic)[1:-1]
            below, above = centers[:-1], centers[1:]
            square = [corners[:, i : corners.shape[1] - 1 + i, j : corners.shape[2] - 1 + j] for i, j in _SQUARE]
            for k in range(4):
                # Coordinates of a0 relative to `below`: above it along the axis, and as _SQUARE says sideways.
                exceeds = 1 + sum(_SQUARE[k])
                a0, a1 = (square[k], square[(k + 1) % 4])[:: 1 if exceeds % 2 == 0 else -1]
                block = np.stack([a0, a1, below, above], axis=-1).reshape(-1, 4)
                block = block[inside[block].any(axis=1)]
                tets.append(block)
                # Walking the square counter-clockwise about the axis, and up the axis, is positive.
                right_handed.append(np.full(len(block), exceeds % 2 == 0))
        return np.concatenate(tets), np.concatenate(right_handed)


# The corners of a square in counter-clockwise order, as offsets along the second and third of its axes.
_SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))


def _corner(given: Vector, name: str) -> Float64Array:
    return real_numbers(given, f"the box's {name} corner", MeshError, finite=False)


def evaluate(function: ImplicitSurface, points: Float64Array) -> Float64Array:
    """The function's values [n] at points [n, 3], refused when they have another shape or are not finite."""
    values = real_numbers(function(points), "the function", MeshError, finite=False)
    if values.shape != (len(points),):
        raise MeshError(
            f"The function gave an array of shape {values.shape} for positions of shape {points.shape}, "
            f"but it must give one value for each position: {(len(points),)}."
        )
    broken = np.flatnonzero(~np.isfinite(values))
    if len(broken):
        raise MeshError(
            f"The function gave {values[broken[0]]} at {points[broken[0]].tolist()}, "
            f"and {len(broken)} such values in all: it must be finite in the whole box and one lattice cube around it."
        )
    return values


def lattice_edges_between_signs(tets: IntArray, signs: npt.NDArray[np.int8]) -> tuple[IntArray, IntArray]:
    """The edges that the surface cuts, as (inside, outside) points [k, 2], and the edge number [m, 6] of each
    tetrahedron's edges in the order of `TET_EDGES`, -1 where not cut."""
    ends = np.sort(tets[:, TET_EDGES], axis=2)
    crossing = signs[ends[..., 0]] * signs[ends[..., 1]] < 0
    keys, number = np.unique(ends[crossing] @ np.array([len(signs), 1]), return_inverse=True)
    edges = np.stack(np.divmod(keys, len(signs)), axis=1)
    edge_of_tet = np.full(crossing.shape, -1, dtype=np.int64)
    edge_of_tet[crossing] = number
    backward = signs[edges[:, 0]] > 0
    edges[backward] = edges[backward][:, ::-1]
    return edges, edge_of_tet


def cut_fractions(
    function: ImplicitSurface, points: Float64Array, values: Float64Array, edges: IntArray
) -> Float64Array:
    """Where along each edge, from its inside (0) to its outside end (1), the function vanishes [k].

    A few steps of false position with Illinois weights (Dowell and Jarratt, 1971): always between the ends, and far
    more exact than one interpolation where the function is not a distance.
    """
    start, end = points[edges[:, 0]], points[edges[:, 1]]
    low, high = np.zeros(len(edges)), np.ones(len(edges))
    value_low, value_high = values[edges[:, 0]], values[edges[:, 1]]
    side = np.zeros(len(edges), dtype=np.int8)
    fraction = value_low / (value_low - value_high)
    for _ in range(FALSE_POSITION_STEPS):
        value = evaluate(function, start + fraction[:, None] * (end - start))
        negative = value < 0
        # The end that stays twice in a row has its value halved, which pulls the next guess towards it.
        value_high = np.where(negative, np.where(side == -1, 0.5 * value_high, value_high), value)
        value_low = np.where(negative, value, np.where(side == 1, 0.5 * value_low, value_low))
        low, high = np.where(negative, fraction, low), np.where(negative, high, fraction)
        side = np.where(negative, -1, 1).astype(np.int8)
        gap = value_low - value_high
        # Both ends at zero: the root is met.
        step = np.divide(value_low, gap, out=np.zeros_like(gap), where=gap < 0)
        fraction = low + step * (high - low)
    return np.clip(fraction, 0.0, 1.0)


def warp_lattice(
    points: Float64Array,
    signs: npt.NDArray[np.int8],
    colors: npt.NDArray[np.int8],
    edges: IntArray,
    fraction: Float64Array,
) -> None:
    """Move the points that the surface passes too closely onto their nearest cut; their sign becomes 0 (in place).

    A moved point's edges are no longer cut, which may free its neighbours from moving: the order matters. Points of one
    colour share no edge, so that colour by colour, all points of it at once, is one valid order.
    """
    # Edges inside one of the two interlocked cubic lattices are long.
    long = colors[edges[:, 0]] // 2 == colors[edges[:, 1]] // 2
    alpha = np.where(long, ALPHA_LONG, ALPHA_SHORT)
    length = np.where(long, 1.0, np.sqrt(0.75))
    position = points[edges[:, 0]] + fraction[:, None] * (points[edges[:, 1]] - points[edges[:, 0]])
    for color in range(4):
        still_cut = (signs[edges] != 0).all(axis=1)
        for end, from_end in ((0, fraction), (1, 1.0 - fraction)):
            near = np.flatnonzero(still_cut & (colors[edges[:, end]] == color) & (from_end < alpha))
            # Farthest first: of several cuts at one point, the last to be written is the nearest.
            near = near[np.argsort(-from_end[near] * length[near], kind="stable")]
            points[edges[near, end]] = position[near]
            signs[edges[near, end]] = 0


def fill_stencils(node_table: IntArray, signs: npt.NDArray[np.int8], right_handed: npt.NDArray[np.bool_]) -> IntArray:
    """The tetrahedra [k, 4] that fill the inside part of each lattice tetrahedron, positively oriented.

    Args:
        node_table: for each lattice tetrahedron its four points and the cuts of its six edges [m, 10].
        signs: -1 inside, 0 on the surface, 1 outside, for its four points [m, 4].
        right_handed: whether the lattice tetrahedron is positively oriented [m].
    """
    code = (signs.astype(np.int64) + 1) @ 3 ** np.arange(4)
    filled = []
    for pattern in itertools.product((-1, 0, 1), repeat=4):
        chosen = np.flatnonzero(code == (np.array(pattern) + 1) @ 3 ** np.arange(4))
        for stencil in inside_stencil(pattern) if len(chosen) else ():
            tets = node_table[chosen][:, stencil]
            left = ~right_handed[chosen]
            tets[left] = tets[left][:, [0, 1, 3, 2]]
            filled.append(tets)
    return np.concatenate(filled) if filled else np.empty((0, 4), dtype=np.int64)


def inside_stencil(signs: tuple[int, ...]) -> list[list[int]]:
    """The tetrahedra that fill the inside part of a lattice tetrahedron a0, a1, b0, b1, as positions in its ten nodes.

    A cut face with two inside corners leaves a quadrilateral, and the two tetrahedra at that face must split it along
    the same diagonal. `owns_diagonal` decides from the face alone.
    """
    inside, on, outside = ([i for i in range(4) if signs[i] == s] for s in (-1, 0, 1))
    match len(inside), len(outside):
        case 0, _:
            tets = []
        case _, 0:
            tets = [[0, 1, 2, 3]]
        case 1, _:
            tets = [inside + on + [cut_node(inside[0], o) for o in outside]]
        case 2, 1:
            p, q = inside if owns_diagonal(inside[0], inside[1], outside[0]) else inside[::-1]
            cut_p, cut_q = cut_node(p, outside[0]), cut_node(q, outside[0])
            tets = [[p, q, cut_q, *on], [p, cut_q, cut_p, *on]]
        case 3, _:
            o = outside[0]
            ranked = sorted(inside, key=lambda p: -sum(owns_diagonal(p, q, o) for q in inside if q != p))
            tets = split_prism(ranked, [cut_node(p, o) for p in ranked])
        case _:
            (p, q), (o, r) = inside, outside
            if not owns_diagonal(p, q, o):
                o, r = r, o
            tets = split_prism([cut_node(p, r), p, cut_node(p, o)], [cut_node(q, r), q, cut_node(q, o)])
    return [positively_oriented(tet) for tet in tets]


def owns_diagonal(p: int, q: int, o: int) -> bool:
    """Whether the quadrilateral that is left of face p, q, o (o outside) is split along the diagonal from p, not q.

    Where one of the cut edges is long, the diagonal ends in the cut of the long edge. Otherwise p and q are of one kind
    and o is of the other: the parity rule takes the one with an even number of coordinates above o's, which by
    the order of `Lattice.tets_touching` are the pairs a0-b0, a1-b1, b0-a1 and b1-a0.
    """
    if p // 2 == o // 2 or q // 2 == o // 2:
        return q // 2 == o // 2
    return (p % 2 == o % 2) == (p < 2)


def cut_node(p: int, q: int) -> int:
    """The position, among the ten nodes of a lattice tetrahedron, of the cut of its edge p, q."""
    return 4 + [tuple(edge) for edge in TET_EDGES.tolist()].index((min(p, q), max(p, q)))


def split_prism(bottom: list[int], top: list[int]) -> list[list[int]]:
    """Three tetrahedra that fill a prism, with diagonals from bottom[i] to top[j] for i < j."""
    return [[*bottom, top[2]], [*bottom[:2], *top[1:]], [bottom[0], *top]]


def positively_oriented(tet: list[int]) -> list[int]:
    """The tetrahedron with its vertices so ordered that its volume is positive when the lattice one's is."""
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    nodes = np.concatenate([corners, corners[TET_EDGES].mean(axis=1)])
    a, b, c, d = nodes[tet]
    return tet if np.linalg.det([b - a, c - a, d - a]) > 0 else [tet[0], tet[1], tet[3], tet[2]]
