"""``simwarp eval``."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from simwarp.cli import DONE, UsageError
from simwarp.cli.options import (
    HELP,
    CommonOptions,
    chosen_obs,
    expand_obs,
    option_value,
    parse_options,
    take_task,
    task_options,
)
from simwarp.tasks import resolve_device, task_class, task_names

if TYPE_CHECKING:
    from simwarp.train.evaluation import Evaluation

_NAMES = {"policy": "trained", "zero": "zero action", "random": "random"}


@dataclasses.dataclass(frozen=True)
class EvalOptions(CommonOptions):
    """Statistics of a policy over fresh worlds, with the zero-action and the random policy beside it."""

    episodes: int = 256
    """Episodes, each world's first ones."""
    checkpoint: Path | None = None
    """Checkpoint file or run folder; by default the newest run of the task, else the shipped policy."""
    num_envs: int | None = None
    """Worlds stepped together; by default one per episode, at most 4096."""
    seed: int = 1_000_003
    """Seed of the worlds, other than that of training."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""
    grid: str | None = None
    """KEY=a,b,c: evaluate once for each value of a field of the task's configuration."""
    runs: Path = Path("runs")
    """Folder of the run folders."""


def run(arguments: list[str]) -> int:
    """Evaluate as the arguments say."""
    name, arguments = take_task(arguments, "eval", task_names())
    cls = task_class(name)
    arguments = expand_obs(arguments, name, cls.config_type())
    import torch

    from simwarp.train.config import task_config_from_plain
    from simwarp.train.evaluation import evaluate_with_baselines
    from simwarp.train.policies import find_policy, network_policy

    torch.set_num_threads(1)
    source, config = policy_defaults(name, arguments, find_policy, task_config_from_plain)
    kind = task_options("EvalCommand", EvalOptions, task=config or cls.config_type())

    def parse(words: list[str]) -> Any:
        return parse_options(kind, words, f"simwarp eval {name}")

    options = parse(arguments)
    options.check()
    _check_counts(options)
    device = resolve_device(options.device)
    source = source or find_policy(name, options.checkpoint, options.runs, chosen_obs(arguments))
    console = options.console()
    results: list[dict[str, Any]] = []
    # A value of the grid is one more option, so that it is typed and checked like any other; all before the first run
    points = [
        (key, parse([*arguments, f"--task.{key}", word]).task if key else options.task)
        for key, word in _grid(options.grid)
    ]
    for key, task_config in points:
        label = {key: getattr(task_config, key.replace("-", "_"))} if key else {}
        evaluations = evaluate_with_baselines(
            name,
            lambda task: network_policy(source.content, task),
            config=task_config,
            episodes=options.episodes,
            seed=options.seed,
            device=device,
            num_envs=options.num_envs,
        )
        title = ", ".join(
            [name, f"{options.episodes} episodes", *(f"{field} = {value}" for field, value in label.items())]
        )
        _print(console, title, evaluations)
        baselines = {which: value.as_json() for which, value in evaluations.items() if which != "policy"}
        results.append({**label, **evaluations["policy"].as_json(), "baselines": baselines})
    console.print(f"policy: {source.origin}", highlight=False, soft_wrap=True)
    head = {"task": name, "checkpoint": str(source.path), "seed": options.seed}
    options.emit(head | ({"grid": results} if options.grid else results[0]))
    return DONE


def policy_defaults(name: str, arguments: list[str], find: Any, from_plain: Any) -> tuple[Any, Any]:
    """Return the policy and the configuration it was trained with, which is the default of the task's options.

    Nothing where the arguments ask for help: that must work without a policy.
    """
    if HELP & set(arguments):
        return None, None
    checkpoint = option_value(arguments, "--checkpoint")
    runs = Path(option_value(arguments, "--runs") or "runs")
    source = find(name, None if checkpoint is None else Path(checkpoint), runs, chosen_obs(arguments))
    return source, from_plain(task_class(name), source.content["task_config"])


def _check_counts(options: Any) -> None:
    for field in ("episodes", "num_envs"):
        value = getattr(options, field)
        if value is not None and value < 1:
            raise UsageError(f"{field.replace('_', '-')} must be at least 1, got {value}")


def _grid(text: str | None) -> list[tuple[str, str]]:
    """Return the (field, value) pairs of ``KEY=a,b,c``, as typed; one empty pair without a grid."""
    if text is None:
        return [("", "")]
    key, equals, values = text.partition("=")
    if not (equals and key.strip() and values):
        raise UsageError(f"--grid wants KEY=a,b,c, got '{text}'")
    return [(key.strip().replace("_", "-"), word.strip()) for word in values.split(",")]


def _print(console: Console, title: str, evaluations: dict[str, Evaluation]) -> None:
    table = Table(title=title, title_justify="left", box=SIMPLE, padding=(0, 1, 0, 0))
    for column in ("", "return", "length", "success", "95 % interval"):
        table.add_column(column, justify="right" if column else "left", no_wrap=True)
    table.add_column("ended by", overflow="fold")
    for key, value in evaluations.items():
        low, high = value.success_ci95
        table.add_row(
            _NAMES[key],
            f"{value.mean_return:.1f} ± {value.std_return:.1f}",
            f"{value.mean_episode_length:.1f}",
            f"{value.success_rate:.1%}",
            f"{low:.1%} - {high:.1%}",
            ", ".join(f"{reason} {count}" for reason, count in value.end_reasons.items()),
        )
    console.print(table)
    own = evaluations["policy"].metrics
    for metric in own:
        values = ", ".join(f"{_NAMES[key]} {value.metrics[metric]:.4g}" for key, value in evaluations.items())
        console.print(f"{metric}: {values}", highlight=False)
