"""Learning from agents that act: rows of those that are done before others of their world are left out of a rollout."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import torch
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict

_STANDARD_EPSILON = 1e-8
"""That of rsl-rl, where it makes advantages of mean 0 and deviation 1."""


class ActingRows:
    """Which samples of a rollout are of agents that acted.

    Args:
        steps: control steps of a rollout.
        rows: agents of all worlds.
        device: of the rollout.
    """

    def __init__(self, steps: int, rows: int, device: str) -> None:
        self._acting = torch.ones(steps, rows, dtype=torch.bool, device=device)

    def record(self, step: int, acting: torch.Tensor) -> None:
        """Record the mask of a step, (rows,) bool."""
        self._acting[step] = acting

    @property
    def share(self) -> float:
        """Samples that are learned from, over all; reads the device."""
        return float(self._acting.float().mean())

    @contextlib.contextmanager
    def alone(self, algorithm: object, *, standardise: bool) -> Iterator[None]:
        """Let an algorithm learn from the samples of agents that acted, as if there were no others.

        Args:
            algorithm: of rsl-rl; its ``storage`` is another one within.
            standardise: the advantages of the rollout were made of mean 0 and deviation 1: those left are again.
        """
        whole: RolloutStorage = algorithm.storage  # type: ignore[attr-defined]
        algorithm.storage = self._compact(whole, standardise)  # type: ignore[attr-defined]
        try:
            yield
        finally:
            algorithm.storage = whole  # type: ignore[attr-defined]
            whole.clear()

    def _compact(self, whole: RolloutStorage, standardise: bool) -> RolloutStorage:
        """Return a rollout of one step, whose rows are the samples of agents that acted."""
        chosen = self._acting.flatten().nonzero().flatten()
        count = len(chosen)

        def pick(values: torch.Tensor) -> torch.Tensor:
            return values.flatten(0, 1).index_select(0, chosen).unsqueeze(0)

        part = RolloutStorage.__new__(RolloutStorage)
        vars(part).update(vars(whole))
        part.num_envs, part.num_transitions_per_env = count, 1
        groups = {name: pick(group) for name, group in whole.observations.items()}
        part.observations = TensorDict(groups, batch_size=[1, count], device=whole.observations.device)
        for name in ("rewards", "actions", "dones", "values", "actions_log_prob", "returns", "advantages"):
            setattr(part, name, pick(getattr(whole, name)))
        part.distribution_params = tuple(pick(one) for one in whole.distribution_params or ())
        if standardise:
            gains = part.advantages
            part.advantages = (gains - gains.mean()) / (gains.std() + _STANDARD_EPSILON)
        return part
