"""`mat` operations on the eigenvalues of symmetric matrices and on the rotation that is nearest to a matrix.

Their scalar code is Jacobi's method, written out: a fixed number of rotations, after which any matrix is diagonal to
rounding. There is no loop to leave early, and lanes of a pack have nothing to wait for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, cast

import numpy as np
from xdsl.ir import Attribute, SSAValue
from xdsl.irdl import irdl_op_definition

from yasps.dialects.mat.base import Batch, MatOp, Shape, ShapeError, shape_of, spell
from yasps.dialects.scalar.graph import Node, ScalarGraph

if TYPE_CHECKING:
    from yasps.dialects.mat.builder import MatBuilder

SIZES = (2, 3)
"""Of the matrices that these operations take, from the least to the largest."""
SWEEPS = {2: 1, 3: 5}
"""Of Jacobi's method over all pairs of rows of a symmetric matrix of this size, or of columns of any. Measured on some
million matrices with values near each other, far apart, equal and opposite: four sweeps of 3x3 leave 1e-8 of the matrix
beside the diagonal, and each sweep takes the third power of what is there; after five it is rounding."""
SMALLEST_SQUARE = 1e-300
"""Squares below this are 0: what is so small is not turned."""
LARGEST = float(np.finfo(np.float64).max)


def pairs(size: int) -> list[tuple[int, int]]:
    """(0, 1), (0, 2), (1, 2): of which divided differences are listed in this order."""
    return [(i, j) for i in range(size) for j in range(i + 1, size)]


def decomposition(a: Batch) -> tuple[Batch, Batch]:
    """Ascending eigenvalues [n, k] and eigenvectors [n, k, k] of the real symmetric parts."""
    values, vectors = np.linalg.eigh(symmetric_part(np.real(a).astype(float)))
    return values, vectors


def symmetric_part(a: Batch) -> Batch:
    """(A + A^T) / 2."""
    return 0.5 * (a + a.swapaxes(1, 2))


def _small_square(word: str, shape: Shape) -> int:
    if shape[0] != shape[1] or shape[0] not in SIZES:
        raise ShapeError(f"{word} needs a matrix of 2x2 or 3x3, got {spell(shape)}")
    return shape[0]


def _in_basis(vectors: Batch, a: Batch) -> Batch:
    """Q^T a Q of the symmetric part of a."""
    return vectors.swapaxes(1, 2) @ symmetric_part(a) @ vectors


@irdl_op_definition
class EigenvaluesOp(MatOp):
    """Eigenvalues of the symmetric part of a matrix, ascending, one column.

    Where two are equal neither has a derivative; what is symmetric in them has one. Reverse mode sees to that:
    `passes/calculus/divided_differences.py`.
    """

    name = "mat.eigenvalues"
    ARITY: ClassVar = 1

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return _small_square("an eigenvalue", shapes[0]), 1

    def evaluate(self, *inputs: Batch) -> Batch:
        values, vectors = decomposition(inputs[0])
        if not np.iscomplexobj(inputs[0]):
            return values[:, :, None]
        turned = _in_basis(vectors, inputs[0].imag)
        return (values + 1j * np.diagonal(turned, axis1=1, axis2=2))[:, :, None]

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        (da,) = tangents
        if da is None:
            return None
        a, size = self.operands[0], shape_of(self.result)[0]
        held = b.zeros((len(pairs(size)), 1))  # a tangent is not differentiated again
        return b.concat_rows([b.dot(b.spectral(a, b.unit((size, 1), k), held), da) for k in range(size)])

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return (b.spectral(self.operands[0], cotangent),)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return eigensystem(s, inputs[0])[0]


@irdl_op_definition
class SpectralOp(MatOp):
    """Q diag(c) Q^T with the eigenvectors Q of the symmetric part of a matrix, in the order of `mat.eigenvalues`.

    The derivative of f(eigenvalues) where c is that of f. The third operand are the divided differences of c, one for
    each pair: (c_j - c_i) / (l_j - l_i), and its limit where the eigenvalues l are equal. The derivative of the result
    needs them; where one is infinite f has no derivative, and the result is not finite. Being a first derivative it is
    pushed forward once, and nothing else.
    """

    name = "mat.spectral"
    ARITY: ClassVar = 3
    DIFFERENTIABLE: ClassVar = False
    HELD_OPERANDS: ClassVar = (2,)

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        size = _small_square("a spectral function", shapes[0])
        _check_differences(size, shapes[2])
        if shapes[1] != (size, 1):
            raise ShapeError(f"a {size}x{size} matrix has {size}x1 eigenvalues, got {spell(shapes[1])}")
        return size, size

    def evaluate(self, *inputs: Batch) -> Batch:
        a, slopes, differences = inputs
        _, vectors = decomposition(a)
        infinite = np.where(np.isfinite(differences), 0, differences).sum(axis=1, keepdims=True)
        middle = np.eye(a.shape[1]) * (slopes + infinite).swapaxes(1, 2)
        if np.iscomplexobj(a):
            middle = middle + 1j * off_diagonal(differences) * _in_basis(vectors, a.imag)
        return cast(Batch, vectors @ middle @ vectors.swapaxes(1, 2))

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        a, _, differences = self.operands
        da, dslopes, _ = tangents
        held = b.zeros(shape_of(differences))  # a tangent is not differentiated again
        along = dslopes and b.spectral(a, dslopes, held)
        return b.total((along, da and b.spectral_tangent(a, differences, da)))

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        _, vectors = eigensystem(s, inputs[0])
        size = len(vectors)
        infinite = s.zero
        for difference in inputs[2]:
            is_finite = s.compare("le", s.unary("abs", difference), s.constant(LARGEST))
            infinite = s.add(infinite, s.select(is_finite, s.zero, difference))
        factors = [s.add(slope, infinite) for slope in inputs[1]]
        scaled = [[s.mul(factor, entry) for entry in vector] for factor, vector in zip(factors, vectors, strict=True)]
        return [
            s.sum([s.mul(scaled[k][min(i, j)], vectors[k][max(i, j)]) for k in range(size)])
            for i in range(size)
            for j in range(size)
        ]


@irdl_op_definition
class SpectralTangentOp(MatOp):
    """How `mat.spectral` changes with its matrix, all c held: Q (D o Q^T da Q) Q^T.

    D has zeros on its diagonal and the divided differences beside it.
    """

    name = "mat.spectral_tangent"
    ARITY: ClassVar = 3
    DIFFERENTIABLE: ClassVar = False

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        size = _small_square("a spectral function", shapes[0])
        _check_differences(size, shapes[1])
        if shapes[2] != shapes[0]:
            raise ShapeError(f"the tangent of a {spell(shapes[0])} matrix has its shape, got {spell(shapes[2])}")
        return shapes[0]

    def evaluate(self, *inputs: Batch) -> Batch:
        a, differences, da = inputs
        _, vectors = decomposition(a)
        turned = _in_basis(vectors, da)
        return cast(Batch, vectors @ (off_diagonal(differences) * turned) @ vectors.swapaxes(1, 2))

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        _, vectors = eigensystem(s, inputs[0])
        size = len(vectors)
        half = s.constant(0.5)
        da = [
            [s.mul(half, s.add(inputs[2][i * size + j], inputs[2][j * size + i])) for j in range(size)]
            for i in range(size)
        ]
        images = [[s.dot(row, vector) for row in da] for vector in vectors]
        sides: list[list[Node]] = [[s.zero] * size for _ in range(size)]  # rows of D o Q^T da Q
        for difference, (i, j) in zip(inputs[1], pairs(size), strict=True):
            sides[i][j] = sides[j][i] = s.mul(difference, s.dot(vectors[i], images[j]))
        columns = [[s.dot([vector[r] for vector in vectors], side) for r in range(size)] for side in sides]
        return [
            s.sum([s.mul(vectors[k][min(r, c)], columns[k][max(r, c)]) for k in range(size)])
            for r in range(size)
            for c in range(size)
        ]


def _check_differences(size: int, shape: Shape) -> None:
    if shape != (len(pairs(size)), 1):
        raise ShapeError(f"{size} eigenvalues have {len(pairs(size))}x1 divided differences, got {spell(shape)}")


def off_diagonal(differences: Batch) -> Batch:
    """Symmetric matrices [n, k, k] of the divided differences [n, pairs, 1], zero on the diagonal."""
    size = {len(pairs(k)): k for k in SIZES}[differences.shape[1]]
    made = np.zeros((len(differences), size, size), differences.dtype)
    for k, (i, j) in enumerate(pairs(size)):
        made[:, i, j] = made[:, j, i] = differences[:, k, 0]
    return made


@irdl_op_definition
class PolarOp(MatOp):
    """The rotation R that is nearest to a 3x3 matrix F, for which F = R S with a symmetric S.

    The eigenvalues of S are the singular values of F, the smallest with the sign of det F. R is the only one, and has
    derivatives, while the sum of the two smallest is positive; they are infinite where it is 0.
    """

    name = "mat.polar"
    ARITY: ClassVar = 1

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        if shapes[0] != (3, 3):
            raise ShapeError(f"a polar decomposition needs a 3x3 matrix, got {spell(shapes[0])}")
        return 3, 3

    def evaluate(self, *inputs: Batch) -> Batch:
        f = inputs[0]
        left, sizes, right = np.linalg.svd(np.real(f).astype(float))
        turned = np.linalg.det(left) * np.linalg.det(right)
        left[:, :, 2] *= turned[:, None]
        sizes[:, 2] *= turned
        rotation = left @ right
        rotation[sizes[:, 1] == 0] = np.nan
        if not np.iscomplexobj(f):
            return cast(Batch, rotation)
        tilt = left.swapaxes(1, 2) @ f.imag @ right.swapaxes(1, 2)
        sums = sizes[:, :, None] + sizes[:, None, :]
        skew = (tilt - tilt.swapaxes(1, 2)) / np.where(np.eye(3, dtype=bool), 1.0, sums)
        return cast(Batch, rotation + 1j * left @ skew @ right)

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        (df,) = tangents
        return None if df is None else self._turned(b, df)

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return (self._turned(b, cotangent),)  # dR is the same symmetric function of dF as F's cotangent is of R's

    def _turned(self, b: MatBuilder, df: SSAValue) -> SSAValue:
        """R [w]x with (tr(S) I - S) w = the axis of R^T dF - dF^T R (R^T dR is skew, and R^T F stays symmetric)."""
        rotation = self.result
        stretch = b.matmul(b.transpose(rotation), self.operands[0])
        turn = b.matmul(b.transpose(rotation), df)
        axis = b.concat_rows([b.sub(_entry(b, turn, i, j), _entry(b, turn, j, i)) for i, j in ((2, 1), (0, 2), (1, 0))])
        inertia = b.sub(b.scale(b.trace(stretch), b.identity(3)), stretch)
        spin = b.matmul(b.inverse(inertia), axis)
        return b.concat_rows([b.cross(b.row(rotation, k), b.transpose(spin)) for k in range(3)])

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return _rotation(s, inputs[0])


def _entry(b: MatBuilder, a: SSAValue, row: int, col: int) -> SSAValue:
    return b.block(a, row, col, 1, 1)


# -- Jacobi's method as scalar code --------------------------------------------------------------------------------


def _rotation_for(s: ScalarGraph, difference: Node, twice: Node) -> tuple[Node, Node]:
    """Cosine and sine of the rotation that diagonalises [[p, off], [off, q]], the larger eigenvalue first.

    difference: p - q; twice: 2 off. Columns (p, q) become (cosine p + sine q, cosine q - sine p).
    """
    squared = s.add(s.mul(difference, difference), s.mul(twice, twice))
    is_nothing = s.compare("le", squared, s.constant(SMALLEST_SQUARE))
    root = s.unary("sqrt", s.select(is_nothing, s.one, squared))
    half = s.constant(0.5)
    larger = s.unary("sqrt", s.add(half, s.div(s.mul(half, s.unary("abs", difference)), root)))
    smaller = s.div(s.div(s.mul(half, twice), root), larger)
    is_swapped = s.compare("lt", difference, s.zero)
    signed = s.select(s.compare("lt", twice, s.zero), s.neg(larger), larger)
    cosine = s.select(is_swapped, s.unary("abs", smaller), larger)
    sine = s.select(is_swapped, signed, smaller)
    return s.select(is_nothing, s.one, cosine), s.select(is_nothing, s.zero, sine)


def _turned(
    s: ScalarGraph, p: Sequence[Node], q: Sequence[Node], cosine: Node, sine: Node
) -> tuple[list[Node], list[Node]]:
    first = [s.add(s.mul(cosine, a), s.mul(sine, c)) for a, c in zip(p, q, strict=True)]
    second = [s.sub(s.mul(cosine, c), s.mul(sine, a)) for a, c in zip(p, q, strict=True)]
    return first, second


def _unit_vectors(s: ScalarGraph, size: int) -> list[list[Node]]:
    return [[s.one if i == k else s.zero for i in range(size)] for k in range(size)]


def eigensystem(s: ScalarGraph, a: Sequence[Node]) -> tuple[list[Node], list[list[Node]]]:
    """Ascending eigenvalues, and their eigenvectors, of the symmetric part of a matrix given row by row."""
    size = {k * k: k for k in SIZES}[len(a)]
    half = s.constant(0.5)
    m = {(i, j): s.mul(half, s.add(a[i * size + j], a[j * size + i])) for i in range(size) for j in range(i, size)}
    vectors = _unit_vectors(s, size)
    for _ in range(SWEEPS[size]):
        for p, q in pairs(size):
            difference, twice = s.sub(m[q, q], m[p, p]), s.neg(s.mul(s.constant(2.0), m[p, q]))
            cosine, sine = _rotation_for(s, difference, twice)  # the smaller first: that of -a
            shift = s.mul(sine, s.sub(s.mul(sine, difference), s.mul(cosine, twice)))
            m[p, p], m[q, q], m[p, q] = s.add(m[p, p], shift), s.sub(m[q, q], shift), s.zero
            for k in (k for k in range(size) if k not in (p, q)):
                at_p, at_q = (min(p, k), max(p, k)), (min(q, k), max(q, k))
                (m[at_p],), (m[at_q],) = _turned(s, [m[at_p]], [m[at_q]], cosine, sine)
            vectors[p], vectors[q] = _turned(s, vectors[p], vectors[q], cosine, sine)
    return [m[k, k] for k in range(size)], vectors


def _rotation(s: ScalarGraph, f: Sequence[Node]) -> list[Node]:
    """R of F = R S, row by row: rotations V from the right make F's columns orthogonal, the longest first."""
    columns = [[f[3 * i + k] for i in range(3)] for k in range(3)]
    vectors = _unit_vectors(s, 3)
    for _ in range(SWEEPS[3]):
        for p, q in pairs(3):
            difference = s.sub(s.dot(columns[p], columns[p]), s.dot(columns[q], columns[q]))
            twice = s.mul(s.constant(2.0), s.dot(columns[p], columns[q]))
            cosine, sine = _rotation_for(s, difference, twice)
            columns[p], columns[q] = _turned(s, columns[p], columns[q], cosine, sine)
            vectors[p], vectors[q] = _turned(s, vectors[p], vectors[q], cosine, sine)
    first = _normalised(s, columns[0])
    along = s.dot(first, columns[1])
    second = _normalised(s, [s.sub(a, s.mul(along, u)) for a, u in zip(columns[1], first, strict=True)])
    left, right = [first, second, _cross(s, first, second)], [*vectors[:2], _cross(s, vectors[0], vectors[1])]
    return [s.sum([s.mul(u[i], v[j]) for u, v in zip(left, right, strict=True)]) for i in range(3) for j in range(3)]


def _normalised(s: ScalarGraph, vector: Sequence[Node]) -> list[Node]:
    length = s.unary("sqrt", s.dot(vector, vector))
    return [s.div(a, length) for a in vector]


def _cross(s: ScalarGraph, x: Sequence[Node], y: Sequence[Node]) -> list[Node]:
    return [s.sub(s.mul(x[i], y[j]), s.mul(x[j], y[i])) for i, j in ((1, 2), (2, 0), (0, 1))]


OPS = (EigenvaluesOp, SpectralOp, SpectralTangentOp, PolarOp)
