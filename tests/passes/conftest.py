"""Scenes run through the pipeline once, with what every stage said and meant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property

import numpy as np
import pytest
from numpy.typing import NDArray
from small_scenes import SCENES, along_each_unknown, dense_assembly, emit
from xdsl.dialects.builtin import ModuleOp

from yasps.backend.reference.interpreter import Interpreter, SceneData
from yasps.passes.ir_text import text_of
from yasps.passes.pipeline import run_pipeline


@dataclass(frozen=True)
class Stage:
    """The module after a pass, and what it means; each number is computed when it is first asked for."""

    text: str
    module: ModuleOp
    data: SceneData = field(repr=False)

    @cached_property
    def energy(self) -> float:
        """The total energy."""
        return float(Interpreter(self.module, self.data).total_energy())

    @cached_property
    def _assembled(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return dense_assembly(self.module, self.data)

    @property
    def gradient(self) -> NDArray[np.float64]:
        """By the interpreter, of a stage that has derivatives."""
        return self._assembled[0]

    @property
    def hessian(self) -> NDArray[np.float64]:
        """By the interpreter, of a stage that has derivatives."""
        return self._assembled[1]


@dataclass(frozen=True)
class Run:
    """A scene's way through the pipeline, and the derivatives that complex steps of its first stage give."""

    data: SceneData
    targets: list[str]
    stages: dict[str, Stage]

    @property
    def last(self) -> ModuleOp:
        """The module the backend gets."""
        return list(self.stages.values())[-1].module

    @cached_property
    def gradient(self) -> NDArray[np.float64]:
        """By complex steps of the energy."""
        return self._along_each_unknown("frontend", lambda interpreter: interpreter.total_energy())

    @cached_property
    def hessian(self) -> NDArray[np.float64]:
        """By complex steps of the gradient."""
        return self._along_each_unknown("differentiate", lambda interpreter: interpreter.assemble()[0])

    def _along_each_unknown(self, stage: str, of: Callable[[Interpreter], object]) -> NDArray[np.float64]:
        return np.asarray(along_each_unknown(self.stages[stage].module, self.data, self.targets, of))


@cache
def _run(scene: str, projection: str) -> Run:
    emitted = emit(SCENES[scene](projection))
    stages: dict[str, Stage] = {}
    known: dict[str, Stage] = {}

    def after(name: str, module: ModuleOp) -> None:
        text = text_of(module)
        if text not in known:  # a pass that changes nothing has the stage before it
            known[text] = Stage(text, module.clone(), emitted.data)
        stages[name] = known[text]

    run_pipeline(emitted.module, None, after)
    return Run(emitted.data, emitted.targets, stages)


@pytest.fixture(scope="session")
def pipeline_run() -> Callable[[str, str], Run]:
    """A scene of `small_scenes.SCENES` with a projection, run once per session."""
    return _run


@pytest.fixture(params=list(SCENES))
def run(request: pytest.FixtureRequest) -> Run:
    """Each scene, projected by "clamp"."""
    return _run(request.param, "clamp")


@pytest.fixture(params=list(SCENES))
def unprojected(request: pytest.FixtureRequest) -> Run:
    """Each scene without projection."""
    return _run(request.param, "none")
