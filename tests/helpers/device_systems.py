"""Linear systems on the CPU and on a device that the host plays, for tests of products and solvers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from cuda_on_host import HostDevice, HostGraph, HostProgram
from numpy.typing import NDArray

from yasps.runtime.build.cuda.sources import runtime_sources
from yasps.runtime.core.library import Runtime
from yasps.runtime.device.protocol import DeviceArray
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.matrix.cuda.block_matrix import CudaBlockMatrix
from yasps.runtime.solvers.cuda.pcg import CudaSolver

SOURCES = ("structure", "multiply", "gathered_multiply", "preconditioner", "coarse_space", "pcg")


class CountingDevice(HostDevice):
    """Counts what waits for the device, and graphs."""

    downloads = 0
    graphs = 0

    def download(self, address: int, array: NDArray[Any]) -> None:
        """As on the host."""
        self.downloads += 1
        super().download(address, array)

    def record(self, work: Callable[[], None]) -> HostGraph:
        """As on the host."""
        self.graphs += 1
        return super().record(work)


def load_solver_program(device: HostDevice | None = None) -> HostProgram:
    """The kernels of the solver and of the matrices, for this device or one without options."""
    return (device or HostDevice()).load([source for source in runtime_sources() if source.name in SOURCES])


@dataclass
class System:
    """The same matrices on the CPU and on the device."""

    device: HostDevice
    cpu: list[BlockMatrix]
    parts: list[CudaBlockMatrix]

    @property
    def size(self) -> int:
        """Unknowns."""
        return self.cpu[0].size

    @property
    def dense(self) -> NDArray[np.float64]:
        """The sum of the parts, as the CPU has it."""
        return np.asarray(sum(part.to_scipy().toarray() for part in self.cpu))

    def send_values(self) -> None:
        """Copies the values of the CPU's matrices to the device's."""
        for cpu, part in zip(self.cpu, self.parts, strict=True):
            part.values.upload(cpu.values)

    def vector(self, values: NDArray[np.float64]) -> DeviceArray:
        """On the device."""
        return DeviceArray(self.device, np.float64, "a vector").upload(values)


class Maker:
    """Makes systems and solvers on one device of its own."""

    def __init__(self, runtime: Runtime, program: HostProgram, device: CountingDevice | None = None) -> None:
        self.device = device or CountingDevice()
        self.runtime, self.program = runtime, program

    def solver(self, deterministic: bool = False, iterations_per_check: int = 8) -> CudaSolver:
        """A new solver for the same device."""
        return CudaSolver(
            self.device,
            self.program,
            lambda: self.runtime,
            deterministic=deterministic,
            iterations_per_check=iterations_per_check,
        )

    def empty(self, dtype: type = np.float64) -> DeviceArray:
        """An array on the device."""
        return DeviceArray(self.device, dtype, "an array of a test")

    def build(self, system: System, scene: Any, cut: int) -> System:
        """Gives both parts their structure: the first `cut` energies are the static part."""
        for k, kappas in enumerate((scene.kappas[:cut], scene.kappas[cut:])[: len(system.cpu)]):
            system.cpu[k].build(scene.boundaries, scene.block_sizes, kappas)
            sent = [DeviceArray(self.device, np.int32, "kappa").upload(kappa) for kappa in kappas]
            system.parts[k].build(scene.boundaries, scene.block_sizes, sent)
        return system

    def random(self, scene: Any, *, parts: int = 2, definite: bool = True, seed: int = 0) -> System:
        """A system with the structure of a scene, its values random."""
        cut = 2 if parts == 2 else len(scene.kappas)
        cpu = [BlockMatrix(self.runtime, with_diagonal=k == 0) for k in range(parts)]
        both = [CudaBlockMatrix(self.device, self.program, with_diagonal=k == 0) for k in range(parts)]
        system = self.build(System(self.device, cpu, both), scene, cut)
        self.fill(system, definite=definite, seed=seed)
        return system

    @staticmethod
    def fill(system: System, *, definite: bool = True, seed: int = 0) -> None:
        """Random values, symmetric, positive definite by large diagonals if asked for."""
        rng = np.random.default_rng(seed)
        for part in system.cpu:
            part.values[:] = rng.standard_normal(part.values.size)
            for group in part.groups:
                diagonal = group.rows == group.cols
                if group.r == group.c:
                    group.values[diagonal] += group.values[diagonal].transpose(0, 2, 1)
        sums = np.abs(system.dense).sum(1)
        for group in system.cpu[0].groups if definite else []:
            for block in np.flatnonzero(group.rows == group.cols):
                rows = slice(group.rows[block], group.rows[block] + group.r)
                group.values[block] += np.diag(0.6 * sums[rows] + 0.1)
        system.send_values()
        if definite:
            assert np.linalg.eigvalsh(system.dense)[0] > 0

    def of_scalars(self, values: list[float]) -> System:
        """A 2 x 2 matrix [a, b; b, c]."""
        system = System(self.device, [BlockMatrix(self.runtime)], [CudaBlockMatrix(self.device, self.program)])
        self.build(system, Structure((2,), (1,), [np.array([[1, 2]], np.int32)]), 1)
        system.cpu[0].values[:] = values
        system.send_values()
        return system


class Structure:
    """Targets and index arrays, as `scene` of conftest.py."""

    def __init__(self, counts: tuple[int, ...], sizes: tuple[int, ...], kappas: list[NDArray[np.int32]]) -> None:
        lengths = [count * size for count, size in zip(counts, sizes, strict=True)]
        self.boundaries = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        self.block_sizes = np.array(sizes, np.int32)
        self.kappas = kappas
        self.size = int(self.boundaries[-1])


def random_structure(seed: int, counts: tuple[int, ...], sizes: tuple[int, ...]) -> Structure:
    """Energies with gaps and repeated slots, and one hub that is in a block with every other dof block."""
    rng = np.random.default_rng(seed)
    plain = Structure(counts, sizes, [])
    bounds = plain.boundaries.tolist()
    starts = np.concatenate(
        [np.arange(begin, end, q) for begin, end, q in zip(bounds, bounds[1:], sizes, strict=False)]
    )
    kappas = []
    for capacity, instances in ((3, 2 * starts.size), (4, 9), (2, 0)):
        kappa = rng.choice(starts, (instances, capacity)) + 1
        kappa[rng.random(kappa.shape) < 0.1] = 0
        kappas.append(kappa.astype(np.int32))
    hub = rng.choice(starts)
    kappas.append(np.stack([np.full(starts.size, hub + 1), starts + 1], axis=1).astype(np.int32))
    return Structure(counts, sizes, kappas)
