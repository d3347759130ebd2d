"""A scene whose energies the bridges hand over: springs between free points and corners of an affine body."""

from __future__ import annotations

import numpy as np

from yasps import Attribute, Scene


def springs_over_a_union() -> tuple[Scene, list[Attribute]]:
    """Three free points and one corner of an affine body, a UNION, three springs between them; the scene, and the
    inputs position, matrix, shift (targets), stiffness (of each spring), length (of the mesh)."""
    scene = Scene("bridged")
    mesh = scene.add_mesh("mesh")
    body = mesh.add_primitive("body", 1)
    matrix = body.add_attribute("matrix", 3, 3, value=np.eye(3) + 0.1 * np.arange(9).reshape(3, 3))
    shift = body.add_attribute("shift", 3, 1, value=[0.1, -0.2, 0.3])
    corners = mesh.add_primitive("corners", 1)
    of_body = corners.add_connectivity("of_body", body, [[0]], 1)
    rest = corners.add_constant("rest", 3, 1, value=[0.5, 0.6, 0.7])
    carried = corners.add_attribute("matrix_of_body", through=of_body, source=matrix).reshape(3, 3)
    moved = corners.add_attribute("shift_of_body", through=of_body, source=shift).transpose()
    corners.add_attribute("position", computed_attribute=carried * rest + moved)
    free = mesh.add_primitive("free", 3)
    numbers = [[0.1, 0, 0], [1.2, 0.1, 0], [2, -0.1, 0.3]]
    position = free.add_attribute("position", 3, 1, value=numbers)
    points = mesh.add_primitive_union("points", [corners, free])
    points.add_attribute("position")
    springs = mesh.add_primitive("springs", 3)
    ends = springs.add_connectivity("ends", points, [[0, 1], [1, 2], [0, 3]], 2)
    both = springs.add_attribute("both", through=ends, source=points["position"])
    stiffness = springs.add_constant("stiffness", 1, 1, value=[2.0, 3.0, 1.5])
    length = mesh.add_constant("length", 1, 1, value=1.3)
    strain = (both.row(1) - both.row(0)).norm() - length
    scene.add_energy(springs.add_attribute("energy", computed_attribute=0.5 * stiffness * strain * strain))
    weight = free.add_attribute("weight", computed_attribute=2.0 * position[1] + 0.3 * position.dot(position))
    scene.add_energy(weight)
    scene.add_minimize_target([position, matrix, shift])
    return scene, [position, matrix, shift, stiffness, length]
