"""Every energy of the shelf as a row: how yasps writes it, and what it is in NumPy.

The NumPy side takes other ways than the shelf does (invariants by inverses, rotations by matrices, angles by their
halves), and takes complex numbers too: their steps give stresses to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yasps import Attribute, Scene, materials

Batch = NDArray[Any]
"""One matrix for each instance: [instances, rows, columns]."""
INSTANCES = 6


@dataclass(frozen=True)
class Part:
    """An energy of unknowns and constants, which both sides take by their names."""

    name: str
    unknowns: Mapping[str, Batch]
    constants: Mapping[str, Batch]
    energy: Callable[..., Attribute]
    by_hand: Callable[..., Batch]
    """Energies, [instances]."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """What else the energy's function is given."""
    moduli: Callable[..., tuple[Batch, Batch, Batch]] | None = None
    """mu and lambda of the linear theory at rest, and volume, from the same arguments; of a sheet, in its plane."""

    def scene(self, projection: str = "clamp", **unknowns: Batch) -> Scene:
        """A scene of this energy alone, perhaps at other unknowns."""
        scene = Scene(self.name, threads=1)
        cells = scene.add_mesh("m").add_primitive("cells", INSTANCES)
        given = {}
        for name, numbers in {**self.unknowns, **unknowns}.items():
            given[name] = cells.add_attribute(name, *numbers.shape[1:], value=numbers)
        scene.add_minimize_target(list(given.values()))
        for name, numbers in self.constants.items():
            given[name] = cells.add_constant(name, *numbers.shape[1:], value=numbers)
        energy = self.energy(**given, **self.options)
        scene.add_energy(cells.add_attribute("energy", computed_attribute=energy), projection=projection)
        return scene

    def energies(self, **unknowns: Batch) -> Batch:
        """NumPy's energies."""
        return self.by_hand(**{**self.unknowns, **unknowns}, **self.arguments)

    @property
    def arguments(self) -> dict[str, Any]:
        """All that the energy is given but its unknowns."""
        return {**self.constants, **self.options}


def _random(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def near(middle: Any, spread: float, seed: int = 0) -> Batch:
    """Matrices around this one."""
    middle = np.asarray(middle, float)
    return middle + spread * _random(seed).standard_normal((INSTANCES, *middle.shape))


def number(low: float, high: float, seed: int = 1) -> Batch:
    """1x1 constants, another one for each instance."""
    return _random(seed).uniform(low, high, (INSTANCES, 1, 1))


def turned(matrices: Batch, seed: int = 2) -> Batch:
    """The matrices after any rotation each."""
    q, r = np.linalg.qr(_random(seed).standard_normal((INSTANCES, 3, 3)))
    q = q * np.sign(np.linalg.det(q) * np.prod(np.diagonal(r, axis1=1, axis2=2), axis=1) ** 2)[:, None, None]
    return q @ matrices


# -- what is shared on NumPy's side ----------------------------------------------------------------------------


def _dot(a: Batch, b: Batch) -> Batch:
    """Of vectors, [n, 3] each."""
    return np.sum(a * b, axis=-1)


def _length(a: Batch) -> Batch:
    return np.sqrt(_dot(a, a))


def _unit(a: Batch) -> Batch:
    return a / _length(a)[..., None]


def _trace(a: Batch) -> Batch:
    return np.trace(a, axis1=1, axis2=2)


def _right(f: Batch) -> Batch:
    """C = F^T F."""
    return np.einsum("nij,nik->njk", f, f)


def _angle(sine: Batch, cosine: Batch) -> Batch:
    """atan2 that takes complex steps."""
    return 2 * np.arctan(sine / (np.sqrt(sine * sine + cosine * cosine) + cosine))


def _turn(start: Batch, end: Batch) -> Batch:
    """Rotation matrices of the smallest rotation from one unit vector to another, by Rodrigues' formula."""
    axis = np.cross(start, end)
    skew = np.zeros((*axis.shape, 3), axis.dtype)
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        skew[..., j, i], skew[..., i, j] = axis[..., k], -axis[..., k]
    return np.eye(3) + skew + skew @ skew / (1 + _dot(start, end))[..., None, None]


# -- solids ----------------------------------------------------------------------------------------------------


def _linear(deformation: Batch, mu: Batch, lam: Batch, volume: Batch) -> Batch:
    moved = deformation - np.eye(3)
    shear = 0.5 * np.einsum("nij,nij->n", moved, moved + moved.swapaxes(1, 2))
    return volume.ravel() * (mu.ravel() * shear + 0.5 * lam.ravel() * (_trace(deformation) - 3) ** 2)


def _st_venant(deformation: Batch, mu: Batch, lam: Batch, volume: Batch) -> Batch:
    right = _right(deformation)
    first, squared = _trace(right), _trace(right @ right)
    return volume.ravel() * (mu.ravel() / 4 * (squared - 2 * first + 3) + lam.ravel() / 8 * (first - 3) ** 2)


def _fixed_corotated(deformation: Batch, mu: Batch, lam: Batch, volume: Batch) -> Batch:
    """|F - R|^2 = |F|^2 - 2 t + 3 with the trace t of the stretch, the largest root of its quartic equation."""
    right = _right(deformation)
    ratio = np.linalg.det(deformation)
    first, second = _trace(right), np.linalg.det(right) * _trace(np.linalg.inv(right))
    trace = (
        np.linalg.svd(deformation.real, compute_uv=False).sum(axis=1)
        - np.where(ratio.real < 0, 2, 0) * (np.linalg.svd(deformation.real, compute_uv=False)[:, 2])
    )
    for _ in range(2):  # (t^2 - tr C)^2 / 4 = II_C + 2 t J, from the real root
        value = (trace**2 - first) ** 2 / 4 - second - 2 * trace * ratio
        trace = trace - value / (trace * (trace**2 - first) - 2 * ratio)
    return volume.ravel() * (mu.ravel() * (first - 2 * trace + 3) + 0.5 * lam.ravel() * (ratio - 1) ** 2)


def _neo_hookean(deformation: Batch, mu: Batch, lam: Batch, volume: Batch) -> Batch:
    log = 0.5 * np.log(np.linalg.det(_right(deformation)))
    first = np.sum(deformation**2, axis=(1, 2))
    return volume.ravel() * (mu.ravel() * (0.5 * (first - 3) - log) + 0.5 * lam.ravel() * log**2)


def _mooney_rivlin(deformation: Batch, c1: Batch, c2: Batch, bulk: Batch, volume: Batch) -> Batch:
    ratio = np.linalg.det(deformation)
    right = _right(deformation / np.exp(np.log(ratio) / 3)[:, None, None])  # of determinant 1
    second = np.linalg.det(right) * _trace(np.linalg.inv(right))
    shape = c1.ravel() * (_trace(right) - 3) + c2.ravel() * (second - 3)
    return volume.ravel() * (shape + 0.5 * bulk.ravel() * (ratio - 1) ** 2)


def _fibres(deformation: Batch, direction: Batch, stiffness: Batch, stiffening: Batch, volume: Batch) -> Batch:
    along = np.einsum("nia,nij,nja->n", direction, _right(deformation), direction)
    k1, k2 = stiffness.ravel(), stiffening.ravel()
    stored = k1 / (2 * k2) * (np.exp(k2 * (along - 1) ** 2) - 1)
    return volume.ravel() * np.where(along.real > 1, stored, 0)


def _symmetric(matrices: Batch) -> Batch:
    return 0.5 * (matrices + matrices.transpose(0, 2, 1))


def _damping(
    deformation: Batch, previous_strain: Batch, viscosity: Batch, volume: Batch, effective_step: float
) -> Batch:
    change = 0.5 * (_right(deformation) - np.eye(3)) - previous_strain
    return viscosity.ravel() * volume.ravel() / (2 * effective_step) * np.sum(change**2, axis=(1, 2))


# -- sheets ----------------------------------------------------------------------------------------------------


def _st_venant_membrane(deformation: Batch, mu: Batch, lam: Batch, area: Batch, thickness: float) -> Batch:
    """By the strains: stresses of plane stress times strains."""
    strain = 0.5 * (_right(deformation) - np.eye(2))
    mu, lam = mu.ravel(), lam.ravel()
    youngs_modulus, ratio = mu * (3 * lam + 2 * mu) / (lam + mu), lam / (2 * (lam + mu))
    xx, yy, xy = strain[:, 0, 0], strain[:, 1, 1], strain[:, 0, 1]
    plane = youngs_modulus / (1 - ratio**2)
    density = 0.5 * plane * (xx**2 + yy**2 + 2 * ratio * xx * yy + 2 * (1 - ratio) * xy**2)
    return area.ravel() * thickness * density


def _neo_hookean_membrane(deformation: Batch, mu: Batch, area: Batch, thickness: float) -> Batch:
    """With the thickness stretch that keeps the volume."""
    normal = np.cross(deformation[:, :, 0], deformation[:, :, 1])
    thinner = 1 / _length(normal)
    first = np.sum(deformation**2, axis=(1, 2)) + thinner**2
    return area.ravel() * thickness * mu.ravel() / 2 * (first - 3)


def _strain_limiting(deformation: Batch, limit: Batch, stiffness: Batch, area: Batch, thickness: float) -> Batch:
    """By the roots of the characteristic polynomial."""
    strain = 0.5 * (_right(deformation) - np.eye(2))
    mean = 0.5 * _trace(strain)
    apart = np.sqrt(mean**2 - np.linalg.det(strain))
    over = np.stack([mean + apart, mean - apart]) - limit.ravel()
    cubes = np.where(over.real > 0, over**3, 0).sum(axis=0)
    return area.ravel() * thickness * stiffness.ravel() / 3 * cubes


# -- points ----------------------------------------------------------------------------------------------------


def _spring(positions: Batch, rest_length: Batch, stiffness: Batch) -> Batch:
    length = _length(positions[:, 1] - positions[:, 0])
    return stiffness.ravel() * (0.5 * length**2 - rest_length.ravel() * length + 0.5 * rest_length.ravel() ** 2)


def _rod_stretching(positions: Batch, rest_length: Batch, stiffness: Batch) -> Batch:
    strain = _length(positions[:, 1] - positions[:, 0]) / rest_length.ravel() - 1
    return 0.5 * stiffness.ravel() * strain**2 * rest_length.ravel()


def _pressure(positions: Batch, pressure: Batch) -> Batch:
    triple = _dot(positions[:, 0], np.cross(positions[:, 1], positions[:, 2]))
    return -pressure.ravel() * triple / 6


def _shell_angle(positions: Batch) -> Batch:
    """From the corners' distances above the edge: a frame of edge, across the left, normal of the left."""
    start, edge = positions[:, 0], _unit(positions[:, 1] - positions[:, 0])
    left, right = positions[:, 2] - start, positions[:, 3] - start
    across = _unit(left - _dot(left, edge)[:, None] * edge)
    up = np.cross(edge, across)
    return _angle(_dot(right, up), -_dot(right, across))


def _shell(positions: Batch, rest_angle: Batch, stiffness: Batch) -> Batch:
    return stiffness.ravel() * (_shell_angle(positions) - rest_angle.ravel()) ** 2


def _quadratic_bending(positions: Batch, weights: Batch, stiffness: Batch) -> Batch:
    moved = np.einsum("nka,nki->ni", weights, positions)
    return 0.5 * stiffness.ravel() * _dot(moved, moved)


def _binormal(positions: Batch) -> tuple[Batch, Batch]:
    """By half the angle between the segments; and their tangents, [n, 2, 3]."""
    tangents = _unit(np.diff(positions, axis=1))
    across = np.cross(tangents[:, 0], tangents[:, 1])
    half = np.arctan(_length(across) / (1 + _dot(tangents[:, 0], tangents[:, 1])))
    return 2 * np.tan(half)[:, None] * _unit(across), tangents


def _rod_bending(positions: Batch, rest_length: Batch, stiffness: Batch) -> Batch:
    binormal, _ = _binormal(positions)
    return stiffness.ravel() / rest_length.ravel() * _dot(binormal, binormal)


def _frames(positions: Batch, previous: Batch, directors: Batch, angles: Batch) -> Batch:
    """Material frames as rotation matrices with columns m_1, m_2, tangent, [n, 2, 3, 3]."""
    _, tangents = _binormal(positions)
    old = _unit(np.diff(previous, axis=1))
    first = np.einsum("nkij,nkj->nki", _turn(old, tangents), directors)
    frames = np.stack([first, np.cross(tangents, first), tangents], axis=-1)
    angles = angles.reshape(-1, 2)
    about = np.zeros((*angles.shape, 3, 3), angles.dtype)
    about[..., 0, 0] = about[..., 1, 1] = np.cos(angles)
    about[..., 1, 0], about[..., 0, 1], about[..., 2, 2] = np.sin(angles), -np.sin(angles), 1
    return frames @ about


def _material_bending(rest_curvature: Batch, rest_length: Batch, stiffness: Batch, **state: Batch) -> Batch:
    binormal, _ = _binormal(state["positions"])
    mean = _frames(**state).mean(axis=1)
    about = np.einsum("ni,nij->nj", binormal, mean)
    rest, stiff = rest_curvature.reshape(-1, 2), stiffness.reshape(-1, 2)
    energy = stiff[:, 0] * (about[:, 1] - rest[:, 0]) ** 2 + stiff[:, 1] * (about[:, 0] + rest[:, 1]) ** 2
    return energy / rest_length.ravel()


def _twist(reference_twist: Batch, **state: Batch) -> Batch:
    """By the material frames themselves, the first taken to the second segment; turns as the reference has them."""
    tangents = _unit(np.diff(state["positions"], axis=1))
    frames = _frames(**state)
    moved = _turn(tangents[:, 0], tangents[:, 1]) @ frames[:, 0]
    between = moved.swapaxes(1, 2) @ frames[:, 1]
    angle = _angle(between[:, 1, 0], between[:, 0, 0])
    angles = state["angles"].reshape(-1, 2)
    about = reference_twist.ravel() + angles[:, 1] - angles[:, 0]
    return angle + 2 * np.pi * np.round((about.real - angle.real) / (2 * np.pi))


def _twisting(rest_twist: Batch, rest_length: Batch, stiffness: Batch, **state: Batch) -> Batch:
    return stiffness.ravel() / rest_length.ravel() * (_twist(**state) - rest_twist.ravel()) ** 2


def _material_bending_of(
    rest_curvature: Attribute, rest_length: Attribute, stiffness: Attribute, **state: Attribute
) -> Attribute:
    curvature = materials.material_curvature(**state)
    return materials.rod_material_bending(curvature, rest_curvature, rest_length, stiffness)


def _twisting_of(rest_twist: Attribute, rest_length: Attribute, stiffness: Attribute, **state: Attribute) -> Attribute:
    return materials.rod_twisting(materials.rod_twist(**state), rest_twist, rest_length, stiffness)


# -- joints ----------------------------------------------------------------------------------------------------


def _held_together(first: Batch, second: Batch, stiffness: Batch) -> Batch:
    return stiffness.ravel() / 2 * np.sum((second - first)[:, 0] ** 2, axis=1)


def _aligned(first: Batch, second: Batch, stiffness: Batch) -> Batch:
    return np.sum(stiffness[:, :, 0] / 2 * np.sum((second - first)[:, 1:] ** 2, axis=2), axis=1)


def _on_the_axis(first: Batch, second: Batch, stiffness: Batch) -> Batch:
    way = np.einsum("nc,nkc->nk", second[:, 0] - first[:, 0], first[:, 2:])
    return stiffness.ravel() / 2 * np.sum(way**2, axis=1)


def _turned_by(first: Batch, second: Batch) -> Batch:
    """By the sum of the complex numbers that say how each vector across the axis has turned."""
    sine = _dot(first[:, 3], second[:, 2]) - _dot(first[:, 2], second[:, 3])
    return _angle(sine, _dot(first[:, 2], second[:, 2]) + _dot(first[:, 3], second[:, 3]))


def _motor(first: Batch, second: Batch, aim: Batch, stiffness: Batch, torque: Batch) -> Batch:
    off, k, most = _turned_by(first, second) - aim.ravel(), stiffness.ravel(), torque.ravel()
    off = np.where(off.real < 0, -off, off)
    return np.where(k * off.real <= most, k / 2 * off**2, most * off - most**2 / (2 * k))


def _motor_of(
    first: Attribute, second: Attribute, aim: Attribute, stiffness: Attribute, torque: Attribute
) -> Attribute:
    return materials.motor(materials.joint_angle(first, second, 0.0), aim, stiffness, torque)


def _angle_limits(first: Batch, second: Batch, least: Batch, most: Batch, stiffness: Batch) -> Batch:
    turn = _turned_by(first, second)
    over, under = turn - most.ravel(), least.ravel() - turn
    return stiffness.ravel() / 3 * (np.where(over.real > 0, over**3, 0) + np.where(under.real > 0, under**3, 0))


def _angle_limits_of(
    first: Attribute, second: Attribute, least: Attribute, most: Attribute, stiffness: Attribute
) -> Attribute:
    return materials.angle_limits(materials.joint_angle(first, second, 0.0), least, most, stiffness)


# -- the table -------------------------------------------------------------------------------------------------

LAME = {"mu": number(1.0, 2.0, 3), "lam": number(0.5, 3.0, 4)}
VOLUME = {"volume": number(0.5, 2.0, 5)}
SHEET = {"area": number(0.5, 2.0, 6)}
SOLID = {"deformation": turned(near(np.eye(3), 0.2))}
MEMBRANE = {"deformation": turned(near(np.eye(3, 2), 0.2))}
ENDS = {"positions": near([[0, 0, 0], [1, 0.2, 0.1]], 0.2)}
TRIANGLE = {"positions": near([[1, 0, 0], [0.2, 1, 0], [0, 0.1, 1]], 0.2)}
FOLDED = {"positions": near([[0, 0, 0], [2, 0, 0], [1, 1, 0.2], [0.5, -1, 0.6]], 0.2)}
BENT = [[0, 0, 0], [1, 0.1, 0], [1.9, 0.6, 0.3]]
LENGTH = {"rest_length": number(1.5, 2.5, 7)}


FRAMES = {
    "first": near(np.vstack([np.zeros(3), np.eye(3)]), 0.1, 30),
    "second": near([[0.3, 0.2, 0.1], [1, 0, 0], [0, 0.5, 0.8], [0, -0.8, 0.5]], 0.1, 31),
}
"""Turned by about 1 rad against each other."""


def _lame(mu: Batch, lam: Batch, volume: Batch) -> tuple[Batch, Batch, Batch]:
    return mu, lam, volume


def _rod_state() -> dict[str, Batch]:
    """Where a step began: bent otherwise than now, with frames that are twisted."""
    previous = near(BENT, 0.05, 8)
    tangents = _unit(np.diff(previous, axis=1))
    across = _unit(np.cross(tangents, near([0.3, 0.2, 1.0], 0.5, 9)[:, None]))
    return {"previous": previous, "directors": across}


ROD = {"positions": near(BENT, 0.1), "angles": near([[0.2], [0.9]], 0.3, 10)}
_PREVIOUS = _rod_state()
REFERENCE_TWIST = {
    "reference_twist": np.array(
        [
            materials.reference_twists(_unit(np.diff(x, axis=0)), u, 2 * np.pi * (k % 3 - 1))
            for k, (x, u) in enumerate(zip(_PREVIOUS["previous"], _PREVIOUS["directors"], strict=True))
        ]
    )[:, :, None]
}

PARTS = (
    Part("linear_elasticity", SOLID, {**LAME, **VOLUME}, materials.linear_elasticity, _linear, moduli=_lame),
    Part("st_venant_kirchhoff", SOLID, {**LAME, **VOLUME}, materials.st_venant_kirchhoff, _st_venant, moduli=_lame),
    Part("fixed_corotated", SOLID, {**LAME, **VOLUME}, materials.fixed_corotated, _fixed_corotated, moduli=_lame),
    Part("neo_hookean", SOLID, {**LAME, **VOLUME}, materials.neo_hookean, _neo_hookean, moduli=_lame),
    Part(
        "mooney_rivlin",
        SOLID,
        {"c1": number(0.3, 1, 11), "c2": number(0.1, 0.5, 12), "bulk": number(2, 4, 13), **VOLUME},
        materials.mooney_rivlin,
        _mooney_rivlin,
        moduli=lambda c1, c2, bulk, volume: (2 * (c1 + c2), bulk - 4 / 3 * (c1 + c2), volume),
    ),
    Part(
        "holzapfel_fibres",
        SOLID,
        {
            "direction": _unit(near([0, 0, 0], 1.0, 14))[:, :, None],
            "stiffness": number(0.5, 2, 15),
            "stiffening": number(0.5, 1.5, 16),
            **VOLUME,
        },
        materials.holzapfel_fibres,
        _fibres,
    ),
    Part(
        "strain_rate_damping",
        SOLID,
        {"previous_strain": _symmetric(near(np.zeros((3, 3)), 0.1, 17)), "viscosity": number(1, 2, 18), **VOLUME},
        materials.strain_rate_damping,
        _damping,
        {"effective_step": 0.05},
    ),
    Part(
        "st_venant_membrane",
        MEMBRANE,
        {**LAME, **SHEET},
        materials.st_venant_membrane,
        _st_venant_membrane,
        {"thickness": 0.3},
        moduli=lambda mu, lam, area, thickness: (mu, 2 * lam * mu / (lam + 2 * mu), area * thickness),
    ),
    Part(
        "neo_hookean_membrane",
        MEMBRANE,
        {"mu": LAME["mu"], **SHEET},
        materials.neo_hookean_membrane,
        _neo_hookean_membrane,
        {"thickness": 0.3},
        moduli=lambda mu, area, thickness: (mu, 2 * mu, area * thickness),  # lambda infinite
    ),
    Part(
        "strain_limiting",
        {"deformation": turned(near(1.1 * np.eye(3, 2), 0.2, 30))},
        {"limit": number(0.05, 0.15, 31), "stiffness": number(1, 2, 32), **SHEET},
        materials.strain_limiting,
        _strain_limiting,
        {"thickness": 0.3},
    ),
    Part("spring", ENDS, {"stiffness": number(1, 2, 19), **LENGTH}, materials.spring, _spring),
    Part("rod_stretching", ENDS, {"stiffness": number(1, 2, 19), **LENGTH}, materials.rod_stretching, _rod_stretching),
    Part("inner_pressure", TRIANGLE, {"pressure": number(1, 2, 20)}, materials.inner_pressure, _pressure),
    Part(
        "discrete_shell_bending",
        FOLDED,
        {"rest_angle": number(-0.5, 0.5, 21), "stiffness": number(1, 2, 22)},
        materials.discrete_shell_bending,
        _shell,
    ),
    Part(
        "quadratic_bending",
        FOLDED,
        {"weights": near([[1], [0.5], [-0.8], [-0.7]], 0.1, 23), "stiffness": number(1, 2, 24)},
        materials.quadratic_bending,
        _quadratic_bending,
    ),
    Part(
        "rod_bending",
        {"positions": ROD["positions"]},
        {"stiffness": number(1, 2, 25), **LENGTH},
        materials.rod_bending,
        _rod_bending,
    ),
    Part(
        "rod_material_bending",
        ROD,
        {
            **_PREVIOUS,
            "rest_curvature": near([[0.1], [-0.2]], 0.1, 26),
            "stiffness": near([[1.0], [3.0]], 0.1, 27),
            **LENGTH,
        },
        _material_bending_of,
        _material_bending,
    ),
    Part(
        "rod_twisting",
        ROD,
        {**_PREVIOUS, **REFERENCE_TWIST, "rest_twist": number(-1, 1, 28), "stiffness": number(1, 2, 29), **LENGTH},
        _twisting_of,
        _twisting,
    ),
    Part("held_together", FRAMES, {"stiffness": number(1, 2, 32)}, materials.held_together, _held_together),
    Part("aligned", FRAMES, {"stiffness": near([[1.0], [2.0], [3.0]], 0.1, 33)}, materials.aligned, _aligned),
    Part("on_the_axis", FRAMES, {"stiffness": number(1, 2, 34)}, materials.on_the_axis, _on_the_axis),
    Part(
        "motor",
        FRAMES,
        {"aim": number(0.0, 2.0, 35), "stiffness": number(1, 2, 36), "torque": number(0.1, 0.8, 37)},
        _motor_of,
        _motor,
    ),
    Part(
        "angle_limits",
        FRAMES,
        {"least": number(-1.0, 1.5, 38), "most": number(0.5, 1.5, 39), "stiffness": number(1, 2, 40)},
        _angle_limits_of,
        _angle_limits,
    ),
)
