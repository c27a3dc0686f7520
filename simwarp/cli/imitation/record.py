"""``simwarp record``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from simwarp.cli import DONE, INTERRUPTED
from simwarp.cli.imitation.dataset_options import RecordOptions
from simwarp.cli.policy_command import PolicyCommand, policy_command
from simwarp.core.stopping import StopRequest, stop_on_signals
from simwarp.tasks import make, resolve_device, task_class

if TYPE_CHECKING:
    from simwarp.train.datasets.dataset_formats import Recorded
    from simwarp.train.runs.progress_display import LiveLine


def run(arguments: list[str]) -> int:
    """Record as the arguments say; 130 after an interruption."""
    from simwarp.train.datasets.dataset_formats import instruction_of
    from simwarp.train.runs.progress_display import LiveLine

    command = policy_command("record", arguments, RecordOptions)
    name, options, source = command.name, command.options(), command.source
    assert source is not None  # options() has ended the process where help was asked for
    options.check_record(name, source.path)
    target = options.target(name)
    instruction_of(task_class(name), options.instruction)
    console, total = options.console(), options.episodes
    console.print(f"policy: {source.origin}", highlight=False, soft_wrap=True)
    with stop_on_signals() as stop, LiveLine(console, total, head="recording") as line:
        data = _record(command, options, target, stop, line)
    interrupted = data.episodes < total
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
    from simwarp.train.datasets.dataset_formats import Recorded, record_dataset
    from simwarp.train.datasets.dataset_kinds import DatasetFormat
    from simwarp.train.datasets.episodes import record
    from simwarp.train.datasets.trajectories import save_trajectories

    total, source = options.episodes, command.source
    assert source is not None
    worlds = min(total, options.num_envs or 256)
    task = make(command.name, worlds, device=resolve_device(options.device), seed=options.seed, config=options.task)

    def report(ended: int) -> None:
        line.show("recording", f"{ended}/{total} episodes", ended)

    about = {"policy": str(source.path), "seed": options.seed}
    if options.kind is not DatasetFormat.NPZ:
        return record_dataset(
            task, source.policy(task), total, options.seed, target, options.kind, about=about,
            instruction=options.instruction, quality=options.video_quality, stop=stop, report=report,
        )  # fmt: skip
    data = record(task, source.policy(task), total, options.seed, about, stop, report)
    with stop.saving():
        save_trajectories(target, data)
    return Recorded(data.episodes, data.steps, data.about["mean_return"])
