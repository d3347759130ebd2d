"""The frontend's scene as `rel` and `mat` operations: the compiler's input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from xdsl.dialects.builtin import FileLineColLoc, IntAttr, ModuleOp, StringAttr, UnitAttr
from xdsl.ir import Block, Operation, SSAValue

from yasps.dialects.mat import MatBuilder, matrix_type
from yasps.dialects.mat.builder import named
from yasps.dialects.mat.calculus import GivenDerivativeOp
from yasps.dialects.rel import (
    AttributeOp,
    ConnectivityOp,
    DataOp,
    EnergyOp,
    JoinNumbersOp,
    JoinOp,
    MeshOp,
    PrimitiveOp,
    PrimitiveUnionOp,
    RefOp,
    SceneOp,
    StorageOp,
    TargetOp,
    UnionNumbersOp,
    UnionOp,
    YieldOp,
)
from yasps.frontend.errors import SceneError
from yasps.frontend.language.attribute import Attribute
from yasps.frontend.language.connectivity import Connectivity
from yasps.frontend.language.entity import Entity
from yasps.frontend.language.given_derivatives import read_beside
from yasps.frontend.language.mesh import Mesh
from yasps.frontend.language.nodes import Computed, Joined, Named, Stored, United
from yasps.frontend.language.primitive import PrimitiveBase, PrimitiveUnion


@dataclass(frozen=True)
class EnergyTerm:
    """One registered energy."""

    attribute: Attribute
    projection: str
    dynamic: bool


class SceneEmitter:
    """Emits what energies, targets and outputs need of one scene."""

    def __init__(self, scene_name: str) -> None:
        self.scene_name = scene_name
        self.meshes: dict[str, MeshOp] = {}
        self.primitives: dict[str, Operation] = {}
        self.connectivities: dict[str, ConnectivityOp] = {}
        self.storages: dict[str, StorageOp] = {}
        self.attributes: dict[str, AttributeOp] = {}
        self.stored: dict[str, Attribute] = {}
        """The user's stored attributes, by symbol."""
        self.kept: dict[str, Attribute] = {}
        """Attributes whose values are kept, by the symbol of the storage that holds them; first those that others read.
        """
        self.connected: dict[str, Connectivity] = {}
        self.owners: dict[str, PrimitiveBase] = {}
        self._symbols: dict[Attribute, str] = {}
        self._unnamed = 0
        self.varied: set[Attribute] = set()
        self._keeps = False

    def emit(
        self,
        energies: Sequence[EnergyTerm],
        targets: Sequence[Attribute],
        outputs: Sequence[Attribute],
        *,
        keeps: bool = False,
    ) -> ModuleOp:
        """The module `rel.scene`, in dependency order. Constants among the targets are emitted as variables.

        keeps: of what a JOIN reads and depends on no target the values are kept in a storage, see `joined`.
        """
        self.varied = set(targets)
        self._keeps = keeps and len(targets) > 0
        final: list[Operation] = [
            EnergyOp(self.defined(term.attribute), term.projection, term.dynamic) for term in energies
        ]
        final += [TargetOp(self.defined(target)) for target in targets]
        for output in outputs:
            self.attributes[self.defined(output)].output = UnitAttr()
        groups = (self.meshes, self.primitives, self.connectivities, self.storages, self.attributes)
        ops: list[Operation] = [op for group in groups for op in group.values()]
        return ModuleOp([SceneOp(self.scene_name, [*ops, *final])])

    def symbol_of(self, attribute: Attribute) -> str:
        """The symbol of an attribute that was emitted."""
        return self._symbols[attribute]

    def owner(self, entity: Entity) -> str:
        """Emits an entity; returns its symbol."""
        if isinstance(entity, Mesh):
            if entity.path not in self.meshes:
                self.meshes[entity.path] = MeshOp(entity.path, self.scene_name)
        elif isinstance(entity, PrimitiveBase):
            if entity.path not in self.primitives:
                mesh = self.owner(entity.mesh)
                self.owners[entity.path] = entity
                if isinstance(entity, PrimitiveUnion):
                    members = [self.owner(member) for member in entity.members]
                    self.primitives[entity.path] = PrimitiveUnionOp(entity.path, mesh, members)
                else:
                    self.primitives[entity.path] = PrimitiveOp(
                        entity.path, mesh, entity.num_instances, entity.is_dynamic
                    )
        else:
            return self.scene_name
        return entity.path

    def connectivity(self, connectivity: Connectivity) -> str:
        """Emits a connectivity; returns its symbol."""
        if connectivity.path not in self.connectivities:
            source, target = self.owner(connectivity.source), self.owner(connectivity.target)
            self.connectivities[connectivity.path] = ConnectivityOp(
                connectivity.path, source, target, connectivity.arity, connectivity.is_variable
            )
            self.connected[connectivity.path] = connectivity
        return connectivity.path

    def defined(self, attribute: Attribute) -> str:
        """Emits an attribute with a symbol of its own; returns the symbol."""
        if attribute in self._symbols:
            return self._symbols[attribute]
        assert attribute.owner is not None
        owner = self.owner(attribute.owner)
        type_ = matrix_type(attribute.shape)
        name = attribute.name
        if name is None:
            self._unnamed += 1
            name = f"unnamed.{self._unnamed}"  # the dot keeps it apart from the user's names
        symbol = f"{attribute.owner.path}.{name}" if attribute.owner.path else name
        self._symbols[attribute] = symbol
        if isinstance(attribute.node, Stored):
            constant = attribute.node.constant and attribute not in self.varied
            self.storages[symbol] = StorageOp(symbol, owner, type_, constant)
            self.stored[symbol] = attribute
            op: Operation = self.storages[symbol]
        else:
            body = self.body(attribute)
            self.attributes[symbol] = AttributeOp(symbol, owner, type_, body)
            op = self.attributes[symbol]
        where = attribute.where
        op.location = FileLineColLoc(StringAttr(where.file), IntAttr(where.line), IntAttr(0))
        return symbol

    def body(self, attribute: Attribute) -> Block:
        """The body of an attribute: its expression down to data, references, JOIN or UNION."""
        b = MatBuilder(Block())
        values: dict[Attribute, SSAValue] = {}
        root = attribute.node.expression if isinstance(attribute.node, Named) else attribute
        node = root.node if root is attribute else None
        if isinstance(node, Joined):
            source, connectivity = self.joined(node.source), self.connectivity(node.connectivity)
            read: JoinOp | UnionOp = JoinNumbersOp(source, connectivity, matrix_type(attribute.shape), node.operation)
            b.append(read)
            values[root] = read.result
        elif isinstance(node, United):
            read = UnionNumbersOp([self.defined(member) for member in node.members], matrix_type(attribute.shape))
            b.append(read)
            values[root] = read.result
        stack = [root]
        while stack:
            current = stack[-1]
            if current in values:
                stack.pop()
                continue
            if isinstance(current.node, Computed):
                missing = [operand for operand in current.node.operands if operand not in values]
                if missing:
                    stack.extend(missing)
                    continue
                if current.node.op_class is GivenDerivativeOp:
                    self.check_arguments(current)
                operands = [values[operand] for operand in current.node.operands]
                values[current] = b.emit(current.node.op_class, operands, dict(current.node.properties))
            else:
                values[current] = self.reference(b, current)
            stack.pop()
        b.append(YieldOp(named(values[root], attribute.name)))
        return b.body

    def joined(self, source: Attribute) -> str:
        """Emits what a JOIN reads; returns its symbol.

        A JOIN works its source out anew for each instance that reads it, in each kernel. What depends on no target
        stays as it is from one solve to the next, so that its values are kept: they are a constant storage, and whoever
        runs the code fills it when something that the source is computed from has changed. The instances of a dynamic
        primitive change too often for that.
        """
        symbol = self.defined(source)
        assert source.owner is not None
        is_fixed = not isinstance(source.node, Stored) and self.varied.isdisjoint(source.inputs)
        if not (self._keeps and is_fixed) or source.owner.is_dynamic:
            return symbol
        kept = f"{symbol}.kept"  # no name has a dot
        if kept not in self.storages:
            self.storages[kept] = StorageOp(kept, self.owner(source.owner), matrix_type(source.shape), True)
            self.storages[kept].location = self.attributes[symbol].location
            self.attributes[symbol].output = UnitAttr()
            self.kept[kept] = source
        return kept

    def check_arguments(self, attribute: Attribute) -> None:
        """Raises SceneError if an attribute with given derivatives depends on a target beside its arguments."""
        for stored in read_beside(attribute):
            if stored in self.varied:
                raise SceneError(
                    f"derivatives with respect to {stored.path} are asked for, and what was given at {attribute.where} "
                    "by with_derivatives depends on it otherwise than through the arguments named there: name it among "
                    "them, or write the formula with them"
                )

    def reference(self, b: MatBuilder, attribute: Attribute) -> SSAValue:
        """Reads another attribute of the lineage."""
        symbol, type_ = self.defined(attribute), matrix_type(attribute.shape)
        read = DataOp(symbol, type_) if isinstance(attribute.node, Stored) else RefOp(symbol, type_)
        read.result.name_hint = attribute.name
        b.append(read)
        return read.result
