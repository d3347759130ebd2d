"""The tables of the paper's evaluation that are about whole scenes, as benchmarks: ours beside what it published."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.measure import Report, Row, Settings
from benchmarks.paper_tables import (
    MACHINE,
    TABLE_1,
    TABLE_2,
    TABLE_2_FRAMES,
    TABLE_3,
    TABLE_6,
    TABLE_6_FRAMES,
    memory_growth,
    memory_of_pairs,
)
from benchmarks.plots import Bars, Curves
from benchmarks.scene_runs import COLLISION, DIFFERENTIATION, KINDS, NOTES, PARTS, REST, SOLVER, SceneRun, run_apart
from yasps.frontend.commands.environment_report import cpu_model
from yasps.runtime.core.library import available_processors

MEGABYTE = 1e6
PAPER = "the paper"

DESCRIPTION_1 = "the paper's table 1 and figure 20: cloths fall on a bunny on a cloth (9.1), with 1 to 3 upper cloths"
SIZE_1 = 16  # cells along the side of a cloth
CLOTHS = (1, 2, 3)
FRAMES_1 = 8  # a round; 25 rounds are the paper's 200

DESCRIPTION_2 = "the paper's table 2 and figure 33: a twisted mat (E.1), time and memory at growing resolution"
SIZE_2 = 900  # vertices of the smallest mat
TIMES_AS_MANY = (1, 2, 4)
FRAMES_2 = 10  # a round
SPEED = 20.0  # rad/s of each end

DESCRIPTION_3 = "the paper's table 3 and figure 22: bunnies fall into a container (10.2, E.2), one perhaps affine"
SIZE_3 = 1_500  # vertices of a bunny
BUNNIES = (1, 2, 4)
MOST_BUNNIES = 25
FRAMES_3 = 4  # a round

DESCRIPTION_6 = "the paper's table 6: a caged bunny falls on a cloth with a soft and an affine one (9.3, G)"
SIZE_6 = 16  # cells along the side of the cloth
FRAMES_6 = 6  # a round


def run_table_1(settings: Settings) -> Report:
    """Runs 9.1 with each number of upper cloths."""
    frames = FRAMES_1 * settings.repeats
    runs = [
        run_apart("cloths_on_bunny", frames, _flags(settings, "--size", settings.size, "--cloths", cloths))
        for cloths in CLOTHS
    ]
    rows: list[Row] = []
    for cloths, found in zip(CLOTHS, runs, strict=True):
        rows += _rows(f"{_cloths(cloths)}, {found.vertices:,} vertices", settings.threads, found)
    for paper in TABLE_1:
        rest = paper.total - paper.differentiation - paper.solver
        rows += _published(
            f"{paper.vertices:,} vertices",
            paper.system,
            (paper.frames, paper.newton, paper.cg),
            {DIFFERENTIATION: paper.differentiation, SOLVER: paper.solver, "collision and everything else": rest},
        )
    of_yasps = [paper for paper in TABLE_1 if paper.system == "YASPS"]
    labels = [f"{_cloths(cloths)}, ours" for cloths in CLOTHS] + [f"{_cloths(n)}, {PAPER}" for n in (1, 2, 3)]
    shares = {
        part: [100 * found.seconds[part] / found.total for found in runs]
        + [100 * value / paper.total for paper in of_yasps for value in [_published_part(paper, part)]]
        for part in (*PARTS, REST)
    }
    plot = Bars("figure_20", "Where the time of 9.1 goes", "% of the frames' time", labels, shares, stacked=True)
    note = (
        f"--size: cells along the side of a cloth, 100 in the paper, whose mesh is --mesh bunny_19k.msh. --repeats R: "
        f"{FRAMES_1} R frames; with few frames nothing touches yet. The paper's collision detection is in its "
        f"'{REST}': the text gives no share of it."
    )
    return Report(rows, [note, _about(settings, frames), *NOTES], [plot])


def _cloths(count: int) -> str:
    return f"{count} upper cloth{'s' * (count > 1)}"


def _published_part(paper: object, part: str) -> float:
    numbers = {DIFFERENTIATION: "differentiation", SOLVER: "solver"}
    if part in numbers:
        return float(getattr(paper, numbers[part]))
    if part == REST:
        total, first, second = (float(getattr(paper, name)) for name in ("total", "differentiation", "solver"))
        return total - first - second
    return 0.0


def run_table_2(settings: Settings) -> Report:
    """Twists mats of each resolution."""
    frames = FRAMES_2 * settings.repeats
    runs = [
        run_apart("mat_twist", frames, _flags(settings, "--size", size * settings.size, "--speed", SPEED))
        for size in TIMES_AS_MANY
    ]
    rows: list[Row] = []
    for found in runs:
        rows += _rows(f"{found.vertices:,} vertices", settings.threads, found)
    ours = _growth(
        [run.vertices for run in runs],
        [run.least_memory / MEGABYTE for run in runs],
        [run.most_memory / MEGABYTE for run in runs],
        [run.most_pairs for run in runs],
    )
    published = _growth(
        [row.vertices for row in TABLE_2],
        [row.least_memory for row in TABLE_2],
        [row.most_memory for row in TABLE_2],
        [row.pairs for row in TABLE_2],
    )
    for paper in TABLE_2:
        case = f"{paper.vertices:,} vertices"
        parts = {COLLISION: paper.collision, DIFFERENTIATION: paper.differentiation, SOLVER: paper.solver}
        rows += [Row(f"{case}: {part}", PAPER, 0, value / TABLE_2_FRAMES, "s/frame") for part, value in parts.items()]
        rows.append(Row(f"{case}: most pairs", PAPER, 0, float(paper.pairs), ""))
        rows.append(Row(f"{case}: least memory", PAPER, 0, paper.least_memory, "MB"))
        rows.append(Row(f"{case}: most memory", PAPER, 0, paper.most_memory, "MB"))
    for name, curves in (("yasps", ours), (PAPER, published)):
        for metric, (vertices, values) in curves.items():
            threads = settings.threads if name == "yasps" else 0
            rows += [
                Row(f"{count:,} vertices: {metric}", name, threads, value, "MB")
                for count, value in zip(vertices, values, strict=True)
            ]
    plot = Curves(
        "figure_33",
        "Memory of a twisted mat (equations 11 and 12)",
        "vertices",
        "MB",
        {
            f"{metric}, {who}": curve
            for who, curves in (("ours", ours), (PAPER, published))
            for metric, curve in curves.items()
        },
        log_x=True,
        log=True,
    )
    first, *_, last = TIMES_AS_MANY
    note = (
        f"--size: vertices of the smallest mat; the largest has {last // first} times as many; 250,000 makes rows of "
        f"the paper's last resolutions. --repeats R: {FRAMES_2} R frames of 1 ms at {SPEED:g} rad/s (the paper: "
        f"{TABLE_2_FRAMES:,} at 5); pairs need about 60 of them."
    )
    return Report(rows, [note, _about(settings, frames), *NOTES], [plot])


def _growth(
    vertices: Sequence[int], least: Sequence[float], most: Sequence[float], pairs: Sequence[int]
) -> dict[str, tuple[Sequence[float], Sequence[float]]]:
    """Figure 33: abscissas and ordinates of both metrics."""
    return {
        "for 10,000 vertices more": (vertices[1:], memory_growth(vertices, least)),
        "for 100,000 pairs": (vertices, memory_of_pairs(least, most, pairs)),
    }


def run_table_3(settings: Settings) -> Report:
    """Drops bunnies: growing numbers of soft ones, and the largest number with one of them affine."""
    frames = FRAMES_3 * settings.repeats

    def dropped(count: int, affine: int) -> SceneRun:
        flags = _flags(settings, "--size", count, "--affine", affine, "--vertices", settings.size)
        return run_apart("bunnies_in_container", frames, flags)

    soft = [dropped(count, 0) for count in BUNNIES]
    mixed = dropped(BUNNIES[-1], 1)
    rows: list[Row] = []
    for count, found in zip(BUNNIES, soft, strict=True):
        rows += _rows(f"{count} soft", settings.threads, found)
        rows += [Row(f"{count} soft: {kind}", "yasps", settings.threads, n, "pairs") for kind, n in found.pairs.items()]
    rows += _rows(f"{BUNNIES[-1] - 1} soft, 1 affine", settings.threads, mixed)
    for what in (DIFFERENTIATION, SOLVER, COLLISION):
        per_iteration = [run.seconds[what] / max(run.newton, 1) for run in (soft[-1], mixed)]
        case = f"{what} of a Newton iteration, one affine over none"
        rows.append(Row(case, "yasps", settings.threads, per_iteration[1] / per_iteration[0], "times"))
    rows.append(Row("most memory, one affine over none", "yasps", settings.threads, _over(mixed, soft[-1]), "times"))
    for paper in TABLE_3:
        case = f"{paper.soft} soft, {paper.affine} affine{', Jacobian apart' * paper.separate}"
        parts = {COLLISION: paper.collision, DIFFERENTIATION: paper.differentiation, SOLVER: paper.solver}
        rows += [Row(f"{case}: {part}", PAPER, 0, value, "s") for part, value in parts.items()]
        rows.append(Row(f"{case}: most memory", PAPER, 0, paper.most_memory, "MB"))
    times = {part: (BUNNIES, [run.seconds[part] / frames for run in soft]) for part in (*PARTS, REST)}
    pairs = {kind: (BUNNIES, [run.pairs[kind] for run in soft]) for kind in KINDS}
    plots = [
        Curves("figure_22_time", "Bunnies in a container", "bunnies", "processor s/frame", times),
        Curves("figure_22_pairs", "Bunnies in a container", "bunnies", "most close pairs", pairs),
    ]
    note = (
        f"--size: vertices of a bunny (19,193 with the paper's --mesh bunny_19k.msh); {', '.join(map(str, BUNNIES))} "
        f"bunnies here, 1 to {MOST_BUNNIES} in figure 22 and 6 to 10 in table 3. --repeats R: {FRAMES_3} R frames. "
        "What an affine body costs is not comparable between frames of different motion: see what an iteration takes."
    )
    return Report(rows, [note, _about(settings, frames), *NOTES], plots)


def _over(one: SceneRun, other: SceneRun) -> float:
    return one.most_memory / other.most_memory


def run_table_6(settings: Settings) -> Report:
    """Drops the caged bunny with either element, each compiled with an empty cache."""
    frames = FRAMES_6 * settings.repeats
    rows: list[Row] = []
    runs = {}
    for element, paper in TABLE_6.items():
        flags = _flags(settings, "--size", settings.size, "--element", element)
        runs[element] = found = run_apart("caged_bunny", frames, flags, cold=True)
        rows += _rows(f"{element}, {found.vertices:,} vertices", settings.threads, found)
        rows.append(Row(f"{element}: compile, empty cache", "yasps", settings.threads, found.compile, "s"))
        rows.append(Row(f"{element}: generated files", "yasps", settings.threads, float(found.modules), ""))
        parts = {DIFFERENTIATION: paper.differentiation, SOLVER: paper.solver}
        rows += _published(element, "YASPS", (TABLE_6_FRAMES, paper.newton, paper.cg), parts)
        rows.append(Row(f"{element}: most memory", PAPER, 0, paper.most_memory, "MB"))
        rows.append(Row(f"{element}: compile, empty cache", PAPER, 0, paper.compile, "s"))
        rows.append(Row(f"{element}: generated files", PAPER, 0, float(paper.files), ""))
    labels = [f"{element}, {who}" for element in TABLE_6 for who in ("ours", PAPER)]
    numbers = {
        "generated files": [n for e in TABLE_6 for n in (float(runs[e].modules), float(TABLE_6[e].files))],
        "compile, s": [s for e in TABLE_6 for s in (runs[e].compile, TABLE_6[e].compile)],
    }
    plot = Bars("table_6", "Compiling 9.3 with an empty cache", "files, seconds", labels, numbers, log=True)
    note = (
        "--size: cells along the side of the cloth, 100 in the paper; the rabbits are about as fine. --repeats R: "
        f"{FRAMES_6} R frames. compile: processor time of yasps and its compilers, with the solver runtime. The paper "
        "counts files and seconds over the whole run, with 495 of hex8's 705 for compressed sizes of one Hessian."
    )
    return Report(rows, [note, _about(settings, frames), *NOTES], [plot])


def _flags(settings: Settings, *flags: object) -> list[str]:
    mesh = [] if settings.mesh is None else ["--mesh", str(settings.mesh.absolute())]
    return [*map(str, flags), "--threads", str(settings.threads), *mesh]


def _about(settings: Settings, frames: int) -> str:
    return (
        f"{frames} frames, {settings.threads} thread{'s' * (settings.threads > 1)}; {cpu_model()}, "
        f"{available_processors()} processors. Threads 0: {MACHINE}."
    )


def _rows(case: str, threads: int, found: SceneRun) -> list[Row]:
    """What a run of ours took."""

    def row(what: str, value: float, unit: str) -> Row:
        return Row(f"{case}: {what}", "yasps", threads, value, unit)

    return [
        row("frame", found.total / found.frames, "s/frame"),
        *(row(part, seconds / found.frames, "s/frame") for part, seconds in found.seconds.items()),
        *(row(f"share of {part}", 100 * seconds / found.total, "%") for part, seconds in found.seconds.items()),
        row("differentiation of a Newton iteration", 1e3 * found.seconds[DIFFERENTIATION] / max(found.newton, 1), "ms"),
        row("a CG iteration", 1e3 * found.seconds[SOLVER] / max(found.cg, 1), "ms"),
        row("Newton iterations", found.newton / found.frames, "1/frame"),
        row("CG iterations", found.cg / max(found.newton, 1), "1/Newton iteration"),
        row("most pairs", float(found.most_pairs), ""),
        row("least memory", found.least_memory / MEGABYTE, "MB"),
        row("most memory", found.most_memory / MEGABYTE, "MB"),
    ]


def _published(case: str, system: str, counts: tuple[int, int, int], seconds: dict[str, float]) -> list[Row]:
    """The same of the paper. counts: frames, Newton iterations, iterations of conjugate gradients."""
    frames, newton, cg = counts
    who = f"{PAPER}, {system}"
    return [
        *(Row(f"{case}: {part}", who, 0, value / frames, "s/frame") for part, value in seconds.items()),
        Row(f"{case}: differentiation of a Newton iteration", who, 0, 1e3 * seconds[DIFFERENTIATION] / newton, "ms"),
        Row(f"{case}: a CG iteration", who, 0, 1e3 * seconds[SOLVER] / cg, "ms"),
        Row(f"{case}: Newton iterations", who, 0, newton / frames, "1/frame"),
        Row(f"{case}: CG iterations", who, 0, cg / newton, "1/Newton iteration"),
    ]
