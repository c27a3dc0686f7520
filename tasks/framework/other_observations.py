"""What policies of other observations would see in the same worlds: teachers of a distillation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .config import obs_of
from .errors import InputError
from .interface_checks import check_observations

if TYPE_CHECKING:
    import torch

    from .task import Task


def observed_as(task: Task[Any], obs: str | None) -> dict[str, torch.Tensor]:
    """Return the observation groups of policies of other observations, or of these, name -> (W, ...).

    Args:
        task: its worlds are looked at.
        obs: name of the observations; None: the task's own.

    Raises:
        InputError: the task does not offer them in this configuration.
        TaskError: a group is not as it has to be.
    """
    own = obs_of(task.config)
    groups = task.observations() if obs in (None, own) else task.observations_of(obs)
    if groups is None:
        besides = "" if own is None else f" with '{own}' observations"
        raise InputError(
            f"task '{task.name}'{besides} does not offer '{obs}' ones beside them: "
            f"its observations_of('{obs}') returns None"
        )
    return dict(check_observations(task, groups))
