"""Numbers of a scene as files, random ones, and what is said about numbers that don't fit."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_scenes import emit, mixed_union, shared_targets
from xdsl.parser import Parser

from yasps.backend.reference.interpreter import SceneData
from yasps.backend.reference.scene_data import (
    SceneDataError,
    check_scene_data,
    load_scene_data,
    random_scene_data,
    save_scene_data,
)
from yasps.passes.pipeline import make_context, run_pipeline

NESTED = """
rel.scene @s {
  rel.primitive_union @m.all in @m of [@m.some, @m.c]
  rel.mesh @m in @s
  rel.primitive @m.a in @m size 2
  rel.primitive @m.b in @m size 2
  rel.primitive @m.c in @m dynamic
  rel.primitive_union @m.some in @m of [@m.a, @m.b]
  rel.connectivity @m.c.ring from @m.c to @m.all arity 4 variable
  rel.storage @m.k on @m : 1x1
}
"""


def same(a: SceneData, b: SceneData) -> bool:
    for field in dataclasses.fields(SceneData):
        first, second = getattr(a, field.name), getattr(b, field.name)
        if first.keys() != second.keys():
            return False
        for name, value in first.items():
            if np.asarray(value).dtype != np.asarray(second[name]).dtype or not np.array_equal(value, second[name]):
                return False
    return True


@pytest.mark.parametrize("ending", [".npz", ".json"])
def test_files_give_back_the_numbers(ending: str, tmp_path: Path) -> None:
    data = emit(mixed_union()).data
    path = tmp_path / f"data{ending}"
    save_scene_data(path, data)
    assert same(load_scene_data(path), data)


def test_no_instances_are_no_trouble(tmp_path: Path) -> None:
    emitted = emit(mixed_union(pairs=[]))
    for ending in (".npz", ".json"):
        save_scene_data(tmp_path / f"data{ending}", emitted.data)
    check_scene_data(emitted.module, load_scene_data(tmp_path / "data.npz"))
    assert load_scene_data(tmp_path / "data.npz").connectivities["both.pp.ends"].shape == (0, 2)


def test_random_numbers_are_the_same_after_every_pass() -> None:
    module = emit(shared_targets()).module
    before = random_scene_data(module, 3, seed=1)
    run_pipeline(module)
    assert same(random_scene_data(module, 3, seed=1), before)
    assert not same(random_scene_data(module, 3, seed=2), before)
    assert set(before.sizes.values()) == {3}
    check_scene_data(module, before)


def test_random_numbers_of_nested_unions_and_variable_arity() -> None:
    module = Parser(make_context(), NESTED).parse_module()
    data = random_scene_data(module, 30)
    check_scene_data(module, data)
    assert data.sizes == {"m.a": 30, "m.b": 30, "m.c": 30, "m.some": 60, "m.all": 90}
    ring = data.connectivities["m.c.ring"]
    counts = (ring >= 0).sum(axis=1)
    assert set(counts) == {1, 2, 3, 4}
    assert data.storages["m.k"].shape == (1, 1, 1)
    assert all(len(set(row[row >= 0])) == count for row, count in zip(ring, counts, strict=True))


def test_rows_repeat_only_where_they_must() -> None:
    module = emit(shared_targets()).module
    assert (np.diff(np.sort(random_scene_data(module, 2).connectivities["m.s.ends"])) == 1).all()
    assert (random_scene_data(module, 1).connectivities["m.s.ends"] == 0).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s, c, n: s.pop("m.v.x"), "the numbers have no storage @m.v.x"),
        (lambda s, c, n: c.pop("m.s.ends"), "the numbers have no connectivity @m.s.ends"),
        (lambda s, c, n: n.pop("m.s"), "the numbers have no size @m.s"),
        (lambda s, c, n: n.update({"m.v": 5}), r"@m.v.x must be an array \(5, 3, 1\), but it is \(4, 3, 1\)"),
        (lambda s, c, n: s.update(k=np.ones((2, 1, 1))), r"@k must be an array \(1, 1, 1\), but it is \(2, 1, 1\)"),
        (lambda s, c, n: c.update({"m.s.ends": np.zeros((5, 3), np.int32)}), r"@m.s.ends must be an array \(5, 2\)"),
        (lambda s, c, n: c.update({"m.s.ends": np.full((5, 2), 4)}), "@m.s.ends leads to instances 0 to 3"),
        (lambda s, c, n: c.update({"m.s.ends": np.full((5, 2), -1)}), "@m.s.ends leads to instances 0 to 3"),
    ],
)
def test_numbers_that_do_not_fit_are_named(change: Callable[[Any, Any, Any], object], message: str) -> None:
    emitted = emit(shared_targets())
    check_scene_data(emitted.module, emitted.data)
    data = SceneData(dict(emitted.data.storages), dict(emitted.data.connectivities), dict(emitted.data.sizes))
    change(data.storages, data.connectivities, data.sizes)
    with pytest.raises(SceneDataError, match=message):
        check_scene_data(emitted.module, data)


def test_a_union_is_as_large_as_its_members() -> None:
    emitted = emit(mixed_union())
    data = dataclasses.replace(emitted.data, sizes={**emitted.data.sizes, "both.v": 12})
    with pytest.raises(SceneDataError, match=r"@both\.v has 12 instances, but its members have 11"):
        check_scene_data(emitted.module, data)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("data.txt", b"", r"an \.npz or a \.json file"),
        ("data.npz", b"no archive", r"is not an \.npz file of plain arrays"),
        ("data.json", b"{", "is not JSON"),
        ("data.json", b"[]", "should hold dictionaries storages, connectivities, sizes and nothing else"),
        ("data.json", b'{"numbers": {}}', "should hold dictionaries"),
        ("data.json", b'{"storages": {"x": [[1], [1, 2]]}}', "storages/x is no array of float64"),
        ("data.json", b'{"connectivities": {"c": [[0.5]]}}', "connectivities/c is no array of int32"),
        ("data.json", b'{"sizes": {"p": "three"}}', "sizes/p is no array of int64"),
    ],
)
def test_files_that_are_no_numbers_are_named(name: str, content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(SceneDataError, match=message):
        load_scene_data(path)


def test_arrays_by_other_names_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "data.npz", x=np.ones(3))
    with pytest.raises(SceneDataError, match="'x' should begin with one of storages/, connectivities/, sizes/"):
        load_scene_data(tmp_path / "data.npz")


def test_json_is_written_by_hand_easily(tmp_path: Path) -> None:
    path = tmp_path / "data.json"
    numbers = {"storages": {"m.k": [[[2]]]}, "sizes": {"m.a": 1}, "connectivities": {"m.c.ring": [[0, 1, -1, -1]]}}
    path.write_text(json.dumps(numbers), encoding="utf-8")
    data = load_scene_data(path)
    assert data.storages["m.k"].dtype == np.float64
    assert data.connectivities["m.c.ring"].dtype == np.int32
    assert data.sizes == {"m.a": 1}
