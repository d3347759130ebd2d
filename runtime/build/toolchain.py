"""Compiles C++ text to shared libraries, in parallel, with a cache that all processes of a user share (build_cache).

Keys are made of the source text, the flags, the compiler's version, what `-march=native` means on this processor, the C
library and the environment variables that a compiler listens to.
"""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from yasps.runtime.build.cache import (
    CacheFolderError,
    cache_folder,
    digest_of,
    in_parallel,
    keep,
    keep_text,
    kept_text,
    safe_name,
    write_text,
)

RUNTIME = Path(__file__).parents[1]
"""The folder of the runtime, which the names in its #include lines count from."""

__all__ = [
    "DEFAULT_FLAGS",
    "CacheFolderError",
    "CompilationError",
    "CompiledObject",
    "Compiler",
    "CompilerNotFoundError",
    "LinkedLibrary",
    "Source",
    "cache_folder",
    "compile_sources",
    "find_compiler",
    "kept_text",
    "link",
]

#: Flags of every compile. No -ffast-math: NaN and infinity must survive, and sums keep their order.
DEFAULT_FLAGS = (
    "-O2",
    "-fPIC",
    "-march=native",
    "-std=c++17",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-ffp-contract=fast",
)

#: Further flags of g++ for generated code, long functions without branches that store what they compute once: searches
#: for stores that nobody reads, and for what a load may find, take time that grows with the square of their length.
STRAIGHT_LINE_FLAGS = ("-fno-dse", "-fno-tree-dse", "--param=sccvn-max-alias-queries-per-access=64")

#: Further flags of g++ for kernels of derivatives: without passes for jumps, repeated expressions and vectors made of
#: numbers, for which these, long and written in vectors, have next to no use. They save a fifth of a compile's time,
#: and cost point-triangle pairs over a UNION of free and affine vertices 4 % of theirs without projection; cloth
#: loses nothing that could be measured. Energies alone, loops over a few operations, would be 10 to 35 % slower.
DERIVATIVE_FLAGS = (
    "-fno-gcse",
    "-fno-tree-pre",
    "-fno-tree-pta",
    "-fno-tree-dominator-opts",
    "-fno-thread-jumps",
    "-fno-tree-loop-vectorize",
    "-fno-tree-slp-vectorize",
    "-fno-schedule-insns2",
    "-fira-region=one",
)

#: Environment variables by which compilers choose headers, libraries and their own parts.
_HEEDED = (
    "CPATH",
    "CPLUS_INCLUDE_PATH",
    "LIBRARY_PATH",
    "COMPILER_PATH",
    "GCC_EXEC_PREFIX",
    "SDKROOT",
    "MACOSX_DEPLOYMENT_TARGET",
)

_MESSAGE_LINES = 12

_VECTOR_MATH_PROBE = """\
typedef double pack __attribute__((vector_size(32)));
extern "C" pack _ZGVdN4v_log(pack);
extern "C" pack _ZGVdN4vv_atan2(pack, pack);  // with the youngest functions, of glibc 2.35
int main(int count, char**) {
    pack x = {1.0 * count, 1.0, 1.0, 1.0};
    pack y = _ZGVdN4v_log(x);
    pack z = _ZGVdN4vv_atan2(y, x);
    return y[0] == 0.0 && y[3] == 0.0 && z[0] == 0.0 ? 0 : 1;
}
"""

_OPENMP_PROBE = """\
#include <omp.h>
int main() {
    int sum = 0;
#pragma omp parallel num_threads(2) reduction(+ : sum)
    sum += 1;
    return sum >= 1 && omp_get_max_threads() >= 1 ? 0 : 1;
}
"""


class CompilerNotFoundError(RuntimeError):
    """No C++ compiler was found; the message says how to install one."""


class CompilationError(RuntimeError):
    """The C++ or CUDA compiler refused a source, or the linker a set of objects.

    Attributes: `module` the name of the source, `source` the file where its text was kept (None for a link), and
    `output` everything the compiler said.
    """

    def __init__(self, module: str, source: Path | None, output: str, language: str = "C++") -> None:
        """Keep what failed; the message shows the first lines of `output`."""
        self.module = module
        self.source = source
        self.output = output
        lines = output.strip().splitlines()
        shown = "\n  ".join(lines[:_MESSAGE_LINES]) or "(no message)"
        more = f"\n  ... and {len(lines) - _MESSAGE_LINES} more lines" if len(lines) > _MESSAGE_LINES else ""
        where = f" (its source is kept in {source})" if source is not None else ""
        super().__init__(f"the {language} module '{module}' did not compile{where}:\n  {shown}{more}")


@dataclass(frozen=True)
class Source:
    """One translation unit: `name` for messages and file names, `text` its complete source, `flags` what a C++ compiler
    is told beyond its own."""

    name: str
    text: str
    flags: tuple[str, ...] = ()


@dataclass(frozen=True)
class CompiledObject:
    """An object file. `seconds` is the time the compile took now: about 0 where `cached`."""

    name: str
    path: Path
    seconds: float
    cached: bool
    key: str


@dataclass(frozen=True)
class LinkedLibrary:
    """A shared library. `seconds` is the time the link took now: about 0 where `cached`."""

    path: Path
    seconds: float
    cached: bool


@dataclass(frozen=True)
class Compiler:
    """A C++ compiler with its flags.

    command: program and leading arguments (as in CXX="ccache g++").
    version: the first line of its `--version`.
    target: digest of the macros it predefines, which name every instruction set `-march=native` turns on, of the C
    library's version, and of the environment variables it heeds.
    has_vector_math: glibc's libmvec (`_ZGVdN4v_log` and its sisters) links and runs with `-lmvec -lm`.
    has_openmp: a program with `-fopenmp` compiles and runs.
    is_clang: it does not know all of g++'s flags.
    """

    command: tuple[str, ...]
    version: str
    target: str
    flags: tuple[str, ...]
    has_vector_math: bool
    has_openmp: bool
    is_clang: bool = False

    @property
    def path(self) -> Path:
        """The program itself."""
        return Path(self.command[0])

    def key(self) -> str:
        """A digest of all that decides what the compiler makes of a source."""
        return digest_of(*self.command, self.version, self.target, "flags", *self.flags)

    def with_flags(self, *flags: str) -> Compiler:
        """The same compiler with further flags."""
        return replace(self, flags=(*self.flags, *flags))

    def for_generated(self) -> Compiler:
        """The same compiler with what generated code asks for."""
        return self if self.is_clang else self.with_flags(*STRAIGHT_LINE_FLAGS)

    @property
    def derivative_flags(self) -> tuple[str, ...]:
        """What kernels of derivatives ask for besides."""
        return () if self.is_clang else DERIVATIVE_FLAGS


def find_compiler(flags: Sequence[str] = DEFAULT_FLAGS) -> Compiler:
    """Find the C++ compiler: YASPS_CXX, then CXX, then g++, c++ and clang++ on the PATH.

    Raises CompilerNotFoundError when there is none, or when the one that a variable names does not run.
    """
    command, origin = _find_command()
    version = _output_of([*command, "--version"], origin).splitlines()
    macros = _output_of([*command, *flags, "-x", "c++", "-dM", "-E", os.devnull], origin)
    heeded = [os.environ.get(name, "") for name in _HEEDED]
    target = digest_of(macros, *platform.libc_ver(), *heeded)
    compiler = Compiler(
        command, version[0] if version else "", target, tuple(flags), False, False, "__clang__" in macros
    )
    return replace(
        compiler,
        has_vector_math=_probe(compiler, "vector-math", _VECTOR_MATH_PROBE, ("-lmvec", "-lm")),
        has_openmp=_probe(compiler, "openmp", _OPENMP_PROBE, ("-fopenmp",)),
    )


def compile_sources(sources: Sequence[Source], compiler: Compiler, jobs: int | None = None) -> list[CompiledObject]:
    """Compile each source to an object file, `jobs` at a time (default: one per processor), or find it in the cache.

    The result has the order of `sources`. Raises CompilationError for the first source, in that order, that does not
    compile, and CacheFolderError when the cache cannot be written.
    """
    folder = cache_folder()
    compiler_key = compiler.key()
    tasks = [partial(_compile, source, compiler, compiler_key, folder) for source in sources]
    return in_parallel(tasks, jobs)


def link(objects: Sequence[CompiledObject], compiler: Compiler, extra_flags: Sequence[str] = ()) -> LinkedLibrary:
    """Link objects to a shared library, or find it in the cache.

    `extra_flags` follow the objects: libraries (`-lmvec`) and link options. Raises CompilationError when the linker
    fails, and CacheFolderError when the cache cannot be written.
    """
    folder = cache_folder()
    name = safe_name(objects[0].name if len(objects) == 1 else "library")
    key = digest_of(compiler.key(), "link", *extra_flags, "objects", *(item.key for item in objects))
    path = folder / f"{name}-{key[:32]}.so"
    start = time.perf_counter()

    def build(target: Path) -> None:
        inputs = [str(item.path) for item in objects]
        command = [*compiler.command, *compiler.flags, "-shared", "-o", str(target), *inputs, *extra_flags]
        failure = _failure_of(command)
        if failure is not None:
            raise CompilationError(", ".join(item.name for item in objects), None, failure)

    cached = keep(path, build)
    return LinkedLibrary(path, time.perf_counter() - start, cached)


def _compile(source: Source, compiler: Compiler, compiler_key: str, folder: Path) -> CompiledObject:
    key = digest_of(compiler_key, *source.flags, "source", source.text)
    stem = f"{safe_name(source.name)}-{key[:32]}"
    path = folder / f"{stem}.o"
    text_path = folder / f"{stem}.cpp"
    start = time.perf_counter()

    def build(target: Path) -> None:
        write_text(text_path, source.text)
        command = [*compiler.command, *compiler.flags, *source.flags, "-c", str(text_path), "-o", str(target)]
        failure = _failure_of(command)
        if failure is not None:
            raise CompilationError(source.name, text_path, failure)

    cached = keep(path, build)
    return CompiledObject(source.name, path, time.perf_counter() - start, cached, key)


def _find_command() -> tuple[tuple[str, ...], str]:
    """The compiler's command and where it was named."""
    for variable in ("YASPS_CXX", "CXX"):
        setting = os.environ.get(variable, "").strip()
        if not setting:
            continue
        words = shlex.split(setting)
        program = shutil.which(words[0])
        if program is None:
            raise CompilerNotFoundError(
                f"the environment variable {variable} names the C++ compiler '{setting}', but there is no program "
                f"'{words[0]}'. Set {variable} to an installed compiler or unset it.\n{_INSTALL_ADVICE}"
            )
        return (program, *words[1:]), f"the environment variable {variable}"
    for name in ("g++", "c++", "clang++"):
        program = shutil.which(name)
        if program is not None:
            return (program,), "the PATH"
    raise CompilerNotFoundError(
        "yasps compiles its kernels at run time and found no C++ compiler (looked for YASPS_CXX, CXX, then g++, c++ "
        f"and clang++ on the PATH).\n{_INSTALL_ADVICE}"
    )


_INSTALL_ADVICE = (
    "To install one: Debian/Ubuntu `apt-get install g++`, Fedora `dnf install gcc-c++`, macOS `xcode-select --install`."
)


def _output_of(command: Sequence[str], origin: str) -> str:
    try:
        result = subprocess.run(command, capture_output=True, text=True, check=False, errors="replace")
    except OSError as error:
        message = f"the C++ compiler {command[0]} (from {origin}) cannot be started: {error}.\n{_INSTALL_ADVICE}"
        raise CompilerNotFoundError(message) from error
    if result.returncode != 0:
        raise CompilerNotFoundError(
            f"the C++ compiler {command[0]} (from {origin}) does not work: `{shlex.join(command)}` failed with\n"
            f"  {result.stderr.strip() or result.stdout.strip()}\n{_INSTALL_ADVICE}"
        )
    return result.stdout


def _failure_of(command: Sequence[str]) -> str | None:
    """What the command said when it failed, else None."""
    try:
        result = subprocess.run(command, capture_output=True, text=True, check=False, errors="replace")
    except OSError as error:
        return f"{command[0]} cannot be started: {error}"
    if result.returncode == 0:
        return None
    return result.stderr or result.stdout or f"`{shlex.join(command)}` ended with exit code {result.returncode}"


def _probe(compiler: Compiler, name: str, program: str, flags: tuple[str, ...]) -> bool:
    """Whether the program compiles with the extra flags and ends with 0. The answer is kept in the cache."""
    key = digest_of(compiler.key(), program, *flags)

    def answer() -> str:
        with tempfile.TemporaryDirectory(prefix="yasps-probe-") as scratch:
            source = Path(scratch) / "probe.cpp"
            binary = Path(scratch) / "probe"
            source.write_text(program, encoding="utf-8")
            command = [*compiler.command, *compiler.flags, str(source), "-o", str(binary), *flags]
            works = _failure_of(command) is None and _failure_of([str(binary)]) is None
        return "yes\n" if works else "no\n"

    return keep_text(cache_folder() / f"probe-{name}-{key[:32]}.txt", answer) == "yes\n"
