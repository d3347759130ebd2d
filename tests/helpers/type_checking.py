"""What mypy says of a user's script."""

from __future__ import annotations

from pathlib import Path

import mypy.api
import pytest

ROOT = Path(__file__).parents[2]


def problems(script: str, folder: Path) -> list[str]:
    """The errors in strict mode, a line each; the script is written into the folder.

    The cache is that of `mypy` in the checkout, which CI has filled by then; from an empty one it takes a minute.
    """
    file = folder / "script.py"
    file.write_text(script, encoding="utf-8")
    options = ["--strict", "--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(ROOT / ".mypy_cache")]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        said, errors, _ = mypy.api.run([*options, "--no-error-summary", str(file)])
    assert errors == ""
    return [line for line in said.splitlines() if "error:" in line]
