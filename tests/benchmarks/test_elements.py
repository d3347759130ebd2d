"""The benchmarks `elements` and `cloth`: their problems are what they say; tiny runs work with and without peers."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import cloth, elements
from benchmarks.__main__ import BENCHMARKS, main
from benchmarks.element_problem import box_of_tets, cloth_hinges, cloth_triangles, hinges_of, make_problem
from benchmarks.element_rows import PeersDisagreeError, check_close
from benchmarks.kernel_problem import bytes_per_element
from benchmarks.measure import Settings
from benchmarks.sympy_kernel import EigenNotFoundError, eigen_folder, sympy_tets
from yasps.meshes import box, cloth_grid, write_mesh
from yasps.runtime.build.toolchain import find_compiler

KEYS = {"case", "implementation", "threads", "value", "unit"}


def test_without_a_name_all_benchmarks_are_listed_one_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines == [f"{name}: {benchmark.description}" for name, benchmark in BENCHMARKS.items()]
    assert "elements" in BENCHMARKS


@pytest.mark.parametrize("arguments", [["nothing"], ["elements", "--size", "0"], ["elements", "--repeats", "many"]])
def test_wrong_arguments_are_refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert f"'{arguments[-1]}'" in capsys.readouterr().err


def test_a_missing_folder_for_the_json_file_is_told_before_anything_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["elements", "--json", str(tmp_path / "none" / "rows.json")]) == 2
    assert "there is no folder" in capsys.readouterr().err


def test_a_missing_mesh_is_told_before_anything_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["elements", "--mesh", str(tmp_path / "none.msh")]) == 2
    assert "there is no such file" in capsys.readouterr().err


def test_a_mesh_is_refused_where_none_is_used(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["projection", "--mesh", __file__]) == 2
    assert "these are: elements" in capsys.readouterr().err


def tiny_run(name: str, path: Path, *, threads: int = 2) -> list[dict[str, object]]:
    arguments = [name, "--size", "200", "--repeats", "1", "--threads", str(threads), "--json", str(path)]
    assert main(arguments) == 0
    rows: list[dict[str, object]] = json.loads(path.read_text())
    for row in rows:
        assert set(row) == KEYS
        assert isinstance(row["threads"], int)
        assert isinstance(row["value"], float)
        assert 0 < row["value"] < np.inf
    return rows


def without_peers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes their imports fail as if they were not there."""
    for package in ("jax", "torch", "sympy"):
        monkeypatch.setitem(sys.modules, package, None)


def test_tiny_run_without_peers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    without_peers(monkeypatch)
    rows = tiny_run("elements", tmp_path / "rows.json")
    said = " ".join(capsys.readouterr().out.split())
    assert "No rows for jax, which is not installed" in said
    assert "No rows for SymPy + Eigen" in said
    found = {(row["implementation"], row["threads"]) for row in rows if row["unit"] == "ns/element"}
    assert {("yasps", 1), ("yasps", 2)} <= found
    assert found <= {("yasps", 1), ("yasps", 2), *((binds, n) for binds in ("bytes", "arithmetic") for n in (1, 2))}
    assert {(row["implementation"], row["unit"]) for row in rows if row["unit"] != "ns/element"} == {
        ("copy", "GB/s"),
        ("8 lanes", "operations/ns"),
        ("bytes", "B/element"),
        ("count", "1/element"),
        ("yasps", "times"),
    }
    cases = [str(row["case"]) for row in rows if row["implementation"] == "yasps" and row["unit"] == "ns/element"]
    assert cases[:6] == ["structure", "structure", "gradient", "gradient", "derived, stored", "derived, assembled"]
    assert sum(case.startswith("projected (") for case in cases) == 3 * len(elements.SHARES)
    for row in rows:
        if row["unit"] == "times":
            case = str(row["case"]).removesuffix(": above floor")
            stored = "stored" in case
            times = next(r for r in rows if r["case"] == case and r["threads"] == row["threads"])
            floor = next(
                r
                for r in rows
                if r["case"] == ("stored, floor" if stored else "assembled, floor") and r["threads"] == row["threads"]
            )
            assert row["value"] == pytest.approx(float(str(times["value"])) / float(str(floor["value"])))


KINDS_OF_ELEMENT = {"elements": 1, "cloth": 2}
PEERS = {"jax": "JAX", "torch": "PyTorch"}


@pytest.mark.parametrize("package", PEERS)
@pytest.mark.parametrize("name", KINDS_OF_ELEMENT)
def test_tiny_run_with_a_peer_compares_numbers_and_adds_its_rows(
    name: str,
    package: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    kinds, peer = KINDS_OF_ELEMENT[name], PEERS[package]
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"{peer} is not installed")
    for other in PEERS:
        if other != package:
            monkeypatch.setitem(sys.modules, other, None)
    rows = tiny_run(name, tmp_path / "rows.json", threads=1)
    said = " ".join(capsys.readouterr().out.split())
    assert said.count("told to use one processor") == kinds
    assert f"{peer} {importlib.metadata.version(package)}" in said
    found = [str(row["case"]) for row in rows if row["implementation"] == peer]
    assert sum(case.endswith("derived, stored") for case in found) == kinds
    shares = len(elements.SHARES) if name == "elements" else len(cloth.NOISE)
    assert len(found) == kinds * (1 + shares)


def test_tiny_run_of_cloth_without_peers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without_peers(monkeypatch)
    rows = tiny_run("cloth", tmp_path / "rows.json", threads=1)
    for name in ("Baraff-Witkin", "hinge"):
        own = [row for row in rows if str(row["case"]).startswith(name)]
        assert sum(row["unit"] == "ns/element" and row["implementation"] == "yasps" for row in own) == 4 + 2 * len(
            cloth.NOISE
        )
        assert sum(row["unit"] == "times" for row in own) == 1 + len(cloth.NOISE)


def has_sympy_and_eigen() -> bool:
    try:
        eigen_folder()
    except EigenNotFoundError:
        return False
    return importlib.util.find_spec("sympy") is not None


@pytest.mark.skipif(not has_sympy_and_eigen(), reason="SymPy or Eigen is not installed")
def test_sympy_peer_agrees_with_projection_and_without() -> None:
    tets = box_of_tets(48)
    peer, ours = sympy_tets(tets, find_compiler()), make_problem(tets, 1)
    assert "JAX" not in elements._check_sympy(peer, ours)
    peer.blocks[:] = 0
    with pytest.raises(PeersDisagreeError):
        check_close("Hessian", "SymPy", np.ones(peer.gradient.size), peer.multiply(np.ones(peer.gradient.size)) + 2)


def test_different_numbers_are_an_error() -> None:
    ours = np.array([[1.0, 2.0]])
    check_close("gradient", "JAX", ours, ours * (1 + 1e-12))
    with pytest.raises(PeersDisagreeError, match=r"gradient of yasps and of JAX differ by 5\.0e-01 of"):
        check_close("gradient", "JAX", ours, np.array([[2.0, 2.0]]))


def test_mesh_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "box.vtu"
    mesh = box(divisions=(2, 2, 2))
    write_mesh(path, mesh)
    assert len(elements.tets_for(Settings(1, 1, 1, path))) == len(mesh.tets)
    assert len(elements.tets_for(Settings(300, 1, 1))) == 6 * 4**3


def test_hinges_are_the_inner_edges_with_both_triangles() -> None:
    triangles = cloth_grid(divisions=(3, 3)).triangles
    hinges = hinges_of(triangles)
    assert len(hinges) == 3 * 9 - 2 * 3  # all edges are 3 n^2 + 2 n with n = 3, the rim is 4 n
    have = {tuple(np.roll(triangle, k).tolist()) for triangle in triangles for k in range(3)}
    for a, b, left, right in hinges.tolist():
        assert (a, b, left) in have
        assert (b, a, right) in have


def test_cloth_at_rest_needs_no_projection_and_noisy_cloth_does() -> None:
    for made in (cloth_triangles(50), cloth_hinges(50)):
        problem = make_problem(made, 1)
        problem.deform(0.0)
        assert problem.projected_share() == 0
        problem.deform(0.2)
        assert problem.projected_share() > 0.5


def test_share_is_the_share_of_indefinite_hessians() -> None:
    problem = make_problem(box_of_tets(200), 1)
    amplitude = problem.amplitude_for(0.33)
    problem.deform(amplitude)
    share = problem.projected_share()
    assert 0.3 < share < 0.36
    # H = J^T H_F J with a J of full row rank: as many tets are indefinite in x as in F.
    alone = make_problem(problem.elements.exploded(), 1)
    alone.deform(amplitude)
    alone.compiled.assemble(project=False)
    dense = alone.compiled.static_matrix.to_scipy().toarray()
    blocks = np.stack([dense[k : k + 12, k : k + 12] for k in range(0, len(dense), 12)])
    assert np.count_nonzero(dense) == np.count_nonzero(blocks)
    values = np.linalg.eigvalsh(blocks)
    assert np.mean(values[:, 0] < -1e-10 * values[:, -1]) == share


def test_without_noise_nothing_needs_projection() -> None:
    problem = make_problem(box_of_tets(200), 1)
    problem.deform(problem.amplitude_for(0.0))
    assert problem.projected_share() == 0


def test_bytes_per_element_of_stored_tets() -> None:
    stored = make_problem(box_of_tets(48).exploded(), 1)
    inputs = 4 * 3 * 8 + 4 * 4 + 9 * 8 + 8  # corners, their indices, inverse rest edges, volume
    placement = 4 * 4 + 10 * 8
    results = 12 * 8 + 10 * 9 * 8
    common = 2 * 8 / len(stored.elements)  # mu and lambda
    assert bytes_per_element(stored.compiled) == pytest.approx(inputs + placement + results + common, rel=1e-12)
