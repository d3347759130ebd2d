"""Derivatives taken through F do not lose digits far from the origin (architecture, 4.2)."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from yasps import Scene, materials
from yasps.meshes import box


def hessian_at(offset: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unprojected Hessian of deformed stable Neo-Hookean tets, written in positions, moved by the offset."""
    shape = box(divisions=(2, 2, 2))
    inverse, volume = materials.rest_shape(shape.vertices, shape.tets)
    noise = 0.1 * np.random.default_rng(0).standard_normal(shape.vertices.shape)
    # Positions that float64 holds exactly at both places: what is measured is the code, not the rounding of its input.
    positions = np.round((shape.vertices + noise) * 2**20) / 2**20
    scene = Scene("translated", threads=1)
    mesh = scene.add_mesh("m")
    vertices = mesh.add_primitive("v", len(positions))
    tets = mesh.add_primitive("t", len(shape.tets))
    x = vertices.add_attribute("x", 3, 1, value=positions + offset)
    corners = tets.add_connectivity("corners", vertices, shape.tets, 4)
    f = materials.deformation_gradient(
        tets.add_attribute("positions", through=corners, source=x),
        tets.add_constant("inverse", 3, 3, value=inverse),
    )
    volumes = tets.add_constant("volume", 1, 1, value=volume)
    energy = materials.stable_neo_hookean(f, 2.0, 3.0, volumes)
    scene.add_energy(tets.add_attribute("e", computed_attribute=energy), projection="none")
    scene.add_minimize_target(x)
    compiled = scene.compile()
    compiled.assemble()
    return compiled.static_matrix.to_scipy().toarray()


@pytest.mark.parametrize("offset", [(10.0, 10.0, 10.0), (-10.0, 0.0, 0.0), (3.3, -7.7, 9.1)])
def test_translation_by_ten_units_keeps_twelve_digits(offset: tuple[float, float, float]) -> None:
    here = hessian_at(np.zeros(3))
    there = hessian_at(np.array(offset))
    assert np.abs(there - here).max() <= 1e-12 * np.abs(here).max()
