"""What contact adds to its mesh beside pairs: constants, laws, planes, and points with their areas."""

from __future__ import annotations

from dataclasses import dataclass

from yasps import Attribute, FloatArray, Mesh, Primitive, PrimitiveBase
from yasps.contact.barrier import BARRIERS, BarrierLaw
from yasps.contact.collision_geometry import CollisionGeometry
from yasps.contact.contact_table import ContactLaws
from yasps.contact.half_spaces import HalfSpaces
from yasps.contact.kinds import KINDS
from yasps.contact.surface_measures import SurfaceMeasures, add_surface_points

OWN_NAMES = (
    *("reach", "squared_reach", "slip_length", "laws", "planes", "ahead"),
    *("surface_points", "surface_triangles", "surface_edges", "surface_rods"),
    *(f"{kind}{part}" for kind in (*KINDS, "half_space") for part in ("", "_friction")),
)
"""What contact adds to its mesh."""


@dataclass(frozen=True)
class ContactParts:
    """What all kinds of contact of a scene share.

    vertices: with a 3x1 `position`. points: an instance a vertex, with `radius` and `rest_position`. laws: with
    `stiffness`, `friction`, `kinetic_friction`; planes: with a unit `normal` and a `point`, both 3x1. reach,
    squared_reach: d_hat [m] and its square. measures: None: weights are numbers of pairs. is_thick: whether a vertex
    has a radius; radii_vary: whether one piece of the surface has several.
    """

    mesh: Mesh
    vertices: PrimitiveBase
    points: Primitive
    laws: Primitive
    planes: Primitive | None
    reach: Attribute
    squared_reach: Attribute
    measures: SurfaceMeasures | None
    barrier: BarrierLaw
    is_thick: bool
    radii_vary: bool


def add_parts(
    mesh: Mesh,
    vertices: PrimitiveBase,
    geometry: CollisionGeometry,
    laws: ContactLaws,
    half_spaces: HalfSpaces,
    *,
    barrier: str,
    rest: FloatArray | None,
    radii: FloatArray,
    room: int,
) -> ContactParts:
    """Constants and primitives that all kinds read; rest: None for the attribute `rest_position` of the vertices.
    room: see `SurfaceMeasures`."""
    distance = geometry.activation_distance
    reach = mesh.add_constant("reach", 1, 1, value=distance)
    squared_reach = mesh.add_constant("squared_reach", 1, 1, value=distance**2)
    law = mesh.add_primitive("laws", len(laws.stiffness))
    for name in ("stiffness", "friction", "kinetic_friction"):
        law.add_constant(name, 1, 1, value=getattr(laws, name))
    planes = None
    if len(half_spaces):
        planes = mesh.add_primitive("planes", len(half_spaces))
        planes.add_constant("normal", 3, 1, value=half_spaces.normals)
        planes.add_constant("point", 3, 1, value=half_spaces.points)
    points = add_surface_points(mesh, vertices, rest, radii)
    return ContactParts(
        mesh=mesh,
        vertices=vertices,
        points=points,
        laws=law,
        planes=planes,
        reach=reach,
        squared_reach=squared_reach,
        measures=SurfaceMeasures(mesh, points, geometry, radii, room) if barrier != "paper" else None,
        barrier=BARRIERS[barrier],
        is_thick=bool(radii.any()),
        radii_vary=radii_vary(geometry, radii),
    )


def radii_vary(geometry: CollisionGeometry, radii: FloatArray) -> bool:
    """Whether one piece of the surface has several."""
    return any(bool((part != part[:, :1]).any()) for part in (radii[geometry.triangles], radii[geometry.edges]))
