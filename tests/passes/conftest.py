"""Scenes run through the pipeline once, with what every stage said and meant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

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
    """The module after a pass."""

    text: str
    module: ModuleOp
    energy: float
    gradient: NDArray[np.float64] | None
    hessian: NDArray[np.float64] | None


@dataclass(frozen=True)
class Run:
    """A scene's way through the pipeline, and the derivatives that complex steps of its first stage give."""

    data: SceneData
    targets: list[str]
    stages: dict[str, Stage]
    gradient: NDArray[np.float64] = field(repr=False)
    hessian: NDArray[np.float64] = field(repr=False)

    @property
    def last(self) -> ModuleOp:
        """The module the backend gets."""
        return list(self.stages.values())[-1].module


@cache
def _run(scene: str, projection: str) -> Run:
    emitted = emit(SCENES[scene](projection))
    stages: dict[str, Stage] = {}

    def after(name: str, module: ModuleOp) -> None:
        copy = module.clone()
        interpreter = Interpreter(copy, emitted.data)
        derivatives = dense_assembly(copy, emitted.data) if interpreter.scene.derivatives else (None, None)
        stages[name] = Stage(text_of(module), copy, float(interpreter.total_energy()), *derivatives)

    run_pipeline(emitted.module, None, after)
    gradient = along_each_unknown(
        stages["frontend"].module, emitted.data, emitted.targets, lambda interpreter: interpreter.total_energy()
    )
    hessian = along_each_unknown(
        stages["differentiate"].module, emitted.data, emitted.targets, lambda interpreter: interpreter.assemble()[0]
    )
    return Run(emitted.data, emitted.targets, stages, gradient, hessian)


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
