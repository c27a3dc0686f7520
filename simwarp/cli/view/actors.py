"""Whoever acts in a task that is shown: a trained policy, nothing, or chance."""

from __future__ import annotations

import dataclasses
from typing import Any

from simwarp.cli.evaluating import policy_defaults
from simwarp.cli.options import option_value
from simwarp.tasks import InputError, Task
from simwarp.train.networks.policies import Policy, find_policy, network_policy, random_policy, zero_policy


@dataclasses.dataclass(frozen=True, eq=False)
class Actor:
    """Who acts.

    Attributes:
        origin: one phrase for the user.
        config: of the task that it was trained on; None: it was not.
        content: of its checkpoint; None: it has none.
        kind: "policy", "zero" or "random".
    """

    origin: str
    config: Any = None
    content: dict[str, Any] | None = None
    kind: str = "policy"

    def policy(self, task: Task[Any]) -> Policy:
        """The policy for a task."""
        if self.content is not None:
            return network_policy(self.content, task)
        return random_policy(task) if self.kind == "random" else zero_policy(task)


def find_actor(name: str, arguments: list[str]) -> Actor:
    """The actor that the arguments mean: without any the newest run, the shipped policy, else chance.

    Raises:
        InputError: the named one cannot be read or is of another task.
    """
    from simwarp.train.config import task_config_from_plain

    asked = option_value(arguments, "--checkpoint")
    if asked in ("zero", "random"):
        return Actor(f"{asked} actions", kind=asked)
    try:
        source, config = policy_defaults(name, arguments, find_policy, task_config_from_plain)
    except InputError:
        if asked is not None:
            raise
        return Actor("random actions: there is no policy yet", kind="random")
    if source is None:
        return Actor("")
    return Actor(source.origin, config, source.content)
