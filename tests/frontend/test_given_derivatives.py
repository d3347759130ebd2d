"""Attributes with derivatives of one's own: used instead of those that are derived, and compared with them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from xdsl.dialects.builtin import ModuleOp

from yasps import (
    Attribute,
    FloatArray,
    Primitive,
    Scene,
    SceneError,
    ShapeMismatchError,
    concat_cols,
    concat_rows,
    constant,
    identity,
)
from yasps.dialects.mat import MatOp
from yasps.dialects.rel import AttributeOp, DerivativeOp
from yasps.frontend.execution.emit import EnergyTerm, SceneEmitter
from yasps.passes.bodies import containers
from yasps.passes.pipeline import PIPELINE, run_pipeline

Given = Callable[[Attribute, Attribute], Attribute]


def energy(d: Attribute, k: Attribute) -> Attribute:
    """k (d . d - 1)^2: its Hessian is indefinite where |d| < 1."""
    return k * (d.dot(d) - 1.0) ** 2


def gradient(d: Attribute, k: Attribute) -> Attribute:
    return 4.0 * k * (d.dot(d) - 1.0) * d


def hessian(d: Attribute, k: Attribute) -> Attribute:
    return 4.0 * k * (d.dot(d) - 1.0) * identity(3) + 8.0 * k * d.outer(d)


def eigensystem(d: Attribute, k: Attribute) -> tuple[Attribute, Attribute]:
    """d, and two vectors across."""
    across = 4.0 * k * (d.dot(d) - 1.0)
    first = d / d.norm()
    second = first.cross(constant([0.3, -0.5, 0.8]))
    second = second / second.norm()
    values = concat_rows([across + 8.0 * k * d.dot(d), across, across])
    return values, concat_cols([first, second, first.cross(second)])


GIVEN: dict[str, Given] = {
    "gradient": lambda d, k: energy(d, k).with_derivatives(d, gradient(d, k)),
    "hessian": lambda d, k: energy(d, k).with_derivatives(d, gradient(d, k), hessian=hessian(d, k)),
    "eigensystem": lambda d, k: energy(d, k).with_derivatives(d, gradient(d, k), eigensystem=eigensystem(d, k)),
    "both": lambda d, k: energy(d, k).with_derivatives([d, k], [gradient(d, k), (d.dot(d) - 1.0) ** 2]),
}


def springs() -> tuple[Scene, Primitive, Attribute, Attribute]:
    """Springs over UNION(targets, constants): the scene, the springs, the difference of their ends, the stiffness."""
    scene = Scene("given")
    mesh = scene.add_mesh("m")
    pins, free = mesh.add_primitive("pins", 2), mesh.add_primitive("free", 4)
    numbers = 0.6 * np.random.default_rng(1).normal(size=(6, 3))
    pins.add_constant("x", 3, 1, value=numbers[:2])
    x = free.add_attribute("x", 3, 1, value=numbers[2:])
    points = mesh.add_primitive_union("points", [pins, free])
    points.add_attribute("x")
    springs = mesh.add_primitive("springs", 5)
    ends = springs.add_connectivity("ends", points, [[0, 2], [2, 3], [3, 4], [4, 5], [5, 1]], 2)
    both = springs.add_attribute("both", through=ends, source=points["x"])
    k = springs.add_constant("k", 1, 1, value=[1.0, 2, 3, 4, 5])
    scene.add_minimize_target(x)
    return scene, springs, (both.row(1) - both.row(0)).transpose(), k


def results(scene: Scene) -> list[FloatArray]:
    """Energy, gradient, exact and projected Hessian."""
    compiled = scene.compile()
    gradient = compiled.assemble(project=False)
    exact = compiled.hessian().to_scipy().toarray()
    compiled.assemble()
    return [np.array(compiled.total_energy()), gradient, exact, compiled.hessian().to_scipy().toarray()]


def test_given_derivatives_are_those_that_would_be_derived() -> None:
    scene, primitive, d, k = springs()
    derived = primitive.add_attribute("derived", computed_attribute=energy(d, k))
    scene.add_energy(derived)
    expected = results(scene)
    assert np.linalg.eigvalsh(expected[2]).min() < -1
    scene.remove_energy(derived)
    for name, give in GIVEN.items():
        given = primitive.add_attribute(f"by_{name}", computed_attribute=give(d, k))
        scene.add_energy(given)
        for found, wanted in zip(results(scene), expected, strict=True):
            np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-13, err_msg=name)
        scene.remove_energy(given)
    with pytest.raises(SceneError, match=r"with respect to m\.springs\.k are asked for, and what was given at .*:\d+"):
        scene.compile_for(k, energies=[primitive["by_hessian"]])
    x = scene.m.free["x"]
    mixed = [scene.compile_for([x, k], energies=[one]) for one in (derived, primitive["by_both"])]
    for compiled in mixed:
        compiled.assemble()
    found, wanted = (compiled.hessian().to_scipy().toarray() for compiled in mixed)
    np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-13)


def test_what_is_given_is_used() -> None:
    """Told to be twice as steep, an energy is."""
    scene, primitive, d, k = springs()
    scene.add_energy(primitive.add_attribute("derived", computed_attribute=energy(d, k)))
    value, slope, exact, _ = results(scene)
    scene.remove_energy(primitive["derived"])
    wrong = energy(d, k).with_derivatives(d, 2.0 * gradient(d, k), check=False)
    scene.add_energy(primitive.add_attribute("steep", computed_attribute=wrong))
    found = results(scene)
    assert found[0] == value
    np.testing.assert_allclose(found[1], 2.0 * slope, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(found[2], 2.0 * exact, rtol=1e-13, atol=1e-13)


def module_after(scene: Scene, attribute: Attribute, stage: str) -> ModuleOp:
    """The scene's IR with this energy alone after a pass."""
    module = SceneEmitter(scene.name).emit([EnergyTerm(attribute, "clamp", False)], scene.minimize_targets, [])
    passes = [one.name for one in PIPELINE]
    return run_pipeline(module, passes=PIPELINE[: 1 + passes.index(stage)])


def test_nothing_is_left_behind_differentiation() -> None:
    """Neither the operation nor, in the code of the value, what the derivative is made of; where the eigenvalues are
    given, they are what is projected."""
    scene, primitive, d, k = springs()
    given = primitive.add_attribute("energy", computed_attribute=GIVEN["eigensystem"](d, k))
    derived = primitive.add_attribute("derived", computed_attribute=energy(d, k))
    assert "mat.given_derivative" in str(module_after(scene, given, "fold-norms"))
    module = module_after(scene, given, "project-psd")
    assert "mat.given_derivative" not in str(module)
    bodies = [
        sorted(op.name for op in made.body.block.ops if isinstance(op, MatOp))
        for one in (module, module_after(scene, derived, "project-psd"))
        for container in containers(one)
        for made in container.body.block.ops
        if isinstance(made, AttributeOp) and made.symbol in ("m.springs.energy", "m.springs.derived")
    ]
    assert bodies[0] == bodies[1]
    (derivative,) = [op for op in containers(module)[0].body.block.ops if isinstance(op, DerivativeOp)]
    assert derivative.projects is not None
    assert derivative.projects.data == "3x3 of 6x6: its eigenvalues are given"


def test_arguments_above_a_narrower_cut() -> None:
    """By both ends, of which the formula sees but the difference."""
    scene, primitive, d, k = springs()
    ends, slope = primitive["both"], gradient(d, k).T
    given = energy(d, k).with_derivatives(ends, concat_rows([-slope, slope]))
    found = []
    for name, one in (("plain", energy(d, k)), ("by_ends", given)):
        scene.add_energy(primitive.add_attribute(name, computed_attribute=one))
        found.append(results(scene))
        scene.remove_energy(primitive[name])
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-13)


def test_arguments_that_are_nonlinear_in_the_targets() -> None:
    """The Hessian that is given is not the energy's then: the gradient's chain rule adds to it."""
    scene, primitive, d, k = springs()
    square = d.dot(d)
    plain = k * (square - 1.0) ** 2
    given = plain.with_derivatives(square, 2.0 * k * (square - 1.0), hessian=2.0 * k)
    found = []
    for name, one in (("plain", plain), ("by_square", given)):
        scene.add_energy(primitive.add_attribute(name, computed_attribute=one))
        found.append(results(scene))
        scene.remove_energy(primitive[name])
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-13)


def test_a_jacobian_behind_a_join() -> None:
    """Points on circles: the Jacobian of a parameterisation is given, and curvature is what differentiates it."""

    def made(is_given: bool) -> list[FloatArray]:
        scene = Scene("circles")
        mesh = scene.add_mesh("m")
        arms = mesh.add_primitive("arms", 3)
        angle = arms.add_attribute("angle", 1, 1, value=[0.3, 1.9, -2.0])
        place = concat_rows([angle.cos(), angle.sin()])
        if is_given:
            place = place.with_derivatives(angle, concat_rows([-angle.sin(), angle.cos()]))
        arms.add_attribute("place", computed_attribute=place)
        links = mesh.add_primitive("links", 2)
        ends = links.add_connectivity("ends", arms, [[0, 1], [1, 2]], 2)
        both = links.add_attribute("both", through=ends, source=arms["place"])
        d = both.row(1) - both.row(0)
        scene.add_energy(links.add_attribute("energy", computed_attribute=(d.dot(d) - 1.0) ** 2))
        scene.add_minimize_target(angle)
        return results(scene)

    for found, wanted in zip(made(True), made(False), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-13)


def test_wrong_derivatives_are_refused() -> None:
    """With the entry, the numbers it was found at, and both values."""
    _, _, d, k = springs()
    e, g, h = energy(d, k), gradient(d, k), hessian(d, k)
    message = (
        r"gradient given of m\.springs\.an expression \(made at .*:\d+\) is not what is derived: at random numbers 0, "
    )
    with pytest.raises(SceneError, match=message + r"entry \[1, 0\] by .* is .* and should be .*\. There, .* = \[\["):
        e.with_derivatives(d, g + constant([0.0, 1e-4, 0.0]))
    with pytest.raises(SceneError, match=r"the Hessian given .*entry \[2, 0\] is"):
        e.with_derivatives(d, g, hessian=h + constant([[0.0, 0, 0], [0, 0, 0], [1e-3, 0, 0]]))
    values, vectors = eigensystem(d, k)
    with pytest.raises(SceneError, match="the Hessian given"):
        e.with_derivatives(d, g, eigensystem=(2.0 * values, vectors))
    with pytest.raises(SceneError, match=r"the product Q\^T Q of the eigenvectors given"):
        e.with_derivatives(d, g, eigensystem=(0.25 * values, 2.0 * vectors))
    with pytest.raises(SceneError, match="the gradient given"):  # finite where it should be, and NaN where it is
        e.with_derivatives(d, g + 0.0 * (d.dot(d) - 0.5).log() * d)
    with pytest.raises(SceneError, match="it and its derivatives are finite at none of 48 sets"):
        (e * (-1.0 - d.dot(d)).log()).with_derivatives(d, g)
    with pytest.raises(SceneError, match="the Jacobian given"):
        d.with_derivatives(d, 2.0 * identity(3))


def test_wrong_arguments_are_refused() -> None:
    _, _, d, k = springs()
    e, g = energy(d, k), gradient(d, k)
    with pytest.raises(SceneError, match="named twice"):
        e.with_derivatives([d, d], [g, g])
    with pytest.raises(SceneError, match="need the attributes"):
        e.with_derivatives([], [])
    with pytest.raises(SceneError, match="or its eigensystem"):
        e.with_derivatives(d, g, hessian=hessian(d, k), eigensystem=eigensystem(d, k))
    with pytest.raises(ShapeMismatchError, match="one gradient for each of 2 arguments, got 1"):
        e.with_derivatives([d, k], g)
    with pytest.raises(ShapeMismatchError, match="must be 3x1, got 1x3"):
        e.with_derivatives(d, g.T)
    with pytest.raises(ShapeMismatchError, match="a Hessian with respect to 3 entries must be 3x3, got 3x1"):
        e.with_derivatives(d, g, hessian=d)
    with pytest.raises(ShapeMismatchError, match="eigenvectors, one in each column, must be 3x3, got 1x3"):
        e.with_derivatives(d, g, eigensystem=(d, d.T))
    with pytest.raises(ShapeMismatchError, match="a Hessian can be given of a 1x1 attribute"):
        d.with_derivatives(d, identity(3), hessian=identity(3))
    with pytest.raises(ShapeMismatchError, match="the Jacobian of 3 entries by 3 must be 3x3, got 1x1"):
        d.with_derivatives(d, constant(1.0))
