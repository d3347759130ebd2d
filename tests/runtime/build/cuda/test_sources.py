"""Files of device code with what they include."""

from __future__ import annotations

import re

from yasps.runtime.build.cuda.sources import runtime_sources
from yasps.runtime.build.toolchain import RUNTIME


def test_lines_are_numbered_as_in_the_files() -> None:
    """So that what a compiler or compute-sanitizer says of a line can be looked up."""
    files = (path for path in RUNTIME.rglob("*") if path.suffix in (".cu", ".cuh", ".h"))
    texts = {path.name: path.read_text(encoding="utf-8") for path in files}
    for source in runtime_sources():
        name, number, met = "", 0, set()
        for line in source.text.splitlines():
            if found := re.fullmatch(r'#line (\d+) "(.+)"', line):
                number, name = int(found[1]), found[2]
                lines = texts[name].splitlines()
                continue
            assert line == ("" if lines[number - 1] == "#pragma once" else lines[number - 1])
            number += 1
            met.add(name)
        assert f"{source.name}.cu" in met
    assert '#line 1 "solver.cuh"' in next(source.text for source in runtime_sources() if source.name == "pcg")
