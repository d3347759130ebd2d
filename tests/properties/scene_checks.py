"""What must hold for every scene: each pass keeps its meaning, and derivatives, indices and kernels are right."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray
from small_scenes import STEP, Emitted, emit
from xdsl.dialects.builtin import ModuleOp

from yasps import Scene
from yasps.backend.reference.interpreter import Interpreter, SceneData
from yasps.dialects.rel import name_of
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.passes.pipeline import run_pipeline
from yasps.runtime.core.library import Runtime
from yasps.runtime.device.protocol import Device

Array = NDArray[np.float64]
TOLERANCE = 1e-10
"""Of the largest entry."""
FEW = 6
"""Up to so many unknowns every one is stepped along; else as many random directions."""


def assert_close(found: Any, wanted: Any, what: str, tolerance: float = TOLERANCE) -> None:
    """Equal, relative to the largest entry (to 1 where all are smaller)."""
    found, wanted = np.asarray(found), np.asarray(wanted)
    if found.size == wanted.size == 0:
        return  # no unknowns
    assert found.shape == wanted.shape, f"{what}: shape {found.shape}, should be {wanted.shape}"
    assert np.isfinite(found).all(), f"{what}: not finite"
    scale = max(1.0, float(np.abs(wanted).max(initial=0.0)))
    error = float(np.abs(found - wanted).max(initial=0.0)) / scale
    assert error <= tolerance, f"{what}: off by {error:.1e} of the largest entry"


def directions(unknowns: int) -> Array:
    """[unknowns, directions]: each unknown, or random ones."""
    if unknowns <= FEW:
        return np.eye(unknowns)
    return np.random.default_rng(0).standard_normal((unknowns, FEW))


def stepped(emitted: Emitted, direction: Array) -> SceneData:
    """The numbers, a complex step along the direction."""
    storages, start = dict(emitted.data.storages), 0
    for target in emitted.targets:
        values = storages[target]
        part = direction[start : start + values.size].reshape(values.shape)
        storages[target] = values + 1j * STEP * part
        start += values.size
    return dataclasses.replace(emitted.data, storages=storages)


def stages_of(scene: Scene) -> tuple[Emitted, dict[str, ModuleOp]]:
    """The module after every pass."""
    emitted = emit(scene)
    modules: dict[str, ModuleOp] = {}
    run_pipeline(emitted.module, None, lambda name, module: modules.update({name: module.clone()}))
    return emitted, modules


def unprojected(module: ModuleOp) -> ModuleOp:
    """A copy whose energies are not projected."""
    copy = module.clone()
    for op in copy.walk():
        if op.name in ("rel.energy", "rel.derivative"):
            op.properties["projection"] = type(op.properties["projection"])("none")  # type: ignore[call-arg]
    return copy


def assemble(module: ModuleOp, data: SceneData) -> tuple[Array, Array]:
    """Gradient and dense Hessian by the interpreter."""
    gradient, hessian = Interpreter(module, data).assemble()
    return gradient, hessian.toarray()


def check_passes(scene: Scene) -> None:
    """No compiler needed: every stage against complex steps and against the stage before."""
    emitted, modules = stages_of(scene)
    data = emitted.data
    energy = Interpreter(modules["frontend"], data).total_energy()
    for stage, module in modules.items():
        assert_close(Interpreter(module, data).total_energy(), energy, f"energy after {stage}", 1e-13)

    frontend, differentiated = modules["frontend"], modules["differentiate"]
    gradient, plain = assemble(unprojected(differentiated), data)
    along = directions(len(gradient))
    moved = [stepped(emitted, direction) for direction in along.T]
    slopes = [np.imag(Interpreter(frontend, numbers).total_energy()) / STEP for numbers in moved]
    assert_close(along.T @ gradient, slopes, "gradient against complex steps of the energy")
    bends = [Interpreter(differentiated, numbers).gradient().imag / STEP for numbers in moved]
    assert_close((plain @ along).T, bends, "Hessian against complex steps of the gradient")
    assert_close(plain, plain.T, "symmetry of the Hessian")

    modes = {energy.projection.data for energy in Interpreter(frontend, data).scene.energies}
    projected: Array | None = None
    for stage in list(modules)[list(modules).index("differentiate") :]:
        found_gradient, found = assemble(modules[stage], data)
        assert_close(found_gradient, gradient, f"gradient after {stage}", 1e-12)
        if modes == {"none"}:
            assert_close(found, plain, f"Hessian after {stage}", 1e-12)
        if stage == "project-psd":
            projected = found
        elif projected is not None:
            assert_close(found, projected, f"Hessian after {stage}")
    assert projected is not None
    check_projection(projected, plain, modes)
    check_indices(Interpreter(modules["infer-indices"], data))
    check_indices(Interpreter(modules["outline-modules"], data))


def check_projection(projected: Array, plain: Array, modes: set[str]) -> None:
    """Positive semi-definite where all energies are projected; and projection only ever adds."""
    assert_close(projected, projected.T, "symmetry of the projected Hessian")
    if not projected.size:
        return
    scale = max(1.0, float(np.abs(projected).max()))
    if "none" not in modes:
        assert np.linalg.eigvalsh(projected)[0] >= -1e-12 * scale, "the projected Hessian has a negative eigenvalue"
    assert np.linalg.eigvalsh(projected - plain)[0] >= -1e-11 * scale, "projection took something away"


def check_indices(interpreter: Interpreter) -> None:
    """kappa names exactly blocks of unknowns, and all that the inputs of an energy depend on."""
    starts: dict[int, int] = {}
    for target in interpreter.scene.targets:
        size = interpreter.scene.size(target)
        first = interpreter.starts[target]
        starts |= {first + k * size: size for k in range(len(interpreter.data.storages[target]))}
    for derivative in interpreter.scene.derivatives:
        assert derivative.indices is not None
        kappa = interpreter.value(name_of(derivative.indices))
        count = interpreter.count(derivative)
        inputs = interpreter.stacked_inputs(derivative, count)
        width = inputs.shape[0] // max(count, 1)
        for instance in range(count):
            places = [int(k) - 1 for k in kappa[instance].ravel() if k]
            assert all(place in starts for place in places), f"{derivative.symbol}: {places} are no blocks"
            covered = {place + k for place in places for k in range(starts[place])}
            rows = inputs[instance * width : (instance + 1) * width]
            reached = set(rows.nonzero()[1].tolist())
            assert reached <= covered, f"{derivative.symbol}, instance {instance}: kappa lacks {reached - covered}"


def check_kernels(scene: Scene, runtime: Runtime) -> CpuScene:
    """Machine code against the interpreter, and against complex steps where nothing is projected."""
    scene._runtime = runtime
    compiled = scene.compile()
    emitted = dataclasses.replace(emit(scene), data=compiled.data())
    interpreter = Interpreter(compiled.module, emitted.data)
    assert_close(compiled.total_energy(), interpreter.total_energy(), "energy of the kernels", 1e-12)
    gradient = compiled.assemble()
    hessian = (compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()).toarray()
    wanted_gradient, wanted = assemble(compiled.module, emitted.data)
    assert_close(gradient, wanted_gradient, "gradient of the kernels")
    assert_close(hessian, wanted, "Hessian of the kernels")
    assert_close(compiled.assemble(hessian=False), gradient, "gradient alone")
    if all(term.projection == "none" for term in scene._energies):
        along = directions(len(gradient))
        moved = [stepped(emitted, direction) for direction in along.T]
        bends = [Interpreter(compiled.module, numbers).gradient().imag / STEP for numbers in moved]
        assert_close((hessian @ along).T, bends, "Hessian of the kernels against complex steps")
    return compiled


def check_device_kernels(scene: Scene, device: Device) -> None:
    """The text of device code, and all around it, against the interpreter."""
    scene._device_name = device
    compiled = scene.compile()
    emitted = dataclasses.replace(emit(scene), data=compiled.data())
    interpreter = Interpreter(compiled.module, emitted.data)
    assert_close(compiled.total_energy(), interpreter.total_energy(), "energy of the device's kernels", 1e-12)
    wanted_gradient, wanted = assemble(compiled.module, emitted.data)
    gradient = compiled.assemble()
    assert_close(gradient, wanted_gradient, "gradient of the device's kernels")
    assert_close(compiled.hessian().to_scipy().toarray(), wanted, "Hessian of the device's kernels")
    assert_close(compiled.assemble(hessian=False), wanted_gradient, "gradient alone")
