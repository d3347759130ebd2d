"""Joints against closed forms, between bodies of different kinds."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.integrate
import scipy.optimize
from numpy.typing import NDArray

from yasps import DataError, Scene, SceneError
from yasps.bodies import AffineBody, Body, Cloth, HalfSpace, Hinge, Joint, Joints, RigidBody, SoftBody
from yasps.meshes import box, cloth_grid
from yasps.simulation import Simulation
from yasps.stepping import BDF2, NewtonSettings

G = 9.8
TIGHT = NewtonSettings(velocity_tolerance=1e-7, solver="direct", projection="on-demand")
NO_GRAVITY = (0.0, 0.0, 0.0)


def mass_of(body: Body) -> float:
    return float(body.mass.value.sum())


def centre(body: Body) -> NDArray[np.float64]:
    return np.asarray(body.mass.value @ body.positions() / mass_of(body))


# -- all kinds in one scene --------------------------------------------------------------------------------

CUBE = box((0.1, 0.1, 0.1), (1, 1, 1))
ARM = box((0.4, 0.05, 0.05), (1, 1, 1))
K = 1e8  # N/m


class Everything:
    """Bodies that have nothing to do with each other, one for each kind of joint."""

    def __init__(self) -> None:
        scene = Scene("joints", threads=1)
        self.hung = AffineBody(scene, "hung", CUBE)
        self.sliding = RigidBody(scene, "sliding", CUBE.translated((1.0, 0.0, 0.0)))
        self.soft = SoftBody(scene, "soft", CUBE.translated((2.0, 0.0, 0.0)), youngs_modulus=1e6)
        self.limited = RigidBody(scene, "limited", ARM.translated((3.2, 0.0, 0.0)))
        self.driven = RigidBody(scene, "driven", ARM.translated((4.2, 0.0, 0.0)))
        self.weak = RigidBody(scene, "weak", ARM.translated((5.2, 0.0, 0.0)))
        self.first = AffineBody(scene, "first", CUBE.translated((6.0, 0.0, 0.0)))
        self.second = RigidBody(scene, "second", CUBE.translated((6.1, 0.0, 0.0)))
        bodies: list[Body] = [self.hung, self.sliding, self.soft, self.limited, self.driven, self.weak]
        bodies += [self.first, self.second]
        self.joints = joints = Joints(scene, bodies)
        self.slope = np.array([np.cos(0.5), 0.0, -np.sin(0.5)])
        self.spring = joints.spring(None, self.hung, (0.0, 0.0, 1.05), (0.0, 0.0, 0.05), 1e3)
        self.slider = joints.slider(None, self.sliding, (1.0, 0.0, 0.0), self.slope, K)
        self.point = joints.point(None, self.soft, (2.0, 0.0, 0.05), 1e6)
        down = (0.0, 1.0, 0.0)  # a positive angle lowers the arm
        self.limit = joints.hinge(None, self.limited, (3.0, 0.0, 0.0), down, K)
        self.limit.limit(-0.3, 0.3, 1e4)
        self.motor = joints.hinge(None, self.driven, (4.0, 0.0, 0.0), down, K)
        self.motor.drive(-1.0, 1e3)
        self.weak_motor = joints.hinge(None, self.weak, (5.0, 0.0, 0.0), down, K)
        self.weak_motor.drive(-1.0, 1e3, torque=1.0)
        self.wall = joints.fixed(None, self.first, (5.95, 0.0, 0.0), K)
        self.glue = joints.fixed(self.first, self.second, (6.05, 0.0, 0.0), K, name="glue")
        options = {"contact": False, "settings": TIGHT, "time_step": 0.02}
        self.simulation = Simulation(scene, bodies, gravity=(0.0, 0.0, -G), **options)
        self.simulation.attach(joints)


@pytest.mark.nightly
def test_all_kinds_against_closed_forms() -> None:
    all_of = Everything()
    simulation, joints = all_of.simulation, all_of.joints
    start, steps = centre(all_of.sliding), 25
    for _ in range(steps):
        simulation.step()
    # What slides has nothing across the axis to hold it: backward Euler's own fall along it.
    way = centre(all_of.sliding) - start
    fallen = steps * (steps + 1) / 2 * 0.02**2 * G * np.sin(0.5)
    np.testing.assert_allclose(way, fallen * all_of.slope, atol=1e-5 * fallen)
    off = all_of.slider.residual()
    assert off.force == pytest.approx(mass_of(all_of.sliding) * G * np.cos(0.5), rel=1e-4)
    assert off.angle < 1e-6
    for _ in range(100):
        simulation.step()
    # A spring is as long as its load says, a point holds its body's weight.
    weight = mass_of(all_of.hung) * G
    assert all_of.spring.residual().gap == pytest.approx(weight / 1e3, rel=1e-4)
    assert all_of.point.residual().force == pytest.approx(mass_of(all_of.soft) * G, rel=1e-2)
    # Limits and motors give way until their torque is that of gravity.
    torque = mass_of(all_of.limited) * G * 0.2
    limit = all_of.limit.angle()
    assert 1e4 * (limit - 0.3) ** 2 == pytest.approx(torque * np.cos(limit), rel=1e-3)
    angle = all_of.motor.angle()
    assert 1e3 * (angle + 1.0) == pytest.approx(torque * np.cos(angle), rel=1e-3)
    # 1 N m holds no arm of 9.8 N at 0.2 m.
    assert all_of.weak_motor.angle() > 0.5
    # The wall bears both blocks, the glue one.
    both = (mass_of(all_of.first) + mass_of(all_of.second)) * G
    assert all_of.wall.residual().force == pytest.approx(both, rel=1e-3)
    assert all_of.glue.residual().force == pytest.approx(mass_of(all_of.second) * G, rel=1e-3)
    assert [one.name for one in joints.residuals()][-1] == "glue"
    assert max(one.angle for one in joints.residuals()) < 1e-5


@pytest.mark.nightly
def test_the_torque_of_a_motor_is_limited() -> None:
    """The weak motor rests where its largest torque is gravity's: cos(angle) = 1 N m / (m g l)."""
    scene = Scene("weak", threads=1)
    arm = RigidBody(scene, "arm", ARM.translated((0.2, 0.0, 0.0)))
    joints = Joints(scene, [arm])
    hinge = joints.hinge(None, arm, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), K)
    hinge.drive(-1.0, 1e3, torque=1.0)
    simulation = Simulation(scene, [arm], contact=False, settings=TIGHT, time_step=0.05)
    simulation.attach(joints)
    for _ in range(500):
        simulation.step()
    assert np.cos(hinge.angle()) == pytest.approx(1.0 / (mass_of(arm) * G * 0.2), rel=1e-3)
    assert 0.5 < hinge.angle() < 0.5 * np.pi


# -- four bars ---------------------------------------------------------------------------------------------

GROUND, CRANK, COUPLER, ROCKER = 1.0, 0.3, 0.9, 0.7  # m


def rocker_angle(crank: float) -> float:
    """Of the rocker against the ground link, for that of the crank: the closure of the loop, solved for it (open)."""
    x, z = GROUND - CRANK * np.cos(crank), -CRANK * np.sin(crank)
    reach = np.hypot(x, z)
    inner = np.arccos((ROCKER**2 + reach**2 - COUPLER**2) / (2 * ROCKER * reach))
    return float(np.arctan2(-z, -x) - inner)


def bar(start: NDArray[np.float64], end: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Middle of a bar in the plane y = 0 and its angle."""
    way = end - start
    return 0.5 * (start + end), float(np.arctan2(way[2], way[0]))


def four_bars() -> tuple[Simulation, Joints, Hinge, Hinge]:
    """A crank that a motor turns, an affine coupler, a rocker."""
    scene = Scene("four_bars", threads=1)
    start = 0.4
    a, d = np.zeros(3), np.array([GROUND, 0.0, 0.0])
    b = CRANK * np.array([np.cos(start), 0.0, np.sin(start)])
    rocker = rocker_angle(start)
    c = d + ROCKER * np.array([np.cos(rocker), 0.0, np.sin(rocker)])
    assert np.linalg.norm(c - b) == pytest.approx(COUPLER, rel=1e-12)
    bodies = []
    for name, kind, (p, q) in (
        ("crank", RigidBody, (a, b)),
        ("coupler", AffineBody, (b, c)),
        ("rocker", RigidBody, (d, c)),
    ):
        middle, angle = bar(p, q)
        shape = box((float(np.linalg.norm(q - p)), 0.05, 0.05), (1, 1, 1)).rotated((0.0, 1.0, 0.0), -angle)
        bodies.append(kind(scene, name, shape.translated(middle), youngs_modulus=1e11))
    crank, coupler, swing = bodies
    joints, axis = Joints(scene, bodies), (0.0, -1.0, 0.0)  # angles count from x to z
    first = joints.hinge(None, crank, a, axis, 1e9)
    joints.hinge(crank, coupler, b, axis, 1e9)
    joints.hinge(coupler, swing, c, axis, 1e9)
    last = joints.hinge(None, swing, d, axis, 1e9)
    simulation = Simulation(scene, bodies, contact=False, gravity=NO_GRAVITY, time_step=0.02, settings=TIGHT)
    simulation.attach(joints)
    return simulation, joints, first, last


def test_a_four_bar_linkage_follows_its_closed_form_through_a_whole_turn() -> None:
    simulation, joints, first, last = four_bars()
    start, worst, gap = 0.4, 0.0, 0.0
    aims = np.linspace(0.0, 2 * np.pi, 61)[1:]
    for aim in aims:
        first.drive(float(aim), 1e7)
        simulation.step()
        expected = np.unwrap([rocker_angle(start), rocker_angle(start + first.angle())])
        worst = max(worst, abs(last.angle() - (expected[1] - expected[0])))
        gap = max(gap, *(one.gap for one in joints.residuals()))
    print(f"rocker off by {worst:.2e} rad, largest gap {gap:.2e} m")
    assert first.angle() == pytest.approx(2 * np.pi, abs=1e-3)  # a whole turn is counted
    assert worst < 1e-4
    assert gap < 1e-5


# -- a door ------------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_a_door_on_a_tilted_axis_swings_as_a_pendulum() -> None:
    """I angle'' = -m g sin(tilt) l sin(angle), with the masses of the vertices."""
    scene = Scene("door", threads=1)
    door = RigidBody(scene, "door", box((0.8, 0.04, 2.0), (1, 1, 1)).translated((0.4, 0.0, 0.0)), density=500.0)
    tilt, spin = 0.3, 1.0
    joints = Joints(scene, [door])
    hinge = joints.hinge(None, door, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1e10)
    down = (G * np.sin(tilt), 0.0, -G * np.cos(tilt))
    options = {"contact": False, "settings": TIGHT, "integrator": BDF2, "time_step": 0.01}
    simulation = Simulation(scene, [door], gravity=down, **options)
    simulation.set_velocity(door, np.cross([0.0, 0.0, spin], door.positions()))
    found, pulled = [], []
    for _ in range(100):
        simulation.step()
        found.append(hinge.angle())
        pulled.append(hinge.residual().force)
    x, mass = door.rest, door.mass.value
    inertia, lever = float(mass @ (x[:, 0] ** 2 + x[:, 1] ** 2)), float(mass @ x[:, 0]) * G * np.sin(tilt)
    solved = scipy.integrate.solve_ivp(
        lambda _, y: [y[1], -lever / inertia * np.sin(y[0])],
        (0.0, 1.0),
        [0.0, spin],
        rtol=1e-10,
        atol=1e-10,
        t_eval=0.01 * np.arange(1, 101),
    )
    off = float(np.abs(np.array(found) - solved.y[0]).max())
    print(f"off by {off:.2e} rad of {solved.y[0].max():.3f}, residual {hinge.residual()}")
    assert off < 2e-3 * solved.y[0].max()
    # The hinge bears weight and centripetal force.
    angle, rate = solved.y[:, -1]
    m, r = mass_of(door), float(mass @ x[:, 0] / mass.sum())
    radial = m * r * rate**2 + m * G * np.sin(tilt) * np.cos(angle)
    tangential = m * G * np.sin(tilt) * np.sin(angle) * (1 - m * r * r / inertia)
    assert pulled[-1] == pytest.approx(np.linalg.norm([radial, tangential, m * G * np.cos(tilt)]), rel=1e-2)


# -- refusals ----------------------------------------------------------------------------------------------


def test_what_no_joint_can_be() -> None:
    scene = Scene("wrong", threads=1)
    rigid = RigidBody(scene, "rigid", CUBE)
    cloth = Cloth(scene, "cloth", cloth_grid((1.0, 1.0), (2, 2)))
    other = RigidBody(scene, "other", CUBE)
    joints = Joints(scene, [rigid, cloth])
    with pytest.raises(SceneError, match="both are the world"):
        joints.point(None, None, (0, 0, 0), 1.0)
    with pytest.raises(SceneError, match="both are the world"):
        joints.hinge(None, None, (0, 0, 0), (0, 0, 1), 1.0)
    with pytest.raises(SceneError, match="is none of the bodies of these joints"):
        joints.fixed(None, HalfSpace(scene, "ground"), (0, 0, 0), 1.0)
    with pytest.raises(SceneError, match="both are <RigidBody 'rigid'"):
        joints.hinge(rigid, rigid, (0, 0, 0), (0, 0, 1), 1.0)
    with pytest.raises(SceneError, match="is none of the bodies of these joints: \\['rigid', 'cloth'\\]"):
        joints.point(None, other, (0, 0, 0), 1.0)
    with pytest.raises(SceneError, match="stiffness of a point joint"):
        joints.point(None, rigid, (0, 0, 0), 0.0)
    with pytest.raises(DataError, match="three numbers"):
        joints.point(None, rigid, (0, 0), 1.0)
    with pytest.raises(DataError, match="a direction, not 0"):
        joints.hinge(None, rigid, (0, 0, 0), (0, 0, 0), 1.0)
    with pytest.raises(SceneError, match="say nothing of a direction off them"):
        joints.hinge(None, cloth, cloth.rest[0], (0, 0, 1), 1.0)
    with pytest.raises(SceneError, match="off the surface cloth"):
        joints.point(None, cloth, cloth.rest[0] + [0.0, 0.0, 0.5], 1.0)
    with pytest.raises(SceneError, match="has no direction"):
        joints.spring(None, rigid, (0, 0, 0), (0, 0, 0), 1.0, length=1.0)
    with pytest.raises(DataError, match="length of a spring needs real numbers"):
        joints.spring(None, rigid, (0, 0, 0), (1, 0, 0), 1.0, length="long")  # type: ignore[arg-type]
    assert joints.all == []
    joint: Joint = joints.point(None, cloth, cloth.rest[0], 1.0)
    assert joint.residual().gap == 0.0
    hinge = joints.hinge(None, rigid, (0, 0, 0), (0, 0, 1), 1.0)
    with pytest.raises(SceneError, match="least <= most"):
        hinge.limit(1.0, -1.0, 1.0)
    with pytest.raises(SceneError, match="the motor of hinge 1"):
        hinge.drive(1.0, -1.0)
    with pytest.raises(DataError, match="the motor of hinge 1 needs real numbers"):
        hinge.drive("open", 1.0)  # type: ignore[arg-type]
    with pytest.raises(DataError, match="the limits of hinge 1: entry 1 is inf"):
        hinge.limit(0.0, np.inf, 1.0)


def test_a_state_has_the_turns_of_hinges() -> None:
    """Restored after most of a turn, the angle goes on from there."""
    first, _, hinge, _ = four_bars()
    for aim in np.linspace(0.0, 5.0, 40)[1:]:
        hinge.drive(float(aim), 1e7)
        first.step()
    state, angle = first.state(), hinge.angle()
    assert angle == pytest.approx(5.0, abs=1e-2)
    second, _, other, _ = four_bars()
    other.drive(5.0, 1e7)
    second._set_state(state)
    assert other.angle() == pytest.approx(angle, abs=1e-12)
    second.step()
    assert other.angle() == pytest.approx(5.0, abs=2e-2)
