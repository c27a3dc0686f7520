"""What commands on a task's policy share: the task, the policy, and options whose defaults come from both."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simwarp.cli import HELP
from simwarp.cli.options import (
    CommonOptions,
    check_variant,
    chosen_obs,
    chosen_variant,
    config_of_variant,
    expand_shorthands,
    option_value,
    parse_options,
    split_task_or_run,
    task_options,
)
from simwarp.tasks import task_class, task_names

if TYPE_CHECKING:
    from simwarp.train.networks.policies import PolicySource


@dataclasses.dataclass(frozen=True, eq=False)
class PolicyCommand:
    """A command whose words are known, but not yet parsed.

    Attributes:
        name: of the task.
        program: the command as help texts name it.
        arguments: the words after the task.
        source: the policy that they mean; None where they ask for help.
        kind: of the options, those of the task's configuration included.
    """

    name: str
    program: str
    arguments: list[str]
    source: PolicySource | None
    kind: type[Any]

    def options(self, more: list[str] | None = None) -> Any:
        """The options, after further words if there are some.

        Raises:
            UsageError: one is wrong.
        """
        return parse_options(self.kind, [*self.arguments, *(more or [])], self.program)


def policy_command(command: str, arguments: list[str], base: type[CommonOptions]) -> PolicyCommand:
    """Finds task and policy of a command; learning and acting get one thread of torch.

    Args:
        command: its name.
        arguments: its words.
        base: of its options: a frozen dataclass.

    Raises:
        UsageError: no task is named.
        InputError: there is no such task or policy.
    """
    word, arguments = split_task_or_run(arguments, command, task_names())
    cls = task_class(word)
    arguments = expand_shorthands(arguments, cls.name, cls.config_type())
    import torch

    torch.set_num_threads(1)
    source, config = policy_defaults(cls.name, arguments)
    kind = task_options(f"{command.capitalize()}Command", base, task=config or config_of_variant(arguments, cls))
    return PolicyCommand(cls.name, f"simwarp {command} {word}", arguments, source, kind)


def policy_defaults(name: str, arguments: list[str]) -> tuple[PolicySource | None, Any]:
    """The policy and the configuration it was trained with, which is the default of the task's options.

    No policy where the arguments ask for help, which must work without one; no configuration where it was not trained.
    """
    from simwarp.train.config import task_config_from_plain
    from simwarp.train.networks.policies import find_policy

    if HELP & set(arguments):
        return None, None
    checkpoint, variant = option_value(arguments, "--checkpoint"), chosen_variant(arguments)
    check_variant(name, task_class(name).config_type(), variant)
    runs = Path(option_value(arguments, "--runs") or "runs")
    source = find_policy(name, None if checkpoint is None else Path(checkpoint), runs, chosen_obs(arguments), variant)
    if not source.content:
        return source, None
    where = f"checkpoint {source.path}: task_config"
    return source, task_config_from_plain(task_class(name), source.content["task_config"], where)
