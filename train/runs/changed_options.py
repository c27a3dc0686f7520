"""Options that have changed since a checkpoint was written, told where it does not fit them."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from simwarp.core.types import formatted
from simwarp.core.wording import option_word
from simwarp.tasks import InputError, TaskConfig
from simwarp.tasks.framework.config_values import plain_value

from ..algorithm.learner import OtherNetworksError
from ..config import TrainConfig, configs_from_plain

_MOST_TOLD: Final = 6


def changed_options(before: Any, after: Any, option: str) -> list[str]:
    """Return options whose values differ, each with both, as ``--task.dt was 0.01, is 0.02``.

    Args:
        before, after: configurations of one class, or values of an option.
        option: name of theirs, such as ``task``.
    """
    if dataclasses.is_dataclass(before) and type(before) is type(after):
        return [
            words
            for field in dataclasses.fields(before)
            for words in changed_options(
                getattr(before, field.name), getattr(after, field.name), f"{option}.{option_word(field.name)}"
            )
        ]
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        names = dict.fromkeys([*before, *after])
        return [
            words
            for name in names
            for words in changed_options(before.get(name), after.get(name), f"{option} {str(name)!r}")
        ]
    return [] if before == after else [f"--{option} was {_value(before)}, is {_value(after)}"]


def _value(value: Any) -> str:
    plain = dataclasses.asdict(value) if dataclasses.is_dataclass(value) and not isinstance(value, type) else value
    return formatted(plain if isinstance(plain, tuple) else plain_value(plain))


def changed_options_error(
    error: InputError, path: Path, content: Mapping[str, Any], config: TrainConfig, task_config: TaskConfig
) -> InputError:
    """Return the error that says which options a checkpoint does not fit; the given one where none has changed.

    Args:
        error: of loading it.
        path: of the checkpoint.
        content: what is in it.
        config, task_config: those that it was to go on with.
    """
    where = f"checkpoint {path}"
    made, lived = configs_from_plain(content, where)
    changes = changed_options(lived, task_config, "task") + changed_options(made.network, config.network, "network")
    if not changes:
        return error
    more = [f"and {len(changes) - _MOST_TOLD} more"] if len(changes) > _MOST_TOLD else []
    # A policy starts a run in other worlds, but not as another network
    start = "" if isinstance(error, OtherNetworksError) else f" from its policy: --warm-start {shlex.quote(str(path))}"
    return InputError(
        f"{where} is of other networks or worlds: {'; '.join([*changes[:_MOST_TOLD], *more])}; go on without what has"
        f" changed, or begin a new run{start}"
    )
