"""How a task prints: what goes in and out of it, why its episodes end, and how long a step is."""

from __future__ import annotations

from typing import Any, ClassVar

import torch

from simwarp.core.readable import Names, Readable, Row, array_text, plural

from .agents import lead_of
from .config import TaskConfig


class ReadableTask(Readable):
    """The rows of a task; see :class:`~simwarp.tasks.Task` for the attributes."""

    name: ClassVar[str]
    num_worlds: int
    device: torch.device
    config: Any
    action: torch.Tensor
    observation_shapes: dict[str, tuple[int, ...]]
    observation_dtypes: dict[str, torch.dtype]
    reward_terms: Any
    end_reasons: Any
    simulation: Any

    def _readable_title(self) -> str:
        return f" '{self.name}': {plural(self.num_worlds, 'world')} on {self.device}"

    def _readable_rows(self) -> dict[str, Row]:
        config: TaskConfig = self.config
        groups = [
            f"{name} {(*lead_of(self), *shape)} {str(self.observation_dtypes[name]).rpartition('.')[2]}"
            for name, shape in self.observation_shapes.items()
        ]
        steps = config.decimation if self.simulation is not None else 1
        return {
            "action": f"{array_text(self.action)} in -1..1",
            "observations": ", ".join(groups),
            "rewards": Names(len(self.reward_terms), self.reward_terms),
            "ends": Names(len(self.end_reasons), self.end_reasons),
            "time": f"{config.dt * steps:g} s a step ({plural(steps, 'physics step')} of {config.dt:g} s), "
            f"at most {plural(config.max_episode_steps, 'step')} an episode",
        }
