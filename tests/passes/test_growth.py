"""The passes' work grows with an energy's operations, and with the square of its width, and no faster.

Work is counted in function calls, which are the same on every machine.
"""

from __future__ import annotations

import sys
from types import FrameType
from typing import Any

import pytest

from benchmarks.large_energies import all_springs, many_energies, scalar_chain, unrolled_hexahedron
from yasps import Scene
from yasps.frontend.execution.emit import SceneEmitter
from yasps.passes.pipeline import run_pipeline


def calls(scene: Scene) -> int:
    """Function calls of all passes on the scene."""
    module = SceneEmitter(scene.name).emit(scene._energies, scene._targets, [])
    count = 0

    def note(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        run_pipeline(module)
    finally:
        sys.setprofile(before)
    return count


def growth(small: Scene, large: Scene, smallest: Scene) -> float:
    """How much more work the large scene adds to the small than the small to the smallest."""
    calls(smallest)  # modules, constants and types that are made but once
    least, less, more = (calls(scene) for scene in (smallest, small, large))
    return (more - less) / (less - least)


@pytest.mark.slow
def test_a_chain_of_numbers() -> None:
    """As many steps more, as much work more."""
    assert growth(scalar_chain(60), scalar_chain(90), scalar_chain(30)) < 1.1


@pytest.mark.nightly
def test_energies() -> None:
    assert growth(many_energies(3), many_energies(5), many_energies(1)) < 1.1


@pytest.mark.nightly
def test_terms() -> None:
    """Gauss points of one element: more terms of a Hessian as wide as before."""
    assert growth(unrolled_hexahedron(4), unrolled_hexahedron(5), unrolled_hexahedron(3)) < 1.2


@pytest.mark.nightly
def test_width() -> None:
    """Twice as many points have 4.4 times as many springs, and about as many more entries of the Hessian."""
    springs = {points: points * (points - 1) // 2 for points in (6, 12)}
    calls(all_springs(6))
    few, many = (calls(all_springs(points)) / count for points, count in springs.items())
    assert many < 1.2 * few
