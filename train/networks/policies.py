"""Policies to act with: a trained network, nothing, and chance."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import torch
from rsl_rl.models import MLPModel
from rsl_rl.utils import resolve_class
from tensordict import TensorDict

from simwarp.core.object_repr import Readable
from simwarp.core.types import formatted
from simwarp.tasks import InputError, Task, task_class
from simwarp.tasks.framework.config import obs_of
from simwarp.tasks.framework.registry import task_word
from simwarp.tasks.framework.saved_state import check_like
from simwarp.tasks.framework.variants import variant_of

from ..algorithm.learner import TrainingError
from ..config import train_config_from_plain
from ..runs.checkpoint import SUFFIX, load_checkpoint
from ..runs.run_folder import RUNS, latest_run, read_policy
from .group_checks import check_groups
from .symmetric import task_settings

Policy = Callable[[dict[str, torch.Tensor]], torch.Tensor]
"""Observation groups -> (W, A) actions. A recurrent one has ``reset_memory`` too, see :func:`reset_memory`."""

SHIPPED = Path(__file__).parents[1] / "shipped"
UNTRAINED: Final = ("zero", "random")
"""Names of policies that need no training, where a checkpoint is asked for."""


@dataclasses.dataclass(frozen=True, repr=False)
class PolicySource(Readable):
    """A policy that a user named, and where it came from.

    Attributes:
        path: the file; ``zero`` or ``random`` for what needs none.
        content: content of the checkpoint; empty where there is none.
        origin: one phrase for the user.
    """

    path: Path
    content: dict[str, Any]
    origin: str

    def policy(self, task: Task[Any]) -> Policy:
        """Return the policy for a task.

        Raises:
            InputError: its network does not fit the task's observations or actions.
        """
        if self.content:
            return network_policy(self.content, task)
        return zero_policy(task) if str(self.path) == "zero" else random_policy(task)

    def _readable_title(self) -> str:
        return f" for task '{self.content['task']}': {self.origin}" if self.content else f": {self.origin}"

    def _readable_rows(self) -> dict[str, str]:
        return {"path": str(self.path)}


def shipped_policy(task_name: str, obs: str | None = None, variant: str | None = None) -> Path | None:
    """Return the policy that comes with the package for a task and its observations, if there is one.

    Where the task has a choice of observations and ``obs`` makes none, the task's default comes first. All policies are
    of the task's default variant.
    """
    if variant not in (None, variant_of(task_class(task_name).config_type())):
        return None
    names = [f"{task_name}.{obs}"]
    if obs is None:
        choice = obs_of(task_class(task_name).config_type())
        names = [task_name, f"{task_name}.{choice}", *sorted(path.stem for path in SHIPPED.glob(f"{task_name}.*.pt"))]
    return next((path for name in names if (path := SHIPPED / f"{name}{SUFFIX}").is_file()), None)


def named_policy(checkpoint: Path | None) -> Path | None:
    """Return the shipped policy whose name, such as ``off-road.state.soil``, stands for a checkpoint; None otherwise.

    A file or folder of that name where the user is comes first.
    """
    known = {path.name.removesuffix(SUFFIX): path for path in SHIPPED.glob(f"*{SUFFIX}")}
    path = known.get(str(checkpoint))
    return None if path is None or Path(str(checkpoint)).exists() else path


def find_policy(
    task_name: str, checkpoint: Path | None, root: Path = RUNS, obs: str | None = None, variant: str | None = None
) -> PolicySource:
    """Read the policy the user means: the given file or run, else the newest run, else the shipped one.

    A checkpoint named ``shipped`` is the shipped one for these observations, the name of one, such as
    ``off-road.state.soil``, that one; ``zero`` and ``random`` are actions without a network. With ``obs`` only a policy
    of these observations will do, with ``variant`` only one of this variant of the task.

    Raises:
        InputError: there is none, it cannot be read, or it is of another task.
    """
    if str(checkpoint) in UNTRAINED:
        return PolicySource(Path(str(checkpoint)), {}, f"{checkpoint} actions")
    named = named_policy(checkpoint)
    if named is not None:
        path, content, origin = named, load_checkpoint(named), f"policy {named.stem}, shipped with simwarp"
    elif checkpoint is not None and str(checkpoint) != SHIPPED.name:
        path, content = read_policy(checkpoint)
        origin = f"checkpoint {path}"
    else:
        run = latest_run(root, task_name, obs, variant) if checkpoint is None else None
        shipped = shipped_policy(task_name, obs, variant)
        if run is not None:
            path, content = run.load_latest()
            origin = f"newest run, {path}"
        elif shipped is not None:
            path, content, origin = shipped, load_checkpoint(shipped), "policy shipped with simwarp"
        else:
            of, option = (f" with {obs} observations", f" --obs {obs}") if obs else ("", "")
            ships = ""
            if variant:
                of, option = f"{of} in variant '{variant}'", f"{option} --task.variant {variant}"
                ships = ", and no shipped one fits"
            raise InputError(
                f"no policy for task '{task_name}'{of} in folder '{root}'{ships}: train one with "
                f"`simwarp train {task_word(task_name)}{option}`, give the folder of its runs with --runs, or a "
                f"--checkpoint, which may be {' or '.join(UNTRAINED)}"
            )
    if content["task"] != task_name:
        raise InputError(f"checkpoint {path} is of task {formatted(content['task'])}, not '{task_name}'")
    trained = content["task_config"].get("obs")
    if obs not in (None, trained):
        raise InputError(
            f"checkpoint {path} was trained on {formatted(trained)} observations, not {obs}: leave --obs away"
        )
    lived = content["task_config"].get("variant", variant_of(task_class(task_name).config_type()))
    if variant not in (None, lived):
        none = ", for which none is shipped" if path.parent == SHIPPED else ""
        raise InputError(
            f"checkpoint {path} was trained in variant {formatted(lived)} of task '{task_name}', not '{variant}'{none}:"
            f" leave --task.variant away, or train one with `simwarp train {task_word(task_name)} "
            f"--task.variant {variant}`"
        )
    return PolicySource(path, content, origin if trained is None else f"{origin} (--obs {trained})")


class NetworkPolicy(Readable):
    """The deterministic policy of a trained network.

    Attributes:
        actor: the network, in evaluation mode.
        groups: names of the observation groups, in the order the network knows them.
    """

    def __init__(self, actor: MLPModel, groups: list[str]) -> None:
        self.actor = actor
        self.groups = groups

    def _readable_title(self) -> str:
        memory = ", with memory" if self.actor.is_recurrent else ""
        numbers = sum(parameter.numel() for parameter in self.actor.parameters())
        return f": {numbers} parameters, sees {', '.join(self.groups)}{memory}"

    def __call__(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        """Return (W, A) actions: the mean, which the task clips to [-1, 1]."""
        with torch.inference_mode():
            worlds = len(observations[self.groups[0]])
            actions: torch.Tensor = self.actor(TensorDict(dict(observations), batch_size=[worlds]))
            return actions

    def reset_memory(self, ended: torch.Tensor | None = None) -> None:
        """Clear the memory of a recurrent network where episodes ended ((W,) bool), or everywhere."""
        if self.actor.is_recurrent:
            with torch.inference_mode():
                self.actor.reset(ended)


def reset_memory(policy: Policy, ended: torch.Tensor | None = None) -> None:
    """Reset a policy's hidden state where episodes ended, or everywhere with None; without a memory nothing happens."""
    clear: Callable[[torch.Tensor | None], None] | None = getattr(policy, "reset_memory", None)
    if clear is not None:
        clear(ended)


def bad_actions(actions: torch.Tensor) -> torch.Tensor:
    """Return the number of (W, A) actions that are not finite, on the device."""
    return (~actions.isfinite()).any(dim=1).sum()


def refuse_bad_actions(count: torch.Tensor, total: int, kept: str = "nothing was written") -> None:
    """Refuse what came of a policy that returned NaN; reads the device.

    Raises:
        TrainingError: it did.
    """
    if int(count):
        raise TrainingError(f"the policy returned NaN or infinity in {int(count)} of {total} actions; {kept}")


def build_actor(settings: dict[str, Any], task: Task[Any]) -> MLPModel:
    """Return a new actor for a task, as ``rsl_rl_config`` describes it; the task's worlds are not looked at."""
    model_class, options = resolve_class(settings["actor"])
    groups = {
        name: torch.zeros(task.num_worlds, *shape, dtype=task.observation_dtypes[name], device=task.device)
        for name, shape in task.observation_shapes.items()
    }
    example = TensorDict(groups, batch_size=[task.num_worlds])
    actor: MLPModel = model_class(example, settings["obs_groups"], "actor", task.action_size, **options)
    return actor.to(task.device)


def network_policy(content: dict[str, Any], task: Task[Any]) -> NetworkPolicy:
    """Return the deterministic policy of a checkpoint, for the observations of ``task``.

    Raises:
        InputError: its network does not fit the task's observations or actions.
    """
    config = train_config_from_plain(content["train_config"], "train_config of the checkpoint")
    groups = list(task.observation_shapes)
    check_groups(config.network, task.name, task.observation_shapes, task.observation_dtypes, task.observation_kinds)
    actor = build_actor(task_settings(task, config), task)
    try:
        check_like(actor.state_dict(), content["actor_state_dict"], "actor_state_dict")
    except InputError as error:
        shapes = ", ".join(f"'{name}' {shape}" for name, shape in task.observation_shapes.items())
        raise InputError(
            f"the checkpoint's network does not fit task '{task.name}' (observations {shapes}, {task.action_size}"
            f" actions): {error}"
        ) from error
    actor.load_state_dict(content["actor_state_dict"], strict=True)
    actor.eval()
    return NetworkPolicy(actor, groups)


def zero_policy(task: Task[Any]) -> Policy:
    """Return the policy that does nothing."""
    nothing = torch.zeros(task.num_worlds * task.agents, task.action_size, device=task.device)
    return lambda observations: nothing


def random_policy(task: Task[Any]) -> Policy:
    """Return the policy that draws every action uniformly from [-1, 1], reproducibly."""
    size = task.action_size

    def draw(observations: dict[str, torch.Tensor]) -> torch.Tensor:
        drawn = task.random.uniform("random policy", -1.0, 1.0, size * task.agents, per_step=True)
        return drawn if task.agents == 1 else drawn.view(-1, size)

    return draw
