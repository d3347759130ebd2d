"""Rows that the benchmarks `elements` and `cloth` have in common: yasps and peers on elements of one kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.array_peer import ArrayPeer
from benchmarks.element_problem import Elements, FloatArray, Problem, make_problem
from benchmarks.jax_elements import jax_elements
from benchmarks.kernel_problem import UNIT
from benchmarks.measure import Peer
from benchmarks.torch_elements import torch_elements

AGREEMENT = 1e-9  # relative; all work in float64
WHAT_ROWS_HOLD = (
    "structure: placement indices, sparsity and positions; once for each topology, in none of the other rows.",
    "gradient: gather, gradient, added to the global gradient.",
    "derived, stored: gather, gradient, local Hessian, written for each element by itself; no projection. yasps: a "
    "mesh whose elements share no vertex, upper triangle in 3x3 blocks, memory zeroed first. Peers: full.",
    "derived, assembled: gather, gradient, Hessian, added to the global gradient and block-sparse matrix, zeroed "
    "first; with several threads, private copies added up; no projection.",
    "projected (share), ...: the same with negative eigenvalues set to zero. yasps: of the Hessian in the linear cut "
    "(9x9 of a tet or hinge, 6x6 of a triangle), for the elements whose factorisation shows any (the share). Peers: "
    "eigh of each whole local Hessian.",
    "The elements to project lie scattered (noise at each vertex): 8 in a pack rarely are all fit or all unfit.",
)


class PeersDisagreeError(RuntimeError):
    """Two implementations of the same mathematics gave different numbers, so timing them means nothing."""


@dataclass(frozen=True)
class Contest:
    """The same elements for yasps (shared vertices, for several numbers of threads, and stored one by one) and peers.

    label: stands before each case. about_peers: how they ran, or that they are not there.
    """

    label: str
    assembled: list[Problem]
    stored: Problem
    peers: list[ArrayPeer]
    about_peers: list[str]

    @property
    def elements(self) -> Elements:
        """What all are of."""
        return self.assembled[0].elements

    def deform(self, amplitude: float) -> str:
        """Moves the vertices of all; returns the share of elements to project, as text."""
        for problem in [*self.assembled, self.stored]:
            problem.deform(amplitude)
        return f"{100 * self.assembled[-1].projected_share():.1f} %"

    def without_projection(self) -> list[Peer]:
        """Structure, gradient, and Hessians as they are, at rest but for the stretch."""
        peers = [self._peer(p, "structure", partial(_rebuild, p)) for p in self.assembled]
        peers += [self._peer(p, "gradient", partial(p.compiled.assemble, hessian=False)) for p in self.assembled]
        peers.append(self._peer(self.stored, "derived, stored", partial(self.stored.compiled.assemble, project=False)))
        x = self.elements.deformed(0.0)
        peers += [self._array_peer(peer, "derived, stored", partial(peer.derive, x)) for peer in self.peers]
        return peers + [
            self._peer(p, "derived, assembled", partial(p.compiled.assemble, project=False)) for p in self.assembled
        ]

    def with_projection(self, amplitude: float, share: str) -> list[Peer]:
        """Projected Hessians, as deformed now by this amplitude."""
        name = f"projected ({share})"
        peers = [self._peer(self.stored, f"{name}, stored", self.stored.compiled.assemble)]
        x = self.elements.deformed(amplitude)
        peers += [self._array_peer(peer, f"{name}, stored", partial(peer.derive_projected, x)) for peer in self.peers]
        return peers + [self._peer(p, f"{name}, assembled", p.compiled.assemble) for p in self.assembled]

    def _peer(self, problem: Problem, case: str, work: Callable[[], object]) -> Peer:
        scale = 1e9 / len(problem.elements)
        return Peer(self.label + case, "yasps", problem.threads, work, scale, UNIT)

    def _array_peer(self, peer: ArrayPeer, case: str, work: Callable[[], object]) -> Peer:
        return Peer(self.label + case, peer.name, 1, work, 1e9 / peer.count, UNIT)


PEERS: dict[str, Callable[..., ArrayPeer]] = {"jax": jax_elements, "torch": torch_elements}


def make_contest(label: str, elements: Elements, threads: Sequence[int], most_of_peers: int) -> Contest:
    """Compiles all. Raises PeersDisagreeError."""
    assembled = [make_problem(elements, count) for count in threads]
    stored = make_problem(elements.exploded(), 1)
    peers, about = [], []
    for package, make in PEERS.items():
        try:
            peer = make(elements, most_of_peers)
        except ImportError as error:
            about.append(
                f"No rows for {package}, which is not installed ({error}); to have them: pip install {package}"
            )
        else:
            about.append(_check_peer(peer, elements, stored))
            peers.append(peer)
    return Contest(label, assembled, stored, peers, about)


def _rebuild(problem: Problem) -> None:
    problem.compiled.connectivity_changed(problem.corners)
    problem.compiled.update_structure()


def _check_peer(peer: ArrayPeer, elements: Elements, stored: Problem) -> str:
    """Compares gradient and Hessian with yasps'; returns how the peer ran."""
    check_peer(peer, elements, stored)
    return (
        f"{peer.name} {peer.version}, float64, {peer.count:,} of the elements, told to use one processor: it kept "
        f"{peer.processors_busy(elements.deformed(0.1)):.2f} busy. Its gradient and Hessian agree with yasps'."
    )


def check_peer(peer: ArrayPeer, elements: Elements, stored: Problem) -> None:
    """Compares gradient and Hessian (times a vector) with yasps' on the first of the elements, stored one by one.

    Not compared: projections in the cut and in the positions give different, equally semidefinite matrices. Raises
    PeersDisagreeError.
    """
    width, count = 3 * elements.corners.shape[1], min(peer.count, len(stored.elements))
    stored.deform(0.1)
    gradient, hessian = peer.derive(elements.deformed(0.1))
    ours = stored.compiled.assemble(project=False).reshape(-1, width)[:count]
    check_close("gradient", peer.name, ours, gradient[:count])
    vector = np.random.default_rng(1).standard_normal(stored.compiled.static_matrix.size)
    product = stored.compiled.static_matrix.multiply(vector).reshape(-1, width)[:count]
    theirs = np.einsum("eij,ej->ei", hessian[:count], vector.reshape(-1, width)[:count])
    check_close("Hessian", peer.name, product, theirs)


def check_close(what: str, peer: str, ours: FloatArray, theirs: FloatArray) -> None:
    """Raises PeersDisagreeError when the largest difference is not small."""
    difference = float(np.abs(ours - theirs).max() / np.abs(theirs).max())
    if not difference < AGREEMENT:
        raise PeersDisagreeError(f"the {what} of yasps and of {peer} differ by {difference:.1e} of the largest entry")
