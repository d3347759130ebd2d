"""Positions, gradients and Hessians through every parameterisation, by one energy on the union of all."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from parameterised_pieces import all_pieces

from yasps import Scene
from yasps.backend.reference.interpreter import Interpreter

STEP = 1e-30


@pytest.mark.nightly  # it compiles all of them
def test_an_energy_of_positions_has_exact_derivatives() -> None:
    """Gradient against complex steps of the formulas in NumPy, Hessian against complex steps of the gradient in the
    interpreter of the IR."""
    scene = Scene("pieces", threads=1)
    pieces = all_pieces(scene, 0.1)
    everything = scene.add_mesh("everything").add_primitive_union("v", [piece.vertices for piece in pieces.values()])
    everything.add_attribute("position")
    x = everything["position"]
    pull = everything.add_attribute("pull", computed_attribute=(x.dot(x) + x[0] * x[1] * x[2]) * (1 + x[2]))
    scene.add_energy(pull, projection="none")
    for piece in pieces.values():
        scene.add_minimize_target(piece.targets)
    compiled = scene.compile()
    found = iter(compiled.split(compiled.gradients()["everything.v.pull"]))

    def energy(positions: np.ndarray) -> complex:
        squares = (positions * positions).sum(axis=1)
        return complex(((squares + positions.prod(axis=1)) * (1 + positions[:, 2])).sum())

    for name, piece in pieces.items():
        here = [target.value.astype(complex) for target in piece.targets]
        for number, values in enumerate(here):
            gradient = next(found)
            for entry in range(values.size):
                moved = [other.copy() for other in here]
                moved[number][entry] += 1j * STEP
                exact = energy(piece.positions(moved)).imag / STEP
                assert gradient[entry] == pytest.approx(exact, abs=1e-12 * np.abs(gradient).max()), name

    hessian = scene.hessian(projected=False).to_scipy().toarray()
    data, rows = compiled.data(), []
    for target in compiled.targets:
        symbol = compiled.emitter.symbol_of(target)
        for k in range(data.storages[symbol].size):
            moved_storage = data.storages[symbol].astype(complex)
            moved_storage.flat[k] += 1j * STEP
            one = dataclasses.replace(data, storages={**data.storages, symbol: moved_storage})
            rows.append(Interpreter(compiled.module, one).gradient().imag / STEP)
    assert np.abs(hessian - np.array(rows)).max() <= 1e-12 * np.abs(hessian).max()
