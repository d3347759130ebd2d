"""The documents are true: code blocks run, dumps are those of today, every operation and option is described."""

from __future__ import annotations

import importlib.util
import re
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from xdsl.parser import Parser

from benchmarks import parts
from yasps import Attribute, Scene, concat_cols, concat_rows, constant, identity, materials, stumpff
from yasps.bodies import SoftBody
from yasps.dialects.mat import OPERATIONS
from yasps.examples import two_bunnies
from yasps.frontend import errors
from yasps.frontend.commands import yasps_opt
from yasps.meshes import box
from yasps.passes.ir_text import text_of
from yasps.passes.pipeline import PIPELINE, make_context
from yasps.simulation import Simulation
from yasps.stepping import BDF2

ROOT = Path(__file__).parents[1]
ARCHITECTURE = ROOT / "docs" / "architecture.md"
BRIDGES = ROOT / "docs" / "bridges.md"
LANGUAGE = ROOT / "docs" / "language.md"
GPU = ROOT / "docs" / "gpu.md"
STEPPING = ROOT / "docs" / "contact-and-stepping.md"
PARAMETERISATIONS = ROOT / "docs" / "parameterisations.md"
PARTS = ROOT / "docs" / "parts.md"
README = ROOT / "README.md"
DOCUMENTS = [README, *sorted((ROOT / "docs").glob("*.md"))]
ADVICE = "if that is meant, run `python docs/update_excerpts.py` and look at `git diff`"


def blocks(document: Path, language: str) -> list[str]:
    """Texts of a document's fenced blocks of one language that start a line."""
    text = document.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def run(code: str, name: str) -> None:
    exec(compile(code, name, "exec"), {"__name__": name})


def load_update_excerpts() -> ModuleType:
    spec = importlib.util.spec_from_file_location("update_excerpts", ROOT / "docs" / "update_excerpts.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


update_excerpts = load_update_excerpts()


@pytest.fixture(scope="module")
def dump(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the example of docs/architecture.md dumps today."""
    folder = tmp_path_factory.mktemp("architecture")
    made: Path = update_excerpts.dump_example(ARCHITECTURE.read_text(encoding="utf-8"), folder)
    return made


# -- README ------------------------------------------------------------------------------------------------------------


def test_readme_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = blocks(README, "python")
    run(code, "readme")  # it ends with an assertion about where the beads hang
    assert "-1.294" in capsys.readouterr().out


def test_readme_has_the_two_commands() -> None:
    text = README.read_text(encoding="utf-8")
    assert "pip install -e '.[examples]' && yasps run two_bunnies" in text
    assert "pip install -e '.[dev]' && python -m pytest -n 2" in text


def test_readme_names_every_option_of_two_bunnies(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        two_bunnies.main(["--help"])
    options = set(re.findall(r"--[a-z-]+", capsys.readouterr().out)) - {"--help"}
    documented = set(re.findall(r"^\s*\| `(--[a-z-]+)", README.read_text(encoding="utf-8"), re.MULTILINE))
    assert documented == options


def test_links_lead_somewhere() -> None:
    for document in DOCUMENTS:
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
        assert position is not None, f"{file} has no line (any more, or here): {line.strip()}; {ADVICE}"
        assert anywhere or position == 0, f"{file} has other lines before: {line.strip()}; {ADVICE}"
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
        assert text_of(module) == text, path.name


def test_the_dump_shows_what_the_text_says(dump: Path) -> None:
    differentiated = (dump / "06-differentiate.mlir").read_text(encoding="utf-8")
    (cut,) = re.findall(r"%\d+ = mat.constant (.*?) : 3x6", differentiated)
    rows = [[float(v) for v in row.split(",")] for row in cut.strip("[]").split("], [")]
    assert rows == [[-1, 0, 0, 1, 0, 0], [0, -1, 0, 0, 1, 0], [0, 0, -1, 0, 0, 1]]
    assert "mat." not in (dump / "10-lower-to-scalar.mlir").read_text(encoding="utf-8").replace("format.", "")


def test_the_command_says_what_the_text_says(dump: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = ARCHITECTURE.read_text(encoding="utf-8")
    commands = re.findall(r"^\$ yasps-opt (.*)\n((?:energy .*\n)*)", text, re.MULTILINE)
    assert any(shown for _, shown in commands)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(dump.parent)
        for command, shown in commands:
            assert yasps_opt.main(command.split()) == 0
            said = capsys.readouterr().out
            assert not shown or said == shown, ADVICE


def test_excerpts_are_up_to_date(dump: Path) -> None:
    text = ARCHITECTURE.read_text(encoding="utf-8")
    assert update_excerpts.updated(text, dump) == text, ADVICE


def test_an_update_repairs_numbers_and_changed_lines(dump: Path) -> None:
    """As after a change of the compiler, the other way round: the document is the one that differs."""
    text = ARCHITECTURE.read_text(encoding="utf-8")

    def renumbered(excerpt: re.Match[str]) -> str:
        moved = re.sub(r"%(\d+)", lambda number: f"%{int(number[1]) + 7}", excerpt[0])
        return re.sub(r"\bt(\d+)", lambda number: f"t{int(number[1]) + 5}", moved)

    old = update_excerpts.EXCERPT.sub(renumbered, text)
    old = old.replace("value 181.25", "value 3").replace("width 3 : i64", "width 4 : i64")
    assert old != text
    assert update_excerpts.updated(old, dump) == text


def test_an_update_marks_lines_that_came_between() -> None:
    shown = ["a = first(1)", "  b = second(2)", "c = third(3) ..."]
    real = ["", "  a = first(1)", "    new line", "    b = second(2)", "  c = third(3) and more"]
    wanted = ["a = first(1)", "  ...", "  b = second(2)", "c = third(3) ..."]
    assert update_excerpts.updated_lines("f", shown, real) == wanted


def test_an_update_refuses_lines_that_are_gone(dump: Path) -> None:
    text = ARCHITECTURE.read_text(encoding="utf-8")
    gone = text.replace("  rel.target @stiff.body.shift\n", "  rel.nothing like this was ever dumped\n", 1)
    assert gone != text
    with pytest.raises(update_excerpts.ExcerptError, match=r"00-frontend.mlir has nothing like .*rel.nothing"):
        update_excerpts.updated(gone, dump)


def test_an_update_refuses_lines_in_another_order() -> None:
    with pytest.raises(update_excerpts.ExcerptError, match="no longer in this order"):
        update_excerpts.updated_lines("f", ["alpha", "...", "beta"], ["beta", "alpha"])


def test_the_text_names_no_value_by_its_number() -> None:
    """An update changes the excerpts only, so that prose must not depend on numbers of values."""
    prose = re.sub(r"^```.*?^```$", "", ARCHITECTURE.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    assert re.findall(r"`%\d+`", prose) == []


# -- language.md -------------------------------------------------------------------------------------------------------


def test_every_operation_has_its_line() -> None:
    lines = re.findall(r"^\| `(mat\.\w+)` \|", LANGUAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(lines) == sorted(operation.name for operation in OPERATIONS)


def test_lines_of_functions_are_those_of_the_table() -> None:
    text = LANGUAGE.read_text(encoding="utf-8")
    assert text == update_excerpts.with_functions(text), "run `python docs/update_excerpts.py`"


def test_every_error_has_its_line() -> None:
    named = {n for n, v in vars(errors).items() if isinstance(v, type) and issubclass(v, errors.YaspsError)}
    documented = set(re.findall(r"^\| `(\w+Error)`", LANGUAGE.read_text(encoding="utf-8"), re.MULTILINE))
    assert named - {"YaspsError"} <= documented


def snippet(word: str) -> str:
    """The code of language.md that holds a word."""
    found = re.findall(r"```python\n(.*?)```", LANGUAGE.read_text(encoding="utf-8"), re.DOTALL)
    (code,) = [code for code in found if word in code]
    return "\n".join(line.strip() for line in code.splitlines())


def test_variable_arity_is_as_described() -> None:
    scene = Scene("neighbours")
    vertices = scene.add_mesh("mesh").add_primitive("vertices", 3)
    x = vertices.add_attribute("x", 1, 1, value=[1.0, 2.0, 4.0])
    names = {"vertices": vertices, "x": x, "neighbours": [1, 0, 2, 1], "counts": [1, 2, 1]}
    exec(snippet("ring"), names)
    assert vertices["around"].value.tolist() == [2.0, 2.5, 2.0]
    ring = vertices.connectivities["ring"]
    assert ring.arity == 2
    assert ring.indices.tolist() == [[1, -1], [0, 2], [1, -1]]


def test_primitives_that_belong_together_are_resized() -> None:
    scene = Scene("mesh")
    mesh = scene.add_mesh("mesh")
    vertices, triangles = mesh.add_primitive("vertices", 4), mesh.add_primitive("triangles", 2)
    names = {"position": vertices.add_attribute("position", 3, 1), "mass": vertices.add_constant("mass", 1, 1)}
    parts = {"corners": triangles.add_connectivity("corners", vertices, [[0, 1, 2], [0, 2, 3]], 3)}
    data = {"x": np.ones((5, 3)), "m": np.ones(5), "t": [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]}
    exec(snippet("resize"), {"scene": scene, "vertices": vertices, "triangles": triangles} | names | parts | data)
    assert vertices.num_instances == 5
    assert parts["corners"].indices.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_parts_of_a_dynamic_primitive_are_set_together() -> None:
    scene = Scene("pairs")
    mesh = scene.add_mesh("mesh")
    vertices, pairs = mesh.add_primitive("vertices", 10), mesh.add_primitive("pairs", 0, is_dynamic=True)
    pairs.add_connectivity("vertices", vertices, [], 2)
    pairs.add_constant("weight", 1, 1)
    exec(snippet("pairs.update"), {"pairs": pairs})
    assert pairs.num_instances == 2
    assert pairs.vertices.indices.tolist() == [[0, 7], [1, 9]]


def test_the_rotation_of_a_vector_is_one() -> None:
    r = np.array([[0.0, 0.0, 0.0], [0.3, -1.2, 0.4]])
    vectors = Scene("turned", threads=1).add_mesh("m").add_primitive("v", 2)
    x, y, z = vectors.add_attribute("r", 3, 1, value=r)
    rows = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    names = {
        "r": vectors["r"],
        "identity": identity,
        "stumpff": stumpff,
        "cross_matrix": concat_rows([concat_cols(row) for row in rows]),
    }
    exec(snippet("stumpff"), names)
    rotation = names["rotation"]
    assert isinstance(rotation, Attribute)
    np.testing.assert_allclose(rotation.compute().array, Rotation.from_rotvec(r).as_matrix(), atol=1e-15)


def test_a_hinge_in_numpys_words_is_what_numpy_computes() -> None:
    x = np.array([[0.0, 0.0, 0.0], [1.0, 0.2, 0.0], [0.4, 1.0, 0.3], [0.5, -1.0, 0.2]])
    hinges = Scene("hinge", threads=1).add_mesh("m").add_primitive("hinges", 1)
    symbolic: dict[str, Any] = {"x": hinges.add_attribute("x", 4, 3, value=x), "np": np, "length": 0.9}
    numbers: dict[str, Any] = {"x": x, "np": np, "length": 0.9}
    for names in (symbolic, numbers):
        exec(snippet("np.arctan2"), names)
    assert symbolic["energy"].value.item() == pytest.approx(float(numbers["energy"]), rel=1e-14)


def test_derivatives_of_ones_own() -> None:
    """An exact gradient of (d . d - 1)^2, and its positive semi-definite Hessian where d is short: 8 d d^T clamped."""
    scene = Scene("own", threads=1)
    d = scene.add_mesh("m").add_primitive("p", 1).add_attribute("d", 3, 1, value=[0.6, 0.0, 0.0])
    names: dict[str, Any] = {"d": d, "length": 1.0, "stiffness": 1.0, "normal": constant([0.0, 0.0, 1.0])}
    with pytest.raises(errors.SceneError, match="the Hessian given"):  # it is no normal of every d
        exec("from yasps import *\n" + snippet("eigensystem="), names)
    names["normal"] = d.cross([0.0, 1.0, 0.0]) / d.cross([0.0, 1.0, 0.0]).norm()
    exec("from yasps import *\n" + snippet("eigensystem="), names)
    scene.add_energy(scene.m.p.add_attribute("energy", computed_attribute=names["energy"]))
    scene.add_minimize_target(d)
    np.testing.assert_allclose(scene.gradient()[0], [4 * (0.36 - 1) * 0.6, 0.0, 0.0], atol=1e-14)
    np.testing.assert_allclose(
        scene.hessian().to_scipy().toarray(), np.diag([8 * 0.36 + 4 * (0.36 - 1), 0, 0]), atol=1e-13
    )


def test_frames_of_a_rod_are_carried_along() -> None:
    (code,) = blocks(PARTS, "python")
    names: dict[str, Any] = {}
    exec(code, names)
    along = names["directors"] @ (names["moved"][1:] - names["moved"][:-1]).T
    np.testing.assert_allclose(np.diag(along), 0.0, atol=1e-15)
    assert names["twists"].shape == (1,)


def test_the_results_of_the_document(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = blocks(ROOT / "docs" / "results.md", "python")
    run(code, "docs/results.md")
    assert capsys.readouterr().out == "[0.   0.01 0.02 0.03] ['die', 'ground']\n"


def test_the_bridges_of_the_document(capsys: pytest.CaptureFixture[str]) -> None:
    code, *_ = blocks(BRIDGES, "python")
    names: dict[str, Any] = {}
    exec(code, names)
    assert capsys.readouterr().out == "[[0.3121, -0.0243, 0.0], [0.6879, -0.0243, 0.0]]\n"
    np.testing.assert_allclose(names["scene"].compile_for(names["position"]).assemble(hessian=False), 0.0, atol=1e-6)


def test_the_run_of_the_document_is_differentiated() -> None:
    """What is fitted brings the cube to its goal but for what no velocity along the ground can do."""
    names: dict[str, Any] = {}
    for code in blocks(ROOT / "docs" / "inverse.md", "python"):
        exec(code, names)
    gradient, velocity, friction = (names[name] for name in ("gradient", "velocity", "friction"))
    assert gradient.warnings == []
    assert gradient[velocity][1] < 0  # the goal is to the left of the way
    assert abs(gradient[friction].sum()) > 1e-4
    assert names["total"].value > gradient.value
    assert names["found"].value < 1e-2 * gradient.value


def test_the_bridge_to_jax_of_the_document() -> None:
    """Newton's method converges quadratically, and the cube that is thrown gets there."""
    jax = pytest.importorskip("jax", reason="pip install 'yasps[jax]'")
    before = jax.config.jax_enable_x64
    names: dict[str, Any] = {}
    scipy_code, jax_code, _, layer_code = blocks(BRIDGES, "python")
    try:
        for code in (scipy_code, jax_code, layer_code):
            exec(code, names)
        assert names["miss"](names["velocity"]) < 1e-24
    finally:
        jax.config.update("jax_enable_x64", before)
    first, *_, last = slopes = names["slopes"]
    assert first > 1e-2
    assert last < 1e-12
    assert all(b < 10 * a**2 for a, b in pairwise(slopes) if a > 1e-7)


def test_the_bridge_to_torch_of_the_document(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torch", reason="pip install 'yasps[torch]'")
    names: dict[str, Any] = {}
    scipy_code, _, torch_code, _ = blocks(BRIDGES, "python")
    exec(scipy_code, names)
    exec(torch_code, names)
    assert "torch.Size([3, 1, 1])" in capsys.readouterr().out


def test_every_energy_has_its_line() -> None:
    """In docs/parts.md, with its width and time as `python -m benchmarks parts` prints them."""
    text = PARTS.read_text(encoding="utf-8")
    lines = re.findall(r"^\| `(\w+)\(.*\| (\d+) \| (\d+) \|$", text, re.MULTILINE)
    assert sorted(name for name, _, _ in lines) == sorted(part.name for part in parts.PARTS)
    assert {name for name in materials.__all__ if not re.search(rf"\b{name}\b", text)} <= {"Scalar"}


def test_every_python_block_is_run() -> None:
    """Whoever writes one more writes a test of it."""
    shown = {name.name: len(re.findall(r"```python", name.read_text(encoding="utf-8"))) for name in DOCUMENTS}
    run = {
        "README.md": 1,
        "architecture.md": 1,
        "bridges.md": 4,
        "contact-and-stepping.md": 6,
        "gpu.md": 1,
        "inverse.md": 3,
        "language.md": 8,
        "parameterisations.md": 1,
        "parts.md": 1,
        "results.md": 1,
        "scenes.md": 1,
    }
    assert {name: count for name, count in shown.items() if count} == run


def test_the_inverse_problem_is_solved() -> None:
    """The minimum of (x - p)^4 / 4 + s x^2 / 2 moves with p as the implicit function theorem says, by differences."""
    scene = Scene("inverse")
    points = scene.add_mesh("mesh").add_primitive("points", 2)
    x = points.add_attribute("x", 1, 1, value=[0.1, 0.2])
    p = points.add_constant("p", 1, 1, value=[1.0, -2.0])
    scene.add_energy(points.add_attribute("energy", computed_attribute=0.25 * (x - p) ** 4 + 0.5 * x * x))
    scene.add_minimize_target(x)

    def minimum() -> NDArray[np.float64]:
        for _ in range(30):
            x.update_value(x.value - scene.minimize_energy(tolerance=1e-24)[0])
        assert np.abs(scene.gradient()[0]).max() < 1e-12
        return x.value

    minimum()
    names: dict[str, object] = {"scene": scene, "x": x, "p": p, "scipy": scipy}
    exec("import scipy.sparse.linalg\n" + snippet("mixed_hessian"), names)
    found = names["dx_dp"]
    assert isinstance(found, np.ndarray)
    start = p.value
    for k in range(2):
        ends = []
        for sign in (1, -1):
            p.update_value(start + sign * 1e-5 * np.eye(2)[k])
            ends.append(minimum())
        np.testing.assert_allclose(found[:, k], (ends[0] - ends[1]) / 2e-5, atol=1e-8)


# -- contact-and-stepping.md -------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_report_of_kernels_runs(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("cuda.bindings", reason="pip install 'yasps[cuda]'")
    (code,) = blocks(GPU, "python")
    run(code, "gpu")
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("m.points.energy ")
    assert lines[-1].startswith("link ")


def test_the_contact_table_says_what_is_said() -> None:
    table, *_ = blocks(STEPPING, "python")
    names: dict[str, Any] = {}
    exec(table, names)
    contacts = names["contacts"]
    assert contacts.entry("ground", "cube") == (0.5, 0.4, 2e4, True)
    assert contacts.entry("cube", "cloth")[3] is False
    assert contacts.entry("cloth", "ground") == (0.3, 0.3, None, True)


def test_overlaps_are_taken_away(capsys: pytest.CaptureFixture[str]) -> None:
    _, code, *_ = blocks(STEPPING, "python")
    exec(code, {})
    before, after = capsys.readouterr().out.splitlines()
    promised = re.findall(r"# (.*?) ?\.\.\.$", code, re.MULTILINE)
    assert before.startswith(promised[0])
    assert after.startswith(promised[1])


@pytest.mark.slow
def test_the_damping_of_the_document_takes_motion_away() -> None:
    *_, code, _, _, _ = blocks(STEPPING, "python")
    kinetic = []
    for damped in (False, True):
        scene = Scene("damped", threads=1)
        body = SoftBody(scene, "cube", box((0.1, 0.1, 0.1), (1, 1, 1)))
        simulation = Simulation(scene, [body], contact=False, gravity=(0.0, 0.0, 0.0), integrator=BDF2, time_step=1e-3)
        if damped:
            exec(code, {"body": body, "simulation": simulation, "materials": materials})
        body.position.update_value(1.1 * body.rest)
        kinetic.append(0.0)
        for _ in range(60):
            simulation.step()
            kinetic[-1] += simulation.stepper.kinetic_energy()
    assert 0.0 < kinetic[1] < 0.9 * kinetic[0]


def test_the_cube_drops_and_drifts() -> None:
    *_, code, _, _ = blocks(STEPPING, "python")
    names: dict[str, object] = {}
    exec(code + "\nmoved = (cube.positions() - cube.rest).mean(axis=0)", names)
    moved = names["moved"]
    assert isinstance(moved, np.ndarray)
    assert moved[0] > 1e-6
    assert -1.5e-2 < moved[2] < -5e-3  # it started 10 mm up, and is soft


def test_the_cube_goes_back_to_a_state_in_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    *_, drop, code, _ = blocks(STEPPING, "python")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(drop + code, names)
    assert names["simulation"].frame == 20
    assert names["checkpoints"].file.is_file()


def test_the_stepper_runs() -> None:
    """It checks for intersections itself; and the cube has landed on the ground without sinking in."""
    *_, code = blocks(STEPPING, "python")
    names: dict[str, object] = {"__name__": "stepper"}
    exec(compile(code + "\nlowest = position.value[2::3].min()", "stepper", "exec"), names)
    lowest = names["lowest"]
    assert isinstance(lowest, float)
    assert 0.0 < lowest < 2e-3  # it started 10 mm up; pairs repel below 2 mm


# -- parameterisations.md ----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_pendulum_of_the_document_turns(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = blocks(PARAMETERISATIONS, "python")
    exec(code, {})
    angle, gap = (float(word) for word in capsys.readouterr().out.split())
    assert 0.0 < angle < 0.3
    assert 0.0 < gap < 1e-5
