"""A control step as a CUDA graph: recorded once, then replayed without Python in between.

Only where there is a CUDA device; what cannot be captured is stepped as ever, and the reason is told once by name. A
graph reads the memory it was recorded with and repeats what Python decided then. It is recorded anew when an attribute
of the task is another object or number, and not at all where that happens in every step.
"""

from __future__ import annotations

import contextlib
import gc
import operator
import warnings
from collections.abc import Callable, Iterator
from typing import Any, ClassVar, Final, Protocol, TypeVar

import torch
import warp as wp

from simwarp.core.interop import shared_stream

from .errors import TaskError
from .host_state import changed_state, state_of

OutcomeT = TypeVar("OutcomeT")
Recorder = Callable[[Callable[[], Any]], tuple[Callable[[], None], Any]]
"""Records what a function launches; returns the replay, and what the function returned."""

_WARM: Final = 2
"""Steps before a capture: they load kernels, and make what is made once."""
_SHORTEST_LIFE: Final = 4
"""Replays below which a graph was not worth recording."""
_MOST_SHORT: Final = 3
"""Graphs in a row with shorter lives, after which nothing is captured any more."""


class Owner(Protocol):
    """Interface of what steps: its attributes are held to those of the capture."""

    capture: bool

    @property
    def name(self) -> str:
        """Of the task."""
        ...

    @property
    def iteration(self) -> int:
        """Of the training; it changes without a new capture, unless a step reads it."""
        ...


class _Graph:
    """A recorded part of a step, and the attributes that it was recorded with."""

    def __init__(self, attributes: dict[str, Any], replay: Callable[[], None], outcome: Any) -> None:
        self.attributes = attributes  # held, so that no other object gets one's identity
        self.replay = replay
        self.outcome = outcome
        self.iteration: int | None = None
        self.replays = 0

    def changed(self, attributes: dict[str, Any], iteration: int) -> str:
        """Return the name of the first attribute that differs; empty if none does."""
        if self.iteration not in (None, iteration):
            return "iteration"
        held, now = self.attributes, attributes
        if len(held) == len(now) and all(map(operator.is_, held.values(), now.values())):
            return ""
        names = [name for name in {**held, **now} if held.get(name, self) is not now.get(name, self)]
        return names[0] if names else ""


class StepCapture:
    """Runs parts of a control step: from a graph where there is one.

    Args:
        owner: whose steps they are.
        record: makes graphs; None: there is no device that could.

    Attributes:
        reason: why nothing is captured; empty where it is, or will be.
        iteration_read: the running part of the step has asked for the training's iteration.
    """

    HOST_STATE: ClassVar[frozenset[str]] = frozenset({"reason", "iteration_read", "_graphs", "_warm", "_short"})
    APART: ClassVar[frozenset[str]] = frozenset({"before_reset", "_iteration", "_captured"})
    """Attributes of the owner that no graph reads: what hangs on them is asked in every step."""

    def __init__(self, owner: Owner, record: Recorder | None) -> None:
        self.reason = "" if record is not None else "there is no CUDA device"
        self.iteration_read = False
        self._owner = owner
        self._record = record
        self._graphs: dict[str, _Graph] = {}
        self._warm: dict[str, int] = {}
        self._short = 0

    def run(self, part: str, body: Callable[[], OutcomeT]) -> tuple[OutcomeT, bool]:
        """Run a part of the step.

        Args:
            part: its name.
            body: launches it.

        Returns:
            What the body returned, and whether it lies in memory that the next replay writes again.
        """
        if self._record is None or self.reason or not self._owner.capture:
            return body(), False
        known = self._graphs.get(part)
        if known is None and self._warm.get(part, 0) < _WARM:
            return self._run_warm(part, body), False
        if known is not None:
            changed = known.changed(self._attributes(), self._owner.iteration)
            if changed:
                self._drop(part, known, changed)
        if part not in self._graphs and not self.reason:
            self._capture(part, body)
        if self.reason:
            return body(), False
        graph = self._graphs[part]
        graph.replay()
        graph.replays += 1
        return graph.outcome, True

    def _attributes(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self._owner).items() if name not in self.APART}

    def _run_warm(self, part: str, body: Callable[[], OutcomeT]) -> OutcomeT:
        """Run a part as ever, and see in the last such step whether it changes what Python keeps."""
        self._warm[part] = self._warm.get(part, 0) + 1
        if self._warm[part] < _WARM:
            return body()
        before = state_of(self._owner)
        outcome = body()
        changed = changed_state(before, state_of(self._owner))
        if changed:
            self._give_up(f"{changed[0]} is another object or number after a step; write into it instead")
        return outcome

    def _drop(self, part: str, graph: _Graph, changed: str) -> None:
        """Forget a graph whose owner has changed."""
        self._short = self._short + 1 if graph.replays < _SHORTEST_LIFE else 0
        del self._graphs[part]
        if self._short >= _MOST_SHORT:
            self._give_up(f"{changed} changes too often")

    def _capture(self, part: str, body: Callable[[], Any]) -> None:
        assert self._record is not None
        attributes = self._attributes()
        self.iteration_read = False
        try:
            replay, outcome = self._record(body)
        except TaskError:
            raise  # the task's own fault, not one of the capture
        except RuntimeError as error:  # of torch and Warp, for what a stream must not do while it is captured
            self._give_up(str(error).strip().partition("\n")[0])
            return
        graph = _Graph(attributes, replay, outcome)
        if self.iteration_read:
            graph.iteration = self._owner.iteration
        self._graphs[part] = graph

    def _give_up(self, reason: str) -> None:
        self.reason = reason
        self._graphs.clear()
        text = f"task '{self._owner.name}': control steps are not captured into a CUDA graph: {reason}"
        warnings.warn(text, RuntimeWarning, stacklevel=2)


def recorder_of(device: torch.device) -> Recorder | None:
    """Return what records graphs on a device; None where there are none."""
    if device.type != "cuda":
        return None
    # A stream that does not block: torch refuses to capture others
    stream = torch.cuda.Stream(device)

    def record(body: Callable[[], Any]) -> tuple[Callable[[], None], Any]:
        graph = torch.cuda.CUDAGraph()
        with (
            _unchanged_stream(device),
            _without_collection(),
            torch.cuda.graph(graph, stream=stream, capture_error_mode="thread_local"),
            shared_stream(str(device)) as launched_on,
            wp.ScopedCapture(stream=launched_on, force_module_load=False, external=True) as held,
        ):
            outcome = body()

        def replay(_held: Any = held) -> None:  # Warp's part of the graph lives as long as this
            graph.replay()

        return replay, outcome

    return record


@contextlib.contextmanager
def _unchanged_stream(device: torch.device) -> Iterator[None]:
    """Go on with torch's stream of before, also where a capture fails at its end."""
    before = torch.cuda.current_stream(device)
    try:
        yield
    finally:
        torch.cuda.set_stream(before)


@contextlib.contextmanager
def _without_collection() -> Iterator[None]:
    """Free nothing by chance: memory that is given back would end a capture."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
