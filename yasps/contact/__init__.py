"""Contact: which pieces of surfaces are close, and the energies that keep them apart."""

from yasps.contact.active_set import ActiveSet, Pairs, PlanePairs
from yasps.contact.barrier import BARRIERS, barrier, mollifier, paper_barrier
from yasps.contact.barrier_contact import BarrierContact, ContactPast
from yasps.contact.collision_geometry import Candidates, CollisionGeometry, narrowest_gap
from yasps.contact.contact_forces import ContactForces, ContactPairs, contact_forces
from yasps.contact.contact_parts import ContactParts
from yasps.contact.contact_table import ContactTable
from yasps.contact.crushed_pairs import crushed_gradient
from yasps.contact.distances import squared_line_line, squared_point_line, squared_point_plane, squared_point_point
from yasps.contact.half_spaces import Plane
from yasps.contact.kinds import HALF_SPACE, KINDS, Kind
from yasps.contact.look_ahead import Constraints, LookAhead
from yasps.contact.pair_primitive import PairPrimitive
from yasps.contact.separation import Separation, separate
from yasps.contact.start_findings import Flipped, Overlap, StartState, Touching
from yasps.contact.start_state import check_start, start_state

__all__ = [
    "BARRIERS",
    "HALF_SPACE",
    "KINDS",
    "ActiveSet",
    "BarrierContact",
    "Candidates",
    "CollisionGeometry",
    "Constraints",
    "ContactForces",
    "ContactPairs",
    "ContactParts",
    "ContactPast",
    "ContactTable",
    "Flipped",
    "Kind",
    "LookAhead",
    "Overlap",
    "PairPrimitive",
    "Pairs",
    "Plane",
    "PlanePairs",
    "Separation",
    "StartState",
    "Touching",
    "barrier",
    "check_start",
    "contact_forces",
    "crushed_gradient",
    "mollifier",
    "narrowest_gap",
    "paper_barrier",
    "separate",
    "squared_line_line",
    "squared_point_line",
    "squared_point_plane",
    "squared_point_point",
    "start_state",
]
