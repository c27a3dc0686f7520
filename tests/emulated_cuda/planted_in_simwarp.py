"""simwarp with a part taken out that a GPU needs, on the emulated device; prints as JSON what was seen.

`EMULATED_CUDA_CHECK=race EMULATED_CUDA_STREAMS=lazy python -m tests.emulated_cuda FILE`, with this file.
"""

from __future__ import annotations

import contextlib
import json
import warnings
from collections.abc import Callable, Iterator
from typing import Any
from unittest import mock

import torch
import warp as wp

import simwarp as sw
from simwarp.kernels.core import scratch
from simwarp.scenes import double_pendulum
from simwarp.tasks.framework import task as task_module
from tests.emulated_cuda.device import device
from tests.emulated_cuda.settings import StreamOrder
from tests.tasks.framework.pair_task import PairConfig, PairTask

CUDA = "cuda:0"
WORLDS = 8


@contextlib.contextmanager
def order(streams: StreamOrder) -> Iterator[None]:
    """Another order of streams for a while."""
    target = device().streams
    before, target.order = target.order, streams
    yield
    target.finish_all()
    target.order = before


def observed(*, captured: bool = False, kind: type[PairTask] = PairTask) -> tuple[list[float], Any]:
    """Observations after some control steps on a stream of torch's that nobody waits for, and the task."""
    task = kind(PairConfig(), WORLDS, device=CUDA, seed=3)
    task.capture = captured
    torch.cuda.synchronize()
    side = torch.cuda.Stream()
    with torch.cuda.stream(side):
        for _ in range(3):
            result = task.step(torch.full((WORLDS, 2, 1), 0.5, device=CUDA))
        return result.observations["policy"].flatten().tolist(), task


def same(**options: Any) -> bool:
    """Whether late streams give what eager ones do."""
    with order(StreamOrder.EAGER):
        truth, _ = observed()
    return observed(**options)[0] == truth


def stepped() -> sw.Simulation:
    """A simulation that has made a step."""
    sim = sw.Simulation(double_pendulum().finalize(WORLDS, CUDA), 1e-3)
    sim.step()
    wp.synchronize_device(CUDA)
    return sim


@contextlib.contextmanager
def not_shared(where: str) -> Iterator[None]:
    """In place of `shared_stream`: Warp launches on its own stream."""
    yield


def one_slot_for_all(shape: tuple[int, ...], *, dtype: Any, device: Any) -> Any:
    """In place of `_slots_innermost`: all worlds write the same scratch."""
    memory = wp.zeros((1, *shape[1:]), dtype=dtype, device=device)
    return scratch._view(memory, int(memory.ptr), shape, (0, *memory.strides[1:]), dtype, device)


class ReadsTheHost(PairTask):
    """Its rewards wait for the device."""

    def rewards(self) -> dict[str, torch.Tensor]:
        """The task's, times a number of the host."""
        factor = 1.0 if float(self.views.joint_q.abs().sum()) >= 0.0 else 0.0
        return {name: factor * each for name, each in super().rewards().items()}


def steps_as_they_are() -> str:
    """Nothing is missing."""
    return f"same {same()}, captured {same(captured=True)}"


def stream_is_not_shared() -> str:
    """Warp and torch do not wait for each other."""
    with mock.patch.object(task_module, "shared_stream", not_shared):
        return f"same {same()}"


def scratch_as_it_is() -> str:
    """Each world has its slot."""
    stepped()
    return f"races {device().races()[0] > 0}"


def scratch_is_shared() -> str:
    """A race of worlds."""
    with mock.patch.object(scratch, "_slots_innermost", one_slot_for_all):
        stepped()
    return f"races {device().races()[0] > 0}"


def a_captured_step_reads_the_host() -> str:
    """The step goes on without a graph, and says why."""
    values, task = observed(captured=True, kind=ReadsTheHost)
    assert values
    return f"not captured: {task.not_captured}"


def a_step_gets_an_array_of_the_host() -> str:
    """One in a struct that simwarp has not looked at."""
    sim = stepped()
    host = wp.zeros_like(sim.control.joint_force, device="cpu")
    disguised: wp.array = wp.array(ptr=host.ptr, dtype=host.dtype, shape=host.shape, device=CUDA)
    sim.control.arrays.joint_force = disguised
    sim.step()
    wp.synchronize_device(CUDA)
    return "passed"


PROGRAMS: tuple[Callable[[], str], ...] = (
    steps_as_they_are, stream_is_not_shared, scratch_as_it_is, scratch_is_shared, a_captured_step_reads_the_host,
    a_step_gets_an_array_of_the_host,
)  # fmt: skip


def main() -> None:
    """Run each on a device without faults."""
    warnings.simplefilter("ignore")
    wp.config.log_level = wp.LOG_WARNING
    target = device()
    target.faults.printing = False
    found = {}
    for program in PROGRAMS:
        target.streams.finish_all()
        target.faults.clear()
        target.faults.violations.clear()
        target.runtime.emu_clear_races()
        try:
            seen = program()
        except (RuntimeError, TypeError, ValueError) as error:
            seen = f"{type(error).__name__}: {error}"
        found[program.__name__] = {"seen": seen, "faults": [text for text, _ in target.faults.violations]}
        target.streams.captures.clear()
    print(json.dumps(found))


if __name__ == "__main__":
    main()
