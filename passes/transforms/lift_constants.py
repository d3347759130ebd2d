"""`lift-constants`: numbers in formulas become numbers of the scene, so that another value needs no other code.

Young's modulus 5e4 in an energy is `mat.constant` before and an entry of `rel.storage @ENERGY.numbers ... numbers
dense<...>` after. Kernels read it as they read what the user stores; the storage keeps the value for the interpreter,
for whoever reads the dump, and for the compiled scene.

Which numbers stay where they are is a question of where they stand, not of what they are, but for the first rule:

- 0, 1/2, 1, 2 and their negatives, in matrices too: they are folded away or cost no more than a shift, and derivatives
  make and cancel them;
- exponents, which are no values at all;
- weights: factors of single terms of sums of unknowns that an energy is nonlinear in, if no such factor is data. They
  are the linear map whose exact rank tells how wide projections are (`linear_cut.constant_map`). A factor of a whole
  sum is no weight.

A number is one entry for every operation that uses it, since two that are equal today may not be tomorrow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from xdsl.context import Context
from xdsl.dialects.builtin import Float64Type, ModuleOp
from xdsl.ir import Block, Operation, Region, SSAValue
from xdsl.passes import ModulePass

from yasps.dialects.mat import MatBuilder, MatOp, Matrix, matrix_type
from yasps.dialects.mat.algebra import TransposeOp
from yasps.dialects.mat.base import constant_value
from yasps.dialects.mat.elementwise import AddOp, DivideOp, NegOp, ScaleOp, SubOp
from yasps.dialects.mat.structure import ConstantOp, ReshapeOp
from yasps.dialects.rel import AttributeOp, DataOp, EnergyOp, ReadOp, SceneOp, StorageOp, YieldOp, name_of
from yasps.passes.analysis.dependence import Dependence, DependenceMap, size_of
from yasps.passes.analysis.reach import Reach
from yasps.passes.bodies import BodyBuilder, containers
from yasps.passes.calculus.linear_cut import coefficients
from yasps.passes.errors import working_on

STRUCTURAL = (0.0, 0.5, 1.0, 2.0)
"""Numbers that stay in the code, with either sign."""


@dataclass(frozen=True)
class LiftConstants(ModulePass):
    """See the module."""

    name = "lift-constants"

    def apply(self, ctx: Context, op: ModuleOp) -> None:
        for scene in containers(op):
            if not isinstance(scene, SceneOp):
                continue
            block = scene.body.block
            energies = {name_of(inner.attribute) for inner in block.ops if isinstance(inner, EnergyOp)}
            reach = Reach(block)
            first = next((inner for inner in block.ops if isinstance(inner, AttributeOp)), None)
            for attribute in [inner for inner in block.ops if isinstance(inner, AttributeOp)]:
                if attribute.body.blocks:
                    with working_on(attribute.symbol, attribute):
                        storage = _lift(attribute, scene.sym_name.data, reach, attribute.symbol in energies)
                    if storage is not None:
                        assert first is not None
                        block.insert_op_before(storage, first)


WHOLE = (ScaleOp, DivideOp, NegOp, ReshapeOp, TransposeOp)
"""Operations that keep all entries of a matrix of the result's size, up to one common factor."""

Use = tuple[Operation, int]
"""An operation and which of its operands."""


def _lift(attribute: AttributeOp, scene: str, reach: Reach, is_energy: bool) -> StorageOp | None:
    """Rewrites the body; returns the storage of what was taken out of it, or None where there was nothing."""
    body = attribute.body.block
    kept = _weights(body, reach) if is_energy else set()
    places: dict[Use, int] = {}
    numbers: list[float] = []
    for op in body.ops:
        for k, operand in enumerate(op.operands):
            entries = _liftable(operand)
            if entries is not None and (op, k) not in kept:
                places[op, k] = len(numbers)
                numbers += [float(entry) for entry in entries]
    if not numbers:
        return None
    name, type_ = f"{attribute.symbol}.numbers", matrix_type((len(numbers), 1))
    block = Block()
    b = BodyBuilder(block)
    read = DataOp(name, type_)
    b.append(read)
    values: dict[SSAValue, SSAValue] = {}

    def operand_of(op: Operation, k: int) -> SSAValue:
        operand = op.operands[k]
        if (op, k) in places:
            return _rebuilt(b, read.result, places[op, k], operand)
        if operand not in values:
            assert isinstance(operand.owner, ConstantOp)
            values[operand] = b.copy(operand.owner, [])
        return values[operand]

    for op in body.ops:
        if isinstance(op, ReadOp):
            values[op.result] = b.read(op)
        elif isinstance(op, MatOp) and not isinstance(op, ConstantOp):
            values[op.result] = b.copy(op, [operand_of(op, k) for k in range(len(op.operands))])
        elif isinstance(op, YieldOp):
            b.append(YieldOp(operand_of(op, 0)))
    attribute.detach_region(attribute.body)
    attribute.add_region(Region(block))
    storage = StorageOp(name, scene, type_, True, np.array(numbers).reshape(-1, 1))
    storage.location = attribute.location
    return storage


def _is_structural(entries: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.isin(np.abs(entries), STRUCTURAL)


def _is_multiple_of_identity(entries: NDArray[np.float64]) -> bool:
    rows, cols = entries.shape
    return rows == cols > 1 and bool(np.all(entries == entries[0, 0] * np.eye(rows)))


def _liftable(value: SSAValue) -> NDArray[np.float64] | None:
    """The numbers that stand for this constant when they are lifted; None if it is none, or has but structure."""
    if not isinstance(value.owner, ConstantOp):
        return None
    entries = constant_value(value)
    is_real = isinstance(cast(Matrix, value.type).element_type, Float64Type)
    if not is_real or entries is None or _is_structural(entries).all():
        return None
    if _is_multiple_of_identity(entries):
        return entries[0, :1]
    return np.where(_is_structural(entries), 0.0, entries).ravel()


def _rebuilt(b: MatBuilder, numbers: SSAValue, place: int, constant: SSAValue) -> SSAValue:
    """The constant, made of its structure and of the numbers from this place on."""
    entries = constant_value(constant)
    assert entries is not None
    rows, cols = entries.shape
    if _is_multiple_of_identity(entries):
        return b.scale(b.block(numbers, place, 0, 1, 1), b.identity(rows))
    lifted = b.reshape(b.block(numbers, place, 0, rows * cols, 1), (rows, cols))
    structural = _is_structural(entries)
    if not structural.any():
        return lifted
    return b.add(b.hadamard(b.constant((~structural).astype(float)), lifted), b.constant(entries * structural))


def _weights(body: Block, reach: Reach) -> set[Use]:
    """Uses of numbers as weights of sums that the energy is nonlinear in."""
    inputs: list[SSAValue] = [op.result for op in body.ops if isinstance(op, ReadOp) and reach.is_active(op)]
    dependence = DependenceMap(body, inputs)
    bent: set[SSAValue] = set()
    """What an operation is nonlinear in, and what is computed from affinely on the way there."""
    summed: set[SSAValue] = set()
    """What becomes one of several terms, or of several entries, of a bent value."""
    weights: set[Use] = set()
    for op in reversed(list(body.ops)):  # users before what they use
        if not isinstance(op, MatOp):
            continue
        active = [operand for operand in op.operands if dependence.is_active(operand)]
        if dependence[op.result] is Dependence.NONLINEAR:
            if op.result in bent or not op.is_linear([dependence.is_active(operand) for operand in op.operands]):
                bent.update(active)
        elif dependence[op.result] is Dependence.AFFINE and op.result in bent:
            bent.update(active)
            is_factor = isinstance(op, WHOLE) and size_of(active[0]) == size_of(op.result)
            is_shift = isinstance(op, AddOp | SubOp) and len(active) == 1
            if op.result in summed or not (is_factor or is_shift):
                summed.update(active)
                weights.update((op, k) for k in range(len(op.operands)) if not is_shift)
    weights = {(op, k) for op, k in weights if _liftable(op.operands[k]) is not None}
    return weights if weights and coefficients(dependence, inputs)[1] is not None else set()
