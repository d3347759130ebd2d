"""`prove-isotropy`: which energies it proves to be isotropic, and in what; and that these are."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from small_scenes import dense_assembly, emit, mixed_union, soft_tets
from xdsl.dialects.builtin import ModuleOp, StringAttr
from xdsl.ir import Block
from xdsl.utils.exceptions import VerifyException

from yasps import Attribute, Scene, concat_rows, eigenvalues, identity, materials, polar, select
from yasps.backend.reference.interpreter import Interpreter, SceneData
from yasps.dialects.mat import ShapeError, matrix_type
from yasps.dialects.mat.calculus import ProjectPsdOp
from yasps.dialects.rel import DerivativeOp, ProjectOp, YieldDerivativeOp, packed_size
from yasps.passes.pipeline import PIPELINE, make_context, run_pipeline
from yasps.passes.transforms.differentiate import Differentiate
from yasps.passes.transforms.inline_references import InlineReferences
from yasps.passes.transforms.project_psd import ProjectPsd
from yasps.passes.transforms.prove_isotropy import ProveIsotropy

Array = NDArray[np.float64]
Energy = Callable[[Attribute], Attribute]
FIBRE = np.array([[1.0], [2.0], [-0.5]])
TILTED = np.array([[1.0, 0.2, 0.0], [0.0, 0.9, 0.1], [0.3, 0.0, 1.1]])


def strain(f: Attribute) -> Attribute:
    return 0.5 * (f.T * f - identity(f.shape[1]))


def st_venant_kirchhoff(f: Attribute) -> Attribute:
    e = strain(f)
    return 2.0 * e.dot(e) + 1.5 * e.trace() * e.trace()


def logarithmic(f: Attribute) -> Attribute:
    """Neo-Hookean."""
    log = f.det().log()
    return 2.0 * (f.dot(f) - 3) - 4.0 * log + 1.5 * log * log


def stable(f: Attribute) -> Attribute:
    return materials.stable_neo_hookean(f, 2.0, 3.0, 0.7)


def with_choice(f: Attribute) -> Attribute:
    """Another energy where it is compressed; which, may depend on anything."""
    return select(f[0, 0] < 1.0, stable(f), st_venant_kirchhoff(f))


def beside_a_frozen_entry(f: Attribute) -> Attribute:
    return f[0, 1].stop_gradient() ** 2 * f.det() ** 2 + f.norm() ** 3


PROVEN: dict[str, Energy] = {
    "stable Neo-Hookean": stable,
    "St. Venant-Kirchhoff": st_venant_kirchhoff,
    "by the norm": lambda f: (f.norm() - 1.7) ** 2,
    "Neo-Hookean": logarithmic,
    "symmetric Dirichlet": lambda f: f.dot(f) + f.inverse().dot(f.inverse()),
    "left Cauchy-Green": lambda f: (f * f.T * (f * f.T)).trace() + f.det() ** 2,
    "second invariant": lambda f: (f.T * f).trace() ** 2 - (f.T * f * f.T * f).trace(),
    "transposed": lambda f: stable(f.T),
    "both ways round": lambda f: (f * f.T).det() + strain(f).norm() ** 2 + f.T.norm() ** 3,
    "a multiple of the identity": lambda f: (f.T * f + f.det() * identity(3)).det(),
    "scaled": lambda f: stable(2.0 * f),
    "less the identity": lambda f: (f - np.eye(3)).dot(f - np.eye(3)) ** 2,
    "times a constant matrix, throughout": lambda f: stable(f * TILTED),
    "inverse of a sum": lambda f: ((identity(3) + f.T * f).inverse() * f.T).norm() ** 3,
    "a choice": with_choice,
    "a frozen entry": beside_a_frozen_entry,
    "the nearest rotation": lambda f: materials.fixed_corotated(f, 2.0, 3.0, 0.7),
    "principal stretches": lambda f: eigenvalues(f.T * f).norm() ** 3 + eigenvalues(f * f.T)[0] ** 2,
    "a constant matrix by itself": lambda f: (f.det() * TILTED).dot(FIBRE * FIBRE.T) ** 2 + f.norm() ** 3,
}
UNPROVEN: dict[str, Energy] = {
    "an entry": lambda f: stable(f) + f[0, 0] ** 4,
    "a row": lambda f: stable(f) + f.row(1).norm() ** 3,
    "a fibre": lambda f: stable(f) + (f * FIBRE).dot(f * FIBRE) ** 2,
    "a fibre in space": lambda f: stable(f) + (FIBRE.T * f).norm() ** 3,
    "times a constant matrix, in places": lambda f: f.det() ** 2 + (f * TILTED).norm() ** 3,
    "less the identity, in places": lambda f: f.det() ** 2 + (f - np.eye(3)).norm() ** 3,
    "the trace": lambda f: f.trace() * f.det(),
    "a product with itself": lambda f: (f * f).trace() * f.det(),
    "the sum of a square": lambda f: (f.T * f).sum() * f.det(),
    "entry by entry": lambda f: f.exp().norm() ** 2,
    "a product of entries": lambda f: f.hadamard(f).norm() ** 2,
    "rows as vectors": lambda f: f.row(0).cross(f.row(1)).dot(f.row(2)) ** 2,
    "a frozen matrix": lambda f: (f - f.stop_gradient()).dot(f) * f.det(),
    "a constant matrix": lambda f: (f.T * f).dot(TILTED) * f.det(),
    "an unequal diagonal": lambda f: (f.T * f + np.diag([1.0, 1.0, 2.0])).det(),
    "F and its transpose": lambda f: (f + f.T).norm() ** 3 * f.det(),
    "eigenvalues of F itself": lambda f: eigenvalues(f).norm() ** 3,
    "an entry of the rotation": lambda f: stable(f) + polar(f)[0, 1] ** 2,
    "a choice, its first side": lambda f: select(f.det() < 1.0, stable(f) + f[0, 0] ** 4, stable(f)),
    "a choice, its second side": lambda f: select(f.det() < 1.0, stable(f), stable(f) + f[0, 0] ** 4),
}


def elements(energy: Callable[[Attribute, Attribute], Attribute], projection: str = "clamp") -> Scene:
    """An energy of the positions and the inverse rest edges of ten random tets; F is not far from the identity."""
    random = np.random.default_rng(7)
    scene = Scene("tets")
    mesh = scene.add_mesh("m")
    points, tets = mesh.add_primitive("v", 12), mesh.add_primitive("t", 10)
    indices = np.array([random.permutation(12)[:4] for _ in range(10)])
    at = random.random((12, 3))
    edges = (at[indices[:, 1:]] - at[indices[:, :1]]).swapaxes(1, 2)
    inverse = np.linalg.inv(edges) @ (np.eye(3) + 0.2 * random.standard_normal((10, 3, 3)))
    points.add_attribute("x", 3, 1, value=at)
    x = tets.add_attribute("x", through=tets.add_connectivity("corners", points, indices, 4), source=points["x"])
    rest = tets.add_constant("inverse", 3, 3, value=inverse)
    scene.add_energy(tets.add_attribute("energy", computed_attribute=energy(x, rest)), projection=projection)
    scene.add_minimize_target(points["x"])
    return scene


def tets(energy: Energy, projection: str = "clamp") -> Scene:
    """An energy of F."""
    return elements(lambda x, rest: energy(materials.deformation_gradient(x, rest)), projection)


def triangles(energy: Energy) -> Scene:
    """As `tets`, with a 3x2 F."""
    random = np.random.default_rng(8)
    scene = Scene("triangles")
    mesh = scene.add_mesh("m")
    points, elements = mesh.add_primitive("v", 9), mesh.add_primitive("t", 10)
    corners = elements.add_connectivity("corners", points, [random.permutation(9)[:3] for _ in range(10)], 3)
    points.add_attribute("x", 3, 1, value=random.random((9, 3)))
    x = elements.add_attribute("x", through=corners, source=points["x"])
    rest = elements.add_constant("inverse", 2, 2, value=np.eye(2) + 0.3 * random.standard_normal((10, 2, 2)))
    f = materials.triangle_deformation(x, rest)
    scene.add_energy(elements.add_attribute("energy", computed_attribute=energy(f)))
    scene.add_minimize_target(points["x"])
    return scene


def said_by_the_proof(module: ModuleOp) -> list[str | None]:
    """The shape each projected energy is said to be isotropic in, or "two vectors", by a module after `prove-isotropy`;
    its projections say so too."""
    said: list[str | None] = []
    for op in module.walk():
        if isinstance(op, DerivativeOp) and op.projects is not None and "nowhere" not in op.projects.data:
            _, _, why = op.projects.data.partition("; ")
            shape = why.removeprefix("by singular values: isotropic in this ").removesuffix(" matrix")
            said.append("two vectors" if shape.startswith("in the plane of two vectors") else shape or None)
    assert [len(op.operands) == 2 for op in module.walk() if isinstance(op, ProjectPsdOp)] == [
        why is not None for why in said
    ]
    return said


def shape_proven(scene: Scene) -> list[str | None]:
    """As `said_by_the_proof`; what the backend gets of the scene says so too."""
    said: list[str | None] = []

    def after(name: str, module: ModuleOp) -> None:
        if name == "prove-isotropy":
            said.extend(said_by_the_proof(module))

    emitted = emit(scene)
    run_pipeline(emitted.module, None, after)
    lowered = [op.deformation is not None for op in emitted.module.walk() if isinstance(op, ProjectOp)]
    assert sorted(lowered) == sorted(why is not None for why in said)
    return said


TO_THE_PROOF = PIPELINE[: [p.name for p in PIPELINE].index("prove-isotropy") + 1]


@cache
def proof_of(energy: Energy) -> tuple[ModuleOp, SceneData]:
    """The module of `tets` after `prove-isotropy`."""
    emitted = emit(tets(energy))
    return run_pipeline(emitted.module, passes=TO_THE_PROOF), emitted.data


@pytest.mark.parametrize("name", PROVEN)
def test_proven(name: str) -> None:
    assert said_by_the_proof(proof_of(PROVEN[name])[0]) == ["3x3"]


@pytest.mark.parametrize("name", UNPROVEN)
def test_not_proven(name: str) -> None:
    assert said_by_the_proof(proof_of(UNPROVEN[name])[0]) == [None]


@pytest.mark.parametrize("name", PROVEN)
def test_the_hessian_falls_apart(name: str) -> None:
    """What the kernel relies on: in the frames of F only the blocks of equal indices and of pairs are not zero."""
    module, data = proof_of(PROVEN[name])
    interpreter = Interpreter(module, data)
    derivative = interpreter.scene.derivatives[0]
    values = interpreter.run(derivative, {})
    (projection,) = [op for op in derivative.body.block.ops if isinstance(op, ProjectPsdOp)]
    hessians, deformations = values[projection.operands[0]], values[projection.operands[1]]
    for hessian, f in zip(hessians, deformations, strict=True):
        u, _, v = np.linalg.svd(f)
        frame = np.kron(u, v.T)
        turned = frame.T @ hessian @ frame
        blocks = np.zeros((9, 9), bool)
        blocks[np.ix_([0, 4, 8], [0, 4, 8])] = True
        for i, j in ((1, 3), (2, 6), (5, 7)):
            blocks[np.ix_([i, j], [i, j])] = True
            assert abs(turned[i, i] - turned[j, j]) < 1e-11 * np.abs(turned).max()
        assert np.abs(turned[~blocks]).max() < 1e-11 * np.abs(turned).max()


def test_scenes_of_other_tests() -> None:
    assert shape_proven(soft_tets()) == ["3x3"]
    said = shape_proven(mixed_union())  # rigidity of a 3x3 target, a spring, tets by the determinant of edges, ...
    assert said[:3] == ["3x3", None, "3x3"]
    assert not any(said[3:])


@pytest.mark.parametrize("mode", ["none", "clamp", "abs"])
def test_modes(mode: str) -> None:
    scene = tets(stable, mode)
    assert shape_proven(scene) == ([] if mode == "none" else ["3x3"])


def test_edges_where_the_rest_shape_matters() -> None:
    """Isotropic in the edges D, or in F = D B, but in neither if both are used."""

    def said(energy: Callable[[Attribute, Attribute], Attribute]) -> list[str | None]:
        def of(x: Attribute, rest: Attribute) -> Attribute:
            edges = concat_rows([x.row(i) - x.row(0) for i in (1, 2, 3)]).T
            return energy(edges, edges * rest)

        return shape_proven(elements(of))

    assert said(lambda d, f: d.det() ** 2) == ["3x3"]
    assert said(lambda d, f: f.det() ** 2 + f.norm() ** 3) == ["3x3"]
    assert said(lambda d, f: d.det() ** 2 + f.norm() ** 3) == [None]


def test_a_matrix_that_is_stored_as_a_column() -> None:
    random = np.random.default_rng(3)
    scene = Scene("columns")
    bodies = scene.add_mesh("m").add_primitive("b", 4)
    a = bodies.add_attribute("a", 9, 1, value=np.eye(3).reshape(9, 1) + 0.2 * random.standard_normal((4, 9, 1)))
    energy = st_venant_kirchhoff(a.reshape(3, 3))
    scene.add_energy(bodies.add_attribute("rigid", computed_attribute=energy))
    scene.add_minimize_target(a)
    assert shape_proven(scene) == ["3x3"]


def test_triangles() -> None:
    assert shape_proven(triangles(st_venant_kirchhoff)) == ["3x2"]
    assert shape_proven(triangles(lambda f: (f.T * f).det() ** 2 + f.norm() ** 3)) == ["3x2"]
    assert shape_proven(triangles(lambda f: materials.baraff_witkin(f, 2.0, 3.0, 1.0))) == ["two vectors"]


Pair = Callable[[Attribute, Attribute], Attribute]
OF_VECTORS: dict[str, Pair] = {
    "lengths and their product": lambda u, v: (u.norm() - 1) ** 2 + 2.0 * (v.norm() - 1) ** 2 + u.dot(v) ** 2,
    "an angle": lambda u, v: (u.dot(v) / (u.norm() * v.norm())) ** 2 + u.norm() ** 3,
    "sums": lambda u, v: (u + 2.0 * v).norm() ** 3 + (u - v).dot(u) ** 2,
    "a choice": lambda u, v: select(u.norm() < 1, u.norm() ** 3, u.dot(u) ** 2) + v.norm() ** 3,
    "normalised": lambda u, v: (u / u.norm() - v / v.norm()).norm() ** 3,
}
NOT_OF_VECTORS: dict[str, Pair] = {
    "an entry": lambda u, v: u.norm() ** 3 + v.norm() ** 3 + u.dot(v) ** 2 + v[0, 0] ** 4,
    "a direction of space": lambda u, v: u.norm() ** 3 + v.norm() ** 3 + (v - FIBRE).norm() ** 3,
    "entries of one by those of the other": lambda u, v: u.hadamard(v).norm() ** 3,
    "a frozen vector": lambda u, v: u.dot(v.stop_gradient()) ** 2 + v.norm() ** 3,
    "a choice, its second side": lambda u, v: select(u.norm() < 1, u.norm() ** 3, u[0, 0] ** 4) + v.norm() ** 3,
}


def columns(energy: Pair) -> Scene:
    """An energy of the images of two directions, 3x1."""
    return triangles(lambda f: energy(f.col(0), f.col(1)))


def edges(energy: Pair) -> Scene:
    """An energy of two edges, 1x3."""
    return elements(lambda x, rest: energy(x.row(1) - x.row(0), x.row(2) - x.row(0)))


@pytest.mark.parametrize("name", OF_VECTORS)
@pytest.mark.parametrize("make", [columns, edges])
def test_two_vectors(name: str, make: Callable[[Pair], Scene]) -> None:
    """Proven; and the Hessian falls apart as the kernel relies on: nothing couples the plane with its normal."""
    emitted = emit(make(OF_VECTORS[name]))
    module = run_pipeline(emitted.module, passes=TO_THE_PROOF)
    assert said_by_the_proof(module) == ["two vectors"]
    interpreter = Interpreter(module, emitted.data)
    derivative = interpreter.scene.derivatives[0]
    values = interpreter.run(derivative, {})
    (projection,) = [op for op in derivative.body.block.ops if isinstance(op, ProjectPsdOp)]
    hessians, vectors = values[projection.operands[0]], values[projection.operands[1]]
    for hessian, (u, v) in zip(hessians, vectors, strict=True):
        normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
        plane, across = np.eye(3) - np.outer(normal, normal), np.outer(normal, normal)
        coupling = np.kron(np.eye(2), plane) @ hessian @ np.kron(np.eye(2), across)
        assert np.abs(coupling).max() < 1e-11 * np.abs(hessian).max()


@pytest.mark.parametrize("name", NOT_OF_VECTORS)
def test_not_isotropic_in_two_vectors(name: str) -> None:
    assert shape_proven(columns(NOT_OF_VECTORS[name])) == [None]


def test_left_out_on_request() -> None:
    stages: list[str] = []
    emitted = emit(tets(stable))
    run_pipeline(emitted.module, None, lambda name, module: stages.append(name), without={"prove-isotropy"})
    assert "prove-isotropy" not in stages
    assert "isotropic" not in str(emitted.module)
    told = emit(tets(stable))
    run_pipeline(told.module)
    assert "isotropic in" in str(told.module)
    gradient, hessian = dense_assembly(emitted.module, emitted.data)
    gradient_told, hessian_told = dense_assembly(told.module, told.data)
    np.testing.assert_array_equal(gradient, gradient_told)
    np.testing.assert_array_equal(hessian, hessian_told)
    with pytest.raises(ValueError, match="only prove-isotropy can be left out, not differentiate"):
        run_pipeline(emit(tets(stable)).module, without={"differentiate"})


@pytest.mark.parametrize("kept", [True, False])
def test_the_proof_is_about_the_cut_that_is_written_down(kept: bool) -> None:
    """`differentiate` says which values the Hessian is of; without that nothing is looked for."""
    module = emit(tets(stable)).module
    for p in (InlineReferences(), Differentiate(), ProjectPsd()):
        p.apply(make_context(), module)
    (terminator,) = (op for op in module.walk() if isinstance(op, YieldDerivativeOp) and op.hessian is not None)
    (cut,) = terminator.cut
    if not kept:
        block = terminator.parent_block()
        assert block is not None
        parts = terminator.energy, terminator.gradient, terminator.hessian, terminator.wrt
        block.erase_op(terminator)
        block.add_op(YieldDerivativeOp(*parts))
    ProveIsotropy().apply(make_context(), module)
    (projection,) = (op for op in module.walk() if isinstance(op, ProjectPsdOp))
    assert list(projection.operands[1:]) == ([cut] if kept else [])


@pytest.mark.parametrize(
    ("matrix", "second"), [((3, 3), (1, 3)), ((9, 9), (3, 2)), ((6, 6), (3, 3)), ((9, 9), (1, 1)), ((4, 4), (2, 2))]
)
def test_shapes_of_a_projection(matrix: tuple[int, int], second: tuple[int, int]) -> None:
    wrong = "a 9x9 matrix can be isotropic in 9 entries and a 6x6 in 6, got"
    with pytest.raises(ShapeError, match=wrong):
        ProjectPsdOp.infer([matrix, second], {"mode": StringAttr("clamp")})
    with pytest.raises(ShapeError, match="got 3 operands"):
        ProjectPsdOp.infer([matrix] * 3, {"mode": StringAttr("clamp")})
    width = matrix[0]
    block = Block(arg_types=[matrix_type((packed_size(width), 1)), matrix_type(second)])
    with pytest.raises(VerifyException, match=wrong):
        ProjectOp(block.args[0], width, "clamp", block.args[1]).verify()


def test_the_second_operand_does_not_change_what_a_projection_means() -> None:
    random = np.random.default_rng(0)
    half = random.standard_normal((4, 9, 9))
    block = Block(arg_types=[matrix_type((9, 9)), matrix_type((3, 3))])
    one = ProjectPsdOp([block.args[0]], matrix_type((9, 9)), {"mode": StringAttr("abs")})
    two = ProjectPsdOp([*block.args], matrix_type((9, 9)), {"mode": StringAttr("abs")})
    symmetric = half + half.swapaxes(1, 2)
    np.testing.assert_array_equal(one.evaluate(symmetric), two.evaluate(symmetric, np.zeros((4, 3, 3))))
