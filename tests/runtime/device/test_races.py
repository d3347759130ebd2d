"""Kernels have no race: the host runs them and looks. First that it would find one."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import device_checks
import device_scenes
import numpy as np
import pytest
from cuda_on_host import HostDevice, HostProgram, kernels_of
from device_systems import CountingDevice, Maker, load_solver_program, random_structure
from numpy.typing import NDArray
from race_detector import Barrier, DataRaceError
from race_examples import ALONE, FOLLOW, HEAD, WAITING, kernel

from yasps.runtime.build.cuda.sources import runtime_sources
from yasps.runtime.build.toolchain import RUNTIME, Source
from yasps.runtime.core.library import Runtime
from yasps.runtime.device.protocol import DeviceArray
from yasps.runtime.matrix.cuda import product as cuda_product
from yasps.runtime.solvers.options import SolveOptions

# -- what finds races --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def examples() -> HostProgram:
    """All of race_examples."""
    texts = [HEAD + "".join(kernel(name, body) for name, body, _ in group) for group in (WAITING, ALONE)]
    return HostDevice(find_races=True).load([Source("waiting", texts[0] + FOLLOW), Source("alone", texts[1])])


@pytest.mark.parametrize("backwards", [False, True], ids=["", "backwards"])
@pytest.mark.parametrize(("name", "races"), [(name, races) for name, _, races in WAITING + ALONE])
def test_finds_races_and_nothing_else(examples: HostProgram, name: str, races: bool, backwards: bool) -> None:
    device = HostDevice(find_races=True, backwards=backwards)
    out = DeviceArray(device, np.float64, "the results").upload(np.zeros(4 * 192))
    for _ in range(2):  # launches are in order
        if not races:
            device.launch(examples.kernel(name), 192, [out.address, 192], block=64)
            continue
        with pytest.raises(DataRaceError):
            device.launch(examples.kernel(name), 192, [out.address, 192], block=64)


def test_says_where(examples: HostProgram) -> None:
    device = HostDevice(find_races=True)
    out = DeviceArray(device, np.float64, "the results").upload(np.zeros(192))
    body = "if (t == 0) out[0] = 1;"
    line = (HEAD + "".join(kernel(name, body) for name, body, _ in ALONE)).split(body)[0].count("\n") + 1
    with pytest.raises(DataRaceError) as caught:
        device.launch(examples.kernel("blocks_write"), 192, [out.address, 192], block=64)
    assert str(caught.value).splitlines() == [
        "blocks_write has a race in byte 0 of the results, the first of 4 found:",
        f"  thread 0 of block 0 writes it at alone:{line} (blocks_write)",
        f"  thread 0 of block 1 writes it at alone:{line} (blocks_write)",
    ]
    with pytest.raises(DataRaceError, match="shared memory"):
        device.launch(examples.kernel("shuffle_orders_nothing"), 192, [out.address, 192], block=64)


def has_race(script: NDArray[np.int32], block: int) -> bool:
    """Every two accesses compared."""
    accesses = []
    for i, orders in enumerate(script.T.tolist()):
        warps_met = blocks_met = 0
        for order in orders:
            warps_met += order == 1
            blocks_met += order == 2
            if order >= 4:
                accesses.append((order // 4, order % 4, i, blocks_met, warps_met))
    for k, (place, kind, i, blocks_met, warps_met) in enumerate(accesses):
        for other_place, other_kind, j, other_blocks_met, other_warps_met in accesses[:k]:
            if i == j or place != other_place or (kind == other_kind and kind != 1):
                continue
            in_order = i // block == j // block and blocks_met != other_blocks_met
            in_order |= i // 32 == j // 32 and warps_met != other_warps_met
            if not in_order:
                return True
    return False


def random_script(seed: int) -> NDArray[np.int32]:
    """Two blocks of two warps, of which few threads touch a place: they read, or add, and one writes in the end."""
    rng = np.random.default_rng(seed)
    active = rng.choice([0, 1, 2, 32, 33, 64, 65], int(rng.integers(2, 4)), replace=False)
    kind, steps = rng.choice([0, 2]), int(rng.integers(3, 9))
    script = np.zeros((steps, 128), np.int32)
    for row in script[:-1]:
        if rng.random() < 0.4:
            row[:] = rng.choice([1, 1, 2, 3])
        else:
            row[rng.choice(active)] = 4 * rng.choice([1, 1, 1, 2]) + kind
    script[-1, rng.choice(active)] = 4 + rng.choice([1, 1, 1, 2 - kind])
    return script


def test_agrees_with_comparing_all(examples: HostProgram) -> None:
    """Random programs: what is kept of each place decides as all accesses do."""
    device = HostDevice(find_races=True)
    data = DeviceArray(device, np.float64, "numbers").upload(np.zeros(4))
    races = 0
    for seed in range(400):
        script = random_script(seed)
        sent = DeviceArray(device, np.int32, "the script").upload(script)
        device.backwards = seed % 2 == 1
        try:
            device.launch(examples.kernel("follow"), 128, [sent.address, len(script), 128, data.address], block=64)
            found = False
        except DataRaceError:
            found = True
        assert found == has_race(script, 64), f"script {seed}"
        races += found
    assert 100 < races < 300


def test_knows_only_whole_warps() -> None:
    for text in ("__syncwarp(3);", "__shfl_down_sync(mask, x, 1);"):
        with pytest.raises(ValueError, match="no part of a warp"):
            HostDevice().load([Source("part", text)])


# -- kernels of the runtime --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def solver_program() -> HostProgram:
    """That of the solver and of the matrices."""
    return load_solver_program(HostDevice(find_races=True))


@pytest.fixture
def in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A team takes several blocks, as on a large system."""
    monkeypatch.setattr(cuda_product, "_ENOUGH_TEAMS", 4)
    monkeypatch.setattr(cuda_product, "_MOST_IN_TURN", 3)


LAYOUTS = [((9, 5, 9), (3, 12, 3)), ((5, 4, 2), (9, 5, 17)), ((9, 3, 4), (2, 6, 1)), ((7, 8, 9), (1, 3, 1))]
ALL_SCENES = {**device_checks.SCENES, **{f"held {name}": make for name, make in device_scenes.SCENES.items()}}
DEFAULT = "held nonlinear_contact"
"""What is looked at in every run."""


def solve(maker: Maker, layouts: Sequence[tuple[tuple[int, ...], tuple[int, ...]]] = LAYOUTS) -> None:
    """Structures, products and the beginning of solves, of both kinds."""
    for layout in layouts:
        for deterministic in (False, True):
            system = maker.random(random_structure(1, *layout))
            g = np.random.default_rng(2).standard_normal(system.size)
            solver = maker.solver(deterministic)
            solver.solve(system.parts, system.vector(g), SolveOptions(1e-24, 10))
    solver.solve(system.parts, system.vector(g), SolveOptions(1e-24, 2, preconditioner="two-level"))


@pytest.mark.usefixtures("in_turn")
def test_no_kernel_of_the_runtime_has_a_race(runtime: Runtime, solver_program: HostProgram) -> None:
    """All of them run."""
    device, *others = CountingDevice(find_races=True), HostDevice(find_races=True), HostDevice(find_races=True)
    solve(Maker(runtime, solver_program, device))
    device_checks.check_agreement(ALL_SCENES[DEFAULT], others[0], deterministic=True)
    device_checks.check_indices_of_the_device(others[1])
    launched = {*device.launches, *others[0].launches, *others[1].launches}
    assert launched >= {name for source in runtime_sources() for name, _ in kernels_of(source.text)}


@pytest.mark.usefixtures("in_turn")
def test_solvers_have_no_race_backwards(runtime: Runtime, solver_program: HostProgram) -> None:
    solve(Maker(runtime, solver_program, CountingDevice(find_races=True, backwards=True)))


def barriers() -> list[Barrier]:
    """Every one of device code that is not generated, by the files' own text."""
    package = RUNTIME.parent
    paths = [path for folder in ("runtime", "backend") for path in (package / folder).rglob("*.cu*")]
    texts = {path.name: path.read_text(encoding="utf-8") for path in paths}
    waits = re.compile(r"__syncthreads\w*\(|__syncwarp\(")
    return [
        Barrier(name, number)
        for name, text in sorted(texts.items())
        for number, line in enumerate(text.splitlines(), 1)
        if waits.search(line)
    ]


@pytest.mark.parametrize("barrier", barriers(), ids=lambda barrier: f"{barrier.file}:{barrier.line}")
@pytest.mark.usefixtures("in_turn")
def test_every_barrier_is_needed(runtime: Runtime, solver_program: HostProgram, barrier: Barrier) -> None:
    """Without it there is a race. All of them are in the kernels of solvers."""
    device = CountingDevice(find_races=True, left_out=barrier)
    with pytest.raises(DataRaceError, match="shared memory"):
        solve(Maker(runtime, solver_program, device))


# -- kernels of scenes -------------------------------------------------------------------------------------

SCENES = [
    pytest.param(name, deterministic, marks=() if name == DEFAULT and not deterministic else pytest.mark.nightly)
    for name in ALL_SCENES
    for deterministic in (False, True)
]


@pytest.mark.parametrize(("name", "deterministic"), SCENES)
def test_scenes_have_no_race(name: str, deterministic: bool) -> None:
    device = HostDevice(find_races=True)
    device_checks.check_agreement(ALL_SCENES[name], device, deterministic=deterministic)


class PlainSums(HostDevice):
    """Its generated kernels add without an atomic function."""

    def load(self, modules: Sequence[Source | str], runtime: Sequence[Source | str] = ()) -> HostProgram:
        plain = "template <class T, class U> __device__ inline void add_plainly(T* at, U value) { *at += value; }\n"
        changed = []
        for module in modules:
            assert isinstance(module, Source)
            assert "atomicAdd(" in module.text
            changed.append(replace(module, text=plain + module.text.replace("atomicAdd(", "add_plainly(")))
        return super().load(changed, runtime)


def test_sums_of_scenes_need_atomic_functions() -> None:
    with pytest.raises(DataRaceError, match=r"(?s)has a race in byte \d+ of .*add_plainly"):
        device_checks.check_agreement(device_checks.SCENES["rings, sum"], PlainSums(find_races=True))


@pytest.mark.nightly
def test_time_steps_with_contact_have_no_race() -> None:
    device_checks.check_two_bunnies(HostDevice(find_races=True))


@pytest.mark.nightly
@pytest.mark.parametrize("deterministic", [False, True], ids=["atomic", "deterministic"])
def test_a_large_scene_has_no_race(deterministic: bool) -> None:
    device = HostDevice(find_races=True)
    device_checks.check_agreement(lambda: device_checks.block(4).scene, device, deterministic=deterministic)
