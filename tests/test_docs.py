"""The documents are true: code blocks run, dumps are those of today, every operation and option is described."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from xdsl.parser import Parser

from yasps.dialects.mat import OPERATIONS
from yasps.examples import two_bunnies
from yasps.frontend import errors, yasps_opt
from yasps.passes.pipeline import PIPELINE, make_context

ROOT = Path(__file__).parents[1]
ARCHITECTURE = ROOT / "docs" / "architecture.md"
LANGUAGE = ROOT / "docs" / "language.md"
STEPPING = ROOT / "docs" / "contact-and-stepping.md"
README = ROOT / "README.md"


def blocks(document: Path, language: str) -> list[str]:
    """Texts of a document's fenced blocks of one language that start a line."""
    text = document.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def run(code: str, name: str) -> None:
    exec(compile(code, name, "exec"), {"__name__": name})


@pytest.fixture(scope="module")
def dump(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the example of docs/architecture.md dumps today."""
    folder = tmp_path_factory.mktemp("architecture")
    (code,) = blocks(ARCHITECTURE, "python")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run(code, "architecture")
    return folder / "dump"


# -- README ------------------------------------------------------------------------------------------------------------


def test_readme_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = blocks(README, "python")
    run(code, "readme")  # it ends with an assertion about where the beads hang
    assert "-1.294" in capsys.readouterr().out


def test_readme_has_the_two_commands() -> None:
    text = README.read_text(encoding="utf-8")
    assert "pip install -e '.[examples]' && yasps run two_bunnies" in text
    assert "pip install -e '.[dev]' && python -m pytest" in text


def test_readme_names_every_option_of_two_bunnies(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        two_bunnies.main(["--help"])
    options = set(re.findall(r"--[a-z-]+", capsys.readouterr().out)) - {"--help"}
    documented = set(re.findall(r"^\s*\| `(--[a-z-]+)", README.read_text(encoding="utf-8"), re.MULTILINE))
    assert documented == options


def test_links_lead_somewhere() -> None:
    for document in (README, ARCHITECTURE, LANGUAGE, STEPPING):
        text = document.read_text(encoding="utf-8")
        for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
            if not link.startswith("http"):
                assert (document.parent / link).exists(), f"{document.name} links to {link}"


# -- architecture.md ---------------------------------------------------------------------------------------------------


def normal(line: str) -> str:
    """A line without its indentation and with hashes made equal."""
    return re.sub(r"yasps_(?:[0-9a-f]{20}|[A-Z])_", "yasps_X_", line.strip())


def excerpts() -> list[tuple[str, list[str]]]:
    """File and lines of each excerpt from the dump."""
    found = []
    for block in [*blocks(ARCHITECTURE, "mlir"), *blocks(ARCHITECTURE, "cpp")]:
        first, *lines = block.splitlines()
        found.append((first.removeprefix("// "), lines))
    return found


@pytest.mark.parametrize(("file", "lines"), excerpts())
def test_excerpts_are_real(dump: Path, file: str, lines: list[str]) -> None:
    """Every line stands in the file, in this order; `...` alone stands for any lines, at a line's end for its rest."""
    rest = [normal(line) for line in (dump / file).read_text(encoding="utf-8").splitlines()]
    anywhere = True
    for line in lines:
        wanted = normal(line)
        if wanted == "...":
            anywhere = True
            continue
        cut = wanted.removesuffix(" ...")
        fits = [real == wanted or (cut != wanted and real.startswith(cut)) for real in rest]
        position = fits.index(True) if any(fits) else None
        assert position is not None, f"{file} has no line (any more, or here): {line.strip()}"
        assert anywhere or position == 0, f"{file} has other lines before: {line.strip()}"
        rest, anywhere = rest[position + 1 :], False


def test_every_dumped_stage_is_a_pass_in_the_table(dump: Path) -> None:
    names = [path.stem.split("-", 1)[1] for path in sorted(dump.glob("*.mlir"))]
    table = re.findall(r"^\| `([a-z-]+)`(?: \(xDSL's\))? \|", ARCHITECTURE.read_text(encoding="utf-8"), re.MULTILINE)
    passes = [p.name for p in PIPELINE]
    assert names == ["frontend", *passes]
    assert [name for name in table if name in passes] == passes


def test_every_dumped_stage_parses_back(dump: Path) -> None:
    for path in sorted(dump.glob("*.mlir")):
        text = path.read_text(encoding="utf-8")
        module = Parser(make_context(), text).parse_module()
        module.verify()
        assert str(module) + "\n" == text, path.name


def test_the_dump_shows_what_the_text_says(dump: Path) -> None:
    differentiated = (dump / "04-differentiate.mlir").read_text(encoding="utf-8")
    (cut,) = re.findall(r"%\d+ = mat.constant \{value = dense<(.*?)> : tensor<3x6xf64>\}", differentiated)
    rows = [[float(v) for v in row.split(",")] for row in cut.strip("[]").split("], [")]
    assert rows == [[-1, 0, 0, 1, 0, 0], [0, -1, 0, 0, 1, 0], [0, 0, -1, 0, 0, 1]]
    assert "mat." not in (dump / "07-lower-to-scalar.mlir").read_text(encoding="utf-8").replace("format.", "")


def test_the_command_says_what_the_text_says(dump: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = ARCHITECTURE.read_text(encoding="utf-8")
    commands = re.findall(r"^\$ yasps-opt (.*)\n((?:energy .*\n)*)", text, re.MULTILINE)
    assert any(shown for _, shown in commands)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(dump.parent)
        for command, shown in commands:
            assert yasps_opt.main(command.split()) == 0
            said = capsys.readouterr().out
            assert not shown or said == shown


# -- language.md -------------------------------------------------------------------------------------------------------


def test_every_operation_has_its_line() -> None:
    lines = re.findall(r"^\| `(mat\.\w+)` \|", LANGUAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(lines) == sorted(operation.name for operation in OPERATIONS)


def test_every_error_has_its_line() -> None:
    named = {n for n, v in vars(errors).items() if isinstance(v, type) and issubclass(v, errors.YaspsError)}
    documented = set(re.findall(r"^\| `(\w+Error)`", LANGUAGE.read_text(encoding="utf-8"), re.MULTILINE))
    assert named - {"YaspsError"} <= documented


# -- contact-and-stepping.md -------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_stepper_runs() -> None:
    """It checks for intersections itself; and the cube has landed on the ground without sinking in."""
    (code,) = blocks(STEPPING, "python")
    names: dict[str, object] = {"__name__": "stepper"}
    exec(compile(code + "\nlowest = position.value[2::3].min()", "stepper", "exec"), names)
    lowest = names["lowest"]
    assert isinstance(lowest, float)
    assert 0.0 < lowest < 2e-3  # it started 10 mm up; pairs repel below 2 mm
