"""Compiled scenes against the NumPy interpreter."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from mat_bodies import relative_error

from yasps import Scene
from yasps.backend.reference.interpreter import Interpreter
from yasps.frontend.execution.cpu_scene import CpuScene

TOLERANCE = 1e-12


def check(scene: Scene) -> CpuScene:
    """Values, gradient and projected Hessian of the machine code are the interpreter's, on the scene's numbers now."""
    compiled = scene.compile()
    interpreter = Interpreter(compiled.module, compiled.data())
    for name, found in compiled.energies().items():
        wanted = interpreter.value(name).ravel()
        assert found.shape == wanted.shape
        assert relative_error(found, wanted) < TOLERANCE, name
    gradient = compiled.assemble()
    hessian = (compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()).toarray()
    wanted_gradient, wanted_hessian = interpreter.assemble()
    assert relative_error(gradient, wanted_gradient) < TOLERANCE
    assert relative_error(hessian, wanted_hessian.toarray()) < TOLERANCE
    assert relative_error(hessian, hessian.T) < 1e-14  # diagonal blocks are stored whole
    return compiled


@pytest.fixture(scope="session")
def agrees_with_interpreter() -> Callable[[Scene], CpuScene]:
    """`check`: compiles a scene (again where it changed) and compares it with the reference."""
    return check
