"""Contact: which pieces of surfaces are close, and the energies that keep them apart."""

from yasps.contact.active_set import ActiveSet, Pairs
from yasps.contact.barrier_contact import BarrierContact, barrier, mollifier
from yasps.contact.collision_geometry import Candidates, CollisionGeometry, narrowest_gap
from yasps.contact.distances import squared_line_line, squared_point_line, squared_point_plane, squared_point_point
from yasps.contact.kinds import KINDS, Kind

__all__ = [
    "KINDS",
    "ActiveSet",
    "BarrierContact",
    "Candidates",
    "CollisionGeometry",
    "Kind",
    "Pairs",
    "barrier",
    "mollifier",
    "narrowest_gap",
    "squared_line_line",
    "squared_point_line",
    "squared_point_plane",
    "squared_point_point",
]
