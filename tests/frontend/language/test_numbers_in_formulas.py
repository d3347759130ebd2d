"""A scene that differs in numbers only compiles nothing, and its results are those of its own numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from small_scenes import emit

from yasps import Scene, as_attribute, contact, select
from yasps.backend.reference.interpreter import Interpreter
from yasps.backend.reference.scene_data import load_scene_data
from yasps.frontend.commands.yasps_opt import interpreted
from yasps.frontend.execution.compiled_scene import CompiledScene
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.passes.pipeline import run_pipeline


def model(stiffness: float, length: float, floor: float, *, projection: str = "clamp") -> Scene:
    """Springs of two kinds, a soft floor, a barrier, points on a computed attribute: numbers wherever they can be."""
    scene = Scene("model")
    mesh, count = scene.add_mesh("m"), 3
    points = mesh.add_primitive("points", count)
    start = np.random.default_rng(3).uniform(0.5, 1.5, (count, 3))
    x = points.add_attribute("x", 3, 1, value=start)
    shown = points.add_attribute("shown", computed_attribute=(x / length).sin() + stiffness * x)
    mass = points.add_constant("mass", 1, 1, value=np.linspace(1, 2, count))
    below = select(x[2] < floor, stiffness * (x[2] - floor) ** 2, 0.0 * x[2])
    scene.add_energy(points.add_attribute("floor", computed_attribute=below + 9.8 * mass * x[2]), projection=projection)
    springs = mesh.add_primitive("springs", count - 1)
    ends = springs.add_connectivity("ends", points, [[k, k + 1] for k in range(count - 1)], 2)
    p = springs.add_attribute("p", through=ends, source=x)
    d = p.row(0) - p.row(1)
    stretch = 0.5 * stiffness * (d.norm() - length) ** 2 + contact.barrier(
        d.dot(d), as_attribute(length * 9), as_attribute(stiffness / 7)
    )
    scene.add_energy(springs.add_attribute("stretch", computed_attribute=stretch), projection=projection)
    y = springs.add_attribute("y", through=ends, source=shown)
    apart = y.row(0) - y.row(1)
    curved = springs.add_attribute("curved", computed_attribute=0.1 * stiffness * apart.dot(apart) ** 1.5)
    scene.add_energy(curved, projection=projection)
    scene.add_minimize_target(x)
    return scene


def check(scene: Scene, exact: Scene) -> None:
    """Values and derivatives against the interpreter on the frontend's IR, which still has the numbers in it."""
    emitted = emit(scene)
    before = Interpreter(emitted.module.clone(), emitted.data)
    np.testing.assert_allclose(scene.total_energy(), before.total_energy(), rtol=1e-12)
    emitted = emit(exact)
    run_pipeline(emitted.module)
    gradient, hessian = Interpreter(emitted.module, emitted.data).assemble()
    np.testing.assert_allclose(np.concatenate(scene.gradient()), gradient, rtol=1e-11, atol=1e-11 * abs(gradient).max())
    found = scene.hessian(projected=False).to_scipy().toarray()
    np.testing.assert_allclose(found, hessian.toarray(), atol=1e-11 * abs(hessian).max())


def sources(compiled: CompiledScene) -> dict[str, str]:
    return {name: code.text for name, code in compiled.code.codes.items()}


@pytest.mark.slow
def test_other_numbers_compile_nothing_and_count() -> None:
    first, second = model(7.3, 0.7, 0.9), model(1234.5, 0.31, 1.1)
    check(first, model(7.3, 0.7, 0.9, projection="none"))
    mixed = first.mixed_hessian(first.m.points["x"], first.m.points["mass"]).toarray()
    shown = first.m.points["shown"].value
    assert second.compile().report.compiled == 0
    assert sources(first.compile()) == sources(second.compile())
    check(second, model(1234.5, 0.31, 1.1, projection="none"))
    np.testing.assert_array_equal(second.mixed_hessian(second.m.points["x"], second.m.points["mass"]).toarray(), mixed)
    x = second.m.points["x"].value
    np.testing.assert_allclose(second.m.points["shown"].value, np.sin(x / 0.31) + 1234.5 * x, rtol=1e-14)
    assert all(compiled.report.compiled == 0 for compiled in second._alive)
    assert not np.allclose(second.m.points["shown"].value, shown)


def test_structural_values_are_right_too() -> None:
    numbers = (0.5, 1.0, 2.0)
    scene, emitted = model(*numbers), emit(model(*numbers, projection="none"))
    np.testing.assert_allclose(
        scene.total_energy(), Interpreter(emitted.module.clone(), emitted.data).total_energy(), rtol=1e-12
    )
    gradient, _ = Interpreter(run_pipeline(emitted.module), emitted.data).assemble()
    np.testing.assert_allclose(np.concatenate(scene.gradient()), gradient, rtol=1e-11, atol=1e-11 * abs(gradient).max())


@pytest.mark.slow
def test_a_dump_knows_its_numbers_with_and_without_data(tmp_path: Path) -> None:
    scene = model(7.3, 0.7, 0.9)
    scene.dump_ir(tmp_path)
    data = load_scene_data(tmp_path / "data.npz")
    assert 9.8 in data.storages["m.points.floor.numbers"]
    emitted = emit(scene)
    module = run_pipeline(emitted.module)
    assert interpreted(module, data) == interpreted(module, emitted.data)
    assert not any(name.endswith(".numbers") for name in emitted.data.storages)


def test_the_exact_hessian_compiles_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """It once compiled the projected scene first, for nothing."""
    built: list[list[str]] = []
    build: Callable[..., object] = CpuScene.__init__

    def noted(self: CpuScene, request: object, *args: object, **kwargs: object) -> None:
        built.append([term.projection for term in request.energies])  # type: ignore[attr-defined]
        build(self, request, *args, **kwargs)

    monkeypatch.setattr(CpuScene, "__init__", noted)
    scene = model(7.3, 0.7, 0.9)
    exact = scene.hessian(projected=False)
    assert built == [["none"] * 3]
    scene.hessian()
    scene.hessian(projected=False)
    assert built == [["none"] * 3, ["clamp"] * 3]
    unprojected = model(7.3, 0.7, 0.9, projection="none")
    np.testing.assert_array_equal(unprojected.hessian(projected=False).to_scipy().toarray(), exact.to_scipy().toarray())
    assert len(built) == 3
