"""How many threads a GPU runs at once, and so how much memory the stacks of its kernels take.

A driver keeps, for each thread that could run at once, the largest stack (local memory) of all kernels that it loaded:
however few threads a kernel has, and however few its registers leave room for.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Residency:
    """multiprocessors: of a GPU; threads_each: how many threads one of them holds at most."""

    multiprocessors: int
    threads_each: int

    @property
    def threads(self) -> int:
        """That run at once at most."""
        return self.multiprocessors * self.threads_each

    def stack_memory(self, stack_bytes: int) -> int:
        """Bytes of the GPU's memory that stacks of so many bytes a thread take."""
        return self.threads * stack_bytes

    def describe_stacks(self, stack_bytes: int) -> str:
        """What they take, for people."""
        return (
            f"stacks of kernels take {self.stack_memory(stack_bytes) / 1e6:.0f} MB: {stack_bytes:,} bytes for each of "
            f"{self.threads:,} threads that can run at once"
        )


TYPICAL = {
    "sm_75": ("T4", Residency(40, 1024)),
    "sm_80": ("A100", Residency(108, 2048)),
    "sm_86": ("RTX 3090", Residency(82, 1536)),
    "sm_89": ("RTX 4090", Residency(128, 1536)),
    "sm_90": ("H100", Residency(132, 2048)),
    "sm_100": ("B200", Residency(148, 2048)),
    "sm_120": ("RTX 5090", Residency(170, 1536)),
}
"""A GPU of each architecture, as its maker describes it, for reports where there is none."""
