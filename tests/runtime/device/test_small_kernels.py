"""The device's sums and its look at indices from others: their kernels run on the host."""

from __future__ import annotations

import numpy as np
import pytest
from cuda_on_host import HostDevice, HostProgram

from yasps.runtime.assembly.cuda import sum as cuda_sum
from yasps.runtime.build.cuda.sources import runtime_sources
from yasps.runtime.device.protocol import DeviceArray


@pytest.fixture(scope="module")
def program() -> HostProgram:
    """The kernels of sum.cu and check_indices.cu."""
    names = ("sum", "check_indices")
    return HostDevice().load([source for source in runtime_sources() if source.name in names])


@pytest.mark.parametrize("most_blocks", [1, 3, 2048])
def test_sums_of_any_length(program: HostProgram, monkeypatch: pytest.MonkeyPatch, most_blocks: int) -> None:
    """Fewer numbers than threads, and so many that blocks take several turns, and threads of the last block too."""
    monkeypatch.setattr(cuda_sum, "blocks_for_sum", lambda _, items: min(-(-items // 128), most_blocks))
    device = HostDevice()
    sums = cuda_sum.DeviceSum(device, program)
    counts = (0, 1, 127, 128, 129, 1000, 128 * 129 + 1)
    numbers = [np.random.default_rng(count).uniform(1, 2, count) for count in counts]
    for _ in range(2):
        sums.begin(len(counts))
        for values in numbers:
            sums.add(DeviceArray(device, np.float64, "numbers").upload(values))
        np.testing.assert_allclose(sums.results(), [values.sum() for values in numbers], rtol=1e-14)


@pytest.mark.parametrize(
    ("indices", "first_bad"),
    [([0, 6], None), ([], None), ([0, 7], 1), ([-1, 6], 0), ([3] * 300 + [7, 3, -1], 300), ([2**31 - 1], 0)],
)
def test_indices_from_others(program: HostProgram, indices: list[int], first_bad: int | None) -> None:
    """Of 7 instances."""
    device = HostDevice()
    given = DeviceArray(device, np.int32, "indices").upload(np.array(indices, np.int32))
    none = np.iinfo(np.int64).max
    answer = DeviceArray(device, np.int64, "answer").upload(np.array([none]))
    arguments = [given.address, len(indices), 7, answer.address]
    device.launch(program.kernel("yasps_check_indices"), max(1, len(indices)), arguments)
    assert answer.download()[0] == (none if first_bad is None else first_bad)
