"""Lines of code of the scenes of the paper's sections 9.1 to 9.3, by part, and what each adds to the one before."""

from __future__ import annotations

import ast
import difflib
import io
import re
import tokenize
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from benchmarks.measure import Report, Row, Settings
from benchmarks.plots import Bars

DESCRIPTION = "the paper's figure 19: lines of code of 9.1 to 9.3, with the kit and by hand, and what each adds"
EXAMPLES: Final = Path(__file__).parent.parent / "examples"
SCENES: Final[Mapping[str, str]] = MappingProxyType(
    {"9.1": "cloths_on_bunny", "9.2": "many_bunnies_on_cloth", "9.3": "caged_bunny"}
)
PAPER: Final[Mapping[str, int]] = MappingProxyType({"9.2": 130, "9.3": 140})
"""Lines that the paper says a scene adds (captions of figures 1 and 19, section 9.3)."""
PARTS: Final = ("setup", "integration", "energy definition", "collision", "initialisation", "newton iteration")
"""Those of the paper (10.1)."""
OTHER_PART: Final = "program"
"""Flags, results and checks: the paper's scenes have none of them but for pictures, which it leaves out, too."""
NOTES = (
    "a line of code has something on it that is no comment and no docstring. Parts begin at comments '# --- Name ---';"
    " imports and constants are setup.",
    "added: with the kit, lines that a diff with the scene before finds (indentation and comments aside), changed"
    " numbers included; by hand, all lines of the scene's own file, which imports what went before as it is.",
    f"'{OTHER_PART}' (flags, checks, results) is in no sum, and neither is bunnies_and_cloth.py, which all share:"
    " reading and placing the mesh, checks. By hand, numbers come from the scene with the kit.",
    "by hand is taken from the kit: meshes (yasps.meshes), CollisionGeometry for close pairs and step bounds (the paper"
    " has both from elsewhere); FrameRecorder and SceneProgram for results and flags.",
)


class CodeLine(NamedTuple):
    """A line of code and the part that it is in."""

    part: str
    text: str
    """Without indentation and comment."""


def code_lines(source: str) -> list[CodeLine]:
    """The lines of code of a module, in their order. Raises ValueError for a part that there is not."""
    has_code = set()
    marks: dict[int, str] = {}
    comments: dict[int, int] = {}
    skipped = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in skipped:
            has_code.update(range(token.start[0], token.end[0] + 1))
        elif token.type == tokenize.COMMENT:
            row, column = token.start
            comments[row] = column
            if found := re.fullmatch(r"# --- (.+) ---", token.string):
                marks[row] = found[1].lower()
                if marks[row] not in (*PARTS, OTHER_PART):
                    raise ValueError(f"line {row}: there is no part {found[1]!r}")
    has_code -= _docstring_lines(source)
    lines, part = [], PARTS[0]
    for number, text in enumerate(source.splitlines(), start=1):
        part = marks.get(number, part)
        if number in has_code:
            lines.append(CodeLine(part, text[: comments.get(number)].strip()))
    return lines


def _docstring_lines(source: str) -> set[int]:
    lines: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            lines.update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return lines


def by_part(lines: list[CodeLine]) -> Counter[str]:
    """How many lines are in each part."""
    return Counter(line.part for line in lines)


def added(before: list[CodeLine], after: list[CodeLine]) -> list[CodeLine]:
    """Lines of `after` that are new or changed."""
    texts = [[line.text for line in lines] for lines in (before, after)]
    matcher = difflib.SequenceMatcher(None, *texts, autojunk=False)
    return [line for tag, _, _, i, j in matcher.get_opcodes() if tag in ("insert", "replace") for line in after[i:j]]


def scene_lines(scene: str, *, by_hand: bool) -> list[CodeLine]:
    """Of a scene of the paper, "9.1" to "9.3"."""
    file = EXAMPLES / f"{SCENES[scene]}{'_by_hand' if by_hand else ''}.py"
    return code_lines(file.read_text(encoding="utf-8"))


def added_lines(scene: str, *, by_hand: bool) -> list[CodeLine]:
    """What a scene adds to the one before, in the parts of the paper."""
    lines = scene_lines(scene, by_hand=by_hand)
    if not by_hand:
        names = list(SCENES)
        lines = added(scene_lines(names[names.index(scene) - 1], by_hand=False), lines)
    return [line for line in lines if line.part in PARTS]


def run(settings: Settings) -> Report:
    """Counts the lines; nothing is timed."""
    del settings
    rows = []
    for by_hand in (False, True):
        which = "by hand" if by_hand else "with the kit"
        for scene in SCENES:
            counts = by_part(scene_lines(scene, by_hand=by_hand))
            rows += [Row(f"{scene}, {part}", which, 1, float(counts[part]), "lines") for part in (*PARTS, OTHER_PART)]
            if scene in PAPER:
                new = float(len(added_lines(scene, by_hand=by_hand)))
                rows.append(Row(f"{scene}, added", which, 1, new, "lines"))
    rows += [Row(f"{scene}, added", "the paper", 1, float(count), "lines") for scene, count in PAPER.items()]
    value = {(row.case, row.implementation): row.value for row in rows}
    ways = [(scene, which) for which in ("with the kit", "by hand") for scene in SCENES]
    parts = {part: [value[f"{scene}, {part}", which] for scene, which in ways] for part in PARTS}
    labels = [f"{scene} {which}" for scene, which in ways]
    plot = Bars("figure_19", "Lines of code; by hand, of the scene's own file", "lines", labels, parts, stacked=True)
    return Report(rows, list(NOTES), [plot])
