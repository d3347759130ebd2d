"""The listings of the paper's section 4, in order and in its own spelling; only the elisions are filled in."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag

from yasps import Attribute, concat_rows, scene

Floats = NDArray[np.float64]

# A unit cube in six tetrahedra around the diagonal 0-7; bit k of a vertex number is its k-th coordinate.
CUBE = np.array([[v & 1, v >> 1 & 1, v >> 2 & 1] for v in range(8)], np.float64)
CUBE_TETS = [0, 1, 3, 7, 0, 3, 2, 7, 0, 2, 6, 7, 0, 6, 4, 7, 0, 4, 5, 7, 0, 5, 1, 7]

BUNNY_VERTEX_POSITIONS = CUBE.reshape(-1)
NUM_BUNNY_VERTEX = 8
TET_INDICES = CUBE_TETS
NUM_TETS = 6
SOFT_REST = CUBE + np.array([1.2, 0.0, 0.0])
SOFT_NOW = SOFT_REST + 0.05 * np.random.default_rng(7).standard_normal((8, 3))
DHAT = 0.09
KAPPA = 10.0
# Vertices 1, 3, 5, 7 of the affine cube face vertices 0, 2, 4, 6 of the soft one, which come after 8 affine ones.
PAIRS = [[1, 8], [3, 10], [5, 12], [7, 14]]


def stable_neo_hookean(x: Attribute, rest: Attribute) -> Attribute:
    """A tetrahedron's elastic energy, for the elided `add other energies`."""
    edges = concat_rows([x.row(k) - x.row(0) for k in (1, 2, 3)]).T
    rest_edges = concat_rows([rest.row(k) - rest.row(0) for k in (1, 2, 3)]).T
    F = edges * rest_edges.inverse()
    strain, J = F.dot(F), F.det()
    return (strain - 3) - (strain + 1).log() + (J - 1.5) * (J - 1.5)


def point_point(position: Attribute, dHat: float, kappa: float) -> Attribute:
    p0 = position.row(0)
    p1 = position.row(1)
    d = (p1 - p0).dot(p1 - p0)
    I5 = d / dHat
    lenE = d - dHat
    I5log = I5.log()
    return kappa * lenE * lenE * I5log * I5log


def listings() -> SimpleNamespace:
    """Sections 4.1 to 4.7; returns every name they bind."""
    # 4.1 Setup
    s0 = scene("scene0")
    bunny_affine = s0.addMesh("bunny_affine")
    bunny_soft = s0.addMesh("bunny_soft")
    bunny_affine.addPrimitive("vertices", numInstances=NUM_BUNNY_VERTEX)
    bunny_affine.addPrimitive("affine_body", numInstances=1)
    bunny_affine.addPrimitive("tets", numInstances=NUM_TETS)

    # 4.2 Attributes
    bunny_affine.affine_body.addAttribute("affine_matrix", rows=3, cols=3)
    bunny_affine.affine_body["affine_matrix"].updateValue(np.eye(3, dtype=np.float64))
    bunny_affine.affine_body.addAttribute("translation", rows=3, cols=1)
    bunny_affine.affine_body["translation"].updateValue(np.array([0.0, 0.0, 0.0], dtype=np.float64))
    bunny_affine.vertices.addConstant("rest_position", rows=3, cols=1)
    bunny_affine.vertices["rest_position"].updateValue(BUNNY_VERTEX_POSITIONS)

    # 4.3 Computation of attributes
    rp = bunny_affine.vertices["rest_position"]
    dotted = rp.dot(rp)
    dotted2 = 2.0 * dotted
    dotted2_value = dotted2.compute().value

    # 4.4 Connectivity
    bv2abd = bunny_affine.vertices.addConnectivity(
        "bunny_vertex_to_affine_body", bunny_affine.affine_body, [0] * (NUM_BUNNY_VERTEX), 1
    )
    affine_tet2v = bunny_affine.tets.addConnectivity("tet2v", bunny_affine.vertices, TET_INDICES, 4)

    # 4.5 JOIN
    bva = bunny_affine.vertices.addAttribute(
        "affine_matrix", through=bv2abd, source=bunny_affine.affine_body["affine_matrix"]
    )
    bva_joined = bva
    btrp = bunny_affine.tets.addAttribute(
        "rest_positions", through=affine_tet2v, source=bunny_affine.vertices["rest_position"]
    )
    bva = bva.resize(3, 3)
    # elided: bvt = ...
    bvt = bunny_affine.vertices.addAttribute(
        "translation", through=bv2abd, source=bunny_affine.affine_body["translation"]
    ).resize(3, 1)
    current_position = bva * bunny_affine.vertices["rest_position"] + bvt
    bvp = bunny_affine.vertices.addAttribute("position", computed_attribute=current_position)
    btp = bunny_affine.tets.addAttribute("positions", through=affine_tet2v, source=bunny_affine.vertices["position"])

    # elided: the soft bunny
    bunny_soft.addPrimitive("vertices", numInstances=8)
    bunny_soft.addPrimitive("tets", numInstances=6)
    bunny_soft.vertices.addConstant("rest_position", rows=3, cols=1)
    bunny_soft.vertices["rest_position"].updateValue(SOFT_REST)
    bunny_soft.vertices.addAttribute("position", rows=3, cols=1)
    bunny_soft.vertices["position"].updateValue(SOFT_NOW)
    soft_tet2v = bunny_soft.tets.addConnectivity("tet2v", bunny_soft.vertices, CUBE_TETS, 4)

    # 4.6 UNION
    bunnies = s0.addMesh("bunnies")
    bunnies.addPrimitiveUnion("vertices", [bunny_affine.vertices, bunny_soft.vertices])
    bunnies.vertices.addAttribute("rest_position")
    bunnies.vertices.addAttribute("position")
    bunnies.addPrimitive("pp", numInstances=0, isDynamic=True)
    pp2v = bunnies.pp.addConnectivity("pp2v", bunnies.vertices, [], 2)
    pp_positions = bunnies.pp.addAttribute("positions", through=pp2v, source=bunnies.vertices["position"])
    pp = point_point(pp_positions, DHAT, KAPPA)
    pp_energy = bunnies.pp.addAttribute("point_point", computed_attribute=pp)

    # 4.7 Energies
    s0.addEnergy(pp_energy, dynamic_instances=True)
    # elided: other energies
    soft_rest = bunny_soft.tets.addAttribute(
        "rest_positions", through=soft_tet2v, source=bunny_soft.vertices["rest_position"]
    )
    soft_now = bunny_soft.tets.addAttribute("positions", through=soft_tet2v, source=bunny_soft.vertices["position"])
    s0.addEnergy(bunny_soft.tets.addAttribute("elastic", computed_attribute=stable_neo_hookean(soft_now, soft_rest)))
    s0.addEnergy(bunny_affine.tets.addAttribute("elastic", computed_attribute=stable_neo_hookean(btp, btrp)))
    moved = bunnies.vertices["position"] - bunnies.vertices["rest_position"]
    s0.addEnergy(bunnies.vertices.addAttribute("inertia", computed_attribute=50 * moved.dot(moved)))
    s0.addMinimizeTarget(
        [
            bunny_soft.vertices["position"],
            bunny_affine.affine_body["affine_matrix"],
            bunny_affine.affine_body["translation"],
        ]
    )
    return SimpleNamespace(**locals())


@pytest.fixture(scope="module")
def paper() -> SimpleNamespace:
    """The scene of section 4 with the contact pairs that a collision detection would find."""
    names = listings()
    names.result_without_contact = names.s0.minimizeEnergy(tolerance=1e-6)
    names.pp2v.updateValue(PAIRS)
    return names


def hessian(paper: SimpleNamespace) -> tuple[Floats, Floats]:
    """The assembled gradient and projected Hessian, dense."""
    compiled = paper.s0.compile()
    gradient = compiled.assemble()
    return gradient, (compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()).toarray()


def test_primitives_are_reached_as_printed(paper: SimpleNamespace) -> None:
    assert paper.bunny_affine.vertices.num_instances == NUM_BUNNY_VERTEX
    assert paper.bunny_affine.affine_body.numInstances == 1
    assert paper.bunny_affine.tets.num_instances == NUM_TETS
    assert paper.bunnies.vertices.num_instances == 16
    assert paper.bunnies.pp.isDynamic


def test_shapes_are_the_printed_ones(paper: SimpleNamespace) -> None:
    assert paper.bva_joined.shape == (1, 9)
    assert paper.bva.shape == (3, 3)
    assert paper.btrp.shape == paper.btp.shape == (4, 3)
    assert paper.pp_positions.shape == (2, 3)
    assert paper.dotted.shape == paper.dotted2.shape == paper.pp_energy.shape == (1, 1)


def test_an_expression_is_not_stored_under_a_name(paper: SimpleNamespace) -> None:
    assert paper.dotted2.owner is paper.bunny_affine.vertices
    assert paper.dotted2.name is None
    assert paper.bunny_affine.vertices["position"] is paper.bvp


def test_computed_value_is_flat(paper: SimpleNamespace) -> None:
    assert paper.dotted2_value.shape == (NUM_BUNNY_VERTEX * 1 * 1,)
    np.testing.assert_allclose(paper.dotted2_value, 2 * (CUBE**2).sum(axis=1), rtol=1e-15)


def test_joins_and_unions_hold_the_right_numbers(paper: SimpleNamespace) -> None:
    tets = np.reshape(CUBE_TETS, (-1, 4))
    np.testing.assert_array_equal(paper.bva_joined.compute().array, np.tile(np.eye(3).reshape(1, 1, 9), (8, 1, 1)))
    np.testing.assert_array_equal(paper.btrp.compute().array, CUBE[tets])
    np.testing.assert_allclose(paper.btp.compute().array, CUBE[tets], atol=1e-15)
    stacked = np.concatenate([CUBE, SOFT_NOW])
    np.testing.assert_allclose(paper.bunnies.vertices["position"].value, stacked.reshape(-1), atol=1e-15)
    np.testing.assert_allclose(paper.pp_positions.compute().array, stacked[PAIRS], atol=1e-15)


def test_point_point_energy_is_the_barrier(paper: SimpleNamespace) -> None:
    first, second = np.concatenate([CUBE, SOFT_NOW])[PAIRS].transpose(1, 0, 2)
    d = ((second - first) ** 2).sum(axis=1)
    expected = KAPPA * (d - DHAT) ** 2 * np.log(d / DHAT) ** 2
    assert (expected > 0).all()
    np.testing.assert_allclose(paper.pp_energy.compute().value, expected, rtol=1e-12)


def test_result_has_one_entry_per_target_in_their_order(paper: SimpleNamespace) -> None:
    assert [part.shape for part in paper.result_without_contact] == [(24,), (9,), (3,)]
    assert [part.shape for part in paper.s0.minimizeEnergy(tolerance=1e-6)] == [(24,), (9,), (3,)]


def test_result_solves_the_system_to_the_tolerance(paper: SimpleNamespace) -> None:
    gradient, H = hessian(paper)
    np.testing.assert_allclose(H, H.T, atol=1e-12 * abs(H).max())
    assert np.linalg.eigvalsh(H).min() > 0
    blocks = [H[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(8)] + [H[24:33, 24:33], H[33:, 33:]]
    inverse = np.linalg.inv(block_diag(*blocks))
    residual = gradient - H @ np.concatenate(paper.s0.minimizeEnergy(tolerance=1e-6))
    assert residual @ inverse @ residual <= 1.0001e-6 * (gradient @ inverse @ gradient)
    exact = np.concatenate(paper.s0.minimizeEnergy(tolerance=1e-26))
    np.testing.assert_allclose(exact, np.linalg.solve(H, gradient), rtol=1e-9, atol=1e-12)


def test_contact_pairs_change_the_result(paper: SimpleNamespace) -> None:
    with_contact = paper.s0.minimizeEnergy(tolerance=1e-6)
    assert abs(with_contact[2] - paper.result_without_contact[2]).max() > 1e-3


def test_negative_result_descends(paper: SimpleNamespace) -> None:
    targets = paper.s0.minimize_targets
    start = [target.value for target in targets]
    gradient, result = paper.s0.gradient(), paper.s0.minimizeEnergy(tolerance=1e-6)
    slope = -sum(g @ x for g, x in zip(gradient, result, strict=True))

    def energy_at(step: float) -> float:
        for target, value, x in zip(targets, start, result, strict=True):
            target.updateValue(value - step * x)
        return float(paper.s0.total_energy())

    step = 1e-4
    change = (energy_at(step) - energy_at(-step)) / (2 * step)
    ahead, here = energy_at(1e-3), energy_at(0.0)
    assert ahead < here
    assert slope < 0
    assert change == pytest.approx(slope, rel=1e-5)


def test_later_calls_reuse_the_kernels(paper: SimpleNamespace) -> None:
    compiled = paper.s0.compile()
    paper.pp2v.updateValue(PAIRS[:2])
    paper.s0.minimizeEnergy(tolerance=1e-6)
    paper.pp2v.updateValue(PAIRS)
    assert paper.s0.compile() is compiled
