"""Contact: which pieces of surfaces are close, and the energies that keep them apart."""

from yasps.contact.active_set import ActiveSet, Pairs, PlanePairs
from yasps.contact.barrier import BARRIERS, barrier, mollifier, paper_barrier
from yasps.contact.barrier_contact import BarrierContact
from yasps.contact.collision_geometry import Candidates, CollisionGeometry, narrowest_gap
from yasps.contact.contact_table import ContactTable
from yasps.contact.distances import squared_line_line, squared_point_line, squared_point_plane, squared_point_point
from yasps.contact.half_spaces import Plane
from yasps.contact.kinds import HALF_SPACE, KINDS, Kind
from yasps.contact.pair_primitive import ContactParts, PairPrimitive

__all__ = [
    "BARRIERS",
    "HALF_SPACE",
    "KINDS",
    "ActiveSet",
    "BarrierContact",
    "Candidates",
    "CollisionGeometry",
    "ContactParts",
    "ContactTable",
    "Kind",
    "PairPrimitive",
    "Pairs",
    "Plane",
    "PlanePairs",
    "barrier",
    "mollifier",
    "narrowest_gap",
    "paper_barrier",
    "squared_line_line",
    "squared_point_line",
    "squared_point_plane",
    "squared_point_point",
]
