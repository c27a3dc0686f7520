"""Where a run's scalars go."""

import math
import sys
import types
from pathlib import Path

import pytest
import torch
from rich.console import Console

from simwarp import cli
from simwarp.core.files import OutputError
from simwarp.tasks import Curriculum, Driver, InputError, Task, replace_fields, task_class
from simwarp.train.config import LoggerKind, Symmetry, default_config
from simwarp.train.runs import progress_table
from simwarp.train.runs.progress_table import ProgressTable, read_progress, seconds_trained, success_share
from simwarp.train.runs.run_folder import RunFolder
from simwarp.train.runs.training import train

QUIET = Console(quiet=True)


def run(root, kind):
    settings = {"num_envs": 8, "iterations": 3, "steps_per_iteration": 8, "device": "cpu", "logger": kind}
    config = replace_fields(default_config(task_class("fast")), settings)
    task_config = task_class("fast").config_type(max_episode_steps=12)
    return RunFolder(Path(train("fast", config, task_config, root=root, console=QUIET).run))


@pytest.mark.parametrize("kind", [LoggerKind.TENSORBOARD, LoggerKind.CSV])
def test_csv_is_always_there_and_tensorboard_by_default(tmp_path, kind):
    folder = run(tmp_path, kind)
    assert [int(row["iteration"]) for row in read_progress(folder.progress)] == [1, 2, 3]
    assert bool(list(folder.path.glob("events.out.tfevents.*"))) == (kind is LoggerKind.TENSORBOARD)


def test_wandb_gets_every_iteration_and_needs_no_account(tmp_path, monkeypatch):
    seen: dict = {"steps": []}

    class Run:
        def log(self, values, step):
            seen["steps"].append(step)
            seen["last"] = values

        def finish(self):
            seen["finished"] = True

    module = types.ModuleType("wandb")
    module.__dict__["init"] = lambda **options: seen.update(options) or Run()
    monkeypatch.setitem(sys.modules, "wandb", module)
    monkeypatch.delenv("WANDB_MODE", raising=False)
    folder = run(tmp_path, LoggerKind.WANDB)
    assert seen["mode"] == "offline"
    assert (seen["steps"], seen["finished"], seen["dir"]) == ([1, 2, 3], True, str(folder.path))
    assert {"train/mean_reward", "loss/value", "reward/near", "speed/learn_s"} <= set(seen["last"])
    assert seen["config"]["train_config"]["num_envs"] == 8
    assert len(read_progress(folder.progress)) == 3


@pytest.mark.slow
def test_wandb_itself_keeps_every_iteration_in_the_run_folder(tmp_path, monkeypatch):
    """Its file is a log of records, uncompressed, of which each iteration has one with all names."""
    pytest.importorskip("wandb")
    monkeypatch.delenv("WANDB_MODE", raising=False)
    folder = run(tmp_path, LoggerKind.WANDB)
    (log,) = folder.path.glob("wandb/offline-run-*/run-*.wandb")
    content = log.read_bytes()
    for name in (b"train/mean_reward", b"loss/value", b"reward/near"):
        assert content.count(name) >= 3, name
    assert b"num_envs" in content


def test_a_logger_that_is_not_installed_is_one_line_that_names_the_extra(tmp_path, monkeypatch, capfd):
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(InputError, match="simwarp\\[wandb\\]"):
        run(tmp_path, LoggerKind.WANDB)
    monkeypatch.chdir(tmp_path)
    assert cli.main(["train", "fast", "--logger", "wandb"]) == 2
    assert capfd.readouterr().err == ("simwarp: --logger wandb needs the package wandb: pip install 'simwarp[wandb]'\n")
    assert list(tmp_path.iterdir()) == []


def test_a_curriculum_tells_its_level_and_a_task_what_it_likes(tmp_path, monkeypatch):
    task = task_class("fast")
    curriculum = Curriculum(driver=Driver.ITERATION, last=4)
    settings = {"num_envs": 8, "iterations": 3, "steps_per_iteration": 8, "device": "cpu"}
    config = replace_fields(default_config(task), settings)

    def on_iteration(self, iteration):
        return {**(Task.on_iteration(self, iteration) or {}), "worlds": torch.arange(8)}

    monkeypatch.setattr(task, "on_iteration", on_iteration)
    result = train("fast", config, task.config_type(curriculum=curriculum), root=tmp_path, console=QUIET)
    rows = read_progress(Path(result.run) / "progress.csv")
    assert [float(row["task/level"]) for row in rows] == [0.0, 0.25, 0.5]
    assert {float(row["task/worlds"]) for row in rows} == {3.5}
    assert (Path(result.run) / "learning_curve.png").stat().st_size > 0


def mirrored(root, resume=None, **changes):
    """Train with a critic that learns alone for two iterations: the loss of symmetry is known from the third on."""
    settings = {
        "num_envs": 8, "iterations": 4, "steps_per_iteration": 8, "device": "cpu", "logger": LoggerKind.CSV,
        "critic_warmup": 2, "ppo.symmetry": Symmetry.LOSS,
    }  # fmt: skip
    config = replace_fields(default_config(task_class("fast")), settings | changes)
    result = train("fast", config, task_class("fast").config_type(), root=root, resume=resume, console=QUIET)
    return RunFolder(Path(result.run))


@pytest.mark.parametrize("part", [None, 1, 2, 3])
def test_a_column_that_comes_later_is_in_the_table(tmp_path, part):
    folder = mirrored(tmp_path, iterations=4 if part is None else part)
    if part is not None:
        mirrored(tmp_path, resume=folder.path)
    rows = read_progress(folder.progress)
    assert [int(row["iteration"]) for row in rows] == [1, 2, 3, 4]
    assert [row["loss/symmetry"] != "" for row in rows] == [False, False, True, True]
    assert all(float(row["loss/symmetry"]) >= 0.0 for row in rows[2:])
    assert all(row["loss/value"] for row in rows)


def test_a_resumed_run_keeps_the_columns_that_it_no_longer_has(tmp_path):
    folder = mirrored(tmp_path, iterations=3)
    mirrored(tmp_path, resume=folder.path, **{"ppo.symmetry": Symmetry.NONE})
    assert [row["loss/symmetry"] != "" for row in read_progress(folder.progress)] == [False, False, True, False]


def test_the_time_of_a_resumed_run_goes_on(tmp_path):
    folder = mirrored(tmp_path, iterations=2)
    last = read_progress(folder.progress)[1]["wall_s"]
    folder.progress.write_text(folder.progress.read_text().replace(f",{last},", ",5000.0,"))  # an hour or so
    mirrored(tmp_path, resume=folder.path)
    walls = [float(row["wall_s"]) for row in read_progress(folder.progress)]
    assert walls[1] == 5000.0
    assert 5000.0 < walls[2] < walls[3]
    assert seconds_trained(read_progress(folder.progress)) == pytest.approx(walls[3], abs=1e-9)  # sums of float64


def test_the_time_of_a_table_whose_resumes_began_at_nothing_is_that_of_all():
    rows = [{"iteration": str(k), "wall_s": wall} for k, wall in enumerate(("1.5", "2.5", "0.5", "", "1.0"), start=1)]
    assert seconds_trained(rows) == 3.5


def test_a_table_that_cannot_be_made_wider_stays_as_it_is(tmp_path, monkeypatch):
    """As after a kill on the way: what was there is there, whole; and the next line brings the column."""
    path = tmp_path / "progress.csv"
    table = ProgressTable(path, ["iteration", "a"])
    table.append({"iteration": 1, "a": 0.5})
    before = path.read_bytes()

    def full(*_):
        raise OutputError("the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(progress_table, "write_run_file", full)
        with pytest.raises(OutputError):
            table.append({"iteration": 2, "a": 0.25, "c, d": 1})
    assert path.read_bytes() == before
    table.append({"iteration": 2, "a": 0.25, "c, d": 1, "b": 2})
    table.append({"iteration": 3, "c, d": 3})
    assert read_progress(path) == [
        {"iteration": "1", "a": "0.5", "b": "", "c, d": ""},
        {"iteration": "2", "a": "0.25", "b": "2", "c, d": "1"},
        {"iteration": "3", "a": "", "b": "", "c, d": "3"},
    ]
    assert [entry.name for entry in tmp_path.iterdir()] == ["progress.csv"]


def test_lines_before_the_column_of_successes_tell_them_by_their_ends():
    row = {"success": "", "episodes": "4", "end/goal": "3"}
    assert success_share(row, ["goal"]) == 0.75
    assert math.isnan(success_share({**row, "success": "nan"}, ["goal"]))
