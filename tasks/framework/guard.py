"""Record of the last states and actions in case the physics of a world breaks down, and the file of such a dump.

Two snapshots of all worlds, taken in turn, and a ring of the last actions and joint states are always at hand. A break
is noted on the device (which world, when); the host looks every few dozen steps, while a snapshot from before the break
still exists, and then keeps that world's part: once per run.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Protocol, TypeAlias

import numpy as np
import torch

from simwarp.core.constraints import Fraction, Ge, Lt
from simwarp.core.files import FileError, OutputError

from ..randomisation.randomising import drawn_parameters
from ..randomisation.randomness import WorldRandom
from .argument_checks import check_room
from .config import require
from .interface_checks import Worlds
from .npz import write_arrays
from .plain import Settings, config_to_plain
from .simulation_access import copy_snapshot, pack_snapshot

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
        level: the curriculum's.
        iteration: of the training.
        device: device of the run.
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

    def validate(self) -> None:
        """Check that the steps fit together."""
        require(1 <= self.replay_steps <= self.episode_steps, self, "replay_steps", "from 1 to episode_steps")
        require(not self.from_reset or self.replay_steps == self.episode_steps, self, "from_reset", "of all steps")


class Guarded(Worlds, Protocol):
    """Parts of a task that are recorded: see the attributes of `Task`."""

    action: torch.Tensor
    level: torch.Tensor
    episode_index: torch.Tensor
    episode_steps: torch.Tensor
    random: WorldRandom
    first_world: int
    iteration: int

    @property
    def simulation(self) -> Any:
        """Of all worlds."""
        ...

    @property
    def views(self) -> Any:
        """Torch views of its arrays."""
        ...

    @property
    def config(self) -> Any:
        """Of the task."""
        ...

    @property
    def per_world(self) -> tuple[str, ...]:
        """Parameters of which every world has its own."""
        ...

    def extra_state(self) -> dict[str, torch.Tensor]:
        """State of the task beside the simulation's."""
        ...


class _Keep:
    """A snapshot of all worlds, and what the task adds to the simulation's state."""

    def __init__(self, task: Guarded) -> None:
        self.simulation = task.simulation.snapshot()
        self.action = task.action.clone()
        self.extra: dict[str, torch.Tensor] = {}
        self.taken = -1

    def take(self, task: Guarded, count: int) -> None:
        copy_snapshot(task.simulation, self.simulation)
        self.action.copy_(task.action)
        self.extra = {name: value.clone() for name, value in task.extra_state().items()}
        self.taken = count


class Guard:
    """Recorder of the last steps of a task, which keeps the first break of its physics.

    Args:
        task: the task; its simulation exists.
        steps: control steps remembered.

    Attributes:
        path: of the dump, written as soon as the host notices a break; None keeps it in memory.
        dump: the kept arrays of the first break, or None.
    """

    def __init__(self, task: Guarded, steps: int) -> None:
        self.path: Path | None = None
        self.dump: dict[str, np.ndarray[Any, Any]] | None = None
        self._task = task
        self._half = max(1, (steps + 1) // 2)
        self._steps = 2 * self._half
        views, worlds, device = task.views, task.num_worlds, task.device

        widths = (task.action_size, views.joint_q.shape[1], views.joint_qd.shape[1])
        what = f"guard-steps: the last {self._steps} steps of {worlds} worlds"
        check_room(what, (self._steps, worlds, sum(widths)), torch.float32, device, "keep fewer steps, or none with 0")

        def ring(width: int) -> torch.Tensor:
            return torch.zeros(self._steps, worlds, width, device=device)

        self._requests, self._joint_q, self._joint_qd = (ring(width) for width in widths)
        self._keeps = (_Keep(task), _Keep(task))
        self._count = 0
        # world, step count, episode and step in it of the first break; -1 without one
        self._first = torch.full((4,), -1, dtype=torch.int64, device=device)
        self._level = torch.ones(1, device=device)

    def before_step(self, request: torch.Tensor) -> None:
        """Take in the action of a control step that is about to run."""
        if self._count % self._half == 0:
            self.look()
            self._keeps[(self._count // self._half) % 2].take(self._task, self._count)
        self._requests[self._count % self._steps] = request

    def after_step(self, broken: torch.Tensor) -> None:
        """Take in the state reached, and note the first world that broke ((W,) bool)."""
        task, row = self._task, self._count % self._steps
        self._joint_q[row] = task.views.joint_q
        self._joint_qd[row] = task.views.joint_qd
        # Indexing by a tensor of no dimension would make the host wait for its value
        world = broken.to(torch.uint8).argmax().view(1)
        now = torch.cat(
            [
                world,
                torch.full_like(world, self._count),
                task.episode_index.index_select(0, world),
                task.episode_steps.index_select(0, world),
            ]
        )
        fresh = broken.any() & (self._first[0] < 0)
        self._first.copy_(torch.where(fresh, now, self._first))
        self._level.copy_(torch.where(fresh, task.level.index_select(0, world), self._level))
        self._count += 1

    def look(self) -> None:
        """Keep the part of the first broken world, and write it where ``path`` says. This waits for the device.

        Raises:
            OutputError: the disk did not take it.
        """
        if self.dump is None:
            world, count, episode, steps = self._first.tolist()
            if world < 0:
                return
            self.dump = self._cut_out(world, count, episode, steps)
        if self.path is None or self.path.exists():
            return
        try:
            self.write(self.path)
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

    def _cut_out(self, world: int, count: int, episode: int, steps: int) -> dict[str, np.ndarray[Any, Any]]:
        """Return the arrays of one world, from a snapshot or the beginning of its episode to the break."""
        task = self._task
        keep = min((item for item in self._keeps if 0 <= item.taken <= count), key=lambda item: item.taken)
        since = count + 1 - keep.taken
        from_reset = steps <= since
        kept = min(count + 1, self._steps)
        rows = [number % self._steps for number in range(count + 1 - kept, count + 1)]
        about = DumpAbout(
            format=FORMAT,
            task=task.name,
            config=config_to_plain(task.config),
            seed=task.random.seed,
            world=task.first_world + world,
            episode=episode,
            episode_steps=steps,
            replay_steps=steps if from_reset else since,
            from_reset=from_reset,
            level=float(self._level),
            iteration=task.iteration,
            device=str(task.device),
        )
        arrays = {
            "meta": np.array(json.dumps(dataclasses.asdict(about))),
            "actions": self._requests[rows, world].cpu().numpy(),
            "joint_q": self._joint_q[rows, world].cpu().numpy(),
            "joint_qd": self._joint_qd[rows, world].cpu().numpy(),
            "start_action": keep.action[world].cpu().numpy(),
        }
        packed = _flat(pack_snapshot(keep.simulation))
        # A leading dimension of 1 is shared by all worlds
        arrays |= {f"start/{name}": part[world % len(part)] for name, part in packed}
        extra = {name: value for name, value in keep.extra.items() if value.shape[:1] == (task.num_worlds,)}
        arrays |= {f"extra/{name}": value[world].cpu().numpy() for name, value in extra.items()}
        for name in sorted({*task.per_world, *drawn_parameters(task.config.randomise)}):
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
