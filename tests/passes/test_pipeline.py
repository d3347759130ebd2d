"""The pipeline as a whole: every pass keeps the meaning, every stage is text that parses back."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mat_bodies import relative_error
from small_scenes import SCENES, emit, soft_tets
from xdsl.parser import Parser

from yasps.dialects.mat import matrix_type
from yasps.dialects.mat.algebra import MatmulOp
from yasps.dialects.mat.base import dense
from yasps.dialects.mat.structure import ConstantOp
from yasps.passes.errors import CompileError
from yasps.passes.ir_text import text_of
from yasps.passes.pipeline import PIPELINE, Verifier, make_context, run_pipeline

DERIVED = ("differentiate", "project-psd", "prove-isotropy", "infer-indices", "lower-to-scalar", "outline-modules")
PROJECTED = DERIVED[1:]


def test_the_passes_are_those_of_the_architecture() -> None:
    assert [p.name for p in PIPELINE if p.name not in ("canonicalize", "cse")] == [
        "inline-references",
        "lift-constants",
        "fold-norms",
        *DERIVED,
    ]


def test_values_are_kept_by_every_pass(run: Any) -> None:
    first = run.stages["frontend"].energy
    assert np.isfinite(first)
    for name, stage in run.stages.items():
        assert abs(stage.energy - first) <= 1e-14 * abs(first), name


def test_gradients_are_the_derivative_of_the_energy_after_every_pass(run: Any) -> None:
    for name in DERIVED:
        assert relative_error(run.stages[name].gradient, run.gradient) < 1e-12, name


def test_hessians_are_the_derivative_of_the_gradient_after_every_pass(unprojected: Any) -> None:
    for name in DERIVED:
        assert relative_error(unprojected.stages[name].hessian, unprojected.hessian) < 1e-12, name


def test_projected_hessians_are_kept_by_every_pass(run: Any) -> None:
    wanted = run.stages["project-psd"].hessian
    for name in PROJECTED:
        found = run.stages[name].hessian
        assert relative_error(found, wanted) < 1e-12, name
        eigenvalues = np.linalg.eigvalsh(found)
        assert eigenvalues[0] > -1e-12 * eigenvalues[-1], name


def test_the_scenes_have_something_to_project(pipeline_run: Any) -> None:
    """Otherwise the tests of projection would test nothing."""
    for name in ("soft_tets", "mixed_union", "shared_targets"):
        assert np.linalg.eigvalsh(pipeline_run(name, "none").stages["differentiate"].hessian)[0] < -1e-3


@pytest.mark.slow
def test_every_stage_is_text_that_parses_verifies_and_prints_back(run: Any) -> None:
    texts = {stage.text: name for name, stage in run.stages.items()}  # each text once
    for text, name in texts.items():
        module = Parser(make_context(), text).parse_module()
        module.verify()
        assert text_of(module) == text, name


def test_compiling_twice_gives_the_same_text(run: Any, request: pytest.FixtureRequest) -> None:
    name = request.node.callspec.params["run"]
    emitted = emit(SCENES[name]())
    texts: dict[str, str] = {}
    run_pipeline(emitted.module, None, lambda stage, module: texts.update({stage: text_of(module)}))
    assert texts == {name: stage.text for name, stage in run.stages.items()}


@pytest.mark.slow
def test_the_text_does_not_depend_on_hashing(tmp_path: Path, pipeline_run: Any) -> None:
    """Sets and identities must not decide an order: another process with another hash seed gives the same text."""
    stages = pipeline_run("mixed_union", "clamp").stages
    source = tmp_path / "scene.mlir"
    source.write_text(stages["lift-constants"].text, encoding="utf-8")
    command = [sys.executable, "-c", "from yasps.passes.yasps_opt import main; main()", "-p", ",".join(DERIVED)]
    result = subprocess.run(
        [*command, str(source)],
        env={**os.environ, "PYTHONHASHSEED": "4711"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stdout.rstrip() == stages["outline-modules"].text.rstrip()


def test_dumps_are_numbered_files_of_every_stage(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "dump"
    module = run_pipeline(emit(soft_tets()).module, folder)
    names = [path.name for path in sorted(folder.iterdir())]
    assert names == [f"{k:02d}-{p}.mlir" for k, p in enumerate(["frontend", *(p.name for p in PIPELINE)])]
    assert (folder / names[-1]).read_text(encoding="utf-8") == text_of(module)


def test_user_locations_survive_to_the_first_dump() -> None:
    """Declarations know the line of Python that made them."""
    emitted = emit(soft_tets())
    locations = {str(op.location) for op in emitted.module.walk() if op.name in ("rel.attribute", "rel.storage")}
    assert any("small_scenes.py" in location for location in locations)


def test_the_garbage_collector_is_left_as_it_was() -> None:
    before = gc.get_threshold()
    run_pipeline(emit(soft_tets()).module)
    assert gc.get_threshold() == before


def test_an_operation_that_a_pass_breaks_is_found_beside_equal_ones_that_are_whole() -> None:
    module = emit(soft_tets()).module
    verifier = Verifier()
    verifier.verify(module, None)
    products = [op for op in module.walk() if isinstance(op, MatmulOp)]
    operand = products[0].operands[0]
    seven = matrix_type((7, 7))
    wider = ConstantOp.create(result_types=[seven], properties={"value": dense(np.eye(7), seven)})
    block = products[0].parent_block()
    assert block is not None
    block.insert_op_before(wider, products[0])
    products[0].operands[0] = wider.result
    with pytest.raises(CompileError, match=r"mat\.matmul"):
        verifier.verify(module, PIPELINE[0])
    products[0].operands[0] = operand
    verifier.verify(module, PIPELINE[0])
