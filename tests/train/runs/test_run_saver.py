"""What a training that is asked to stop leaves behind: by copies of a signal, by a later one, at any moment."""

import signal
from pathlib import Path
from typing import Any

import pytest
import torch
from rich.console import Console

from simwarp.core import stopping
from simwarp.tasks import replace_fields, task_class
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import default_config
from simwarp.train.runs import run_saver
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.progress_table import read_progress
from simwarp.train.runs.run_folder import RunFolder
from simwarp.train.runs.training import train
from tests.train.runs.test_kill_resume import same

FAST: Any = task_class("fast")
STEPS = 8
ASKED_AT = 3 * STEPS + 4
"""Control step in the middle of the fourth iteration."""


@pytest.fixture(autouse=True)
def handled():
    """Signals as they were, also where Ctrl-C is ignored."""
    before = {number: signal.getsignal(number) for number in stopping.HEARD}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def no_copies(monkeypatch):
    """Each signal is a request, as if there was always a second between two of them."""
    monkeypatch.setattr(stopping, "COPIES_WITHIN", 0.0)
    monkeypatch.setattr(run_saver, "COPIES_WITHIN", 0.0)


@pytest.fixture
def signals_at(monkeypatch):
    """Let signals come in a control step, counted from the beginning of the run."""

    def plan(*numbers, step=ASKED_AT):
        count = [0]
        rewards = FAST.rewards

        def counted(task):
            if hasattr(task, "_statistics"):  # else it is the probe of a new task
                count[0] += 1
                for number in numbers if count[0] == step else ():
                    signal.raise_signal(number)
            return rewards(task)

        monkeypatch.setattr(FAST, "rewards", counted)

    return plan


def run(root, iterations=6, resume=None, films=None, **settings):
    settings = {
        "num_envs": 4,
        "steps_per_iteration": STEPS,
        "save_interval": 100,
        "device": "cpu",
        "threads": 1,
    } | settings
    config = replace_fields(default_config(FAST), settings | {"iterations": iterations, "ppo.mini_batches": 2})
    task_config = FAST.config_type(max_episode_steps=20)
    console = Console(quiet=True)
    return train("fast", config, task_config, root=root, resume=resume, films=films, console=console)


def saved(result):
    return load_checkpoint(Path(result.checkpoint))


def networks(content):
    return content["actor_state_dict"], content["critic_state_dict"], content["optimizer_state_dict"]


def differing(left, right):
    return [key for key in left if not same(left[key], right[key])]


@pytest.mark.parametrize("numbers", [(signal.SIGTERM,) * 2, (signal.SIGINT,) * 5, (signal.SIGTERM, signal.SIGHUP)])
def test_copies_of_a_signal_finish_the_iteration_and_save_it(signals_at, tmp_path, numbers):
    signals_at(*numbers)
    result = run(tmp_path)
    folder = RunFolder(Path(result.run))
    assert (result.interrupted, result.iterations) == (True, 4)
    assert [saved(result)["iteration"], len(read_progress(folder.progress))] == [4, 4]
    assert Path(str(result.picture)).is_file()
    resumed = run(tmp_path, resume=folder.path)
    assert (resumed.interrupted, resumed.iterations) == (False, 6)


def test_an_iteration_that_takes_long_is_saved_before_and_after_and_nothing_changes(signals_at, no_copies, tmp_path):
    whole = [saved(run(tmp_path / str(count), count)) for count in (3, 4)]
    signals_at(signal.SIGTERM)
    result = run(tmp_path / "asked")
    files = RunFolder(Path(result.run)).checkpoint_files()
    assert [load_checkpoint(path)["iteration"] for path in files] == [3, 4]
    # The first one is what there was when the signal came: learning as after three iterations, worlds half an
    # iteration on. The second one is that of a run that nobody asked to stop, bit by bit.
    first, second = map(load_checkpoint, files)
    assert same(networks(first), networks(whole[0]))
    assert not same(first["worlds"], whole[0]["worlds"])
    assert differing(second, whole[1]) == ["train_config"]  # more iterations were asked for


def test_asked_twice_it_leaves_the_iteration_and_can_go_on(signals_at, no_copies, tmp_path):
    whole = saved(run(tmp_path / "whole", 3))
    late: list[int] = []
    signals_at(signal.SIGTERM, signal.SIGTERM)
    after = signals_after(FAST, late)
    result = run(tmp_path / "asked")
    after.undo()
    assert late == []  # no control step came after the one in which it was asked
    assert (result.interrupted, result.iterations, result.picture) == (True, 3, None)
    content = saved(result)
    assert content["iteration"] == 3
    assert same(networks(content), networks(whole))
    assert len(read_progress(RunFolder(Path(result.run)).progress)) == 3
    resumed = run(tmp_path, resume=Path(result.run))
    assert (resumed.interrupted, resumed.iterations) == (False, 6)
    assert [int(row["iteration"]) for row in read_progress(RunFolder(Path(result.run)).progress)] == [1, 2, 3, 4, 5, 6]


def signals_after(kind, late):
    """Note control steps that begin after the one in which signals came."""
    patch = pytest.MonkeyPatch()
    apply, count = kind.apply, [0]

    def counted(task, action):
        count[0] += hasattr(task, "_statistics")
        if count[0] > ASKED_AT:
            late.append(count[0])
        apply(task, action)

    patch.setattr(kind, "apply", counted)
    return patch


def test_a_checkpoint_of_the_iteration_before_is_not_replaced_by_one_that_is_part_of_an_iteration_on(
    signals_at, no_copies, tmp_path
):
    whole = saved(run(tmp_path / "whole", 3))
    signals_at(signal.SIGTERM, signal.SIGTERM)
    result = run(tmp_path / "asked", save_interval=3)
    assert differing(saved(result), whole) == ["train_config"]


def test_asked_twice_while_it_learns_it_leaves_between_two_mini_batches(no_copies, tmp_path, monkeypatch):
    learn = Trainer._learn
    steps: list[int] = []

    def asked(trainer):
        if trainer.iteration == 2 and not steps:
            trainer.algorithm.optimizer.register_step_pre_hook(lambda *_: steps.append(1))
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
        return learn(trainer)

    monkeypatch.setattr(Trainer, "_learn", asked)
    result = run(tmp_path)
    assert steps == [1]
    assert (result.interrupted, result.iterations, saved(result)["iteration"]) == (True, 2, 2)
    assert all(bool(value.isfinite().all()) for value in saved(result)["actor_state_dict"].values())
    assert run(tmp_path, resume=Path(result.run)).iterations == 6


@pytest.mark.parametrize("moment", ["before", "after"])
def test_a_checkpoint_that_is_being_written_is_written(no_copies, tmp_path, monkeypatch, moment):
    save = RunFolder.save

    def asked(folder, content, keep):
        def ask():
            for _ in range(3):
                signal.raise_signal(signal.SIGTERM)

        if moment == "before":
            ask()
        path = save(folder, content, keep)
        if moment == "after":
            ask()
        return path

    monkeypatch.setattr(RunFolder, "save", asked)
    result = run(tmp_path, 3, save_interval=2)
    assert (result.interrupted, result.iterations, saved(result)["iteration"]) == (True, 2, 2)
    assert [path.name for path in Path(result.checkpoint).parent.iterdir()] == [Path(result.checkpoint).name]


class Films:
    """Notes what was saved when a film was to be made; a later signal comes while the last one is."""

    every = 1

    def __init__(self, asked=False):
        self.newest, self.asked = [], asked

    def make(self, trainer, path):
        files = RunFolder(path.parents[1]).checkpoint_files()
        self.newest.append((trainer.iteration, files[-1].stem if files else ""))
        if self.asked and files:
            signal.raise_signal(signal.SIGINT)
            raise AssertionError("a later signal did not end the film")


def test_the_checkpoint_comes_before_films_and_logs(signals_at, tmp_path, monkeypatch):
    from simwarp.train.runs.loggers import RunLog

    add, logged = RunLog.add, []

    def noted(log, report, wall):
        logged.append((report.iteration, len(list(tmp_path.glob("fast/*/checkpoints/*.pt")))))
        add(log, report, wall)

    monkeypatch.setattr(RunLog, "add", noted)
    signals_at(signal.SIGTERM)
    films = Films()
    assert run(tmp_path, films=films).iterations == 4
    assert films.newest == [(1, ""), (2, ""), (3, ""), (4, "iteration_000004")]
    assert logged == [(1, 0), (2, 0), (3, 0), (4, 1)]


def test_a_later_signal_ends_the_film_and_the_picture_not_the_run(signals_at, no_copies, tmp_path):
    signals_at(signal.SIGINT)
    result = run(tmp_path, films=Films(asked=True))
    assert (result.interrupted, result.iterations, result.picture) == (True, 4, None)
    assert saved(result)["iteration"] == 4


def test_in_the_first_iteration_of_all_there_is_nothing_to_save(signals_at, no_copies, tmp_path):
    signals_at(signal.SIGTERM, signal.SIGTERM, step=2)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path)
    (folder,) = (tmp_path / "fast").iterdir()
    assert RunFolder(folder).checkpoint_files() == []
    assert not (folder / "writer.json").exists()
    assert torch.is_tensor(saved(run(tmp_path, 1, resume=folder))["actor_state_dict"]["mlp.0.weight"])


def test_several_processes_leave_a_rollout_before_torchrun_kills_them(monkeypatch):
    from simwarp.train.algorithm.distributed import shutdown_time

    monkeypatch.delenv("TORCHELASTIC_RUN_ID", raising=False)
    monkeypatch.setenv("TORCH_ELASTIC_SHUTDOWN_TIMEOUT", "110")
    assert shutdown_time() == float("inf")  # nobody kills them
    monkeypatch.setenv("TORCHELASTIC_RUN_ID", "none")
    assert shutdown_time() == 110.0
    monkeypatch.delenv("TORCH_ELASTIC_SHUTDOWN_TIMEOUT")
    assert shutdown_time() == 30.0
