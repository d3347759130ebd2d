"""Connectivities and JOIN."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from yasps import Connectivity, Mesh, Scene

X = np.random.default_rng(3).standard_normal((5, 3, 1))
TETS = np.array([[0, 1, 2, 3], [4, 3, 2, 1]])


@pytest.fixture
def mesh() -> Mesh:
    """Five points with positions x, two tets."""
    mesh = Scene("s").add_mesh("m")
    mesh.add_primitive("points", 5).add_attribute("x", 3, 1, value=X)
    mesh.add_primitive("tets", 2)
    return mesh


@pytest.mark.parametrize(
    "indices",
    [
        TETS.reshape(-1).tolist(),
        TETS,
        TETS.astype(np.uint8),
        TETS.astype(np.int64).reshape(-1),
        np.asfortranarray(TETS),
        TETS[::-1][::-1],
        tuple(map(tuple, TETS)),
    ],
    ids=["flat list", "rows", "bytes", "flat array", "column-major", "strided", "tuples"],
)
def test_indices_in_any_integer_form(mesh: Mesh, indices: Any) -> None:
    connectivity = mesh.tets.add_connectivity("points", mesh.points, indices, 4)
    np.testing.assert_array_equal(connectivity.indices, TETS)
    assert connectivity.indices.dtype == np.int32


def test_it_is_reached_by_its_name_and_describes_itself(mesh: Mesh) -> None:
    connectivity = mesh.tets.addConnectivity("tet2point", mesh.points, TETS, 4)
    assert isinstance(connectivity, Connectivity)
    assert mesh.tets.tet2point is mesh.tets.connectivities["tet2point"] is connectivity
    assert repr(connectivity) == "<connectivity m.tets.tet2point: m.tets -> 4 x m.points>"
    assert (connectivity.source, connectivity.target, connectivity.arity) == (mesh.tets, mesh.points, 4)


def test_indices_are_copied_and_read_only(mesh: Mesh) -> None:
    given = TETS.astype(np.int32)
    connectivity = mesh.tets.add_connectivity("c", mesh.points, given, 4)
    given[...] = 0
    np.testing.assert_array_equal(connectivity.indices, TETS)
    with pytest.raises(ValueError, match="read-only"):
        connectivity.indices[0, 0] = 1


def test_join_stacks_flattened_matrices(mesh: Mesh) -> None:
    connectivity = mesh.tets.add_connectivity("c", mesh.points, TETS, 4)
    F = np.arange(30.0).reshape(5, 2, 3)
    mesh.points.add_attribute("F", 2, 3, value=F)
    joined = mesh.tets.add_attribute("x", through=connectivity, source=mesh.points["x"])
    flattened = mesh.tets.add_attribute("F", through=connectivity, source=mesh.points["F"])
    assert joined.shape == (4, 3)
    assert flattened.shape == (4, 6)
    np.testing.assert_array_equal(joined.compute().array, X[TETS][..., 0])
    np.testing.assert_array_equal(flattened.compute().array, F[TETS].reshape(2, 4, 6))


def test_join_of_an_expression_and_of_a_join(mesh: Mesh) -> None:
    tet2point = mesh.tets.add_connectivity("c", mesh.points, TETS, 4)
    neighbours = mesh.tets.add_connectivity("n", mesh.tets, [1, 0], 1)
    squares = mesh.points["x"].dot(mesh.points["x"])
    joined = mesh.tets.add_attribute("squares", through=tet2point, source=squares)
    across = mesh.tets.add_attribute("across", through=neighbours, source=joined)
    expected = (X**2).sum(axis=(1, 2))[TETS]
    np.testing.assert_allclose(joined.value, expected.reshape(-1), rtol=1e-14)
    assert across.shape == (1, 4)
    np.testing.assert_allclose(across.value, expected[::-1].reshape(-1), rtol=1e-14)


def test_an_index_may_repeat(mesh: Mesh) -> None:
    twice = mesh.tets.add_connectivity("twice", mesh.points, [[2, 2], [0, 0]], 2)
    joined = mesh.tets.add_attribute("x", through=twice, source=mesh.points["x"])
    away = joined.row(0) + joined.row(1)
    mesh.scene.add_energy(0.5 * away.dot(away))
    mesh.scene.add_minimize_target(mesh.points["x"])
    expected = np.zeros((5, 3))
    expected[[2, 0]] = 4 * X[[2, 0], :, 0]
    np.testing.assert_allclose(mesh.scene.gradient()[0], expected.reshape(-1), rtol=1e-13)


def test_new_indices_are_seen_by_values_gradients_and_solutions(mesh: Mesh) -> None:
    point_of = mesh.tets.add_connectivity("point", mesh.points, [0, 1], 1)
    joined = mesh.tets.add_attribute("x", through=point_of, source=mesh.points["x"])
    x = mesh.points["x"]
    mesh.scene.add_energy(joined.dot(joined))
    mesh.scene.add_energy(0.5 * x.dot(x))
    mesh.scene.add_minimize_target(x)
    for indices in ([0, 1], [4, 4], [3, 0]):
        point_of.update_value(indices)
        np.testing.assert_array_equal(joined.value, X[indices].reshape(-1))
        stiffness = 1 + 2 * np.bincount(indices, minlength=5)
        np.testing.assert_allclose(mesh.scene.gradient()[0], (stiffness[:, None] * X[:, :, 0]).reshape(-1), rtol=1e-13)
        np.testing.assert_allclose(mesh.scene.minimize_energy(1e-24)[0], X.reshape(-1), rtol=1e-10)
        compiled = mesh.scene.compile()
        np.testing.assert_allclose(compiled.static_matrix.to_scipy().toarray(), np.diag(np.repeat(stiffness, 3)))


def test_a_connectivity_may_start_at_a_union(mesh: Mesh) -> None:
    union = mesh.add_primitive_union("union", [mesh.points, mesh.tets])
    partner = union.add_connectivity("partner", mesh.points, [4, 3, 2, 1, 0, 1, 1], 1)
    joined = union.add_attribute("x", through=partner, source=mesh.points["x"])
    np.testing.assert_array_equal(joined.value, X[[4, 3, 2, 1, 0, 1, 1]].reshape(-1))
    partner.update_value([0] * 7)
    np.testing.assert_array_equal(joined.value, X[[0] * 7].reshape(-1))
