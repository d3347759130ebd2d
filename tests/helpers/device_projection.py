"""Calls the device's projections on the host, for many matrices, and says what should come out."""

from __future__ import annotations

import numpy as np
from cuda_on_host import HostDevice, HostProgram

from yasps.runtime.build.cuda.sources import runtime_sources
from yasps.runtime.build.toolchain import Source
from yasps.runtime.core.library import LANES, Projection, Runtime
from yasps.runtime.device.protocol import DeviceArray

Array = np.ndarray

KERNELS = """
#include "projection/cuda/projection.cuh"

extern "C" __global__ void project_all(double* packed, long count, long n, long mode, double* work, long* outcome) {
    const long i = blockIdx.x * (long)blockDim.x + threadIdx.x;
    if (i >= count) return;
    outcome[i] = yasps_project(packed + i * (n * (n + 1) / 2), (int)n, (int)mode, work + i * n * (n + 2));
}

extern "C" __global__ void project_all_apart(double* packed, long count, long n, long mode, double* work,
                                             long* outcome) {
    const long i = blockIdx.x * (long)blockDim.x + threadIdx.x;
    if (i >= count) return;
    outcome[i] = yasps_project_apart(packed + i, count, (int)n, (int)mode, work + i, count);
}

extern "C" __global__ void project_all_isotropic(double* packed, const double* f, long count, long n, long mode,
                                                 long* outcome) {
    const long i = blockIdx.x * (long)blockDim.x + threadIdx.x;
    if (i >= count) return;
    outcome[i] = yasps_project_isotropic(packed + i * (n * (n + 1) / 2), f + i * n, (int)n, (int)mode);
}
"""


def load_projections() -> HostProgram:
    """Both projections and kernels that call them."""
    return HostDevice().load([KERNELS], projections())


def projections() -> list[Source]:
    """The files of runtime/cuda that hold them."""
    found = [source for source in runtime_sources() if source.name in ("projection", "isotropic")]
    assert len(found) == 2
    return found


def triangles(matrices: Array) -> Array:
    """[n, w, w] as upper triangles, row by row."""
    rows, cols = np.triu_indices(matrices.shape[1])
    return np.ascontiguousarray(matrices[:, rows, cols])


def whole(packed: Array, w: int) -> Array:
    """The matrices again."""
    rows, cols = np.triu_indices(w)
    result = np.empty((len(packed), w, w))
    result[:, rows, cols] = packed
    result[:, cols, rows] = packed
    return result


def project(program: HostProgram, matrices: Array, mode: Projection, f: Array | None = None) -> tuple[Array, Array]:
    """What came back for each matrix, and the matrices; memory beside them must keep its bits."""
    device = HostDevice()
    count, w, _ = matrices.shape
    packed = DeviceArray(device, np.float64, "matrices").upload(triangles(matrices))
    outcome = DeviceArray(device, np.int64, "outcomes").resize(count)
    if f is None:
        guard = 7
        filled = np.full(count * w * (w + 2) + guard, np.nan)
        work = DeviceArray(device, np.float64, "work").upload(filled)
        arguments = [packed.address, count, w, int(mode), work.address, outcome.address]
        device.launch(program.kernel("project_all"), count, arguments)
        assert np.isnan(work.download()[-guard:]).all()
    else:
        deformations = DeviceArray(device, np.float64, "deformations").upload(f.reshape(count, w))
        arguments = [packed.address, deformations.address, count, w, int(mode), outcome.address]
        device.launch(program.kernel("project_all_isotropic"), count, arguments)
    return outcome.download(), whole(packed.download(), w)


def project_apart(program: HostProgram, matrices: Array, mode: Projection) -> tuple[Array, Array]:
    """The same where entry k of all matrices stands together, as in the workspace of kernels."""
    device = HostDevice()
    count, w, _ = matrices.shape
    packed = DeviceArray(device, np.float64, "matrices").upload(triangles(matrices).T)
    outcome = DeviceArray(device, np.int64, "outcomes").resize(count)
    work = DeviceArray(device, np.float64, "work").upload(np.full(count * w * (w + 2) + count, np.nan))
    arguments = [packed.address, count, w, int(mode), work.address, outcome.address]
    device.launch(program.kernel("project_all_apart"), count, arguments)
    assert np.isnan(work.download()[-count:]).all(), "memory behind it keeps its bits"
    return outcome.download(), whole(np.ascontiguousarray(packed.download().T), w)


def packs(values: Array) -> Array:
    """[n, k] as the CPU's packs of eight interleaved."""
    padded = np.zeros((-(-len(values) // LANES) * LANES, values.shape[1]))
    padded[: len(values)] = values
    return np.ascontiguousarray(padded.reshape(-1, LANES, values.shape[1]).transpose(0, 2, 1))


def on_cpu(runtime: Runtime, matrices: Array, mode: Projection, f: Array | None = None) -> Array:
    """The matrices as the CPU's runtime projects them."""
    packed, count = packs(triangles(matrices)), len(matrices)
    if f is None:
        changed = runtime.project(packed, count, mode)
    else:
        changed = runtime.project_isotropic(packed, packs(f.reshape(count, -1)), count, mode)
    assert changed >= 0
    return whole(packed.transpose(0, 2, 1).reshape(-1, packed.shape[1])[:count], matrices.shape[1])


def reference(matrices: Array, mode: Projection) -> Array:
    values, vectors = np.linalg.eigh(matrices)
    values = np.maximum(values, 0) if mode == Projection.CLAMP else np.abs(values)
    return np.asarray((vectors * values[:, None, :]) @ vectors.swapaxes(1, 2))


def norms_of(matrices: Array) -> Array:
    return np.linalg.norm(matrices, axis=(1, 2)) + 1e-300


def check(matrices: Array, outcome: Array, result: Array, mode: Projection, tolerance: float) -> None:
    """Agrees with NumPy; outcomes say what happened."""
    norms = norms_of(matrices)
    changed = outcome == 1
    error = np.linalg.norm(result - reference(matrices, mode), axis=(1, 2)) / norms
    assert error[changed].max(initial=0) < tolerance
    assert set(outcome) <= {0, 1}
    np.testing.assert_array_equal(changed, np.any(result != matrices, axis=(1, 2)), "or every bit is kept")
    smallest = np.linalg.eigvalsh(matrices)[:, 0]
    assert (smallest[changed] < 0).all()
    assert (smallest >= -negligible(matrices))[~changed].all()


def compare_with_cpu(matrices: Array, outcome: Array, result: Array, wanted: Array, tolerance: float) -> None:
    """Rounding decides what becomes of eigenvalues next to those that are left; all else is the same."""
    same = np.any(wanted != matrices, axis=(1, 2)) == (outcome == 1)
    error = np.linalg.norm(result - wanted, axis=(1, 2)) / norms_of(matrices)
    assert error[same].max(initial=0) < tolerance
    assert (np.linalg.eigvalsh(matrices)[:, 0] >= -negligible(matrices))[~same].all()


def negligible(matrices: Array) -> Array:
    """Negative eigenvalues up to this size are left, of which the last term is rounding."""
    return 1e-13 * np.trace(np.abs(matrices), axis1=1, axis2=2) + 2e-14 * norms_of(matrices)
