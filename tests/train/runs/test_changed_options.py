"""A run that is resumed with options which its worlds or networks do not fit: one line names them, and what to do."""

from pathlib import Path
from typing import Any

import pytest

from simwarp import cli
from simwarp.tasks import Curriculum, InputError, Range, Sensing, replace_fields, task_class
from simwarp.train.config import default_config
from simwarp.train.runs.changed_options import changed_options
from simwarp.train.runs.checkpoint import load_checkpoint, save_checkpoint
from simwarp.train.runs.run_folder import RunFolder
from simwarp.train.runs.training import train
from tests.train.runs.trained_run import QUIET, SMALL


def run(root: Path, resume: Path | None = None, task: dict[str, Any] | None = None, **changes: Any) -> RunFolder:
    """Train two iterations, or go on to three."""
    changes = {"iterations": 2 if resume is None else 3, **changes}
    config = replace_fields(default_config(task_class("fast")), SMALL | changes)
    task_config = task_class("fast").config_type(**(task or {}))
    return RunFolder(Path(train("fast", config, task_config, root=root, resume=resume, console=QUIET).run))


LATE: dict[str, Any] = {"action_delay": (0, 2)}
SENSED: dict[str, Any] = {"sensing": {"policy": Sensing(delay=(1, 2))}}


@pytest.mark.parametrize(
    ("before", "after", "named"),
    [
        ({}, LATE, "--task.action-delay was (0, 0), is (0, 2)"),
        (LATE, {}, "--task.action-delay was (0, 2), is (0, 0)"),
        ({}, SENSED, "--task.sensing 'policy' was None, is {'noise': 0.0, 'bias': 0.0, 'delay': [1, 2]}"),
        (
            {"curriculum": Curriculum(up=0.5)},
            {"dt": 0.02, **LATE},
            (
                "--task.dt was 0.01, is 0.02; --task.action-delay was (0, 0), is (0, 2); "
                "--task.curriculum.up was 0.5, is 0.05"
            ),
        ),
    ],
)
def test_options_that_the_worlds_do_not_fit_are_named_with_both_values(tmp_path, before, after, named):
    folder = run(tmp_path, task=before)
    with pytest.raises(InputError) as caught:
        run(tmp_path, resume=folder.path, task=after)
    said = str(caught.value)
    assert said.startswith(f"checkpoint {folder.latest_checkpoint()} is of other networks or worlds: {named}; go on ")
    assert "version" not in said
    assert "\n" not in said
    assert run(tmp_path, resume=folder.path, task=before).latest_checkpoint().name == "iteration_000003.pt"


def test_networks_that_do_not_fit_name_their_options(tmp_path):
    folder = run(tmp_path)
    changes: dict[str, Any] = {"network.hidden": (8,), "ppo.gamma": 0.5}
    with pytest.raises(InputError) as caught:
        run(tmp_path, resume=folder.path, **changes)
    # A policy cannot be taken over by another network: there is no --warm-start
    assert str(caught.value).endswith(
        "--network.hidden was (64, 64), is (8,); go on without what has changed, or begin a new run"
    )


def test_a_change_that_the_worlds_fit_is_taken(tmp_path):
    folder = run(tmp_path)
    run(tmp_path, resume=folder.path, task={"max_episode_steps": 7})
    assert folder.load_config()["task_config"]["max_episode_steps"] == 7


def test_a_checkpoint_that_lacks_something_by_itself_is_of_another_version(tmp_path):
    folder = run(tmp_path)
    content = load_checkpoint(folder.latest_checkpoint())
    del content["worlds"]["episode_clock"]
    save_checkpoint(folder.latest_checkpoint(), content)
    with pytest.raises(InputError, match="worlds has no 'episode_clock': it was made by another version"):
        run(tmp_path, resume=folder.path)


def test_the_command_says_it_in_one_line_and_its_remedies_work(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    folder = run(Path("runs"))
    late = ["--task.action-delay", "0", "2", "--iterations", "3"]
    assert cli.main(["train", "--resume", str(folder.path), *late]) == 2
    err = [line for line in capfd.readouterr().err.splitlines() if not line.startswith("Warp")]
    newest = folder.latest_checkpoint()
    told = (
        f"simwarp: checkpoint {newest} is of other networks or worlds: --task.action-delay was (0, 0), is (0, 2); "
        f"go on without what has changed, or begin a new run from its policy: --warm-start {newest}"
    )
    assert err == [told]
    begin = ["train", "fast", "--warm-start", str(folder.latest_checkpoint()), "--num-envs", "8", "--device", "cpu"]
    assert cli.main([*begin, *late]) == 0
    assert cli.main(["train", "--resume", str(folder.path), "--iterations", "3"]) == 0


def test_every_change_is_found():
    before = task_class("fast").config_type()
    fields = {"dt": 0.1, "substeps": 2, "decimation": 2, "max_episode_steps": 2, "action_rise_time": 0.5,
              "guard_steps": 2, "action_delay": (0, 1), "curriculum.up": 0.1, "curriculum.down": 0.1}  # fmt: skip
    said = changed_options(before, replace_fields(before, fields), "task")
    assert len(said) == len(fields)
    assert said[0] == f"--task.dt was {before.dt}, is 0.1"
    assert changed_options(before, before, "task") == []


def test_a_range_is_compared_value_by_value():
    config = task_class("pendulum").config_type
    before, after = (config(randomise={"body_mass": Range(0.5, high, only=("arm",))}) for high in (1.5, 2.0))
    changed = changed_options(before, after, "task")
    assert changed == ["--task.randomise 'body_mass'.high was 1.5, is 2.0"]
