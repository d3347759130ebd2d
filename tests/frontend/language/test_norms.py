"""Scenes where norms are 0: what is smooth has its stiffness, what is not is reported; on both kinds of device."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from cuda_on_host import HostDevice
from numpy.typing import NDArray

from yasps import Attribute, DataError, NotFiniteError, Scene, atan2, concat_cols, concat_rows, identity, stumpff, zeros

Array = NDArray[np.float64]

SMOOTH: dict[str, tuple[Callable[[Attribute], Attribute], float, float]] = {
    "a square": (lambda d: d.norm() ** 2, 0.0, 2.0),
    "an angle": (lambda d: atan2(d.norm(), 0.5) ** 2, 0.0, 8.0),
    "a cube": (lambda d: d.norm() ** 3, 0.0, 0.0),
    "sin(2 n) / n": (lambda d: (2 * d.norm()).sin() / d.norm(), 2.0, -8 / 3),
}
"""Energies of a vector, their value and the multiple of the identity that is their Hessian where it is 0."""


@pytest.fixture(scope="module")
def host() -> HostDevice:
    return HostDevice()


@pytest.fixture(params=["cpu", "cuda"])
def device(request: pytest.FixtureRequest, host: HostDevice) -> Any:
    return "cpu" if request.param == "cpu" else host


def hessian(scene: Scene) -> Array:
    return scene.hessian(projected=False).to_scipy().toarray()


def test_smooth_energies_have_their_hessians(device: Any) -> None:
    """One term for each instance; at 0, and by a hair beside it."""
    count = len(SMOOTH)
    scene = Scene("s", device=device)
    points = scene.add_mesh("m").add_primitive("v", count)
    x = points.add_attribute("x", 3, 1, value=np.ones((count, 3)))
    offset = x - points.add_constant("p", 3, 1, value=np.ones((count, 3)))
    one = points.add_constant("one", count, 1, value=np.eye(count))
    terms = [one[k] * write(offset) for k, (write, _, _) in enumerate(SMOOTH.values())]
    scene.add_energy(points.add_attribute("e", computed_attribute=sum(terms)), projection="none")
    scene.add_minimize_target(x)
    expected = np.kron(np.diag([c for _, _, c in SMOOTH.values()]), np.eye(3))
    assert scene.total_energy() == pytest.approx(sum(value for _, value, _ in SMOOTH.values()), rel=1e-15)
    np.testing.assert_array_equal(scene.gradient()[0], np.zeros(3 * count))
    np.testing.assert_allclose(hessian(scene), expected, rtol=1e-14, atol=1e-300)
    points["p"].update_value(np.zeros((count, 3)))
    beside = np.tile([0.6e-7, -0.8e-7, 0.0], (count, 1))
    x.update_value(beside)
    np.testing.assert_allclose(hessian(scene), expected, rtol=1e-12, atol=1e-6)  # of the cube: 1e-7
    np.testing.assert_allclose(scene.gradient()[0], expected @ beside.ravel(), rtol=1e-12, atol=1e-13)


def test_points_pinned_at_their_targets_hold() -> None:
    """A weight of 9.8 N on a pin of 2e4 N/m."""
    scene = Scene("pinned")
    points = scene.add_mesh("m").add_primitive("v", 2)
    x = points.add_attribute("x", 3, 1, value=np.ones((2, 3)))
    scene.add_energy(points.add_attribute("pin", computed_attribute=1e4 * (x - np.ones((3, 1))).norm() ** 2))
    scene.add_energy(points.add_attribute("weight", computed_attribute=9.8 * x[2]))
    scene.add_minimize_target(x)
    step = scene.minimize_energy(tolerance=1e-24)[0]
    np.testing.assert_allclose(step, np.tile([0.0, 0.0, 4.9e-4], 2), rtol=1e-12)


def test_a_straight_rod_resists_bending() -> None:
    """Half the square of the angle at the middle one of three points, 1 apart: k k^T across the rod, k = (1, -2, 1)."""
    scene = Scene("rod")
    mesh = scene.add_mesh("m")
    points, rods = mesh.add_primitive("v", 3), mesh.add_primitive("rods", 1)
    x = points.add_attribute("x", 1, 3, value=[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    ends = rods.add_connectivity("ends", points, [0, 1, 2], 3)
    corner = rods.add_attribute("corner", through=ends, source=x)
    a, b = corner.row(1) - corner.row(0), corner.row(2) - corner.row(1)
    angle = atan2(a.cross(b).norm(), a.dot(b))
    scene.add_energy(rods.add_attribute("bending", computed_attribute=0.5 * angle * angle))
    scene.add_minimize_target(x)
    k = np.array([1.0, -2.0, 1.0])
    np.testing.assert_allclose(hessian(scene), np.kron(np.outer(k, k), np.diag([0.0, 1.0, 1.0])), atol=1e-14)
    np.testing.assert_array_equal(scene.gradient()[0], np.zeros(9))


def test_a_minimum_moves_with_its_parameter() -> None:
    """Of 2 |x - p|^2 + x^2 / 2: dx/dp = 4 / 5, also where x = p."""
    scene = Scene("inverse")
    points = scene.add_mesh("m").add_primitive("v", 1)
    x, p = points.add_attribute("x", 3, 1), points.add_constant("p", 3, 1)
    energy = 2.0 * (x - p).norm() ** 2 + 0.5 * x.norm() * x.norm()
    scene.add_energy(points.add_attribute("e", computed_attribute=energy))
    scene.add_minimize_target(x)
    moved = -np.linalg.solve(hessian(scene), scene.mixed_hessian(x, p).toarray())
    np.testing.assert_allclose(moved, 0.8 * np.eye(3), rtol=1e-14)


def cross_matrix(r: Attribute) -> Attribute:
    zero = zeros(1, 1)
    rows = [[zero, -r[2], r[1]], [r[2], zero, -r[0]], [-r[1], r[0], zero]]
    return concat_rows([concat_cols(row) for row in rows])


def by_matrix(r: Attribute) -> Attribute:
    n, k = r.norm(), cross_matrix(r)
    return identity(3) + n.sin() / n * k + (1 - n.cos()) / (n * n) * k * k


def by_axis(r: Attribute) -> Attribute:
    n = r.norm()
    k = cross_matrix(r / n)
    return identity(3) + n.sin() * k + (1 - n.cos()) * k * k


def by_axis_and_cosine(r: Attribute) -> Attribute:
    n = r.dot(r).sqrt()
    axis = r / n
    return n.cos() * identity(3) + n.sin() * cross_matrix(axis) + (1 - n.cos()) * axis * axis.T


def by_half_angles(r: Attribute) -> Attribute:
    n = r.norm()
    v, w = (0.5 * n).sin() / n * r, (0.5 * n).cos()
    return identity(3) + 2 * w * cross_matrix(v) + 2 * cross_matrix(v) * cross_matrix(v)


def rotating_body(rotation: Callable[[Attribute], Attribute], rest: Array, goal: Array, device: Any) -> Scene:
    """Points of a body turned by a rotation vector of 0, drawn to other points."""
    scene = Scene("body", device=device)
    mesh = scene.add_mesh("m")
    body, points, springs = mesh.add_primitive("b", 1), mesh.add_primitive("v", 2), mesh.add_primitive("s", 2)
    r = body.add_attribute("r", 3, 1)
    body.add_attribute("rotation", computed_attribute=rotation(r))
    of = points.add_connectivity("of", body, [0, 0], 1)
    turned = points.add_attribute("turned", through=of, source=body["rotation"]).reshape(3, 3)
    points.add_attribute("x", computed_attribute=turned * points.add_constant("rest", 3, 1, value=rest))
    at = springs.add_connectivity("at", points, [0, 1], 1)
    offset = springs.add_attribute("x", through=at, source=points["x"]).reshape(3, 1)
    offset = offset - springs.add_constant("goal", 3, 1, value=goal)
    scene.add_energy(springs.add_attribute("e", computed_attribute=0.5 * offset.dot(offset)))
    scene.add_minimize_target(r)
    return scene


@pytest.mark.parametrize("rotation", [by_matrix, by_axis, by_axis_and_cosine, by_half_angles])
def test_a_rigid_body_at_rotation_zero(rotation: Callable[[Attribute], Attribute], host: HostDevice) -> None:
    """Against R x = x + r x x + r x (r x x) / 2 + ..., also through two layers of JOINs."""
    random = np.random.default_rng(3)
    rest, goal = random.standard_normal((2, 2, 3))
    gradient, curvature = np.zeros(3), np.zeros((3, 3))
    turns = np.eye(3)
    for x, q in zip(rest, goal, strict=True):
        moved = np.cross(turns, x)
        gradient += moved @ (x - q)
        twice = np.array([[np.cross(turns[i], moved[j]) for j in range(3)] for i in range(3)])
        curvature += moved @ moved.T + 0.5 * (twice + twice.swapaxes(0, 1)) @ (x - q)
    devices = ["cpu", host] if rotation is by_matrix else ["cpu"]
    for device in devices:
        scene = rotating_body(rotation, rest, goal, device)
        np.testing.assert_allclose(scene.gradient()[0], gradient, rtol=1e-12)
        np.testing.assert_allclose(hessian(scene), curvature, rtol=1e-12, atol=1e-14)


# -- what has no derivatives ---------------------------------------------------------------------------------


def test_a_spring_of_no_length_is_named(device: Any) -> None:
    scene = Scene("s", device=device)
    points = scene.add_mesh("m").add_primitive("v", 3)
    x = points.add_attribute("x", 3, 1, value=[[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    scene.add_energy(points.add_attribute("spring", computed_attribute=(x.norm() - 1.0) ** 2))
    scene.add_minimize_target(x)
    for work in (scene.gradient, scene.hessian, scene.minimize_energy, lambda: scene.hessian(projected=False)):
        with pytest.raises(NotFiniteError, match=r"derivatives of energy m\.v\.spring are not finite on instance 1;"):
            work()
    assert scene.total_energy() == 2.0


def test_a_norm_behind_a_join_is_reported_too(device: Any) -> None:
    """The energy does not see that its input is a norm; its derivatives with respect to that are finite."""
    scene = Scene("s", device=device)
    mesh = scene.add_mesh("m")
    points, pairs = mesh.add_primitive("v", 2), mesh.add_primitive("p", 1)
    x = points.add_attribute("x", 3, 1, value=[[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    points.add_attribute("length", computed_attribute=x.norm())
    ends = pairs.add_connectivity("ends", points, [0, 1], 2)
    lengths = pairs.add_attribute("lengths", through=ends, source=points["length"])
    scene.add_energy(pairs.add_attribute("e", computed_attribute=(lengths[0] - lengths[1]) ** 2))
    scene.add_minimize_target(x)
    with pytest.raises(NotFiniteError, match=r"gradient is not finite on m\.v\.x, instance 1"):
        scene.gradient()
    with pytest.raises(NotFiniteError, match=r"derivatives of energy m\.p\.e are not finite on instance 0"):
        scene.minimize_energy()  # its Hessian is projected on the targets
    x.update_value([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    np.testing.assert_allclose(scene.gradient()[0], [-2.0, 0.0, 0.0, 0.0, 2.0, 0.0])


# -- energies that are not finite where their derivatives are --------------------------------------------------

UNBOUNDED: dict[str, tuple[Callable[[Attribute, Attribute], Attribute], float, float, str]] = {
    "an inverted element": (lambda x, p: -(p * x).log(), 1.0, -1.0, "nan"),
    "a logarithm that is shared": (lambda x, p: (p * x) * (p * x).log(), 1.0, -1.0, "nan"),
    "a collapsed element": (lambda x, p: -x.exp() + (p * p).log() * x * x, 1.0, 0.0, "-inf"),
    "an infinite power": (lambda x, p: (p * x) ** 4 / (p * p * p), 1.0, 1e100, "inf"),
    "a norm of large entries": (lambda x, p: concat_rows([p * x, p]).norm(), 1.0, 1e200, "inf"),
    "an affine energy": (lambda x, p: x + p.log(), 1.0, -1.0, "nan"),
    "a side of a choice": (lambda x, p: x * x + (p - x.stop_gradient()).sqrt(), 2.0, 0.5, "nan"),
}
"""Energies of x = 1 and p; a p at which they are finite, one at which they are not, and the value there."""


def test_energies_that_are_not_finite_are_named(device: Any) -> None:
    """Each with derivatives that look finite; -log x is the energy whose derivative -1 / x is anything but right."""
    scene = Scene("s", device=device)
    points = scene.add_mesh("m").add_primitive("v", 11)
    x = points.add_attribute("x", 1, 1, value=np.ones(11))
    parameters = {}
    for k, (name, (write, good, _, _)) in enumerate(UNBOUNDED.items()):
        parameters[name] = points.add_constant(f"p{k}", 1, 1, value=np.full(11, good))
        scene.add_energy(points.add_attribute(f"e{k}", computed_attribute=write(x, parameters[name])))
    scene.add_minimize_target(x)
    before = scene.gradient()[0]
    for k, (name, (_, good, bad, value)) in enumerate(UNBOUNDED.items()):
        numbers = np.full(11, good)
        numbers[9] = bad
        parameters[name].update_value(numbers)
        for work in (scene.gradient, scene.hessian, scene.minimize_energy):
            with pytest.raises(NotFiniteError, match=rf"energy m\.v\.e{k} is not finite \(-?{value}\) on instance 9;"):
                work()
        parameters[name].update_value(np.full(11, good))
    np.testing.assert_array_equal(scene.gradient()[0], before)


@pytest.mark.parametrize("order", [-1, 6, 1.5, True])
def test_orders_of_stumpff_functions(order: Any) -> None:
    scene = Scene("s")
    with pytest.raises(DataError, match="a whole number of 0 to 5"):
        stumpff(order, scene.add_attribute("squared", 1, 1))
