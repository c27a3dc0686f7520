"""Whoever acts in a task that is shown: a trained policy, nothing, or chance."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from simwarp.cli import HELP, UsageError
from simwarp.cli.options import option_value
from simwarp.cli.policy_command import policy_defaults
from simwarp.core.types import formatted
from simwarp.tasks import InputError, Task, task_class
from simwarp.train.config import task_config_from_plain
from simwarp.train.networks.policies import Policy, network_policy, random_policy, zero_policy
from simwarp.train.runs.run_folder import CHECKPOINTS, CONFIG, open_run


@dataclasses.dataclass(frozen=True, eq=False)
class Actor:
    """Who acts.

    Attributes:
        origin: one phrase for the user.
        config: of the task that it was trained on; None: it was not.
        content: of its checkpoint; None: it has none.
        kind: "policy", "zero" or "random".
        run: folder of the run that it is from, if it is from one.
        path: of the checkpoint.
    """

    origin: str
    config: Any = None
    content: dict[str, Any] | None = None
    kind: str = "policy"
    run: Path | None = None
    path: Path | None = None

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
    asked, run = option_value(arguments, "--checkpoint"), option_value(arguments, "--reload")
    if run is not None and not HELP & set(arguments):
        if asked is not None:
            raise UsageError("--reload begins with the newest checkpoint of its run: leave --checkpoint away")
        return _of_run(name, Path(run))
    try:
        source, config = policy_defaults(name, arguments)
    except InputError:
        if asked is not None:
            raise
        return Actor("random actions: there is no policy yet", kind="random")
    if source is None:
        return Actor("")
    if not source.content:
        return Actor(source.origin, kind=str(source.path))
    return Actor(source.origin, config, source.content, run=_run_of(source.path), path=source.path)


def _of_run(name: str, path: Path) -> Actor:
    """The newest checkpoint of a run; chance until there is one."""
    folder = open_run(path)
    saved = folder.load_config()
    if saved["task"] != name:
        raise InputError(f"run {path} is of task {formatted(saved['task'])}, not '{name}'")
    config = task_config_from_plain(task_class(name), saved["task_config"], f"{path / CONFIG}: task_config")
    if not folder.checkpoint_files():
        return Actor("random actions until the run has a checkpoint", config, kind="random", run=path)
    file, content = folder.load_latest()
    return Actor(f"checkpoint {file}", config, content, run=path, path=file)


def _run_of(checkpoint: Path) -> Path | None:
    """Folder of the run that a checkpoint lies in."""
    folder = checkpoint.parent.parent
    return folder if checkpoint.parent.name == CHECKPOINTS and (folder / CONFIG).is_file() else None
