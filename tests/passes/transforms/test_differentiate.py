"""`differentiate`: what is differentiated, with respect to what, and what is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from mat_bodies import relative_error
from small_scenes import along_each_unknown, dense_assembly, emit
from xdsl.dialects.builtin import ModuleOp

from yasps import Attribute, Scene, concat_cols, concat_rows
from yasps.backend.reference.interpreter import Interpreter
from yasps.dialects.rel import CurvatureOp, DerivativeOp, JacobianOp, YieldCurvatureOp, YieldDerivativeOp
from yasps.passes.pipeline import make_context
from yasps.passes.transforms.differentiate import Differentiate
from yasps.passes.transforms.inline_references import InlineReferences


def points(count: int = 3, seed: int = 0) -> tuple[Scene, Attribute]:
    """A scene with free points x (3x1)."""
    scene = Scene("s")
    vertices = scene.add_mesh("m").add_primitive("v", count)
    x = vertices.add_attribute("x", 3, 1, value=np.random.default_rng(seed).uniform(0.5, 1.5, (count, 3)))
    scene.add_minimize_target(x)
    return scene, x


def derived(scene: Scene) -> tuple[ModuleOp, list[DerivativeOp], list[JacobianOp]]:
    """The scene after `differentiate`."""
    emitted = emit(scene)
    for p in (InlineReferences(), Differentiate()):
        p.apply(make_context(), emitted.module)
        emitted.module.verify()
    ops = list(emitted.module.walk())
    return (
        emitted.module,
        [op for op in ops if isinstance(op, DerivativeOp)],
        [op for op in ops if isinstance(op, JacobianOp)],
    )


def check(scene: Scene) -> None:
    """Gradient and Hessian against complex steps."""
    module, _, _ = derived(scene)
    emitted = emit(scene)
    gradient, hessian = dense_assembly(module, emitted.data)
    wanted = along_each_unknown(emitted.module, emitted.data, emitted.targets, lambda i: i.total_energy())
    assert relative_error(gradient, wanted) < 1e-12
    wanted = along_each_unknown(module, emitted.data, emitted.targets, lambda i: i.assemble()[0])
    assert relative_error(hessian, wanted) < 1e-12
    assert relative_error(hessian, hessian.T) < 1e-14


ENERGIES: dict[str, Callable[[Attribute], Attribute]] = {
    "quadratic": lambda x: x.dot(x),
    "linear": lambda x: 3.0 * x[2],
    "linear beside a cut": lambda x: 3.0 * x[2] + (x[0] - x[1]) ** 3,
    "of the norm": lambda x: x.norm() ** 3 + x.norm(),
    "transcendental": lambda x: (x[0] * x[1]).sin() + x.log().sum() * x[2].exp() + x.cos().dot(x.sqrt()),
    "rational": lambda x: x[0] / (1.0 + x.dot(x)) + 2.0 / x[1],
    "of an inverse": lambda x: (x.outer(x) + np.eye(3)).inverse().trace(),
    "of a determinant": lambda x: (x.outer(x) + 2.0 * np.eye(3)).det().log(),
    "of a determinant of four": lambda x: (concat_rows([x, x[0] * x[1]]).outer([1.0, 2, 3, 4]) + np.eye(4)).det() ** 2,
    "of a cross product": lambda x: x.cross([1.0, 2.0, 3.0]).norm() * x.T.cross(x.T * np.diag([1.0, 2, 3])).norm(),
    "of parts": lambda x: (concat_cols([x, 2.0 * x]).T * concat_rows([x, x]).block(1, 0, 3, 1)).sum() ** 2,
    "with a part held": lambda x: x.dot(x.stop_gradient()) * x[0],
    "a power": lambda x: x.dot(x) ** 1.5 + x[0] ** -2 + x[1] ** 0.5,
}


@pytest.mark.parametrize("name", [name for name in ENERGIES if "held" not in name])
def test_against_complex_step(name: str) -> None:
    scene, x = points()
    assert x.owner is not None
    scene.add_energy(x.owner.add_attribute("e", computed_attribute=ENERGIES[name](x)), projection="none")
    check(scene)


def test_what_is_held_is_constant() -> None:
    """e = (x . c) x_0 with c = x held: gradient c x_0 + (x . c) e_0, Hessian c e_0^T + e_0 c^T."""
    scene, x = points(1)
    assert x.owner is not None
    scene.add_energy(x.owner.add_attribute("e", computed_attribute=ENERGIES["with a part held"](x)))
    module, _, _ = derived(scene)
    gradient, hessian = dense_assembly(module, emit(scene).data)
    c, first = x.value, np.eye(3)[0]
    assert relative_error(gradient, c * c[0] + c @ c * first) < 1e-14
    assert relative_error(hessian, np.outer(c, first) + np.outer(first, c)) < 1e-14


def test_random_scenes_of_several_layers() -> None:
    """JOIN of a UNION of a JOIN and of a UNION, several slots on the same points."""
    random = np.random.default_rng(5)
    scene = Scene("s")
    mesh, other = scene.add_mesh("m"), scene.add_mesh("o")
    free, cage, fixed = mesh.add_primitive("free", 3), mesh.add_primitive("cage", 2), mesh.add_primitive("fixed", 2)
    for primitive, count in ((free, 3), (cage, 2)):
        primitive.add_attribute("x", 2, 1, value=random.random((count, 2)))
    fixed.add_constant("x", 2, 1, value=random.random((2, 2)))
    inside = mesh.add_primitive("inside", 4)
    corners = inside.add_connectivity("corners", cage, random.integers(0, 2, (4, 2)), 2)
    inside.add_constant("w", 1, 2, value=random.random((4, 2)))
    joined = inside.add_attribute("corners_x", through=corners, source=cage["x"])
    inside.add_attribute("x", computed_attribute=(inside["w"] * joined).T)
    first = mesh.add_primitive_union("first", [free, inside])
    first.add_attribute("x")
    second = other.add_primitive_union("second", [fixed, first])
    second.add_attribute("x")
    pairs = other.add_primitive("pairs", 6)
    ends = pairs.add_connectivity("ends", second, random.integers(0, 9, (6, 3)), 3)
    x = pairs.add_attribute("x", through=ends, source=second["x"])
    between = x.row(0) + x.row(1) - 2.0 * x.row(2)
    energy = (1.0 + between.dot(between)).sqrt() + x.row(0).dot(x.row(1)) ** 2
    scene.add_energy(pairs.add_attribute("e", computed_attribute=energy), projection="none")
    scene.add_minimize_target([cage["x"], free["x"]])
    check(scene)
    _, _, jacobians = derived(scene)
    assert [op.symbol for op in jacobians] == ["m.inside.x.jacobian"]  # of the targets none is needed


def test_an_affine_energy_has_no_hessian() -> None:
    scene, x = points()
    assert x.owner is not None
    scene.add_energy(x.owner.add_attribute("e", computed_attribute=ENERGIES["linear"](x)))
    _, (derivative,), _ = derived(scene)
    terminator = derivative.body.block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    assert terminator.hessian is None


def test_an_energy_of_constants_has_no_derivative() -> None:
    scene, x = points()
    assert x.owner is not None
    c = x.owner.add_constant("c", 3, 1)
    scene.add_energy(x.owner.add_attribute("e", computed_attribute=c.dot(c)))
    scene.add_energy(x.owner.add_attribute("held", computed_attribute=x.dot(x)))
    _, derivatives, _ = derived(scene)
    assert [op.symbol for op in derivatives] == ["m.v.held.derivative"]


def test_shared_attributes_are_differentiated_once(pipeline_run: Callable[..., object]) -> None:
    text = pipeline_run("mixed_union", "clamp").stages["differentiate"].text  # type: ignore[attr-defined]
    assert text.count("rel.jacobian @stiff.v.x.jacobian ") == 1
    assert text.count("rel.jacobian ") == 1  # the stiff elastic energy, gravity and barriers share it


def test_derivatives_are_of_boundary_inputs_only(pipeline_run: Callable[..., object]) -> None:
    """The Hessian of a contact is 6x6 whatever parameterises its points."""
    module = pipeline_run("mixed_union", "clamp").stages["differentiate"].module  # type: ignore[attr-defined]
    (barrier,) = [op for op in module.walk() if isinstance(op, DerivativeOp) and "barrier" in op.symbol]
    terminator = barrier.body.block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    assert terminator.hessian is not None
    assert str(terminator.hessian.type) == "tensor<6x6xf64>"
    assert [str(v.type) for v in terminator.wrt] == ["tensor<2x3xf64>"]


def _bent() -> tuple[Scene, Attribute]:
    """Points whose positions are nonlinear in the targets: polar coordinates, read through a JOIN."""
    scene, x = points()
    assert x.owner is not None
    place = concat_rows([x[0] * x[1].cos(), x[0] * x[1].sin(), x[2]])
    bent = x.owner.add_attribute("bent", computed_attribute=place)
    pairs = scene.m.add_primitive("p", 3)
    ends = pairs.add_connectivity("ends", x.owner, [[0, 1], [1, 2], [2, 2]], 2)
    return scene, pairs.add_attribute("x", through=ends, source=bent)


def test_a_nonlinear_parameterisation_has_a_curvature() -> None:
    scene, pair = _bent()
    energy = (pair.row(0) - 2.0 * pair.row(1)).dot(pair.row(0)) ** 2
    scene.add_energy(scene.m.p.add_attribute("e", computed_attribute=energy), projection="none")
    check(scene)
    module, (derivative,), (jacobian,) = derived(scene)
    assert jacobian.symbol == "m.v.bent.jacobian"
    assert derivative.curved is not None
    (curvature,) = [op for op in module.walk() if isinstance(op, CurvatureOp)]
    assert curvature.symbol == "m.v.bent.curvature"
    terminator = curvature.body.block.last_op
    assert isinstance(terminator, YieldCurvatureOp)
    assert str(terminator.hessian.type) == "tensor<3x3xf64>"  # one matrix, no third-order object


def test_an_affine_energy_of_a_nonlinear_parameterisation_is_curved() -> None:
    """Its Hessian is the curvature term alone."""
    scene, pair = _bent()
    scene.add_energy(scene.m.p.add_attribute("e", computed_attribute=pair.sum() * 3.0), projection="none")
    check(scene)
    _, (derivative,), _ = derived(scene)
    terminator = derivative.body.block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    assert terminator.hessian is None
    assert derivative.curved is not None


@pytest.mark.parametrize("in_union", [False, True])
def test_an_affine_layer_in_front_of_a_nonlinear_one_is_curved(in_union: bool) -> None:
    """It has no curvature of its own, but what it reads has."""
    scene, pair = _bent()
    middles = scene.m.p.add_attribute("middle", computed_attribute=0.5 * (pair.row(0) + pair.row(1)))
    front = scene.m.p
    if in_union:
        front = scene.m.add_primitive_union("u", [scene.m.p])
        middles = front.add_attribute("middle")
    edges = scene.m.add_primitive("e", 2)
    ends = edges.add_connectivity("ends", front, [[0, 1], [1, 2]], 2)
    x = edges.add_attribute("x", through=ends, source=middles)
    between = x.row(0) - x.row(1)
    scene.add_energy(edges.add_attribute("e", computed_attribute=between.dot(between)), projection="none")
    check(scene)
    module, (derivative,), _ = derived(scene)
    assert [op.symbol for op in module.walk() if isinstance(op, CurvatureOp)] == ["m.v.bent.curvature"]
    assert derivative.curved is not None


def test_affine_parameterisations_are_not_curved(pipeline_run: Callable[..., object]) -> None:
    text = pipeline_run("mixed_union", "clamp").stages["differentiate"].text  # type: ignore[attr-defined]
    assert "rel.jacobian" in text
    assert "curved" not in text
    assert "rel.curvature" not in text


def test_the_same_nonlinear_part_inside_the_energy_is_fine() -> None:
    scene, x = points()
    assert x.owner is not None
    bent = x.owner.add_attribute("bent", computed_attribute=x.sin())
    scene.add_energy(x.owner.add_attribute("e", computed_attribute=bent.dot(bent)), projection="none")
    check(scene)


def test_a_target_that_no_energy_reads_has_zero_derivatives() -> None:
    scene, x = points()
    assert x.owner is not None
    scene.add_minimize_target(x.owner.add_attribute("unused", 2, 1))
    scene.add_energy(x.owner.add_attribute("e", computed_attribute=x.dot(x)))
    module, _, _ = derived(scene)
    emitted = emit(scene)
    assert "m.v.unused" in emitted.data.storages
    gradient, hessian = dense_assembly(module, emitted.data)
    assert gradient.shape == (15,)
    assert not gradient[9:].any()
    assert not hessian[9:].any()


def test_interpreter_values_by_name() -> None:
    """The reference itself: an attribute's values on every instance."""
    scene, x = points(2)
    assert x.owner is not None
    scene.add_energy(x.owner.add_attribute("e", computed_attribute=x.dot(x)))
    emitted = emit(scene)
    values = Interpreter(emitted.module, emitted.data).value("m.v.e")
    assert values.shape == (2, 1, 1)
    assert np.allclose(values.ravel(), (x.value.reshape(2, 3) ** 2).sum(axis=1), rtol=1e-15)
