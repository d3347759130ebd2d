"""The numbers of a scene as a file (`.npz` or `.json`), or random ones, for the reference interpreter.

In an `.npz` file, arrays are named `storages/m.v.x`, `connectivities/m.e.ends` and `sizes/m.v`; in a `.json` file, the
three words are dictionaries of nested lists by the same names.
"""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from xdsl.dialects.builtin import ModuleOp

from yasps.dialects.mat import Batch
from yasps.dialects.rel import ConnectivityOp, Container, PrimitiveOp, PrimitiveUnionOp, StorageOp, name_of
from yasps.dialects.rel.declarations import storage_shape

GROUPS = ("storages", "connectivities", "sizes")

_MOST_INSTANCES = 2**31 - 1
"""Indices are int32."""
_MOST_RANDOM_NUMBERS = 10**8
_MOST_DEFLATED = 1032
"""Bytes that one byte of a compressed file can stand for."""


@dataclass(frozen=True)
class SceneData:
    """The numbers of a scene, by the names of the IR.

    storages: [instances, rows, columns]; those that `lift-constants` made may be missing, the module knows their
    numbers. connectivities: [instances, arity]; sizes: instances of each primitive and primitive union (meshes and the
    scene have one).
    """

    storages: Mapping[str, Batch]
    connectivities: Mapping[str, NDArray[np.int32]]
    sizes: Mapping[str, int]


class SceneDataError(ValueError):
    """Numbers that are missing, or don't fit what a module declares."""


def save_scene_data(path: Path, data: SceneData) -> None:
    """Writes the numbers as `.npz` or `.json`, as the name ends. Raises SceneDataError for another ending."""
    groups = {"storages": data.storages, "connectivities": data.connectivities, "sizes": data.sizes}
    if path.suffix == ".npz":
        arrays = {f"{word}/{name}": np.asarray(v) for word, group in groups.items() for name, v in group.items()}
        np.savez_compressed(path, **cast("dict[str, Any]", arrays))
    elif path.suffix == ".json":
        lists = {word: {name: np.asarray(v).tolist() for name, v in group.items()} for word, group in groups.items()}
        path.write_text(json.dumps(lists, indent=1) + "\n", encoding="utf-8")
    else:
        raise _unknown_ending(path)


def load_scene_data(path: Path) -> SceneData:
    """Reads what `save_scene_data` writes, or what somebody wrote by hand.

    Raises SceneDataError for a file that is no such thing, FileNotFoundError.
    """
    groups: dict[str, dict[str, Any]] = {word: {} for word in GROUPS}
    if path.suffix == ".npz":
        for key, value in _load_arrays(path).items():
            word, _, name = key.partition("/")
            if word not in groups or not name:
                raise SceneDataError(f"{path}: {key!r} should begin with one of {', '.join(f'{w}/' for w in GROUPS)}")
            groups[word][name] = value
    elif path.suffix == ".json":
        try:
            read = json.loads(path.read_text(encoding="utf-8"))
        except (ValueError, RecursionError) as error:
            raise SceneDataError(f"{path} is not JSON: {error}") from error
        if not isinstance(read, dict) or not all(k in groups and isinstance(v, dict) for k, v in read.items()):
            raise SceneDataError(f"{path} should hold dictionaries {', '.join(GROUPS)} and nothing else")
        groups.update(read)
    else:
        raise _unknown_ending(path)
    return SceneData(
        {name: _array(path, f"storages/{name}", v, np.float64) for name, v in groups["storages"].items()},
        {name: _array(path, f"connectivities/{name}", v, np.int32) for name, v in groups["connectivities"].items()},
        {name: _size(path, name, v) for name, v in groups["sizes"].items()},
    )


def _load_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an `.npz` file. No array takes more memory than there are numbers in the file."""
    content = path.read_bytes()
    try:
        with zipfile.ZipFile(BytesIO(content)) as archive:
            entries = archive.infolist()
            _check_claims(entries, len(content))
            return {entry.filename.removesuffix(".npy"): _load_array(archive, entry) for entry in entries}
    except Exception as error:  # damage shows anywhere: in zip, zlib, the header of an array, its type
        told = str(error) or type(error).__name__
        raise SceneDataError(f"{path} is not an .npz file of plain arrays: {told}") from error


def _check_claims(entries: Sequence[zipfile.ZipInfo], size: int) -> None:
    for entry in entries:
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"{entry.filename} is compressed in another way than NumPy does")
    claimed = sum(entry.file_size for entry in entries)
    if claimed > _MOST_DEFLATED * size:
        raise ValueError(f"its {size} bytes claim to be {claimed} bytes of numbers")


def _load_array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(entry) as stream:
        version = np.lib.format.read_magic(stream)
        read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        if version not in read_header:
            raise ValueError(f"{entry.filename} has another version than arrays of numbers have")
        shape, _, dtype = read_header[version](stream)
        there = entry.file_size - stream.tell()
        if math.prod(shape) * dtype.itemsize != there or min(shape, default=0) < 0:
            raise ValueError(f"{entry.filename} says that it is {dtype} {list(shape)}, but has {there} bytes")
    with archive.open(entry) as stream:
        array: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    return array


def _size(path: Path, name: str, value: Any) -> int:
    number = _array(path, f"sizes/{name}", value, np.int64).reshape(-1)
    if number.size != 1 or not 0 <= number[0] <= _MOST_INSTANCES:
        raise SceneDataError(f"{path}: sizes/{name} is no number of instances, 0 to {_MOST_INSTANCES}")
    return int(number[0])


def _unknown_ending(path: Path) -> SceneDataError:
    return SceneDataError(f"{path}: numbers of a scene are an .npz or a .json file")


def _array(path: Path, name: str, value: Any, dtype: Any) -> NDArray[Any]:
    try:
        array = np.asarray(value)
        if array.size == 0 or np.can_cast(array.dtype, dtype, "same_kind"):
            if array.size and array.dtype.kind in "iu" and dtype is not np.float64:
                least, greatest = np.iinfo(dtype).min, np.iinfo(dtype).max
                if array.min() < least or array.max() > greatest:
                    raise SceneDataError(f"{path}: {name} holds numbers that {np.dtype(dtype).name} does not")
            return array.astype(dtype)
    except (ValueError, TypeError):  # rows of different lengths, no numbers
        pass
    raise SceneDataError(f"{path}: {name} is no array of {np.dtype(dtype).name}")


def random_scene_data(module: ModuleOp, instances: int, seed: int = 0) -> SceneData:
    """Numbers in [0.5, 1.5) on `instances` instances of each primitive, connected at random.

    They depend on seed and names alone, so that they are the same after every pass; numbers that were taken out of
    formulas stay what they are. No row of a connectivity names an
    instance twice where that can be avoided; of a variable arity, rows have different lengths.

    Raises SceneDataError for more than 1e8 numbers.
    """
    declared = _Declared(module)
    sizes = dict.fromkeys(declared.primitives, instances)
    sizes |= {name: instances * declared.members_below(name) for name in declared.unions}
    wanted = sum(sizes.get(name_of(op.owner), 1) * math.prod(storage_shape(op)) for op in declared.storages.values())
    wanted += sum(sizes[name_of(op.source)] * op.arity.value.data for op in declared.connectivities.values())
    if wanted > _MOST_RANDOM_NUMBERS:
        raise SceneDataError(f"the module needs {wanted} random numbers; at most {_MOST_RANDOM_NUMBERS} are drawn")
    storages = {}
    for name, storage in declared.storages.items():
        shape = (sizes.get(name_of(storage.owner), 1), *storage_shape(storage))
        if storage.numbers is None:
            storages[name] = 0.5 + _generator(seed, name).random(shape)
    connectivities = {}
    for name, connectivity in declared.connectivities.items():
        rows, arity = sizes[name_of(connectivity.source)], connectivity.arity.value.data
        there, random = sizes[name_of(connectivity.target)], _generator(seed, name)
        chosen = [random.choice(there, arity, replace=arity > there) for _ in range(rows)]
        indices = np.array(chosen, np.int32).reshape(rows, arity)
        if connectivity.variable is not None:
            indices[np.arange(arity) >= random.integers(1, arity + 1, rows)[:, None]] = -1
        connectivities[name] = indices
    return SceneData(storages, connectivities, sizes)


def _generator(seed: int, name: str) -> np.random.Generator:
    return np.random.default_rng([seed, *name.encode()])


def check_scene_data(module: ModuleOp, data: SceneData) -> None:
    """Raises SceneDataError where numbers don't fit the module: a missing array, a wrong shape, an index too far."""
    declared = _Declared(module)
    for name in (*declared.primitives, *declared.unions):
        _present(name, data.sizes, "size")
    for name, members in declared.unions.items():
        united = sum(data.sizes[member] for member in members)
        if data.sizes[name] != united:
            raise SceneDataError(f"@{name} has {data.sizes[name]} instances, but its members have {united}")
    for name, storage in declared.storages.items():
        if storage.numbers is not None and name not in data.storages:
            continue
        _present(name, data.storages, "storage")
        shape = (data.sizes.get(name_of(storage.owner), 1), *storage_shape(storage))
        if data.storages[name].shape != shape:
            raise SceneDataError(f"@{name} must be an array {shape}, but it is {data.storages[name].shape}")
    for name, connectivity in declared.connectivities.items():
        _present(name, data.connectivities, "connectivity")
        indices = data.connectivities[name]
        expected = (data.sizes[name_of(connectivity.source)], connectivity.arity.value.data)
        if indices.shape != expected:
            raise SceneDataError(f"@{name} must be an array {expected}, but it is {indices.shape}")
        least, count = (0 if connectivity.variable is None else -1), data.sizes[name_of(connectivity.target)]
        if indices.size and not least <= indices.min() <= indices.max() < count:
            raise SceneDataError(f"@{name} leads to instances {least} to {count - 1}, but it names others")


def _present(name: str, group: Mapping[str, object], what: str) -> None:
    if name not in group:
        raise SceneDataError(f"the numbers have no {what} @{name}")


class _Declared:
    """What of a module needs numbers, by symbol."""

    def __init__(self, module: ModuleOp) -> None:
        ops = [op for scene in module.body.block.ops if isinstance(scene, Container) for op in scene.body.block.ops]
        self.primitives = [op.symbol for op in ops if isinstance(op, PrimitiveOp)]
        self.unions = {
            op.symbol: [name_of(member) for member in op.members] for op in ops if isinstance(op, PrimitiveUnionOp)
        }
        self.storages = {op.symbol: op for op in ops if isinstance(op, StorageOp)}
        self.connectivities = {op.symbol: op for op in ops if isinstance(op, ConnectivityOp)}

    def members_below(self, name: str) -> int:
        """Primitives that a union unites, those of the unions among its members counted in."""
        return sum(self.members_below(member) for member in self.unions[name]) if name in self.unions else 1
