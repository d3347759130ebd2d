"""Small scenes of nonlinear layers, variable arity and their nesting."""

from __future__ import annotations

import numpy as np

from yasps import Attribute, Scene, concat_rows

SPRINGS = {
    False: [[0, 4], [4, 7], [4, 5], [1, 9], [5, 5], [3, 8], [10, 4]],
    True: [[0, 11], [12, 7], [4, 13], [16, 9], [14, 14]],
}


def lever_scene(projection: str, nested: bool) -> Scene:
    """Free points, tips of levers (angle, paper fig. 29) and fixed points; springs between any of them.

    Nested: also midpoints, themselves nonlinear, of pairs of those.
    """
    rng = np.random.default_rng(1)
    scene = Scene("levers")
    mesh = scene.add_mesh("mesh")
    arms = mesh.add_primitive("arms", 3)
    angle = arms.add_attribute("angle", 1, 1, value=rng.random(3))
    length = arms.add_constant("length", 1, 1, value=1 + rng.random(3))
    tips = mesh.add_primitive("tips", 5)
    arm = tips.add_connectivity("arm", arms, [0, 1, 2, 0, 1], 1)
    a = tips.add_attribute("angle", through=arm, source=angle)
    r = tips.add_attribute("length", through=arm, source=length)
    offset = mesh.add_attribute("offset", 3, 1, value=rng.random(3))
    tip = tips.add_attribute("position", computed_attribute=concat_rows([r * a.cos(), r * a.sin(), a * 0.1]) + offset)
    free = mesh.add_primitive("free", 4)
    position = free.add_attribute("position", 3, 1, value=rng.random((4, 3)))
    fixed = mesh.add_primitive("fixed", 2)
    fixed.add_constant("position", 3, 1, value=rng.random((2, 3)))
    points = mesh.add_primitive_union("points", [free, tips, fixed])
    points.add_attribute("position")
    if nested:
        middles = mesh.add_primitive("middles", 6)
        ends = middles.add_connectivity("ends", points, [0, 4, 5, 6, 8, 1, 4, 7, 9, 4, 10, 5], 2)
        both = middles.add_attribute("both", through=ends, source=points["position"])
        first, second = both.row(0).T, both.row(1).T
        middle = 0.5 * (first + second) + 0.1 * first.hadamard(second)
        middles.add_attribute("position", computed_attribute=middle)
        points = mesh.add_primitive_union("everything", [points, middles])
        points.add_attribute("position")
    springs = mesh.add_primitive("springs", len(SPRINGS[nested]))
    ends = springs.add_connectivity("ends", points, SPRINGS[nested], 2)
    x = springs.add_attribute("ends_at", through=ends, source=points["position"])
    d = x.row(0) - x.row(1)
    energy = (d.dot(d) - 0.5) ** 2 + d.dot(d)
    scene.add_energy(springs.add_attribute("energy", computed_attribute=energy), projection=projection)
    scene.add_energy(tips.add_attribute("weight", computed_attribute=9.8 * tip[1]), projection=projection)
    scene.add_minimize_target([angle, position, offset])
    return scene


def ring_scene(operation: str, nonlinear: bool, projection: str) -> Scene:
    """One-ring Laplacian of values, or of a nonlinear function of them, and pairs of rings."""
    rng = np.random.default_rng(2)
    scene = Scene("rings")
    mesh = scene.add_mesh("mesh")
    vertices = mesh.add_primitive("vertices", 7)
    x = vertices.add_attribute("x", 3, 1, value=rng.random((7, 3)))
    counts = [3, 2, 4, 1 if operation == "mean" else 0, 2, 5, 1]
    ring = vertices.add_connectivity("ring", vertices, rng.integers(0, 7, sum(counts)), counts=counts)
    source: Attribute = x
    if nonlinear:
        source = vertices.add_attribute("y", computed_attribute=x.hadamard(x) + x.sin())
    around = vertices.add_attribute("around", through=ring, source=source, operation=operation)
    d = around - x
    scene.add_energy(vertices.add_attribute("laplacian", computed_attribute=d.dot(d) ** 2), projection=projection)
    pairs = mesh.add_primitive("pairs", 4)
    ends = pairs.add_connectivity("ends", vertices, [[0, 1], [2, 3], [3, 3], [5, 6]], 2)
    both = pairs.add_attribute("both", through=ends, source=around)
    q = both.row(0) - 2 * both.row(1)
    scene.add_energy(pairs.add_attribute("energy", computed_attribute=q.dot(q) * (q.dot(q) - 3)), projection=projection)
    scene.add_minimize_target(x)
    return scene
