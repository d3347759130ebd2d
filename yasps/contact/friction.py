"""Lagged smoothed Coulomb friction (Li et al. 2020, section 5), as functions of attributes.

At the beginning of a step, or of a lagging pass, normal forces, closest points and tangent planes of all close pairs
are fixed; friction then has a potential. Its argument is the slip: how far one piece has moved along the other since
the beginning of the step.
"""

from __future__ import annotations

from yasps import Attribute, constant, maximum, select
from yasps.contact.kinds import Kind

KINETIC_FROM = 10.0
"""Slip, in slip lengths, from which on friction is kinetic."""


def smoothed_distance(slip: Attribute, slip_length: Attribute) -> Attribute:
    """F of the length y of a slip [m], any shape: e/3 + y^2/e - y^3/(3 e^2) below the slip length e, y from there on.

    Twice continuously differentiable, at y = 0 too: F' = f1 = 2 y/e - y^2/e^2, then 1. Derivatives of the norm at 0 are
    the compiler's; they are right to rounding there and near it.
    """
    y = slip.norm()
    share = y / slip_length
    return select(y < slip_length, slip_length / 3 + y * share * (1 - share / 3), y)


def sliding_distance(slip: Attribute, slip_length: Attribute, static: Attribute, kinetic: Attribute) -> Attribute:
    """W, whose derivative by the length y of the slip is mu(y) f1(y): times the normal force, friction's potential [m].

    mu is the static coefficient up to the slip length e, the kinetic one from 10 e on, and falls from one to the other
    with two continuous derivatives in between (the polynomial 6 q^5 - 15 q^4 + 10 q^3). So friction reaches all of the
    static coefficient before anything slides; in ipctk's version of it mu falls within e already, and the force never
    does. Where both coefficients are equal, W is the coefficient times `smoothed_distance`, to the last bit.
    """
    width = (KINETIC_FROM - 1) * slip_length
    q = maximum(slip.norm() / width - 1 / (KINETIC_FROM - 1), constant(0.0))
    lost = select(q < 1, q**4 * (2.5 - q * (3 - q)), q - 0.5)
    return static * smoothed_distance(slip, slip_length) - (static - kinetic) * (width * lost)


def slip_of(kind: Kind, way: Attribute, lagged: Attribute) -> Attribute:
    """The slip of a pair, 2x1 [m]: how far its second piece has come along the first, in the lagged tangent basis.

    way: how far each of its vertices has come since the beginning of the step, arity x 3 [m]. lagged: the corners of
    the pair when it was lagged. Linear in the way, so that Hessians of friction are projected as 2x2 matrices.
    """
    return kind.tangents(lagged).T * (way.T * kind.weights(lagged))


def log_normal_force(
    squared_distance: Attribute, offset: Attribute, reach: Attribute, strength: Attribute
) -> Attribute:
    """-dE/dd [N] of the barrier E = strength d_hat beta(tau), beta = -(tau - 1)^2 ln(tau), tau = (d^2 - xi^2) / H.

    d is the distance, offset xi the sum of radii, reach d_hat [m], H = d_hat^2 + 2 xi d_hat; strength is weight [m^2]
    times mollifier times stiffness [Pa]. As negative as the weight, should that be.
    """
    d = squared_distance.sqrt()
    support = reach * (reach + 2 * offset)
    tau = (d - offset) * (d + offset) / support
    return strength * reach * (2 * d / support) * ((1 - tau) * ((1 - tau) / tau - 2 * tau.log()))


def paper_normal_force(squared_distance: Attribute, squared_reach: Attribute, strength: Attribute) -> Attribute:
    """-dE/dd [N] of the barrier E = strength (D - H)^2 log(D / H)^2 of the squared distance D = d^2 < H = d_hat^2.

    strength [J/m^4]: number of equal pairs times mollifier times stiffness.
    """
    gap, ratio = squared_reach - squared_distance, (squared_distance / squared_reach).log()
    d = squared_distance.sqrt()
    return 4 * strength * d * gap * ratio * (ratio - gap / squared_distance)
