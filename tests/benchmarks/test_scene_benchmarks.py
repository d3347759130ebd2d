"""The benchmarks `index`, `scene`, `memory` and `compile`: small runs work, and what they compare is the same."""

from __future__ import annotations

import ctypes
import json
import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmarks import compile_times, indices, memory, scene_steps
from benchmarks.__main__ import BENCHMARKS, main
from benchmarks.compile_times import Strategy, empty_cache, environment, generated, one_file
from benchmarks.element_problem import box_of_tets, elements_scene
from benchmarks.indices import affine_case, chain_case, union_case
from benchmarks.measure import Row, Settings
from benchmarks.memory import Measurement
from yasps import Scene
from yasps.meshes import box, write_mesh
from yasps.runtime.build.toolchain import Source, find_compiler
from yasps.runtime.core.library import load_runtime


def by_case(rows: list[Row]) -> dict[str, float]:
    return {row.case: row.value for row in rows}


# -- index -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "make",
    [partial(chain_case, 1, 40), partial(chain_case, 3, 40), partial(union_case, 3, 40), partial(affine_case, 40)],
)
def test_indices_by_hand_are_those_of_yasps(make: partial[indices.Case]) -> None:
    case = make()
    indices.check(case)
    kappa = case.indices()
    pattern = indices.scipy_structure(kappa, case.compiled.static_matrix.size)
    unique, places = indices.numpy_structure(kappa, case.compiled.static_matrix.size)
    assert pattern.nnz == np.count_nonzero(unique >= 0)
    assert np.array_equal(unique[places], indices.block_keys(kappa, case.compiled.static_matrix.size))


def test_other_indices_are_an_error() -> None:
    case = chain_case(1, 40)
    wrong = indices.Case(case.name, case.compiled, lambda: case.indices() + 3)
    with pytest.raises(ValueError, match="join of 1: yasps' placement indices"):
        indices.check(wrong)


def test_tiny_run_of_index(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(indices, "DEPTHS", (2,))
    monkeypatch.setattr(indices, "MEMBERS", (2,))
    path = tmp_path / "rows.json"
    assert main(["index", "--size", "40", "--repeats", "1", "--threads", "2", "--json", str(path)]) == 0
    rows = json.loads(path.read_text())
    assert len(rows) == 3 * 8
    assert all(0 < row["value"] < np.inf for row in rows)
    assert {row["implementation"] for row in rows} == {"yasps", "NumPy", "SciPy"}


# -- scene -------------------------------------------------------------------------------------------------


def test_steps_of_a_mesh_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_steps, "FREE_FLIGHT", 1)
    mesh = tmp_path / "box.vtu"
    write_mesh(mesh, box(divisions=(2, 2, 2)))
    report = scene_steps.run(Settings(1, 1, 1, mesh))
    rows = by_case(report.rows)
    assert "27 vertices and 48 tets each, 3 frames" in report.notes[0]
    assert rows["Newton iterations"] >= 1
    assert rows["longest frame"] >= rows["frame"] > 0
    shares = [value for case, value in rows.items() if case.startswith("share: ")]
    assert sum(shares) == pytest.approx(100)
    stages = sum(value for case, value in rows.items() if case.startswith("stage: "))
    assert stages == pytest.approx(1e3 * rows["frame"], rel=0.2)
    assert rows["height of the stiff body"] > rows["height of the soft body"] > 0


# -- memory ------------------------------------------------------------------------------------------------


def test_memory_of_a_kind_is_what_remains_of_the_slope() -> None:
    small = Measurement(10, 100, 1000, 500, 2000, 3000, 4000)
    large = Measurement(110, 1100, 3000, 700, 4000, 6000, 9000)
    rows = by_case(memory.slopes("tet", 1, small, large))
    assert rows["tet: indices"] == 10
    assert rows["tet: matrix"] == 20
    assert rows["tet: vectors"] == 2
    assert rows["tet: peak with assembly"] == 30
    assert rows["tet: extra"] == 50 - 10 - 20 - 2


@pytest.mark.skipif(not memory.CLEAR_PEAK.exists(), reason="the peak memory of a process cannot be reset here")
def test_a_measurement_counts_what_there_is() -> None:
    found = memory.measure_apart("tet", 6 * 10**3, 1)
    assert found.count == 6 * 10**3
    assert found.indices == found.count * (4 * 4 + 10 * 8)
    assert found.matrix > 0
    assert found.structure_peak <= found.assembly_peak <= found.solver_peak
    # All indices and the matrix are there at the peak, but for what was free memory of the process before.
    assert found.solver_peak > 0.5 * (found.indices + found.matrix)


def test_a_process_that_fails_is_told() -> None:
    with pytest.raises(memory.UnsupportedSystemError, match="KeyError: 'brick'"):
        memory.measure_apart("brick", 8, 1)


# -- compile -----------------------------------------------------------------------------------------------


def tiny_scene() -> Scene:
    return elements_scene(box_of_tets(6), 1).scene


def test_the_cache_is_a_new_one_inside_and_the_old_one_after(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("YASPS_CACHE", "/nowhere")
    with empty_cache():
        assert os.listdir(os.environ["YASPS_CACHE"]) == []
    assert os.environ["YASPS_CACHE"] == "/nowhere"
    with environment("YASPS_CACHE", None):
        assert "YASPS_CACHE" not in os.environ
    assert os.environ["YASPS_CACHE"] == "/nowhere"


def test_one_file_holds_every_object_in_a_namespace() -> None:
    text = one_file([Source("a", "#include <cmath>\nint a;\n"), Source("b", "#include <cmath>\nint a;\n")]).text
    assert text.count("#include <cmath>") == 1
    assert text.index("#include") < text.index("namespace object_0 {\nint a;\n}") < text.index("namespace object_1 {")


def test_all_ways_to_compile_give_the_same_gradient() -> None:
    compiler = find_compiler()
    runtime = load_runtime(compiler, 1)
    strategies = [
        Strategy("modular", compile_times._optimized(compiler, "-O1"), 2),
        Strategy("one file", compile_times._optimized(compiler, "-O1"), 1, in_one_file=True),
    ]
    assert "-O1" in strategies[0].compiler.flags
    assert "-O2" not in strategies[0].compiler.flags
    rows = by_case(compile_times._rows_of("tiny", tiny_scene, runtime, strategies, 1))
    for name in ("tiny: modular", "tiny: one file"):
        assert rows[name] > 0
        assert rows[f"{name}: run"] > 0


def test_another_librarys_numbers_are_an_error() -> None:
    made = elements_scene(box_of_tets(6), 1)
    made.position.update_value(1.1 * box_of_tets(6).vertices)
    compiled = compile_times._compiled(made.scene, load_runtime(find_compiler(), 1))
    nothing = ctypes.CFUNCTYPE(ctypes.c_long, *[ctypes.c_void_p] * 4)(lambda *arguments: -1)

    class DoesNothing:
        """Has every function."""

        def __getattr__(self, name: str) -> object:
            return nothing

    with pytest.raises(ValueError, match="another gradient"):
        compile_times._exchange(compiled, DoesNothing())  # type: ignore[arg-type]


def test_every_scene_is_compiled_in_every_way() -> None:
    compiler = find_compiler()
    strategies, about = compile_times.strategies_for(compiler, 2)
    assert [s.in_one_file for s in strategies[:3]] == [False, False, True]
    assert [s.jobs for s in strategies[:3]] == [2, 1, 1]
    assert "clang" in about
    sources = generated(compile_times.four_energies(8), compiler)
    assert sum("_derive(" in source.text for source in sources) == 4
    assert len({source.text for source in sources}) == len(sources)


def test_all_benchmarks_of_the_issue_are_listed() -> None:
    assert {"elements", "cloth", "contacts", "index", "scene", "memory", "compile", "opcounts"} <= set(BENCHMARKS)
