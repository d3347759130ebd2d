"""The paper's evaluation as benchmarks: numbers are the paper's, ours are made of what they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import paper_scenes, replicated, scale
from benchmarks.__main__ import main
from benchmarks.measure import Row, Settings
from benchmarks.memory import CLEAR_PEAK
from benchmarks.paper_compile import monolithic
from benchmarks.paper_products import copies, plain_formats
from benchmarks.paper_projection import expanded, in_gradient
from benchmarks.paper_tables import TABLE_1, TABLE_2, TABLE_3, TABLE_6, memory_growth, memory_of_pairs
from benchmarks.scene_runs import COLLISION, DIFFERENTIATION, REST, SOLVER, SceneRun, run_apart, run_here
from benchmarks.spmv import check_product, make_case
from yasps.meshes import box
from yasps.runtime.build.toolchain import Source, find_compiler
from yasps.runtime.core.library import load_runtime

NEEDS_PEAK = pytest.mark.skipif(not CLEAR_PEAK.exists(), reason="the peak memory of a process cannot be reset here")


def values(rows: list[Row]) -> dict[tuple[str, str], float]:
    return {(row.case, row.implementation): row.value for row in rows}


# -- what the paper published ------------------------------------------------------------------------------


def test_table_1_has_the_averages_that_the_paper_has_beside_it() -> None:
    differentiation = [13.53, 11.06, 8.81, 15.83, 12.89, 14.80, 18.99, 15.21, 11.12, 124.89]
    solver = [0.075, 0.075, 0.97, 0.083, 0.083, 1.31, 0.092, 0.092, 0.67, 0.91]
    assert [1e3 * row.differentiation / row.newton for row in TABLE_1] == pytest.approx(differentiation, abs=6e-3)
    assert [1e3 * row.solver / row.cg for row in TABLE_1] == pytest.approx(solver, abs=6e-3)


def test_table_6_has_them_too() -> None:
    assert [1e3 * row.differentiation / row.newton for row in TABLE_6.values()] == pytest.approx(
        [59.04, 87.66], abs=6e-3
    )
    assert [1e3 * row.solver / row.cg for row in TABLE_6.values()] == pytest.approx([0.075, 0.075], abs=6e-4)


def test_tables_2_and_3_grow_as_they_should() -> None:
    assert [round(row.vertices**0.5) for row in TABLE_2] == [100 * k for k in range(1, 11)]
    assert all(row.most_memory > row.least_memory for row in TABLE_2)
    for number in range(5):
        soft, mixed, apart = TABLE_3[3 * number : 3 * number + 3]
        assert [row.soft + row.affine for row in (soft, mixed, apart)] == [6 + number] * 3
        assert mixed.stack > apart.stack > soft.stack


def test_memory_is_counted_by_the_papers_equations() -> None:
    assert memory_growth([10_000, 40_000, 50_000], [100.0, 130.0, 135.0]) == pytest.approx([10.0, 5.0])
    found = memory_of_pairs([100.0, 130.0], [120.0, 130.0], [200_000, 0])
    assert found[0] == pytest.approx(10.0)
    assert np.isnan(found[1])


# -- whole scenes ------------------------------------------------------------------------------------------


@pytest.fixture
def invented(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int, list[str]]]:
    """No scene runs; the calls. Everything grows with the number of calls."""
    calls: list[tuple[str, int, list[str]]] = []

    def run(scene: str, frames: int, flags: list[str], *, cold: bool = False) -> SceneRun:
        calls.append((scene, frames, flags))
        k = len(calls)
        seconds = {DIFFERENTIATION: 4.0 * k, SOLVER: 2.0 * k, COLLISION: 1.0 * k, REST: 1.0 * k}
        pairs = dict.fromkeys(("point-point", "point-edge", "point-triangle", "edge-edge"), 10 * k)
        memory = 1_000_000 * k
        return SceneRun(1000 * k, frames, 10 * k, 100 * k, seconds, pairs, 40 * k, memory, 3 * memory, 9.0, 50 + cold)

    monkeypatch.setattr(paper_scenes, "run_apart", run)
    return calls


def test_table_1(invented: list[tuple[str, int, list[str]]]) -> None:
    report = paper_scenes.run_table_1(Settings(12, 2, 1, Path("bunny.msh")))
    mesh = ["--mesh", str(Path("bunny.msh").absolute())]
    assert invented[2] == ("cloths_on_bunny", 16, ["--size", "12", "--cloths", "3", "--threads", "1", *mesh])
    found = values(report.rows)
    assert found["2 upper cloths, 2,000 vertices: frame", "yasps"] == pytest.approx(1.0)
    assert found["2 upper cloths, 2,000 vertices: share of linear solver", "yasps"] == pytest.approx(25.0)
    assert found["2 upper cloths, 2,000 vertices: a CG iteration", "yasps"] == pytest.approx(20.0)
    assert found["39,595 vertices: Newton iterations", "the paper, YASPS"] == pytest.approx(19.67)
    assert found["39,595 vertices: CG iterations", "the paper, GIPC"] == pytest.approx(160_751 / 2_889)
    (plot,) = report.plots
    assert np.sum(list(plot.series.values()), axis=0) == pytest.approx([100.0] * 6)


def test_table_2(invented: list[tuple[str, int, list[str]]]) -> None:
    report = paper_scenes.run_table_2(Settings(100, 1, 1))
    assert [flags[1] for _, _, flags in invented] == ["100", "200", "400"]
    found = values(report.rows)
    assert found["2,000 vertices: for 10,000 vertices more", "yasps"] == pytest.approx(10.0)
    assert found["1,000 vertices: for 100,000 pairs", "yasps"] == pytest.approx(5000.0)
    assert found["1,000,000 vertices: for 100,000 pairs", "the paper"] == pytest.approx(33.5, abs=0.1)
    assert [plot.name for plot in report.plots] == ["figure_33"]


def test_table_3(invented: list[tuple[str, int, list[str]]]) -> None:
    report = paper_scenes.run_table_3(Settings(1500, 1, 1))
    assert [flags[1:4:2] for _, _, flags in invented] == [["1", "0"], ["2", "0"], ["4", "0"], ["4", "1"]]
    found = values(report.rows)
    assert found[f"{DIFFERENTIATION} of a Newton iteration, one affine over none", "yasps"] == pytest.approx(1.0)
    assert found["most memory, one affine over none", "yasps"] == pytest.approx(4 / 3)
    assert found["5 soft, 1 affine, Jacobian apart: most memory", "the paper"] == 5389.02


def test_table_6(invented: list[tuple[str, int, list[str]]]) -> None:
    report = paper_scenes.run_table_6(Settings(10, 1, 1))
    found = values(report.rows)
    assert found["hex8: generated files", "yasps"] == 51.0  # with an empty cache
    assert found["hex8: generated files", "the paper"] == 705.0
    assert [flags[3] for _, _, flags in invented] == ["tet4", "hex8"]


@NEEDS_PEAK
@pytest.mark.slow
def test_a_run_of_its_own_counts_what_happens() -> None:
    found = run_apart("mat_twist", 4, ["--size", "64", "--speed", "400", "--threads", "1"])
    assert (found.vertices, found.frames) == (64, 4)
    assert found.newton >= 4
    assert found.cg > found.newton
    assert set(found.seconds) == {DIFFERENTIATION, SOLVER, COLLISION, REST}
    assert min(found.seconds.values()) > 0
    assert found.most_memory >= found.least_memory > 0
    assert found.modules > 5


def test_a_run_has_frames() -> None:
    with pytest.raises(ValueError, match="a run has one frame or more, got 0"):
        run_here("mat_twist", 0, [])


# -- scale -------------------------------------------------------------------------------------------------


def test_sizes_grow_by_four_and_end_where_asked() -> None:
    assert scale.sizes_to(1_000_000) == [10_000, 40_000, 160_000, 640_000, 1_000_000]
    assert scale.sizes_to(40_000) == [10_000, 40_000]
    assert scale.sizes_to(300) == [300]


@NEEDS_PEAK
@pytest.mark.slow
def test_all_stages_are_timed_and_weighed() -> None:
    found = scale.measure_here("cloth", 64, 1, 1, 1)
    assert (found.vertices, found.elements) == (64, 98)
    stages = {scale.STRUCTURE, scale.ASSEMBLY, scale.PRODUCT, scale.ITERATION, scale.ENERGY, scale.STEP}
    assert set(found.seconds) == stages
    assert set(found.memory) == stages | {"scene"}
    assert min(found.seconds.values()) > 0
    rows = scale.rows_of(
        "cloth", 1, [found, scale.Sized(640, 980, {scale.ENERGY: 20 * found.seconds[scale.ENERGY]}, {})]
    )
    assert ("x", pytest.approx(2.0)) in [(row.unit, row.value) for row in rows]


# -- kernels -----------------------------------------------------------------------------------------------


def test_elements_of_figure_25_agree_with_sympy(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("sympy")
    problem = replicated.replicated("point_point", 11)
    found, theirs = problem.derivatives(), replicated.sympy_loop(problem, find_compiler())()
    assert found.shape == (11, 6 + 21)
    assert found == pytest.approx(theirs, rel=1e-9, abs=1e-9 * np.abs(found).max())


def test_the_cost_of_det_is_what_goes_with_it() -> None:
    rows = [
        Row(replicated.WITH_DET, "yasps", 1, 8.0, replicated.UNIT),
        Row(replicated.WITH_SUM, "yasps", 1, 6.0, replicated.UNIT),
    ]
    assert [(row.implementation, row.value) for row in replicated.det_rows(rows)] == [("yasps", pytest.approx(25.0))]


def test_expanded_hessians_have_the_same_negative_eigenvalues() -> None:
    random = np.random.default_rng(0)
    small = random.standard_normal((20, 3, 3))
    small += small.transpose(0, 2, 1)
    local = np.block([[small, -small], [-small, small]])
    negative = (np.linalg.eigvalsh(small) < -1e-9).sum(axis=1)
    for width in (3, 6, 15, 24):
        matrices = expanded(local, width)
        assert matrices.shape == (20, width, width)
        assert ((np.linalg.eigvalsh(matrices) < -1e-9).sum(axis=1) == negative).all()


@pytest.mark.parametrize("k", [2, 3])
def test_hessians_in_f_are_those_that_corners_have_their_from(k: int) -> None:
    random = np.random.default_rng(0)
    inverse, hessian = random.standard_normal((5, k, k)), random.standard_normal((5, 3 * k, 3 * k))
    jacobian = np.zeros((5, 3 * k, 3 * (k + 1)))
    for axis in range(3):
        for edge in range(k):
            jacobian[:, k * axis : k * axis + k, 3 * (edge + 1) + axis] = inverse[:, edge]
            jacobian[:, k * axis : k * axis + k, axis] -= inverse[:, edge]
    corners = jacobian.transpose(0, 2, 1) @ hessian @ jacobian
    assert in_gradient(corners, inverse) == pytest.approx(hessian, rel=1e-9)


def test_products_in_all_formats_agree() -> None:
    compiler = find_compiler()
    mesh = copies(box(divisions=(2, 2, 1)), 2)
    assert (len(mesh.vertices), len(mesh.tets)) == (36, 48)
    case = make_case(load_runtime(compiler, 1), mesh, permuted=True)
    formats = plain_formats(case, compiler)
    assert list(formats) == ["BCSR, half", "BCOO, half", "BCSR, full", "BCOO, full"]
    for name, made in formats.items():
        check_product(name, made.multiply(case.x), case)
    assert 2 * len(formats["BCOO, half"].columns) - 36 == len(formats["BCOO, full"].columns)


def test_monolithic_files_have_all_that_they_need() -> None:
    shared, value, energy, other = (f"yasps_0000000{k}" for k in range(4))
    sources = [
        Source(shared, "int a;\n"),
        Source(value, f"// {shared}_value\nint b;\n"),
        Source(energy, f"// {value}_pull\nint c;\n"),
        Source(other, f"// {shared}_value\nint d;\n"),
    ]
    files = {source.name: source.text for source in monolithic(sources)}
    assert set(files) == {f"monolithic.{energy}", f"monolithic.{other}"}
    assert all(f"int {name};" in files[f"monolithic.{energy}"] for name in "abc")
    assert "int d;" not in files[f"monolithic.{energy}"]
    assert "int a;" in files[f"monolithic.{other}"]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "size"),
    [
        *(("figure_23", 64), ("figure_24", 64), ("figure_27", 10), ("figure_28", 1), ("figure_30", 1500)),
        *(("scale", 100), ("table_1", 8), ("table_2", 64), ("table_3", 1500), ("table_6", 8)),
    ],
)
def test_tiny_runs(name: str, size: int, tmp_path: Path) -> None:
    options = ["--size", str(size), "--repeats", "1", "--threads", "1", "--plots", str(tmp_path)]
    assert main([name, *options]) == 0
    assert list(tmp_path.glob("*.png"))
