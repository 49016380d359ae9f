"""Several processes that train one network: each has its own pictures, all take the same step.

On a CPU two processes of one thread are faster than one process of two threads, because they meet once a step and not
in every layer. Batch normalisation looks at the pictures of its own process, so a step of N processes of batch B is
that of one process of batch N B except for those statistics.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import torch
import torch.distributed as dist
from torch import nn

T = TypeVar("T")


@dataclass(frozen=True)
class Team:
    """This process's number and how many there are."""

    rank: int = 0
    size: int = 1

    @staticmethod
    def join() -> Team:
        """The team that the environment describes, as `launch` and torchrun write it there; else a team of one."""
        if not Team.gathered():
            return Team()
        if not dist.is_initialized():
            dist.init_process_group("gloo")
        return Team(dist.get_rank(), dist.get_world_size())

    @staticmethod
    def gathered() -> bool:
        """Whether this process was started as one of a team."""
        return "WORLD_SIZE" in os.environ

    @property
    def leads(self) -> bool:
        """Whether this process writes the files and shows the progress."""
        return self.rank == 0

    def batch(self, step: int) -> int:
        """Number of the batch that this process takes at `step`: no two processes ever take the same."""
        return step * self.size + self.rank

    def leader_first(self, make: Callable[[], T]) -> T:
        """What `make` makes in each process, in the leader before the others: it may write files that they read."""
        if self.size > 1 and not self.leads:
            dist.barrier()
        made = make()
        if self.size > 1 and self.leads:
            dist.barrier()
        return made

    def average_gradients(self, network: nn.Module) -> None:
        """Replaces every gradient by its mean over the processes."""
        if self.size == 1:
            return
        gradients = [p.grad for p in network.parameters() if p.grad is not None]
        flat = torch.cat([g.reshape(-1) for g in gradients])
        dist.all_reduce(flat)
        flat /= self.size
        for gradient, part in zip(gradients, flat.split([g.numel() for g in gradients]), strict=True):
            gradient.copy_(part.view_as(gradient))


def launch(processes: int, command: Sequence[str]) -> None:
    """Runs `command` in a team of `processes` on this machine, which import from where this one does; when one of them
    fails, the others are ended.

    Raises `ChildProcessError` naming the first process that failed; what it printed says why.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    shared = {**os.environ, "WORLD_SIZE": str(processes), "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port)}
    shared["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    team = [subprocess.Popen(command, env={**shared, "RANK": str(rank)}) for rank in range(processes)]
    try:
        while None in (codes := [member.poll() for member in team]) or any(codes):
            for rank, code in enumerate(codes):
                if code:
                    raise ChildProcessError(f"process {rank} of {processes}: expected it to finish, it ended with {code}")
            time.sleep(0.1)
    finally:
        for member in team:
            if member.poll() is None:
                member.terminate()
        for member in team:
            member.wait()
        signal.signal(signal.SIGTERM, before)
