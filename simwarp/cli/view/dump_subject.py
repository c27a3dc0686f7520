"""The steps before a world broke down, over and over."""

from __future__ import annotations

from pathlib import Path

from simwarp.cli import UsageError
from simwarp.cli.view.task_subject import lines_of
from simwarp.tasks.framework.replay import Rerun
from simwarp.viewer.live.subject import Mask, Subject


def dump_subject(path: str, device: str) -> Subject:
    """The dump of a guard as a subject: it rests for a second where the physics breaks down, and begins again.

    Raises:
        FileError: there is no such file, or it is damaged.
        InputError: it is no such dump.
        UsageError: its task has nothing to look at.
    """
    rerun = Rerun(path, device=device)
    task = rerun.task
    scene = task.scene()
    if scene is None:
        raise UsageError(f"'{path}': task '{task.name}' has no bodies to look at; simwarp replay {path} tells about it")
    rest = round(1.0 / task.config.control_dt)
    done = [0]

    def advance() -> None:
        step = done[0]
        if step >= rerun.about.replay_steps + rest:
            reset(None)
        elif step < rerun.about.replay_steps and rerun.advance(step):
            done[0] = rerun.about.replay_steps
        done[0] += 1

    def reset(_: Mask | None) -> None:
        rerun.restart()
        done[0] = 0

    return Subject(
        f"{task.name}, world {rerun.about.world}: {Path(path).name}", task.simulation, scene,
        float(task.config.control_dt), advance, reset, task.shot(), paths=lambda: lines_of(task),
    )  # fmt: skip
