"""Recordings made without a page that anybody opens: `simwarp play --html`, and the films of a training."""

from __future__ import annotations

import dataclasses
import importlib.util
from pathlib import Path
from typing import Any, Final

import torch

from simwarp.cli import UsageError
from simwarp.cli.view.shown_model import shown_config
from simwarp.cli.view.task_subject import task_subject
from simwarp.core.threads import default_threads
from simwarp.tasks import InputError, Task, make
from simwarp.train.algorithm.learner import Learner
from simwarp.train.evaluation.play import record
from simwarp.train.networks.policies import network_policy, zero_policy
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.recording import Recorder
from simwarp.viewer.live.subject import Subject

WORLDS: Final = 4
"""Worlds of a training's film."""
SECONDS: Final = 5.0
"""Of a training's film, where an episode is not shorter [s]."""
SEED: Final = 1_000_003


class HtmlFilm:
    """Records worlds where pictures of `simwarp play` would be taken: the same steps in the same worlds.

    Args:
        task: with bodies.
        path: of the file.

    Raises:
        UsageError: the task has no bodies.
        ModelError: viser is not installed, or a file of another kind.
    """

    def __init__(self, task: Task[Any], path: Path) -> None:
        self.path = path
        self._view = LiveView(_seen(task), worlds=min(task.num_worlds, 64), port=0)
        self._recorder: Recorder | None = None

    def render(self, index: int, count: int, time: float) -> None:
        """Takes the present state as a frame; it goes on from the first one."""
        if self._recorder is None:
            self._recorder = Recorder(self._view, self.path)
        else:
            self._view.step()

    def write(self) -> None:
        """Writes the file."""
        if self._recorder is not None:
            self._recorder.finish()

    def close(self) -> None:
        """Closes the port that the page would have been seen at."""
        for recorder in self._view.recorders:
            recorder.drop()
        self._view.stop()


def _seen(task: Task[Any]) -> Subject:
    """A task that somebody else steps."""
    subject, _ = task_subject(task, zero_policy(task), SEED)
    return dataclasses.replace(subject, returns=lambda: task.state_dict()["running_terms"].sum(dim=1).cpu().numpy())


class TrainingFilms:
    """Makes films of a policy while it is trained, in worlds of their own.

    Nothing of the training is touched: neither its worlds nor torch's random numbers.

    Args:
        every: iterations from film to film.

    Raises:
        UsageError: there are none, or viser is not installed.
    """

    def __init__(self, every: int) -> None:
        if importlib.util.find_spec("viser") is None:
            raise UsageError("--film needs the package viser: pip install 'simwarp[viewer]'")
        if every < 1:
            raise UsageError(f"film must be at least 1 iteration, got {every}; leave it away for no films")
        self.every = every
        self._task: Task[Any] | None = None

    def make(self, trainer: Learner, path: Path) -> None:
        """Writes a film of the present policy.

        Raises:
            InputError: the viewer does not show such a task.
            TrainingError: the policy returns NaN or infinity.
            OutputError: the disk did not take it.
        """
        of = trainer.task
        devices = [of.device] if of.device.type == "cuda" else []
        with torch.random.fork_rng(devices=devices), default_threads(trainer.config.threads):
            if self._task is None:
                # Not captured: a capture would hold memory of the training's device for a few steps in a while
                config = shown_config(of.config, lambda text: None)
                self._task = make(of.name, WORLDS, device=str(of.device), seed=SEED, config=config, capture=False)
            content = trainer.checkpoint_of_policy()
            policy = network_policy(content, self._task)
            episode = of.config.max_episode_steps * of.config.control_dt
            try:
                film = HtmlFilm(self._task, path)
            except UsageError as error:  # a task that the viewer does not show
                raise InputError(str(error)) from None
            try:
                record(self._task, policy, min(SECONDS, episode), SEED, film)
                film.write()
            finally:
                film.close()
