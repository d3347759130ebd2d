"""Which unknowns stay as they are while others are solved for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps.frontend.errors import DataError, SceneError
from yasps.frontend.language.arrays import plain_array
from yasps.frontend.language.attribute import Attribute


def unknowns_of(targets: Sequence[Attribute], fixed: Mapping[Attribute, ArrayLike]) -> NDArray[np.bool_]:
    """For each scalar unknown of the targets, end to end, whether it is fixed.

    fixed: of some targets, for each instance whether it stays as it is, bool [instances]. Raises SceneError for what is
    no target, DataError for other shapes and types.
    """
    if not isinstance(fixed, Mapping):
        raise DataError(f"fixed is a table, target -> truth values of its instances, got {fixed!r}")
    parts = []
    for target in targets:
        assert target.owner is not None
        count = target.owner.num_instances
        of_target = plain_array(fixed.get(target, np.zeros(count, np.bool_)), f"fixed: {target.path}")
        if of_target.shape != (count,) or of_target.dtype != np.bool_:
            raise DataError(
                f"fixed: {target.path} has {count} instances and needs as many truth values, [{count}], got "
                f"{of_target.dtype} {list(of_target.shape)}"
            )
        parts.append(np.repeat(of_target, target.shape[0] * target.shape[1]))
    for target in fixed:
        if target not in targets:
            raise SceneError(
                f"fixed: {getattr(target, 'path', target)!r} is no minimisation target, so it stays as it is anyway"
            )
    return np.concatenate(parts)
