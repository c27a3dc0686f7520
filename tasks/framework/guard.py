"""Record of the last states and actions in case the physics of a world breaks down, and the file of such a dump.

Two snapshots of all worlds, taken in turn, and a ring of the last actions and joint states are always at hand. What
belongs to a world is recorded until its physics breaks down and stays as it is then: the host may look at any time, and
keeps the part of the world that broke first, once per run.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np
import torch
import warp as wp

from simwarp.core.constraints import Fraction, Ge, Lt
from simwarp.core.files import FileError, OutputError
from simwarp.core.interop import TensorLaunch, from_torch

from ..randomisation.randomising import drawn_parameters
from .argument_checks import check_room
from .config import require
from .config_values import Settings, config_to_plain
from .control_step_kernels import Recording, keep_bytes, keep_words
from .npz import write_arrays
from .recorded_launches import filled
from .task_simulation import arrays_of, pack_snapshot

FORMAT = 1


Counted: TypeAlias = Annotated[int, Ge(0), Lt(2**53)]
"""A whole number that float64 holds."""


@dataclasses.dataclass(frozen=True)
class DumpAbout(Settings):
    """Description of a dump, as JSON in its array ``meta``.

    Attributes:
        format: of the file.
        task: name of the task.
        config: the task's configuration, as plain values.
        seed, world, episode: indices of the episode and of the world that broke down.
        episode_steps: control step of the episode in which it broke, the first is 1.
        replay_steps: control steps to be repeated.
        from_reset: from the beginning of the episode; else from the snapshot within it.
        level: the curriculum's as the episode began; in the steps to be repeated it is that of the array ``level``.
        iteration: of the training.
        device: device of the run.
        task_file: file and class of a task that is not installed.
        value: that was not finite, such as ``reward 'speed'``; empty where the physics broke down.
    """

    format: int
    task: str
    config: Mapping[str, Any]
    seed: int
    world: Counted
    episode: Counted
    episode_steps: int
    replay_steps: int
    from_reset: bool
    level: Fraction
    iteration: Counted
    device: str
    task_file: str = ""
    value: str = ""

    def validate(self) -> None:
        """Check that the steps fit together."""
        require(1 <= self.replay_steps <= self.episode_steps, self, "replay_steps", "from 1 to episode_steps")
        require(not self.from_reset or self.replay_steps == self.episode_steps, self, "from_reset", "of all steps")


class _Keep:
    """A snapshot of all worlds, and what the task adds to the simulation's state.

    Args:
        task: the task.
        recording: in worlds that broke down nothing is taken any more.
    """

    def __init__(self, task: Any, recording: Recording) -> None:
        self.simulation = task.simulation.snapshot()
        self.action = task.action.clone()
        self.extra: dict[str, torch.Tensor] = {}
        pairs = list(zip(arrays_of(task.simulation), arrays_of(self.simulation), strict=True))
        pairs.append((from_torch(task.action), from_torch(self.action)))
        self._launches = [
            _copying(recording.broken_at, present, copy, task.device) for present, copy in pairs if present.size
        ]

    def update(self, task: Any, sound: torch.Tensor) -> None:
        """Bring it up to date in the worlds of a mask (W,) bool: those that have not broken down."""
        for launch in self._launches:
            launch.launch()
        for name, value in _rows(task).items():
            kept = self.extra.setdefault(name, value.clone())
            kept.copy_(torch.where(sound.view(-1, *(1,) * (value.dim() - 1)), value, kept))


def _rows(task: Any) -> dict[str, torch.Tensor]:
    """Return the task's own state that each world has a row of."""
    return {name: value for name, value in task.contract.extra_state().items() if value.shape[:1] == (task.num_worlds,)}


def _copying(broken_at: wp.array, present: wp.array, copy: wp.array, device: torch.device) -> TensorLaunch:
    """Return the launch that copies rows of an array, whatever they hold."""
    size = present.size * wp.types.type_size_in_bytes(present.dtype) // present.shape[0]
    kernel, dtype, width = (keep_bytes, wp.uint8, size) if size % 4 else (keep_words, wp.int32, size // 4)
    shape = (present.shape[0], width)
    rows: list[wp.array] = [
        wp.array(ptr=part.ptr, dtype=dtype, shape=shape, device=part.device, copy=False) for part in (present, copy)
    ]
    return TensorLaunch(kernel, shape, [broken_at, *rows], device)


class Guard:
    """Recorder of the last steps of a task, which keeps the first break of its physics.

    A reward or an observation that is not finite while the physics is sound is kept likewise: a run ends there.

    Args:
        task: the task; its simulation exists.
        steps: control steps remembered.

    Attributes:
        path: of the dump, written when the host looks after a break; None keeps it in memory.
        dump: the kept arrays of the first break, or None; those of a value take the place of those of the physics.
        values: names of the values that are looked at.
        recording: for the kernel that counts control steps.
    """

    HOST_STATE: ClassVar[frozenset[str]] = frozenset(
        {"path", "dump", "values", "_of_value", "_keeps", "_until", "_turn"}
    )
    """Attributes that no captured step reads."""

    def __init__(self, task: Any, steps: int) -> None:
        self.path: Path | None = None
        self.dump: dict[str, np.ndarray[Any, Any]] | None = None
        self.values: list[str] = []
        self._of_value = False
        self._task = task
        self._half = max(1, (steps + 1) // 2)
        self._steps = 2 * self._half
        views, worlds, device = task.views, task.num_worlds, task.device

        widths = (task.action[0].numel(), views.joint_q.shape[1], views.joint_qd.shape[1])
        what = f"guard-steps: the last {self._steps} steps of {worlds} worlds"
        check_room(what, (self._steps, worlds, sum(widths)), torch.float32, device, "keep fewer steps, or none with 0")

        self._requests, self._joint_q, self._joint_qd = (
            torch.zeros(self._steps, worlds, width, device=device) for width in widths
        )
        self._counted, self._episode, self._episode_steps = (
            torch.zeros(worlds, dtype=torch.int64, device=device) for _ in range(3)
        )
        self._broken_at = torch.full((worlds,), -1, dtype=torch.int64, device=device)
        self._value = torch.zeros(worlds, dtype=torch.int32, device=device)
        self._drawn_level = torch.ones(worlds, device=device)
        self._level = torch.ones(self._steps, worlds, device=device)
        self.recording = filled(
            Recording,
            count=self._counted,
            broken_at=self._broken_at,
            value=self._value,
            episode=self._episode,
            steps=self._episode_steps,
            drawn_level=self._drawn_level,
            level=self._level,
            request=self._requests,
            joint_q=self._joint_q,
            joint_qd=self._joint_qd,
        )
        self._keeps = (_Keep(task, self.recording), _Keep(task, self.recording))
        self._until = 0
        self._turn = 0

    def before_step(self) -> None:
        """Take a snapshot, if one is due: never twice within as many steps as it is to reach back."""
        if self._until == 0:
            self._keeps[self._turn].update(self._task, self._broken_at < 0)
            self._turn = 1 - self._turn
            self._until = self._half
        self._until -= 1

    def notice(self) -> None:
        """Keep the part of the world that broke first. This waits for the device."""
        broken_at, value = self._broken_at.cpu(), self._value.cpu()
        broken = broken_at >= 0
        of_value = broken & (value > 0)
        ended = bool(of_value.any())
        if self._of_value or not bool(broken.any()) or (self.dump is not None and not ended):
            return
        # What ended the run comes first
        world = int(torch.where(of_value if ended else broken, broken_at, broken_at.max() + 1).argmin())
        episode, steps = int(self._episode[world]), int(self._episode_steps[world])
        name = self.values[value[world] - 1] if ended else ""
        self.dump = self._cut_out(world, int(broken_at[world]), episode, steps, name)
        self._of_value = ended

    def look(self) -> Path | None:
        """Keep the part of the first broken world, and write it where ``path`` says. This waits for the device.

        What a value has broken is written as ``NAME_value`` where a break of the physics was written before.

        Returns:
            The file that was written, if one was.

        Raises:
            OutputError: the disk did not take it.
        """
        self.notice()
        if self.dump is None or self.path is None:
            return None
        path = self.path.with_stem(f"{self.path.stem}_value") if self._of_value and self.path.exists() else self.path
        if path.exists():
            return None
        try:
            return self.write(path)
        except FileError as error:
            # It could be written to when the work began
            raise OutputError(str(error)) from None

    def write(self, path: Path) -> Path:
        """Write the dump, whole or not at all, and return its path.

        Raises:
            ValueError: no world has broken down.
            FileError: ``path`` cannot be written to.
            OutputError: the disk did not take it.
        """
        if self.dump is None:
            raise ValueError(f"task '{self._task.name}': no world has broken down, there is nothing to dump")
        write_arrays(path, self.dump)
        return path

    def _cut_out(
        self, world: int, count: int, episode: int, steps: int, value: str = ""
    ) -> dict[str, np.ndarray[Any, Any]]:  # fmt: skip
        """Return the arrays of one world, from a snapshot or the beginning of its episode to the break."""
        task = self._task
        # The older one of the two that were taken before the break
        taken = max(0, count // self._half - 1)
        keep = self._keeps[taken % 2]
        since = count + 1 - taken * self._half
        from_reset = steps <= since
        kept = min(count + 1, self._steps)
        rows = [number % self._steps for number in range(count + 1 - kept, count + 1)]
        about = DumpAbout(
            format=FORMAT,
            task=task.name,
            config=config_to_plain(task.config),
            seed=task.random.seed,
            world=int(task.random.world[world]),
            episode=episode,
            episode_steps=steps,
            replay_steps=steps if from_reset else since,
            from_reset=from_reset,
            level=float(self._drawn_level[world]),
            iteration=task.iteration,
            device=str(task.device),
            task_file=task.task_file,
            value=value,
        )
        arrays = {
            "meta": np.array(json.dumps(dataclasses.asdict(about))),
            "level": self._level[rows, world].cpu().numpy(),
            "actions": self._requests[rows, world].cpu().numpy(),
            "joint_q": self._joint_q[rows, world].cpu().numpy(),
            "joint_qd": self._joint_qd[rows, world].cpu().numpy(),
            "start_action": keep.action[world].flatten().cpu().numpy(),
        }
        packed = _flat(pack_snapshot(keep.simulation))
        # A leading dimension of 1 is shared by all worlds
        arrays |= {f"start/{name}": part[world % len(part)] for name, part in packed}
        arrays |= {f"extra/{name}": value[world].cpu().numpy() for name, value in keep.extra.items()}
        for name in sorted({*task.own_parameters, *drawn_parameters(task.config.uncertainty.randomise)}):
            arrays[f"model/{name}"] = getattr(task.simulation.model, name).numpy()[world]
        return arrays


def _flat(packed: Mapping[str, Any], prefix: str = "") -> list[tuple[str, np.ndarray[Any, Any]]]:
    """Return the leaves of a packed snapshot under names with slashes."""
    leaves = []
    for name, part in packed.items():
        if isinstance(part, torch.Tensor):
            leaves.append((prefix + name, part.numpy()))
        else:
            leaves += _flat(part, f"{prefix}{name}/")
    return leaves
