"""A task as ``simwarp view`` shows it: under a policy, with a person at the wheel where it has one."""

from __future__ import annotations

from typing import Any

import torch

from simwarp.cli import UsageError
from simwarp.cli.options import config_of_variant, expand_shorthands, parse_options, task_options
from simwarp.cli.view.human_in_task import HumanInTask
from simwarp.cli.view.policy_choice import find_actor
from simwarp.cli.view.reloading import PolicyReload
from simwarp.cli.view.shown_model import shown_config
from simwarp.cli.view.subject_page import open_view, say
from simwarp.cli.view.task_subject import task_subject
from simwarp.cli.view.view_options import TaskViewOptions, check_view_options
from simwarp.tasks import make, resolve_device, task_class
from simwarp.train.runs.run_folder import RunFolder
from simwarp.viewer.live.driving.browser_driving import WHEEL
from simwarp.viewer.live.hand import with_hand
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.web_server import WebServer


def task_view(name: str, arguments: list[str], server: WebServer | None) -> tuple[Any, LiveView]:
    """The options, and the page, which runs when it is told to.

    Raises:
        UsageError: an option is wrong.
        InputError: there is no such policy, or a value of the configuration is wrong.
    """
    torch.set_num_threads(1)
    cls, word = task_class(name), name
    name = cls.name
    arguments = expand_shorthands(arguments, name, cls.config_type())
    actor = find_actor(name, arguments)
    options: Any = parse_options(
        task_options("ViewCommand", TaskViewOptions, task=actor.config or config_of_variant(arguments, cls)), arguments,
        f"simwarp view {word}",
    )  # fmt: skip
    check_view_options(options)
    say(options, f"building worlds of '{name}' ...")
    config = shown_config(options.task, lambda text: say(options, text))
    task = make(
        name, options.worlds or 16, device=resolve_device(options.device), seed=options.seed, config=config,
        elements=with_hand,
    )  # fmt: skip
    subject, loop = task_subject(task, actor.policy(task), options.seed)
    human = HumanInTask(loop, options.seed)
    subject.details[WHEEL] = human.wheel()
    if actor.run is not None:
        iteration = None if actor.content is None else actor.content["iteration"]
        subject.details["training"] = PolicyReload(
            RunFolder(actor.run), loop, using=actor.path, iteration=iteration, on=options.reload is not None
        )
    say(options, f"policy: {actor.origin}")
    if options.record_trajectories is not None and human.wheel() is None:
        raise UsageError(f"--record-trajectories: nobody can drive in task '{name}'; driving tasks have a vehicle")
    view = open_view(subject, options, server)
    if options.record_trajectories is not None:
        _record(view, human, options)
    return options, view


def _record(view: LiveView, human: HumanInTask, options: Any) -> None:
    """Keeps the steps while somebody is at the wheel; the file is written when the page ends."""
    path = options.record_trajectories
    human.recording = lambda: view.wheel.occupied
    view.listeners.append(human.after_step)

    def save() -> None:
        steps = human.save(path)
        say(options, f"wrote {path}: {steps:,} steps driven by hand" if steps else f"nobody drove; no {path} written")

    view.closers.append(save)
