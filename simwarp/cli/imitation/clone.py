"""``simwarp clone``."""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path
from typing import Any

from simwarp.cli import DONE, INTERRUPTED, UsageError
from simwarp.cli.imitation.dataset_options import CloneOptions
from simwarp.cli.options import HELP, in_shell, option_value, parse_options, split_task, task_options
from simwarp.core.stopping import stop_on_signals
from simwarp.tasks import make, task_class, task_names


def run(arguments: list[str]) -> int:
    """Clone as the arguments say; 130 after an interruption."""
    word, arguments = split_task(arguments, "clone", task_names())
    cls = task_class(word)
    name = cls.name
    import torch

    from simwarp.train.algorithm.cloning import CloneConfig, clone
    from simwarp.train.config import default_config, task_config_from_plain
    from simwarp.train.datasets.dataset_formats import load_trajectories
    from simwarp.train.runs.checkpoint import save_checkpoint

    torch.set_num_threads(1)
    source = option_value(arguments, "--data")
    data = None if source is None or HELP & set(arguments) else load_trajectories(Path(source), name)
    task_config = cls.config_type()
    if data is not None:
        task_config = task_config_from_plain(cls, data.about["task_config"], f"trajectories '{source}': task_config")
    train_config = default_config(cls, task_config)
    kind = task_options("CloneCommand", CloneOptions, flat_clone=CloneConfig(), network=train_config.network)
    options: Any = parse_options(kind, arguments, f"simwarp clone {word}")
    target = options.output or Path(f"{name}_clone.pt")
    options.check(options.data, output=target)
    if data is None:
        raise UsageError(f"which trajectories? usage: simwarp clone {word} --data FILE_OR_FOLDER")
    task = make(name, max(1, len(task_config.by_model())), config=task_config)
    console = options.console()

    def report(epoch: int, loss: float) -> None:
        if epoch == 1 or epoch % 10 == 0 or epoch == options.flat_clone.epochs:
            console.print(f"epoch {epoch}/{options.flat_clone.epochs}  loss {loss:.3g}", highlight=False)

    config = dataclasses.replace(train_config, network=options.network)
    with stop_on_signals() as stop:
        result = clone(task, data, options.flat_clone, config, report, stop)
        with stop.saving():
            save_checkpoint(target, result.content)
    interrupted = result.epochs < options.flat_clone.epochs
    console.print(
        f"imitates {result.steps:,} steps: mean squared error {result.loss:.3g}, {result.held_out_loss:.3g} on"
        " episodes held out",
        highlight=False,
        soft_wrap=True,
    )
    told = f"interrupted and saved after {result.epochs} of {options.flat_clone.epochs} epochs; " if interrupted else ""
    console.print(f"{told}wrote {target}", highlight=False, soft_wrap=True)
    console.print(
        f"next   simwarp train {in_shell(name)} --warm-start {shlex.quote(str(target))} --critic-warmup 10",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
    options.emit(
        {
            "task": name,
            "output": str(target),
            "steps": result.steps,
            "loss": result.loss,
            "held_out_loss": result.held_out_loss,
            "interrupted": interrupted,
        }
    )
    return INTERRUPTED if interrupted else DONE
