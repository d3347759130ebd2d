"""A scene as a program: flags, a run with progress and files, a check of the end, and the numbers of the run."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from yasps import Scene, SceneError, YaspsError, __version__
from yasps.output import FrameRecorder
from yasps.program.options import Options, add_common, refuse
from yasps.program.run_numbers import RunNumbers, numbers_of, size_of
from yasps.runtime.build.toolchain import cache_folder
from yasps.simulation import Checkpoints, Simulation

JITTER = 1e-2
"""How far `--seed` moves a vertex in the first step at most, in activation distances."""


class CheckFailedError(YaspsError):
    """A scene did not end as it must; the message says what is wrong, in numbers."""


class Recording(TypedDict, total=False):
    """Keywords of `FrameRecorder`."""

    fields: Sequence[str]
    colors: Mapping[str, str] | None
    camera: str
    view_direction: ArrayLike
    bounds: ArrayLike | None
    speed: float


Build = Callable[[Options], Simulation]
Check = Callable[[Simulation, Options], str]


class SceneProgram:
    """The flags of a scene's program, and its run.

    A program is a module with a `SceneProgram`, a function `build(options)` that returns a `Simulation` of
    `scene(options)`, a function `check(simulation, options)` that raises `CheckFailedError` or says in a sentence what
    was reached, and `main`, which calls `run`.
    """

    def __init__(
        self,
        name: str,
        description: str | None,
        *,
        frames: int | None = 100,
        time_step: float = 0.01,
        size: float | None = None,
        size_means: str = "",
        mesh_means: str = "",
    ) -> None:
        """name: as in `yasps run NAME`, of the scene and its files. description: for --help, the module's docstring.

        frames, time_step [s], size: defaults; frames=None for a program without a simulation, which calls `options`
        itself. size_means, mesh_means: what `--size` counts and `--mesh` replaces; without them, the program has none.
        """
        self.name = name
        self._mesh_means = mesh_means
        self._parser = argparse.ArgumentParser(
            prog=f"yasps run {name}",
            description=description,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        add_common(
            self._parser,
            name,
            frames=frames,
            time_step=time_step,
            size=size,
            size_means=size_means,
            mesh_means=mesh_means,
        )

    def add_argument(self, flag: str, **how: Any) -> None:
        """A flag of this program alone, as in `argparse.ArgumentParser.add_argument`."""
        self._parser.add_argument(flag, **how)

    def options(self, arguments: Sequence[str] | None = ()) -> Options:
        """The flags, checked; arguments: None for those of the process.

        Raises SystemExit (2) with a message on stderr for flags that can't be.
        """
        options = self._parser.parse_args(arguments, namespace=Options())
        refuse(self._parser, self.name, options, mesh_means=self._mesh_means)
        try:
            self.scene(options)  # nothing compiles yet
        except SceneError as error:
            self._parser.error(str(error))
        return options

    def scene(self, options: Options) -> Scene:
        """An empty scene on the device that was asked for; results are the same for any number of threads."""
        return Scene(self.name, device=options.device, threads=options.threads, deterministic=True)

    def run(self, arguments: Sequence[str] | None, build: Build, check: Check, **recording: Unpack[Recording]) -> int:
        """Runs the program; progress goes to stderr, what was reached to stdout, its numbers to OUTPUT/NAME.json.

        arguments: None for those of the process. recording: of `FrameRecorder`: what is shown, and from where.

        Returns 0, or 1 with a message on stderr if `check` raises CheckFailedError. Raises what `build` and
        `Simulation.run` raise.
        """
        options = self.options(arguments)
        threads = options.threads or "one a processor"
        where = f"cpu, threads: {threads}" if options.device == "cpu" else options.device
        _say(f"yasps {__version__}: {self.name} on {where}; compiled code in {cache_folder()}")
        checkpoints = Checkpoints(options.output, self.name)
        if options.resume:
            checkpoints.files()  # before anything is built
        begin = time.perf_counter()
        simulation = build(options)
        if options.resume:
            self._resume(simulation, checkpoints, options)
        with simulation.times.stage("compile"):
            report = simulation.scene.compile_report
        _say(f"compile: {report}")
        _say(size_of(simulation))
        if options.seed and not options.resume:
            jitter(simulation, options.seed)
        first, start_up = simulation.frame, time.perf_counter() - begin
        with FrameRecorder(
            simulation,
            options.output,
            self.name,
            pictures=not options.headless,
            resume=first > 0,
            **recording,
        ) as files:
            if first and not files.number_of_frames:
                files.record(simulation)
            begin = time.perf_counter()
            reports = simulation.run(options.frames - first, files, checkpoints)
            running = time.perf_counter() - begin
            with simulation.times.stage("pictures"):
                files.close()
        command = self._command(arguments)
        numbers = numbers_of(simulation, reports, options, command=command, start_up=start_up, running=running)
        simulation.times.print(title=f"{self.name}, {options.frames} frames")
        return self._end(simulation, options, check, numbers)

    def _command(self, arguments: Sequence[str] | None) -> str:
        """The command without what does not change the motion."""
        words = list(sys.argv[1:] if arguments is None else arguments)
        for flag, count in (("--headless", 1), ("--resume", 1), ("--output", 2), ("--threads", 2)):
            while flag in words:
                del words[words.index(flag) : words.index(flag) + count]
        words = [word for word in words if not word.startswith(("--output=", "--threads="))]
        return " ".join([f"yasps run {self.name}", *(Path(word).name if "/" in word else word for word in words)])

    def _resume(self, simulation: Simulation, checkpoints: Checkpoints, options: Options) -> None:
        """Goes on from the last checkpoint. Raises SceneError if there is none, or if it is beyond the end."""
        file = checkpoints.resume(simulation)
        _say(f"goes on after frame {simulation.frame}, from {file}")
        if simulation.frame > options.frames:
            raise SceneError(
                f"{file} is of frame {simulation.frame}, but --frames {options.frames} ends before: give more --frames,"
                " or leave --resume out to begin again"
            )

    def _end(self, simulation: Simulation, options: Options, check: Check, numbers: RunNumbers) -> int:
        """Checks the end and writes the numbers."""
        file = options.output / f"{self.name}.json"
        try:
            sentence = check(simulation, options)
        except CheckFailedError as error:
            numbers.write(file, str(error), passed=False)
            print(f"{self.name}: {error}", file=sys.stderr)
            return 1
        numbers.write(file, sentence, passed=True)
        print(f"{sentence}\n{numbers}")
        return 0


def jitter(simulation: Simulation, seed: int) -> None:
    """Gives each vertex that moves a small random velocity for the first step: it moves by at most a hundredth of the
    activation distance."""
    random = np.random.default_rng(seed)
    speed = JITTER * simulation.activation_distance / float(simulation.time_step.value[0])
    for body in simulation.moving:
        velocity = simulation.velocity_of(body)
        noise = random.uniform(-1.0, 1.0, velocity.shape) / np.sqrt(3.0)
        simulation.set_velocity(body, velocity + speed * noise)


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
