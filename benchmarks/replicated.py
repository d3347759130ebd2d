"""One element many times over, as in the paper's figures 25 and 26: gradient and Hessian of each by itself, by yasps,
SymPy with `cse` as a loop in C, and JAX."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from benchmarks.element_problem import FloatArray
from benchmarks.element_rows import check_close
from benchmarks.energies import ENERGIES, Energy, Numbers
from benchmarks.jax_elements import one_processor
from benchmarks.kernel_problem import on_cpu
from benchmarks.measure import Peer, Report, Row, Settings, measure
from benchmarks.plots import Bars
from benchmarks.sympy_kernel import statements
from yasps import Scene
from yasps.frontend.commands.environment_report import cpu_model
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, find_compiler, link
from yasps.runtime.core.library import available_processors

DESCRIPTION = "the paper's figures 25 and 26: derivatives of one element by yasps, SymPy and JAX, and what det costs"
DEFAULT_SIZE = 50_000
UNIT = "ns/element"
WITH_DET, WITH_SUM = "stable Neo-Hookean, x", "with sum for det, x"
CHOSEN: Final = ("point_point", "affine orthogonality", "Baraff-Witkin, x", WITH_SUM, WITH_DET)
PAPER_DET: Final = 5.0  # %, of YASPS
AGREEMENT_POINT = 3
NOTES = (
    "--size N: elements, each with vertices of its own, so that nothing is added up; all have numbers of their own.",
    "yasps: gather, gradient, Hessian (not projected), in packs of 8, stored block by block in the upper triangle of a "
    "block-sparse matrix; an affine body has one whole block of 9 x 9. SymPy: diff of each entry, cse of all, compiled "
    "by the same compiler with the same flags, one element after another; gradient and upper triangle stored. JAX: "
    "jit(vmap(hessian)), one processor, full matrices. All in float64, and in processor time; derivatives agree with "
    "yasps' before they are timed.",
    "over yasps: time divided by yasps' of the same energy, figure 25. The paper gives no numbers, but that YASPS, on "
    "a GPU, matches the others and in some cases outperforms them, the more so the more complex the energy.",
    "cost of det: of the time with det(F), the share that goes if the sum of F's entries stands for it, figure 26. The "
    f"paper: {PAPER_DET:g} % for YASPS, a major boost for the others.",
)


# JAX need not be installed: its modules and arrays are `Any`.
def _solid(jnp: Any, v: Mapping[str, Any], *, determinant: bool) -> Any:
    x = v["x"]
    f = (x[1:] - x[0]).T @ v["inverse"]
    stretch = jnp.sum(f * f)
    volume = jnp.dot(f[0], jnp.cross(f[1], f[2])) if determinant else jnp.sum(f)
    dilation = volume - (1 + 0.75 * v["mu"] / v["lam"])
    return v["volume"] * (0.5 * v["mu"] * (stretch - 3 - jnp.log(stretch + 1)) + 0.5 * v["lam"] * dilation * dilation)


def _cloth(jnp: Any, v: Mapping[str, Any]) -> Any:
    x = v["x"]
    f = (x[1:] - x[0]).T @ v["inverse"]
    a, b = f[:, 0], f[:, 1]
    stretch = (jnp.sqrt(a @ a) - 1) ** 2 + (jnp.sqrt(b @ b) - 1) ** 2
    return v["area"] * (v["stretch"] * stretch + v["shear"] * (a @ b) ** 2)


def _points(jnp: Any, v: Mapping[str, Any]) -> Any:
    d = v["x"][1] - v["x"][0]
    squared = d @ d
    return v["weight"] * v["stiffness"] * (squared - v["reach"]) ** 2 * jnp.log(squared / v["reach"]) ** 2


def _affine(jnp: Any, v: Mapping[str, Any]) -> Any:
    strain = v["a"].T @ v["a"] - jnp.eye(3)
    return 0.5 * v["stiffness"] * jnp.sum(strain * strain)


JAX_ENERGIES: Final[Mapping[str, Callable[[Any, Mapping[str, Any]], Any]]] = MappingProxyType(
    {
        "point_point": _points,
        "affine orthogonality": _affine,
        "Baraff-Witkin, x": _cloth,
        WITH_DET: lambda jnp, v: _solid(jnp, v, determinant=True),
        WITH_SUM: lambda jnp, v: _solid(jnp, v, determinant=False),
    }
)


@dataclass(frozen=True)
class Replicated:
    """Many elements of one energy, each with unknowns and numbers of its own, [n, rows, cols] by name."""

    name: str
    energy: Energy
    numbers: Numbers
    compiled: CpuScene

    @property
    def count(self) -> int:
        """Elements."""
        return len(next(iter(self.numbers.values())))

    @property
    def width(self) -> int:
        """Unknowns of an element."""
        return sum(rows * cols for rows, cols in self.energy.variables.values())

    def derivatives(self) -> FloatArray:
        """yasps' gradient, then the upper triangle of the Hessian, [n, width + width (width + 1) / 2]."""
        gradient = self.compiled.assemble(project=False).reshape(self.count, self.width)
        whole = self.compiled.static_matrix.to_scipy().tobsr((self.width, self.width)).data
        return np.hstack([gradient, whole[:, *np.triu_indices(self.width)]])


def replicated(name: str, count: int) -> Replicated:
    """That many elements with regular numbers."""
    energy = ENERGIES[name]
    numbers = energy.numbers(AGREEMENT_POINT, count)
    compiled = on_cpu(_scene(energy, numbers, count).compile())
    compiled.update_structure()
    return Replicated(name, energy, numbers, compiled)


def _scene(energy: Energy, numbers: Numbers, count: int) -> Scene:
    """As in a mesh, positions belong to vertices, here to those of one element each; other variables to elements."""
    scene = Scene("replicated", threads=1)
    mesh = scene.add_mesh("mesh")
    element = mesh.add_primitive("element", count)
    values, targets = {}, []
    for name, (rows, cols) in energy.variables.items():
        if name == "x":
            vertices = mesh.add_primitive("vertices", rows * count)
            target = vertices.add_attribute("position", 3, 1, value=numbers[name].reshape(-1, 3))
            corners = element.add_connectivity("corners", vertices, np.arange(rows * count).reshape(-1, rows), rows)
            values[name] = element.add_attribute("x", through=corners, source=target)
        else:
            target = values[name] = element.add_attribute(name, rows, cols, value=numbers[name])
        targets.append(target)
    for name, shape in energy.constants.items():
        values[name] = element.add_constant(name, *shape, value=numbers[name])
    scene.add_energy(element.add_attribute("energy", computed_attribute=energy.expression(values)))
    scene.add_minimize_target(targets)
    return scene


def run(settings: Settings) -> Report:
    """Times all. Raises PeersDisagreeError."""
    compiler = find_compiler()
    about: list[str] = []
    peers: list[Peer] = []
    for name in CHOSEN:
        problem = replicated(name, settings.size)
        expected = problem.derivatives()
        work = {"yasps": lambda problem=problem: problem.compiled.assemble(project=False)}
        for who, make in {"SymPy": lambda p: sympy_loop(p, compiler), "JAX": jax_loop}.items():
            try:
                peer = make(problem)
            except ImportError as error:
                about.append(f"No rows for {who}: {error}")
                continue
            check_close(f"derivatives of {name}", who, expected, peer())
            work[who] = peer
        peers += [Peer(name, who, 1, do, 1e9 / settings.size, UNIT) for who, do in work.items()]
    # All in turn: with and without det, too, are compared.
    rows = measure(peers, settings.repeats, time.process_time)
    own = {row.case: row.value for row in rows if row.implementation == "yasps"}
    rows += [
        Row(f"{row.case}: over yasps", row.implementation, 1, row.value / own[row.case], "times")
        for row in rows
        if row.implementation != "yasps"
    ]
    rows += det_rows(rows)
    rows.append(Row("cost of det", "the paper, YASPS", 0, PAPER_DET, "%"))
    machine = f"{settings.size:,} elements; {cpu_model()}, {available_processors()} processors; {compiler.version}."
    return Report(rows, [machine, *dict.fromkeys(about), *NOTES], _plots(rows))


def det_rows(rows: Sequence[Row]) -> list[Row]:
    """Figure 26: what of the time with a determinant it takes."""
    time_of = {(row.case, row.implementation): row.value for row in rows if row.unit == UNIT}
    return [
        Row("cost of det", who, 1, 100 * (1 - time_of[WITH_SUM, who] / value), "%")
        for (case, who), value in time_of.items()
        if case == WITH_DET
    ]


def _plots(rows: Sequence[Row]) -> list[Bars]:
    time_of = {(row.case, row.implementation): row.value for row in rows if row.unit == UNIT}
    who = list(dict.fromkeys(implementation for _, implementation in time_of))
    over = {one: [time_of[name, one] / time_of[name, "yasps"] for name in CHOSEN] for one in who}
    cost = [row for row in rows if row.case == "cost of det"]
    return [
        Bars("figure_25", "Gradient and Hessian of one element", "time over yasps'", CHOSEN, over, log=True),
        Bars(
            "figure_26",
            "What the determinant costs",
            "% of the time of a stable Neo-Hookean tet",
            [row.implementation for row in cost],
            {"share of det": [row.value for row in cost]},
        ),
    ]


_LOOP = """\
#include <cmath>
static void derive(const double* in, double* out) {
@BODY@
}
extern "C" void sympy_elements(long count, const double* in, double* out) {
    for (long k = 0; k < count; ++k) derive(in + @READ@ * k, out + @WRITTEN@ * k);
}
"""


def sympy_loop(problem: Replicated, compiler: Compiler) -> Callable[[], FloatArray]:
    """A function that has SymPy's code derive all elements. Raises ImportError."""
    energies = import_module("benchmarks.sympy_energies")
    replacements, reduced = energies.derivatives(problem.name)
    shapes = problem.energy.variables | problem.energy.constants
    names = [f"{name}_{i}_{j}" for name, (rows, cols) in shapes.items() for i in range(rows) for j in range(cols)]
    body = [f"    const double {name} = in[{k}];" for k, name in enumerate(names)] + statements(replacements, reduced)
    text = _LOOP.replace("@BODY@", "\n".join(body)).replace("@READ@", str(len(names)))
    source = Source("benchmark.sympy_elements", text.replace("@WRITTEN@", str(len(reduced))))
    function = ctypes.CDLL(str(link(compile_sources([source], compiler), compiler, ("-lm",)).path)).sympy_elements
    function.argtypes = (ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p)
    function.restype = None
    given = np.hstack([problem.numbers[name].reshape(problem.count, -1) for name in shapes])
    out = np.empty((problem.count, len(reduced)))

    def derive() -> FloatArray:
        function(problem.count, given.ctypes.data, out.ctypes.data)
        return out

    return derive


def jax_loop(problem: Replicated) -> Callable[[], FloatArray]:
    """A function that has JAX derive all elements. Raises ImportError."""
    with one_processor():
        jax: Any = import_module("jax")
        jnp: Any = import_module("jax.numpy")
        jax.config.update("jax_enable_x64", True)
        (variable, shape), *_ = problem.energy.variables.items()
        constants = {name: jnp.asarray(problem.numbers[name]) for name in problem.energy.constants}

        def energy(flat: Any, own: Mapping[str, Any]) -> Any:
            numbers = {name: value[0, 0] if value.shape == (1, 1) else value for name, value in own.items()}
            return JAX_ENERGIES[problem.name](jnp, {variable: flat.reshape(shape), **numbers})

        def derivatives(x: Any, own: Mapping[str, Any]) -> tuple[Any, Any]:
            return jax.vmap(jax.grad(energy))(x, own), jax.vmap(jax.hessian(energy))(x, own)

        x = jnp.asarray(problem.numbers[variable].reshape(problem.count, -1))
        compiled = jax.jit(derivatives).lower(x, constants).compile()

    upper = np.triu_indices(problem.width)
    first = True

    def derive() -> FloatArray:
        nonlocal first
        gradient, hessian = jax.block_until_ready(compiled(x, constants))
        if not first:
            return np.empty(0)  # what it takes to bring results into our form is not JAX's time
        first = False
        return np.hstack([np.asarray(gradient), np.asarray(hessian)[:, *upper]])

    return derive
