"""The command `yasps`: run or explain an example or a script, show what it left, list the examples, describe the
machine."""

import argparse
import ast
import difflib
import importlib
import os
import pkgutil
import runpy
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from yasps.frontend.commands import results
from yasps.frontend.commands.environment_report import environment_report, package_version
from yasps.frontend.errors import YaspsError
from yasps.runtime.build.cuda.nvcc import CudaNotFoundError
from yasps.runtime.build.toolchain import CacheFolderError, CompilerNotFoundError
from yasps.runtime.device.driver import NoDeviceError

FAILED: Final = 1
INTERRUPTED: Final = 130  # 128 + SIGINT, as shells report it
EXAMPLES_PACKAGE: Final = "yasps.examples"


class CommandLineError(YaspsError):
    """What was asked to run does not exist."""


@dataclass(frozen=True)
class Example:
    """A runnable module of the package of examples."""

    name: str
    summary: str
    picture: Path | None
    """Of what it shows."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line and returns its exit status.

    Args:
        arguments: without the program's name; `sys.argv[1:]` if None.

    Returns:
        0, what an example's `main` returned, 1 after an error of the user's (a `YaspsError`: one message on
        stderr, the traceback only with YASPS_TRACEBACK=1), or 130 after Ctrl-C.

    Raises:
        SystemExit: from argparse (wrong usage: 2; `--help`, `--version`: 0) or from the script that is run.
    """
    chosen = _parser().parse_args(arguments)
    try:
        if chosen.command == "run":
            return run(chosen.target, chosen.arguments)
        if chosen.command == "explain":
            _explain(chosen.target, chosen.arguments)
        elif chosen.command == "info":
            _print_aligned(environment_report())
        elif chosen.command in results.COMMANDS:
            results.run(chosen)
        else:
            _print_aligned({example.name: _told(example) for example in find_examples().values()})
    except (YaspsError, CompilerNotFoundError, CacheFolderError, CudaNotFoundError, NoDeviceError) as error:
        if os.environ.get("YASPS_TRACEBACK") == "1":
            traceback.print_exc()
        print(f"yasps: error: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("yasps: interrupted", file=sys.stderr)
        return INTERRUPTED
    return 0


def run(target: str, arguments: Sequence[str]) -> int:
    """Runs a `.py` file as `python FILE` would, or an example by its name.

    Raises:
        CommandLineError: there is no such file or example.
    """
    if target.endswith(".py") or os.sep in target:
        return _run_file(Path(target), arguments)
    examples = find_examples()
    name = target.replace("-", "_")
    if name not in examples:
        raise CommandLineError(_unknown_example(target, examples))
    module = importlib.import_module(f"{EXAMPLES_PACKAGE}.{name}")
    return int(module.main(list(arguments)) or 0)


def _explain(target: str, arguments: Sequence[str]) -> None:
    from yasps.frontend.commands.explain import explain_first_scene  # the compiler, which the other commands don't need

    text = explain_first_scene(lambda: run(target, arguments))
    if text is None:
        raise CommandLineError(
            f"'{target}' ended without a scene with an energy to explain: it must ask for something that is compiled, "
            "such as minimize_energy(), gradient() or hessian()."
        )
    print(text)


def find_examples() -> dict[str, Example]:
    """The examples by name, sorted; those are the modules that define `main`. Their source is read, not
    run."""
    package = importlib.import_module(EXAMPLES_PACKAGE)
    examples = {}
    for module in sorted(pkgutil.iter_modules(package.__path__), key=lambda module: module.name):
        spec = module.module_finder.find_spec(module.name, None)
        if module.ispkg or spec is None or spec.origin is None:
            continue
        tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"), filename=spec.origin)
        if any(isinstance(node, ast.FunctionDef) and node.name == "main" for node in tree.body):
            summary = (ast.get_docstring(tree) or "").partition("\n")[0]
            picture = Path(spec.origin).parent / "pictures" / f"{module.name}.jpg"
            examples[module.name] = Example(module.name, summary, picture if picture.is_file() else None)
    return examples


def _told(example: Example) -> str:
    """Its line, and where its picture is."""
    return example.summary if example.picture is None else f"{example.summary}\n{example.picture}"


def _run_file(file: Path, arguments: Sequence[str]) -> int:
    if not file.is_file():
        raise CommandLineError(f"There is no file '{file}' (looked from '{Path.cwd()}').")
    with _as_script(file, arguments):
        runpy.run_path(str(file), run_name="__main__")
    return 0


@contextmanager
def _as_script(file: Path, arguments: Sequence[str]) -> Iterator[None]:
    """`sys.argv` and `sys.path` as `python FILE ARGUMENTS` would set them, for the time of the block."""
    argv, path = sys.argv, sys.path
    sys.argv = [str(file), *arguments]
    sys.path = [str(file.resolve().parent), *path]
    try:
        yield
    finally:
        sys.argv, sys.path = argv, path


def _unknown_example(target: str, examples: Mapping[str, Example]) -> str:
    message = f"There is no example '{target}'."
    if close := difflib.get_close_matches(target.replace("-", "_"), examples, n=1):
        message += f" Did you mean '{close[0]}'?"
    known = ", ".join(examples) or "none in this installation"
    return f"{message} Examples: {known}. A script of your own is named by its path, ending in '.py'."


def _print_aligned(lines: Mapping[str, str]) -> None:
    width = max(map(len, lines), default=0)
    for name, text in lines.items():
        first, *rest = text.split("\n")
        print(f"{name:{width}}  {first}".rstrip())
        for line in rest:
            print(f"{'':{width}}  {line}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="yasps", description="yasps: a compiler for physical simulation.")
    parser.add_argument("--version", action="version", version=f"yasps {package_version('yasps')}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    runner = commands.add_parser("run", help="run an example by name, or a Python file")
    runner.add_argument("target", metavar="FILE|EXAMPLE", help="a path ending in .py, or a name from `yasps examples`")
    runner.add_argument("arguments", nargs=argparse.REMAINDER, metavar="...", help="given on to what is run")
    teller = commands.add_parser("explain", help="say what the compiler makes of each energy of an example or a file")
    teller.add_argument("target", metavar="FILE|EXAMPLE", help="as for run; it ends at its first scene with energies")
    teller.add_argument("arguments", nargs=argparse.REMAINDER, metavar="...", help="given on to what is run")
    results.add_parsers(commands)
    commands.add_parser("examples", help="list the examples, a line each, and where their pictures are")
    commands.add_parser("info", help="describe this machine and installation, for bug reports")
    return parser


if __name__ == "__main__":
    sys.exit(main())
