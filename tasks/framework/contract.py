"""The contract of a task in every step: what its methods return stays what it was when they first returned it.

Names, shapes, dtypes and devices are Python's: holding a result to them launches nothing and waits for nothing. Values
are counted on the device, by the kernels that judge a step and look at its observations.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Final, TypeAlias

import torch

from simwarp.core.object_repr import plural
from simwarp.core.types import formatted

from .agents import Worlds
from .drawing import Drawing, Line
from .errors import TaskError, TaskStepError, broken
from .escapes import named_escapes
from .interface_checks import check_batch, check_flags, check_observations, check_terms
from .statistics import EpisodeSummary

Form: TypeAlias = tuple[torch.Size, torch.dtype, torch.device]
"""Shape, dtype and device of a tensor."""

_ALWAYS: Final = "return all of them always"
_FULL: Final = "return the same in every step"


class Contract:
    """Calls the methods of a task that return something, and holds the results to their form.

    The first result of a method is checked against the contract, and its names, shapes, dtypes and devices are those
    of all that follow.

    Args:
        task: whose methods they are.

    Attributes:
        step: control steps begun since the task was built.
    """

    HOST_STATE: ClassVar[frozenset[str]] = frozenset({"step", "_forms"})
    """Attributes that no captured step reads: shapes cannot change in one."""

    def __init__(self, task: Any) -> None:
        self.step = 0
        self._task = task
        self._forms: dict[str, dict[str, Form]] = {}

    def observations(self) -> dict[str, torch.Tensor]:
        """Return the observation groups, name -> (W, ...)."""
        return self._held("observations", "observation", self._task.observations(), check_observations)

    def observations_of(self, obs: str | None) -> dict[str, torch.Tensor] | None:
        """Return the groups (W, ...) of other observations; None where there are none."""
        groups = self._task.observations_of(obs)
        method = f"observations_of({obs!r})"
        return None if groups is None else self._held(method, "observation", groups, check_observations)

    def privileged(self) -> torch.Tensor | None:
        """Return (W, N) float32 for the critic alone; None where the task has nothing for it."""
        value = self._task.privileged()
        if value is None and "privileged" not in self._forms:
            return None
        return self._held("privileged", "row", {"privileged": value}, check_observations)["privileged"]

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the reward terms, name -> (W,) float32, always in the same order."""
        return self._held("rewards", "reward", self._task.rewards(), check_terms, "reward terms")

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return the reasons to end, name -> (W,) bool, always in the same order."""
        check = functools.partial(check_flags, kind="termination")
        return self._held("terminations", "termination", self._task.terminations(), check, "reasons to end")

    def truncations(self) -> dict[str, torch.Tensor]:
        """Return the reasons to cut off, name -> (W,) bool, always in the same order."""
        check = functools.partial(check_flags, kind="truncation")
        return self._held("truncations", "truncation", self._task.truncations(), check, "reasons to cut off")

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return the metrics, name -> (W,)."""
        check = functools.partial(check_terms, kind="metric", floating=False)
        return self._held("metrics", "metric", self._task.metrics(), check)

    def extra_state(self) -> dict[str, torch.Tensor]:
        """Return the task's own state, name -> (...)."""
        with named_escapes():
            state = self._task.extra_state()
        return self._held("extra_state", "state", state, _check_state)

    def on_iteration(self, iteration: int) -> dict[str, torch.Tensor]:
        """Begin a training iteration; return what is logged, name -> (W,)."""
        with named_escapes():
            logged = self._task.on_iteration(iteration)
        return self._held("on_iteration", "value", {} if logged is None else logged, _check_logged)

    def step_limit(self) -> torch.Tensor:
        """Return the control steps after which episodes are over, (W,)."""
        with named_escapes():
            value = {"step_limit": self._task.step_limit()}
        return self._held("step_limit", "limit", value, _check_limit)["step_limit"]

    def map_position(self) -> torch.Tensor | None:
        """Return the agent's position, (W, 3) [m]; None if it has none."""
        with named_escapes():
            value = self._task.map_position()
        if value is None and "map_position" not in self._forms:
            return None
        return self._held("map_position", "position", {"map_position": value}, _check_position)["map_position"]

    def drawing(self) -> Drawing:
        """Return the lines of pictures and maps; their number and their points may change."""
        with named_escapes():
            drawing = self._task.drawing()
        if not isinstance(drawing, Drawing) or not all(isinstance(line, Line) for line in drawing.lines):
            raise self._error("drawing", f"must return a Drawing of Lines, got {formatted(drawing)}")
        worlds = self._task.num_worlds
        for line in drawing.lines:
            points = line.points
            if not isinstance(points, torch.Tensor) or points.dim() != 3 or points.shape[::2] != (worlds, 3):
                raise self._error("drawing", f"points of a line must be ({worlds}, P, 3), got {_form_of(points)}")
        return drawing

    def _held(
        self, method: str, kind: str, values: Any, check: Callable[[Worlds, Any], Mapping[str, torch.Tensor]],
        ordered: str = "",
    ) -> dict[str, torch.Tensor]:  # fmt: skip
        """Return results that have the form of the first ones.

        Args:
            method: that returned them.
            kind: of one of them, for errors.
            values: what it returned.
            check: of the first ones.
            ordered: what they are together, where their order counts.
        """
        known = self._forms.get(method)
        if known is None:
            checked = dict(check(self._task, values))
            self._forms[method] = {name: (value.shape, value.dtype, value.device) for name, value in checked.items()}
            return checked
        if type(values) is not dict:
            if not isinstance(values, Mapping):
                raise self._error(method, f"must return a dict of {kind}s, got {_form_of(values)}; {_FULL}")
            values = dict(values)
        if values.keys() != known.keys() or (ordered and list(values) != list(known)):
            zeros = ", of zeros where they do not count" if ordered else ""
            what = f"the {ordered or f'names of {kind}s'} must stay {list(known)}, got {list(values)}"
            raise self._error(method, f"{what}: {_ALWAYS}{zeros}")
        for name, (shape, dtype, device) in known.items():
            value = values[name]
            if not (
                isinstance(value, torch.Tensor)
                and value.shape == shape
                and value.dtype is dtype
                and value.device == device
            ):
                rule = f"must stay {_form(shape, dtype, device)}, got {_form_of(value)}"
                raise self._error(method, f"{kind} '{name}' {rule}; {_FULL}")
        found: dict[str, torch.Tensor] = values
        return found

    def _error(self, method: str, what: str) -> TaskStepError:
        return broken(self._task, method, what)


def bad_value(task: Any, summary: EpisodeSummary, kept: Path | None) -> TaskStepError:
    """Return the error of a reward or an observation that was not finite.

    Args:
        task: whose it is.
        summary: of the episodes, in which there is one.
        kept: the file in which it is, if it was written.
    """
    first = summary.first_bad
    assert first is not None
    world, agent = divmod(first.row, task.agents)
    which = f"world {task.first_world + world}" + (f", agent {agent}" if task.agents > 1 else "")
    times = plural(summary.bad_values.get(first.name, 1), "world-step")
    when = f"at control step {first.step} (step {first.episode_step} of its episode {first.episode})"
    hint = f"; `simwarp replay {kept}` repeats what led there" if kept is not None else ""
    return TaskStepError(
        f"task '{task.name}': {first.name} was NaN or infinite in {times} of {plural(task.num_worlds, 'world')}, "
        f"first in {which} {when}, must be finite{hint}"
    )


def _form(shape: torch.Size, dtype: torch.dtype, device: torch.device) -> str:
    return f"{str(dtype).removeprefix('torch.')} {tuple(shape)} on {device}"


def _form_of(value: Any) -> str:
    if isinstance(value, torch.Tensor):
        return _form(value.shape, value.dtype, value.device)
    return "None" if value is None else f"{type(value).__name__} {formatted(value)}"


def _check_state(task: Worlds, values: Any) -> Mapping[str, torch.Tensor]:
    if not isinstance(values, Mapping) or not all(isinstance(each, torch.Tensor) for each in values.values()):
        raise TaskError(f"task '{task.name}': extra_state() must be a dict of named tensors, got {formatted(values)}")
    return values


def _check_logged(task: Worlds, values: Any) -> Mapping[str, torch.Tensor]:
    if not isinstance(values, Mapping):
        rule = "a dict of named tensors or None"
        raise TaskError(f"task '{task.name}': on_iteration() must be {rule}, got {type(values).__name__}")
    for name, value in values.items():
        check_batch(task, f"value '{name}' of on_iteration()", value)
    return values


def _check_limit(task: Worlds, values: Any) -> Mapping[str, torch.Tensor]:
    value = values["step_limit"]
    if not isinstance(value, torch.Tensor) or value.shape != (task.num_worlds,) or value.dtype.is_complex:
        raise TaskError(f"task '{task.name}': step_limit() must be ({task.num_worlds},) numbers, got {_form_of(value)}")
    return {"step_limit": value}


def _check_position(task: Worlds, values: Any) -> Mapping[str, torch.Tensor]:
    value = values["map_position"]
    if not isinstance(value, torch.Tensor) or value.shape != (task.num_worlds, 3):
        raise TaskError(f"task '{task.name}': map_position() must be ({task.num_worlds}, 3), got {_form_of(value)}")
    return {"map_position": value}
