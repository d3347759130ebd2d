"""The benchmarks that run no kernel: operation counts, symbolic times and code growth."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from small_scenes import emit

from benchmarks import codegrowth, opcounts, symbolic
from benchmarks.__main__ import main
from benchmarks.codegrowth import affine, cage, free, growth, lever
from benchmarks.element_problem import box_of_tets, elements_scene
from benchmarks.energies import ENERGIES
from benchmarks.large_energies import LARGE_ENERGIES, LargeEnergy
from yasps.backend.reference.interpreter import Interpreter
from yasps.passes.pipeline import run_pipeline

needs_sympy = pytest.mark.skipif(importlib.util.find_spec("sympy") is None, reason="SymPy is not installed")


# -- operation counts --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ENERGIES)
def test_energies_are_regular_at_their_numbers(name: str) -> None:
    energy = ENERGIES[name]
    module, data = opcounts.compiled(energy.scene(energy.numbers(), projection="none"))
    gradient, hessian = Interpreter(module, data).assemble()
    assert len(gradient) == sum(rows * cols for rows, cols in energy.variables.values())
    assert np.isfinite(hessian.toarray()).all()
    assert np.abs(gradient).max() > 0


def test_operations_of_a_squared_length() -> None:
    """k |x|^2 in three unknowns: 2 k, then a product for each entry of the gradient; the Hessian is 2 k."""
    from yasps import Scene

    scene = Scene("s", threads=1)
    points = scene.add_mesh("m").add_primitive("p", 1)
    x, k = points.add_attribute("x", 3, 1), points.add_constant("k", 1, 1)
    scene.add_energy(points.add_attribute("e", computed_attribute=k * x.dot(x)), projection="none")
    scene.add_minimize_target(x)
    module, _ = opcounts.compiled(scene)
    assert dict(opcounts.operations(module)) == {"mul": 4}


@needs_sympy
def test_operations_of_sympy_expressions() -> None:
    import sympy as sp

    x, y, z = sp.symbols("x y z")
    count = opcounts.sympy_operations
    assert count([x * y + z - 1]) == {"mul": 1, "add": 2}
    assert count([x - y, -x]) == {"add": 1, "neg": 1}
    assert count([x**2, x**3, x**5]) == {"mul": 1 + 2 + 3}
    assert count([x / y, 1 / y]) == {"div": 2}
    assert count([x / (y * z)]) == {"div": 1, "mul": 1}
    assert count([sp.sqrt(x), 1 / sp.sqrt(x), x ** sp.Rational(3, 2)]) == {"sqrt": 3, "div": 1, "mul": 1}
    assert count([sp.log(x + y), -2 * x]) == {"log": 1, "add": 1, "mul": 1}


@needs_sympy
@pytest.mark.parametrize("name", ["point_point", "with sum for det, F", "Baraff-Witkin, F", "affine orthogonality"])
def test_yasps_agrees_with_sympy_and_needs_no_more(name: str) -> None:
    from benchmarks import sympy_energies

    energy = ENERGIES[name]
    replacements, reduced = sympy_energies.derivatives(name)
    opcounts.check_agreement(name, energy, energy.numbers(), replacements, reduced)
    ours = opcounts.operations(opcounts.compiled(energy.scene(energy.numbers()))[0]).total()
    theirs = opcounts.sympy_operations([e for _, e in replacements] + reduced).total()
    assert ours <= theirs


@needs_sympy
def test_disagreement_is_told() -> None:
    from benchmarks import sympy_energies

    replacements, reduced = sympy_energies.derivatives("point_point")
    reduced[3] = 1.001 * reduced[3]
    energy = ENERGIES["point_point"]
    with pytest.raises(ValueError, match="point_point: derivatives of yasps and SymPy differ"):
        opcounts.check_agreement("point_point", energy, energy.numbers(), replacements, reduced)


def test_counts_without_sympy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "sympy", None)
    monkeypatch.delitem(sys.modules, "benchmarks.sympy_energies", raising=False)
    monkeypatch.setattr(opcounts, "ENERGIES", {"point_point": ENERGIES["point_point"]})
    path = tmp_path / "rows.json"
    assert main(["opcounts", "--json", str(path)]) == 0
    assert "SymPy, which is not installed" in capsys.readouterr().out
    rows = json.loads(path.read_text())
    assert {row["implementation"] for row in rows} == {"yasps"}
    by_unit = {row["unit"]: row["value"] for row in rows}
    assert by_unit["operations"] == sum(value for unit, value in by_unit.items() if unit != "operations")


# -- symbolic times ----------------------------------------------------------------------------------------


def test_every_stage_is_timed() -> None:
    seconds = symbolic.stages(elements_scene(box_of_tets(6), 1).scene)
    assert next(iter(seconds)) == "frontend"
    assert {"differentiate", "project-psd", "lower-to-scalar", "outline-modules"} <= set(seconds)
    assert all(value >= 0 for value in seconds.values())


# -- code growth -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [affine, cage, lever])
def test_code_grows_by_the_same_with_every_parameterisation(kind: codegrowth.Parameterisation) -> None:
    """Second differences are zero: no kernel for any combination."""
    sizes = [growth((free, *[kind] * count)) for count in (1, 2, 3)]
    for values in ([size.lines for size in sizes], [size.objects for size in sizes]):
        steps = np.diff(values)
        assert steps[0] > 0
        assert np.all(steps == steps[0])
    assert all(size.derivatives == 1 for size in sizes)
    assert len({size.largest_array for size in sizes}) == 1


def test_different_parameterisations_add_up() -> None:
    """What affine bodies and cages add to free vertices is independent; levers change the kernel, once.

    A union of free vertices alone has no object.
    """
    of_union = 1
    base, one, other, both = (growth(p) for p in ((free,), (free, affine), (free, cage), (free, affine, cage)))
    # Not quite equal: the union pads placement indices of the narrower with zeros.
    assert both.lines - base.lines <= (one.lines - base.lines) + (other.lines - base.lines)
    alone = [size.objects - base.objects - of_union for size in (one, other)]
    assert both.objects - base.objects - of_union == sum(alone)
    assert base.largest_array == both.largest_array
    curved, more = growth((free, lever)), growth((free, affine, cage, lever))
    assert more.derivatives == 1
    assert more.objects - curved.objects == sum(alone)


# -- large energies ----------------------------------------------------------------------------------------


@pytest.mark.nightly
@pytest.mark.parametrize("energy", LARGE_ENERGIES, ids=lambda energy: energy.make.__name__)
def test_large_energies_are_regular_at_their_numbers(energy: LargeEnergy) -> None:
    emitted = emit(energy.make(energy.sizes[0]))
    gradient, hessian = Interpreter(run_pipeline(emitted.module), emitted.data).assemble()
    assert np.isfinite(gradient).all()
    assert np.isfinite(hessian.toarray()).all()
    assert np.abs(gradient).max() > 1e-3


@pytest.mark.nightly
def test_compile_growth_has_rows_of_all_stages(tmp_path: Path) -> None:
    assert main(["compile_growth", "--size", "1", "--json", str(tmp_path / "rows.json")]) == 0
    rows = {row["case"]: row["value"] for row in json.loads((tmp_path / "rows.json").read_text())}
    assert {case.partition(": ")[0] for case in rows} == {"rod", "rotation vector", "hexahedron by Gauss points"}
    for stage in ("symbolic", "emission", "C++", "cold", "warm"):
        assert rows[f"rod: {stage}, processor time"] > 0
