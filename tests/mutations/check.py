"""Makes one mistake at a time in a copy of the project and says which test sees it.

    python tests/mutations/check.py [--workers N] [--only PATTERN] [AREA ...]

Run by hand and nightly (`pytest -m nightly tests/mutations`). The tests that the table names must pass before anything
is broken. Every worker has a copy of the working tree; compiled code is shared by all of them and by all mutations,
because it is kept by content: a mutation compiles what it changes. YASPS_TEST_CACHE names a folder for it that shall
outlast the run. Tests run in processes forked from one that has imported other people's packages and nothing of ours.
The exit status is 0 only if every mutation could be made and was seen.
"""

from __future__ import annotations

import argparse
import compileall
import multiprocessing
import os
import py_compile
import queue
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from mutation import Mutation

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (
    "yasps",
    "dialects",
    "passes",
    "frontend",
    "backend",
    "runtime",
    "examples",
    "benchmarks",
    "tests",
    "pyproject.toml",
)
PRELOADED = ["numpy", "scipy.sparse", "pytest", "xdsl.dialects.arith", "xdsl.dialects.func", "ipctk"]
MOST_SECONDS = 900
ELSEWHERE = 99
"""Exit status of a test process that would have tested something else than the copy."""


def run_tests(folder: str, environment: dict[str, str], arguments: list[str], log: str) -> None:
    """What a forked process does: runs pytest in the copy and exits with its status; output goes to the file `log`."""
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    # A changed source counts at once, however soon it was changed: see compileall below.
    sys.dont_write_bytecode = True
    sys.path[:] = [folder, *(entry for entry in sys.path if not Path(entry, "yasps").is_dir())]
    with open(log, "wb", buffering=0) as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    import pytest

    import yasps

    if not Path(yasps.__file__).is_relative_to(folder):
        print(f"Python imports yasps from {yasps.__file__}, not from the copy")
        sys.exit(ELSEWHERE)
    sys.exit(int(pytest.main(arguments)))


@dataclass(frozen=True)
class Run:
    """How a process of tests ended: pytest's status, or minus a signal; None if it had to be stopped."""

    status: int | None
    output: str

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the tests that failed. Status 1 means that a test did; what ends otherwise has seen nothing, but for
        a crash: kernels that read out of bounds."""
        if self.status is not None and self.status < 0:
            return (f"a crash by signal {-self.status}",)
        if self.status != 1:
            return ()
        return tuple(dict.fromkeys(re.findall(r"^(?:FAILED|ERROR) \S+?::(\w+)", self.output, re.MULTILINE)))

    @property
    def last_line(self) -> str:
        if self.status is None:
            return f"stopped after {MOST_SECONDS} s"
        return (self.output.strip().splitlines() or [f"status {self.status}"])[-1]


@dataclass(frozen=True)
class Answer:
    """What came of a mutation. seen_by: tests that failed, empty if none; otherwise `said` tells how it went."""

    mutation: Mutation
    seen_by: tuple[str, ...]
    said: str
    seconds: float


class Copy:
    """A copy of the working tree in which tests are run."""

    def __init__(self, folder: Path, cache: Path) -> None:
        self.folder = folder.resolve()
        # What would lead Python elsewhere (PYTHONPATH), or pytest to other options, does not count here.
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "PYTEST", "YASPS", "COVERAGE"))}
        self.environment = {
            **kept,
            "PYTHONPATH": str(self.folder),  # for processes that tests start
            "PYTHONDONTWRITEBYTECODE": "1",
            "YASPS_HYPOTHESIS_PROFILE": "mutation",
            "YASPS_TEST_CACHE": str(cache),
        }
        for name in FOLDERS:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, folder / name)
        compileall.compile_dir(folder, quiet=1, invalidation_mode=py_compile.PycInvalidationMode.CHECKED_HASH)

    def test(self, tests: Sequence[str], *options: str) -> Run:
        """Runs these tests here."""
        arguments = ["-rf", "-p", "no:cacheprovider", "--tb=line", *options, *tests]
        with tempfile.NamedTemporaryFile(dir=self.folder) as log:
            process = FORKS.Process(
                target=run_tests, args=(str(self.folder), self.environment, arguments, log.name), daemon=False
            )
            process.start()
            process.join(MOST_SECONDS)
            if process.exitcode is None:
                process.kill()
                process.join()
                return Run(None, "")
            return Run(process.exitcode, Path(log.name).read_text(encoding="utf-8", errors="replace"))

    def try_out(self, mutation: Mutation) -> Answer:
        """Makes the mistake, runs its tests and takes it back."""
        start = time.perf_counter()
        path = self.folder / mutation.file
        text = path.read_text(encoding="utf-8")
        if text.count(mutation.right) != 1:
            return Answer(mutation, (), f"not made: the text occurs {text.count(mutation.right)} times", 0.0)
        path.write_text(text.replace(mutation.right, mutation.wrong), encoding="utf-8")
        try:
            run = self.test(mutation.tests, "-x")
        finally:
            path.write_text(text, encoding="utf-8")
        return Answer(mutation, run.failed, run.last_line, time.perf_counter() - start)


FORKS = multiprocessing.get_context("forkserver")


def check(mutations: Sequence[Mutation], workers: int) -> int:
    """Tries them all and prints a table; returns how many were not seen."""
    unseen = 0
    with tempfile.TemporaryDirectory(prefix="yasps-mutations-") as temporary:
        cache = Path(os.environ.get("YASPS_TEST_CACHE", Path(temporary) / "compiled-code"))
        copies: queue.SimpleQueue[Copy] = queue.SimpleQueue()
        for k in range(workers):
            copies.put(Copy(Path(temporary) / f"copy{k}", cache))
        start = time.perf_counter()
        first = copies.get()
        unbroken = first.test(sorted({test for mutation in mutations for test in mutation.tests}))
        copies.put(first)
        if unbroken.status != 0:
            print(unbroken.output[-4000:], "the tests fail before anything is broken", sep="\n")
            return len(mutations)
        print(f"before anything is broken: {unbroken.last_line}\n", flush=True)

        def try_out(mutation: Mutation) -> Answer:
            copy = copies.get()
            try:
                return copy.try_out(mutation)
            finally:
                copies.put(copy)

        print("| mutation | seen by | seconds |\n|---|---|---:|", flush=True)
        with ThreadPoolExecutor(workers) as pool:
            for future in as_completed([pool.submit(try_out, mutation) for mutation in mutations]):
                answer = future.result()
                unseen += not answer.seen_by
                seen_by = ", ".join(answer.seen_by) or f"**nobody** ({answer.said})"
                print(f"| {answer.mutation.title} | {seen_by} | {answer.seconds:.0f} |", flush=True)
        print(f"\n{len(mutations) - unseen} of {len(mutations)} seen, {time.perf_counter() - start:.0f} s")
    return unseen


def main() -> int:
    from tables import AREAS  # here: forked processes import this file, and need no tables

    FORKS.set_forkserver_preload(PRELOADED)
    parser = argparse.ArgumentParser(description="Breaks the code in one place at a time and says which test sees it.")
    parser.add_argument("areas", nargs="*", metavar="AREA", help=f"of {', '.join(AREAS)}; all if none is named")
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1), help="tests run at once")
    parser.add_argument("--only", default="", metavar="PATTERN", help="mutations with this in their title")
    given = parser.parse_args()
    unknown = sorted(set(given.areas) - set(AREAS))
    if unknown:
        parser.error(f"there is no area {', '.join(unknown)}; there are {', '.join(AREAS)}")
    chosen = [
        mutation
        for area in given.areas or AREAS
        for mutation in AREAS[area]
        if re.search(given.only, mutation.title, re.IGNORECASE)
    ]
    if not chosen:
        parser.error("no mutation was chosen")
    return 1 if check(chosen, given.workers) else 0


if __name__ == "__main__":
    sys.exit(main())
