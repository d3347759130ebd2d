"""Numbers in formulas are read from a storage: the code is the same for all of them, and means what it meant."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from small_scenes import emit
from xdsl.dialects.builtin import ModuleOp
from xdsl.parser import Parser
from xdsl.passes import ModulePass

from yasps import Attribute, Scene, concat_rows, constant, contact, materials, select
from yasps.backend.reference.interpreter import Interpreter
from yasps.backend.reference.scene_data import check_scene_data
from yasps.dialects.rel import DerivativeOp, StorageOp
from yasps.frontend.execution.scene_key import text_of_key
from yasps.passes.pipeline import LIFTING, PIPELINE, make_context, run_pipeline

Formula = Callable[[Attribute, float], Attribute]
"""An energy of the positions of four points, as rows, and a number."""


def hinge_with_stiffness(x: Attribute, a: float) -> Attribute:
    return materials.hinge_bending(x, a)


def tet(x: Attribute, a: float) -> Attribute:
    inverse = constant([[1.0, 0.3, 0.0], [0.0, 1.7, 0.4], [0.1, 0.0, 1.1]])  # these are weights
    deformation = materials.deformation_gradient(x, inverse)
    return materials.stable_neo_hookean(deformation, a, 2.5 * a, a / 6)


def cloth(x: Attribute, a: float) -> Attribute:
    corners = concat_rows([x.row(i) for i in range(3)])
    deformation = materials.triangle_deformation(corners, constant([[1.2, 0.0], [0.3, 1.4]]))
    return materials.baraff_witkin(deformation, a, 3.0 * a, 0.7, compression=a / 100)


FORMULAS: dict[str, Formula] = {
    "factor": lambda x, a: a * (x.row(0) - x.row(1)).dot(x.row(2)),
    "divisor": lambda x, a: (x.row(0) - x.row(1)).dot(x.row(0) - x.row(1)) ** 2 / a,
    "shift": lambda x, a: ((x.row(0) - x.row(1)).norm() - a) ** 2,
    "vector": lambda x, a: x.row(0).dot(constant([[a, 0.0, -9.8]])) + x.row(1).dot(x.row(1)),
    "multiple of the identity": lambda x, a: (x.T * x - constant(a * np.eye(3))).det() ** 2,
    "divided by itself": lambda x, a: x.row(0).dot(x.row(0)) ** 2 / (a + x.row(0).dot(x.row(1)) ** 2),
    "comparison": lambda x, a: select(x[0, 0] < a, a, a + 1) * x.row(1).dot(x.row(1)),
    "choice": lambda x, a: select(x[0, 0] < x[1, 0], constant(a), constant(3 * a)) * x.row(1).dot(x.row(1)),
    "power": lambda x, a: (a + x.row(1).dot(x.row(1))) ** 1.7 * a**2,
    "functions": lambda x, a: (x[0, 0] / a).sin().exp() * (a + x[1, 1] * x[1, 1]).log(),
    "number alone": lambda x, a: constant(a) + 0 * x[0, 0],
    "time step": lambda x, a: ((x.row(0) - x.row(1)) / a).norm() ** 3,
    "barrier": lambda x, a: contact.barrier(contact.squared_point_plane(x), constant(a), constant(4 * a)),
    "hinge": hinge_with_stiffness,
    "tet": tet,
    "cloth": cloth,
}


def scene_of(formula: Callable[[Attribute], Attribute]) -> Scene:
    scene = Scene("numbers")
    mesh = scene.add_mesh("m")
    points, elements = mesh.add_primitive("points", 4), mesh.add_primitive("elements", 2)
    x = points.add_attribute("x", 3, 1, value=np.random.default_rng(7).uniform(0.5, 1.5, (4, 3)))
    corners = elements.add_connectivity("corners", points, [[0, 1, 2, 3], [1, 3, 2, 0]], 4)
    rows = elements.add_attribute("rows", through=corners, source=x)
    scene.add_energy(elements.add_attribute("energy", computed_attribute=formula(rows)))
    scene.add_minimize_target(x)
    return scene


def lowered(formula: Formula, number: float, passes: Sequence[ModulePass] = PIPELINE) -> ModuleOp:
    return run_pipeline(emit(scene_of(lambda x: formula(x, number))).module, passes=passes)


def numbers_in(module: ModuleOp) -> list[float]:
    storages = [op for op in module.walk() if isinstance(op, StorageOp)]
    return [float(v) for op in storages if (known := op.known_numbers()) is not None for v in known.ravel()]


@pytest.mark.parametrize("name", FORMULAS)
def test_the_text_is_the_same_for_all_numbers(name: str) -> None:
    some, others = (lowered(FORMULAS[name], number, LIFTING) for number in (3.7, 0.6180339887498949))
    assert text_of_key(some) == text_of_key(others)
    assert str(some) != str(others)
    assert "3.7" not in text_of_key(some)


@pytest.mark.parametrize("name", ["divisor", "shift", "choice", "time step"])
def test_no_later_pass_looks_at_the_numbers(name: str) -> None:
    assert text_of_key(lowered(FORMULAS[name], 3.7)) == text_of_key(lowered(FORMULAS[name], 0.6180339887498949))


@pytest.mark.parametrize("name", FORMULAS)
def test_it_means_the_same_before_and_after(name: str) -> None:
    """Of structural numbers too, which stay in the code."""
    for number in (3.7, 0.5, 1.0):
        emitted = emit(scene_of(lambda x, number=number: FORMULAS[name](x, number)))  # type: ignore[misc]
        before = Interpreter(emitted.module.clone(), emitted.data).total_energy()
        run_pipeline(emitted.module, passes=LIFTING)
        check_scene_data(emitted.module, emitted.data)
        after = Interpreter(emitted.module, emitted.data).total_energy()
        assert abs(after - before) <= 1e-14 * max(1, abs(before))


def test_two_uses_of_equal_numbers_are_two_numbers() -> None:
    """Otherwise the code would depend on whether two parameters happen to be equal."""

    def two(a: float, b: float) -> ModuleOp:
        return run_pipeline(emit(scene_of(lambda x: a * x.row(0).dot(x.row(0)) + b * x.row(1).dot(x.row(1)))).module)

    assert text_of_key(two(3.0, 3.0)) == text_of_key(two(3.0, 4.0))


def test_what_is_structure_stays() -> None:
    module = lowered(lambda x, a: 0.5 * (a * x.row(0).dot(x.row(0)) - 2 * x.row(1).dot(x.row(1))) ** 2, 3.7)
    assert numbers_in(module) == [3.7]
    assert numbers_in(lowered(lambda x, a: 0.5 * x.row(0).dot(x.row(0)) ** 3 - 1, 3.7)) == []


def test_every_digit_is_in_the_dump() -> None:
    for number in (0.1 + 0.2, 1e-310, 1.7976931348623157e308, -1 / 3):
        module = lowered(lambda x, a: a * x[0, 0], number)
        again = Parser(make_context(), str(module)).parse_module()
        again.verify()
        assert numbers_in(again) == [number]


# -- weights -----------------------------------------------------------------------------------------------------------


def mean(x: Attribute) -> Attribute:
    return (x.row(0) + x.row(1) + x.row(2) + x.row(3)) / 4


def about_the_mean(x: Attribute, a: float) -> Attribute:
    """Four differences, of which three are independent: found by their weights. a is a factor of all of them."""
    differences = [(x.row(i) - mean(x)) / a for i in range(4)]
    return sum((d.dot(d) ** 2 for d in differences), constant(0.0))


def projection_of(module: ModuleOp) -> str:
    (derivative,) = [op for op in module.walk() if isinstance(op, DerivativeOp)]
    assert derivative.projects is not None
    return derivative.projects.data


def test_weights_stay_where_they_tell_how_wide_the_projection_is() -> None:
    module = lowered(about_the_mean, 0.01)
    assert projection_of(module).startswith("9x9 of 12x12")
    assert set(numbers_in(module)) == {0.01}


def test_a_factor_of_a_whole_sum_is_no_weight() -> None:
    module = lowered(lambda x, a: ((0.25 * x.row(0) + 0.75 * x.row(1)) / a).norm() ** 3, 3.7)
    assert numbers_in(module) == [3.7]


def test_weights_beside_data_tell_nothing_and_are_lifted() -> None:
    scene = Scene("data")
    mesh = scene.add_mesh("m")
    points, elements = mesh.add_primitive("points", 2), mesh.add_primitive("elements", 1)
    x = points.add_attribute("x", 3, 1)
    rest = elements.add_constant("rest", 1, 1, value=[1.0])
    rows = elements.add_attribute("rows", through=elements.add_connectivity("c", points, [0, 1], 2), source=x)
    y = 0.3 * rows.row(0) - rest * rows.row(1)
    scene.add_energy(elements.add_attribute("energy", computed_attribute=y.dot(y) ** 2))
    scene.add_minimize_target(x)
    assert numbers_in(run_pipeline(emit(scene).module)) == [0.3]


def test_in_a_linear_energy_there_are_no_weights() -> None:
    """It has no Hessian to project: another acceleration of gravity needs no other code."""
    module = lowered(lambda x, a: a * x[0, 0] + 3 * x[1, 0] + x.row(2).dot(constant([[0.0, a, 1.0]])), 9.8)
    assert set(numbers_in(module)) == {9.8, 3.0, 0.0}


def test_weights_of_an_attribute_behind_a_join_are_lifted() -> None:
    scene = Scene("behind")
    mesh = scene.add_mesh("m")
    points, pairs = mesh.add_primitive("points", 2), mesh.add_primitive("pairs", 1)
    x = points.add_attribute("x", 3, 1)
    points.add_attribute("y", computed_attribute=concat_rows([0.3 * x[0] + 0.7 * x[1], x[2]]))
    ends = pairs.add_connectivity("ends", points, [0, 1], 2)
    rows = pairs.add_attribute("rows", through=ends, source=points["y"])
    gap = rows.row(0) - rows.row(1)
    scene.add_energy(pairs.add_attribute("energy", computed_attribute=gap.dot(gap)))
    scene.add_minimize_target(x)
    assert set(numbers_in(run_pipeline(emit(scene).module))) == {0.3, 0.7}


def test_the_pass_says_it_all_and_twice_is_once() -> None:
    emitted = emit(scene_of(lambda x: 3.7 * x.row(0).dot(x.row(1))))
    run_pipeline(emitted.module, passes=LIFTING)
    text = str(emitted.module)
    assert "rel.storage @m.elements.energy.numbers on @numbers : 1x1 constant numbers 3.7\n" in text
    run_pipeline(emitted.module, passes=LIFTING)
    assert str(emitted.module) == text
