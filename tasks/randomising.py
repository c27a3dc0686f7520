"""Model parameters drawn anew for worlds whose episode begins, or in every control step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from .errors import InputError, near_names
from .randomness import WorldRandom
from .uncertainty import Mode, Range, When


class _Parameter:
    """One parameter: the view of it, its built value, and which of its entries are drawn."""

    def __init__(self, name: str, spec: Range, model: Any) -> None:
        from simwarp.interop import to_torch

        self.name = name
        self.spec = spec
        self.view = to_torch(getattr(model, name))
        self.built = self.view.clone()
        self.chosen = _chosen(name, spec, model, self.view)
        trailing = self.view.dim() - (1 if name == "gravity" else 2)
        if not self.view.is_floating_point():
            raise InputError(f"randomise '{name}': it holds whole numbers, which no range describes")
        if trailing and spec.mode is not Mode.SCALE:
            raise InputError(f"randomise '{name}': vectors and matrices can be scaled only")
        self.count = 1 if name == "gravity" else self.view.shape[1]
        self.shape = (self.view.shape[0],) + (() if name == "gravity" else (self.count,)) + (1,) * trailing

    def draw(self, random: WorldRandom, mask: torch.Tensor, level: torch.Tensor) -> None:
        """Write new values into the worlds of the mask."""
        spec, per_step = self.spec, self.spec.when is When.STEP
        purpose = f"randomise {spec.draw or self.name}"
        size = 1 if spec.shared else self.count
        number = random.uniform(purpose, spec.low, spec.high, size=size, per_step=per_step).expand(-1, self.count)
        number = number.reshape(self.shape).to(self.view.dtype)
        if spec.mode is Mode.SCALE:
            value = self.built * number
        elif spec.mode is Mode.ADD:
            value = self.built + number
        else:
            value = number.expand_as(self.view)
        if spec.grows:
            share = level.to(self.view.dtype).view(-1, *(1,) * (self.view.dim() - 1))
            value = self.built + share * (value - self.built)
        where = mask.view(-1, *(1,) * (self.view.dim() - 1)) & self.chosen
        self.view.copy_(torch.where(where, value, self.view))


def _chosen(name: str, spec: Range, model: Any, view: torch.Tensor) -> torch.Tensor:
    """Return a mask over the entries of a parameter that broadcasts to it: those that ``only`` names."""
    if not spec.only:
        return torch.ones((1,) * view.dim(), dtype=torch.bool, device=view.device)
    head = name.partition("_")[0]
    names = {"body": model.body_names, "joint": model.joint_names, "drive": model.joint_names}.get(head)
    names = model.shape_names if head == "shape" else names
    if names is None:
        raise InputError(f"randomise '{name}': it has no parts that `only` could name")
    mask = torch.zeros(view.shape[1], dtype=torch.bool)
    for part in spec.only:
        if part not in names:
            raise InputError(f"randomise '{name}': there is no '{part}'{near_names(part, names)}")
        index = names.index(part)
        if head in ("joint", "drive") and view.shape[1] == model.dof_count:
            mask[model.joint_dof_start[index] : model.joint_dof_start[index + 1]] = True
        else:
            mask[index] = True
    return mask.to(view.device).view(1, -1, *(1,) * (view.dim() - 2))


class Randomiser:
    """Draws the parameters that a configuration names.

    Args:
        ranges: parameter name -> range.
        model: a model whose named parameters have a copy per world.
    """

    def __init__(self, ranges: Mapping[str, Range], model: Any) -> None:
        self._parameters = [_Parameter(name, spec, model) for name, spec in ranges.items()]
        self._by_step = [item for item in self._parameters if item.spec.when is When.STEP]

    def begin_episodes(self, random: WorldRandom, mask: torch.Tensor, level: torch.Tensor) -> None:
        """Draw everything in the worlds of the mask ((W,) bool)."""
        for item in self._parameters:
            item.draw(random, mask, level)

    def begin_step(self, random: WorldRandom, every: torch.Tensor, level: torch.Tensor) -> None:
        """Draw what changes in every control step."""
        for item in self._by_step:
            item.draw(random, every, level)


def check_ranges(ranges: Mapping[str, Range]) -> None:
    """Refuse the name of a parameter that does not exist."""
    from simwarp.model import PARAMETERS

    for name in ranges:
        if name not in PARAMETERS:
            raise InputError(f"randomise: there is no model parameter '{name}'{near_names(name, PARAMETERS)}")
