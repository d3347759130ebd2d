"""What NumPy users try first: broadcasting of numbers, indices and slices, iteration, NumPy's own functions."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from yasps import Attribute, DataError, Scene, SceneError, ShapeMismatchError

rng = np.random.default_rng(3)
V, W, R = (rng.uniform(0.2, 0.9, shape) for shape in ((3, 1), (3, 1), (1, 3)))
M, N = rng.normal(size=(3, 4)), rng.normal(size=(3, 3))


@pytest.fixture(scope="module")
def symbols() -> dict[str, Attribute]:
    scene = Scene("s", threads=1)
    points = scene.add_mesh("m").add_primitive("p", 1)
    return {name: points.add_attribute(name, *value.shape, value=value) for name, value in NUMBERS.items()}


NUMBERS = {"v": V, "w": W, "m": M, "n": N, "r": R}
VALUES: dict[str, tuple[Callable[[Any], Any], Any]] = {
    "number + vector": (lambda a: 1.5 + a.v, 1.5 + V),
    "vector + number": (lambda a: a.v + 1.5, V + 1.5),
    "number - matrix": (lambda a: 2 - a.m, 2 - M),
    "matrix - number": (lambda a: a.m - 2, M - 2),
    "matrix + 1x1 attribute": (lambda a: a.m + a.v[0], M + V[0]),
    "vector < number": (lambda a: a.v < 0.5, V < 0.5),
    "number <= matrix": (lambda a: 0.1 <= a.m, M >= 0.1),  # noqa: SIM300 - that is what is tried
    "+a": (lambda a: +a.v, V),
    "2 ** a": (lambda a: 2**a.v, 2**V),
    "np.maximum(a, 0.5)": (lambda a: np.maximum(a.v, 0.5), np.maximum(V, 0.5)),
    "np.minimum(0.5, a)": (lambda a: np.minimum(0.5, a.v), np.minimum(V, 0.5)),
    "a[1:3]": (lambda a: a.v[1:3], V[1:3]),
    "a[-1]": (lambda a: a.v[-1], V[-1:]),
    "a[::2]": (lambda a: a.v[::2], V[::2]),
    "a[::-1]": (lambda a: a.v[::-1], V[::-1]),
    "row vector [1:]": (lambda a: a.r[1:], R[:, 1:]),
    "A[0, :]": (lambda a: a.m[0, :], M[:1]),
    "A[:, 1]": (lambda a: a.m[:, 1], M[:, 1:2]),
    "A[..., 0]": (lambda a: a.m[..., 0], M[:, :1]),
    "A[0, ...]": (lambda a: a.m[0, ...], M[:1]),
    "A[1]": (lambda a: a.m[1], M[1:2]),
    "A[1:, ::2]": (lambda a: a.m[1:, ::2], M[1:, ::2]),
    "A[2, 3]": (lambda a: a.m[2, 3], M[2:, 3:]),
    "a[...]": (lambda a: a.v[...], V),
    "reshape(-1, 1)": (lambda a: a.m.reshape(-1, 1), M.reshape(-1, 1)),
    "reshape(6, -1)": (lambda a: a.m.reshape(6, -1), M.reshape(6, -1)),
    "reshape((2, 6))": (lambda a: a.m.reshape((2, 6)), M.reshape(2, 6)),
    "flatten()": (lambda a: a.m.flatten(), M.reshape(-1, 1)),
    "np.where": (lambda a: np.where(a.v < 0.5, a.v, 0.0), np.where(V < 0.5, V, 0.0)),
    "np.sin": (lambda a: np.sin(a.v), np.sin(V)),
    "np.arctan2": (lambda a: np.arctan2(a.v, 1.0), np.arctan2(V, 1.0)),
    "np.sqrt": (lambda a: np.sqrt(a.v), np.sqrt(V)),
    "np.linalg.norm": (lambda a: np.linalg.norm(a.m), np.linalg.norm(M)),
    "np.linalg.det": (lambda a: np.linalg.det(a.n), np.linalg.det(N)),
    "np.linalg.inv": (lambda a: np.linalg.inv(a.n), np.linalg.inv(N)),
    "np.linalg.eigvalsh": (lambda a: np.linalg.eigvalsh(a.n.T @ a.n), np.linalg.eigvalsh(N.T @ N)[:, None]),
    "np.cross": (lambda a: np.cross(a.v, a.w), np.cross(V.T, W.T).T),
    "np.dot of vectors": (lambda a: np.dot(a.v, a.r), V[:, 0] @ R[0]),
    "np.dot of matrices": (lambda a: np.dot(a.n, a.m), N @ M),
    "np.stack": (lambda a: np.stack([a.v, a.w]), np.concatenate([V.T, W.T])),
    "np.stack axis 1": (lambda a: np.stack([a.v, a.w], axis=1), np.concatenate([V, W], axis=1)),
    "np.concatenate": (lambda a: np.concatenate([a.v, a.w]), np.concatenate([V, W])),
    "np.hstack": (lambda a: np.hstack([a.v, a.n]), np.hstack([V, N])),
    "np.trace": (lambda a: np.trace(a.n), np.trace(N)),
    "np.sum": (lambda a: np.sum(a.m), M.sum()),
    "np.transpose": (lambda a: np.transpose(a.m), M.T),
    "array @ attribute": (lambda a: N @ a.m, N @ M),
    "array + attribute": (lambda a: W + a.v, W + V),
    "array * attribute is the product": (lambda a: N * a.m, N @ M),
    "a & b": (lambda a: (a.v < 0.6) & (a.w < 0.6), (V < 0.6) & (W < 0.6)),
    "a | b": (lambda a: (a.v < 0.4) | (a.w < 0.4), (V < 0.4) | (W < 0.4)),
    "~a": (lambda a: ~(a.v < 0.5), ~(V < 0.5)),
    "a & 1x1": (lambda a: (a.v < 0.6) & (a.w[0] < 0.6), (V < 0.6) & (W[0] < 0.6)),
}


class Names:
    """Attributes by name."""

    def __init__(self, symbols: dict[str, Attribute]) -> None:
        self.__dict__.update(symbols)


def test_values_are_numpys(symbols: dict[str, Attribute]) -> None:
    """All in one attribute, so that they compile once."""
    results = {case: build(Names(symbols)) for case, (build, _) in VALUES.items()}
    for case, (_, expected) in VALUES.items():
        shape = np.atleast_2d(expected).shape
        assert results[case].shape == shape, case
    packed = np.concatenate([result.flatten() for result in results.values()])
    primitive = next(iter(symbols.values())).owner
    assert primitive is not None
    computed = primitive.add_attribute("packed", computed_attribute=packed).value
    start = 0
    for case, (_, expected) in VALUES.items():
        numbers = np.asarray(expected, dtype=float).reshape(-1)
        found = computed[start : start + numbers.size]
        np.testing.assert_allclose(found, numbers, rtol=1e-14, atol=1e-15, err_msg=case)
        start += numbers.size


def test_unpacking_iteration_and_length(symbols: dict[str, Attribute]) -> None:
    x, y, z = symbols["v"]
    assert {part.shape for part in (x, y, z)} == {(1, 1)}
    assert [row.shape for row in symbols["m"]] == [(1, 4)] * 3
    assert [len(symbols[name]) for name in ("v", "r", "m")] == [3, 3, 3]
    assert (symbols["m"].ndim, symbols["m"].size) == (2, 12)
    assert (np.ndim(symbols["m"]), np.size(symbols["m"]), np.shape(symbols["m"])) == (2, 12, (3, 4))
    assert symbols["v"] in list(symbols.values())  # `==` tells attributes apart


REFUSED: dict[str, tuple[Callable[[Any], Any], type[Exception], str]] = {
    "an index out of range": (lambda a: a.v[3], ShapeMismatchError, "no row 3"),
    "a slice of nothing": (lambda a: a.v[3:], ShapeMismatchError, "chooses no row"),
    "three indices": (lambda a: a.m[0, 0, 0], ShapeMismatchError, "got 3 indices"),
    "a mask": (lambda a: a.v[np.array([True, False, True])], ShapeMismatchError, "must be an integer"),
    "column + row": (lambda a: a.v + a.r, ShapeMismatchError, "3x1"),
    "reshape to a wrong size": (lambda a: a.m.reshape(-1, 5), ShapeMismatchError, "reshape"),
    "reshape(12)": (lambda a: a.m.reshape(12), ShapeMismatchError, "one may be -1"),
    "a negative base": (lambda a: (-2) ** a.v, DataError, "base"),
    "np.fft.fft": (lambda a: np.fft.fft(a.v), SceneError, "no meaning for attributes.*linalg.norm"),
    "np.floor": (lambda a: np.floor(a.v), SceneError, "np.floor has no meaning"),
    "out=": (lambda a: np.add(a.v, a.v, out=np.zeros((3, 1))), SceneError, "out="),
    "np.add.reduce": (lambda a: np.add.reduce(a.v), SceneError, "np.add.reduce"),
    "np.linalg.norm of an axis": (lambda a: np.linalg.norm(a.m, axis=0), SceneError, "np.linalg.norm.*axis"),
    "np.stack of matrices": (lambda a: np.stack([a.m, a.m]), ShapeMismatchError, "third axis"),
    "np.array": (lambda a: np.array(a.v), SceneError, "symbolic"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused(case: str, symbols: dict[str, Attribute]) -> None:
    build, error, words = REFUSED[case]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(error, match=words):
            build(Names(symbols))
