"""Contact: which pieces of surfaces are close, and the energies that keep them apart."""

from yasps.contact.active_set import ActiveSet, MollifiedPairs, Pairs
from yasps.contact.barrier_contact import BarrierContact, barrier, mollifier
from yasps.contact.collision_geometry import Candidates, CollisionGeometry, narrowest_gap
from yasps.contact.contact_forces import ContactForces, ContactPairs, contact_forces
from yasps.contact.distances import squared_line_line, squared_point_line, squared_point_plane, squared_point_point
from yasps.contact.kinds import KINDS, Kind
from yasps.contact.separation import Separation, separate
from yasps.contact.start_state import Flipped, Overlap, StartState, Touching, check_start, start_state

__all__ = [
    "KINDS",
    "ActiveSet",
    "BarrierContact",
    "Candidates",
    "CollisionGeometry",
    "ContactForces",
    "ContactPairs",
    "Flipped",
    "Kind",
    "MollifiedPairs",
    "Overlap",
    "Pairs",
    "Separation",
    "StartState",
    "Touching",
    "barrier",
    "check_start",
    "contact_forces",
    "mollifier",
    "narrowest_gap",
    "separate",
    "squared_line_line",
    "squared_point_line",
    "squared_point_plane",
    "squared_point_point",
    "start_state",
]
