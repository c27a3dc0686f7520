"""What policies of other observations would see in the same worlds: teachers of a distillation."""

from __future__ import annotations

from typing import Any, Protocol

import torch

from .config import obs_of
from .contract import Contract
from .errors import InputError
from .interface_checks import Worlds


class Observed(Worlds, Protocol):
    """Interface of a task that is observed."""

    @property
    def config(self) -> Any:
        """Of the task."""
        ...

    contract: Contract
    """Calls its methods."""


def observed_as(task: Observed, obs: str | None) -> dict[str, torch.Tensor]:
    """Return the observation groups of policies of other observations, or of these, name -> (W, ...).

    Args:
        task: its worlds are looked at.
        obs: name of the observations; None: the task's own.

    Raises:
        InputError: the task does not offer them in this configuration.
        TaskError: a group is not as it has to be.
    """
    own = obs_of(task.config)
    contract = task.contract
    groups = contract.observations() if obs in (None, own) else contract.observations_of(obs)
    if groups is None:
        besides = "" if own is None else f" with '{own}' observations"
        raise InputError(
            f"task '{task.name}'{besides} does not offer '{obs}' ones beside them: "
            f"its observations_of('{obs}') returns None"
        )
    return groups
