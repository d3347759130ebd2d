"""Checks of what a surface's collision geometry is given."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from yasps import ConnectivityError, DataError, SceneError
from yasps.contact.active_set import Floats, Ids
from yasps.frontend.language.arrays import plain_array, real_numbers
from yasps.runtime.collision.surface_pairs import Classes


def checked_points(points: ArrayLike, name: str, count: int | None = None) -> Floats:
    """Finite float64 [n, 3], of `count` points if that is given. Raises DataError."""
    checked = real_numbers(points, name, finite=False)
    if checked.ndim != 2 or checked.shape[1:] != (3,) or count not in (None, len(checked)):
        raise DataError(f"{name} must have shape [{'n' if count is None else count}, 3], got {list(checked.shape)}")
    if not np.isfinite(checked).all():
        bad, first = first_not_finite(checked)
        raise DataError(f"{name}: {bad} vertices are NaN or infinite, first vertex {first}")
    return checked


def first_not_finite(points: Floats) -> tuple[int, int]:
    """How many of the points [n, 3] are not finite, and the first of them."""
    bad = ~np.isfinite(points).all(axis=1)
    return int(bad.sum()), int(np.argmax(bad))


def checked_length(value: float, name: str) -> float:
    """A finite length, perhaps 0, as a float. Raises DataError."""
    number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not number or not 0 <= value < np.inf:
        raise DataError(f"{name} must be a length >= 0, got {value!r}")
    return float(value)


def checked_radii(radii: ArrayLike, count: int) -> Floats:
    """Radii of all vertices [m], [count], of one or one each. Raises DataError."""
    numbers = real_numbers(radii, "radii")
    if numbers.shape not in ((), (count,)) or (numbers < 0).any():
        raise DataError(f"radii are one length >= 0 or one for each of {count} vertices, got {list(numbers.shape)}")
    return np.broadcast_to(numbers, (count,)).copy()


def checked_ids(elements: ArrayLike, arity: int, vertex_count: int, name: str) -> Ids:
    """Vertex ids, int32 [m, arity]. Raises ConnectivityError."""
    ids = plain_array(elements, name, ConnectivityError)
    if ids.size == 0:
        return np.empty((0, arity), np.int32)
    if ids.ndim != 2 or ids.shape[1] != arity:
        raise ConnectivityError(f"{name} must have shape [m, {arity}], got {list(ids.shape)}")
    if not np.issubdtype(ids.dtype, np.integer):
        raise ConnectivityError(f"{name} must hold integer vertex ids, got {ids.dtype}")
    if ids.min() < 0 or ids.max() >= vertex_count:
        raise ConnectivityError(f"{name} must hold ids from 0 to {vertex_count - 1}, got {ids.min()} to {ids.max()}")
    ordered = np.sort(ids, axis=1)
    twice = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    if twice.any():
        row = int(np.argmax(twice))
        raise ConnectivityError(f"{name}: row {row} names a vertex twice: {ids[row].tolist()}")
    return ids.astype(np.int32)


def checked_vertices(points: ArrayLike | None, triangles: Ids, edges: Ids, vertex_count: int) -> Ids:
    """Ids of loose vertices, int32 [p], sorted. Raises ConnectivityError."""
    if points is None:
        return np.empty(0, np.int32)
    ids = plain_array(points, "points", ConnectivityError)
    loose = np.sort(checked_ids(ids.reshape(-1, 1) if ids.ndim == 1 else ids, 1, vertex_count, "points").ravel())
    if (loose[1:] == loose[:-1]).any():
        raise ConnectivityError(f"points: vertex {loose[:-1][loose[1:] == loose[:-1]][0]} is there twice")
    held = np.intersect1d(loose, np.concatenate([triangles.ravel(), edges.ravel()]))
    if len(held) > 0:
        raise ConnectivityError(
            f"points: vertex {held[0]} is in a triangle or an edge, and takes part in contact with it: leave it out"
        )
    return loose


def checked_classes(
    class_of: ArrayLike | None, allowed: ArrayLike | None, vertex_count: int, triangles: Ids, edges: Ids
) -> Classes | None:
    """Which classes of vertices meet; None where all do. Raises DataError."""
    if class_of is None and allowed is None:
        return None
    if class_of is None or allowed is None:
        raise DataError("class_of and allowed go together: the class of each vertex, and which classes may meet")
    of, meet = plain_array(class_of, "class_of"), plain_array(allowed, "allowed")
    if of.shape != (vertex_count,) or not np.issubdtype(of.dtype, np.integer):
        raise DataError(f"class_of must be integers [{vertex_count}], got {of.dtype} {list(of.shape)}")
    if meet.dtype != np.bool_ or meet.ndim != 2 or meet.shape[0] != meet.shape[1] or (meet != meet.T).any():
        raise DataError(f"allowed must be a symmetric bool [c, c], got {meet.dtype} {list(meet.shape)}")
    if of.size > 0 and not 0 <= of.min() <= of.max() < len(meet):
        raise DataError(f"class_of must hold classes from 0 to {len(meet) - 1}, got {of.min()} to {of.max()}")
    for name, pieces in (("triangles", triangles), ("edges", edges)):
        mixed = (of[pieces] != of[pieces[:, :1]]).any(axis=1)
        if mixed.any():
            row = int(np.argmax(mixed))
            raise DataError(f"{name}: the vertices of row {row} are of different classes: {of[pieces[row]].tolist()}")
    return None if meet.all() else Classes(of.astype(np.int32), np.ascontiguousarray(meet))


def labels_of_filter(fixed: ArrayLike | None, group: ArrayLike | None, vertex_count: int) -> Ids | None:
    """One label per vertex such that exactly the pairs of equal labels are left out; None if no pair is.

    Raises DataError for arrays of the wrong kind, SceneError for a group of both fixed and free vertices.
    """
    if fixed is None and group is None:
        return None
    labels = np.full(vertex_count, -1) if group is None else plain_array(group, "group")
    still = np.zeros(vertex_count, np.bool_) if fixed is None else plain_array(fixed, "fixed")
    if labels.shape != (vertex_count,) or not np.issubdtype(labels.dtype, np.integer):
        raise DataError(f"group must be integers [{vertex_count}], got {labels.dtype} {list(labels.shape)}")
    if still.shape != (vertex_count,) or still.dtype != np.bool_:
        raise DataError(f"fixed must be bool [{vertex_count}], got {still.dtype} {list(still.shape)}")
    mixed = np.intersect1d(labels[still & (labels >= 0)], labels[~still])
    if len(mixed) > 0:
        raise SceneError(
            f"group {mixed[0]} holds both fixed and free vertices, but a group is all fixed or all free: give the"
            " fixed ones group -1 (they then can collide with the rest of the group)"
        )
    # Small labels: one for the fixed vertices, one per group, then one for each remaining vertex by itself.
    alone = ~still & (labels < 0)
    _, packed = np.unique(np.where(still, -1, labels), return_inverse=True)
    packed[alone] = packed.max(initial=0) + 1 + np.arange(int(alone.sum()))
    return packed.astype(np.int32)
