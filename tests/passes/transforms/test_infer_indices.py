"""`infer-indices`: the rules of |kappa| and kappa (paper, appendix A)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from small_scenes import PAIRS, emit
from xdsl.dialects.builtin import ModuleOp

from yasps import Scene
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.reference.interpreter import Interpreter, SceneData
from yasps.passes.pipeline import run_pipeline


def _indices(module: ModuleOp, data: SceneData) -> tuple[Interpreter, dict[str, list[list[int]]]]:
    """All placement indices after the pipeline, by attribute, [instances, |kappa|]."""
    interpreter = Interpreter(module, data)
    names = [name for name in interpreter.scene.attributes if name.endswith(".kappa")]
    return interpreter, {name: interpreter.value(name)[:, 0, :].astype(int).tolist() for name in names}


def test_capacities_follow_the_rules(pipeline_run: Callable[[str, str], Any]) -> None:
    """data 1; JOIN of arity k: k times; UNION: the most; anything else: the sum over its inputs."""
    view = SceneView(pipeline_run("mixed_union", "clamp").last)
    assert {name: view.size(name) for name in view.attributes if name.endswith(".kappa")} == {
        "soft.v.x.kappa": 1,
        "stiff.body.A.kappa": 1,
        "stiff.body.t.kappa": 1,
        "stiff.v.x.kappa": 2,  # A and t
        "both.v.x.kappa": 2,  # max(2, 1)
        "soft.t.swell.kappa": 4,
        "stiff.body.rigid.kappa": 1,
        "stiff.s.spring.kappa": 4,  # 2 x 2
        "both.v.gravity.kappa": 2,
        "both.pp.barrier.kappa": 4,
    }
    for name in ("soft.v.x", "stiff.v.x", "both.v.x"):
        assert view.capacity(name) == view.size(f"{name}.kappa")


def test_indices_count_from_one_and_targets_follow_each_other(pipeline_run: Callable[[str, str], Any]) -> None:
    """soft.v.x: 6 x 3 unknowns from 1; then A, 9 from 19; then t, 3 from 28."""
    run = pipeline_run("mixed_union", "clamp")
    interpreter, kappa = _indices(run.last, run.data)
    assert interpreter.starts == {"soft.v.x": 0, "stiff.body.A": 18, "stiff.body.t": 27}
    assert kappa["soft.v.x.kappa"] == [[1 + 3 * i] for i in range(6)]
    assert kappa["stiff.body.A.kappa"] == [[19]]
    assert kappa["stiff.body.t.kappa"] == [[28]]


def test_joins_gather_and_unions_pad_with_zero(pipeline_run: Callable[[str, str], Any]) -> None:
    run = pipeline_run("mixed_union", "clamp")
    _, kappa = _indices(run.last, run.data)
    of_points = kappa["stiff.v.x.kappa"]
    assert all(sorted(row) == [19, 28] for row in of_points)
    union = kappa["both.v.x.kappa"]
    assert union == of_points + [[1 + 3 * i, 0] for i in range(6)]
    assert kappa["both.v.gravity.kappa"] == union
    assert kappa["both.pp.barrier.kappa"] == [union[a] + union[b] for a, b in PAIRS]
    corners = [[0, 1, 2, 3], [1, 2, 3, 4], [2, 3, 4, 5]]
    assert kappa["soft.t.swell.kappa"] == [[1 + 3 * v for v in row] for row in corners]


def test_targets_of_a_mesh_and_the_scene_are_shared_by_all_instances(
    pipeline_run: Callable[[str, str], Any],
) -> None:
    """k: 1 unknown; x: 4 x 3 from 2; shift: 3 from 14."""
    run = pipeline_run("shared_targets", "clamp")
    _, kappa = _indices(run.last, run.data)
    assert [sorted(row) for row in kappa["m.v.moved.kappa"]] == [[2 + 3 * i, 14] for i in range(4)]
    ends = [[0, 1], [1, 2], [2, 3], [3, 0], [1, 1]]
    rows = kappa["m.s.stretch.kappa"]
    assert [sorted(row) for row in rows] == [sorted([1, 2 + 3 * a, 14, 2 + 3 * b, 14]) for a, b in ends]
    assert kappa["well.kappa"] == [[1]]
    assert sorted(kappa["m.anchor.kappa"][0]) == [1, 14]


def test_constant_members_contribute_nothing() -> None:
    random = np.random.default_rng(0)
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    free, fixed = mesh.add_primitive("free", 2), mesh.add_primitive("fixed", 3)
    free.add_attribute("x", 2, 1, value=random.random((2, 2)))
    fixed.add_constant("x", 2, 1, value=random.random((3, 2)))
    union = mesh.add_primitive_union("u", [fixed, free])
    x = union.add_attribute("x")
    pairs = mesh.add_primitive("p", 2)
    ends = pairs.add_connectivity("ends", union, [[0, 3], [4, 2]], 2)
    joined = pairs.add_attribute("x", through=ends, source=x)
    scene.add_energy(pairs.add_attribute("e", computed_attribute=joined.dot(joined)))
    scene.add_minimize_target(free["x"])
    emitted = emit(scene)
    run_pipeline(emitted.module)
    _, kappa = _indices(emitted.module, emitted.data)
    assert kappa["m.u.x.kappa"] == [[0], [0], [0], [1], [3]]
    assert kappa["m.p.e.kappa"] == [[0, 1], [3, 0]]


def test_index_functions_return_integers(run: Any) -> None:
    """Also those without inputs: what a call gives has the type of what the function returns."""
    functions = {op.sym_name.data: op for op in run.last.walk() if op.name == "func.func"}
    calls = [op for op in run.last.walk() if op.name == "rel.apply"]
    assert calls
    for call in calls:
        returned = functions[call.function.root_reference.data].function_type.outputs.data
        wanted = [v.type.element_type for v in call.values for _ in range(np.prod(v.type.get_shape()))]
        assert list(returned) == wanted
