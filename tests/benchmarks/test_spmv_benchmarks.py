"""The benchmarks `spmv` and `assembly`: they compare like with like, and every installed peer has its rows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import assembly, spmv
from benchmarks.__main__ import main
from benchmarks.element_rows import PeersDisagreeError
from benchmarks.measure import Settings
from benchmarks.spmv_peers import EigenProduct, FloatArray, MklNotFoundError, MklProduct, mkl_library
from benchmarks.sympy_kernel import EigenNotFoundError, eigen_folder
from yasps.meshes import box, sphere
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.core.library import Runtime, load_runtime
from yasps.runtime.matrix import block_matrix


@pytest.fixture(scope="module")
def runtime() -> Runtime:
    """The runtime that is timed."""
    return load_runtime(find_compiler(), 2)


@pytest.fixture(scope="module")
def case(runtime: Runtime) -> spmv.Case:
    """A small matrix whose vertices are mixed."""
    return spmv.make_case(runtime, sphere(vertices=200), permuted=True)


def test_both_orders_hold_the_same_definite_matrix(runtime: Runtime, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(block_matrix, "FEWEST_BLOCKS", 0)
    case = spmv.make_case(runtime, sphere(vertices=200), permuted=True)
    assert case.reordered.order is not None
    assert case.plain.order is None
    dense = case.full.toarray()
    np.testing.assert_array_equal(dense, dense.T)
    np.testing.assert_array_equal(case.reordered.to_scipy().toarray(), dense)
    assert np.linalg.eigvalsh(dense)[0] > 0


def test_eigen_multiplies(case: spmv.Case) -> None:
    try:
        product = EigenProduct(case.full, find_compiler())
    except EigenNotFoundError as error:
        pytest.skip(str(error))
    np.testing.assert_allclose(product.multiply(case.x), case.full @ case.x, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("threads", [1, 2])
def test_mkl_multiplies(case: spmv.Case, threads: int) -> None:
    try:
        product = MklProduct(case.full, threads)
    except MklNotFoundError as error:
        pytest.skip(str(error))
    np.testing.assert_allclose(product.multiply(case.x), case.full @ case.x, rtol=1e-12, atol=1e-12)


def test_peer_that_is_wrong_is_found(case: spmv.Case, monkeypatch: pytest.MonkeyPatch) -> None:
    def multiply(self: EigenProduct, x: FloatArray) -> FloatArray:
        self.y[:] = x
        return self.y

    try:
        eigen_folder()
    except EigenNotFoundError as error:
        pytest.skip(str(error))
    monkeypatch.setattr(EigenProduct, "multiply", multiply)
    with pytest.raises(PeersDisagreeError, match="Eigen"):
        spmv.run(Settings(size=100, repeats=1, threads=1))


def test_spmv_on_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "rows.json"
    assert main(["spmv", "--size", "150", "--repeats", "1", "--threads", "2", "--json", str(path)]) == 0
    rows = json.loads(path.read_text())
    found = {(row["case"], row["implementation"], row["threads"]) for row in rows}
    for case in ("natural order", "permuted vertices"):
        assert (case, "SciPy BSR", 1) in found
        for threads in (1, 2):
            for name in ("yasps", "yasps, not reordered"):
                assert (case, name, threads) in found
                assert (f"{case}, one iteration", name, threads) in found
            try:
                mkl_library()
            except MklNotFoundError:
                continue
            assert (case, "MKL", threads) in found
    assert all(row["value"] > 0 for row in rows)


def test_given_derivatives_add_up_to_their_dense_sum(runtime: Runtime) -> None:
    mesh = box(divisions=(2, 1, 1))
    given = assembly.given_derivatives(len(mesh.vertices), mesh.tets)
    values, rows, cols = given.entries()
    dense = np.zeros((3 * given.count, 3 * given.count))
    np.add.at(dense, (rows, cols), values)
    np.testing.assert_allclose(dense, dense.T, rtol=1e-14)
    gradient = np.zeros((given.count, 3))
    np.add.at(gradient, given.tets, given.gradients)
    library, kernel = assembly.make_kernel(find_compiler())
    for deterministic in (False, True):
        one = assembly.Sum(runtime, kernel, given, 2, deterministic=deterministic)
        for _ in range(2):
            one.run()
        np.testing.assert_allclose(one.matrix.to_scipy().toarray(), dense, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(one.gradient, gradient.reshape(-1), rtol=1e-13, atol=1e-13)
    assert library is not None
    pattern = assembly.block_sparsity(given.count, given.tets).toarray() != 0
    np.testing.assert_array_equal(pattern, np.abs(dense).reshape(given.count, 3, given.count, 3).max((1, 3)) > 0)


def test_assembly_on_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "rows.json"
    assert main(["assembly", "--size", "400", "--repeats", "1", "--threads", "2", "--json", str(path)]) == 0
    rows = json.loads(path.read_text())
    found = {(row["case"], row["implementation"], row["threads"]) for row in rows}
    for case in ("structure, first time", "structure", "contacts", "values"):
        assert {(case, "yasps", 1), (case, "yasps", 2)} <= found
    for name in ("yasps, deterministic", "SciPy COO to CSR", "NumPy bincount"):
        assert ("values", name, 1) in found
    (moved,) = (row["value"] for row in rows if (row["case"], row["implementation"]) == ("floor, values", "bytes"))
    cells = round((400 / 6) ** (1 / 3))
    assert moved * 1e6 > 6 * cells**3 * (12 * 8 + 90 * 8 + 16 + 80)
