"""`project-psd` and the linear cut: where Hessians are projected, how wide, and that it is right."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from mat_bodies import relative_error
from numpy.typing import NDArray
from small_scenes import dense_assembly, emit, soft_tets, stable_neo_hookean

from yasps import Attribute, Scene, concat_rows
from yasps.backend.reference.interpreter import Interpreter
from yasps.dialects.rel import DerivativeOp
from yasps.passes.pipeline import make_context
from yasps.passes.transforms.differentiate import Differentiate
from yasps.passes.transforms.inline_references import InlineReferences
from yasps.passes.transforms.project_psd import ProjectPsd


def slots(arity: int, energy: Callable[[Attribute], Attribute], projection: str = "clamp") -> Scene:
    """An energy of the rows of a JOIN of `arity` free points (3x1), on four instances."""
    random = np.random.default_rng(8)
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    points, elements = mesh.add_primitive("v", 6), mesh.add_primitive("e", 4)
    points.add_attribute("x", 3, 1, value=random.random((6, 3)))
    choices = [random.permutation(6)[:arity] for _ in range(4)]
    ends = elements.add_connectivity("ends", points, np.array(choices), arity)
    x = elements.add_attribute("x", through=ends, source=points["x"])
    scene.add_energy(elements.add_attribute("energy", computed_attribute=energy(x)), projection=projection)
    scene.add_minimize_target(points["x"])
    return scene


def projected(scene: Scene) -> tuple[list[str], Any]:
    """What each derivative says about its projection, and the module."""
    emitted = emit(scene)
    for p in (InlineReferences(), Differentiate(), ProjectPsd()):
        p.apply(make_context(), emitted.module)
    emitted.module.verify()
    said = [op.projects.data for op in emitted.module.walk() if isinstance(op, DerivativeOp) and op.projects]
    return said, emitted.module


def _differences(x: Attribute, pairs: list[tuple[int, int]]) -> Attribute:
    return concat_rows([x.row(i) - x.row(j) for i, j in pairs])


CUT = "the energy reads its inputs through a linear cut"
WHOLE = "no narrower linear cut"
WIDTHS: dict[str, tuple[int, Callable[[Attribute], Attribute], str]] = {
    "point-point": (2, lambda x: (x.row(1) - x.row(0)).norm() ** 3, f"3x3 of 6x6: {CUT}"),
    "point-triangle by differences": (
        4,
        lambda x: _differences(x, [(1, 0), (2, 0), (3, 0)]).dot(_differences(x, [(1, 0), (2, 0), (3, 0)])) ** 2,
        f"9x9 of 12x12: {CUT}",
    ),
    "hinge": (
        4,
        lambda x: (x.row(1) - x.row(0)).cross(x.row(2) - x.row(0)).dot(x.row(3) - x.row(0)) ** 2,
        f"9x9 of 12x12: {CUT}",
    ),
    "all three edges of a triangle": (
        3,
        lambda x: sum(((x.row(i) - x.row(j)).norm() for i, j in ((0, 1), (1, 2))), (x.row(2) - x.row(0)).norm()),
        f"6x6 of 9x9: {CUT}",
    ),
    "one coordinate": (3, lambda x: (x.col(2).sum() - 1.0) ** 4, f"1x1 of 9x9: {CUT}"),
    "a linear part beside": (2, lambda x: x.sum() + (x.row(1) - x.row(0)).norm(), f"3x3 of 6x6: {CUT}"),
    "a linear part inside": (
        2,
        lambda x: concat_rows([x[0, 1], (x.row(1) - x.row(0)).norm()]).norm() ** 3,
        f"4x4 of 6x6: {CUT}",
    ),
    "products of inputs": (2, lambda x: x.row(0).dot(x.row(1)), f"6x6 of 6x6: {WHOLE}"),
    "a part held constant": (
        2,
        lambda x: (x.row(1) - x.row(0)).dot(x.row(1) - x.row(0)) * (x.stop_gradient().norm() + 1.0),
        f"3x3 of 6x6: {CUT}",
    ),
    "affine": (2, lambda x: x.sum() * 3.0, "nowhere: the energy is affine, its Hessian is zero"),
}


@pytest.mark.parametrize("name", WIDTHS)
def test_width(name: str) -> None:
    arity, energy, wanted = WIDTHS[name]
    said, _ = projected(slots(arity, energy))
    assert said == [wanted]


@pytest.mark.parametrize("mode", ["clamp", "abs"])
def test_tetrahedra_written_in_positions_are_projected_in_nine(mode: str) -> None:
    said, module = projected(soft_tets(mode))
    assert said == [f"9x9 of 12x12: {CUT}"]
    (projection,) = [op for op in module.walk() if op.name == "mat.project_psd"]
    assert str(projection.result.type) == "tensor<9x9xf64>"
    assert projection.mode.data == mode


def test_switched_off() -> None:
    said, module = projected(soft_tets("none"))
    assert said == ["nowhere: switched off"]
    assert "mat.project_psd" not in str(module)


def _definite(matrix: NDArray[np.float64], mode: str) -> NDArray[np.float64]:
    values, vectors = np.linalg.eigh(matrix)
    kept = np.abs(values) if mode == "abs" else np.maximum(values, 0)
    return np.asarray((vectors * kept) @ vectors.T)


@pytest.mark.parametrize("mode", ["clamp", "abs"])
@pytest.mark.parametrize("name", ["point-point", "products of inputs", "one coordinate", "a linear part beside"])
def test_the_projected_hessian_is_the_projection_at_the_cut(name: str, mode: str) -> None:
    """By hand: L^T P(S) L with S from the plain Hessian through the pseudo-inverse of a known L."""
    arity, energy, _ = WIDTHS[name]
    differences = np.hstack([-np.eye(3), np.eye(3)])
    linear = {
        "point-point": differences,
        "a linear part beside": differences,
        "products of inputs": np.eye(6),
        "one coordinate": np.tile([0.0, 0.0, 1.0], 3)[None],
    }[name]
    _, module = projected(slots(arity, energy, mode))
    _, plain = projected(slots(arity, energy, "none"))
    data = emit(slots(arity, energy)).data
    found, whole = Interpreter(module, data), Interpreter(plain, data)
    _, hessians = found.local_derivative(found.scene.derivatives[0])
    _, full = whole.local_derivative(whole.scene.derivatives[0])
    assert hessians is not None
    assert full is not None
    inverse = np.linalg.pinv(linear)
    for got, h in zip(hessians, full, strict=True):
        wanted = linear.T @ _definite(inverse.T @ h @ inverse, mode) @ linear
        assert relative_error(got, wanted) < 1e-12


def test_a_definite_hessian_is_left_alone() -> None:
    energy = WIDTHS["point-triangle by differences"][1]
    _, clamped = projected(slots(4, energy, "clamp"))
    _, plain = projected(slots(4, energy, "none"))
    data = emit(slots(4, energy)).data
    found, wanted = dense_assembly(clamped, data)[1], dense_assembly(plain, data)[1]
    assert np.linalg.eigvalsh(wanted)[0] > -1e-12
    assert relative_error(found, wanted) < 1e-13


def test_the_gradient_is_not_touched() -> None:
    _, clamped = projected(soft_tets("clamp"))
    _, plain = projected(soft_tets("none"))
    data = emit(soft_tets()).data
    assert np.array_equal(dense_assembly(clamped, data)[0], dense_assembly(plain, data)[0])


def test_each_energy_has_its_own_mode() -> None:
    scene = soft_tets("abs")
    tets = scene.m.t
    again = scene.m.add_primitive("t2", 3)
    corners = again.add_connectivity("corners", scene.m.v, tets.connectivities["corners"].indices, 4)
    energy = stable_neo_hookean(again, corners, scene.m.v["x"], scene.m.v["rest"])
    scene.add_energy(again.add_attribute("elastic", computed_attribute=energy), projection="none")
    said, _ = projected(scene)
    assert said == [f"9x9 of 12x12: {CUT}", "nowhere: switched off"]
