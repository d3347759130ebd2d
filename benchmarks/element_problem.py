"""The problem of the benchmark `elements`: a box of stable Neo-Hookean tets, deformed as far as wanted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yasps import Scene
from yasps.frontend import materials
from yasps.frontend.attribute import Attribute
from yasps.frontend.compiled_scene import CompiledScene
from yasps.frontend.connectivity import Connectivity
from yasps.frontend.shapes import box
from yasps.runtime.assembly import Assembler, KernelCall

FloatArray = NDArray[np.float64]

YOUNGS_MODULUS, POISSON_RATIO = 5e4, 0.4  # Pa
# Stretched evenly by this much every tet has a semidefinite Hessian; noise then makes some indefinite.
STRETCH = 1.05
LARGEST_NOISE = 1.0  # in cells
BISECTIONS = 14


@dataclass(frozen=True)
class Tets:
    """Tets at rest and the noise that deforms them.

    vertices: [n, 3]; tets: int32 [m, 4]; inverse: inverse rest edges [m, 3, 3]; volume: [m]; noise: [n, 3], in -1 .. 1
    times the length of a cell.
    """

    vertices: FloatArray
    tets: NDArray[np.int32]
    inverse: FloatArray
    volume: FloatArray
    noise: FloatArray

    def deformed(self, amplitude: float) -> FloatArray:
        """Positions [n, 3]: an even stretch, and noise of this amplitude, independent at each vertex."""
        return STRETCH * self.vertices + amplitude * self.noise

    def exploded(self) -> Tets:
        """The same tets, none of which share a vertex: assembling them adds nothing up, it stores each by itself."""
        corners = self.tets.reshape(-1)
        own = np.arange(corners.size, dtype=np.int32).reshape(-1, 4)
        return Tets(self.vertices[corners], own, self.inverse, self.volume, self.noise[corners])


def box_of_tets(size: int) -> Tets:
    """A cube of about `size` tets, at least 6."""
    cells = max(1, round((size / 6) ** (1 / 3)))
    mesh = box(divisions=(cells, cells, cells))
    inverse, volume = materials.rest_shape(mesh.vertices, mesh.tets)
    noise = np.random.default_rng(0).uniform(-1.0, 1.0, mesh.vertices.shape) / cells
    return Tets(mesh.vertices, mesh.tets, inverse, volume, noise)


@dataclass(frozen=True)
class Problem:
    """The scene of these tets, with one energy and one target."""

    tets: Tets
    position: Attribute
    corners: Connectivity
    compiled: CompiledScene
    threads: int

    def deform(self, amplitude: float) -> None:
        """Moves the vertices."""
        self.position.update_value(self.tets.deformed(amplitude))

    def projected_share(self) -> float:
        """Share of the tets whose Hessian the assembler has to project as they are deformed now."""
        compiled = self.compiled
        compiled.assemble()
        (term,) = compiled._terms
        assert term.derivative is not None
        assert term.kappas is not None
        call = KernelCall(
            compiled.program.function(term.derivative, "derive"),
            compiled.program.arguments(term.derivative),
            term.count,
            term.kappas,
            term.positions,
        )
        matrix = compiled.static_matrix
        (status,) = Assembler(compiled.runtime).assemble([call], [matrix], np.zeros(matrix.size), matrix.block_size_at)
        return status.projected / term.count

    def amplitude_for(self, share: float) -> float:
        """The amplitude of noise at which about this share of the tets needs projection."""
        if share == 0:
            return 0.0
        low, high = 0.0, LARGEST_NOISE
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            self.deform(middle)
            low, high = (middle, high) if self.projected_share() < share else (low, middle)
        return high


@dataclass(frozen=True)
class TetsScene:
    """A scene of stable Neo-Hookean tets, nothing compiled yet."""

    scene: Scene
    position: Attribute
    corners: Connectivity


def tets_scene(tets: Tets, threads: int) -> TetsScene:
    """The scene of these tets, with one energy and one target."""
    scene = Scene("elements", threads=threads)
    body = scene.add_mesh("body")
    vertices = body.add_primitive("vertices", num_instances=len(tets.vertices))
    position = vertices.add_attribute("position", rows=3, cols=1, value=tets.vertices)
    elements = body.add_primitive("tets", num_instances=len(tets.tets))
    corners = elements.add_connectivity("corners", vertices, tets.tets, 4)
    deformation = materials.deformation_gradient(
        elements.add_attribute("positions", through=corners, source=position),
        elements.add_constant("rest_edges_inverse", rows=3, cols=3, value=tets.inverse),
    )
    mu, lam = materials.stable_neo_hookean_parameters(YOUNGS_MODULUS, POISSON_RATIO)
    energy = materials.stable_neo_hookean(
        deformation,
        body.add_constant("mu", rows=1, cols=1, value=mu),
        body.add_constant("lambda", rows=1, cols=1, value=lam),
        elements.add_constant("rest_volume", rows=1, cols=1, value=tets.volume),
    )
    scene.add_energy(elements.add_attribute("stable_neo_hookean", computed_attribute=energy))
    scene.add_minimize_target(position)
    return TetsScene(scene, position, corners)


def make_problem(tets: Tets, threads: int) -> Problem:
    """The scene, compiled and its structure built."""
    made = tets_scene(tets, threads)
    compiled = made.scene.compile()
    compiled.update_structure()
    return Problem(tets, made.position, made.corners, compiled, threads)
