"""`infer-indices`: where each local derivative goes in the global gradient and Hessian (paper, section 6, appendix A).

kappa is an attribute like any other, on integers: data gives the place of its block (1-based, 0 = no contribution), a
JOIN gathers the kappas of the connected instances, a UNION takes the branch's kappa padded with zeros, everything else
concatenates. Its length is the capacity |kappa|.
"""

from __future__ import annotations

from dataclasses import dataclass

from xdsl.context import Context
from xdsl.dialects.builtin import IntegerType, ModuleOp
from xdsl.ir import Block, Operation, SSAValue
from xdsl.passes import ModulePass

from yasps.dialects.mat import MatBuilder, matrix_type, shape_of
from yasps.dialects.rel import (
    AttributeOp,
    ConnectivityOp,
    Container,
    DataOp,
    DerivativeOp,
    JacobianOp,
    JoinIndicesOp,
    JoinOp,
    RefOp,
    TargetIndexOp,
    TargetOp,
    UnionIndicesOp,
    UnionOp,
    YieldDerivativeOp,
    YieldJacobianOp,
    YieldOp,
    name_of,
    symbol,
)
from yasps.dialects.rel.declarations import StorageOp
from yasps.passes.bodies import containers, is_union

i32 = IntegerType(32)


@dataclass(frozen=True)
class InferIndices(ModulePass):
    """See the module."""

    name = "infer-indices"

    def apply(self, ctx: Context, op: ModuleOp) -> None:
        for container in containers(op):
            _IndexInference(container).run()


class _IndexInference:
    def __init__(self, container: Container) -> None:
        self.block = container.body.block
        ops = list(self.block.ops)
        self.attributes = {op.symbol: op for op in ops if isinstance(op, AttributeOp)}
        self.storages = {op.symbol: op for op in ops if isinstance(op, StorageOp)}
        self.arities = {op.symbol: op.arity.value.data for op in ops if isinstance(op, ConnectivityOp)}
        self.jacobians = {name_of(op.attribute): op for op in ops if isinstance(op, JacobianOp)}
        self.derivatives = [op for op in ops if isinstance(op, DerivativeOp)]
        self.targets = {name_of(op.variable) for op in ops if isinstance(op, TargetOp)}
        self._kappas: dict[str, AttributeOp] = {}

    def run(self) -> None:
        for derivative in self.derivatives:
            terminator = derivative.body.block.last_op
            assert isinstance(terminator, YieldDerivativeOp)
            name = f"{name_of(derivative.attribute)}.kappa"
            kappa = self.concatenated(name, derivative, list(terminator.wrt))
            derivative.indices = symbol(kappa.symbol)
        for attribute, jacobian in self.jacobians.items():
            jacobian.indices = symbol(self.kappa_of(attribute).symbol)
        for kappa in self._kappas.values():
            self.block.add_op(kappa)

    def kappa_of(self, name: str) -> AttributeOp:
        """kappa of a source: a target, an attribute on the way to one, or anything constant."""
        key = f"{name}.kappa"
        if key in self._kappas:
            return self._kappas[key]
        if name in self.jacobians:
            terminator = self.jacobians[name].body.block.last_op
            assert isinstance(terminator, YieldJacobianOp)
            return self.concatenated(key, self.jacobians[name], list(terminator.wrt))
        attribute = self.attributes.get(name)
        if attribute is not None and is_union(attribute):
            return self.union(key, attribute)
        source = self.storages[name] if name in self.storages else self.attributes[name]
        b = MatBuilder(Block())
        if name in self.targets:
            op = TargetIndexOp(name)
            b.append(op)
            value: SSAValue = op.result
        else:
            value = b.zeros((1, 1), i32)  # no contribution
        return self.define(key, source, b, value)

    def union(self, key: str, attribute: AttributeOp) -> AttributeOp:
        union = attribute.body.block.first_op
        assert isinstance(union, UnionOp)
        kappas = [self.kappa_of(name_of(member)) for member in union.members]
        capacity = max(kappa.matrix_type.get_shape()[1] for kappa in kappas)
        b = MatBuilder(Block())
        op = UnionIndicesOp([kappa.symbol for kappa in kappas], matrix_type((1, capacity), i32))
        b.append(op)
        return self.define(key, attribute, b, op.result)

    def concatenated(self, key: str, user: DerivativeOp | JacobianOp, wrt: list[SSAValue]) -> AttributeOp:
        b = MatBuilder(Block())
        parts = [self.of_read(b, value.owner) for value in wrt]
        return self.define(key, user, b, b.concat_cols(parts))

    def of_read(self, b: MatBuilder, read: Operation | Block) -> SSAValue:
        """kappa of one boundary input, as a row."""
        if isinstance(read, DataOp):
            op: DataOp | JoinOp | RefOp | TargetIndexOp = TargetIndexOp(name_of(read.storage))
        elif isinstance(read, RefOp):
            kappa = self.kappa_of(name_of(read.attribute))
            op = RefOp(kappa.symbol, kappa.matrix_type)
        else:
            assert isinstance(read, JoinOp)
            kappa = self.kappa_of(name_of(read.source))
            connectivity = name_of(read.connectivity)
            shape = (self.arities[connectivity], kappa.matrix_type.get_shape()[1])
            op = JoinIndicesOp(kappa.symbol, connectivity, matrix_type(shape, i32))
        b.append(op)
        rows, cols = shape_of(op.result)
        return b.reshape(op.result, (1, rows * cols))

    def define(
        self, key: str, of: StorageOp | AttributeOp | DerivativeOp | JacobianOp, b: MatBuilder, value: SSAValue
    ) -> AttributeOp:
        """Adds the attribute `key`, the kappa of `of`: it lives where that lives and was made where that was made."""
        b.append(YieldOp(value))
        kappa = AttributeOp(key, name_of(of.owner), matrix_type(shape_of(value), i32), b.body)
        kappa.location = of.location
        self._kappas[key] = kappa
        return kappa
