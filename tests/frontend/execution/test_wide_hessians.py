"""Local Hessians that are wide: what fits is right, whatever stack a thread has, and what does not is refused."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cuda_on_host import HostDevice
from device_checks import on_device

from yasps import Connectivity, Scene, UnsupportedSceneError
from yasps.backend.reference.interpreter import Interpreter
from yasps.frontend.execution import compiled_scene
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.passes.analysis.local_width import WIDEST_CURVED, WIDEST_EXPANDED, WIDEST_INPUTS

STACK = 2048  # KiB, of a thread: the least of a usual system


def check(scene: Scene) -> None:
    """Gradient and Hessian are those of the interpreter."""
    compiled = scene.compile()
    assert isinstance(compiled, CpuScene)
    gradient = compiled.assemble()
    expected, hessian = Interpreter(compiled.module, compiled.data()).assemble()
    np.testing.assert_allclose(gradient, expected, rtol=1e-12, atol=1e-12)
    found = compiled.static_matrix.to_scipy().toarray()
    np.testing.assert_allclose(found, hessian.toarray(), rtol=1e-12, atol=1e-12 * np.abs(found).max())


def chain(links: int, joints: int) -> tuple[Scene, Connectivity]:
    """The end of a chain of links in the plane, each of which all joints turn, is drawn to a point."""
    scene = Scene("chain", threads=1)
    mesh = scene.add_mesh("arm")
    hinges, sticks = mesh.add_primitive("joints", joints), mesh.add_primitive("links", links)
    tips = mesh.add_primitive("tips", 1)
    angle = hinges.add_attribute("angle", 1, 1, value=np.linspace(0.0, 0.1, joints))
    turning = sticks.add_connectivity("joints", hinges, list(range(joints)) * links, counts=[joints] * links)
    direction = sticks.add_attribute("direction", through=turning, source=angle, operation="sum")
    cosine = sticks.add_attribute("cosine", computed_attribute=direction.cos())
    way = tips.add_connectivity("links", sticks, list(range(links)), counts=[links])
    off = tips.add_attribute("end", through=way, source=cosine, operation="sum") - 0.5
    scene.add_energy(tips.add_attribute("pull", computed_attribute=off * off), projection="none")
    scene.add_minimize_target(angle)
    return scene, way


def middle(points: int) -> Scene:
    """A centre of its own is drawn to the mean of many points."""
    scene = Scene("middle", threads=1)
    mesh = scene.add_mesh("cloud")
    dots, centres = mesh.add_primitive("points", points), mesh.add_primitive("centres", 1)
    x = dots.add_attribute("x", 3, 1, value=np.sin(np.arange(3.0 * points)))
    own = centres.add_attribute("own", 3, 1, value=[1.0, 2.0, 3.0])
    around = centres.add_connectivity("around", dots, list(range(points)), counts=[points])
    off = centres.add_attribute("mean", through=around, source=x, operation="mean") - own
    scene.add_energy(centres.add_attribute("pull", computed_attribute=off.dot(off)))
    scene.add_minimize_target([x, own])
    return scene


def all_at_once(points: int) -> Scene:
    """An energy that reads all points one by one, through a JOIN of fixed arity."""
    scene = Scene("together", threads=1)
    mesh = scene.add_mesh("m")
    dots, groups = mesh.add_primitive("points", points), mesh.add_primitive("groups", 1)
    x = dots.add_attribute("x", 1, 1, value=np.cos(np.arange(points)))
    members = groups.add_connectivity("members", dots, list(range(points)), points)
    together = groups.add_attribute("together", through=members, source=x)
    scene.add_energy(groups.add_attribute("size", computed_attribute=together.dot(together) ** 2))
    scene.add_minimize_target(x)
    return scene


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["chain(26, 20)[0]", "middle(300)", "all_at_once(66)"])
def test_a_wide_hessian_needs_no_deep_stack(scene: str) -> None:
    """Its arrays would be larger than the stack; so in a process of its own, which might die."""
    paths = [str(Path(__file__).parent), *sys.path]
    code = f"from test_wide_hessians import *; check({scene})"
    run = subprocess.run(
        ["sh", "-c", f'ulimit -s {STACK} && exec "$@"', "sh", sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OMP_STACKSIZE": f"{STACK}K"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr[-2000:]


@pytest.mark.parametrize("device", [None, HostDevice])
def test_curvature_of_too_many_unknowns_is_refused(device: type[HostDevice] | None) -> None:
    links = WIDEST_CURVED // 20 + 1
    scene, _ = chain(links, 20)
    if device is not None:
        on_device(scene, device())
    with pytest.raises(UnsupportedSceneError) as caught:
        scene.compile()
    for part in (
        "arm.tips.pull (made at ",
        "test_wide_hessians.py:",
        f"up to {20 * links} unknowns",
        f"{WIDEST_CURVED} is the most",
        f"up to {links} instances through arm.tips.links times up to 20 instances through arm.links.joints times 1 of",
        "connect each instance to fewer others",
    ):
        assert part in str(caught.value)


@pytest.mark.slow
def test_rows_that_become_too_long_are_refused_and_shorter_ones_work_again() -> None:
    scene, way = chain(2, 200)
    scene.gradient()
    before = way.indices.copy()
    way.update_value(([0, 1] * 3, [6]))
    with pytest.raises(UnsupportedSceneError, match=r"up to 6 instances through arm\.tips\.links"):
        scene.gradient()
    way.update_value((before.ravel(), [2]))
    check(scene)


def test_a_sum_over_too_many_unknowns_is_refused() -> None:
    points = WIDEST_EXPANDED // 3
    with pytest.raises(UnsupportedSceneError, match=f"up to {points} instances through cloud.centres.around times 3"):
        middle(points).compile()


def test_too_many_inputs_are_refused_before_they_are_differentiated() -> None:
    wide = WIDEST_INPUTS + 1
    with pytest.raises(UnsupportedSceneError, match=f"{wide} numbers wide, but {WIDEST_INPUTS} .* m.groups.members"):
        all_at_once(wide).compile()


def test_more_blocks_than_can_be_numbered_are_refused_before_they_are_allocated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = all_at_once(3)
    monkeypatch.setattr(compiled_scene, "MOST_LOCAL_BLOCKS", 5)
    with pytest.raises(UnsupportedSceneError, match=r"m.groups.size \(made at .*\) has 6 local blocks.* 1 instances"):
        scene.gradient()
    monkeypatch.setattr(compiled_scene, "MOST_LOCAL_BLOCKS", 6)
    check(scene)
