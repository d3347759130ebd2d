"""Values that JOINs read and that depend on no target: computed when what they are made of has changed."""

from __future__ import annotations

import numpy as np
import pytest
from cuda_on_host import HostDevice
from numpy.typing import NDArray

from yasps import Scene
from yasps.backend.reference.interpreter import Interpreter
from yasps.frontend.execution.compiled_scene import CompiledScene
from yasps.runtime.device.protocol import Device

Floats = NDArray[np.float64]
POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.1], [0.0, 1.0, 0.2], [1.0, 1.0, 0.0]])


def build(device: str | Device = "cpu") -> Scene:
    """Springs from points to their rest positions, as stiff as the length of the rods at them."""
    scene = Scene("kept", device=device)
    points = scene.add_mesh("m").add_primitive("points", 4)
    x = points.add_attribute("x", 3, 1, value=2.0 * POINTS)
    rest = points.add_constant("rest", 3, 1, value=POINTS)
    rods = scene.m.add_primitive("rods", 3)
    ends = rods.add_connectivity("ends", points, [[0, 1], [1, 2], [2, 3]], 2)
    a, b = rods.add_attribute("ends_at_rest", through=ends, source=rest)
    rods.add_attribute("length", computed_attribute=(b - a).norm())
    around = points.add_connectivity("around", rods, [0, 0, 1, 1, 2, 2], counts=[1, 2, 2, 1])
    points.add_attribute("stiffness", through=around, source=rods["length"], operation="sum")
    pairs = scene.m.add_primitive("pairs", 2, is_dynamic=True)
    who = pairs.add_connectivity("who", points, [[0, 1], [2, 3]], 2)
    k = pairs.add_attribute("stiffnesses", through=who, source=points["stiffness"])
    u = pairs.add_attribute("positions", through=who, source=x) - pairs.add_attribute("rests", through=who, source=rest)
    scene.add_energy(pairs.add_attribute("spring", computed_attribute=k[0] * u.row(0).dot(u.row(0)) * k[1]))
    scene.add_minimize_target(x)
    return scene


def expected(scene: Scene) -> Floats:
    """The energies, by NumPy."""
    points = scene.m.points
    x, rest = (points[name].value.reshape(-1, 3) for name in ("x", "rest"))
    ends = rest[scene.m.rods.ends.indices]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    around = points.around.indices
    k = np.where(around >= 0, length[around], 0.0).sum(axis=1)
    first, second = scene.m.pairs.who.indices.T
    return np.asarray(k[first] * k[second] * ((x[first] - rest[first]) ** 2).sum(axis=1))


def energies(scene: Scene) -> Floats:
    return scene.energy_values()["m.pairs.spring"]


@pytest.mark.parametrize("device", ["cpu", "cuda on host"])
def test_values_follow_all_that_they_are_computed_from(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = build("cpu" if device == "cpu" else HostDevice())
    compiled = scene.compile()
    assert set(compiled.emitter.kept) == {"m.rods.length.kept", "m.points.stiffness.kept"}
    computed: list[str] = []
    run = type(compiled)._run

    def counted(self: CompiledScene, symbol: str, count: int, shape: tuple[int, int]) -> Floats:
        computed.append(symbol)
        return run(self, symbol, count, shape)

    monkeypatch.setattr(type(compiled), "_run", counted)
    both = ["m.rods.length", "m.points.stiffness"]

    def check(*again: str) -> None:
        computed.clear()
        np.testing.assert_allclose(energies(scene), expected(scene), rtol=1e-14)
        assert computed == [*again, "m.pairs.spring"]
        x = scene.m.points["x"].value
        gradient = scene.gradient()[0]
        scene.m.points["x"].update_value(x + 1e-6 * gradient)
        there = scene.total_energy()
        scene.m.points["x"].update_value(x - 1e-6 * gradient)
        change = there - scene.total_energy()
        np.testing.assert_allclose(change, 2e-6 * (gradient @ gradient), rtol=1e-7)
        scene.m.points["x"].update_value(x)
        assert not set(both) & set(computed[len(again) :])

    check(*both)
    check()
    scene.m.points["rest"].update_value(POINTS * [1.0, 2.0, 3.0])
    check(*both)
    scene.m.rods.ends.update_value([[0, 2], [1, 3], [0, 3]])
    check(*both)
    scene.m.points.around.update_value([0, 1, 2], counts=[1, 1, 0, 1])
    check("m.points.stiffness")
    scene.m.pairs.update(who=[[3, 0]])
    check()
    rods, around = scene.m.rods, scene.m.points.around
    scene.resize({rods: 2}, {rods.ends: [[0, 3], [1, 2]], around: ([0, 1, 1, 0], [1, 1, 1, 1])})
    check(*both)
    assert scene.compile() is compiled


def test_the_interpreter_agrees() -> None:
    compiled = build().compile()
    interpreter = Interpreter(compiled.module, compiled.data())
    assert interpreter.total_energy() == pytest.approx(compiled.total_energy(), rel=1e-14)


def test_what_depends_on_targets_is_not_kept() -> None:
    """Derivatives with respect to the rest positions go through lengths."""
    scene = build()
    x, rest = scene.m.points["x"], scene.m.points["rest"]
    assert scene.compile_for([x, rest]).emitter.kept == {}
    mixed = scene.mixed_hessian(x, rest).toarray()
    step = 1e-6
    for k in (4, 8):
        moved = []
        for sign in (1, -1):
            rest.update_value(POINTS.ravel() + sign * step * (np.arange(12) == k))
            moved.append(scene.gradient()[0])
        np.testing.assert_allclose(mixed[:, k], (moved[0] - moved[1]) / (2 * step), atol=1e-7)


def test_what_depends_on_dynamic_instances_is_not_kept() -> None:
    scene = build()
    groups = scene.m.add_primitive("groups", 2)
    weight = scene.m.pairs.add_attribute("weight", computed_attribute=scene.m.pairs["stiffnesses"].sum())
    of = groups.add_connectivity("of", scene.m.pairs, [0, 1], 1)
    x = groups.add_attribute(
        "x", through=groups.add_connectivity("at", scene.m.points, [0, 1], 1), source=scene.m.points["x"]
    )
    load = groups.add_attribute("weight", through=of, source=weight)
    scene.add_energy(groups.add_attribute("load", computed_attribute=load * x.dot(x)), dynamic_instances=True)
    assert "m.pairs.weight.kept" not in scene.compile().emitter.kept
    assert scene.total_energy() > 0
