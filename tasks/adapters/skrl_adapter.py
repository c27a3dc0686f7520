"""True final observations for agents of skrl; needs ``simwarp[skrl]``.

skrl steps a task through its own wrapper of Gymnasium's vector environments:

    env = wrap_env(TaskVectorEnv("pendulum", 64))

Its agents take the observation that a step returned for the one that followed the action. Where an episode ended, the
worlds have been reset and that is the first observation of the next episode: a time-out would be valued by a state that
it never led to. :class:`FinalObservations` hands the agent the true one:

    class TruePPO(FinalObservations, PPO): ...

With ``time_limit_bootstrap`` set, PPO then values a time-out by the state it cut off; agents with a replay memory store
the right transitions.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import torch
from skrl.utils.spaces.torch import flatten_tensorized_space, tensorize_space

__all__ = ["FinalObservations"]


def true_next(space: gymnasium.Space[Any], next_observations: torch.Tensor, infos: dict[str, Any]) -> torch.Tensor:
    """Return the observations after the actions, (W, N): the true final observation where an episode ended.

    Args:
        space: space of one world's observation.
        next_observations: (W, N) flattened, as skrl's wrapper returned them; not changed.
        infos: infos of the step of a ``TaskVectorEnv``.
    """
    if "final_obs" not in infos:
        return next_observations
    true = next_observations.clone()
    for world in np.flatnonzero(infos["_final_obs"]):
        row = flatten_tensorized_space(tensorize_space(space, infos["final_obs"][world], device=true.device))
        true[world] = row.reshape(-1)
    return true


class FinalObservations:
    """Mixin before an agent class of skrl, for one agent over all worlds of a ``TaskVectorEnv``."""

    observation_space: Any

    def record_transition(self, *, next_observations: torch.Tensor, infos: Any, **rest: Any) -> None:
        """Record a transition, with the true final observations."""
        true = true_next(self.observation_space, next_observations, infos)
        super().record_transition(next_observations=true, infos=infos, **rest)  # type: ignore[misc]
