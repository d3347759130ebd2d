"""How wide the local Hessian of an energy is, as derived and expanded to the targets, and how wide it may be."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import isqrt
from typing import cast

from xdsl.ir import Block, SSAValue

from yasps.dialects.mat import Matrix
from yasps.dialects.rel import AttributeOp, ConnectivityOp, DataOp, JoinOp, ReadOp, UnionOp, name_of
from yasps.dialects.rel.declarations import StorageOp
from yasps.passes.analysis.dependence import size_of
from yasps.passes.analysis.reach import Reach
from yasps.passes.bodies import is_union, source_of
from yasps.passes.errors import CompileError

DEVICE_THREAD = 512 << 10
"""Bytes of local memory of a GPU's thread, where the packed Hessians of an instance lie."""
WIDEST_INPUTS = (isqrt(1 + DEVICE_THREAD // 2) - 1) // 2
"""Numbers that an energy reads: two packed triangles of doubles, of the cut and of the inputs, fit there."""
MEMORY_OF_A_THREAD = 1 << 30
"""Bytes that a thread may take for one local Hessian that is expanded to the targets."""
BYTES_OF_AN_ENTRY = 8
"""Of a local Hessian that is expanded block by block (backend/cpp/expand.py)."""
BYTES_OF_A_PROJECTED_ENTRY = 1024
"""Of one that is projected as a whole: 16 matrices are decomposed at a time, each with 7 arrays of its size, and more
(`negative_part_scratch` and `memory_size` in runtime/projection/)."""
WIDEST_EXPANDED = isqrt(MEMORY_OF_A_THREAD // BYTES_OF_AN_ENTRY)
WIDEST_CURVED = isqrt(MEMORY_OF_A_THREAD // BYTES_OF_A_PROJECTED_ENTRY)
ADVICE = (
    "connect each instance to fewer others, or put what many of them share into an attribute with unknowns of its own"
    " (a target) and tie it to them by an energy"
)


@dataclass(frozen=True)
class _Width:
    """How many unknowns, and the factors of the most of them, as the user knows them."""

    unknowns: int
    factors: tuple[str, ...] = ()


class LocalWidth:
    """Of what the attributes in a container's block lead to, once references are inlined."""

    def __init__(self, block: Block, reach: Reach) -> None:
        self._attributes = {op.symbol: op for op in block.ops if isinstance(op, AttributeOp)}
        self._connectivities = {op.symbol: op for op in block.ops if isinstance(op, ConnectivityOp)}
        self._storages = {op.symbol: op for op in block.ops if isinstance(op, StorageOp)}
        self._reach = reach
        self._known: dict[str, _Width] = {}

    def check_inputs(self, inputs: Iterable[SSAValue]) -> None:
        """Raises CompileError where second derivatives with respect to so many inputs are too many."""
        widths = {value: size_of(value) for value in inputs}
        if (width := sum(widths.values())) > WIDEST_INPUTS:
            widest = max(widths, key=widths.__getitem__)
            raise CompileError(
                f"its local Hessian would be {width} numbers wide, but {WIDEST_INPUTS} is the most (the Hessian of an"
                f" instance has to fit in the {DEVICE_THREAD >> 10} KiB of a GPU's thread); most of its inputs are"
                f" {self._read(widest)}; {ADVICE}; or sum over instances by a connectivity with counts= and"
                " operation='sum'"
            )

    def check_expanded(self, inputs: Iterable[SSAValue], *, curved: bool) -> None:
        """Raises CompileError where the inputs lead to more unknowns than a local Hessian may have rows.

        curved: is it projected as a whole, since inputs are nonlinear in the unknowns?
        """
        width = self._of_reads(value.owner for value in inputs)
        most = WIDEST_CURVED if curved else WIDEST_EXPANDED
        if width.unknowns <= most:
            return
        takes = f"projecting it takes {BYTES_OF_A_PROJECTED_ENTRY}" if curved else f"it takes {BYTES_OF_AN_ENTRY}"
        raise CompileError(
            f"its local Hessian would be up to {width.unknowns} unknowns wide (one that an instance reads twice counts"
            f" twice), but {most} is the most ({takes} bytes times the square of the width, and a thread may take"
            f" {MEMORY_OF_A_THREAD >> 30} GiB); most of them come from {' times '.join(width.factors)}; {ADVICE}"
        )

    def _of_reads(self, reads: Iterable[object]) -> _Width:
        widths = [self._of_read(read) for read in reads if isinstance(read, ReadOp)]
        most = max(widths, key=lambda width: width.unknowns, default=_Width(0))
        return _Width(sum(width.unknowns for width in widths), most.factors)

    def _of_read(self, read: ReadOp) -> _Width:
        if not self._reach.is_active(read):
            return _Width(0)
        if isinstance(read, UnionOp):
            members = [name for name in map(name_of, read.members) if self._reach.reaches_target(name)]
            return max(map(self._behind, members), key=lambda width: width.unknowns)
        source = name_of(read.storage) if isinstance(read, DataOp) else source_of(read)
        assert source is not None
        behind = self._behind(source)
        if not isinstance(read, JoinOp):
            return behind
        times = self._connectivities[name_of(read.connectivity)].arity.value.data
        return _Width(times * behind.unknowns, (self._through(read), *behind.factors))

    def _behind(self, name: str) -> _Width:
        """Unknowns behind one instance of an attribute or storage."""
        if name not in self._known:
            attribute = self._attributes.get(name)
            if attribute is not None and attribute.body.blocks:
                reads = [op for op in attribute.body.block.ops if isinstance(op, ReadOp)]
                self._known[name] = self._of_read(reads[0]) if is_union(attribute) else self._of_reads(reads)
            else:
                rows, cols = cast(Matrix, self._storages[name].type).get_shape()
                self._known[name] = _Width(rows * cols, (f"{rows * cols} of {name}",))
        return self._known[name]

    def _read(self, value: SSAValue) -> str:
        read = value.owner
        assert isinstance(read, ReadOp)
        return self._through(read) if isinstance(read, JoinOp) else f"{size_of(value)} of one instance"

    def _through(self, join: JoinOp) -> str:
        connectivity = self._connectivities[name_of(join.connectivity)]
        up_to = "up to " if connectivity.variable is not None else ""
        return f"{up_to}{connectivity.arity.value.data} instances through {connectivity.symbol}"
