"""Makes one mistake at a time in a copy of the project and says which test sees it.

    python tests/mutations/check.py [--workers N] [--only WORDS] [AREA ...]

Run by hand and nightly (`pytest -m nightly tests/mutations`). The tests that the table names must pass before anything
is broken. Every worker has a copy of the working tree; compiled code is shared by all of them and by all mutations,
because it is kept by content: a mutation compiles what it changes. The exit status is 0 only if every mutation could be
made and was seen.
"""

from __future__ import annotations

import argparse
import compileall
import os
import py_compile
import queue
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from mutation import Mutation
from tables import AREAS

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("yasps", "dialects", "passes", "frontend", "backend", "runtime", "examples", "tests", "pyproject.toml")
PACKAGES = ("dialects", "passes", "frontend", "backend", "runtime")
MOST_SECONDS = 600


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
        self.folder = folder
        # What would lead Python elsewhere (PYTHONPATH), or pytest to other options, does not count here.
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "PYTEST", "YASPS", "COVERAGE"))}
        self.environment = {
            **kept,
            "PYTHONPATH": str(folder),
            # A byte code file is not valid for a changed source, however soon it was changed: see compileall below.
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
        self._require_imports_from_here()

    def _require_imports_from_here(self) -> None:
        names = ", ".join(f"yasps.{name}" for name in PACKAGES)
        code = f"import yasps, {names}\nfor m in (yasps, {names}): print(m.__file__)"
        done = self._run([sys.executable, "-c", code])
        files = [Path(line).resolve() for line in done.stdout.split()]
        if len(files) != 1 + len(PACKAGES) or not all(file.is_relative_to(self.folder.resolve()) for file in files):
            raise RuntimeError(
                f"Python does not import yasps from the copy in {self.folder}: {done.stdout}{done.stderr}"
            )

    def _run(self, command: Sequence[str]) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            command,
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=MOST_SECONDS,
            check=False,
        )

    def test(self, tests: Sequence[str], *options: str) -> subprocess.CompletedProcess[str]:
        """Runs these tests here."""
        fixed = ["-rf", "-p", "no:cacheprovider", "--tb=line"]
        return self._run([sys.executable, "-m", "pytest", *fixed, *options, *tests])

    def try_out(self, mutation: Mutation) -> Answer:
        """Makes the mistake, runs its tests and takes it back."""
        start = time.perf_counter()
        path = self.folder / mutation.file
        text = path.read_text(encoding="utf-8")
        if text.count(mutation.right) != 1:
            return Answer(mutation, (), f"not made: the text occurs {text.count(mutation.right)} times", 0.0)
        path.write_text(text.replace(mutation.right, mutation.wrong), encoding="utf-8")
        seen_by: tuple[str, ...] = ()
        try:
            done = self.test(mutation.tests, "-x")
        except subprocess.TimeoutExpired:
            said = f"the tests did not end in {MOST_SECONDS} s"
        else:
            seen_by = failed_tests(done)
            said = last_line(done)
        finally:
            path.write_text(text, encoding="utf-8")
        return Answer(mutation, seen_by, said, time.perf_counter() - start)


def failed_tests(done: subprocess.CompletedProcess[str]) -> tuple[str, ...]:
    """Names of the tests that failed. pytest's status is 1 only if a test did: what ends otherwise was not seen."""
    if done.returncode < 0:  # kernels that read out of bounds
        return (f"a crash by signal {-done.returncode}",)
    if done.returncode != 1:
        return ()
    return tuple(dict.fromkeys(re.findall(r"^(?:FAILED|ERROR) \S+?::(\w+)", done.stdout, re.MULTILINE)))


def last_line(done: subprocess.CompletedProcess[str]) -> str:
    lines = done.stdout.strip().splitlines()
    return lines[-1] if lines else done.stderr[-300:]


def check(mutations: Sequence[Mutation], workers: int) -> int:
    """Tries them all and prints a table; returns how many were not seen."""
    unseen = 0
    with tempfile.TemporaryDirectory(prefix="yasps-mutations-") as temporary:
        cache = Path(temporary) / "compiled-code"
        copies: queue.SimpleQueue[Copy] = queue.SimpleQueue()
        for k in range(workers):
            copies.put(Copy(Path(temporary) / f"copy{k}", cache))
        start = time.perf_counter()
        first = copies.get()
        done = first.test(sorted({test for mutation in mutations for test in mutation.tests}))
        copies.put(first)
        if done.returncode != 0:
            print(done.stdout[-3000:], done.stderr[-1000:], "the tests fail before anything is broken", sep="\n")
            return len(mutations)
        print(f"{last_line(done)} before anything is broken: {time.perf_counter() - start:.0f} s\n", flush=True)

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
    parser = argparse.ArgumentParser(description="Breaks the code in one place at a time and says which test sees it.")
    parser.add_argument("areas", nargs="*", metavar="AREA", help=f"of {', '.join(AREAS)}; all if none is named")
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1), help="tests run at once")
    parser.add_argument("--only", default="", metavar="WORDS", help="mutations with this in their title")
    given = parser.parse_args()
    unknown = sorted(set(given.areas) - set(AREAS))
    if unknown:
        parser.error(f"there is no area {', '.join(unknown)}; there are {', '.join(AREAS)}")
    chosen = [
        mutation
        for area in given.areas or AREAS
        for mutation in AREAS[area]
        if given.only.lower() in mutation.title.lower()
    ]
    if not chosen:
        parser.error("no mutation was chosen")
    return 1 if check(chosen, given.workers) else 0


if __name__ == "__main__":
    sys.exit(main())
