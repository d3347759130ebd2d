"""Products with the Hessian on a device: the kernels run on the host, against SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cuda_on_host import HostProgram
from device_systems import Maker, load_solver_program, random_structure

from yasps.runtime.core.library import Runtime
from yasps.runtime.matrix.cuda import product as cuda_product

SHAPES = ("1x1", "1x3", "3x1", "2x2", "3x3", "3x12", "12x3", "6x6", "9x9", "12x12")
SPECIAL = {f"yasps_multiply_{shape}" for shape in SHAPES}
both_products = pytest.mark.parametrize("deterministic", [False, True])


@pytest.fixture(scope="module")
def program() -> HostProgram:
    """The kernels of the solver and of the matrices."""
    return load_solver_program()


@pytest.fixture
def maker(runtime: Runtime, program: HostProgram) -> Maker:
    """Makes systems and solvers on a device of the test's own."""
    return Maker(runtime, program)


LAYOUTS = [
    ((70,), (3,)),
    ((9, 5, 9), (3, 12, 3)),
    ((7, 8, 9), (1, 3, 1)),
    ((40, 3), (2, 6)),
    ((5, 4, 2), (9, 5, 17)),
    ((0, 3, 0, 4), (3, 4, 12, 33)),
    ((1,), (1,)),
]


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("parts", [1, 2])
@both_products
def test_product_is_that_of_scipy(maker: Maker, layout: Any, parts: int, deterministic: bool) -> None:
    system = maker.random(random_structure(1, *layout), parts=parts, definite=False)
    x = np.random.default_rng(2).standard_normal(system.size)
    y = maker.empty()
    maker.solver(deterministic).multiply(system.parts, system.vector(x), y)
    expected = system.dense @ x
    np.testing.assert_allclose(y.download(), expected, rtol=0, atol=1e-13 * (np.abs(system.dense) @ np.abs(x)).max())


def test_every_special_kernel_was_tried(maker: Maker) -> None:
    """The layouts above have every shape that has a kernel of its own, and others."""
    for layout in LAYOUTS:
        system = maker.random(random_structure(1, *layout), definite=False)
        maker.solver().multiply(system.parts, system.vector(np.ones(system.size)), maker.empty())
    assert {name for name in maker.device.launches if "multiply" in name} == SPECIAL | {"yasps_multiply_any"}


@pytest.mark.parametrize("layout", LAYOUTS[1:5])
def test_teams_take_blocks_in_turn(maker: Maker, monkeypatch: pytest.MonkeyPatch, layout: Any) -> None:
    """As on a large system: a team adds up a row as long as it stays the same."""
    monkeypatch.setattr(cuda_product, "_ENOUGH_TEAMS", 4)
    monkeypatch.setattr(cuda_product, "_MOST_IN_TURN", 3)
    system = maker.random(random_structure(3, *layout), definite=False)
    x = np.random.default_rng(2).standard_normal(system.size)
    y = maker.empty()
    maker.solver().multiply(system.parts, system.vector(x), y)
    np.testing.assert_allclose(y.download(), system.dense @ x, rtol=0, atol=1e-12)
