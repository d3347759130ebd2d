"""Eigenvalues, rotations, singular values: Jacobi's method; derivatives against many digits, at equal values too."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from mat_bodies import lower_and_run, run_block
from mat_examples import Example
from numpy.typing import NDArray
from small_scenes import dense_assembly, emit

from yasps import Attribute, NotFiniteError, Scene, ShapeMismatchError, eigenvalues, polar, select, singular_values
from yasps.dialects.mat import MatBuilder
from yasps.dialects.mat.spectral import EigenvaluesOp, PolarOp, SpectralOp
from yasps.passes.pipeline import run_pipeline

Array = NDArray[np.float64]
COUNT = 2000


def rotations(random: np.random.Generator, count: int = COUNT, size: int = 3) -> Array:
    """Orthogonal matrices, of both signs."""
    q, _ = np.linalg.qr(random.standard_normal((count, size, size)))
    return np.asarray(q)


def values_of(random: np.random.Generator) -> dict[str, Array]:
    """Eigenvalues that are hard to tell from each other, or from 0, [COUNT, 3]."""
    one, near = np.ones(COUNT), 10.0 ** random.uniform(-16, 0, COUNT)
    return {
        "all near": 1 + 10.0 ** random.uniform(-16, 0, (COUNT, 3)),
        "two near": np.stack([one, 1 + near, 3 * random.standard_normal(COUNT)], axis=1),
        "opposite": np.stack([one, near - 1, random.standard_normal(COUNT)], axis=1),
        "graded": 10.0 ** random.uniform(-12, 3, (COUNT, 3)),
        "equal": np.stack([one, one, 2 * one], axis=1),
        "one zero": np.stack([one, random.uniform(0.1, 1, COUNT), 0 * one], axis=1),
    }


def matrices(random: np.random.Generator) -> dict[str, Array]:
    """Matrices of any kind."""
    return {
        "random": random.standard_normal((COUNT, 3, 3)),
        "small integers": random.integers(-2, 3, (COUNT, 3, 3)).astype(float),
        "entries far apart": 10.0 ** random.uniform(-8, 2, (COUNT, 3, 3)) * random.choice([-1.0, 1.0], (COUNT, 3, 3)),
        "parallel columns": random.standard_normal((COUNT, 3, 1)) + 1e-6 * random.standard_normal((COUNT, 3, 3)),
    }


def test_five_sweeps_find_all_eigenvalues() -> None:
    random = np.random.default_rng(0)
    cases = {name: a + a.swapaxes(1, 2) for name, a in matrices(random).items()}
    for name, values in values_of(random).items():
        q = rotations(random)
        cases[name] = q @ (values[:, :, None] * q.swapaxes(1, 2))
    _, op = Example(EigenvaluesOp, ((3, 3),)).build()
    for name, a in cases.items():
        found = lower_and_run(op, [a])[:, :, 0]
        size = np.abs(a).max(axis=(1, 2))
        assert (np.abs(found - np.linalg.eigvalsh(0.5 * (a + a.swapaxes(1, 2)))).max(axis=1) < 1e-14 * size).all(), name
        assert (np.diff(found, axis=1) >= -1e-15 * size[:, None]).all(), name


def test_five_sweeps_find_the_rotation() -> None:
    """A rotation, and S = R^T F symmetric with at most one negative eigenvalue, the least in size."""
    random = np.random.default_rng(1)
    cases = matrices(random)
    for name, values in values_of(random).items():
        cases[name] = rotations(random) @ (values[:, :, None] * rotations(random))
    _, op = Example(PolarOp, ((3, 3),)).build()
    for name, all_of_them in cases.items():
        sizes = np.linalg.svd(all_of_them, compute_uv=False)
        f = all_of_them[sizes[:, 1] > 1e-10 * sizes[:, 0]]
        sizes = np.linalg.svd(f, compute_uv=False)
        with np.errstate(all="ignore"):
            found = lower_and_run(op, [f])
        stretch = found.swapaxes(1, 2) @ f
        assert np.abs(found.swapaxes(1, 2) @ found - np.eye(3)).max() < 1e-14, name
        assert (np.linalg.det(found) > 0).all(), name
        size = sizes[:, :1]
        assert (np.abs(stretch - stretch.swapaxes(1, 2)).max(axis=(1, 2)) < 1e-14 * size[:, 0]).all(), name
        signed = np.linalg.eigvalsh(0.5 * (stretch + stretch.swapaxes(1, 2)))[:, ::-1]
        sizes[:, 2] *= np.sign(np.linalg.det(f))
        assert (np.abs(signed - sizes) < 1e-14 * size).all(), name


def test_tangent_of_a_spectral_function() -> None:
    """Of Q diag(c) Q^T with c = exp(l), against the tangent of the exponential of a matrix in many digits."""
    random = np.random.default_rng(2)
    half, da = random.standard_normal((2, 3, 3))
    a, da = half + half.T, da + da.T
    values = np.linalg.eigvalsh(a)
    slopes = np.exp(values)
    quotients = [(slopes[j] - slopes[i]) / (values[j] - values[i]) for i, j in ((0, 1), (0, 2), (1, 2))]
    block, op = Example(SpectralOp, ((3, 3), (3, 1), (3, 1))).build(extra=((3, 3),))
    b = MatBuilder(block)
    # c changes with a, too: dl_k exp(l_k), of which the op itself knows nothing
    along = op.pushforward(b, [block.args[3], None, None])
    assert along is not None
    numbers = [a, slopes[:, None], np.array(quotients)[:, None], da]
    found = run_block(block, [array[None] for array in numbers])[along][0]
    _, vectors = np.linalg.eigh(a)
    found = found + vectors @ np.diag(slopes * np.diag(vectors.T @ da @ vectors)) @ vectors.T
    with mpmath.workdps(50):
        step = mpmath.mpf(10) ** -15
        two = [mpmath.expm(mpmath.matrix(a.tolist()) + s * step * mpmath.matrix(da.tolist())) for s in (1, -1)]
        wanted = np.array(((two[0] - two[1]) / (2 * step)).tolist(), float)
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-13)


# -- second derivatives ----------------------------------------------------------------------------------------


def derivatives(build: Callable[[Attribute], Attribute], at: Array) -> tuple[Array, Array]:
    """Gradients and Hessians of a function of a matrix at these matrices, by what kernels compute."""
    scene = Scene("s")
    cells = scene.add_mesh("m").add_primitive("c", len(at))
    a = cells.add_attribute("a", *at.shape[1:], value=at)
    scene.add_energy(cells.add_attribute("e", computed_attribute=build(a)), projection="none")
    scene.add_minimize_target(a)
    emitted = emit(scene)
    gradient, hessian = dense_assembly(run_pipeline(emitted.module), emitted.data)
    size = at[0].size
    blocks = hessian.reshape(len(at), size, len(at), size)
    return gradient.reshape(len(at), size), np.stack([blocks[k, :, k] for k in range(len(at))])


def in_many_digits(function: Callable[[Any], Any], at: Array) -> tuple[Array, Array]:
    """Gradient and Hessian by central differences with sixty digits."""
    places = list(np.ndindex(at.shape))
    with mpmath.workdps(60):
        step, middle = mpmath.mpf(10) ** -15, mpmath.matrix(at.tolist())

        def moved(*steps: tuple[tuple[int, int], int]) -> Any:
            there = middle.copy()
            for place, sign in steps:
                there[place] += sign * step
            return function(there)

        gradient = [(moved((p, 1)) - moved((p, -1))) / (2 * step) for p in places]
        hessian = np.zeros((len(places), len(places)))
        for k, p in enumerate(places):
            for m, q in enumerate(places[k:], k):
                four = [moved((p, s), (q, t)) * s * t for s in (1, -1) for t in (1, -1)]
                hessian[k, m] = hessian[m, k] = float(sum(four) / (4 * step * step))
    return np.array(gradient, float), hessian


def agree(build: Callable[[Attribute], Attribute], function: Callable[[Any], Any], at: Array, digits: float) -> None:
    gradients, hessians = derivatives(build, at)
    for matrix, gradient, hessian in zip(at, gradients, hessians, strict=True):
        wanted = in_many_digits(function, matrix)
        size = np.abs(wanted[1]).max()
        np.testing.assert_allclose(gradient, wanted[0], rtol=digits, atol=digits * size)
        np.testing.assert_allclose(hessian, wanted[1], rtol=0, atol=digits * size)


def eigenvalues_in_many_digits(a: Any) -> list[Any]:
    return list(mpmath.eigsy((a + a.T) / 2, eigvals_only=True))


def _hencky(values: Attribute) -> Attribute:
    return values.log().dot(values.log())


def _ogden(values: Attribute) -> Attribute:
    """Not a sum over eigenvalues."""
    return (values**1.3).sum() + 2 * (values[0] * values[1] * values[2]) ** -1


def _cubes(values: Attribute) -> Attribute:
    """With a kink in the second derivative."""
    return sum((select(value > 1.05, (value - 1.05) ** 3, 0) for value in values), values[0] * 0)


SYMMETRIC: dict[str, tuple[Callable[[Attribute], Attribute], Callable[[Any], Any]]] = {
    "Hencky": (_hencky, lambda a: sum(mpmath.log(x) ** 2 for x in eigenvalues_in_many_digits(a))),
    "Ogden": (
        _ogden,
        lambda a: sum(x ** mpmath.mpf(1.3) for x in eigenvalues_in_many_digits(a)) + 2 / mpmath.det((a + a.T) / 2),
    ),
    "cubes": (
        _cubes,
        lambda a: sum(max(x - mpmath.mpf(1.05), 0) ** 3 for x in eigenvalues_in_many_digits(a)),
    ),
}
GAPS = (1e-15, 1e-5, 1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Hencky", *(pytest.param(n, marks=pytest.mark.nightly) for n in ("Ogden", "cubes"))])
def test_symmetric_functions_where_eigenvalues_are_nearly_equal(name: str) -> None:
    """To rounding, however near; exactly equal ones too. Beside 1.05 the cubes begin."""
    build, function = SYMMETRIC[name]
    turn = rotations(np.random.default_rng(3), 1)[0]
    at = [np.diag([1.05, 2.0, 1.05]), 1.2 * np.eye(3)]
    for gap in GAPS:
        a = turn @ np.diag([1.05 + 0.6 * gap, 2.0, 1.05 - 0.4 * gap]) @ turn.T
        at.append(0.5 * (a + a.T))
    agree(lambda a: build(eigenvalues(a)), function, np.array(at), 2e-13)


def test_two_by_two() -> None:
    at = np.array([np.eye(2), np.diag([1.0, 1.0 + 1e-7]), [[2.0, 0.3], [0.3, 1.0]]])
    agree(lambda a: _hencky(eigenvalues(a)), SYMMETRIC["Hencky"][1], at, 2e-13)


def test_single_eigenvalues() -> None:
    """Right where they are apart; where two are equal those two have no derivative, the third one has."""
    a = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, -0.2], [0.1, -0.2, 0.5]])
    agree(lambda a: eigenvalues(a)[1], lambda a: eigenvalues_in_many_digits(a)[1], a[None], 1e-13)
    equal = np.diag([1.0, 3.0, 1.0])
    for k, smooth in ((0, False), (1, False), (2, True)):
        gradient, hessian = derivatives(lambda a, k=k: eigenvalues(a)[k], equal[None])
        assert np.isfinite(gradient).all() == smooth
        assert np.isfinite(hessian).all() == smooth


def test_equal_slopes_by_chance_are_no_symmetry() -> None:
    """(l_0 - 1)^2 + 2 (l_1 - 1)^2 + ... has the gradient 0 at the identity, and curvature that no matrix can say."""

    def weighted(a: Attribute) -> Attribute:
        over = eigenvalues(a) - 1
        return over.hadamard(over).dot(np.array([[1.0], [2.0], [3.0]]))

    _, hessian = derivatives(weighted, np.array([np.eye(3), np.diag([0.5, 1.0, 2.0])]))
    assert not np.isfinite(hessian[0]).any()
    assert np.isfinite(hessian[1]).all()


def behind_a_join(at: Array) -> tuple[Array, Array]:
    """Gradient and Hessian of a Hencky energy whose eigenvalues are an attribute of another primitive."""
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    cells, sums = mesh.add_primitive("c", 1), mesh.add_primitive("s", 1)
    a = cells.add_attribute("a", 3, 3, value=at)
    values = cells.add_attribute("values", computed_attribute=eigenvalues(a))
    joined = sums.add_attribute("values", through=sums.add_connectivity("of", cells, [0], 1), source=values)
    scene.add_energy(sums.add_attribute("e", computed_attribute=_hencky(joined)), projection="none")
    scene.add_minimize_target(a)
    emitted = emit(scene)
    return dense_assembly(run_pipeline(emitted.module), emitted.data)


def test_eigenvalues_behind_a_join() -> None:
    """Right while they are apart; where two are equal nobody knows that the energy is symmetric, and it is reported."""
    at = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, -0.2], [0.1, -0.2, 0.5]])
    gradients, hessians = derivatives(lambda a: _hencky(eigenvalues(a)), at[None])
    gradient, hessian = behind_a_join(at)
    np.testing.assert_allclose(gradient, gradients[0], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(hessian, hessians[0], rtol=1e-11, atol=1e-12)
    _, hessian = behind_a_join(np.diag([1.0, 2.0, 1.0]))
    assert not np.isfinite(hessian).all()


@pytest.mark.slow
def test_a_scene_names_the_instance_without_a_derivative() -> None:
    scene = Scene("s")
    cells = scene.add_mesh("m").add_primitive("c", 3)
    a = cells.add_attribute("a", 3, 3, value=[np.diag([1.0, 2.0, 3.0]), np.diag([1.0, 1.0, 3.0]), np.diag([5.0, 4, 3])])
    scene.add_energy(cells.add_attribute("least", computed_attribute=eigenvalues(a)[0]))
    scene.add_minimize_target(a)
    for result in (scene.gradient, scene.hessian):
        with pytest.raises(NotFiniteError, match=r"instance 1 of .*least|least.*instance 1"):
            result()


# -- rotations and singular values -----------------------------------------------------------------------------


def decomposed_in_many_digits(f: Any) -> tuple[Any, Any]:
    """Rotation, and singular values of which the last has the sign of det F."""
    left, sizes, right = mpmath.svd_r(f)
    sign = mpmath.sign(mpmath.det(left) * mpmath.det(right))
    last = f.cols - 1
    flip = mpmath.diag([1] * last + [sign])
    return left * flip * right, [*list(sizes)[:last], sign * sizes[last]]


WEIGHTS = np.array([[1.0, -2.0, 0.5], [0.3, 1.5, 0.7], [-0.6, 0.2, 2.0]])
STATES = {
    "any": [[1.2, 0.3, -0.1], [0.2, 0.8, 0.4], [0.0, -0.3, 1.1]],
    "at rest": np.eye(3).tolist(),
    "flat": [[1.0, 0.2, 0.0], [0.1, 0.9, 0.0], [0.3, 0.1, 0.0]],
    "inverted": [[1.0, 0.2, 0.1], [0.1, 0.9, 0.2], [0.3, 0.1, -0.3]],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["flat", *(pytest.param(n, marks=pytest.mark.nightly) for n in STATES if n != "flat")])
def test_derivatives_of_the_rotation(name: str) -> None:
    at = np.array([STATES[name]])
    weights = mpmath.matrix(WEIGHTS.tolist())

    def function(f: Any) -> Any:
        rotation, _ = decomposed_in_many_digits(f)
        return sum(w * r for w, r in zip(weights, rotation, strict=True))

    agree(lambda f: polar(f).dot(WEIGHTS), function, at, 1e-12)


def test_opposite_singular_values_leave_no_derivative() -> None:
    """Two rotations are equally near, turned half a turn about the first axis; of rank one there are many more."""
    at = np.array([np.diag([2.0, 0.5, -0.5]), np.diag([2.0, 0.0, 0.0]), np.diag([2.0, 0.5, -0.4])])
    gradient, hessian = derivatives(lambda f: polar(f).dot(WEIGHTS), at)
    for k, smooth in enumerate((False, False, True)):
        assert np.isfinite(gradient[k]).all() == smooth
        assert np.isfinite(hessian[k]).all() == smooth


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["at rest", "any", "inverted"])
def test_derivatives_of_symmetric_functions_of_singular_values(name: str) -> None:
    def function(f: Any) -> Any:
        _, sizes = decomposed_in_many_digits(f)
        return sum((s - 1) ** 4 + s for s in sizes)

    def build(f: Attribute) -> Attribute:
        sizes = singular_values(f)
        return ((sizes - 1) ** 4).sum() + sizes.sum()

    agree(build, function, np.array([STATES[name]]), 1e-12)


def test_singular_values_of_all_shapes() -> None:
    random = np.random.default_rng(5)
    for shape in ((2, 2), (3, 3), (3, 2)):
        f = random.standard_normal((20, *shape))
        cells = Scene("s").add_mesh("m").add_primitive("c", 20)
        found = cells.add_attribute(
            "sizes", computed_attribute=singular_values(cells.add_attribute("f", *shape, value=f))
        )
        wanted = np.linalg.svd(f, compute_uv=False)
        if shape[0] == shape[1]:
            wanted[:, -1] *= np.sign(np.linalg.det(f))
        np.testing.assert_allclose(found.compute().array[:, :, 0], wanted, atol=1e-14)


def test_sheets_and_plane_matrices() -> None:
    """Smooth functions of the singular values of 2x2 and 3x2, equal ones too, are what they are by invariants."""

    def by_invariants(f: Attribute) -> Attribute:
        right = f.T * f
        return right.dot(right) + right.trace()  # sum of s^4 + s^2

    def by_values(f: Attribute) -> Attribute:
        sizes = singular_values(f)
        return (sizes**4).sum() + (sizes**2).sum()

    random = np.random.default_rng(6)
    for shape in ((2, 2), (3, 2)):
        at = np.concatenate([random.standard_normal((3, *shape)), np.eye(*shape)[None], 1.5 * np.eye(*shape)[None]])
        for found, wanted in zip(derivatives(by_values, at), derivatives(by_invariants, at), strict=True):
            np.testing.assert_allclose(found, wanted, atol=1e-12 * np.abs(wanted).max())


def test_plane_rotations() -> None:
    f = np.random.default_rng(7).standard_normal((10, 2, 2))
    cells = Scene("s").add_mesh("m").add_primitive("c", 10)
    rotation = cells.add_attribute("r", computed_attribute=polar(cells.add_attribute("f", 2, 2, value=f)))
    found = rotation.compute().array
    stretch = found.swapaxes(1, 2) @ f
    np.testing.assert_allclose(found.swapaxes(1, 2) @ found, np.tile(np.eye(2), (10, 1, 1)), atol=1e-15)
    np.testing.assert_allclose(stretch, stretch.swapaxes(1, 2), atol=1e-15)
    assert (np.trace(stretch, axis1=1, axis2=2) > 0).all()


def test_other_shapes_are_named() -> None:
    a = Scene("s").add_mesh("m").add_primitive("c", 1).add_attribute("a", 4, 4)
    with pytest.raises(ShapeMismatchError, match=r"an eigenvalue needs a matrix of 2x2 or 3x3, got .*4x4"):
        eigenvalues(a)
    with pytest.raises(ShapeMismatchError, match=r"a polar decomposition needs a 3x3 matrix"):
        polar(a)
    with pytest.raises(ShapeMismatchError, match=r"singular values are available of 2x2, 3x3 and 3x2, got m\.c\.a"):
        singular_values(a)
