"""A tiny training of a task without physics, for tests of what it leaves behind."""

from rich.console import Console

from simwarp.tasks import replace_fields, task_class
from simwarp.train.config import default_config
from simwarp.train.runs.run_folder import open_run
from simwarp.train.runs.training import train

QUIET = Console(quiet=True)
SMALL = {
    "num_envs": 8, "iterations": 3, "steps_per_iteration": 4, "device": "cpu", "save_interval": 1, "logger": "csv",
}  # fmt: skip


def run(root, resume=None, console=QUIET, take_over=False, **changes):
    """Train as SMALL says, but for some changes; return the run folder."""
    task = task_class("fast")
    config = replace_fields(default_config(task), SMALL | changes)
    result = train(
        "fast", config, task.config_type(max_episode_steps=12), root=root, resume=resume, take_over=take_over,
        console=console,
    )  # fmt: skip
    return open_run(root / "fast" / result.run.rpartition("/")[2]) if resume is None else open_run(resume)
