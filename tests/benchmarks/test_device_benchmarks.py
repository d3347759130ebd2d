"""`python -m benchmarks NAME --device cuda`, with the host in the GPU's place: it runs, agrees, and counts bytes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cuda_on_host import HostDevice
from numpy.typing import NDArray

from benchmarks import device_derivatives, device_systems, on_device, scene_steps
from benchmarks.__main__ import BENCHMARKS, ON_DEVICE, main
from benchmarks.array_peer import ArrayPeer
from benchmarks.device_peers import products_of, torch_products
from benchmarks.element_problem import box_of_tets, make_problem
from benchmarks.element_rows import PEERS, PeersDisagreeError, check_peer
from benchmarks.measure import Peer, Row, measure
from benchmarks.solver_problems import in_contact, soft
from benchmarks.spmv import make_case
from yasps import NoDeviceError
from yasps.meshes import box, write_mesh
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.core.library import load_runtime


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small copies, few repetitions."""
    monkeypatch.setattr(on_device, "COPIED_BYTES", 1 << 16)
    monkeypatch.setattr(device_derivatives, "SHARES", (0.0, 0.84))
    monkeypatch.setattr(device_derivatives, "TETS_TO_TUNE", 300)


def rows_of(name: str, path: Path, *options: str) -> list[dict[str, Any]]:
    """Rows of a run on the host as a device."""
    arguments = [name, "--device", "cuda", "--repeats", "1", "--threads", "2", "--json", str(path), *options]
    assert main(arguments, lambda device: HostDevice()) == 0
    rows: list[dict[str, Any]] = json.loads(path.read_text())
    assert all(row["value"] >= 0 for row in rows)
    return rows


def found_in(rows: list[dict[str, Any]]) -> set[tuple[str, str, int]]:
    """What there are rows of."""
    return {(row["case"], row["implementation"], row["threads"]) for row in rows}


def test_elements(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = found_in(rows_of("elements", tmp_path / "rows.json", "--size", "300"))
    for case in ("structure", "gradient", "derived", "projected (0.0 %)", "projected (0.0 %), whole call"):
        assert {(case, "yasps", 2), (case, "yasps", 0)} <= found
    assert ("memory bandwidth", "copy", 0) in found
    assert ("derived: floor", "bytes", 0) in found
    assert ("derived: share of bandwidth", "yasps", 0) in found
    shared = {case for case, _, _ in found if case.endswith("share of bandwidth")}
    assert not {"structure: share of bandwidth", "gradient: share of bandwidth"} & shared
    assert len(shared) == 3
    said = " ".join(capsys.readouterr().out.split())
    assert "the host, as a device (sm_90), beside" in said
    assert "No rows for jax: " in said
    assert "No rows for torch: " in said


def test_contacts(tmp_path: Path) -> None:
    found = found_in(rows_of("contacts", tmp_path / "rows.json", "--size", "50"))
    for case in ("gradient", "derived", "projected (100.0 %)"):
        name = f"point_triangle, free and affine: {case}"
        assert {(name, "yasps", 2), (name, "yasps", 0)} <= found
    assert ("point_triangle, free and affine: derived: share of bandwidth", "yasps", 0) in found


def test_spmv(tmp_path: Path) -> None:
    rows = rows_of("spmv", tmp_path / "rows.json", "--size", "60")
    for case in ("natural order", "permuted vertices"):
        for name in ("yasps", "yasps, deterministic"):
            assert {(case, name, 0), (f"{case}, one iteration", name, 0)} <= found_in(rows)
    # The floor: upper blocks and their columns, x and y, at the bandwidth that was measured.
    tets = box(divisions=(4, 4, 4)).tets
    blocks = 125 + len({tuple(sorted((tet[a], tet[b]))) for tet in tets for a in range(4) for b in range(a)})
    (copy,) = (row["value"] for row in rows if row["case"] == "memory bandwidth")
    floors = [row["value"] for row in rows if row["case"].endswith(": floor")]
    assert floors == pytest.approx([1e3 * (blocks * 76 + 125 * 48) / (1e9 * copy)] * 2)


def test_assembly(tmp_path: Path) -> None:
    found = found_in(rows_of("assembly", tmp_path / "rows.json", "--size", "300"))
    for case in ("structure", "contacts"):
        assert {(case, "yasps", 0), (case, "yasps", 2), (case, "SciPy COO to CSR", 1)} <= found


def test_solver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_systems, "PROBLEMS", (soft, in_contact))
    rows = rows_of("solver", tmp_path / "rows.json", "--size", "100")
    iterations: dict[str, list[float]] = {}
    for row in rows:
        if row["unit"] == "iterations":
            iterations.setdefault(row["case"], []).append(row["value"])
    assert list(iterations) == ["soft", "in contact"]
    for ours, theirs in iterations.values():
        assert abs(ours - theirs) <= 2 + 0.05 * ours


@pytest.mark.slow
def test_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_steps, "FREE_FLIGHT", 1)
    write_mesh(tmp_path / "box.vtu", box(divisions=(1, 1, 1)))
    rows = rows_of("scene", tmp_path / "rows.json", "--mesh", str(tmp_path / "box.vtu"))
    for case in ("frame", "Newton iterations", "height of the stiff body"):
        assert {(case, "yasps", 2), (case, "yasps", 0)} <= found_in(rows)
    heights = [row["value"] for row in rows if row["case"] == "height of the stiff body"]
    assert heights[0] == pytest.approx(heights[1], rel=1e-6)


def test_a_device_that_gives_something_else_is_not_timed(tmp_path: Path) -> None:
    class Wrong(HostDevice):
        """Gives back numbers that are a little off."""

        def download(self, address: int, array: NDArray[Any]) -> None:
            super().download(address, array)
            if array.dtype == np.float64:
                array *= 1 + 1e-6

    for name in ("contacts", "spmv"):
        with pytest.raises(PeersDisagreeError):
            main([name, "--device", "cuda", "--size", "60", "--repeats", "1"], lambda device: Wrong())


def test_without_a_gpu_there_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    def no_device(name: str) -> HostDevice:
        assert name == "cuda:1"
        raise NoDeviceError("there is none")

    assert main(["spmv", "--device", "cuda:1"], no_device) == 1
    assert capsys.readouterr().err == "--device cuda:1: there is none\n"


def test_benchmarks_of_the_cpu_say_so(capsys: pytest.CaptureFixture[str]) -> None:
    def never(name: str) -> HostDevice:
        raise AssertionError(name)

    for name in set(BENCHMARKS) - set(ON_DEVICE):
        assert main([name, "--device", "cuda"], never) == 2
        assert f"{name} runs on the CPU only; these run on a GPU: elements" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["spmv", "--device", "gpu"], never)


def test_bandwidth_counts_what_is_read_and_written(monkeypatch: pytest.MonkeyPatch) -> None:
    copies = []

    class Counting(HostDevice):
        """Notes the copies."""

        def copy(self, source: int, address: int, size: int) -> None:
            copies.append(size)
            super().copy(source, address, size)

    def timed(peers: list[Peer], repeats: int) -> list[Row]:
        (row,) = measure(peers, repeats)
        assert peers[0].scale * on_device.LAUNCHES == 1
        return [Row(row.case, row.implementation, row.threads, 2.0, row.unit, 4.0)]

    monkeypatch.setattr(on_device, "measure", timed)
    row = on_device.copy_bandwidth(Counting(), 2)
    assert copies == [1 << 16] * (3 * on_device.LAUNCHES)
    assert (row.value, row.median, row.unit) == (2 * (1 << 16) / 2e9, 2 * (1 << 16) / 4e9, "GB/s")


@pytest.mark.parametrize("package", PEERS)
def test_peers_keep_their_arrays(package: str) -> None:
    pytest.importorskip(package)
    tets = box_of_tets(48)
    peer = PEERS[package](tets, 48)
    for project in (False, True):
        peer.resident(tets.deformed(0.1), project)()
    with pytest.raises((ImportError, RuntimeError), match="nowhere"):
        PEERS[package](tets, 48, "nowhere")


def test_rows_of_peers(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("jax")
    monkeypatch.setattr(device_derivatives, "PEERS", {"jax": PEERS["jax"]})
    tets = box_of_tets(48)
    peers, about = device_derivatives._array_peers(tets, "cpu")
    assert "Its gradient and Hessian agree" in about[0]
    tets.noise[:] *= -1  # other elements than the peer was made for
    with pytest.raises(PeersDisagreeError, match="JAX"):
        check_peer(peers[0], tets, make_problem(box_of_tets(48).exploded(), 1))
    (peer,) = device_derivatives._stored(peers, tets.deformed(0.0), "derived", False)
    (row,) = measure([peer], 1)
    assert (row.case, row.implementation, row.threads, row.unit) == ("derived, stored", "JAX", 0, "ns/element")


def test_a_peer_that_does_not_work_is_left_out() -> None:
    def broken(*given: object) -> ArrayPeer:
        raise RuntimeError("no\nlibrary")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(device_derivatives, "PEERS", {"jax": broken})
        assert device_derivatives._array_peers(box_of_tets(6), "cuda") == ([], ["No rows for jax: no library."])
    products, missing = products_of(box_matrix(), np.ones(81))
    assert len(products) + len(missing) >= 2


def test_products_of_pytorch() -> None:
    torch = pytest.importorskip("torch")
    matrix = box_matrix()
    x = np.random.default_rng(0).standard_normal(matrix.shape[0])
    for product in torch_products(torch, "cpu", matrix, x):
        np.testing.assert_allclose(product.result(), matrix @ x, rtol=1e-12, atol=1e-12)
        product.run(2)


def box_matrix() -> Any:
    """The Hessian's shape over a few tets."""
    return make_case(load_runtime(find_compiler(), 1), box(divisions=(2, 2, 2)), permuted=False).full
