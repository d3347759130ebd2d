"""What mypy says of a user's script."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import mypy.api
import pytest

ROOT = Path(__file__).parents[2]


def problems(scripts: Sequence[str], folder: Path) -> list[list[str]]:
    """For each script the errors in strict mode, a line each; they are written into the folder and checked in one go.

    The cache is that of `mypy` in the checkout, which CI fills while the first tests run; from an empty one it takes a
    minute.
    """
    files = [folder / f"script_{k}.py" for k in range(len(scripts))]
    for file, script in zip(files, scripts, strict=True):
        file.write_text(script, encoding="utf-8")
    options = ["--strict", "--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(ROOT / ".mypy_cache")]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        said, errors, _ = mypy.api.run([*options, "--no-error-summary", *map(str, files)])
    assert errors == ""
    lines = [line for line in said.splitlines() if "error:" in line]
    found = [[line for line in lines if Path(line.split(":")[0]).name == file.name] for file in files]
    assert sum(map(len, found)) == len(lines), said
    return found
