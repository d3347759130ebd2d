"""The benchmark `contacts`: its pairs are close and of their kind, ipctk agrees, and a tiny run works."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import contacts
from benchmarks.__main__ import main
from benchmarks.contact_problem import CONTACTS, REACH, close_pairs, free_problem, union_problem
from benchmarks.element_rows import PeersDisagreeError
from benchmarks.ipctk_contacts import ipctk_pairs


@pytest.mark.parametrize("kind", CONTACTS)
def test_pairs_are_close_and_ipctk_agrees(kind: str) -> None:
    pairs = close_pairs(kind, 20)
    assert len(pairs.pairs) == 16
    assert len(np.unique(pairs.pairs, axis=0)) == 16
    assert pairs.pairs.max() < len(pairs.vertices)
    assert (pairs.pairs[:, 0] >= pairs.lower).all()
    assert np.abs(pairs.vertices[pairs.pairs[:, 0], 2] - pairs.vertices[pairs.pairs[:, -1], 2]).max() < REACH
    peer, problem = ipctk_pairs(pairs), free_problem(pairs, 1)
    contacts.check_ipctk(peer, problem)
    energy = problem.compiled.total_energy()
    assert energy > 0
    assert energy == pytest.approx(peer.potential(peer.collisions, peer.mesh, peer.x), rel=1e-12)
    # Projected Hessians differ (9 unknowns here, 12 there); both are semidefinite.
    values = np.linalg.eigvalsh(peer.hessian(True).toarray())
    problem.compiled.assemble()
    ours = np.linalg.eigvalsh(problem.compiled.static_matrix.to_scipy().toarray())
    assert min(values[0], ours[0]) > -1e-9 * max(values[-1], ours[-1])


def test_nearly_parallel_edges_are_below_the_threshold() -> None:
    pairs = close_pairs("mollified_edge_edge", 100)
    assert pairs.threshold is not None
    x = pairs.vertices[pairs.pairs]
    cross = np.cross(x[:, 1] - x[:, 0], x[:, 3] - x[:, 2])
    assert ((cross * cross).sum(axis=1) < pairs.threshold).all()
    assert close_pairs("edge_edge", 100).threshold is None


def test_other_numbers_are_an_error() -> None:
    few, other = close_pairs("point_point", 9), close_pairs("point_point", 9)
    other.vertices[0, 2] -= 1e-4
    with pytest.raises(PeersDisagreeError, match="IPC Toolkit"):
        contacts.check_ipctk(ipctk_pairs(other), free_problem(few, 1))


def test_union_has_the_same_energy_and_the_affine_bodys_gradient() -> None:
    pairs = close_pairs("point_triangle", 16)
    free, union = free_problem(pairs, 1), union_problem(pairs, 1)
    assert union.compiled.total_energy() == pytest.approx(free.compiled.total_energy(), rel=1e-12)
    gradient = free.compiled.assemble().reshape(-1, 3)
    expected = np.concatenate([gradient[: pairs.lower].reshape(-1), np.zeros(12)])
    upper = pairs.vertices[pairs.lower :]
    expected[-12:-3] = np.einsum("ni,nj->ij", gradient[pairs.lower :], upper - upper.mean(axis=0)).reshape(-1)
    expected[-3:] = gradient[pairs.lower :].sum(axis=0)
    assert union.compiled.assemble() == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())


def test_tiny_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contacts, "CONTACTS", ("point_triangle",))
    path = tmp_path / "rows.json"
    assert main(["contacts", "--size", "16", "--repeats", "1", "--threads", "1", "--json", str(path)]) == 0
    rows = json.loads(path.read_text())
    assert all(0 < row["value"] < np.inf for row in rows)
    timed = {(row["case"].partition(" (")[0], row["implementation"]) for row in rows if row["unit"] == "ns/pair"}
    for case in ("gradient", "derived", "projected"):
        assert (f"point_triangle: {case}", "yasps") in timed
        assert (f"point_triangle: {case}", "IPC Toolkit") in timed
        assert (f"{contacts.UNION}: {case}", "yasps") in timed
    assert sum(row["unit"] == "times" for row in rows) == 4
