"""The benchmarks `elements` and `contacts` on a device: derivatives added to the global gradient and Hessian there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.array_peer import ArrayPeer
from benchmarks.contact_problem import close_pairs, union_scene
from benchmarks.element_problem import Elements, box_of_tets, elements_scene, first_of, make_problem, tets_of
from benchmarks.element_rows import PEERS, PeersDisagreeError, check_close, check_peer
from benchmarks.kernel_problem import bytes_per_element, on_cpu, projected_share
from benchmarks.measure import Peer, Report, Row, Settings, measure
from benchmarks.on_device import (
    DEVICE_NOTES,
    ON_DEVICE,
    Where,
    about_device,
    copy_bandwidth,
    device_peer,
    share_rows,
)
from yasps import Attribute, Connectivity, Scene
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.frontend.execution.cuda_scene import CudaScene
from yasps.meshes import read_tetrahedral_mesh
from yasps.runtime.device.protocol import Device, DeviceArray

SHARES = (0.0, 0.09, 0.33, 0.84)  # as in `elements`
TETS_TO_TUNE = 6_000  # enough to find the noise at which such a share of the tets needs projection
PEER_TETS = 100_000
COMPARED_TETS = 1_000
NOTES = (
    *DEVICE_NOTES,
    "gradient; derived (gradient and Hessian, no projection); projected (share of the instances that needed it): added "
    "to the global gradient and block-sparse matrix, zeroed first.",
    "whole call: with new positions copied to the GPU, and the gradient copied back.",
    "structure: placement indices, sparsity, positions; once for each topology.",
)
PEER_NOTE = (
    "each Hessian stored by itself, positions and results on the GPU; projection: eigh of each whole one. Its gradient "
    "and Hessian agree with yasps'."
)


@dataclass(frozen=True)
class Twins:
    """A scene with one energy on all processors and on a device; `count`: its instances."""

    label: str
    unit: str
    cpu: CpuScene
    gpu: CudaScene
    count: int
    threads: int

    @property
    def scale(self) -> float:
        """From seconds to ns for each instance."""
        return 1e9 / self.count

    def peers(self, case: str, *, hessian: bool = True, project: bool = True) -> list[Peer]:
        """The same assembly on both."""
        self.gpu.assemble()  # what was moved is copied here, not in what is timed
        return self.peers_of(
            case,
            partial(self.cpu.assemble, hessian=hessian, project=project),
            partial(self.gpu.launch_assembly, hessian=hessian, project=project),
        )

    def peers_of(self, case: str, ours: Callable[[], object], theirs: Callable[[], object]) -> list[Peer]:
        """Work of processors, then of the device."""
        name = f"{self.label}{case}"
        return [
            Peer(name, "yasps", self.threads, ours, self.scale, self.unit),
            device_peer(self.gpu.device, Peer(name, "yasps", ON_DEVICE, theirs, self.scale, self.unit)),
        ]

    def check(self) -> None:
        """Compares gradient and Hessian (times a vector). Raises PeersDisagreeError."""
        check_close("gradient", "yasps on the CPU", self.gpu.assemble(), self.cpu.assemble())
        vector = np.random.default_rng(1).standard_normal(self.cpu.static_matrix.size)
        x, y = (DeviceArray(self.gpu.device, np.float64, "a vector of a benchmark") for _ in range(2))
        self.gpu._solver.multiply([self.gpu.static_matrix], x.upload(vector), y)
        check_close("Hessian", "yasps on the CPU", y.download(), self.cpu.static_matrix.multiply(vector))

    def shares(self, bandwidth: Row, rows: Sequence[Row]) -> list[Row]:
        """How near those that make a Hessian come to the copy of all bytes they need."""
        moved = bytes_per_element(self.cpu) * self.count
        own = [row for row in rows if row.implementation == "yasps" and not row.case.endswith("gradient")]
        return share_rows(moved, bandwidth, own, self.scale)


def make_twins(label: str, unit: str, make: Callable[[Where], Scene], settings: Settings, device: Device) -> Twins:
    """Both compiled, their structures built, and seen to agree. Raises PeersDisagreeError."""
    cpu, gpu = on_cpu(make(settings.threads).compile()), make(device).compile()
    assert isinstance(gpu, CudaScene)
    (term,) = cpu._terms
    twins = Twins(label, unit, cpu, gpu, term.count, settings.threads)
    twins.check()
    return twins


# -- elements ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Moved:
    """Positions and corners of the scenes of `make_twins`, in the order in which they were made."""

    positions: list[Attribute]
    corners: list[Connectivity]

    def deform(self, x: np.ndarray) -> None:
        for position in self.positions:
            position.update_value(x)


def run_elements(settings: Settings, device: Device) -> Report:
    """Stable Neo-Hookean tets. Raises PeersDisagreeError."""
    tets = box_of_tets(settings.size) if settings.mesh is None else tets_of(read_tetrahedral_mesh(settings.mesh))
    moved = _Moved([], [])

    def make(where: Where) -> Scene:
        made = elements_scene(tets, where)
        made.position.update_value(tets.deformed(0.1))
        moved.positions.append(made.position)
        moved.corners.append(made.corners)
        return made.scene

    twins = make_twins("", "ns/element", make, settings, device)
    array_peers, about_peers = _array_peers(tets, "cuda")
    bandwidth = copy_bandwidth(device, settings.repeats)
    structure = measure(_structure(twins, moved), settings.repeats)
    moved.deform(tets.deformed(0.0))
    rows = measure(twins.peers("gradient", hessian=False), settings.repeats)
    x = tets.deformed(0.0)
    rows += measure(twins.peers("derived", project=False) + _stored(array_peers, x, "derived", False), settings.repeats)
    tuned = make_problem(box_of_tets(TETS_TO_TUNE), settings.threads)
    for wanted in SHARES:
        x = tets.deformed(tuned.amplitude_for(wanted))
        moved.deform(x)
        case = f"projected ({100 * projected_share(twins.cpu):.1f} %)"
        peers = twins.peers(case) + _stored(array_peers, x, case, True)

        def whole(k: int, x: np.ndarray = x) -> None:
            moved.positions[k].update_value(x)
            (twins.cpu, twins.gpu)[k].assemble()

        peers += twins.peers_of(f"{case}, whole call", partial(whole, 0), partial(whole, 1))
        rows += measure(peers, settings.repeats)
    shares = twins.shares(bandwidth, [row for row in rows if not row.case.endswith("whole call")])
    rows = [*structure, *rows, bandwidth, *shares]
    what = f"{len(tets):,} elements, {len(tets.vertices):,} vertices"
    return Report(rows, [*about_device(device, what, settings.repeats), *about_peers, *NOTES])


def _structure(twins: Twins, moved: _Moved) -> list[Peer]:
    def rebuild(k: int) -> None:
        scene = (twins.cpu, twins.gpu)[k]
        scene.connectivity_changed(moved.corners[k])
        scene.update_structure()

    return twins.peers_of("structure", partial(rebuild, 0), partial(rebuild, 1))


def _array_peers(tets: Elements, place: str) -> tuple[list[ArrayPeer], list[str]]:
    """JAX and PyTorch on the GPU, and what to say of them. Raises PeersDisagreeError."""
    peers, about = [], []
    stored = make_problem(first_of(tets, COMPARED_TETS).exploded(), 1)
    for package, make in PEERS.items():
        try:
            peer = make(tets, PEER_TETS, place)
            check_peer(peer, tets, stored)
            peer.resident(tets.deformed(0.1), True)()
        except PeersDisagreeError:
            raise
        except (ImportError, RuntimeError) as error:  # of a library that does not work here
            reason = " ".join(str(error).split())
            about.append(f"No rows for {package}: {reason[:300]}.")
        else:
            peers.append(peer)
            about.append(f"{peer.name} {peer.version}, float64, {peer.count:,} of the elements: {PEER_NOTE}")
    return peers, about


def _stored(peers: Sequence[ArrayPeer], x: np.ndarray, case: str, project: bool) -> list[Peer]:
    """What other libraries do on the GPU with these positions. They wait for it themselves."""
    return [
        Peer(f"{case}, stored", peer.name, ON_DEVICE, peer.resident(x, project), 1e9 / peer.count, "ns/element")
        for peer in peers
    ]


# -- contacts ----------------------------------------------------------------------------------------------


def run_contacts(settings: Settings, device: Device) -> Report:
    """Point-triangle barriers between free vertices and those of an affine body. Raises PeersDisagreeError."""
    pairs = close_pairs("point_triangle", settings.size)
    label = "point_triangle, free and affine: "
    twins = make_twins(label, "ns/pair", lambda where: union_scene(pairs, where), settings, device)
    bandwidth = copy_bandwidth(device, settings.repeats)
    peers = twins.peers("gradient", hessian=False) + twins.peers("derived", project=False)
    peers += twins.peers(f"projected ({100 * projected_share(twins.cpu):.1f} %)")
    rows = measure(peers, settings.repeats)
    rows += [bandwidth, *twins.shares(bandwidth, rows)]
    about = about_device(device, f"{len(pairs.pairs):,} pairs", settings.repeats)
    return Report(rows, [*about, "free and affine: as in the benchmark without --device.", *NOTES])
