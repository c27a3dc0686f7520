"""Actuators whose numbers differ by world and episode: what `randomise` may name of them, and how it acts.

Numbers of a law belong together: a stiffer controller has another gain and another bias, a weaker motor other limits
too. So `randomise` names what people mean, and each number drawn is a factor of all that it concerns; a delay is a
time.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch

import simwarp as sw
from simwarp.core.types import formatted

from ..framework.errors import InputError, near_names
from .randomisation_config import Mode, Range

STRENGTH, STIFFNESS, DAMPING, DELAY = "actuator_strength", "actuator_stiffness", "actuator_damping", "actuator_delay"
ARRAYS: Final[Mapping[str, tuple[str, ...]]] = {
    STRENGTH: ("gain", "bias", "force_range", "stall_force"),
    STIFFNESS: ("gain", "bias"),
    DAMPING: ("bias",),
    DELAY: ("delay",),
}
"""What `randomise` may name, and the arrays of `Actuators` that it writes."""
NO_BOUND: Final = 1.0e30
"""Stands for no bound in these arrays."""
_RULES: Final = {
    STRENGTH: "servos have the strength of their drives, `drive_effort_limit`",
    STIFFNESS: "only PD laws have a stiffness; that of servos is `drive_stiffness`",
    DAMPING: "only PD laws have a damping; that of servos is `drive_damping`",
    DELAY: "only actuators that are built with a delay have one",
}


def of_actuators(ranges: Mapping[str, Range]) -> dict[str, Range]:
    """Return the ranges that are about actuators."""
    return {name: spec for name, spec in ranges.items() if name in ARRAYS}


def own_arrays(names: Iterable[str]) -> set[str]:
    """Return the arrays of `Actuators` that need a row for each world, so that these names can be randomised."""
    return {array for name in names if name in ARRAYS for array in ARRAYS[name]}


class ActuatorNumbers:
    """What is drawn of the actuators of a simulation.

    Args:
        names: of what is drawn, among `ARRAYS`.
        simulation: that has them.
        owner: whose simulation it is: the errors name it.

    Attributes:
        views: name -> (W, A) float32 tensor of factors, and of delays [s].

    Raises:
        InputError: there are no actuators, several groups of them, or an array is shared by the worlds.
    """

    def __init__(self, names: Iterable[str], simulation: Any, owner: str) -> None:
        wanted = list(names)
        found = [element for element in simulation.elements if isinstance(element, sw.actuators.Actuators)]
        if len(found) != 1:
            raise InputError(
                f"randomise '{wanted[0]}': {owner} must have one group of actuators, got {len(found)}; add it in attach"
            )
        self.actuators: sw.actuators.Actuators = found[0]
        worlds = simulation.model.world_count
        for array in sorted(own_arrays(wanted)):
            if getattr(self.actuators, array).shape[0] != worlds:
                raise InputError(
                    f"randomise '{wanted[0]}': the actuators of {owner} share '{array}' among all worlds; make them "
                    f"with actuators_of, or with per_world=['{array}']"
                )
        self._arrays = {name: sw.to_torch(getattr(self.actuators, name)) for name in own_arrays(wanted)}
        self._built = {name: view.clone() for name, view in self._arrays.items()}
        size = (worlds, len(self.actuators))
        device = next(iter(self._arrays.values())).device
        self.views = {
            name: self._arrays["delay"] if name == DELAY else torch.ones(size, device=device) for name in wanted
        }  # fmt: skip

    def chosen(self, name: str, spec: Range) -> torch.Tensor:
        """Return (A,) bool: actuators that a range is about.

        Raises:
            InputError: one of them does not exist, or the range cannot act on it.
        """
        known = self.actuators.names
        for part in spec.only:
            if part not in known:
                raise InputError(f"randomise '{name}': there is no {formatted(part)}{near_names(part, known)}")
        acts = np.array([_acts(name, each) for each in self.actuators.specs], bool)
        mask = np.array([not spec.only or each in spec.only for each in known], bool)
        idle = [each for each, wanted, may in zip(known, mask, acts, strict=True) if wanted and not may]
        if idle and (spec.only or not acts.any()):
            where = f"'{idle[0]}'" if spec.only else "any actuator"
            raise InputError(f"randomise '{name}': it cannot act on {where}: {_RULES[name]}; leave it out")
        if name == DELAY:
            self._check_delays(spec, mask & acts)
        return torch.from_numpy(mask & acts)

    def _check_delays(self, spec: Range, mask: npt.NDArray[np.bool_]) -> None:
        """Refuse delays below zero, or longer than the lines that were built for them."""
        for each in (one for one, wanted in zip(self.actuators.specs, mask, strict=True) if wanted):
            low, high = {
                Mode.SCALE: (spec.low * each.delay, spec.high * each.delay),
                Mode.ADD: (each.delay + spec.low, each.delay + spec.high),
                Mode.SET: (spec.low, spec.high),
            }[Mode(spec.mode)]
            longest = max(one.delay for one in self.actuators.specs)
            if low < 0.0 or high > longest * (1.0 + 1e-6):
                raise InputError(
                    f"randomise '{DELAY}': delays of '{each.name}' must be from 0 to {longest:g} s, the longest built, "
                    f"got {low:g} to {high:g}; build it with the longest"
                )

    def compose(self, mask: torch.Tensor) -> None:
        """Write the laws of the present factors into the worlds of the mask ((W,) bool)."""
        one = torch.ones((), device=mask.device)
        strength, stiffness, damping = (self.views.get(name, one) for name in (STRENGTH, STIFFNESS, DAMPING))
        for name, built in self._built.items():
            if name == "delay":
                continue
            value = built * strength[..., None] if built.dim() == 3 and strength.dim() else built * strength
            if name == "gain":
                value[..., 0] *= stiffness
            elif name == "bias":
                value[..., 1] *= stiffness
                value[..., 2] *= damping
            else:
                value = torch.where(built.abs() < NO_BOUND, value, built)
            where = mask.view(-1, *(1,) * (built.dim() - 1))
            self._arrays[name].copy_(torch.where(where, value, self._arrays[name]))


def _acts(name: str, spec: sw.actuators.ActuatorSpec) -> bool:
    """True if what is drawn has an effect on an actuator."""
    if name == DELAY:
        return spec.delay > 0.0
    if spec.law is sw.actuators.Law.SERVO:
        return False
    if name == STIFFNESS:
        return spec.bias[1] != 0.0 and spec.gain[0] == -spec.bias[1]
    return name == STRENGTH or spec.bias[2] != 0.0
