"""Symmetric matrices as the projections of the runtime take them, and what numpy makes of them."""

from __future__ import annotations

import numpy as np

from yasps.runtime.core.library import LANES, Projection

Array = np.ndarray


def packs(values: Array) -> Array:
    """[n, k] as packs of eight interleaved, [packs, k, 8]; places left over hold NaN."""
    n, k = values.shape
    padded = np.full((-(-n // LANES) * LANES, k), np.nan)
    padded[:n] = values
    return np.ascontiguousarray(padded.reshape(-1, LANES, k).transpose(0, 2, 1))


def packed_triangles(matrices: Array) -> Array:
    rows, cols = np.triu_indices(matrices.shape[1])
    return packs(matrices[:, rows, cols])


def unpacked(packed: Array, count: int) -> Array:
    """The matrices again, [count, w, w]."""
    entries = packed.shape[1]
    width = int((np.sqrt(8 * entries + 1) - 1) / 2)
    rows, cols = np.triu_indices(width)
    triangles = packed.transpose(0, 2, 1).reshape(-1, entries)[:count]
    result = np.empty((count, width, width))
    result[:, rows, cols] = triangles
    result[:, cols, rows] = triangles
    return result


def reference(matrices: Array, mode: Projection) -> Array:
    """What the projection should give, by NumPy."""
    values, vectors = np.linalg.eigh(matrices)
    values = np.maximum(values, 0) if mode == Projection.CLAMP else np.abs(values)
    return np.asarray((vectors * values[:, None, :]) @ vectors.swapaxes(1, 2))
