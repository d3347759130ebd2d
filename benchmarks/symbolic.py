"""How long yasps works before any C++ compiler starts: from the frontend to scalar code, pass by pass."""

from __future__ import annotations

import statistics
import time

from benchmarks.element_problem import box_of_tets, elements_scene
from benchmarks.measure import Report, Row, Settings
from yasps import Scene
from yasps.examples.two_bunnies import two_bunnies
from yasps.frontend.execution.emit import SceneEmitter
from yasps.meshes import box
from yasps.passes.pipeline import run_pipeline

DESCRIPTION = "time of the symbolic stages: one energy, and the scene two_bunnies, pass by pass, ms"
NOTES = (
    "Processor time, least and median of all rounds. Each pass with its verification; frontend: expressions to IR.",
    "total: from the registered energies to one module of scalar code for each object file. The mesh, small boxes for "
    "rabbits here, plays no part.",
)


def stages(scene: Scene) -> dict[str, float]:
    """Seconds of processor time of the frontend and of each pass."""
    seconds: dict[str, float] = {}
    last = time.process_time()

    def after(name: str, module: object) -> None:
        nonlocal last
        now = time.process_time()
        seconds[name] = now - last
        last = now

    emitter = SceneEmitter(scene.name)
    run_pipeline(emitter.emit(scene._energies, scene._targets, []), after=after)
    return seconds


def run(settings: Settings) -> Report:
    """Times both scenes."""
    scenes = {
        "stable Neo-Hookean tets": elements_scene(box_of_tets(6), 1).scene,
        "two_bunnies": two_bunnies(box(divisions=(2, 2, 2)), Scene("two_bunnies", threads=1)).scene,
    }
    rows = []
    for case, scene in scenes.items():
        rounds = [stages(scene) for _ in range(settings.repeats + 1)][1:]  # the first round warms up
        totals = [sum(seconds.values()) for seconds in rounds]
        samples = {"total": totals} | {name: [seconds[name] for seconds in rounds] for name in rounds[0]}
        for name, values in samples.items():
            row = Row(f"{case}: {name}", "yasps", 1, 1e3 * min(values), "ms", 1e3 * statistics.median(values))
            rows.append(row)
    energies = {case: len(scene.energies) for case, scene in scenes.items()}
    return Report(rows, [*NOTES, "energies: " + ", ".join(f"{count} in {case}" for case, count in energies.items())])
