"""Several processes that train one policy: their settings from ``torchrun``, and their communication.

Each process steps worlds of its own; gradients, normalisers, learning rate and statistics are averaged or summed over
all, so that parameters stay equal. NCCL carries this between GPUs, gloo between CPUs.
"""

from __future__ import annotations

import atexit
import dataclasses
import math
import os
from typing import Any, Final

import torch
from torch import distributed

from simwarp.core.threads import thread_count
from simwarp.tasks import InputError, resolve_device

_SHUTDOWN_TIME: Final = 30.0
"""Time that ``torchrun`` leaves by default between a signal and SIGKILL [s]."""


@dataclasses.dataclass(frozen=True)
class Processes:
    """The processes of a run.

    Attributes:
        rank: index of this process, from 0.
        local_rank: its index on its machine.
        count: number of processes.
        local_count: number of those on its machine.
    """

    rank: int = 0
    local_rank: int = 0
    count: int = 1
    local_count: int = 1

    @property
    def several(self) -> bool:
        """True if there is more than one process."""
        return self.count > 1

    @property
    def first(self) -> bool:
        """True for the process that writes the run folder and the messages."""
        return self.rank == 0

    def device(self, name: str) -> str:
        """Return the device of this process; of several on one machine, each gets the GPU of its number."""
        if not self.several:
            return resolve_device(name)
        gpu = name.startswith("cuda") or (name == "auto" and torch.cuda.is_available())
        return resolve_device(f"cuda:{self.local_rank}" if gpu else name)

    def threads(self, asked: int | None) -> int:
        """Return the number of threads of each process: what was asked for, or a fair share of the first's processors.

        All processes must call this together, once they are connected.

        Raises:
            ModelError: SIMWARP_THREADS is no number of threads.
        """
        number: int = self.gather(thread_count(asked, processes=self.local_count))[0]
        return number

    def rsl_rl(self) -> dict[str, int] | None:
        """Return rsl-rl's description of the same; None for a single process."""
        if not self.several:
            return None
        return {"global_rank": self.rank, "local_rank": self.local_rank, "world_size": self.count}

    def sums(self, values: dict[str, float], device: str) -> dict[str, float]:
        """Return each value summed over all processes; all must have the same names."""
        if not self.several:
            return values
        total = torch.tensor(list(values.values()), dtype=torch.float64, device=device)
        distributed.all_reduce(total)
        return dict(zip(values, total.tolist(), strict=True))

    def gather(self, value: Any) -> list[Any]:
        """Return the values of all processes, by rank."""
        if not self.several:
            return [value]
        values: list[Any] = [None] * self.count
        distributed.all_gather_object(values, value)
        return values


def processes() -> Processes:
    """Return the settings of ``torchrun`` in the environment; a single process without it.

    Raises:
        InputError: its variables contradict each other.
    """
    try:
        count = int(os.environ.get("WORLD_SIZE", "1"))
        rank, local = int(os.environ.get("RANK", "0")), int(os.environ.get("LOCAL_RANK", "0"))
        beside = int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
    except ValueError as error:
        raise InputError(
            "RANK, LOCAL_RANK, WORLD_SIZE and LOCAL_WORLD_SIZE must be whole numbers; let torchrun set them"
        ) from error
    if count <= 1:
        return Processes()
    if not 0 <= rank < count or "MASTER_ADDR" not in os.environ:
        raise InputError(
            f"WORLD_SIZE is {count}, but RANK or MASTER_ADDR does not fit: start the processes by torchrun"
        )
    return Processes(rank, local, count, max(1, beside))


def connect(group: Processes, device: str) -> None:
    """Meet the other processes; nothing to do for a single one, or a second time.

    They stay together until they exit: the same processes cannot meet anew.
    """
    if not group.several or distributed.is_initialized():
        return
    if device.startswith("cuda"):
        torch.cuda.set_device(device)
    backend = "nccl" if device.startswith("cuda") else "gloo"
    distributed.init_process_group(backend, rank=group.rank, world_size=group.count)
    atexit.register(_disconnect)


def shutdown_time() -> float:
    """Return how long after a signal ``torchrun`` kills what it has started [s]; infinite for any other process."""
    if "TORCHELASTIC_RUN_ID" not in os.environ:
        return math.inf
    try:
        return float(os.environ.get("TORCH_ELASTIC_SHUTDOWN_TIMEOUT", ""))
    except ValueError:
        return _SHUTDOWN_TIME


def _disconnect() -> None:
    if distributed.is_initialized():
        distributed.destroy_process_group()
