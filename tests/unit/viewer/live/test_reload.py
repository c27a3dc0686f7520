"""A page follows a training: newer checkpoints act, what does not fit is refused, and the old policy goes on."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from rich.console import Console

from simwarp import cli
from simwarp.cli.view.reloading import PolicyReload
from simwarp.cli.view.task_subject import TaskLoop, task_subject
from simwarp.tasks import make, replace_fields, task_class
from simwarp.train.config import default_config
from simwarp.train.networks.policies import network_policy, random_policy
from simwarp.train.runs.checkpoint import load_checkpoint, save_checkpoint
from simwarp.train.runs.run_folder import RunFolder
from simwarp.train.runs.training import train
from simwarp.viewer.live import LiveView
from simwarp.viewer.live.training_panel import TrainingPanel

PATIENCE = 200.0
"""Longest wait, on a machine that has other things to do [s]."""


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory) -> Path:
    """A run of the pendulum with checkpoints after two and four iterations."""
    settings = {"num_envs": 4, "iterations": 4, "steps_per_iteration": 8, "device": "cpu", "save_interval": 2}
    config = replace_fields(default_config(task_class("pendulum")), settings)
    task_config = task_class("pendulum").config_type(max_episode_steps=12)
    root = tmp_path_factory.mktemp("runs")
    result = train("pendulum", config, task_config, root=root, console=Console(quiet=True))
    return Path(result.run)


@pytest.fixture
def early(run_folder, tmp_path) -> RunFolder:
    """The run as it was after two iterations."""
    folder = RunFolder(tmp_path / "run")
    folder.checkpoints.mkdir(parents=True)
    for name in ("config.json", "progress.csv", "checkpoints/iteration_000002.pt"):
        (folder.path / name).write_bytes((run_folder / name).read_bytes())
    return folder


def weights(loop: TaskLoop) -> torch.Tensor:
    policy: Any = loop.policy
    return torch.cat([value.flatten().double() for value in policy.actor.state_dict().values()])


def checkpoint(folder: Path, iteration: int) -> dict:
    return load_checkpoint(folder / "checkpoints" / f"iteration_{iteration:06d}.pt")


@contextlib.contextmanager
def shown(folder: RunFolder, on: bool = True) -> Iterator[tuple[LiveView, TaskLoop, PolicyReload]]:
    """A page on the pendulum under the newest policy of a run."""
    task = make("pendulum", 2, device="cpu", seed=3)
    path = folder.latest_checkpoint()
    subject, loop = task_subject(task, network_policy(load_checkpoint(path), task), 3)
    reload = PolicyReload(folder, loop, using=path, iteration=2, on=on)
    view = LiveView(subject, worlds=2, port=0)
    try:
        yield view, loop, reload
    finally:
        reload.close()
        view.stop()


def wait(view: LiveView, done: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < end
        view.obey()
        view.subject.advance()
        time.sleep(0.01)


def test_a_newer_checkpoint_acts(run_folder, early):
    with shown(early) as (view, loop, reload):
        assert reload._interval + 1.0 <= 3.0  # it acts within 3 s: looks come that often, and reading takes less
        reload.start(view.post)
        before, policy = weights(loop), loop.policy
        save_checkpoint(early.checkpoint_path(4), checkpoint(run_folder, 4))
        wait(view, lambda: reload.iteration == 4)
        assert loop.policy is not policy
        assert not torch.equal(before, weights(loop))
        saved = checkpoint(run_folder, 4)["actor_state_dict"]
        assert torch.equal(weights(loop), torch.cat([value.flatten().double() for value in saved.values()]))


def test_it_acts_between_steps_only(run_folder, early):
    with shown(early) as (view, loop, reload):
        reload._post = view.post
        policy = loop.policy
        save_checkpoint(early.checkpoint_path(4), checkpoint(run_folder, 4))
        reload.look()
        assert loop.policy is policy
        view.obey()
        assert loop.policy is not policy


@pytest.mark.parametrize(
    ("spoil", "trouble"),
    [
        (lambda content: {**content, "task": "ant"}, "is of task 'ant', not 'pendulum'"),
        (
            lambda content: {
                **content,
                "actor_state_dict": {
                    name: value[:1] for name, value in content["actor_state_dict"].items() if value.dim()
                },
            },
            "does not fit task 'pendulum'",
        ),
    ],
)
def test_another_task_or_network_is_refused(run_folder, early, spoil, trouble):
    with shown(early) as (view, loop, reload):
        policy = loop.policy
        save_checkpoint(early.checkpoint_path(4), spoil(checkpoint(run_folder, 4)))
        reload.look()
        view.obey()
        assert loop.policy is policy
        assert reload.iteration == 2
        assert trouble in reload.trouble
        panel = TrainingPanel(view, reload)
        assert "iteration 2" in panel._line.content
        assert "<span" in panel._line.content


def test_a_broken_file_leaves_the_old_policy_and_a_whole_one_ends_the_trouble(run_folder, early):
    with shown(early) as (_, loop, reload):
        policy = loop.policy
        whole = (run_folder / "checkpoints/iteration_000004.pt").read_bytes()
        early.checkpoint_path(4).write_bytes(whole[:-1000])
        reload.look()
        assert loop.policy is policy
        assert "truncated or not a checkpoint" in reload.trouble
        early.checkpoint_path(5).write_bytes(whole)
        reload.look()
        assert loop.policy is not policy
        assert reload.trouble == ""


def test_it_may_be_switched_off(run_folder, early):
    with shown(early, on=False) as (_, loop, reload):
        policy = loop.policy
        save_checkpoint(early.checkpoint_path(4), checkpoint(run_folder, 4))
        reload.look()
        assert loop.policy is policy
        reload.on = True
        reload.look()
        assert loop.policy is not policy


def test_the_panel_shows_the_learning_curve(run_folder, early):
    with shown(early) as (view, _, reload):
        reload.name = "<b>*run*</b>"
        panel = TrainingPanel(view, reload)
        assert "&lt;b&gt;&#42;run" in panel._line.content
        table = early.progress.read_text().splitlines()
        place = table[0].split(",").index("mean_reward")
        rows = [line.split(",") for line in table[1:]]
        for index, row in enumerate(rows):
            row[place] = str(-float(index))
        early.progress.write_text("\n".join([table[0], *map(",".join, rows)]) + "\n")
        reload.look()
        panel.refresh(0.0)
        assert panel._plot.data[0].tolist() == [1.0, 2.0, 3.0, 4.0]
        assert panel._plot.data[1].tolist() == [0.0, -1.0, -2.0, -3.0]


def test_building_a_policy_looks_at_no_world(early, monkeypatch):
    """It is built in another thread than that which steps."""
    task = make("pendulum", 2, device="cpu", seed=3)
    monkeypatch.setattr(task, "observations", lambda: pytest.fail("the worlds were looked at"))
    network_policy(checkpoint(early.path, 2), task)


def test_without_a_checkpoint_chance_acts_until_there_is_one(run_folder, early, monkeypatch, capsys):
    early.checkpoint_path(2).unlink()
    seen: list[PolicyReload] = []
    monkeypatch.setattr(PolicyReload, "start", lambda self, post: seen.append(self))
    command = ["view", "pendulum", "--reload", str(early.path), "--no-open", "--port", "0", "--worlds", "2"]
    assert cli.main([*command, "--seconds", "0.2"]) == 0
    assert "random actions until the run has a checkpoint" in capsys.readouterr().out
    assert seen[0].iteration is None
    save_checkpoint(early.checkpoint_path(4), checkpoint(run_folder, 4))
    seen[0].look()
    assert seen[0].iteration == 4


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["--reload", "nowhere"], "run folder nowhere does not exist"),
        (["--reload", "nowhere", "--checkpoint", "zero"], "leave --checkpoint away"),
    ],
)
def test_a_run_that_is_none_is_one_line(arguments, error, capsys):
    assert cli.main(["view", "pendulum", *arguments]) == 2
    said = capsys.readouterr().err
    assert error in said
    assert said.count("\n") == 1


def test_a_run_of_another_task_is_refused(early, capsys):
    assert cli.main(["view", "ant", "--reload", str(early.path)]) == 2
    assert "is of task 'pendulum', not 'ant'" in capsys.readouterr().err


def test_random_policy_is_replaced(run_folder, early):
    task = make("pendulum", 2, device="cpu", seed=3)
    _, loop = task_subject(task, random_policy(task), 3)
    reload = PolicyReload(early, loop)
    reload.look()
    assert reload.iteration == 2
