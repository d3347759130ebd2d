"""What the emitter asks about a compiled scene: declarations and objects by name, sizes of expanded derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

from xdsl.dialects.builtin import IntegerType, ModuleOp

from yasps.dialects.mat import Matrix, Shape
from yasps.dialects.rel import (
    ApplyOp,
    AttributeOp,
    ConnectivityOp,
    Container,
    CurvatureOp,
    DataOp,
    DerivativeOp,
    EnergyOp,
    JacobianOp,
    JoinOp,
    ObjectOp,
    PrimitiveUnionOp,
    ReadOp,
    RefOp,
    StorageOp,
    TargetOp,
    UnionOp,
    YieldDerivativeOp,
    YieldJacobianOp,
    YieldOp,
    YieldPullbackOp,
    name_of,
)


@dataclass(frozen=True)
class Slot:
    """One independent input of an energy or Jacobian: `source` at one instance."""

    source: str
    connectivity: str | None
    """None: at the instance itself."""
    arity: int
    position: int
    """Which of the `arity` connected instances."""
    size: int
    """Entries of the source on one instance."""
    rows: int
    """Most scalars of the global gradient behind it."""
    capacity: int
    """Most blocks of the global gradient behind it."""
    is_target: bool
    """Is the source a target itself, so that its entries are those of the gradient?"""
    is_direct: bool
    """Is it, at each instance, a target or constant? Then its entries are those of the gradient or go nowhere."""
    reduction: str | None = None
    """ "sum" or "mean" over a variable number of connected instances, at most `arity`."""


class SceneView:
    """Read access to a module after `outline-modules`."""

    def __init__(self, module: ModuleOp) -> None:
        self.storages: dict[str, StorageOp] = {}
        self.attributes: dict[str, AttributeOp] = {}
        self.connectivities: dict[str, ConnectivityOp] = {}
        self.unions: dict[str, PrimitiveUnionOp] = {}
        self.jacobians: dict[str, JacobianOp] = {}
        self.curvatures: dict[str, CurvatureOp] = {}
        self.derivatives: list[DerivativeOp] = []
        self.energies: list[EnergyOp] = []
        self.targets: list[str] = []
        self.objects: dict[str, ObjectOp] = {}
        """Objects by the symbol of the definition they hold."""
        for container in module.body.block.ops:
            if isinstance(container, Container):
                self._add(container)

    def _add(self, container: Container) -> None:
        for op in container.body.block.ops:
            if isinstance(op, StorageOp):
                self.storages[op.symbol] = op
            elif isinstance(op, ConnectivityOp):
                self.connectivities[op.symbol] = op
            elif isinstance(op, PrimitiveUnionOp):
                self.unions[op.symbol] = op
            elif isinstance(op, EnergyOp):
                self.energies.append(op)
            elif isinstance(op, TargetOp):
                self.targets.append(name_of(op.variable))
            elif isinstance(op, AttributeOp):
                if op.symbol not in self.attributes or op.body.blocks:  # a definition beats its declaration
                    self.attributes[op.symbol] = op
            elif isinstance(op, JacobianOp):
                self.jacobians[name_of(op.attribute)] = op
            elif isinstance(op, CurvatureOp):
                self.curvatures[name_of(op.attribute)] = op
            elif isinstance(op, DerivativeOp):
                self.derivatives.append(op)
            else:
                continue
            if isinstance(container, ObjectOp) and isinstance(
                op, AttributeOp | JacobianOp | CurvatureOp | DerivativeOp
            ):
                self.objects[op.symbol] = container

    def type_of(self, name: str) -> Matrix:
        """Type of a storage or attribute, on one instance."""
        if name in self.storages:
            return cast(Matrix, self.storages[name].type)
        return self.attributes[name].matrix_type

    def shape(self, name: str) -> Shape:
        rows, cols = self.type_of(name).get_shape()
        return rows, cols

    def size(self, name: str) -> int:
        """Entries of a storage or attribute, on one instance."""
        rows, cols = self.shape(name)
        return rows * cols

    def is_union(self, name: str) -> bool:
        attribute = self.attributes.get(name)
        return (
            attribute is not None and bool(attribute.body.blocks) and isinstance(attribute.body.block.first_op, UnionOp)
        )

    def union_members(self, name: str) -> list[str]:
        """Names of the attributes or storages a UNION attribute unites."""
        union = self.attributes[name].body.block.first_op
        assert isinstance(union, UnionOp)
        return [name_of(member) for member in union.members]

    def reaches_target(self, name: str) -> bool:
        """Does this source have derivatives?"""
        if name in self.targets or name in self.jacobians:
            return True
        return self.is_union(name) and any(self.reaches_target(member) for member in self.union_members(name))

    def is_direct(self, name: str) -> bool:
        """Is each instance of this source a target itself, or free of targets? Its placement index is then one number,
        0 where there is no target, and there is nothing to pull back."""
        if name in self.targets:
            return True
        return self.is_union(name) and all(
            self.is_direct(member) or not self.reaches_target(member) for member in self.union_members(name)
        )

    def leaf_sizes(self, name: str) -> list[int] | None:
        """Unknowns of each block behind one instance of this source, if they are the same at all instances.

        None where they may differ: behind UNIONs, unless these are direct, JOINs of variable arity, and nonlinear
        attributes, whose Hessians are projected as a whole.
        """
        if self.is_direct(name):
            return [self.size(name)]
        if name not in self.jacobians or name in self.curvatures:
            return None
        sizes: list[int] = []
        for slot in (slot for read in self.wrt(self.jacobians[name]) for slot in self.slots(read)):
            behind = self.leaf_sizes(slot.source)
            if behind is None or slot.reduction is not None:
                return None
            sizes += behind
        return sizes

    def branches(self, name: str) -> list[str] | None:
        """The parameterised sources that a UNION takes its instances from, those behind inner UNIONs among them; of
        another source itself. Direct ones are left out. None where the unknowns behind one of them may differ."""
        if self.is_union(name) and not self.is_direct(name):
            found: list[str] = []
            for member in self.union_members(name):
                if self.is_constant(member):
                    continue
                behind = self.branches(member)
                if behind is None:
                    return None
                found += behind
            return found
        if self.leaf_sizes(name) is None:
            return None
        return [] if self.is_direct(name) else [name]

    def is_constant(self, name: str) -> bool:
        """Is the source free of targets?"""
        return not self.reaches_target(name)

    def runs_in_lanes(self, derivative: DerivativeOp) -> bool:
        """Can what lies behind the inputs be pulled back for several instances at once?"""
        slots = [slot for read in self.wrt(derivative) for slot in self.slots(read)]
        return derivative.curved is None and all(
            slot.reduction is None and self.branches(slot.source) is not None for slot in slots
        )

    @cached_property
    def pulled_in_lanes(self) -> bool:
        """Is anything pulled back for several instances at once?"""
        return any(map(self.runs_in_lanes, self.derivatives))

    @cached_property
    def pulled_one_by_one(self) -> bool:
        """Is anything pulled back for single instances?"""
        return not all(map(self.runs_in_lanes, self.derivatives))

    @cached_property
    def read_one_by_one(self) -> bool:
        """Does anything read computed numbers for single instances on the processor?

        What pulls back for single instances does, a JOIN of variable arity, and what is nothing but a read.
        """
        reads = [op for container in self.objects.values() for op in container.walk() if isinstance(op, JoinOp)]
        for name, container in self.objects.items():
            attribute = self.attributes.get(name)
            if attribute is None or not any(entry.data == "batch" for entry in container.entries):
                continue
            terminator = attribute.body.block.last_op
            assert isinstance(terminator, YieldOp)
            is_number = not isinstance(attribute.matrix_type.element_type, IntegerType)
            if is_number and not isinstance(terminator.value.owner, ApplyOp):
                return True
        return self.pulled_one_by_one or any(read.reduction is not None for read in reads)

    def is_stored(self, name: str) -> bool:
        """Are its numbers stored as they are: those of a storage, or of the storages a UNION unites?"""
        if name in self.storages:
            return True
        return self.is_union(name) and all(map(self.is_stored, self.union_members(name)))

    def is_curved(self, name: str) -> bool:
        """Is the source, or one behind it, nonlinear in the targets?"""
        if name in self.curvatures:
            return True
        if name in self.jacobians:
            return any(
                self.is_curved(slot.source) for read in self.wrt(self.jacobians[name]) for slot in self.slots(read)
            )
        return self.is_union(name) and any(self.is_curved(member) for member in self.union_members(name))

    def expanded_rows(self, name: str) -> int:
        """Most scalars of the global gradient that one instance of this source depends on."""
        return self._most_behind(name, self.size, lambda slot: slot.rows, 0)

    def capacity(self, name: str) -> int:
        """|kappa|: most blocks of the global gradient that one instance of this source depends on (appendix A.2)."""
        return self._most_behind(name, lambda _: 1, lambda slot: slot.capacity, 1)

    def _most_behind(
        self, name: str, of_target: Callable[[str], int], of_slot: Callable[[Slot], int], least: int
    ) -> int:
        """What the targets behind one instance of a source add up to; of a UNION's members the most."""
        if name in self.targets:
            return of_target(name)
        if name in self.jacobians:
            return sum(of_slot(slot) for read in self.wrt(self.jacobians[name]) for slot in self.slots(read))
        if self.is_union(name):
            members = self.union_members(name)
            return max(least, *(self._most_behind(member, of_target, of_slot, least) for member in members))
        return least

    def slots(self, read: ReadOp) -> list[Slot]:
        """The independent inputs a boundary read consists of: one for each connected instance of a JOIN."""
        if isinstance(read, JoinOp):
            source, connectivity = name_of(read.source), name_of(read.connectivity)
            arity = self.connectivities[connectivity].arity.value.data
            if read.reduction is not None:
                one = self._slot(source, connectivity, arity, 0)
                rows, capacity = arity * one.rows, arity * one.capacity
                return [
                    replace(
                        one, rows=rows, capacity=capacity, is_target=False, is_direct=False, reduction=read.reduction
                    )
                ]
            return [self._slot(source, connectivity, arity, position) for position in range(arity)]
        if isinstance(read, RefOp):
            return [self._slot(name_of(read.attribute), None, 1, 0)]
        assert isinstance(read, DataOp)
        return [self._slot(name_of(read.storage), None, 1, 0)]

    def _slot(self, source: str, connectivity: str | None, arity: int, position: int) -> Slot:
        return Slot(
            source,
            connectivity,
            arity,
            position,
            self.size(source),
            self.expanded_rows(source),
            self.capacity(source),
            source in self.targets,
            self.is_direct(source),
        )

    def wrt(self, op: DerivativeOp | JacobianOp) -> list[ReadOp]:
        """The boundary reads a derivative is taken with respect to."""
        terminator = op.body.block.last_op
        assert isinstance(terminator, YieldDerivativeOp | YieldJacobianOp | YieldPullbackOp)
        return [cast(ReadOp, value.owner) for value in terminator.wrt]
