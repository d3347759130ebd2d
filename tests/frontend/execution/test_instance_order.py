"""An energy's instances in another order inside the assembly: nobody outside may see more of it than rounding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from yasps import Attribute, Connectivity, NotFiniteError, Scene
from yasps.backend.reference.interpreter import Interpreter
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.runtime.matrix.ordering import FEWEST_BLOCKS, instance_order

POINTS = FEWEST_BLOCKS + 100


@dataclass
class Chain:
    """Springs between neighbours on a line, given in random order."""

    position: Attribute
    rest: Attribute
    ends: Connectivity
    energy: Attribute
    compiled: CpuScene


def chain(threads: int = 2) -> Chain:
    rng = np.random.default_rng(3)
    scene = Scene("chain", threads=threads)
    mesh = scene.add_mesh("m")
    points = mesh.add_primitive("points", POINTS)
    position = points.add_attribute(
        "position", 3, 1, value=np.arange(POINTS)[:, None] + rng.normal(0, 0.1, (POINTS, 3))
    )
    pairs = np.column_stack([np.arange(POINTS - 1), np.arange(1, POINTS)])
    springs = mesh.add_primitive("springs", POINTS - 1)
    ends = springs.add_connectivity("ends", points, rng.permutation(pairs), 2)
    rest = springs.add_constant("rest", 1, 1, value=rng.uniform(0.5, 1.5, POINTS - 1))
    x = springs.add_attribute("x", through=ends, source=position)
    stretch = (x.row(1) - x.row(0)).norm() - rest
    energy = springs.add_attribute("energy", computed_attribute=stretch * stretch)
    scene.add_energy(energy)
    scene.add_minimize_target(position)
    return Chain(position, rest, ends, energy, scene.compile())


def check(c: Chain) -> None:
    """Gradient, Hessian and energies against the interpreter, which knows of no such order."""
    gradient = c.compiled.assemble()
    interpreter = Interpreter(c.compiled.module, c.compiled.data())
    expected, hessian = interpreter.assemble()
    assert np.abs(gradient - expected).max() < 1e-12
    assert np.abs(c.compiled.static_matrix.to_scipy() - hessian).max() < 1e-12
    (values,) = c.compiled.energies().values()
    assert np.allclose(values, interpreter.value("m.springs.energy").reshape(-1), rtol=1e-13)


def ordered(c: Chain) -> bool:
    (term,) = c.compiled._terms
    return c.compiled.placements[term.symbol].ordered is not None


@pytest.mark.parametrize("threads", [1, 3])
def test_results_are_those_of_the_given_order(threads: int) -> None:
    c = chain(threads)
    check(c)
    assert ordered(c)


def test_new_numbers_and_new_indices_are_seen() -> None:
    c = chain()
    c.compiled.assemble()
    c.rest.update_value(np.linspace(0.1, 2.0, POINTS - 1))
    check(c)
    c.ends.update_value(c.ends.indices[::-1])
    check(c)
    assert ordered(c)
    in_order = np.column_stack([np.arange(POINTS - 1), np.arange(1, POINTS)])
    c.ends.update_value(in_order)
    check(c)
    assert not ordered(c)


def test_an_error_names_the_instance_of_the_user() -> None:
    c = chain()
    c.compiled.assemble()
    assert ordered(c)
    values = np.arange(POINTS)[:, None] * np.ones(3)
    values[0] = 1e200  # overflows in the one spring at this end of the chain
    spring = np.flatnonzero((c.ends.indices == 0).any(axis=1))[0]
    c.position.update_value(values)
    with pytest.raises(NotFiniteError, match=f"on instance {spring} "):
        c.compiled.assemble()


@pytest.mark.parametrize("count", [FEWEST_BLOCKS, 70_000])  # the latter does not fit in 16 bits
def test_order_follows_the_first_block_that_counts(count: int) -> None:
    kappa = np.column_stack([np.arange(count)[::-1] + 1, np.zeros(count)]).astype(np.int32)
    shuffled = np.random.default_rng(0).permutation(count)
    sizes = np.ones(count, np.int32)
    found = instance_order(kappa[shuffled], sizes, None)
    assert found is not None
    assert np.array_equal(kappa[shuffled][found][:, 0], np.arange(count) + 1)
    assert instance_order(kappa, sizes, None) is None
    backwards = np.arange(count, dtype=np.int32)[::-1]
    found = instance_order(kappa[shuffled], sizes, backwards)
    assert found is not None
    assert np.array_equal(kappa[shuffled][found], kappa)
