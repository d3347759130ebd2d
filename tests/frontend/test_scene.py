"""Scenes: independence, threads, energies and targets, solutions, dumps."""

from __future__ import annotations

import gc
import weakref
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from xdsl.parser import Parser

from yasps import Attribute, Mesh, NameTakenError, Primitive, Scene, SceneError, add_scene
from yasps.passes.ir_text import text_of
from yasps.passes.pipeline import PIPELINE, make_context

Floats = NDArray[np.float64]
GOAL = np.array([1.0, -2.0, 3.0])


def springs(name: str, seed: int) -> tuple[Scene, Attribute, Floats]:
    """Points pulled to GOAL with random weights, chained by springs; with the dense solution x of H x = g."""
    rng = np.random.default_rng(seed)
    start, weights = rng.standard_normal((6, 3)), rng.uniform(1, 2, 6)
    s = Scene(name)
    points = s.add_mesh("m").add_primitive("points", 6)
    x = points.add_attribute("x", 3, 1, value=start)
    weight = points.add_constant("weight", 1, 1, value=weights)
    edges = s.m.add_primitive("edges", 5)
    ends = edges.add_connectivity("ends", points, [[k, k + 1] for k in range(5)], 2)
    both = edges.add_attribute("x", through=ends, source=x)
    apart, away = both.row(0) - both.row(1), x - GOAL
    s.add_energy(edges.add_attribute("spring", computed_attribute=0.5 * apart.dot(apart)))
    s.add_energy(points.add_attribute("pull", computed_attribute=0.5 * weight * away.dot(away)))
    s.add_minimize_target(x)
    chain = np.zeros((6, 6))
    for k in range(5):
        chain[k : k + 2, k : k + 2] += [[1, -1], [-1, 1]]
    gradient = chain @ start + weights[:, None] * (start - GOAL)
    return s, x, np.linalg.solve(chain + np.diag(weights), gradient)


def test_scenes_of_one_name_are_independent() -> None:
    first, x1, expected1 = springs("same", 1)
    second, x2, expected2 = springs("same", 2)
    for _ in range(2):
        np.testing.assert_allclose(first.minimize_energy(1e-26)[0], expected1.reshape(-1), rtol=1e-10)
        np.testing.assert_allclose(second.minimize_energy(1e-26)[0], expected2.reshape(-1), rtol=1e-10)
    second_energy = second.total_energy()
    x1.update_value(np.zeros((6, 3)))
    assert second.total_energy() == second_energy
    assert first.total_energy() != second_energy
    first.add_mesh("more")
    assert not hasattr(second, "more")
    assert x1.owner is not x2.owner


def test_scenes_work_side_by_side_in_threads() -> None:
    def solve(seed: int) -> float:
        s, _, expected = springs("same", seed % 3)
        error = 0.0
        for _ in range(3):
            error = max(error, float(abs(s.minimize_energy(1e-26)[0] - expected.reshape(-1)).max()))
        return error

    thresholds = gc.get_threshold()
    with ThreadPoolExecutor(4) as pool:
        assert max(pool.map(solve, range(8))) < 1e-10
    assert gc.get_threshold() == thresholds


def test_one_step_of_a_quadratic_energy_reaches_its_minimum() -> None:
    s, x, _ = springs("s", 3)
    before = s.total_energy()
    x.update_value(x.value - s.minimize_energy(tolerance=1e-26)[0])
    assert s.total_energy() < 1e-20 < before
    np.testing.assert_allclose(np.tile(GOAL, 6), x.value, rtol=1e-10)
    np.testing.assert_allclose(s.gradient()[0], 0, atol=1e-10)


def test_energy_values_are_by_path_and_instance() -> None:
    s, x, _ = springs("s", 4)
    values = s.energy_values()
    assert {name: value.shape for name, value in values.items()} == {"m.edges.spring": (5,), "m.points.pull": (6,)}
    start = x.value.reshape(6, 3)
    np.testing.assert_allclose(values["m.edges.spring"], 0.5 * (np.diff(start, axis=0) ** 2).sum(axis=1), rtol=1e-13)
    assert s.total_energy() == pytest.approx(sum(v.sum() for v in values.values()), rel=1e-14)
    assert s.energies == (s.m.edges["spring"], s.m.points["pull"])


def test_energies_without_a_name_are_all_listed() -> None:
    s = Scene("s")
    points = s.add_mesh("m").add_primitive("points", 2)
    x = points.add_attribute("x", 1, 1, value=[1.0, 2.0])
    for factor in (1.0, 2.0, 3.0):
        s.add_energy(factor * x * x)
    # a name of the user's can't be one that is given to an expression
    s.add_energy(points.add_attribute("unnamed-1", computed_attribute=4.0 * x * x))
    assert sorted(values.tolist() for values in s.energy_values().values()) == [[1, 4], [2, 8], [3, 12], [4, 16]]
    assert s.total_energy() == 50.0


def test_energies_need_no_target_for_their_values() -> None:
    s = Scene("s")
    x = s.add_attribute("x", 2, 1, value=[3.0, 4.0])
    s.add_energy(x.dot(x))
    assert s.total_energy() == 25.0
    s.add_minimize_target(x)
    np.testing.assert_allclose(s.gradient()[0], [6.0, 8.0])


def test_variables_of_scene_mesh_and_primitive_are_targets_together() -> None:
    s = Scene("s")
    mesh = s.add_mesh("m")
    points = mesh.add_primitive("points", 4)
    a = s.add_attribute("a", 1, 1, value=2.0)
    b = mesh.add_attribute("b", 3, 1, value=[1.0, 0.0, -1.0])
    x = points.add_attribute("x", 3, 1, value=np.arange(12) / 10)
    away = x - a * b
    s.add_energy(away.dot(away))
    s.add_energy(b.dot(b))
    s.add_energy(a * a)
    s.add_minimize_target([b, x])
    s.add_minimize_target(a)
    A, B, X = 2.0, b.value, x.value.reshape(4, 3)
    R = X - A * B
    db, dx, da = 2 * B - 2 * A * R.sum(axis=0), 2 * R, 2 * A - 2 * (R @ B).sum()
    solution = s.solve(tolerance=1e-20)
    for found, expected in zip(solution.gradient, (db, dx.reshape(-1), [da]), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert [part.shape for part in solution.directions] == [(3,), (12,), (1,)]
    assert solution.report.converged
    compiled = s.compile()
    H = (compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()).toarray()
    np.testing.assert_allclose(H @ np.concatenate(solution.directions), np.concatenate(solution.gradient), rtol=1e-8)


@pytest.mark.parametrize(("projection", "curvature"), [("clamp", 2.0), ("abs", 8.0), ("none", -4.0)])
def test_projection_is_done_to_each_instance(projection: str, curvature: float) -> None:
    s = Scene("s")
    x = s.add_mesh("m").add_primitive("points", 3).add_attribute("x", 1, 1, value=[1.0, 2.0, 3.0])
    s.add_energy(-3.0 * x * x, projection=projection)  # second derivative -6: 0, 6 or -6
    s.add_energy(x * x)
    s.add_minimize_target(x)
    compiled = s.compile()
    compiled.assemble()
    np.testing.assert_allclose(compiled.static_matrix.to_scipy().toarray(), curvature * np.eye(3), atol=1e-14)
    np.testing.assert_allclose(s.gradient()[0], [-4.0, -8.0, -12.0])


def test_gradient_is_that_of_the_energy_whatever_the_projection() -> None:
    s, x, _ = springs("s", 5)
    gradient = s.gradient()[0]
    np.testing.assert_array_equal(s.solve().gradient[0], gradient)
    start, direction = x.value, np.random.default_rng(0).standard_normal(18)
    energies = []
    for sign in (-1, 1):
        x.update_value(start + sign * 1e-5 * direction)
        energies.append(s.total_energy())
    assert (energies[1] - energies[0]) / 2e-5 == pytest.approx(gradient @ direction, rel=1e-8)


def test_what_is_added_later_takes_part() -> None:
    s, x, _ = springs("s", 6)
    before = s.total_energy()
    compiled = s.compile()
    extra = s.m.points.add_attribute("extra", computed_attribute=x.dot(x))
    assert s.compile() is compiled
    s.add_energy(extra)
    assert s.total_energy() == pytest.approx(before + (x.value**2).sum(), rel=1e-14)
    assert s.compile() is not compiled


def test_a_compiled_scene_kept_by_the_user_follows_the_numbers() -> None:
    s, x, _ = springs("s", 7)
    kept = s.compile()
    s.add_mesh("later").add_primitive("p", 1)
    assert s.compile() is not kept
    edges: Primitive = s.m.edges
    edges.update(ends=[[0, 1]] * 5)
    start = x.value.reshape(6, 3)
    expected = 0.5 * 5 * ((start[0] - start[1]) ** 2).sum()
    assert kept.energies()["m.edges.spring"].sum() == pytest.approx(expected, rel=1e-13)
    assert kept.total_energy() == pytest.approx(s.total_energy(), rel=1e-14)


def test_compiled_scenes_are_freed_with_their_users() -> None:
    s, _, _ = springs("s", 8)
    kept = weakref.ref(s.compile())
    s.add_energy(s.m.points["x"].sum())
    gc.collect()
    assert kept() is None


def test_results_repeat_bit_for_bit() -> None:
    s, _, _ = springs("s", 9)
    np.testing.assert_array_equal(s.minimize_energy(1e-8)[0], s.minimize_energy(1e-8)[0])
    one_thread = Scene("t", threads=1)
    y = one_thread.add_attribute("y", 1, 1, value=2.0)
    one_thread.add_energy(y * y)
    one_thread.add_minimize_target(y)
    assert one_thread.runtime.threads == 1
    np.testing.assert_allclose(one_thread.minimize_energy()[0], [2.0])


def test_add_scene_makes_a_new_one_each_time() -> None:
    first, second = add_scene("s"), add_scene("s")
    assert isinstance(first, Scene)
    assert first is not second
    assert isinstance(first.add_mesh("m"), Mesh)
    assert first.path == ""
    assert first.label == "scene s"


# -- dumps ---------------------------------------------------------------------------------------------------

STAGES = [f"{k:02d}-{name}.mlir" for k, name in enumerate(["frontend", *(pass_.name for pass_ in PIPELINE)])]


def assert_dump(folder: Path) -> None:
    """Every stage is there and parses back to the same text; so are the generated sources."""
    assert sorted(path.name for path in folder.glob("*.mlir")) == STAGES
    for path in folder.glob("*.mlir"):
        text = path.read_text(encoding="utf-8")
        module = Parser(make_context(), text, str(path)).parse_module()
        module.verify()
        assert text_of(module) == text
    sources = list((folder / "generated").glob("*.cpp"))
    assert sources
    assert all("extern" in path.read_text(encoding="utf-8") for path in sources)


def test_dump_ir_writes_every_stage(tmp_path: Path) -> None:
    s, _, expected = springs("s", 10)
    s.dump_ir(tmp_path / "ir")
    assert_dump(tmp_path / "ir")
    frontend = (tmp_path / "ir" / STAGES[0]).read_text(encoding="utf-8")
    for name in ("m.points.x", "m.edges.ends", "m.points.pull"):
        assert name in frontend
    assert {path.stem for path in (tmp_path / "ir" / "generated").glob("*.cpp")} >= {"m.points.pull", "m.edges.spring"}
    np.testing.assert_allclose(s.minimize_energy(1e-26)[0], expected.reshape(-1), rtol=1e-10)


def test_environment_variable_dumps_every_compile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("YASPS_DUMP_IR", str(tmp_path))
    s, x, _ = springs("dumped", 11)
    assert list(tmp_path.iterdir()) == []
    s.total_energy()
    assert_dump(tmp_path / "dumped")
    (x * 2.0).compute()
    assert_dump(tmp_path / "dumped" / "compute-1")


def test_names_of_any_length_can_be_dumped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def named(ending: str) -> Scene:
        scene = Scene("s" * 300 + ending)
        x = scene.add_mesh("m" * 300).add_primitive("v" * 300, 2).add_attribute("x" * 300, 1, 1, value=[1.0, 2.0])
        assert x.owner is not None
        for end in "ab":  # which differ where the names of files end
            scene.add_energy(x.owner.add_attribute("e" * 300 + end, computed_attribute=x * x))
        scene.add_minimize_target(x)
        return scene

    named("1").dump_ir(tmp_path / "ir")
    assert_dump(tmp_path / "ir")
    monkeypatch.setenv("YASPS_DUMP_IR", str(tmp_path / "all"))
    for ending in "12":
        named(ending).total_energy()
    folders = list((tmp_path / "all").iterdir())
    assert len(folders) == 2, "each scene has its own"
    for folder in folders:
        assert_dump(folder)


@pytest.mark.parametrize("name", ["../x", "..", "a/b", "/etc/x", "a\0b", "", ".", "a b", "-x", "~"])
def test_no_name_is_a_path(name: str) -> None:
    with pytest.raises(NameTakenError):
        Scene(name)
    scene = Scene("s")
    with pytest.raises(NameTakenError):
        scene.add_mesh(name)
    mesh = scene.add_mesh("m")
    with pytest.raises(NameTakenError):
        mesh.add_primitive(name, 1)
    with pytest.raises(NameTakenError):
        mesh.add_attribute(name, 1, 1)


def test_what_can_be_no_folder_is_refused_before_anything_is_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    s, _, _ = springs("s", 10)
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(s, "compile", None)
    for folder in (tmp_path / "file", tmp_path / "file" / "ir", "a\0b", "x" * 300):
        with pytest.raises(SceneError, match="the IR can't be written to"):
            s.dump_ir(folder)


def test_compile_report_lists_modules() -> None:
    s, _, _ = springs("s", 12)
    report = s.compile_report
    names = [module.name for module in report.modules]
    assert "m.points.pull" in " ".join(names)
    assert "link" in names
    assert f"{report.compiled} modules compiled" in str(report)
    again, _, _ = springs("other-name", 12)
    assert again.compile_report.compiled == 0
