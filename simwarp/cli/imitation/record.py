"""``simwarp record``."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from simwarp.cli import DONE, INTERRUPTED, UsageError
from simwarp.cli.options import CommonOptions
from simwarp.cli.policy_command import PolicyCommand, policy_command
from simwarp.core.stopping import StopRequest, stop_on_signals
from simwarp.tasks import make, resolve_device, task_class

if TYPE_CHECKING:
    from simwarp.train.datasets.dataset_formats import Recorded
    from simwarp.train.runs.progress_display import LiveLine


@dataclasses.dataclass(frozen=True)
class RecordOptions(CommonOptions):
    """Write whole episodes of a policy, observations and actions of every step, to a dataset that `clone` reads."""

    episodes: int = 64
    """Episodes, each world's first ones."""
    format: Literal["npz", "minari", "lerobot"] = "npz"
    """One file of arrays, or a folder that Minari or LeRobot opens."""
    output: Path | None = None
    """File or new folder to write; by default TASK.npz, TASK-v0 (minari) or TASK_lerobot in the working folder."""
    instruction: str | None = None
    """Sentence that says what is to be done, for minari and lerobot; by default the task's own."""
    video_quality: int = 18
    """Of images in lerobot, H.264: from 0, which keeps every bit in large files, to 51, the worst."""
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
    from simwarp.train.datasets.dataset_formats import DatasetFormat, check_dataset, default_output, instruction_of
    from simwarp.train.runs.progress_display import LiveLine

    command = policy_command("record", arguments, RecordOptions)
    name, options, source = command.name, command.options(), command.source
    assert source is not None  # options() has ended the process where help was asked for
    kind = DatasetFormat(options.format)
    target = options.output or default_output(kind, name)
    check_dataset(kind, target, options.video_quality)
    instruction_of(task_class(name), options.instruction)
    options.check(source.path, output=target)
    for field in ("episodes", "num_envs"):
        value = getattr(options, field)
        if value is not None and value < 1:
            raise UsageError(f"{field.replace('_', '-')} must be at least 1, got {value}")
    console, total = options.console(), options.episodes
    with stop_on_signals() as stop, LiveLine(console, total, head="recording") as line:
        data = _record(command, options, target, stop, line)
    interrupted = data.episodes < total
    console.print(f"policy: {source.origin}", highlight=False, soft_wrap=True)
    console.print(
        f"{data.episodes} episodes, {data.steps:,} steps, mean return {data.mean_return:.1f}", highlight=False
    )
    told = f"interrupted and saved after {data.episodes} of {total} episodes; " if interrupted else ""
    console.print(f"{told}wrote {target}", highlight=False, soft_wrap=True)
    options.emit(
        {
            "task": name,
            "output": str(target),
            "file": str(target),
            "format": options.format,
            "episodes": data.episodes,
            "steps": data.steps,
            "mean_return": data.mean_return,
            "checkpoint": str(source.path),
            "interrupted": interrupted,
        }
    )
    return INTERRUPTED if interrupted else DONE


def _record(command: PolicyCommand, options: Any, target: Path, stop: StopRequest, line: LiveLine) -> Recorded:
    """Record into the target."""
    from simwarp.train.datasets.dataset_formats import DatasetFormat, Recorded, record_dataset
    from simwarp.train.datasets.episodes import record
    from simwarp.train.datasets.trajectories import save_trajectories

    total, source = options.episodes, command.source
    assert source is not None
    worlds = min(total, options.num_envs or 256)
    task = make(command.name, worlds, device=resolve_device(options.device), seed=options.seed, config=options.task)

    def report(ended: int) -> None:
        line.show("recording", f"{ended}/{total} episodes", ended)

    about = {"policy": str(source.path), "seed": options.seed}
    if options.format != "npz":
        return record_dataset(
            task, source.policy(task), total, options.seed, target, DatasetFormat(options.format), about=about,
            instruction=options.instruction, quality=options.video_quality, stop=stop, report=report,
        )  # fmt: skip
    data = record(task, source.policy(task), total, options.seed, about, stop, report)
    with stop.saving():
        save_trajectories(target, data)
    return Recorded(data.episodes, data.steps, data.about["mean_return"])
