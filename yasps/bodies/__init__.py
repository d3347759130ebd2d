"""Bodies: a mesh, its attributes and its energies in one call, all of it in plain sight.

Each class is what a user could have written with the language alone: it adds a mesh to the scene, and primitives,
attributes and energies to that, and keeps them where they are found (`soft.vertices["position"]`, `soft.tets`), so that
an energy of one's own is added in the next line. Inertia, gravity and contact come from `yasps.simulation`.
"""

from yasps.bodies.affine_body import AffineBody
from yasps.bodies.body import Body
from yasps.bodies.caged_body import CagedBody
from yasps.bodies.cloth import Cloth
from yasps.bodies.element_body import ElementBody
from yasps.bodies.joints import Hinge, Joint, Joints, Residual
from yasps.bodies.obstacle import Ground, HalfSpace, MovingObstacle, Obstacle
from yasps.bodies.rigid_body import RigidBody
from yasps.bodies.rod import Rod
from yasps.bodies.soft_body import SoftBody

__all__ = [
    "AffineBody",
    "Body",
    "CagedBody",
    "Cloth",
    "ElementBody",
    "Ground",
    "HalfSpace",
    "Hinge",
    "Joint",
    "Joints",
    "MovingObstacle",
    "Obstacle",
    "Residual",
    "RigidBody",
    "Rod",
    "SoftBody",
]
