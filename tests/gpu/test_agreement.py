"""Scenes on a GPU give what they give on the CPU. The same on a device that the host plays, which proves the checks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import device_checks
import numpy as np
import pytest
from cuda_on_host import HostDevice
from device_checks import SCENES, MakeScene, OpenDevice
from numpy.typing import NDArray

from yasps import NoDeviceError
from yasps.runtime.build.cuda.nvcc import CudaNotFoundError
from yasps.runtime.device.driver import find_device
from yasps.runtime.device.gpu import Gpu


@dataclass(frozen=True)
class Place:
    """Where scenes run; `cells`: divisions of a cube that is large there."""

    open_device: OpenDevice
    cells: int


@pytest.fixture(params=[pytest.param("cuda", marks=pytest.mark.gpu), "host"])
def place(request: pytest.FixtureRequest) -> Place:
    """The GPU, if there is one; the host."""
    if request.param == "host":
        return Place(HostDevice, 2)
    try:
        find_device()
    except (NoDeviceError, CudaNotFoundError) as error:
        pytest.skip(str(error))
    return Place(Gpu, 24)


@pytest.mark.parametrize("deterministic", [False, True], ids=["atomic", "deterministic"])
@pytest.mark.parametrize("make", SCENES.values(), ids=SCENES.keys())
def test_a_scene_agrees(make: MakeScene, deterministic: bool, place: Place) -> None:
    device_checks.check_agreement(make, place.open_device(), deterministic=deterministic)


@pytest.mark.parametrize("deterministic", [False, True], ids=["atomic", "deterministic"])
def test_a_large_scene_agrees(deterministic: bool, place: Place) -> None:
    def make() -> device_checks.Scene:
        return device_checks.block(place.cells).scene

    device_checks.check_agreement(make, place.open_device(), deterministic=deterministic)


@pytest.mark.parametrize("make", SCENES.values(), ids=SCENES.keys())
def test_deterministic_scenes_give_the_same_bits(make: MakeScene, place: Place) -> None:
    device_checks.check_every_run_is_the_same(make, place.open_device)


def test_a_large_deterministic_scene_gives_the_same_bits(place: Place) -> None:
    make = partial(device_checks.block, place.cells)
    device_checks.check_every_run_is_the_same(lambda: make().scene, place.open_device)


def test_two_levels_agree(place: Place) -> None:
    device_checks.check_two_levels(lambda: device_checks.block(place.cells).scene, place.open_device())


def test_time_steps_agree(place: Place) -> None:
    device_checks.check_steps(place.cells // 2, place.open_device())


def test_indices_on_the_device(place: Place) -> None:
    device_checks.check_indices_of_the_device(place.open_device())


def test_out_of_memory(place: Place) -> None:
    device_checks.check_out_of_memory(place.open_device())


def test_two_scenes_on_a_device(place: Place) -> None:
    device_checks.check_two_scenes(place.open_device)


@pytest.mark.slow
def test_time_steps_with_contact_agree(place: Place) -> None:
    device_checks.check_two_bunnies(place.open_device())


# -- the checks themselves ---------------------------------------------------------------------------------


class Inexact(HostDevice):
    """Its results are off by a billionth."""

    def download(self, address: int, array: NDArray[Any]) -> None:
        super().download(address, array)
        if array.dtype == np.float64:
            array *= 1 + 1e-9


class Restless(HostDevice):
    """The last bit of its results changes from run to run."""

    downloads = 0

    def download(self, address: int, array: NDArray[Any]) -> None:
        super().download(address, array)
        Restless.downloads += 1
        if array.dtype == np.float64 and Restless.downloads % 3 == 0:
            array[...] = np.nextafter(array, np.inf)


def test_a_device_that_is_off_is_found() -> None:
    with pytest.raises(AssertionError, match=r"differs from the CPU's by 1\.0e-09"):
        device_checks.check_agreement(SCENES["shared_targets"], Inexact())
    with pytest.raises(AssertionError):
        device_checks.check_every_run_is_the_same(SCENES["shared_targets"], Restless)
