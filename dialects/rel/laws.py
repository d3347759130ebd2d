"""The laws of the relational language, checked for all declarations of a container at once.

One lineage for each body (paper, 4.3); JOIN's source lives on the connectivity's target (4.5); UNION's members have one
shape and come in the order of the primitive union (4.6); energies are 1x1; targets are stored variables.
"""

from __future__ import annotations

from typing import cast

from xdsl.dialects.builtin import StringAttr
from xdsl.ir import Block, Operation
from xdsl.utils.exceptions import VerifyException

from yasps.dialects.mat import Matrix, spell
from yasps.dialects.mat.syntax import spell_type
from yasps.dialects.rel import body as body_ops
from yasps.dialects.rel import declarations as decl
from yasps.dialects.rel.declarations import name_of
from yasps.dialects.rel.terminators import YieldOp


class BrokenLawError(VerifyException):
    """A law does not hold. `declaration`: whose body or words break it, None where what is named does not exist."""

    def __init__(self, reason: str, declaration: decl.Declaration | None) -> None:
        super().__init__(reason)
        self.declaration = declaration


class Scope:
    """Symbols of one container, and the lineage of its entities."""

    def __init__(self, container: Operation) -> None:
        self.symbols: dict[str, Operation] = {}
        parent = container.parent
        if isinstance(container, decl.ObjectOp) and parent is not None:  # what it uses stands declared in the scene
            for op in parent.ops:
                if isinstance(op, decl.SceneOp):
                    self._add(op)
        self._add(container)

    def _add(self, container: Operation) -> None:
        for op in container.regions[0].block.ops:
            name = op.get_attr_or_prop("sym_name")
            if isinstance(name, StringAttr):
                self.symbols[name.data] = op

    def find(self, name: str, kinds: tuple[type[Operation], ...], what: str, user: str) -> Operation:
        op = self.symbols.get(name)
        if op is None:
            raise VerifyException(f"{user} names {what} @{name}, which does not exist")
        if not isinstance(op, kinds):
            raise VerifyException(f"{user} needs {what}, but @{name} is {op.name}")
        return op

    def lineage(self, entity: str) -> list[str]:
        """The entity, its mesh and its scene; the scene alone stands for itself."""
        op = self.symbols.get(entity)
        if isinstance(op, decl.PrimitiveOp | decl.PrimitiveUnionOp):
            return [entity, *self.lineage(name_of(op.mesh))]
        if isinstance(op, decl.MeshOp):
            return [entity, name_of(op.scene)]
        if op is None:  # the scene, which is the container itself
            return [entity]
        raise VerifyException(f"@{entity} is {op.name}, not a scene, mesh or primitive")

    def owner_and_type(self, name: str, user: str) -> tuple[str, Matrix]:
        op = self.find(name, (decl.StorageOp, decl.AttributeOp), "an attribute", user)
        assert isinstance(op, decl.StorageOp | decl.AttributeOp)
        return name_of(op.owner), cast(Matrix, op.type)


def verify_laws(container: Operation) -> None:
    """Raises BrokenLawError for the first law that does not hold."""
    scope = Scope(container)
    for op in container.regions[0].block.ops:
        try:
            _verify_declaration(scope, op)
        except VerifyException as error:
            raise BrokenLawError(str(error), _whose(scope, op)) from error


def _whose(scope: Scope, op: Operation) -> decl.Declaration | None:
    """The declaration that an operation of a scene is about: itself, or what an energy or a target names."""
    if isinstance(op, decl.EnergyOp | decl.TargetOp):
        named = scope.symbols.get(name_of(op.attribute if isinstance(op, decl.EnergyOp) else op.variable))
        return named if isinstance(named, decl.Declaration) else None
    return op if isinstance(op, decl.Declaration) else None


def _verify_declaration(scope: Scope, op: Operation) -> None:
    if isinstance(op, decl.ConnectivityOp):
        _verify_connectivity(scope, op)
    elif isinstance(op, decl.PrimitiveUnionOp):
        for member in op.members:
            kinds = (decl.PrimitiveOp, decl.PrimitiveUnionOp)
            scope.find(name_of(member), kinds, "a primitive", f"@{op.symbol}")
    elif isinstance(op, decl.EnergyOp):
        _, type_ = scope.owner_and_type(name_of(op.attribute), "an energy")
        if type_.get_shape() != (1, 1):
            raise VerifyException(
                f"an energy is 1x1, but @{name_of(op.attribute)} is {'x'.join(map(str, type_.get_shape()))}"
            )
    elif isinstance(op, decl.TargetOp):
        name = name_of(op.variable)
        storage = scope.find(name, (decl.StorageOp,), "a stored variable as target", "a target")
        if cast(decl.StorageOp, storage).constant is not None:
            raise VerifyException(f"@{name} is a constant; a target must be a variable")
    elif isinstance(op, decl.AttributeOp | decl.DerivativeOp | decl.JacobianOp | decl.CurvatureOp) and op.body.blocks:
        _verify_body(scope, op, op.body.block)


def _verify_connectivity(scope: Scope, op: decl.ConnectivityOp) -> None:
    user = f"@{op.symbol}"
    scope.find(name_of(op.source), (decl.PrimitiveOp, decl.PrimitiveUnionOp), "a primitive", user)
    scope.find(name_of(op.target), (decl.PrimitiveOp, decl.PrimitiveUnionOp), "a primitive", user)
    if op.arity.value.data < 1:
        raise VerifyException(f"{user} has arity {op.arity.value.data}; the least is 1")


def _verify_body(
    scope: Scope, op: decl.AttributeOp | decl.DerivativeOp | decl.JacobianOp | decl.CurvatureOp, block: Block
) -> None:
    user = f"@{op.symbol}"
    lineage = scope.lineage(name_of(op.owner))
    for inner in block.ops:
        if isinstance(inner, body_ops.DataOp | body_ops.RefOp):
            name = name_of(inner.storage if isinstance(inner, body_ops.DataOp) else inner.attribute)
            owner, type_ = scope.owner_and_type(name, user)
            if owner not in lineage:
                raise VerifyException(
                    f"{user} lives on @{lineage[0]} and reads @{name} of @{owner}: attributes of different lineages "
                    "meet only through a JOIN or a UNION"
                )
            if isinstance(inner, body_ops.DataOp):
                scope.find(name, (decl.StorageOp,), "a stored attribute for rel.data", user)
            else:
                scope.find(name, (decl.AttributeOp,), "a computed attribute for rel.ref", user)
            _same_type(user, name, type_, inner.matrix_type)
        elif isinstance(inner, body_ops.JoinOp):
            _verify_join(scope, user, lineage[0], inner)
        elif isinstance(inner, body_ops.UnionOp):
            _verify_union(scope, user, lineage[0], inner)
        elif isinstance(inner, body_ops.TargetIndexOp):
            scope.find(name_of(inner.target), (decl.StorageOp,), "a stored variable", user)
    if isinstance(op, decl.AttributeOp):
        last = block.last_op
        if not isinstance(last, YieldOp):
            raise VerifyException(f"{user} must end with rel.yield")
        _same_type(user, op.symbol, op.matrix_type, cast(Matrix, last.value.type))


def _same_type(user: str, name: str, declared: Matrix, used: Matrix) -> None:
    if declared != used:
        raise VerifyException(f"{user} uses @{name} as {spell_type(used)}, but it is {spell_type(declared)}")


def _verify_join(scope: Scope, user: str, owner: str, op: body_ops.JoinOp) -> None:
    name = name_of(op.connectivity)
    connectivity = scope.find(name, (decl.ConnectivityOp,), "a connectivity", user)
    assert isinstance(connectivity, decl.ConnectivityOp)
    if name_of(connectivity.source) != owner:
        raise VerifyException(f"{user} lives on @{owner}, but connectivity @{name} starts at {connectivity.source}")
    source_owner, type_ = scope.owner_and_type(name_of(op.source), user)
    if source_owner != name_of(connectivity.target):
        raise VerifyException(
            f"{user} joins @{name_of(op.source)} of @{source_owner} through @{name}, which leads to "
            f"{connectivity.target}"
        )
    rows, cols = type_.get_shape()
    arity = connectivity.arity.value.data
    if (connectivity.variable is not None) != (op.reduction is not None) and not isinstance(op, body_ops.JoinIndicesOp):
        raise VerifyException(
            f"{user}: a JOIN through @{name} "
            + (
                "needs an operation, its arity varies"
                if op.reduction is None
                else "takes no operation, its arity is fixed"
            )
        )
    if op.reduction is not None:
        _same_type(user, name_of(op.source), type_, op.matrix_type)
        return
    if op.matrix_type.get_shape() != (arity, rows * cols):
        raise VerifyException(
            f"{user}: a JOIN of arity {arity} of {rows}x{cols} values is {arity}x{rows * cols}, not "
            f"{spell_type(op.result.type)}"
        )


def _verify_union(scope: Scope, user: str, owner: str, op: body_ops.UnionOp) -> None:
    union = scope.find(owner, (decl.PrimitiveUnionOp,), "a primitive union", user)
    assert isinstance(union, decl.PrimitiveUnionOp)
    expected = [name_of(m) for m in union.members]
    if len(expected) != len(op.members):
        raise VerifyException(f"{user} unites {len(op.members)} attributes, but @{owner} has {len(expected)} members")
    padded = isinstance(op, body_ops.UnionIndicesOp)
    for member, reference in zip(expected, op.members, strict=True):
        member_owner, type_ = scope.owner_and_type(name_of(reference), user)
        if member_owner != member:
            raise VerifyException(f"{user}: @{name_of(reference)} lives on @{member_owner}, expected @{member}")
        shape, wanted = type_.get_shape(), op.matrix_type.get_shape()
        fits = shape == wanted or (padded and shape[0] == 1 and shape[1] <= wanted[1])
        if not fits or type_.element_type != op.matrix_type.element_type:
            raise VerifyException(
                f"{user} is {spell((wanted[0], wanted[1]))}, but @{name_of(reference)} is {spell((shape[0], shape[1]))}"
            )
