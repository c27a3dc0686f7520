"""Check of a control step: what in it makes the host wait, takes memory, or is launched anew; and how much it launches.

A step that passes can be captured into one CUDA graph, of as many launches as are counted here. Nothing needs a GPU: on
a CPU the same calls are made. On a GPU what a captured step launches beside its graph is counted.
"""

from __future__ import annotations

import contextlib
import dataclasses
import sys
import types
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import torch
import warp as wp
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode

from simwarp.core import interop
from simwarp.simulation.world_launches import WorldProgram, WorldShares

from .agents import lead_of
from .host_state import changed_state, state_of

if TYPE_CHECKING:
    from .task import Task

_READS: Final = (
    "_local_scalar_dense", "nonzero", "masked_select", "_unique", "unique", "item", "equal", "lift_fresh", "bincount",
    "repeat_interleave",
)  # fmt: skip
"""Operations of torch in which the host waits for the device: for their result, or to bring its own numbers there."""
_HOST_METHODS: Final = ("numpy", "tolist", "cpu", "__array__")
"""Methods of a tensor that bring it to the host."""
_FREE: Final = ("detach", "empty", "empty_strided", "empty_like", "new_empty", "alias")
"""Operations of torch that launch nothing."""
_LAUNCHES: Final = ("launch", "launch_tiled")
_ALLOCATIONS: Final = ("zeros", "zeros_like", "empty", "empty_like", "full", "full_like", "ones", "ones_like", "clone")
_COPIES: Final = ("copy",)
_WAITS: Final = ("synchronize", "synchronize_device", "synchronize_stream", "synchronize_event")
_FILLS: Final = ("assign", "fill_", "zero_")
_HERE: Final = Path(__file__).parent
_ROOM: Final = _HERE.parents[1]
_LIBRARIES: Final = tuple(str(Path(str(module.__file__)).parent) for module in (torch, wp))
_BETWEEN: Final = (__file__, str(interop.__file__))
"""Modules that launch for others."""


@dataclasses.dataclass(frozen=True)
class StepReport:
    """What one control step does, the mean over some of them; places are ``file:line`` of the caller.

    Attributes:
        operations: torch operations that are kernels on a GPU, by place.
        launches: Warp launches, copies and fills, by place.
        host_reads: what makes the host wait for the device, by place.
        allocations: Warp arrays made, by place. Torch keeps its own memory, also in a captured step.
        unrecorded: launches that are not recorded ones, by place.
        rebound: attributes of the task that are other objects or numbers after a step: a captured step would not see
            the new ones.
    """

    operations: Mapping[str, float]
    launches: Mapping[str, float]
    host_reads: Mapping[str, float]
    allocations: Mapping[str, float]
    unrecorded: Mapping[str, float]
    rebound: tuple[str, ...]

    @property
    def total(self) -> float:
        """Torch operations and Warp launches together, per control step; a count, dimensionless."""
        return sum(self.operations.values()) + sum(self.launches.values())

    def problems(self) -> list[str]:
        """Return one line for each thing that a captured step must not do."""
        kinds = {
            "reads the device on the host": self.host_reads,
            "allocates": self.allocations,
            "launches without a recording": self.unrecorded,
        }
        lines = [f"{place} {what}" for what, places in kinds.items() for place in places]
        return lines + [f"{name} is another object or number after a step" for name in self.rebound]


def check_step(
    task: Task[Any], *, steps: int = 2, warm: int = 3, step: Callable[[torch.Tensor], Any] | None = None
) -> StepReport:  # fmt: skip
    """Return what control steps of a task do, with random actions.

    Args:
        task: it goes on from where it is. On a CPU all of a step is looked at; on a GPU, where steps are captured, what
            is launched beside the graph.
        steps: control steps looked at; numbers of the report are per step.
        warm: steps before, in which what is made once is made.
        step: takes actions (W, A) and steps the task, such as an adapter's; None: the task's own.
    """
    generator = torch.Generator().manual_seed(0)
    shape = (steps + warm, *lead_of(task), task.action_size)
    actions = (2.0 * torch.rand(shape, generator=generator) - 1.0).to(task.device)
    step = step or task.step
    for action in actions[:warm]:
        step(action)
    watch = _Watch()
    before = state_of(task)
    with watch.patched(), watch.functions, watch.dispatches:
        for action in actions[warm:]:
            step(action)
    rebound = changed_state(before, state_of(task))

    def each(counter: Counter[str]) -> dict[str, float]:
        return {place: count / steps for place, count in counter.items()}

    return StepReport(
        operations=each(watch.operations),
        launches=each(watch.launches),
        host_reads=each(watch.reads),
        allocations=each(watch.allocations),
        unrecorded=each(watch.unrecorded),
        rebound=tuple(rebound),
    )


class _Watch:
    """Counters of calls into torch and Warp."""

    def __init__(self) -> None:
        self.operations: Counter[str] = Counter()
        self.launches: Counter[str] = Counter()
        self.reads: Counter[str] = Counter()
        self.allocations: Counter[str] = Counter()
        self.unrecorded: Counter[str] = Counter()
        self.dispatches = _Dispatches(self)
        self.functions = _Functions(self)
        self._within = False

    @contextlib.contextmanager
    def patched(self) -> Iterator[None]:
        """Count calls into Warp."""
        with contextlib.ExitStack() as stack:
            for name in _LAUNCHES:
                stack.enter_context(self._counted(wp, name, self.launches, self.unrecorded))
            for name in _ALLOCATIONS:
                stack.enter_context(self._counted(wp, name, self.allocations))
            for name in _COPIES:
                stack.enter_context(self._counted(wp, name, self.launches))
            for name in _WAITS:
                stack.enter_context(self._counted(wp, name, self.reads))
            for name in _FILLS:
                stack.enter_context(self._counted(wp.array, name, self.launches))
            stack.enter_context(self._counted(wp.array, "numpy", self.reads))
            stack.enter_context(self._counted(wp.Launch, "launch", self.launches))
            for owner in (WorldShares, WorldProgram):
                stack.enter_context(self._counted_runs(owner))
            yield

    @contextlib.contextmanager
    def _counted_runs(self, owner: Any) -> Iterator[None]:
        """Count what a simulation launches: each kernel once, however many threads share its worlds."""
        run: Callable[..., None] = owner.run

        def counting(runner: Any, *arguments: Any) -> None:
            commands = arguments[0] if owner is WorldShares else runner.commands
            times = arguments[-1] if isinstance(arguments[-1], int) else 1
            before, self._within = self._within, True
            try:
                if not before:
                    for command in commands:
                        file = command.kernel.func.__module__.partition(".")[2].replace(".", "/")
                        self.launches[f"{file}.py {command.kernel.key.rpartition('__')[2]}"] += times
                run(runner, *arguments)
            finally:
                self._within = before

        owner.run = counting
        try:
            yield
        finally:
            owner.run = run

    @contextlib.contextmanager
    def _counted(self, owner: Any, name: str, *counters: Counter[str]) -> Iterator[None]:
        """Count the calls of a function, but not what it calls itself."""
        function: Callable[..., Any] = getattr(owner, name)

        def counting(*arguments: Any, **options: Any) -> Any:
            if self._within:
                return function(*arguments, **options)
            self._within = True
            try:
                for counter in counters:
                    counter[f"{place()} {name}"] += 1
                return function(*arguments, **options)
            finally:
                self._within = False

        setattr(owner, name, counting)
        try:
            yield
        finally:
            setattr(owner, name, function)


class _Dispatches(TorchDispatchMode):
    """Counter of what torch would launch."""

    def __init__(self, watch: _Watch) -> None:
        super().__init__()
        self._watch = watch

    def __torch_dispatch__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Mapping[str, Any] | None = None
    ) -> Any:
        name = func.name().partition("::")[2].partition(".")[0]
        where = f"{place()} {name}"
        if name not in _FREE and not _is_view(func):
            self._watch.operations[where] += 1
        if name.startswith(_READS) or (name.startswith("index") and _has_mask(args)):
            self._watch.reads[where] += 1
        return func(*args, **(kwargs or {}))


class _Functions(TorchFunctionMode):
    """Counter of reads that torch does not dispatch."""

    def __init__(self, watch: _Watch) -> None:
        super().__init__()
        self._watch = watch

    def __torch_function__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Mapping[str, Any] | None = None
    ) -> Any:
        name = getattr(func, "__name__", "")
        own = getattr(torch.Tensor, name, None) is func
        # A device in words is meant; `tensor.to(task.device)` is the CPU here, and the GPU there
        words = (*args[1:2], (kwargs or {}).get("device")) if name == "to" else ()
        told = any(isinstance(word, str) and word == "cpu" for word in words)
        if (own and (name in _HOST_METHODS or told)) or name == "allclose":
            self._watch.reads[f"{place()} {name}"] += 1
        return func(*args, **(kwargs or {}))


def _is_view(func: Any) -> bool:
    """Whether an operation of torch only looks at memory that is there."""
    aliased = [argument.alias_info for argument in func._schema.arguments if argument.alias_info is not None]
    return bool(aliased) and not any(info.is_write for info in aliased)


def _has_mask(args: tuple[Any, ...]) -> bool:
    """Whether an operation of torch is indexed by a mask."""
    indices = args[1] if len(args) > 1 and isinstance(args[1], list | tuple) else ()
    return any(isinstance(index, torch.Tensor) and index.dtype in (torch.bool, torch.uint8) for index in indices)


def place() -> str:
    """Return ``file:line`` of the innermost caller outside torch, Warp and this module."""
    frame: types.FrameType | None = sys._getframe(1)
    while frame is not None:
        file = frame.f_code.co_filename
        if file not in _BETWEEN and not file.startswith(_LIBRARIES):
            path = Path(file)
            return f"{path.relative_to(_ROOM) if path.is_relative_to(_ROOM) else path.name}:{frame.f_lineno}"
        frame = frame.f_back
    return "?"
