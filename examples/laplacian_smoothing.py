"""Smooths a noisy surface: each vertex is drawn to the mean of its neighbours, of which each has its own number.

Shows a connectivity of variable arity and a JOIN with operation="mean", differentiated to second order. Minimises
sum |x - x0|^2 / 2 + s sum |mean of neighbours - x|^2 / 2 in one Newton step, since the energy is quadratic.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from yasps.meshes import sphere
from yasps.program import SceneProgram

PROGRAM = SceneProgram("laplacian_smoothing", __doc__, frames=None, size=2000, size_means="vertices of the ball, about")
PROGRAM.add_argument("--strength", type=float, default=50.0, help="of the smoothing (50)")


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run laplacian_smoothing`."""
    options = PROGRAM.options(arguments)
    ball = sphere(1.0, options.size)
    used, edges = np.unique(ball.surface_edges(), return_inverse=True)
    edges = edges.reshape(-1, 2)
    noisy = ball.vertices[used] * np.random.default_rng(options.seed).normal(1.0, 0.05, (len(used), 1))

    both_ways = np.concatenate([edges, edges[:, ::-1]])
    both_ways = both_ways[np.argsort(both_ways[:, 0], kind="stable")]
    scene = PROGRAM.scene(options)
    vertices = scene.add_mesh("surface").add_primitive("vertices", num_instances=len(used))
    x = vertices.add_attribute("x", rows=3, cols=1, value=noisy)
    start = vertices.add_constant("start", rows=3, cols=1, value=noisy)
    ring = vertices.add_connectivity("ring", vertices, both_ways[:, 1], counts=np.bincount(both_ways[:, 0]))
    around = vertices.add_attribute("around", through=ring, source=x, operation="mean")
    strength = scene.add_constant("strength", rows=1, cols=1, value=options.strength)
    rough, far = around - x, x - start
    scene.add_energy(vertices.add_attribute("roughness", computed_attribute=0.5 * strength * rough.dot(rough)))
    scene.add_energy(vertices.add_attribute("distance", computed_attribute=0.5 * far.dot(far)))
    scene.add_minimize_target(x)

    def roughness() -> float:
        return float(np.std(np.linalg.norm(x.compute().array, axis=1)))

    before, energy = roughness(), scene.total_energy()
    (direction,) = scene.minimize_energy(tolerance=1e-20)
    x.update_value(x.value - direction)
    after = roughness()
    left = np.abs(scene.gradient()[0]).max()
    print(f"{len(used)} vertices, {ring.arity} neighbours at most: energy {energy:.4g} -> {scene.total_energy():.4g}")
    print(f"spread of the radii {before:.4f} -> {after:.4f}; largest entry of the gradient left {left:.1e}")
    if not (after < 0.5 * before and left < 1e-8):
        print("the surface did not get smooth", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
