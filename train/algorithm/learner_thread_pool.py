"""Threads that learn side by side, with torch's own threads out of their way."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any, TypeVar

import torch

from .kept_memory import keep_freed_memory

ResultT = TypeVar("ResultT")


class LearnerThreads:
    """The caller's thread and others beside it, which start when they are first needed and end with :meth:`close`.

    Torch gives up Python's lock in each of its operations, and works backwards through a graph in the thread that asks
    for it: several threads learn at once.

    Args:
        count: number of threads, the caller's one of them; at least 2.
    """

    def __init__(self, count: int) -> None:
        keep_freed_memory()
        self.count = count
        self._others = ThreadPoolExecutor(count - 1, thread_name_prefix="simwarp-learner")

    def map(self, function: Callable[..., ResultT], *columns: Iterable[Any]) -> list[ResultT]:
        """Return ``function`` of each row of arguments, in their order; a thread that is free takes the next one.

        Gradients are kept, or not, as in the caller's thread.

        Raises:
            Exception: what ``function`` raised first; rows that no thread had begun are left out.
        """
        rows = deque(enumerate(zip(*columns, strict=True)))
        found: dict[int, ResultT] = {}
        inference, gradients = torch.is_inference_mode_enabled(), torch.is_grad_enabled()

        def work() -> None:
            while True:
                try:
                    place, row = rows.popleft()
                except IndexError:
                    return
                try:
                    found[place] = function(*row)
                except BaseException:
                    rows.clear()
                    raise

        def work_beside() -> None:
            with torch.inference_mode(inference), torch.set_grad_enabled(gradients):
                work()

        with _one_thread_of_torch():
            others = [self._others.submit(work_beside) for _ in range(min(self.count, len(rows)) - 1)]
            try:
                work()
            finally:
                rows.clear()
                wait(others)
        for other in others:
            other.result()
        return [found[place] for place in range(len(found))]

    def close(self) -> None:
        """End the threads."""
        self._others.shutdown()


@contextlib.contextmanager
def _one_thread_of_torch() -> Iterator[None]:
    """Let an operation of torch keep to the thread that calls it."""
    before = torch.get_num_threads()
    if before == 1:
        yield
        return
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
