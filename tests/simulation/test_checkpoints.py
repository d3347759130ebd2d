"""States in files: runs that go on to the last bit, files that are whole or not there, and states that are refused."""

from __future__ import annotations

import logging
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import checkpoint_scene
import numpy as np
import pytest
from checkpoint_scene import CUBE, NAME, crowd

from yasps import NotConvergedError, Scene, SceneError
from yasps.bodies import AffineBody, SoftBody
from yasps.output import FrameRecorder, read_series
from yasps.runtime.solvers.pcg import PreconditionerChoice
from yasps.simulation import Checkpoints, DamagedStateError, Simulation, fingerprint, state_files
from yasps.stepping import BDF2


def assert_same(one: Simulation, other: Simulation) -> None:
    """Both have the same state, to the last bit."""
    assert_states_same(one.state(), other.state())


def assert_states_same(mine: Mapping[str, Any], others: Mapping[str, Any]) -> None:
    assert mine.keys() == others.keys()
    for name, value in mine.items():
        np.testing.assert_array_equal(others[name], value, err_msg=name)


def falling(**options: Any) -> tuple[Simulation, SoftBody]:
    """A soft cube in the air."""
    scene = Scene("falling", threads=1)
    soft = SoftBody(scene, "soft", CUBE)
    return Simulation(scene, [soft], **{"contact": False, "activation_distance": 1e-3, **options}), soft


# -- the same to the last bit ------------------------------------------------------------------------------------------


def test_a_restored_run_is_the_same_to_the_last_bit(tmp_path: Path) -> None:
    """Soft, affine and rigid bodies, friction, a moving obstacle, a joint, a pin, a field of forces, BDF2."""
    whole = crowd(threads=2)
    states = {}
    for frame in range(21):
        if frame in {0, 1, 2, 9, 13, 20}:
            whole.save(tmp_path / f"{frame}.npz")
            states[frame] = whole.state()
        if frame < 20:
            whole.step()
    assert whole.contact is not None
    assert len(whole.contact.active) > 0
    again = crowd(threads=1)
    for frame, end in ((0, 9), (1, 9), (2, 9), (9, 13), (13, 20)):  # also back in time
        again.restore(tmp_path / f"{frame}.npz")
        assert again.frame == frame
        for _ in range(end - frame):
            again.step()
        assert_states_same(again.state(), states[end])


@pytest.mark.nightly
@pytest.mark.parametrize("solver", ["direct", "auto"])
def test_other_solvers_go_on_in_the_same_way(solver: str, tmp_path: Path) -> None:
    whole = crowd(threads=2, solver=solver)
    whole.run(8)
    whole.save(tmp_path / "state.npz")
    whole.run(12)
    again = crowd(threads=1, solver=solver)
    again.restore(tmp_path / "state.npz")
    again.run(12)
    assert_same(again, whole)


def test_what_auto_has_learned_belongs_to_the_state(tmp_path: Path) -> None:
    simulation, _ = falling()
    simulation.scene.compile().direct_solves_left = 7
    learned = PreconditionerChoice(two_level=True, lead=3.5, solved=6, wait=16)
    simulation.scene.compile().preconditioner_choice.set_numbers(learned.numbers())
    simulation.save(tmp_path / "state.npz")
    again, _ = falling()
    again.restore(tmp_path / "state.npz")
    assert again.scene.compile().direct_solves_left == 7
    assert again.scene.compile().preconditioner_choice == learned


def test_numbers_that_were_set_on_the_way_are_restored(tmp_path: Path) -> None:
    """Also back, in the simulation itself."""
    simulation, soft = falling()
    force = simulation.add_force(soft)
    simulation.run(2)
    simulation.save(tmp_path / "early.npz")
    force.update_value(np.ones(24))
    simulation.gravity.update_value([0.0, 0.0, 1.0])
    simulation.step()
    simulation.save(tmp_path / "late.npz")
    simulation.restore(tmp_path / "early.npz")
    assert not force.value.any()
    assert simulation.gravity.value[2] == -9.8
    again, other = falling()
    its = again.add_force(other)
    again.restore(tmp_path / "late.npz")
    np.testing.assert_array_equal(its.value, 1.0)
    assert again.gravity.value[2] == 1.0
    again.restore(tmp_path / "early.npz")
    assert_same(again, simulation)


def test_pins_that_were_moved_and_released_are_restored(tmp_path: Path) -> None:
    def pinned() -> tuple[Simulation, SoftBody, list[Any]]:
        simulation, soft = falling()
        return simulation, soft, [simulation.pin(soft, [0]), simulation.pin(soft, [7]), simulation.pin(soft, [3], 1e3)]

    simulation, _, (moved, released, spring) = pinned()
    simulation.step()
    moved.move_to(moved.positions() + 0.01)
    released.release()
    spring.move_to([[0.0, 0.0, 0.1]])
    simulation.step()
    simulation.save(tmp_path / "state.npz")
    simulation.run(3)
    again, _, _ = pinned()
    again.restore(tmp_path / "state.npz")
    again.run(3)
    assert_same(again, simulation)


# -- runs that were ended ----------------------------------------------------------------------------------------------


def start(folder: Path, frames: int, threads: int = 1) -> subprocess.Popen[str]:
    """The scene in a process of its own, which has just begun its first step."""
    command = [sys.executable, checkpoint_scene.__file__, str(folder), str(frames), str(threads)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    assert process.stdout.readline().strip().isdigit()
    return process


def kill_until_it_ends(folder: Path, frames: int, delays: Callable[[], float], most: int) -> int:
    """Runs, killed after each delay [s] and resumed, until one gets to the end; how many were killed."""
    for kills in range(most + 1):
        with start(folder, frames, threads=1 + kills % 2) as process:
            try:
                process.wait(None if kills == most else delays())
            except subprocess.TimeoutExpired:
                process.kill()
        if process.returncode == 0:
            return kills
        assert process.returncode == -signal.SIGKILL
    raise AssertionError("the last run was not killed and did not end")


def assert_run_is_whole(folder: Path, frames: int) -> None:
    """State and file are those of a run that nobody has ended."""
    whole = crowd()
    with FrameRecorder(whole, folder / "whole", NAME, pictures=False) as files:
        whole.run(frames, files)
    last = crowd()
    Checkpoints(folder, NAME).resume(last)
    assert last.frame == frames
    assert_same(last, whole)
    expected, found = read_series(folder / "whole" / f"{NAME}.vtkhdf"), read_series(folder / f"{NAME}.vtkhdf")
    assert len(found) == frames + 1
    np.testing.assert_array_equal(found.times, expected.times)
    for frame in range(frames + 1):
        np.testing.assert_array_equal(found.positions(frame), expected.positions(frame))


def test_a_run_that_was_killed_goes_on(tmp_path: Path) -> None:
    assert kill_until_it_ends(tmp_path, 30, lambda: 0.3, most=1) == 1
    assert_run_is_whole(tmp_path, 30)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(2))
def test_a_run_that_is_killed_again_and_again_ends_all_the_same(seed: int, tmp_path: Path) -> None:
    chance = random.Random(seed)
    assert kill_until_it_ends(tmp_path, 150, lambda: chance.uniform(0.0, 0.8), most=25) > 3
    assert_run_is_whole(tmp_path, 150)


def test_frames_after_the_checkpoint_are_made_again(tmp_path: Path) -> None:
    def run(folder: Path, frames: int, checkpoints: Checkpoints, *, resumes: bool = False) -> Simulation:
        simulation, _ = falling()
        if resumes:
            checkpoints.resume(simulation)
        with FrameRecorder(simulation, folder, "falling", pictures=False, resume=resumes) as files:
            if frames < 0:  # ends in the middle of frame 9
                simulation.before_step.append(stop)
                with pytest.raises(KeyboardInterrupt):
                    simulation.run(20, files, checkpoints)
            else:
                simulation.run(frames, files, checkpoints)
        return simulation

    def stop(simulation: Simulation) -> None:
        if simulation.frame == 8:
            raise KeyboardInterrupt

    run(tmp_path, -1, Checkpoints(tmp_path, "falling", every=5))
    assert len(read_series(tmp_path / "falling.vtkhdf")) == 9
    resumed = run(tmp_path, 7, Checkpoints(tmp_path, "falling", every=5), resumes=True)
    assert resumed.frame == 12
    whole = run(tmp_path / "whole", 12, Checkpoints(tmp_path / "whole", "falling"))
    assert_same(resumed, whole)
    one, other = (read_series(folder / "falling.vtkhdf") for folder in (tmp_path, tmp_path / "whole"))
    np.testing.assert_array_equal(one.times, other.times)
    for frame in range(13):
        np.testing.assert_array_equal(one.positions(frame), other.positions(frame))


def test_states_are_written_when_they_are_due(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[int] = []
    simulation, _ = falling()
    monkeypatch.setattr(simulation, "save", lambda file: written.append(simulation.frame))
    simulation.run(7, checkpoints=Checkpoints(tmp_path, "every", every=3))
    assert written == [0, 3, 6, 7]
    clock = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    by_time = Checkpoints(tmp_path, "time", seconds=10.0)
    written.clear()
    for now, is_written in ((0.0, True), (9.0, False), (10.5, True), (20.0, False), (21.0, True)):
        clock[0] = now
        simulation.frame += 1
        by_time.save_if_due(simulation)
        assert (written[-1:] == [simulation.frame]) == is_written


# -- files that can't be read or written -------------------------------------------------------------------------------


def flipped(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


@pytest.mark.parametrize(
    "damage", [flipped, lambda x: x[: len(x) // 2], lambda x: x[:-30], lambda x: b"", lambda x: b"\0" * len(x)]
)
def test_a_damaged_file_is_refused_and_the_earlier_one_taken(
    damage: Callable[[bytes], bytes], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    simulation, _ = falling()
    checkpoints = Checkpoints(tmp_path, "falling", every=2)
    simulation.run(4, checkpoints=checkpoints)
    checkpoints.file.write_bytes(damage(checkpoints.file.read_bytes()))
    again, _ = falling()
    before = again.state()
    with pytest.raises(DamagedStateError, match="holds no state of a simulation"):
        again.restore(checkpoints.file)
    for name, value in again.state().items():
        np.testing.assert_array_equal(value, before[name])
    with caplog.at_level(logging.WARNING, "yasps"):
        assert Checkpoints(tmp_path, "falling").resume(again) == checkpoints.earlier
    assert again.frame == 2
    assert "holds no state of a simulation" in caplog.text
    assert "the one before it is taken" in caplog.text
    checkpoints.earlier.write_bytes(b"")
    with pytest.raises(DamagedStateError, match="earlier-checkpoint"):
        Checkpoints(tmp_path, "falling").resume(again)


def test_every_bit_of_a_file_counts(tmp_path: Path) -> None:
    """A bit that is turned anywhere is noticed, or changes nothing."""
    simulation, _ = falling()
    simulation.run(2)
    file = tmp_path / "state.npz"
    simulation.save(file)
    content = file.read_bytes()
    noticed = 0
    for place in random.Random(0).sample(range(len(content)), 60):
        file.write_bytes(content[:place] + bytes([content[place] ^ 4]) + content[place + 1 :])
        again, _ = falling()
        try:
            again.restore(file)
        except SceneError:
            noticed += 1
        else:
            assert_same(again, simulation)
    assert noticed > 30


@pytest.mark.parametrize(("place", "what"), [(4, "version"), (6, "encryption"), (8, "method of compression")])
def test_damage_to_how_a_file_is_packed_is_said(tmp_path: Path, place: int, what: str) -> None:
    """In each entry of a zip file: what it needs, flags, and its method."""
    simulation, _ = falling()
    file = tmp_path / "state.npz"
    simulation.save(file)
    content = bytearray(file.read_bytes())
    directory = content.index(b"PK\x01\x02")
    content[place] ^= 0x61
    content[directory + place + 2] ^= 0x61
    file.write_bytes(content)
    with pytest.raises(SceneError, match=r"state\.npz holds no state of a simulation"):
        simulation.restore(file)


def test_a_file_that_can_not_be_written_leaves_the_one_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    simulation, _ = falling()
    file = tmp_path / "state.npz"
    simulation.save(file)
    content = file.read_bytes()
    simulation.step()

    def full(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(SceneError, match=r"the state can't be written to .*No space left on device"):
            simulation.save(file)
    assert file.read_bytes() == content
    assert list(tmp_path.iterdir()) == [file]
    with pytest.raises(SceneError, match=r"the state can't be written to .*No such file or directory"):
        simulation.save(tmp_path / "nowhere" / "state.npz")


def test_no_checkpoint_is_said(tmp_path: Path) -> None:
    simulation, _ = falling()
    with pytest.raises(SceneError, match=r"there is no checkpoint to go on from: .*none.checkpoint.npz does not exist"):
        Checkpoints(tmp_path, "none").resume(simulation)
    with pytest.raises(SceneError, match="every, in frames"):
        Checkpoints(tmp_path, "none", every=0)
    with pytest.raises(SceneError, match="seconds from one to the next"):
        Checkpoints(tmp_path, "none", seconds=0.0)


# -- states of something else ------------------------------------------------------------------------------------------


def other_scene() -> Simulation:
    scene = Scene("other", threads=1)
    return Simulation(scene, [SoftBody(scene, "soft", CUBE)], contact=False, activation_distance=1e-3)


def other_body() -> Simulation:
    scene = Scene("falling", threads=1)
    return Simulation(scene, [AffineBody(scene, "soft", CUBE)], contact=False, activation_distance=1e-3)


def one_more_body() -> Simulation:
    scene = Scene("falling", threads=1)
    bodies = [SoftBody(scene, "soft", CUBE), SoftBody(scene, "heap", CUBE.translated((1.0, 0.0, 0.0)))]
    return Simulation(scene, bodies, contact=False, activation_distance=1e-3)


def one_more_energy() -> Simulation:
    simulation, soft = falling()
    soft.add_energy(soft.vertices.add_attribute("lift", computed_attribute=-1.0 * soft.position[2]))
    return simulation


def of_material(**material: Any) -> Simulation:
    scene = Scene("falling", threads=1)
    soft = SoftBody(scene, "soft", CUBE, **material)
    return Simulation(scene, [soft], contact=False, activation_distance=1e-3)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (other_scene, "the scene is falling there and other here"),
        (other_body, "body soft is SoftBody of 8 vertices there and AffineBody of 8 vertices here"),
        (one_more_body, "the list of bodies is soft there and soft, heap here"),
        (one_more_energy, "energy soft.vertices.lift is not in it"),
        (lambda: falling(time_step=0.02)[0], r"time_step is \[0.01\] there and \[0.02\] here"),
        (lambda: falling(gravity=(0.0, 0.0, 1.0))[0], r"gravity is \[ ?0. ?, +0. ?, -9.8\] there and"),
        (lambda: falling(integrator=BDF2)[0], "the integrator is backward Euler there and BDF2 here"),
        (lambda: falling(rescue=1)[0], "rescue is 3 there and 1 here"),
        (lambda: of_material(youngs_modulus=2e5), "is .* there and .* here"),
        (lambda: of_material(density=900.0), "mass is an array .* there and .* here"),
    ],
)
def test_a_state_of_something_else_is_refused_by_name(
    make: Callable[[], Simulation], words: str, tmp_path: Path
) -> None:
    simulation, _ = falling()
    simulation.run(2)
    simulation.save(tmp_path / "state.npz")
    another = make()
    before = another.state()
    with pytest.raises(SceneError, match=f"state.npz is a state of another simulation: .*({words})"):
        another.restore(tmp_path / "state.npz")
    for name, value in another.state().items():
        np.testing.assert_array_equal(value, before[name])


def test_a_state_of_another_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    simulation, _ = falling()
    simulation.save(tmp_path / "state.npz")
    monkeypatch.setattr(fingerprint, "__version__", "9.9")
    again, _ = falling()
    with pytest.raises(SceneError, match=r"the version of yasps is 0.1.0 there and 9.9 here"):
        again.restore(tmp_path / "state.npz")


def test_a_body_that_came_on_the_way_is_missed(tmp_path: Path) -> None:
    simulation, _ = falling()
    simulation.step()
    simulation.add(SoftBody(simulation.scene, "heap", CUBE.translated((1.0, 0.0, 0.0))))
    simulation.step()
    simulation.save(tmp_path / "state.npz")
    simulation.run(2)
    later = simulation.state()
    simulation.restore(tmp_path / "state.npz")
    simulation.run(2)
    for name, value in simulation.state().items():
        np.testing.assert_array_equal(later[name], value)
    again, _ = falling()
    with pytest.raises(SceneError, match="the list of bodies is soft, heap there and soft here"):
        again.restore(tmp_path / "state.npz")


def test_a_state_that_does_not_fit_what_stands_here_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation, _ = falling()
    simulation.run(2)
    simulation.save(tmp_path / "state.npz")
    simulation.gravity.update_value([0.0, 0.0, 1.0])
    simulation.step()
    before = simulation.state()

    def fails(past: object) -> None:
        monkeypatch.undo()
        raise NotConvergedError("not today")

    monkeypatch.setattr(simulation.stepper, "remember", fails)
    with pytest.raises(NotConvergedError, match="not today"):
        simulation.restore(tmp_path / "state.npz")
    assert simulation.gravity.value[2] == 1.0
    for name, value in simulation.state().items():
        np.testing.assert_array_equal(value, before[name])


def test_arrays_are_read_as_they_were_written(tmp_path: Path) -> None:
    arrays = {"a/b.c": np.arange(6.0).reshape(2, 3), "empty": np.empty((0, 3)), "text": np.array("ä")}
    state_files.write_arrays(tmp_path / "x.npz", arrays)
    read = state_files.read_arrays(tmp_path / "x.npz")
    assert read.keys() == arrays.keys()
    for name, value in arrays.items():
        np.testing.assert_array_equal(read[name], value)
        assert read[name].dtype == value.dtype
