"""The global gradient on a device, summed by atomic additions or, on request, in a fixed order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from yasps.runtime.device.protocol import Device, DeviceArray, LoadedProgram
from yasps.runtime.matrix.cuda.build import (
    MOST_SOURCES,
    BuildScratch,
    bad_source,
    check_kappas,
    describe_slot,
    find_first_sources,
)


class CudaGradient:
    """A vector that kernels add to, dof block by dof block.

    Without any unknowns until `build`; `build` can be called again and reuses memory.
    """

    def __init__(
        self,
        device: Device,
        program: LoadedProgram,
        *,
        deterministic: bool = False,
        scratch: BuildScratch | None = None,
    ) -> None:
        """An empty vector. `program` holds the kernels of structure.cu.

        deterministic: kernels add each local block to zeros of its own and `finish` sums them in the order of energies,
        instances and slots. scratch: shares memory with other builds on this device.
        """
        self.device = device
        self.deterministic = deterministic
        self.size = 0
        self._program = program
        self._scratch = scratch if scratch is not None else BuildScratch(device)
        self._positions: list[DeviceArray] = []
        self._block_size_at = DeviceArray(device, np.int32, "sizes of dof blocks")
        self._ranges = DeviceArray(device, np.int64, "contributions of dof blocks")
        self._contributions = DeviceArray(device, np.float64, "contributions to the gradient")
        #: float64 [size].
        self.values = DeviceArray(device, np.float64, "the gradient")

    @property
    def target(self) -> DeviceArray:
        """What kernels add to, at the offsets that positions say, or at kappa - 1; cleared with `clear` before."""
        return self._contributions if self.deterministic else self.values

    def clear(self) -> None:
        """Makes `target` zero, before an assembly."""
        self.target.clear()

    def finish(self) -> None:
        """After an assembly, makes `values` what was added to `target`."""
        if not self.deterministic:
            return
        arrays = (self._block_size_at, self._ranges, self._contributions, self.values)
        kernel = self._program.kernel("yasps_gradient_sum")
        self.device.launch(kernel, self.size, [self.size, *(array.address for array in arrays)])

    def build(
        self, size: int, block_size_at: DeviceArray, kappas: Sequence[DeviceArray]
    ) -> list[DeviceArray] | list[None]:
        """Make room for `size` unknowns, which become zero.

        block_size_at: int32 [size], as `CudaBlockMatrix` has it; kept, not copied. kappas: for each energy int32 [n, c]
        on the device, as for `CudaBlockMatrix.build`. Returns for each energy None: contributions of a slot go to the
        offset kappa - 1 of `target`. If deterministic, int64 [n, c] on the device, the offset of a place for each slot,
        -1 where it does not contribute; waits once for the device.

        Raises ValueError for arrays that do not fit together, and, if deterministic, for slots that name no dof block
        (else `CudaBlockMatrix.build` says so); the vector is then as before. DeviceMemoryError leaves it as before or
        empty.
        """
        if block_size_at.shape != (size,) or block_size_at.dtype != np.int32:
            raise ValueError(
                f"block_size_at is {block_size_at.dtype} {block_size_at.shape}, but the gradient needs int32 {(size,)}"
            )
        check_kappas(kappas)
        if not self.deterministic:
            self._take_over(size, block_size_at)
            return [None] * len(kappas)
        first_sources = find_first_sources([kappa.size for kappa in kappas])
        if first_sources[-1] > MOST_SOURCES:
            raise ValueError("more than 2^32 slots: split the energies over several gradients")
        total = self._sort(size, block_size_at, kappas, first_sources)
        try:
            return self._place(
                size, block_size_at, [kappa.shape for kappa in kappas], slots=first_sources[-1], total=total
            )
        except MemoryError:
            self.size = 0
            for array in (self.values, self._contributions, self._ranges):
                array.resize(0)
            raise

    def _take_over(self, size: int, block_size_at: DeviceArray) -> None:
        self.values.resize(size).clear()
        self.size, self._block_size_at = size, block_size_at

    def _sort(
        self, size: int, block_size_at: DeviceArray, kappas: Sequence[DeviceArray], first_sources: list[int]
    ) -> int:
        """Sorts all slots by dof block; returns how many scalars they contribute to."""
        slots = first_sources[-1]
        if slots == 0:
            return 0
        scratch, launch, kernel = self._scratch, self.device.launch, self._program.kernel
        scratch.reserve(slots)
        scratch.send(kappas, first_sources)
        scratch.answer.resize(2)
        keys, sorted_keys, bad = scratch.keys.address, scratch.sorted_keys.address, scratch.request.address
        sizes = block_size_at.address
        arguments = [slots, scratch.table, len(kappas), sizes, size, keys, scratch.sources.address, bad]
        launch(kernel("yasps_gradient_keys"), slots, arguments)
        scratch.sort(slots, max(1, size.bit_length()))
        launch(kernel("yasps_gradient_lengths"), slots, [slots, sorted_keys, sizes, size, keys])
        before = scratch.sum(slots)
        arguments = [slots, sorted_keys, sizes, size, before, bad, scratch.answer.address]
        launch(kernel("yasps_gradient_total"), 1, arguments)
        code, total = (int(number) for number in scratch.answer.download())
        source = bad_source(code)
        if source is not None:
            energy = int(np.searchsorted(first_sources, source, side="right")) - 1
            instance, slot = divmod(source - first_sources[energy], kappas[energy].shape[1])
            raise ValueError(
                f"{describe_slot(kappas, energy, instance, slot)} is not the 1-based offset of a dof block among "
                f"{size} unknowns; 0 means no contribution"
            )
        return total

    def _place(
        self, size: int, block_size_at: DeviceArray, shapes: Sequence[tuple[int, ...]], *, slots: int, total: int
    ) -> list[DeviceArray]:
        scratch = self._scratch
        self._ranges.resize(size, 2).clear()
        self._contributions.resize(total)
        while len(self._positions) < len(shapes):
            self._positions.append(DeviceArray(self.device, np.int64, "positions of slots"))
        positions = [array.resize(*shape) for array, shape in zip(self._positions, shapes, strict=False)]
        self._take_over(size, block_size_at)
        scratch.places.upload(np.array([position.address for position in positions], np.int64))
        arguments = [slots, scratch.sorted_keys.address, scratch.sorted_sources.address, scratch.keys.address]
        arguments += [scratch.table, len(positions), scratch.places.address, block_size_at.address, size]
        kernel = self._program.kernel("yasps_gradient_place")
        self.device.launch(kernel, slots, [*arguments, self._ranges.address])
        return positions
