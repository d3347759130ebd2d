"""What generated kernels and the runtime agree on, as runtime/core/sink.h says it."""

from __future__ import annotations

import re
from pathlib import Path

TEXT = Path(__file__).with_name("sink.h").read_text(encoding="utf-8").replace("#pragma once\n", "")
"""What generated files begin with."""
_NUMBERS = {name: int(number) for name, number in re.findall(r"kYasps(\w+) = (\d+)", TEXT)}
LANES = _NUMBERS["Lanes"]
"""Instances that a kernel of the processor evaluates at once."""
TILE = 1 << _NUMBERS["TileBits"]
"""Doubles of gradient or matrix in a tile, the unit in which pieces of an assembly share memory."""
THREADS = _NUMBERS["Threads"]
"""Of a block of a device, where a kernel does not ask for another number."""
DEVICE_FIELDS: list[tuple[str, str]] = re.findall(
    r"^    ([\w ]+\*?) (\w+);", TEXT.split("#else\nstruct")[0], re.MULTILINE
)
"""Types and names of what a kernel of derivatives is given on a device, in order."""
