"""The rabbit, yasps' own test animal: a smooth union of ellipsoids, so that it comes at any resolution."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from yasps.meshes.isosurface_stuffing import stuff_isosurface_with_vertex_count
from yasps.meshes.tetrahedral_mesh import Float64Array, MeshError, TetrahedralMesh

FEWEST_VERTICES = 1500


@dataclass(frozen=True)
class Ellipsoid:
    """One part of the rabbit, which faces -y and stands on z = 0.

    Args:
        center, radii: in units of the rabbit's height.
        pitch: degrees about x; positive turns the front (-y) down and the top (+z) to the front.
        roll: degrees about y; positive leans the top (+z) to the side of +x.
        blend: how widely the part melts into the others, as a length.
        paired: whether its mirror image (x -> -x) is there too.
    """

    center: tuple[float, float, float]
    radii: tuple[float, float, float]
    pitch: float = 0.0
    roll: float = 0.0
    blend: float = 0.05
    paired: bool = False


PARTS = (
    Ellipsoid((0, 0.12, 0.250), (0.175, 0.235, 0.220), pitch=-18),  # body
    Ellipsoid((0, -0.09, 0.32), (0.125, 0.125, 0.19), pitch=12, blend=0.10),  # chest
    Ellipsoid((0, -0.185, 0.565), (0.118, 0.142, 0.118), pitch=14, blend=0.06),  # head
    Ellipsoid((0.036, -0.280, 0.520), (0.055, 0.058, 0.048), blend=0.03, paired=True),  # cheeks
    Ellipsoid((0.094, -0.230, 0.600), (0.022, 0.032, 0.032), blend=0.006, paired=True),  # eyes
    Ellipsoid((0.088, -0.095, 0.805), (0.056, 0.042, 0.195), pitch=-14, roll=13, blend=0.03, paired=True),  # ears
    Ellipsoid((0.135, 0.15, 0.165), (0.085, 0.155, 0.155), pitch=-12, blend=0.025, paired=True),  # haunches
    Ellipsoid((0.165, 0.075, 0.035), (0.050, 0.130, 0.042), blend=0.02, paired=True),  # hind feet
    Ellipsoid((0.072, -0.170, 0.155), (0.048, 0.050, 0.160), pitch=4, blend=0.035, paired=True),  # forelegs
    Ellipsoid((0.072, -0.210, 0.035), (0.046, 0.075, 0.040), blend=0.02, paired=True),  # front paws
    Ellipsoid((0, 0.350, 0.185), (0.078, 0.070, 0.078), blend=0.02),  # tail
)
GROUND_BLEND = 0.01


def rabbit(vertices: int = 5000) -> TetrahedralMesh:
    """A sitting rabbit of tetrahedra, one unit high, on the plane z = 0 and centred in x and y; it faces -y.

    Its surface is in one piece, closed and without holes. The same number gives the same mesh.

    Args:
        vertices: the wished number of vertices, at least 1500; the mesh comes within 5 % of it.

    Raises:
        MeshError: fewer vertices than the ears need.
    """
    if vertices < FEWEST_VERTICES:
        raise MeshError(
            f"A rabbit of {vertices} vertices was asked for, but its ears take at least {FEWEST_VERTICES}. "
            "For a smaller mesh take box() or sphere()."
        )
    mesh = stuff_isosurface_with_vertex_count(rabbit_surface, (-0.3, -0.42, -0.03), (0.3, 0.5, 1.05), vertices)
    low, high = mesh.bounds
    standing = mesh.translated((*(-0.5 * (low + high)[:2]), -low[2]))
    return standing.scaled(1.0 / float(high[2] - low[2]))


def rabbit_surface(points: Float64Array) -> Float64Array:
    """Negative inside the rabbit, positive outside, about a distance near its surface; for points [n, 3]."""
    # One half is enough: a pair's other part is far from this side, and both blend alike in the middle.
    folded = np.column_stack([np.abs(points[:, 0]), points[:, 1:]])
    value = ellipsoid_distance(folded, PARTS[0])
    for part in PARTS[1:]:
        own = ellipsoid_distance(folded, part)
        if part.paired:
            own = smooth_minimum(own, ellipsoid_distance(folded * (-1, 1, 1), part), part.blend)
        value = smooth_minimum(value, own, part.blend)
    # The part above the ground is the larger of the two values.
    standing: Float64Array = -smooth_minimum(-value, points[:, 2], GROUND_BLEND)
    return standing


def ellipsoid_distance(points: Float64Array, part: Ellipsoid) -> Float64Array:
    """About the signed distance to an ellipsoid: exact on its surface to first order.

    With k = |p / r|, the function k - 1 vanishes on the surface and its gradient has the length |p / r^2| / k: their
    quotient is a distance near the surface (Taubin, 1994), here times k to grow like one far away.
    """
    rotation = Rotation.from_euler("yx", [part.roll, part.pitch], degrees=True)
    local = rotation.inv().apply(points - np.array(part.center))
    radii = np.array(part.radii)
    scaled = np.linalg.norm(local / radii, axis=1)
    slope = np.linalg.norm(local / radii**2, axis=1)
    at_center = slope == 0
    near: Float64Array = scaled * (scaled - 1.0) / np.where(at_center, 1.0, slope)
    return np.asarray(np.where(at_center, -radii.min(), near))


def smooth_minimum(a: Float64Array, b: Float64Array, blend: float) -> Float64Array:
    """The smaller of two values, rounded off where they differ by less than `blend` (a quadratic; C1)."""
    overlap = np.maximum(blend - np.abs(a - b), 0.0)
    smaller: Float64Array = np.minimum(a, b) - 0.25 * overlap**2 / blend
    return smaller
