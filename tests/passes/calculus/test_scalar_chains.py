"""Chains of numbers: one slope for all directions, right values, and no NaN out of a choice not taken."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pytest
from mat_bodies import block_of, run_block
from xdsl.ir import SSAValue

from yasps.dialects.mat import MatBuilder
from yasps.dialects.mat.algebra import NormOp
from yasps.dialects.mat.comparison import SelectOp
from yasps.dialects.mat.elementwise import TABLED
from yasps.passes.calculus.derivatives import jacobian
from yasps.passes.calculus.scalar_chains import ScalarChains


def chains_of(inputs: list[SSAValue]) -> ScalarChains:
    def partial(value: SSAValue, u: SSAValue, front: Collection[SSAValue]) -> SSAValue | None:
        return None

    return ScalarChains(inputs, partial)


def front(chains: ScalarChains, value: SSAValue) -> list[SSAValue] | None:
    slopes = chains.slopes(value)
    return None if slopes is None else [u for u, _ in slopes]


@pytest.fixture
def b() -> MatBuilder:
    """A block with two vectors."""
    return MatBuilder(block_of([(3, 1), (3, 1)]))


def test_a_chain_ends_at_its_bottleneck(b: MatBuilder) -> None:
    x, _ = b.body.args
    distance = b.dot(x, x)
    logarithm = b.emit(TABLED["log"], [b.scale(b.number(3.0), distance)])
    gap = b.sub(distance, b.number(2.0))
    energy = b.scale(b.scale(gap, gap), logarithm)
    chains = chains_of([x])
    assert front(chains, energy) == [distance]
    assert front(chains, logarithm) == [distance]
    assert front(chains, distance) is None  # of a vector: its own rule


def test_two_numbers_are_a_bottleneck_too_and_one_is_a_better(b: MatBuilder) -> None:
    x, y = b.body.args
    first, second = b.dot(x, x), b.dot(y, y)
    ratio = b.divide(first, second)
    root = b.emit(TABLED["sqrt"], [ratio])
    chains = chains_of([x, y])
    assert front(chains, ratio) == [first, second]
    assert front(chains, b.scale(root, ratio)) == [ratio]
    mixed = front(chains, b.divide(root, second))
    assert mixed is not None
    assert set(mixed) == {first, second}


def test_three_independent_numbers_are_none(b: MatBuilder) -> None:
    x, _ = b.body.args
    entries = [b.block(x, k, 0, 1, 1) for k in range(3)]
    product = b.scale(entries[0], b.scale(entries[1], entries[2]))
    assert front(chains_of([x]), product) == [entries[0], product.owner.operands[1]]  # as its own rule
    assert front(chains_of(entries), entries[0]) is None


def test_constants_do_not_count(b: MatBuilder) -> None:
    x, y = b.body.args
    data, distance = b.dot(y, y), b.dot(x, x)
    chains = chains_of([x])
    assert front(chains, b.scale(b.divide(distance, data), data)) == [distance]


def test_jacobian_through_chains_by_complex_step(b: MatBuilder) -> None:
    x, y = b.body.args
    distance, other = b.dot(x, x), b.dot(x, y)
    ratio = b.divide(distance, b.add(other, b.number(4.0)))
    value = b.scale(b.emit(TABLED["log"], [ratio]), b.scale(ratio, ratio))
    vector = b.scale(b.scale(value, other), y)
    matrix = jacobian(b, [value, vector], [x])
    points = np.random.default_rng(0).uniform(0.2, 1.0, (2, 1, 3, 1))
    made = run_block(b.body, list(points))[matrix][0]
    for k in range(3):
        step = points.astype(complex)
        step[0, 0, k, 0] += 1e-30j
        values = run_block(b.body, list(step))
        column = np.concatenate([values[value].ravel(), values[vector].ravel()]).imag / 1e-30
        assert np.allclose(made[:, k], column, rtol=1e-13, atol=1e-14)


def test_each_direction_costs_one_product_of_numbers() -> None:
    """A longer chain adds operations once, not for each of three directions."""

    def operations(length: int) -> int:
        own = MatBuilder(block_of([(3, 1)]))
        value = own.dot(own.body.args[0], own.body.args[0])
        for _ in range(length):
            value = own.emit(TABLED["log"], [value])
        before = len(own.body.ops)
        jacobian(own, [value], [own.body.args[0]])
        return len(own.body.ops) - before

    per_link = [operations(length + 1) - operations(length) for length in (2, 3, 4)]
    assert len(set(per_link)) == 1
    assert per_link[0] <= 2  # its reciprocal, and the product of the slopes


def test_a_choice_is_no_part_of_a_chain(b: MatBuilder) -> None:
    """select(c, u, log 0): the slope of the side not taken is infinite and must not meet a zero."""
    x, y = b.body.args
    wrong = b.emit(TABLED["log"], [b.dot(y, y)])
    distance = b.dot(x, x)
    chosen = b.emit(SelectOp, [distance, distance, wrong])
    value = b.scale(chosen, chosen)
    chains = chains_of([x, y])
    assert front(chains, chosen) is None
    assert front(chains, value) == [chosen]
    matrix = jacobian(b, [value], [x, y])
    inputs = [np.array([[[1.0], [2.0], [3.0]]]), np.zeros((1, 3, 1))]
    assert np.allclose(run_block(b.body, inputs)[matrix][0], [[56.0, 112.0, 168.0, 0.0, 0.0, 0.0]])


def test_a_quotient_by_a_norm_has_no_front_but_that_norm(b: MatBuilder) -> None:
    """Where slope and norm are 0, the quotient's derivative with respect to anything else is infinite."""
    x, y = b.body.args
    norm, other = b.emit(NormOp, [x]), b.dot(y, y)
    chains = chains_of([x, y])
    alone = b.over_norm(b.scale(norm, norm), norm)
    assert front(chains, alone) == [norm]
    assert front(chains, b.scale(alone, alone)) == [norm]
    mixed = b.over_norm(b.scale(norm, other), norm)
    assert front(chains, mixed) is None
    assert front(chains, b.scale(mixed, mixed)) == [mixed]
