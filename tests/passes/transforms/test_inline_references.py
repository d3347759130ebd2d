"""`inline-references`: bodies are closed down to data, JOINs and UNIONs, and hold each value once."""

from __future__ import annotations

import numpy as np
from small_scenes import emit

from yasps import Scene
from yasps.dialects.rel import AttributeOp, RefOp
from yasps.passes.pipeline import make_context
from yasps.passes.transforms.inline_references import InlineReferences


def _scene() -> Scene:
    scene = Scene("s")
    points = scene.add_mesh("m").add_primitive("v", 2)
    x = points.add_attribute("x", 3, 1, value=np.ones((2, 3)))
    square = points.add_attribute("square", computed_attribute=x.dot(x))
    root = points.add_attribute("root", computed_attribute=(square + 1.0).sqrt())
    scene.add_energy(points.add_attribute("e", computed_attribute=root * square + square))
    scene.add_minimize_target(x)
    return scene


def _inlined(scene: Scene) -> dict[str, AttributeOp]:
    emitted = emit(scene)
    InlineReferences().apply(make_context(), emitted.module)
    emitted.module.verify()
    return {op.symbol: op for op in emitted.module.walk() if isinstance(op, AttributeOp)}


def test_references_are_replaced_and_attributes_nobody_needs_dropped() -> None:
    attributes = _inlined(_scene())
    assert list(attributes) == ["m.v.e"]
    names = [op.name for op in attributes["m.v.e"].body.block.ops]
    assert names.count("rel.data") == 1
    assert names.count("mat.dot") == 1  # `square` is used three times
    assert "rel.ref" not in names


def test_references_to_unions_stay() -> None:
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    for name in ("a", "b"):
        mesh.add_primitive(name, 1).add_attribute("x", 1, 1)
    union = mesh.add_primitive_union("u", [mesh.a, mesh.b])
    x = union.add_attribute("x")
    scene.add_energy(union.add_attribute("e", computed_attribute=x * x))
    scene.add_minimize_target(mesh.a["x"])
    attributes = _inlined(scene)
    assert list(attributes) == ["m.u.x", "m.u.e"]
    assert [op.attribute.root_reference.data for op in attributes["m.u.e"].walk() if isinstance(op, RefOp)] == ["m.u.x"]


def test_what_a_join_reads_is_kept() -> None:
    scene = _scene()
    points = scene.m.v
    pairs = scene.m.add_primitive("p", 1)
    ends = pairs.add_connectivity("ends", points, [0, 1], 2)
    joined = pairs.add_attribute("roots", through=ends, source=points["root"])
    scene.add_energy(pairs.add_attribute("e", computed_attribute=joined.dot(joined)))
    assert list(_inlined(scene)) == ["m.v.root", "m.v.e", "m.p.e"]


def test_what_only_a_union_reads_is_kept() -> None:
    scene = _scene()
    union = scene.m.add_primitive_union("u", [scene.m.v, scene.m.add_primitive("w", 1)])
    scene.m.w.add_attribute("root", computed_attribute=2.0 * scene.m.w.add_attribute("x", 1, 1))
    root = union.add_attribute("root")
    scene.add_energy(union.add_attribute("e", computed_attribute=root * root))
    assert set(_inlined(scene)) == {"m.v.root", "m.w.root", "m.u.root", "m.v.e", "m.u.e"}
