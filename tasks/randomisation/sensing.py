"""Delays and noise between a task and its policy: delayed actions, and observations that are late, noisy or biased."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from simwarp.core.types import formatted

from ..framework.argument_checks import check_room
from ..framework.errors import InputError, near_names
from .randomisation_config import Sensing
from .randomness import WorldRandom


class WorldRows:
    """Rows of worlds that become copies of others.

    Args:
        source_of: (W,) int, the world that each becomes a copy of; -1: it stays.
    """

    def __init__(self, source_of: torch.Tensor) -> None:
        self._stays = source_of < 0
        self._source = source_of.clamp(min=0).to(torch.int64)

    def of(self, mine: torch.Tensor, theirs: torch.Tensor) -> torch.Tensor:
        """Return ``mine`` (W, ...) or (W * N, ...) with the rows of ``theirs`` in the worlds that become copies."""
        worlds = len(self._source)
        rows = mine.reshape(worlds, -1)
        there = theirs.reshape(-1, rows.shape[1]).index_select(0, self._source)
        return torch.where(self._stays.unsqueeze(1), rows, there).view_as(mine)

    def into(self, mine: torch.Tensor, theirs: torch.Tensor) -> None:
        """Write what `of` returns into ``mine``."""
        if mine.numel():
            mine.copy_(self.of(mine, theirs))


class DelayLine:
    """The last values of a (W, ...) tensor, and those that each world sees.

    Args:
        like: a tensor of that shape, dtype and device.
        bounds: least and largest delay [control steps].
        purpose: the name of its random draws.
        agents: agents of a world, N; each has a delay of its own.

    Raises:
        InputError: so many values do not fit into memory.
    """

    def __init__(self, like: torch.Tensor, bounds: tuple[int, int], purpose: str, agents: int = 1) -> None:
        self.least, self.largest = bounds
        self.purpose = purpose
        shape = (self.largest + 1, *like.shape)
        what = f"{purpose} up to {formatted(self.largest)} steps: the last values of {like.shape[0]} worlds"
        check_room(what, (1 + shape[0], *shape[1:]), like.dtype, like.device, "shorten the delay or take fewer worlds")
        self.values = torch.zeros(shape, dtype=like.dtype, device=like.device)
        """(D + 1, W, ...): the newest first."""
        self._rows = like.shape[0] * agents
        self._agents = agents
        self.delay = torch.zeros(self._rows, dtype=torch.int64, device=like.device)
        """(W * N,) int64 control steps."""
        self._row = torch.arange(self._rows, device=like.device)
        self._seen = torch.zeros_like(like)

    def push(self, value: torch.Tensor) -> None:
        """Take in the value of a control step."""
        for age in range(self.largest, 0, -1):
            self.values[age].copy_(self.values[age - 1])
        self.values[0].copy_(value)

    def fill(self, mask: torch.Tensor, value: torch.Tensor, random: WorldRandom) -> None:
        """Begin an episode in the worlds of the mask: ``value`` was there all along, and the delay is a new one."""
        where = mask.view(1, -1, *(1,) * (value.dim() - 1))
        torch.where(where, value, self.values, out=self.values)
        drawn = random.integers(self.purpose, self.least, self.largest + 1, self._agents)
        self.delay.copy_(torch.where(mask.unsqueeze(1), drawn, self.delay.view(drawn.shape)).flatten())

    def read(self) -> torch.Tensor:
        """Return (W, ...), each agent's value as late as its delay; in memory that the next call writes again."""
        rows, seen = self.values.view(len(self.values) * self._rows, -1), self._seen.view(self._rows, -1)
        torch.index_select(rows, 0, self.delay * self._rows + self._row, out=seen)
        return self._seen

    def take(self, other: DelayLine, copied: WorldRows) -> None:
        """Take over what worlds of another line, or of this one, have waiting."""
        for age, values in enumerate(self.values):
            copied.into(values, other.values[age])
        copied.into(self.delay, other.delay)

    def state(self, name: str) -> dict[str, torch.Tensor]:
        """Return the state that a checkpoint keeps."""
        return {f"{name} values": self.values.clone(), f"{name} delay": self.delay.clone()}

    def load(self, name: str, state: Mapping[str, torch.Tensor]) -> None:
        """Take back what :meth:`state` returned."""
        self.values.copy_(state[f"{name} values"])
        self.delay.copy_(state[f"{name} delay"])


class Sensors:
    """Delay, bias and noise of the observation groups that a configuration names; others pass untouched.

    Args:
        sensing: group name -> what to do with it.
        groups: observation groups of the task.
        random: draws.
        agents: agents of a world, N; then groups are (W, N, ...).
    """

    def __init__(
        self, sensing: Mapping[str, Sensing], groups: Mapping[str, torch.Tensor], random: WorldRandom, agents: int = 1
    ) -> None:
        self._random = random
        self._specs = dict(sensing)
        self._lines: dict[str, DelayLine] = {}
        self._spread: dict[tuple[str, str], torch.Tensor] = {}
        for name, spec in sensing.items():
            if name not in groups:
                raise InputError(f"sensing: there is no observation {formatted(name)}{near_names(name, groups)}")
            group = groups[name]
            if spec.delay[1]:
                self._lines[name] = DelayLine(group, spec.delay, f"delay of {name}", agents)
            for kind in ("noise", "bias"):
                value = getattr(spec, kind)
                if value and not group.is_floating_point():
                    raise InputError(f"sensing '{name}': {kind} needs a floating-point observation, not {group.dtype}")
                spread = torch.tensor(value, dtype=torch.float32, device=group.device)
                shape = tuple(group.shape[1 if agents == 1 else 2 :])
                if spread.dim() and (len(spread),) != shape:
                    raise InputError(f"sensing '{name}': {kind} has {len(spread)} values, the observation {shape}")
                if bool((spread > 0).any()):
                    self._spread[name, kind] = spread

    @property
    def late(self) -> bool:
        """True if any group is delayed: its history must see the state before a reset too."""
        return bool(self._lines)

    def push(self, groups: Mapping[str, torch.Tensor]) -> None:
        """Take in the groups of a control step."""
        for name, line in self._lines.items():
            line.push(groups[name])

    def begin(self, mask: torch.Tensor, groups: Mapping[str, torch.Tensor]) -> None:
        """Begin an episode in the worlds of the mask."""
        for name, line in self._lines.items():
            line.fill(mask, groups[name], self._random)

    def sense(self, groups: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        """Return the groups as the policy gets them; changes nothing."""
        if not self._specs:
            return groups
        sensed = dict(groups)
        for name, line in self._lines.items():
            sensed[name] = line.read()
        for (name, kind), spread in self._spread.items():
            group = sensed[name]
            shape, size = group.shape, group[0].numel()
            drawn = self._random.normal(f"{kind} of {name}", size=size, per_step=kind == "noise")
            sensed[name] = group + spread * drawn.view(shape).to(group.dtype)
        return sensed

    def take(self, other: Sensors, copied: WorldRows) -> None:
        """Take over what worlds of others, or of these, have waiting."""
        for name, line in self._lines.items():
            line.take(other._lines[name], copied)

    def state(self) -> dict[str, Any]:
        """Return the state that a checkpoint keeps."""
        return {key: value for name, line in self._lines.items() for key, value in line.state(name).items()}

    def load(self, state: Mapping[str, Any]) -> None:
        """Take back what :meth:`state` returned."""
        for name, line in self._lines.items():
            line.load(name, state)
