"""The benchmark `projection`: its matrices are what it says, and yasps agrees with Eigen to rounding."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import projection, projection_peers
from benchmarks.__main__ import main
from benchmarks.element_problem import FloatArray
from benchmarks.measure import Settings
from benchmarks.projection import packed, random_matrices, unpacked
from benchmarks.projection_peers import ANY_WIDTH, EigenProjection, eigen_projection, numpy_projection
from benchmarks.sympy_kernel import EigenNotFoundError
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.core.library import Runtime, load_runtime


@pytest.fixture(scope="module")
def runtime() -> Runtime:
    """The runtime whose projection is timed."""
    return load_runtime(find_compiler(), 1)


@pytest.fixture(scope="module")
def eigen() -> EigenProjection:
    """Eigen's solver, where Eigen is installed."""
    try:
        return eigen_projection(find_compiler(), [ANY_WIDTH])
    except EigenNotFoundError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("width", [1, 3, 9])
@pytest.mark.parametrize("share", projection.SHARES)
def test_matrices_are_what_the_case_says(runtime: Runtime, width: int, share: float) -> None:
    matrices = random_matrices(1001, width, share)
    values = np.linalg.eigvalsh(matrices)
    assert abs((values[:, 0] < 0).mean() - share) < 0.05
    assert (values < 0).sum(axis=1).max() <= max(1, width // 2)
    assert np.abs(values).min() > 0.09
    packs = packed(matrices)
    np.testing.assert_array_equal(unpacked(packs, 1001, width), matrices)
    harness = projection.make_harness(find_compiler())
    target = np.full_like(packs, np.nan)
    assert harness.project(packs, target, 1001, width, copy_only=True) == 0
    np.testing.assert_array_equal(target, packs)
    assert harness.project(packs, target, 1001, width, copy_only=False) == (values[:, 0] < 0).sum()
    np.testing.assert_allclose(unpacked(target, 1001, width), numpy_projection(matrices), rtol=0, atol=1e-14)


def rank_deficient(rng: np.random.Generator, width: int) -> FloatArray:
    thin = rng.standard_normal((40, width, max(1, width // 3)))
    product: FloatArray = thin @ (rng.standard_normal((40, thin.shape[2], 1)) * thin.swapaxes(1, 2))
    return 0.5 * (product + product.swapaxes(1, 2))


def repeated_eigenvalues(rng: np.random.Generator, width: int) -> FloatArray:
    frames = np.linalg.qr(rng.standard_normal((40, width, width)))[0]
    product: FloatArray = (frames * rng.choice([-2.0, 1.0], (40, 1, width))) @ frames.swapaxes(1, 2)
    return 0.5 * (product + product.swapaxes(1, 2))


@pytest.mark.parametrize("width", [1, 2, 3, 6, 9, 12, 15, 24])
@pytest.mark.parametrize("scale", [1e-300, 1e-150, 1.0, 1e150, 1e300])
def test_eigen_gives_the_same(runtime: Runtime, eigen: EigenProjection, width: int, scale: float) -> None:
    rng = np.random.default_rng(width)
    groups = [random_matrices(100, width, 0.6), rank_deficient(rng, width), repeated_eigenvalues(rng, width)]
    matrices = np.concatenate(groups) * scale
    expected = np.zeros_like(matrices)
    eigen.project(matrices, expected)
    packs = packed(matrices)
    assert runtime.project(packs, len(matrices)) > 0
    difference = np.abs(unpacked(packs, len(matrices), width) - expected).max(axis=(1, 2))
    assert (difference <= 1e-13 * np.abs(matrices).max(axis=(1, 2))).all()


@pytest.mark.parametrize("installed", [True, False])
def test_a_tiny_run(
    installed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(projection, "WIDTHS", (3, 9))
    # One compile for all widths, that of the other tests.
    monkeypatch.setattr(projection, "eigen_projection", lambda compiler, _: eigen_projection(compiler, [ANY_WIDTH]))

    def none() -> Path:
        raise EigenNotFoundError("no Eigen, says the test")

    if not installed:
        monkeypatch.setattr(projection_peers, "eigen_folder", none)
    path = tmp_path / "rows.json"
    assert main(["projection", "--size", "100", "--repeats", "1", "--json", str(path)]) == 0
    rows = json.loads(path.read_text())
    printed = capsys.readouterr().out
    has_eigen = "No rows for Eigen" not in printed
    assert installed or not has_eigen
    names = ["copy", "yasps", "Eigen", "NumPy"] if has_eigen else ["copy", "yasps", "NumPy"]
    cases = [f"{w}x{w}, {share} fail" for w in (3, 9) for share in ("0%", "25%", "100%")]
    assert [(row["case"], row["implementation"]) for row in rows] == [(c, name) for c in cases for name in names]
    assert all(row["value"] > 0 and row["unit"] == "ns/matrix" for row in rows)


def test_disagreement_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(projection, "numpy_projection", lambda matrices: 1.001 * numpy_projection(matrices))
    monkeypatch.setattr(projection, "eigen_projection", lambda compiler, _: eigen_projection(compiler, [ANY_WIDTH]))
    with pytest.raises(RuntimeError, match="the projection of yasps and of NumPy differ"):
        projection.run(Settings(20, 1, 1))
