"""Names of values for people: what a pass or the user calls a value, else what it is (`det_F`, `position_row1`).

Names that are derived from operations are made when a dump is printed, and nowhere else: no pass has to hand them on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from xdsl.dialects.builtin import SymbolRefAttr
from xdsl.ir import SSAValue

from yasps.dialects.mat import MatOp, shape_of
from yasps.dialects.mat.base import Batch, constant_value, is_identity, is_zero
from yasps.dialects.mat.structure import BlockOp, ConstantOp, IdentityOp, ReshapeOp
from yasps.dialects.rel import DataOp, JoinOp, ReadOp, RefOp, TargetIndexOp, UnionOp, name_of

LONGEST = 32
"""Characters of a derived name; what would be longer gets a number."""
SHORT = {"trace": "tr", "transpose": "t", "inverse": "inv", "cofactor": "cof", "neg": "minus"}
"""Words of operations as names have them, where that is not the word itself."""


def value_name(value: SSAValue) -> str | None:
    """What to call a value; None where nothing short says what it is."""
    if value.name_hint is not None:
        return value.name_hint
    op = value.owner
    if isinstance(op, ReadOp):
        name: str | None = _read_name(op)
    elif isinstance(op, ConstantOp | IdentityOp):
        name = _constant_name(value)
    elif isinstance(op, MatOp) and len(op.operands) == 1:
        name = _of_one(op)
    else:
        return None
    if name is None or len(name) > LONGEST:
        return None
    return SSAValue.extract_valid_name(name) if SSAValue.is_valid_name(name) else None


def _last(symbol: SymbolRefAttr) -> str:
    """The attribute's own name; of what passes made of an attribute, its own and theirs (`x.kappa`)."""
    parts = name_of(symbol).split(".")
    return "_".join(parts[-2:]) if parts[-1] in ("kappa", "numbers") and len(parts) > 1 else parts[-1]


READ_NAMES: dict[type[ReadOp], Callable[..., str]] = {
    DataOp: lambda op: _last(op.storage),
    RefOp: lambda op: _last(op.attribute),
    JoinOp: lambda op: f"{_last(op.source)}_at_{_last(op.connectivity)}",
    UnionOp: lambda op: _last(op.members.data[0]),
    TargetIndexOp: lambda op: f"index_of_{_last(op.target)}",
}


def _read_name(op: ReadOp) -> str:
    (rule,) = [rule for kind, rule in READ_NAMES.items() if isinstance(op, kind)]
    return rule(op)


def _constant_name(value: SSAValue) -> str | None:
    if shape_of(value) != (1, 1):
        return "zero" if is_zero(value) else "identity" if is_identity(value) else None
    number = cast(Batch, constant_value(value)).item()
    if number != int(number if abs(number) < 100 else 0):
        return "half" if number == 0.5 else None
    return f"c{int(number)}" if number >= 0 else f"cm{int(-number)}"


def _of_one(op: MatOp) -> str | None:
    operand = value_name(op.operands[0])
    if operand is None:
        return None
    if isinstance(op, ReshapeOp):
        return f"{operand}_flat" if shape_of(op.result)[1] == 1 else None
    if isinstance(op, BlockOp):
        return _part_name(op, operand)
    return f"{SHORT.get(op.word(), op.word())}_{operand}" if not op.properties else None


def _part_name(op: BlockOp, operand: str) -> str | None:
    row, col, rows, cols = op.bounds
    height, width = shape_of(op.operands[0])
    if (rows, cols) == (1, width):
        return f"{operand}_row{row}"
    if (rows, cols) == (height, 1):
        return f"{operand}_col{col}"
    return f"{operand}_r{row}c{col}" if rows == cols == 1 else None
