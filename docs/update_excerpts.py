"""Writes what documents show of the compiler anew: `python docs/update_excerpts.py`.

In docs/language.md these are the lines of the functions in `dialects/scalar/functions.py`, in docs/architecture.md
excerpts from a fresh dump. Which lines are shown is what the document says now: each line of an excerpt is looked for
in the dumped file, best as it stands, else with other value numbers, else as the most similar line, in the order of
the excerpt; `...` goes where lines have come between. What `yasps-opt` prints is replaced as a whole. A line of which
nothing is left is an error and nothing is written: edit that excerpt by hand. Look at `git diff` afterwards, numbers
in the prose included.
"""

from __future__ import annotations

import contextlib
import difflib
import io
import re
import sys
import tempfile
from pathlib import Path

import numpy as np

from yasps.dialects.scalar.functions import FUNCTIONS
from yasps.frontend.commands import yasps_opt

DOCUMENT = Path(__file__).with_name("architecture.md")
LANGUAGE = Path(__file__).with_name("language.md")
HASH = re.compile(r"yasps_([0-9a-f]{20}|[A-Z])_")
EXCERPT = re.compile(r"^```(mlir|cpp)\n// (\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"^\$ yasps-opt (.*)\n((?:energy .*\n)+)", re.MULTILINE)
LEAST_SIMILAR = 0.7
"""Of `difflib`, in [0, 1]: below, two lines are not the same line changed."""


class ExcerptError(Exception):
    """A line of the document has no counterpart in the dump."""


def with_functions(text: str) -> str:
    """docs/language.md with a line for each function of the table, between those of `mat.pow` and `mat.hypot`."""
    start = text.index("\n", text.index("| `mat.pow` |")) + 1
    end = text.index("| `mat.hypot` |")
    lines = []
    for function in FUNCTIONS:
        low, high = function.domain
        inside = "" if low == -np.inf else f", of [{low:g}, {high:g}]" if high < np.inf else f", a >= {low:g}"
        lines.append(f"| `mat.{function.name}` | `a.{function.name}()` | any{inside} | {function.tangent} |\n")
    return text[:start] + "".join(lines) + text[end:]


def dump_example(text: str, folder: Path) -> Path:
    """Runs the document's only Python block in a folder; returns the folder of the dump."""
    (code,) = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    with contextlib.chdir(folder):
        exec(compile(code, "architecture.md", "exec"), {"__name__": "architecture"})
    return folder / "dump"


def updated(text: str, dump: Path) -> str:
    """The document with the excerpts of this dump. Raises ExcerptError."""

    def excerpt(match: re.Match[str]) -> str:
        language, file, shown = match.groups()
        real = (dump / file).read_text(encoding="utf-8").splitlines()
        lines = updated_lines(file, shown.splitlines(), real)
        return "\n".join([f"```{language}", f"// {file}", *lines, "```"])

    def command(match: re.Match[str]) -> str:
        arguments = match.group(1)
        said = io.StringIO()
        with contextlib.chdir(dump.parent), contextlib.redirect_stdout(said):
            if yasps_opt.main(arguments.split()) != 0:
                raise ExcerptError(f"yasps-opt {arguments} failed")
        return f"$ yasps-opt {arguments}\n{said.getvalue()}"

    return COMMAND.sub(command, EXCERPT.sub(excerpt, text))


def updated_lines(file: str, shown: list[str], real: list[str]) -> list[str]:
    """The lines of one excerpt as the dumped file has them now."""
    kept = [line for line in shown if line.strip() != "..."]
    places = _places(file, shown, real)
    letters: dict[str, str] = {}
    for line, place in zip(kept, places, strict=True):
        ours, theirs = HASH.findall(line), HASH.findall(real[place])
        if len(ours) == len(theirs):
            letters.update(zip(theirs, ours, strict=True))
    out: list[str] = []
    last, rest = None, iter(places)
    for line in shown:
        if line.strip() == "...":
            out.append(line)
            continue
        place = next(rest)
        indent = line[: len(line) - len(line.lstrip())]
        if last is not None and place != last + 1 and out[-1].strip() != "...":
            out.append(f"{indent}...")
        out.append(indent + _with_letters(_cut_as(line, real[place]), letters, file))
        last = place
    return out


def _with_letters(line: str, letters: dict[str, str], file: str) -> str:
    """Hashes as the letters that stand for them in the document."""

    def letter(match: re.Match[str]) -> str:
        if match.group(1) not in letters:
            raise ExcerptError(f"{file} calls another object now, give it a letter by hand: {line}")
        return f"yasps_{letters[match.group(1)]}_"

    return HASH.sub(letter, line)


def _cut_as(shown: str, real: str) -> str:
    """The real line, cut after as many words as the shown one if that ends with `...`."""
    real = real.strip()
    if not shown.endswith(" ..."):
        return real
    return " ".join([*real.split()[: len(shown.split()) - 1], "..."])


def _without_numbers(line: str) -> str:
    """A line without the numbers of its values: %44, t6, x0."""
    return re.sub(r"%\w+", "%", re.sub(r"\b([a-z])\d+\b", r"\1", line))


def _costs(shown: str, real: list[str]) -> list[float]:
    """How unlike each real line is to the shown one; infinite if it can't be the same."""
    wanted = HASH.sub("yasps_X_", shown.strip())
    matcher = difflib.SequenceMatcher(autojunk=False)
    matcher.set_seq2(wanted)
    found = []
    for line in real:
        candidate = HASH.sub("yasps_X_", _cut_as(shown, line))
        matcher.set_seq1(candidate)
        if candidate == wanted:
            found.append(0.0)
        elif _without_numbers(candidate) == _without_numbers(wanted):
            found.append(1.0)
        elif matcher.quick_ratio() >= LEAST_SIMILAR and matcher.ratio() >= LEAST_SIMILAR:
            found.append(2.0 + 10.0 * (1.0 - matcher.ratio()))
        else:
            found.append(np.inf)
    return found


def _places(file: str, shown: list[str], real: list[str]) -> list[int]:
    """For each shown line the real one it stands for: least unlike in all, in order, adjacent where there is no `...`.

    By dynamic programming over the shown lines; of equally good places the first.
    """
    total = np.zeros(len(real) + 1)  # [j]: the best for the lines so far, all of them before real line j
    choices: list[np.ndarray[tuple[int], np.dtype[np.intp]]] = []
    anywhere = True
    ends = np.full(len(real), np.inf)  # [j]: the best for the lines so far, the last of them at real line j
    for line in shown:
        if line.strip() == "...":
            anywhere = True
            continue
        costs = np.array(_costs(line, real))
        if np.isinf(costs).all():
            raise ExcerptError(f"{file} has nothing like this line any more: {line.strip()}")
        before = total[:-1] + (0.0 if anywhere else 1.0)
        earlier = np.array([int(np.argmin(ends[:j])) if j else -1 for j in range(len(real))], np.intp)
        if not anywhere:
            adjacent = np.concatenate([[np.inf], ends[:-1]])
            earlier = np.where(adjacent <= before, np.arange(len(real)) - 1, earlier)
            before = np.minimum(before, adjacent)
        choices.append(earlier)
        ends = costs + before
        total = np.concatenate([[np.inf], np.minimum.accumulate(ends)])
        anywhere = False
    if not np.isfinite(ends).any():
        raise ExcerptError(f"{file} has the lines of its excerpt, but no longer in this order")
    places = [int(np.argmin(ends))]
    for earlier in reversed(choices[1:]):
        places.append(int(earlier[places[-1]]))
    return places[::-1]


def main() -> int:
    """Rewrites the documents; returns the exit status."""
    LANGUAGE.write_text(with_functions(LANGUAGE.read_text(encoding="utf-8")), encoding="utf-8")
    text = DOCUMENT.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        try:
            new = updated(text, dump_example(text, Path(folder)))
        except ExcerptError as error:
            print(f"update_excerpts: {error}", file=sys.stderr)
            return 1
    DOCUMENT.write_text(new, encoding="utf-8")
    print(f"{DOCUMENT.name}: {'excerpts are up to date' if new == text else 'excerpts changed, look at git diff'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
