"""The compiler and the runtime, built once per test session, and random scenes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from yasps.runtime.build.toolchain import Compiler, find_compiler
from yasps.runtime.core.library import Runtime, load_runtime


@pytest.fixture(scope="session")
def compiler() -> Compiler:
    """The C++ compiler of this machine."""
    return find_compiler()


@pytest.fixture(scope="session")
def runtime(compiler: Compiler) -> Runtime:
    """The solver runtime."""
    return load_runtime(compiler)


@dataclass(frozen=True)
class Scene:
    """Targets of several sizes and energies with random index arrays."""

    boundaries: NDArray[np.int64]
    block_sizes: NDArray[np.int32]
    kappas: list[NDArray[np.int32]]

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.boundaries[-1])

    def size_of(self, slot: int) -> int:
        """Size of the dof block that a 1-based offset names."""
        target = int(np.searchsorted(self.boundaries, slot - 1, side="right")) - 1
        return int(self.block_sizes[target])


def make_scene(seed: int, counts: tuple[int, ...], sizes: tuple[int, ...]) -> Scene:
    """Energies with capacities 1 to 5 over random dof blocks: with gaps, repeated slots, and one without instances."""
    rng = np.random.default_rng(seed)
    lengths = [count * size for count, size in zip(counts, sizes, strict=True)]
    boundaries = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    starts = np.concatenate(
        [np.arange(boundaries[t], boundaries[t + 1], size, dtype=np.int64) for t, size in enumerate(sizes)]
    )
    kappas = []
    for capacity, instances in ((4, 37), (1, 20), (2, 0), (5, 19), (3, 1)):
        kappa = rng.choice(starts, (instances, capacity)) + 1
        kappa[rng.random(kappa.shape) < 0.2] = 0
        repeated = rng.random(instances) < 0.3
        kappa[repeated, -1] = kappa[repeated, 0]
        kappas.append(kappa.astype(np.int32))
    kappas.append(kappas[0][:5].copy())  # an energy on the same blocks as another
    return Scene(boundaries, np.array(sizes, np.int32), kappas)


@pytest.fixture(params=[((7, 5, 4), (3, 9, 1)), ((30,), (3,)), ((4, 3, 6, 2), (9, 3, 3, 5)), ((3, 2), (12, 7))])
def scene(request: pytest.FixtureRequest) -> Scene:
    """Scenes with one and several block sizes, some with a specialised product and some without."""
    counts, sizes = request.param
    return make_scene(len(counts), counts, sizes)
