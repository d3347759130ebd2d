"""Small runs for gradients, and differences of whole runs to hold them against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yasps import Scene
from yasps.bodies import AffineBody, Body, HalfSpace
from yasps.contact import ContactTable
from yasps.inverse import PRECISE, Trajectory
from yasps.meshes import box
from yasps.simulation import Simulation

SETTINGS = replace(PRECISE, relative_force_tolerance=1e-12)
EIGHTH_ORDER = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
"""Weights of central differences at 1 to 4 steps."""
Floats = NDArray[np.float64]


class Chain(Body):
    """Points on springs of rest length 0 in a row, from the origin on: `vertices` have `position`, `mass`; `springs`
    `stiffness` [N/m]."""

    def __init__(self, scene: Scene, places: Floats, stiffness: float) -> None:
        super().__init__(scene, "chain", places)
        count = len(places)
        self.edges = np.array([[k, k + 1] for k in range(count - 1)], np.int32)
        self.triangles = np.empty((0, 3), np.int32)
        self.cells = {"line": self.edges}
        self.vertices = self.mesh.add_primitive("vertices", count)
        position = self.vertices.add_attribute("position", 3, 1, value=places)
        self.vertices.add_constant("rest_position", 3, 1, value=places)
        self.vertices.add_constant("mass", 1, 1, value=np.linspace(0.3, 0.5, count))
        self.targets = self.falling = (position,)
        self.anchor = self.mesh.add_constant("anchor", 3, 1)
        self.stiffness = self.mesh.add_constant("stiffness", 1, 1, value=stiffness)
        hook = self.vertices.add_constant("hook", 1, 1, value=np.arange(count) == 0)
        way = position - self.anchor
        held = 0.5 * self.stiffness * hook * way.dot(way)
        self.add_energy(self.vertices.add_attribute("held", computed_attribute=held))
        springs = self.mesh.add_primitive("springs", count - 1)
        ends = springs.add_connectivity("ends", self.vertices, self.edges, 2)
        first, second = springs.add_attribute("positions", through=ends, source=position)
        stretch = 0.5 * self.stiffness * (second - first).dot(second - first)
        self.add_energy(springs.add_attribute("stretch", computed_attribute=stretch))


def chain(stiffness: float, **options: Any) -> tuple[Simulation, Chain]:
    """A chain that falls and swings, without contact."""
    scene = Scene("chain", threads=1, deterministic=True)
    places = np.random.default_rng(3).normal(size=(3, 3))
    body = Chain(scene, places, stiffness)
    simulation = Simulation(
        scene, [body], contact=False, activation_distance=1.0, settings=SETTINGS, time_step=0.05, **options
    )
    simulation.set_velocity(body, places[::-1])
    return simulation, body


def sliding_cube(**options: Any) -> tuple[Simulation, AffineBody]:
    """A cube that falls on a half-space, tilted, and slides."""
    scene = Scene("sliding", threads=1, deterministic=True)
    shape = box((0.1, 0.1, 0.1), (1, 1, 1)).rotated((0.3, 1.0, 0.2), 0.1).translated((0.0, 0.0, 0.061))
    cube = AffineBody(scene, "cube", shape, youngs_modulus=2e5)
    chosen = {
        "contacts": ContactTable(0.3),
        "activation_distance": 1e-2,
        "time_step": 0.005,
        "eps_v": 0.02,
        "settings": replace(PRECISE, relative_force_tolerance=1e-11),
    }
    simulation = Simulation(scene, [cube, HalfSpace(scene, "ground")], **(chosen | options))
    simulation.set_velocity(cube, (0.4, 0.1, -0.1))
    return simulation, cube


def add_miss(body: Body, goal: Sequence[float]) -> Any:
    """An attribute of each vertex: the squared distance from a point [m^2]."""
    way = body.position - body.vertices.add_constant("goal", 3, 1, value=np.tile(goal, (len(body.rest), 1)))
    return body.vertices.add_attribute("miss", computed_attribute=way.dot(way))


def difference(
    trajectory: Trajectory, objective: Any, directions: Mapping[Any, Floats], step: float = 1e-4
) -> tuple[float, bool]:
    """The derivative of an objective along directions of parameters, by differences of order 8 of whole runs; and
    whether all runs had as many contacts in each step as the one in the middle."""
    values = {parameter: trajectory.value(parameter) for parameter in directions}
    trajectory.objective(objective)
    contacts, same, total = [report.contacts for report in trajectory.reports], True, 0.0
    for times, weight in EIGHTH_ORDER:
        for sign in (1, -1):
            for parameter, direction in directions.items():
                trajectory.set(parameter, values[parameter] + sign * times * step * direction)
            total += sign * weight / step * trajectory.objective(objective)
            same &= [report.contacts for report in trajectory.reports] == contacts
    for parameter, value in values.items():
        trajectory.set(parameter, value)
    return total, same


def random_directions(trajectory: Trajectory, parameters: Sequence[Any], seed: int = 0) -> dict[Any, Floats]:
    """For each parameter a random direction about as large as its numbers."""
    random = np.random.default_rng(seed)
    found = {}
    for parameter in parameters:
        value = trajectory.value(parameter)
        found[parameter] = random.normal(size=value.shape) * max(np.abs(value).max(), 1e-2)
    return found


def along(gradient: Mapping[Any, Floats], directions: Mapping[Any, Floats]) -> float:
    """A gradient along these directions."""
    return float(sum((gradient[parameter] * direction).sum() for parameter, direction in directions.items()))
