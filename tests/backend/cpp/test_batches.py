"""Many instances in one call of a kernel: packs that are projected together, and numbers of every count gathered."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from yasps import Scene
from yasps.backend.cpp.derivative import MOST_PACKS
from yasps.frontend.execution.cpu_scene import CpuScene

Check = Callable[[Scene], CpuScene]


@pytest.mark.parametrize("projection", ["clamp", "none"])
def test_counts_around_batches(projection: str, agrees_with_interpreter: Check) -> None:
    """One thread, so that a kernel gets all instances at once. Some pairs are one point with itself, some turned."""
    rng = np.random.default_rng(2)
    batch = 8 * MOST_PACKS
    scene = Scene("pairs", threads=1)
    mesh = scene.add_mesh("m")
    points = mesh.add_primitive("points", 12)
    x = points.add_attribute("x", 3, 1, value=rng.standard_normal((12, 3)))
    pairs = mesh.add_primitive("pairs", 0, is_dynamic=True)
    ends = pairs.add_connectivity("ends", points, [], 2)
    weight = pairs.add_constant("weight", 1, 1)
    both = pairs.add_attribute("both", through=ends, source=x)
    a, b = both.row(0), both.row(1)
    slanted = a[0] * b[1] + a[2] * b[2] * b[0]
    energy = weight * (a.dot(a) * b.dot(b) - a.dot(b) + slanted)
    scene.add_energy(pairs.add_attribute("energy", computed_attribute=energy), projection=projection)
    scene.add_minimize_target(x)
    for count in (1, 9, batch - 1, batch, batch + 1, 2 * batch + 17):
        chosen = rng.integers(0, 12, (count, 2))
        chosen[::5, 1] = chosen[::5, 0]
        pairs.update(ends=chosen, weight=rng.uniform(-1, 1, count))
        agrees_with_interpreter(scene)


def test_numbers_of_every_count_are_gathered() -> None:
    """Eight at a time, then two, then one."""
    rng = np.random.default_rng(4)
    instances, counts = 21, (1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 14)
    scene = Scene("numbers", threads=1)
    mesh = scene.add_mesh("m")
    sources = mesh.add_primitive("sources", 5)
    readers = mesh.add_primitive("readers", instances)
    indices = rng.integers(0, 5, instances)
    through = readers.add_connectivity("through", sources, indices, 1)
    expected = {}
    for n in counts:
        own, others = rng.standard_normal((instances, n)), rng.standard_normal((5, n))
        constant = readers.add_constant(f"own{n}", n, 1, value=own)
        sources.add_constant(f"other{n}", n, 1, value=others)
        joined = readers.add_attribute(f"joined{n}", through=through, source=sources[f"other{n}"])
        factors = np.arange(1.0, n + 1)
        value = constant.dot(factors.reshape(n, 1)) - joined.dot(factors.reshape(1, n))
        scene.add_energy(readers.add_attribute(f"sum{n}", computed_attribute=value))
        expected[f"m.readers.sum{n}"] = own @ factors - others[indices] @ factors
    for name, values in scene.energy_values().items():
        np.testing.assert_allclose(values, expected[name], rtol=1e-12, atol=1e-12)
