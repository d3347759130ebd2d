"""Attributes whose derivatives the user gives, checked against those that the compiler derives (paper, section 12)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from xdsl.ir import Block, SSAValue

from yasps.dialects.mat import MatBuilder, MatOp, matrix_type, spell
from yasps.dialects.mat.calculus import CongruenceOp, GivenDerivativeOp
from yasps.frontend.errors import SceneError, ShapeMismatchError
from yasps.frontend.language.attribute import Attribute, combine, concat_cols, constant, identity
from yasps.frontend.language.nodes import Computed, FloatArray, Named, Stored, operands_of
from yasps.passes.analysis.dependence import DependenceMap
from yasps.passes.calculus.derivatives import jacobian, pull_back

SAMPLES = 48
"""Sets of random numbers that a given derivative is compared at."""
TOLERANCE = 1e-6
"""Of a given derivative's entries, relative to the largest entry at the same numbers: rounding of formulas that lose
half of all digits stays below, a wrong factor does not."""


def with_derivatives(
    value: Attribute,
    arguments: Sequence[Attribute],
    gradient: Attribute | Sequence[Attribute],
    *,
    hessian: Attribute | None,
    eigensystem: tuple[Attribute, Attribute] | None,
    check: bool,
) -> Attribute:
    """See `Attribute.with_derivatives`."""
    if not arguments or any(not isinstance(one, Attribute) for one in arguments):
        raise SceneError("given derivatives need the attributes that they are with respect to")
    if any(one is other for k, one in enumerate(arguments) for other in arguments[:k]):
        raise SceneError("given derivatives: an argument is named twice")
    if hessian is not None and eigensystem is not None:
        raise SceneError("given derivatives: give the Hessian or its eigensystem, which is one already")
    entries = sum(argument.size for argument in arguments)
    first = _jacobian_of(value, arguments, gradient)
    vectors = None
    if eigensystem is not None:
        values, vectors = eigensystem
        _check_shape(values, (vectors.shape[1], 1), "eigenvalues, one column for as many eigenvectors,")
        _check_shape(vectors, (entries, vectors.shape[1]), "eigenvectors, one in each column,")
        diagonal = identity(values.size).hadamard(values @ constant(np.ones((1, values.size))))
        hessian = combine(CongruenceOp, [diagonal, vectors.transpose()])
    if hessian is not None:
        if value.shape != (1, 1):
            raise ShapeMismatchError(f"a Hessian can be given of a 1x1 attribute; {value.path} is {spell(value.shape)}")
        _check_shape(hessian, (entries, entries), f"a Hessian with respect to {entries} entries")
    if check:
        _Comparison(value, arguments, first, hessian, vectors).run()
    if hessian is not None:
        column = combine(GivenDerivativeOp, [first.transpose(), hessian, *arguments])
        first = column.transpose()
    return combine(GivenDerivativeOp, [value, first, *arguments])


def _jacobian_of(
    value: Attribute, arguments: Sequence[Attribute], gradient: Attribute | Sequence[Attribute]
) -> Attribute:
    """The Jacobian [entries of the value, entries of the arguments] of what was given."""
    if value.shape != (1, 1):
        if not isinstance(gradient, Attribute):
            raise ShapeMismatchError(f"{value.path} is {spell(value.shape)}: give its Jacobian, one matrix")
        entries = sum(argument.size for argument in arguments)
        _check_shape(gradient, (value.size, entries), f"the Jacobian of {value.size} entries by {entries}")
        return gradient
    parts = [gradient] if isinstance(gradient, Attribute) else list(gradient)
    if len(parts) != len(arguments):
        raise ShapeMismatchError(f"one gradient for each of {len(arguments)} arguments, got {len(parts)}")
    for part, argument in zip(parts, arguments, strict=True):
        _check_shape(part, argument.shape, f"the gradient with respect to {argument.path}")
    return concat_cols([part.reshape(1, part.size) for part in parts])


def _check_shape(attribute: Attribute, shape: tuple[int, int], what: str) -> None:
    if attribute.shape != shape:
        raise ShapeMismatchError(f"{what} must be {spell(shape)}, got {spell(attribute.shape)}")


def read_beside(attribute: Attribute) -> list[Attribute]:
    """Stored attributes that a value with a given derivative depends on otherwise than through its arguments."""
    node = attribute.node
    assert isinstance(node, Computed)
    value, derivative, *arguments = node.operands
    found, seen, stack = [], set(arguments), [value, derivative]
    while stack:
        current = stack.pop()
        if current in seen:
            continue
        seen.add(current)
        if isinstance(current.node, Stored):
            found.append(current)
        stack.extend(operands_of(current.node))
    return found


@dataclass
class _Comparison:
    """What was given of a value, beside what the compiler derives of it, at random numbers."""

    value: Attribute
    arguments: Sequence[Attribute]
    first: Attribute
    second: Attribute | None
    vectors: Attribute | None

    def run(self) -> None:
        """Raises SceneError where the two differ."""
        self._builder = MatBuilder(Block())
        self._known: dict[Attribute, SSAValue] = {}
        self._leaves: list[Attribute] = []
        for argument in self.arguments:
            self._add_leaf(argument)
        b, inputs = self._builder, [self._known[argument] for argument in self.arguments]
        value, first = self._emitted(self.value), self._emitted(self.first)
        derived = jacobian(b, [value], inputs)
        compared = [("gradient" if self.value.shape == (1, 1) else "Jacobian", first, derived)]
        if self.second is not None:
            slopes = pull_back(b, DependenceMap(b.body, inputs), {value: b.number(1.0)}, inputs)
            listed = [slopes.get(u, b.zeros(a.shape)) for u, a in zip(inputs, self.arguments, strict=True)]
            compared.append(("Hessian", self._emitted(self.second), jacobian(b, listed, inputs)))
        if self.vectors is not None:
            vectors = self._emitted(self.vectors)
            product = b.matmul(b.transpose(vectors), vectors)
            compared.append(("product Q^T Q of the eigenvectors", product, b.identity(self.vectors.shape[1])))
        numbers, values = self._evaluated()
        usable = np.isfinite(values[value]).all(axis=(1, 2))
        for _, _, right in compared:
            usable &= np.isfinite(values[right]).all(axis=(1, 2))
        if not usable.any():
            raise SceneError(
                f"derivatives given of {self._name}: it and its derivatives are finite at none of {SAMPLES} sets of "
                "random numbers, so that nothing can be compared; give them with check=False"
            )
        for what, given, right in compared:
            self._compare(what, values[given][usable], values[right][usable], [n[usable] for n in numbers])

    @property
    def _name(self) -> str:
        return f"{self.value.path} (made at {self.value.where})"

    def _add_leaf(self, attribute: Attribute) -> None:
        block = self._builder.body
        self._known[attribute] = block.insert_arg(matrix_type(attribute.shape), len(block.args))
        self._leaves.append(attribute)

    def _emitted(self, attribute: Attribute) -> SSAValue:
        """Its formula in the block, down to arguments and to what is stored or comes by JOIN or UNION."""
        stack = [attribute]
        while stack:
            current = stack[-1]
            node = current.node
            if not isinstance(node, Named | Computed) and current not in self._known:
                self._add_leaf(current)
            if current in self._known:
                stack.pop()
                continue
            missing = [operand for operand in operands_of(node) if operand not in self._known]
            if missing:
                stack.extend(missing)
                continue
            operands = [self._known[operand] for operand in operands_of(node)]
            if isinstance(node, Computed):
                self._known[current] = self._builder.emit(node.op_class, operands, dict(node.properties))
            else:
                self._known[current] = operands[0]
            stack.pop()
        return self._known[attribute]

    def _evaluated(self) -> tuple[list[FloatArray], dict[SSAValue, FloatArray]]:
        """Random numbers of the leaves, and values of everything in the block, [samples, rows, columns]."""
        random = np.random.default_rng(0)
        numbers = [_sampled(random, leaf, leaf in self.arguments) for leaf in self._leaves]
        block = self._builder.body
        values: dict[SSAValue, FloatArray] = dict(zip(block.args, numbers, strict=True))
        with np.errstate(all="ignore"):
            for op in block.ops:
                assert isinstance(op, MatOp)
                made = op.evaluate(*[values[operand] for operand in op.operands])
                values[op.result] = np.broadcast_to(made, (SAMPLES, *made.shape[1:]))
        return numbers, values

    def _compare(self, what: str, given: FloatArray, derived: FloatArray, numbers: Sequence[FloatArray]) -> None:
        largest = np.abs(derived).max(axis=(1, 2), keepdims=True)
        wrong: NDArray[np.bool_] = ~(np.abs(given - derived) <= TOLERANCE * largest + 1e-9 * float(np.max(largest)))
        if not wrong.any():
            return
        sample, row, col = (int(k) for k in np.argwhere(wrong)[0])
        entry = self._entry_by(col) if what == "gradient" else f"entry [{row}, {col}]"
        at = "; ".join(
            f"{argument.path} = {np.array2string(array[sample], precision=6).replace(chr(10), '')}"
            for argument, array in zip(self.arguments, numbers, strict=False)
        )
        raise SceneError(
            f"the {what} given of {self._name} is not what is derived: at random numbers {sample}, {entry} "
            f"is {given[sample, row, col]:.12g} and should be {derived[sample, row, col]:.12g}. There, "
            f"{at}. If the given one is right, and this a matter of rounding, give it with check=False"
        )

    def _entry_by(self, position: int) -> str:
        """Which entry of which argument this entry of the gradient is by."""
        for argument in self.arguments:
            if position < argument.size:
                row, col = divmod(position, argument.shape[1])
                return f"entry [{row}, {col}] by {argument.path}"
            position -= argument.size
        raise IndexError(position)


def _sampled(random: np.random.Generator, attribute: Attribute, is_argument: bool) -> FloatArray:
    """Numbers of an attribute, [samples, rows, columns].

    A third each near the identity or 1, of any sign and size, and positive; of stored ones that were set, half are
    theirs, and a little beside where they are an argument.
    """
    rows, cols = attribute.shape
    drawn = random.standard_normal((SAMPLES, rows, cols))
    kind = np.arange(SAMPLES) % 6 % 3
    near = np.eye(rows, cols) if min(rows, cols) > 1 else np.ones((rows, cols))
    drawn[kind == 0] = near + 0.25 * drawn[kind == 0]
    drawn[kind == 2] = random.uniform(0.2, 2.0, drawn[kind == 2].shape)
    if isinstance(attribute.node, Stored) and attribute.node.array.any():
        own = attribute.node.array[random.integers(len(attribute.node.array), size=SAMPLES)]
        if is_argument:
            own = own + 0.1 * np.abs(own).max() * random.standard_normal(own.shape)
        chosen = np.arange(SAMPLES) % 2 == 0
        drawn[chosen] = own[chosen]
    return drawn
