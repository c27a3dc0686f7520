"""The state of a task that a checkpoint keeps."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any, ClassVar, Final, NoReturn

import torch

from ..randomisation.randomness import WorldRandom
from ..randomisation.sensing import Sensors
from .action_path import ActionPath
from .agents import Agents
from .contract import Contract
from .errors import InputError
from .named_contacts import Touching
from .simulation_access import pack_snapshot, unpack_snapshot
from .statistics import EpisodeStatistics

NEW_STATE: Final = frozenset({"drawn_level"})
"""Entries of a task's state that older checkpoints do not have."""


class SavedTask(Touching):
    """Saving and loading of a task; see :class:`~simwarp.tasks.Task` for the attributes."""

    name: ClassVar[str]
    num_worlds: int
    iteration: int
    simulation: Any
    random: WorldRandom
    action: torch.Tensor
    level: torch.Tensor
    drawn_level: torch.Tensor
    episode_index: torch.Tensor
    episode_steps: torch.Tensor
    episode_clock: torch.Tensor
    contract: Contract
    _climbing: bool
    _agents: Agents
    _every_world: torch.Tensor
    _path: ActionPath
    _randomiser: Any
    _sensors: Sensors
    _statistics: EpisodeStatistics

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            f"task '{self.name}' cannot be pickled or copied: it refers to memory of a device; make it again with "
            f"make('{self.name}', {self.num_worlds}, config=task.config) and bring its state over with state_dict() "
            "and load_state_dict()"
        )

    def extra_state(self) -> dict[str, torch.Tensor]:
        """Return the task's own state, such as a curriculum level, that a checkpoint must keep: name -> (...)."""
        return {}

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Take back what :meth:`extra_state` returned, name -> (...); write into existing buffers."""

    def _acting(self) -> contextlib.AbstractContextManager[None]:
        raise NotImplementedError

    def _climb(self, climbing: bool) -> None:
        raise NotImplementedError

    def state_dict(self) -> dict[str, Any]:
        """Return everything that a later :meth:`load_state_dict` needs to go on exactly from here."""
        state: dict[str, Any] = {
            "seed": self.random.seed,
            "iteration": self.iteration,
            "episode_index": self.episode_index.clone(),
            "episode_steps": self.episode_steps.clone(),
            "episode_clock": self.episode_clock.clone(),
            "action": self.action.clone(),
            "running_terms": self._statistics.running.clone(),
            "level": self.level.clone(),
            "drawn_level": self.drawn_level.clone(),
            "climbing": self._climbing,
            "sensing": self._sensors.state() | self._path.state() | self._contacts_state(),
            "extra": {key: value.clone() for key, value in self.contract.extra_state().items()},
            **self._agents.state(),
        }
        if self.simulation is not None:
            with self._acting():
                state["simulation"] = pack_snapshot(self.simulation.snapshot())
        return state

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take back what :meth:`state_dict` returned, for the same configuration and number of worlds.

        Raises:
            InputError: it is of another number of worlds, another simulation, or an older version of simwarp.
        """
        if state["episode_index"].shape != self.episode_index.shape:
            raise InputError(f"saved state has {len(state['episode_index'])} worlds, the task has {self.num_worlds}")
        with self._acting():
            self.random.reseed(int(state["seed"]))
            self.iteration = int(state["iteration"])
            self.episode_index.copy_(state["episode_index"])
            self.episode_steps.copy_(state["episode_steps"])
            self.episode_clock.copy_(state["episode_clock"])
            self.action.copy_(state["action"])
            self._statistics.running.copy_(state["running_terms"])
            if "level" not in state:
                raise InputError("saved state of the task was made by an older version of simwarp: start a new run")
            self.level.copy_(state["level"])
            self.drawn_level.copy_(state.get("drawn_level", state["level"]))  # older states do not tell
            self._climb(bool(state["climbing"]))
            self._sensors.load(state["sensing"])
            self._path.load(state["sensing"])
            self._agents.load(state)
            if self._randomiser is not None:
                self._randomiser.begin_episodes(self.random, self._every_world, self.drawn_level)
            if self.simulation is not None:
                self.simulation.restore(unpack_snapshot(state["simulation"], self.simulation.snapshot()))
            self._load_contacts(state["sensing"])
            self.load_extra_state(state["extra"])
