"""Symbolic attributes: what users compute with (paper, 4.2 to 4.6). No number is touched until `compute()`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike
from xdsl.dialects.builtin import FloatAttr, StringAttr, f64
from xdsl.ir import Attribute as IrAttribute

from yasps.dialects.mat import (
    MatOp,
    Shape,
    ShapeError,
    algebra,
    calculus,
    comparison,
    elementwise,
    matrix_type,
    spell,
    structure,
)
from yasps.dialects.mat.base import dense
from yasps.frontend.errors import DataError, LineageError, SceneError, ShapeMismatchError
from yasps.frontend.language.arrays import in_instances, real_numbers
from yasps.frontend.language.entrywise import EntrywiseFunctions
from yasps.frontend.language.in_scene import InScene
from yasps.frontend.language.indexing import chosen, integer, integers, wrapped
from yasps.frontend.language.location import Location, user_location
from yasps.frontend.language.nodes import Computed, ComputedValue, FloatArray, Node, Stored, operands_of
from yasps.frontend.language.paper_names import AttributeNames
from yasps.frontend.language.scene_lock import SceneLock, one_thread_at_a_time
from yasps.frontend.language.spelling import both_spellings

if TYPE_CHECKING:
    from yasps.frontend.execution.compiled_scene import CompiledScene
    from yasps.frontend.language.entity import Entity


@both_spellings
class Attribute(AttributeNames, EntrywiseFunctions, InScene):
    """A rows x cols matrix on every instance of its owner.

    Arithmetic gives new attributes: `+`, `-`, `*` (matrix product, or a 1x1 value times a matrix), `/` by a 1x1 value,
    `**` with a number. All operands must share one lineage (paper, 4.3): attributes of a primitive, of its mesh and of
    the scene meet freely; those of different primitives meet through JOIN (`through=`, `source=`) or UNION.
    """

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **keywords: Any) -> Any:
        """What NumPy's functions of numbers mean here, `np.sin(a)` for example; `array * attribute` comes here, too."""
        from yasps.frontend.language.numpy_functions import call_ufunc

        return call_ufunc(ufunc, method, inputs, keywords)

    def __array_function__(self, function: Any, types: Any, inputs: Any, keywords: Any) -> Any:
        """What NumPy's functions of arrays mean here, `np.cross(a, b)` for example."""
        from yasps.frontend.language.numpy_functions import call_function

        return call_function(function, inputs, keywords)

    def __init__(
        self,
        owner: Entity | None,
        shape: Shape,
        node: Node,
        name: str | None = None,
    ) -> None:
        self._owner = owner
        self._shape = shape
        self._node = node
        self._name = name
        self._where = user_location()
        self.evaluator: CompiledScene | None = None
        """What `compute()` compiled; it lives as long as the attribute does."""

    # -- what it is ----------------------------------------------------------------------------------------

    @property
    def owner(self) -> Entity | None:
        """The primitive, mesh or scene it lives on; None for a number that lives nowhere."""
        return self._owner

    @property
    def _lock(self) -> SceneLock | nullcontext[None]:
        return self._owner.scene.lock if self._owner is not None else nullcontext()

    @property
    def shape(self) -> Shape:
        """Rows and columns on one instance."""
        return self._shape

    @property
    def ndim(self) -> int:
        """Always 2: rows and columns."""
        return 2

    @property
    def size(self) -> int:
        """Rows times columns."""
        return self._shape[0] * self._shape[1]

    def __len__(self) -> int:
        """Entries of a vector, rows of a matrix."""
        return self.size if self.is_vector else self._shape[0]

    @property
    def is_vector(self) -> bool:
        """Whether it has one row or one column."""
        return min(self._shape) == 1

    @property
    def name(self) -> str | None:
        """Its name on the owner, if it has one."""
        return self._name

    @property
    def node(self) -> Node:
        """How it comes about."""
        return self._node

    @property
    def inputs(self) -> tuple[Attribute, ...]:
        """The stored attributes that it is computed from, as they are met; of a stored one itself."""
        found: dict[Attribute, None] = {}
        seen, stack = {self}, [self]
        while stack:
            attribute = stack.pop()
            if isinstance(attribute.node, Stored):
                found[attribute] = None
            new = [operand for operand in dict.fromkeys(operands_of(attribute.node)) if operand not in seen]
            seen.update(new)
            stack.extend(reversed(new))
        return tuple(found)

    @property
    def where(self) -> Location:
        """The line of the user's Python that made it."""
        return self._where

    @property
    def path(self) -> str:
        """A name for messages."""
        label = self._name or "an expression"
        if self._owner is None:
            return "a number"
        return f"{self._owner.path}.{label}" if self._owner.path else label

    def __repr__(self) -> str:
        kind = type(self._node).__name__.lower()
        return f"<{kind} attribute {self.path} {spell(self._shape)}>"

    def __bool__(self) -> bool:
        raise SceneError(
            f"{self.path} is symbolic and has no truth value: choose with select(condition, a, b), minimum(a, b) or "
            "maximum(a, b), or branch on numbers (compute().value)"
        )

    def __array__(self, dtype: object = None, copy: object = None) -> NoReturn:
        raise SceneError(
            f"{self.path} is symbolic and can't become a NumPy array: take its numbers by compute().array, build "
            "matrices of attributes by concat_rows and concat_cols, multiply by * and @"
        )

    # -- numbers -------------------------------------------------------------------------------------------

    @one_thread_at_a_time
    def update_value(self, values: ArrayLike) -> None:
        """Sets the numbers of a stored attribute: [instances, rows, columns], [instances, rows * columns] or flat,
        row-major; for one instance its matrix alone, too. Axes of length 1 may be left out.

        On a dynamic primitive the number of instances follows from the data; its other parts must follow before the
        next result (`Primitive.update` sets all at once).

        Raises DataError for a wrong count or layout, for what are no real numbers, for masked entries, NaN and
        infinity; nothing is changed then.
        Raises SceneError for a computed attribute.
        """
        if not isinstance(self._node, Stored) or self._owner is None:
            raise SceneError(
                f"{self.path} is computed; only stored attributes (add_attribute with rows and cols) are set"
            )
        shaped = self._checked_values(values)
        if self._node.array.shape == shaped.shape:
            self._node.array[...] = shaped
            self._node.version += 1
        else:
            self._node.array = shaped.copy()
            self._owner.scene.arrays_moved(self._owner)
        if len(shaped) != self._owner.num_instances:
            self._owner.set_num_instances(len(shaped))

    def _checked_values(self, values: ArrayLike) -> FloatArray:
        """The numbers as [instances, rows, columns], perhaps the same memory; raises as `update_value` does."""
        assert self._owner is not None
        count = None if self._owner.follows_data else self._owner.num_instances
        return in_instances(real_numbers(values, self.path), count, self._shape, self.path)

    @one_thread_at_a_time
    def compute(self) -> ComputedValue:
        """Evaluates the attribute on all instances (compiled on first use)."""
        if isinstance(self._node, Stored):
            return ComputedValue(self._node.array.copy())
        if self._owner is None:
            raise SceneError("a number alone has no instances to be computed on; combine it with an attribute")
        return ComputedValue(self._owner.scene.evaluate(self))

    @property
    def value(self) -> FloatArray:
        """A copy of the current numbers, flat; short for `compute().value`."""
        return self.compute().value

    # -- arithmetic ----------------------------------------------------------------------------------------

    def __add__(self, other: Any) -> Attribute:
        return combine(elementwise.AddOp, broadcast(elementwise.AddOp, self, other))

    def __radd__(self, other: Any) -> Attribute:
        if type(other) is int and other == 0:  # where Python's sum() starts
            return self
        return combine(elementwise.AddOp, broadcast(elementwise.AddOp, other, self))

    def __sub__(self, other: Any) -> Attribute:
        return combine(elementwise.SubOp, broadcast(elementwise.SubOp, self, other))

    def __rsub__(self, other: Any) -> Attribute:
        return combine(elementwise.SubOp, broadcast(elementwise.SubOp, other, self))

    def __pos__(self) -> Attribute:
        return self

    def __neg__(self) -> Attribute:
        return combine(elementwise.NegOp, [self])

    def __mul__(self, other: Any) -> Attribute:
        return _product(self, as_attribute(other))

    def __rmul__(self, other: Any) -> Attribute:
        return _product(as_attribute(other), self)

    def __matmul__(self, other: Any) -> Attribute:
        return combine(algebra.MatmulOp, [self, as_attribute(other)])

    def __rmatmul__(self, other: Any) -> Attribute:
        return combine(algebra.MatmulOp, [as_attribute(other), self])

    def __truediv__(self, other: Any) -> Attribute:
        return combine(elementwise.DivideOp, [self, as_attribute(other)])

    def __rtruediv__(self, other: Any) -> Attribute:
        return combine(elementwise.DivideOp, [as_attribute(other), self])

    def __pow__(self, exponent: float | Attribute) -> Attribute:
        if isinstance(exponent, Attribute):  # of positive numbers only; 1x1, or one exponent for each entry
            logarithm = self.log()
            return (exponent * logarithm if exponent.shape == (1, 1) else exponent.hadamard(logarithm)).exp()
        number = isinstance(exponent, int | float | np.integer | np.floating) and not isinstance(exponent, bool)
        if not number or not np.isfinite(exponent):
            raise DataError(f"the exponent of ** is a finite number or an attribute, got {exponent!r}")
        return combine(elementwise.PowOp, [self], {"exponent": FloatAttr(float(exponent), f64)})

    def __rpow__(self, base: Any) -> Attribute:
        number = isinstance(base, int | float | np.integer | np.floating) and not isinstance(base, bool)
        if not number or not 0 < base < np.inf:
            raise DataError(f"the base of ** is a positive number or an attribute, got {base!r}")
        return (float(np.log(base)) * self).exp()

    # `==` and `!=` stay Python's: attributes are told apart by identity, as keys of dictionaries.

    def __lt__(self, other: Any) -> Attribute:
        return _comparison("lt", self, other)

    def __le__(self, other: Any) -> Attribute:
        return _comparison("le", self, other)

    def __gt__(self, other: Any) -> Attribute:
        return _comparison("lt", other, self)

    def __ge__(self, other: Any) -> Attribute:
        return _comparison("le", other, self)

    # Of conditions: a number that is not 0 is true.

    def __and__(self, other: Any) -> Attribute:
        first, second = broadcast(comparison.SelectOp, self, other)
        return combine(comparison.SelectOp, [first, second, constant(np.zeros(second.shape))])

    def __or__(self, other: Any) -> Attribute:
        first, second = broadcast(comparison.SelectOp, self, other)
        return combine(comparison.SelectOp, [first, constant(np.ones(second.shape)), second])

    def __invert__(self) -> Attribute:
        return combine(comparison.SelectOp, [self, constant(np.zeros(self.shape)), constant(np.ones(self.shape))])

    def __abs__(self) -> Attribute:
        return self.abs()

    def _apply(self, operation: type[elementwise.TabledFunction]) -> Attribute:
        return combine(operation, [self])

    def abs(self) -> Attribute:
        """Absolute value of every entry; also `abs(a)`."""
        return combine(comparison.AbsOp, [self])

    def hadamard(self, other: Any) -> Attribute:
        """Entry-wise product."""
        return combine(elementwise.HadamardOp, [self, as_attribute(other)])

    # -- linear algebra ------------------------------------------------------------------------------------

    def dot(self, other: Any) -> Attribute:
        """Sum of the entry-wise product: dot product of vectors, Frobenius product of matrices; 1x1."""
        return combine(algebra.DotOp, [self, as_attribute(other)])

    def cross(self, other: Any) -> Attribute:
        """Cross product of two 3-vectors."""
        return combine(algebra.CrossOp, [self, as_attribute(other)])

    def outer(self, other: Any) -> Attribute:
        """Outer product a b^T of two column (or row) vectors."""
        first, second = self, as_attribute(other)
        column = first if first.shape[1] == 1 else first.transpose()
        row = second if second.shape[0] == 1 else second.transpose()
        return combine(algebra.MatmulOp, [column, row])

    def transpose(self) -> Attribute:
        """Transpose; also `.T`."""
        return combine(algebra.TransposeOp, [self])

    @property
    def T(self) -> Attribute:  # noqa: N802 - NumPy's name
        """Transpose."""
        return self.transpose()

    def trace(self) -> Attribute:
        """Sum of the diagonal; 1x1."""
        return combine(algebra.TraceOp, [self])

    def sum(self) -> Attribute:
        """Sum of all entries; 1x1."""
        return combine(algebra.SumOp, [self])

    def norm(self) -> Attribute:
        """Euclidean (Frobenius) norm; 1x1. At 0, where it has no derivative, 0 is taken."""
        return combine(algebra.NormOp, [self])

    def det(self) -> Attribute:
        """Determinant, up to 4x4; 1x1."""
        return combine(algebra.DetOp, [self])

    def inverse(self) -> Attribute:
        """Inverse, up to 4x4."""
        return combine(algebra.InverseOp, [self])

    # -- structure -----------------------------------------------------------------------------------------

    def reshape(self, rows: int | tuple[int, int], cols: int | None = None) -> Attribute:
        """The same entries, row-major, as rows x cols; also `reshape((rows, cols))`. One of the two may be -1."""
        if isinstance(rows, tuple) and cols is None and len(rows) == 2:
            rows, cols = rows
        if isinstance(rows, tuple) or cols is None:
            raise ShapeMismatchError(f"{self.path} has rows and columns: write reshape(rows, cols), one may be -1")
        rows, cols = integer(rows, "the number of rows"), integer(cols, "the number of columns")
        if rows == -1 and cols > 0 and self.size % cols == 0:
            rows = self.size // cols
        elif cols == -1 and rows > 0 and self.size % rows == 0:
            cols = self.size // rows
        return combine(structure.ReshapeOp, [self], {"shape": integers(rows, cols)})

    def flatten(self) -> Attribute:
        """All entries, row-major, as one column."""
        return self.reshape(self.size, 1)

    def resize(self, rows: int, cols: int) -> Attribute:
        """The paper's name of `reshape`."""
        return self.reshape(rows, cols)

    def block(self, row: int, col: int, rows: int, cols: int) -> Attribute:
        """The rows x cols block whose first entry is (row, col)."""
        return combine(structure.BlockOp, [self], {"block": integers(row, col, rows, cols)})

    def row(self, index: int) -> Attribute:
        """One row, 1 x cols; -1 is the last."""
        return self.block(wrapped(index, self._shape[0], "row", self), 0, 1, self._shape[1])

    def col(self, index: int) -> Attribute:
        """One column, rows x 1; -1 is the last."""
        return self.block(0, wrapped(index, self._shape[1], "column", self), self._shape[0], 1)

    def __getitem__(self, index: Any) -> Attribute:
        """`a[i]` of a vector, 1x1; row `A[i]` of a matrix; `A[i, j]`; slices of all of them, as in NumPy: `a[1:3]`,
        `A[:, 0]`, `A[..., 0]`. The result has rows and columns, too. Raises ShapeMismatchError."""
        rows, cols = self._shape
        indices = index if isinstance(index, tuple) else (index,)
        indices = tuple(slice(None) if one is Ellipsis else one for one in indices)
        if len(indices) > 2:
            raise ShapeMismatchError(f"{self.path} has rows and columns: write a[i, j], got {len(indices)} indices")
        if len(indices) == 1:
            indices = (0, *indices) if rows == 1 else (*indices, 0) if cols == 1 else (*indices, slice(None))
        chosen_rows = chosen(indices[0], rows, "row", self)
        chosen_cols = chosen(indices[1], cols, "column", self)
        bands = []
        for row, height in chosen_rows:
            parts = [self.block(row, col, height, width) for col, width in chosen_cols]
            bands.append(parts[0] if len(parts) == 1 else concat_cols(parts))
        return bands[0] if len(bands) == 1 else concat_rows(bands)

    def __iter__(self) -> Iterator[Attribute]:
        """The entries of a vector, the rows of a matrix."""
        return (self[index] for index in range(len(self)))

    def stop_gradient(self) -> Attribute:
        """The same value, held constant by differentiation."""
        return combine(calculus.StopGradientOp, [self])

    def with_derivatives(
        self,
        arguments: Attribute | Sequence[Attribute],
        gradient: Attribute | Sequence[Attribute],
        *,
        hessian: Attribute | None = None,
        eigensystem: tuple[Attribute, Attribute] | None = None,
        check: bool = True,
    ) -> Attribute:
        """The same value with derivatives of one's own, which the compiler uses instead of deriving them.

        arguments: attributes that the formula is written with, m entries together. gradient: one attribute in the shape
        of each argument; if this attribute is not 1x1, its Jacobian instead, a row for each of its entries and a column
        for each of the arguments', all row-major. hessian: of a 1x1 attribute, m x m; without it the gradient is
        differentiated. eigensystem: of that Hessian instead, eigenvalues k x 1 and orthonormal eigenvectors m x k, one
        a column, k <= m; where this attribute is an energy and its arguments are affine in the targets, their negative
        ones are removed without looking for them. check: compare with what is derived, at random numbers, now.

        Derivatives with respect to what is reached otherwise than through the arguments raise SceneError when the scene
        is compiled. Raises SceneError where a given derivative is wrong, ShapeMismatchError, LineageError.
        """
        from yasps.frontend.language.given_derivatives import with_derivatives

        listed = [arguments] if isinstance(arguments, Attribute) else list(arguments)
        return with_derivatives(self, listed, gradient, hessian=hessian, eigensystem=eigensystem, check=check)


def constant(values: ArrayLike) -> Attribute:
    """A matrix of numbers to compute with: a number is 1x1, a flat list of n numbers n x 1."""
    array = real_numbers(values, "a constant")
    if array.ndim > 2 or array.size == 0:
        raise ShapeMismatchError(f"a constant is a number, a vector or a matrix, got an array of shape {array.shape}")
    if array.ndim < 2:
        array = array.reshape(-1, 1)
    shape = (array.shape[0], array.shape[1])
    properties: tuple[tuple[str, IrAttribute], ...] = (("value", dense(array, matrix_type(shape))),)
    return Attribute(None, shape, Computed(structure.ConstantOp, (), properties))


def as_attribute(value: Any) -> Attribute:
    """Attributes as they are, numbers and arrays as constants."""
    return value if isinstance(value, Attribute) else constant(value)


def broadcast(op_class: type[MatOp], first: Any, second: Any) -> list[Attribute]:
    """Both as attributes, a single number in the shape of the other. Raises LineageError."""
    one, other = as_attribute(first), as_attribute(second)
    deepest([one, other], op_class.word())  # names what the user wrote
    if one.shape == other.shape or (1, 1) not in (one.shape, other.shape):
        return [one, other]
    shape = max(one.shape, other.shape)
    return [each if each.shape == shape else _filled(each, shape) for each in (one, other)]


def _filled(number: Attribute, shape: Shape) -> Attribute:
    """A matrix of this shape with the number everywhere."""
    return combine(elementwise.ScaleOp, [number, constant(np.ones(shape))])


def deepest(attributes: Sequence[Attribute], what: str) -> Entity | None:
    """The entity that a combination of these lives on: the deepest of their common lineage (paper, 4.3)."""
    owner: Entity | None = None
    holder: Attribute | None = None
    for attribute in attributes:
        candidate = attribute.owner
        if candidate is None or candidate is owner:
            continue
        if owner is None or owner in candidate.lineage():
            owner, holder = candidate, attribute
        elif candidate not in owner.lineage():
            assert holder is not None
            pair = f"{what} of {holder.path} and {attribute.path}"
            if candidate.scene is not owner.scene:
                raise LineageError(
                    f"{pair}: the first is of {owner.scene.label}, the second of another, {candidate.scene.label}. "
                    "Scenes share nothing; build both parts in one scene."
                )
            raise LineageError(
                f"{pair}: they live on {owner.label} and {candidate.label}, which are not of one lineage. Bring one to "
                "the other's primitive first: add_attribute(name, through=connectivity, source=attribute) is a JOIN, "
                "add_attribute(name) on a primitive union a UNION."
            )
    return owner


def combine(
    op_class: type[MatOp], operands: Sequence[Attribute], properties: dict[str, IrAttribute] | None = None
) -> Attribute:
    """The attribute that this operation gives; raises LineageError and ShapeMismatchError."""
    properties = properties or {}
    owner = deepest(operands, op_class.word())
    try:
        shape = op_class.infer([operand.shape for operand in operands], properties)
    except ShapeError as error:
        names = ", ".join(f"{operand.path} {spell(operand.shape)}" for operand in operands)
        raise ShapeMismatchError(f"{op_class.word()} of {names}: {error}") from error
    return Attribute(owner, shape, Computed(op_class, tuple(operands), tuple(properties.items())))


def concat_rows(parts: Sequence[Any]) -> Attribute:
    """Parts of equally many columns, one below the other."""
    return combine(structure.ConcatRowsOp, [as_attribute(part) for part in parts])


def concat_cols(parts: Sequence[Any]) -> Attribute:
    """Parts of equally many rows, side by side."""
    return combine(structure.ConcatColsOp, [as_attribute(part) for part in parts])


def identity(size: int) -> Attribute:
    """The identity matrix."""
    return constant(np.eye(size))


def zeros(rows: int, cols: int) -> Attribute:
    """A matrix of zeros."""
    return constant(np.zeros((rows, cols)))


def _comparison(predicate: str, left: Any, right: Any) -> Attribute:
    """1 where it holds, 0 elsewhere."""
    return combine(
        comparison.CompareOp, broadcast(comparison.CompareOp, left, right), {"predicate": StringAttr(predicate)}
    )


def _product(left: Attribute, right: Attribute) -> Attribute:
    """`*`: a 1x1 value scales; anything else is a matrix product."""
    if left.shape == (1, 1):
        return combine(elementwise.ScaleOp, [left, right])
    if right.shape == (1, 1):
        return combine(elementwise.ScaleOp, [right, left])
    return combine(algebra.MatmulOp, [left, right])
