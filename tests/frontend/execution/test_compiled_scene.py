"""Machine code bound to numbers: two scenes on one code, agreement with the interpreter, what is found again when."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from yasps import NotFiniteError, Scene
from yasps.backend.reference.interpreter import Interpreter
from yasps.frontend.execution.cpu_scene import CpuScene

Floats = NDArray[np.float64]


def build(name: str, seed: int) -> Scene:
    """Points with a nonlinear energy each, on static pairs and on dynamic triples."""
    rng = np.random.default_rng(seed)
    s = Scene(name)
    mesh = s.add_mesh("m")
    points = mesh.add_primitive("points", 6)
    x = points.add_attribute("x", 2, 1, value=rng.standard_normal((6, 2)))
    scale = mesh.add_attribute("scale", 1, 1, value=rng.uniform(1, 2))
    pairs = mesh.add_primitive("pairs", 4)
    ends = pairs.add_connectivity("ends", points, rng.integers(0, 6, (4, 2)), 2)
    triples = mesh.add_primitive("triples", 0, is_dynamic=True)
    corners = triples.add_connectivity("corners", points, rng.integers(0, 6, (3, 3)), 3)
    e = pairs.add_attribute("x", through=ends, source=x)
    t = triples.add_attribute("x", through=corners, source=x)
    length = (e.row(0) - e.row(1)).dot(e.row(0) - e.row(1)) + 1.0
    area = (t[1, 0] - t[0, 0]) * (t[2, 1] - t[0, 1]) - (t[1, 1] - t[0, 1]) * (t[2, 0] - t[0, 0])
    s.add_energy(pairs.add_attribute("spring", computed_attribute=scale * length.log()))
    s.add_energy(triples.add_attribute("area", computed_attribute=scale * (area - 0.5) ** 2))
    s.add_energy(points.add_attribute("anchor", computed_attribute=(x.dot(x) + scale * scale) ** 1.5))
    s.add_minimize_target([x, scale])
    return s


def system(compiled: CpuScene, *, project: bool) -> tuple[Floats, Floats]:
    """Gradient and Hessian, dense."""
    gradient = compiled.assemble(project=project)
    return gradient, (compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()).toarray()


def test_two_scenes_share_code_and_keep_their_numbers() -> None:
    first, second = build("first", 1).compile(), build("second", 2).compile()
    before = system(first, project=True)
    other = system(second, project=True)
    assert second.report.compiled == 0
    assert abs(before[0] - other[0]).max() > 0.1
    again = system(first, project=True)
    np.testing.assert_array_equal(again[0], before[0])
    np.testing.assert_array_equal(again[1], before[1])


@pytest.mark.parametrize("seed", [3, 4])
def test_kernels_agree_with_the_interpreter(seed: int) -> None:
    scene = build("s", seed)
    compiled = scene.compile()
    interpreter = Interpreter(compiled.module, compiled.data())
    assert compiled.total_energy() == pytest.approx(interpreter.total_energy(), rel=1e-13)
    gradient, _ = system(compiled, project=True)
    H = (compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()).toarray()
    expected_gradient, expected_H = interpreter.assemble()
    np.testing.assert_allclose(gradient, expected_gradient, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(H, expected_H.toarray(), rtol=1e-10, atol=1e-11)
    assert np.linalg.eigvalsh(H).min() > -1e-11


def test_gradients_of_all_energies_and_of_some() -> None:
    compiled = build("s", 5).compile()
    gradients = compiled.gradients()
    assert list(gradients) == ["m.pairs.spring", "m.triples.area", "m.points.anchor"]
    whole = compiled.assemble(hessian=False)
    np.testing.assert_allclose(sum(gradients.values()), whole, rtol=0, atol=1e-12 * abs(whole).max())
    some = compiled.gradients(["m.points.anchor", "m.pairs.spring"])
    assert list(some) == ["m.pairs.spring", "m.points.anchor"]
    np.testing.assert_array_equal(some["m.points.anchor"], gradients["m.points.anchor"])


def test_hessian_is_the_difference_of_gradients() -> None:
    scene = build("s", 5)
    compiled = scene.compile()
    gradient, H = system(compiled, project=False)
    targets = scene.minimize_targets
    start = [target.value for target in targets]
    direction = np.random.default_rng(0).standard_normal(len(gradient))
    sides = []
    for sign in (-1, 1):
        for target, value, part in zip(targets, start, compiled.split(direction), strict=True):
            target.update_value(value + sign * 1e-5 * part)
        sides.append(compiled.assemble(hessian=False))
    np.testing.assert_allclose((sides[1] - sides[0]) / 2e-5, H @ direction, rtol=1e-6, atol=1e-6)


def test_structure_is_found_again_only_where_it_changed() -> None:
    scene = build("s", 6)
    compiled = scene.compile()
    compiled.assemble()
    assert (compiled._static_valid, compiled._dynamic_valid) == (True, True)
    scene.m.points["x"].update_value(np.zeros(12))
    assert (compiled._static_valid, compiled._dynamic_valid) == (True, True)
    scene.m.triples.update(corners=[[0, 1, 2]])
    assert (compiled._static_valid, compiled._dynamic_valid) == (True, False)
    compiled.assemble()
    scene.m.pairs.ends.update_value([[0, 1]] * 4)
    assert not compiled._static_valid
    compiled.assemble()
    assert (compiled._static_valid, compiled._dynamic_valid) == (True, True)


def test_static_and_dynamic_parts_are_apart() -> None:
    scene = build("s", 7)
    compiled = scene.compile()
    _, both = system(compiled, project=True)
    static = compiled.static_matrix.to_scipy().toarray()
    scene.m.triples.update(corners=[])
    _, without = system(compiled, project=True)
    np.testing.assert_array_equal(without, static)
    assert abs(both - static).max() > 0.1


def test_split_follows_the_targets() -> None:
    compiled = build("s", 8).compile()
    parts = compiled.split(np.arange(13.0))
    assert [part.tolist() for part in parts] == [list(range(12)), [12.0]]
    assert compiled.place_of(0) == "m.points.x, instance 0"
    assert compiled.place_of(11) == "m.points.x, instance 5"
    assert compiled.place_of(12) == "m.scale, instance 0"
    with pytest.raises(IndexError):
        compiled.place_of(13)


def test_energies_are_listed_in_the_order_they_were_added() -> None:
    compiled = build("s", 9).compile()
    assert list(compiled.energies()) == ["m.pairs.spring", "m.triples.area", "m.points.anchor"]


def test_a_failed_assembly_leaves_the_scene_usable() -> None:
    scene = build("s", 10)
    x = scene.m.points["x"]
    good = x.value
    before = scene.minimize_energy(1e-12)
    x.update_value(np.full(12, 1e200))
    with pytest.raises(NotFiniteError, match=r"not finite \(inf\) on instance 0"):
        scene.minimize_energy()
    x.update_value(good)
    for again, part in zip(scene.minimize_energy(1e-12), before, strict=True):
        np.testing.assert_array_equal(again, part)
