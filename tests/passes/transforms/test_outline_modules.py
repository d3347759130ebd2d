"""`outline-modules`: one object for each definition, with all it calls and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from xdsl.dialects.func import FuncOp

from yasps.dialects.rel import ApplyOp, AttributeOp, DerivativeOp, JacobianOp, ObjectOp, SceneOp, UnionOp, name_of


def _definitions(container: Any) -> list[Any]:
    kinds = (AttributeOp, DerivativeOp, JacobianOp)
    return [op for op in container.body.block.ops if isinstance(op, kinds)]


def test_one_object_for_each_definition(run: Any) -> None:
    before = run.stages["lower-to-scalar"].module
    (scene,) = before.body.block.ops
    defined = [op.symbol for op in _definitions(scene) if op.body.blocks]
    objects = [op for op in run.last.body.block.ops if isinstance(op, ObjectOp)]
    assert [op.sym_name.data for op in objects] == [f"{name}.object" for name in defined]
    for name, container in zip(defined, objects, strict=True):
        (definition,) = _definitions(container)
        assert definition.symbol == name


def test_an_object_holds_the_functions_it_calls(run: Any) -> None:
    functions = []
    for container in run.last.body.block.ops:
        if isinstance(container, ObjectOp):
            called = {name_of(op.function) for op in container.walk() if isinstance(op, ApplyOp)}
            held = [op.sym_name.data for op in container.walk() if isinstance(op, FuncOp)]
            assert sorted(held) == sorted(called)
            functions += held
    assert len(functions) == len(set(functions))
    lowered = [op for op in run.stages["lower-to-scalar"].module.walk() if isinstance(op, FuncOp)]
    assert len(functions) == len(lowered)


def test_the_scene_keeps_declarations_only(run: Any) -> None:
    scene = run.last.body.block.first_op
    assert isinstance(scene, SceneOp)
    assert not [op for op in scene.body.block.ops if isinstance(op, DerivativeOp | JacobianOp | FuncOp)]
    attributes = [op for op in scene.body.block.ops if isinstance(op, AttributeOp)]
    assert attributes
    assert not [op.symbol for op in attributes if op.body.blocks]


def _entries(run: Any) -> dict[str, list[str]]:
    return {
        op.sym_name.data.removesuffix(".object"): [entry.data for entry in op.entries]
        for op in run.last.body.block.ops
        if isinstance(op, ObjectOp)
    }


def test_entries_say_how_an_object_is_run(pipeline_run: Callable[[str, str], Any]) -> None:
    assert _entries(pipeline_run("mixed_union", "clamp")) == {
        "stiff.v.x": ["call"],
        "both.v.x": ["call"],
        "stiff.body.rigid": ["batch"],
        "stiff.s.spring": ["batch"],
        "soft.t.swell": ["batch"],
        "both.v.gravity": ["batch"],
        "both.pp.barrier": ["batch"],
        "stiff.v.x.jacobian": ["call"],
        "stiff.body.rigid.derivative": ["batch"],
        "stiff.s.spring.derivative": ["batch"],
        "soft.t.swell.derivative": ["batch"],
        "both.v.gravity.derivative": ["batch"],
        "both.pp.barrier.derivative": ["batch"],
        "stiff.body.A.kappa": ["call"],
        "stiff.body.t.kappa": ["call"],
        "stiff.v.x.kappa": ["call"],
        "soft.v.x.kappa": ["call"],
        "both.v.x.kappa": ["call"],
        "stiff.body.rigid.kappa": ["batch"],
        "stiff.s.spring.kappa": ["batch"],
        "soft.t.swell.kappa": ["batch"],
        "both.v.gravity.kappa": ["batch"],
        "both.pp.barrier.kappa": ["batch"],
    }


def test_whatever_is_read_elsewhere_can_be_called(run: Any) -> None:
    entries = _entries(run)
    for op in run.last.walk():
        read = []
        if op.name == "rel.join":
            read = [name_of(op.source)]
        elif op.name == "rel.ref":
            read = [name_of(op.attribute)]
        elif isinstance(op, UnionOp):
            read = [name_of(member) for member in op.members]
        for name in read:
            assert name not in entries or "call" in entries[name], name
