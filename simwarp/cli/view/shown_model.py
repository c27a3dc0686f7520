"""One model of a mixed batch, for pages and files that show worlds of one simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from simwarp.core.wording import option_word
from simwarp.tasks import TaskConfig

ConfigT = TypeVar("ConfigT", bound=TaskConfig)


def shown_config(config: ConfigT, say: Callable[[str], None]) -> ConfigT:
    """Return the configuration of the model that is shown: of several the first, and which others there are is said.

    Args:
        config: of the task.
        say: prints a line.
    """
    models, mix = config.by_model(), config.mixed()
    if not models or mix is None:
        return config
    first, *others = models
    option = f"--task.{option_word(mix.field)}"
    say(f"showing '{first}', one of {len(models)} models; {option} {others[0]} shows another")
    return models[first]
