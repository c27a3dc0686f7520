"""``simwarp record``."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from simwarp.cli import DONE, INTERRUPTED, UsageError
from simwarp.cli.options import CommonOptions
from simwarp.cli.policy_command import policy_command
from simwarp.core.stopping import stop_on_signals
from simwarp.tasks import make, resolve_device


@dataclasses.dataclass(frozen=True)
class RecordOptions(CommonOptions):
    """Write whole episodes of a policy, observations and actions of every step, to a file that `clone` reads."""

    episodes: int = 64
    """Episodes, each world's first ones."""
    output: Path | None = None
    """File to write, .npz; by default TASK.npz in the working folder."""
    checkpoint: Path | None = None
    """Checkpoint file or run folder, or `shipped`, the name of a shipped one, `zero`, `random`; by default the newest
    run, else the shipped."""
    num_envs: int | None = None
    """Worlds stepped together; by default one per episode, at most 256."""
    seed: int = 2_000_003
    """Seed of the worlds, other than those of training and evaluation."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""
    runs: Path = Path("runs")
    """Folder of the run folders."""


def run(arguments: list[str]) -> int:
    """Record as the arguments say; 130 after an interruption."""
    from simwarp.train.algorithm.trajectories import record, save_trajectories
    from simwarp.train.runs.progress_display import LiveLine

    command = policy_command("record", arguments, RecordOptions)
    name, options, source = command.name, command.options(), command.source
    assert source is not None  # options() has ended the process where help was asked for
    target = options.output or Path(f"{name}.npz")
    options.check(source.path, output=target)
    if target.suffix != ".npz":
        raise UsageError(f"--output must end in .npz, got '{target}'")
    for field in ("episodes", "num_envs"):
        value = getattr(options, field)
        if value is not None and value < 1:
            raise UsageError(f"{field.replace('_', '-')} must be at least 1, got {value}")
    worlds = min(options.episodes, options.num_envs or 256)
    task = make(name, worlds, device=resolve_device(options.device), seed=options.seed, config=options.task)
    about = {"policy": str(source.path), "seed": options.seed}
    console, total = options.console(), options.episodes
    with stop_on_signals() as stop:
        with LiveLine(console, total, head="recording") as line:

            def report(ended: int) -> None:
                line.show("recording", f"{ended}/{total} episodes", ended)

            data = record(task, source.policy(task), total, options.seed, about, stop, report)
        with stop.saving():
            save_trajectories(target, data)
    interrupted = data.episodes < total
    console.print(f"policy: {source.origin}", highlight=False, soft_wrap=True)
    console.print(
        f"{data.episodes} episodes, {data.steps:,} steps, mean return {data.about['mean_return']:.1f}", highlight=False
    )
    told = f"interrupted and saved after {data.episodes} of {total} episodes; " if interrupted else ""
    console.print(f"{told}wrote {target}", highlight=False, soft_wrap=True)
    options.emit(
        {
            "task": name,
            "output": str(target),
            "episodes": data.episodes,
            "steps": data.steps,
            "mean_return": data.about["mean_return"],
            "checkpoint": str(source.path),
            "interrupted": interrupted,
        }
    )
    return INTERRUPTED if interrupted else DONE
