"""FileCheck tests: `.mlir` files whose RUN line names passes and whose CHECK lines say what comes out.

Run in this process: starting `yasps-opt` and `filecheck` for each file would take seconds.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
from pathlib import Path

import pytest
from filecheck.finput import FInput
from filecheck.matcher import Matcher
from filecheck.options import parse_argv_options
from filecheck.parser import Parser

from yasps.passes.yasps_opt import main

FILES = sorted((Path(__file__).parent / "filecheck").glob("*.mlir"))
RUN = re.compile(r"//\s*RUN:\s*yasps-opt (?P<opt>.*?) \| filecheck %s(?P<check>.*)$", re.MULTILINE)


def check(path: Path) -> tuple[int, str]:
    """FileCheck's exit code and what it says, for the file's RUN line."""
    match = RUN.search(path.read_text(encoding="utf-8"))
    assert match is not None, f"{path} has no line `// RUN: yasps-opt ... | filecheck %s`"
    arguments = [word.replace("%s", str(path)) for word in shlex.split(match["opt"])]
    output, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output):
        main(arguments)
    options = parse_argv_options(["filecheck", str(path), *shlex.split(match["check"])])
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        code = Matcher(options, FInput("-", output.getvalue()), Parser.from_opts(options)).run()
    return code, said.getvalue() + "\n" + output.getvalue()


def test_there_are_files() -> None:
    assert len(FILES) >= 5


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_file(path: Path) -> None:
    code, said = check(path)
    assert code == 0, said


def test_a_wrong_check_fails(tmp_path: Path) -> None:
    """The harness itself."""
    path = tmp_path / "wrong.mlir"
    path.write_text("// RUN: yasps-opt %s | filecheck %s\nbuiltin.module {}\n// CHECK: not there\n", encoding="utf-8")
    code, _ = check(path)
    assert code == 1
