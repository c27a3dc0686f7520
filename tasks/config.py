"""The configuration every task shares, and the checks its fields obey."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, TypeVar

from .errors import InputError, near_names

ConfigT = TypeVar("ConfigT")


def require(condition: bool, config: object, field: str, rule: str) -> None:
    """Raise an :class:`InputError` that names the field, the rule and the value, unless it holds."""
    if not condition:
        value = getattr(config, field)
        raise InputError(f"{field.replace('_', '-')} must be {rule}, got {value!r}")


def require_finite(config: Any) -> None:
    """Raise an :class:`InputError` for the first float field that is infinite or NaN."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if isinstance(value, float):
            require(math.isfinite(value), config, field.name, "a finite number")


def replace_fields(config: ConfigT, changes: Mapping[str, Any]) -> ConfigT:
    """Return ``config`` with some fields replaced; ``"ppo.gamma"`` reaches into a nested config.

    Raises:
        InputError: there is no such field, or the new value breaks its rule.
    """
    grouped: dict[str, dict[str, Any]] = {}
    direct: dict[str, Any] = {}
    names = {field.name for field in dataclasses.fields(config)}  # type: ignore[arg-type]
    for key, value in changes.items():
        head, _, rest = key.partition(".")
        if head not in names:
            raise InputError(f"{type(config).__name__} has no field '{head}'{near_names(head, names)}")
        if rest:
            grouped.setdefault(head, {})[rest] = value
        else:
            direct[head] = value
    for head, nested in grouped.items():
        direct[head] = replace_fields(direct.get(head, getattr(config, head)), nested)
    return dataclasses.replace(config, **direct)  # type: ignore[type-var]


@dataclasses.dataclass(frozen=True)
class TaskConfig:
    """Fields that every task has; a task adds its own in a frozen subclass."""

    dt: float = 0.01
    """Physics step [s]."""
    substeps: int = 1
    """Sub-steps of dt / substeps inside one physics step."""
    decimation: int = 1
    """Physics steps per control step; one action lasts decimation * dt seconds."""
    max_episode_steps: int = 1000
    """Control steps after which an episode is truncated."""
    action_rise_time: float = 0.0
    """Time an action takes from 0 to 1 [s]: it moves at most control_dt / rise time per control step; 0 is at once."""

    def __post_init__(self) -> None:
        require_finite(self)
        require(self.dt > 0.0, self, "dt", "positive")
        require(self.substeps >= 1, self, "substeps", "at least 1")
        require(self.decimation >= 1, self, "decimation", "at least 1")
        require(self.max_episode_steps >= 1, self, "max_episode_steps", "at least 1")
        require(self.action_rise_time >= 0.0, self, "action_rise_time", "zero or positive")
        self.validate()

    def validate(self) -> None:
        """Check the fields of a subclass with :func:`require`; called after the shared ones."""

    @property
    def control_dt(self) -> float:
        """Time between two actions [s]."""
        return self.dt * self.decimation
