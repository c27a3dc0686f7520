"""What a task tells of itself is held to its form when the task is made, and settings stay JSON where redeclared."""

import dataclasses
import sys

import pytest
import torch

from simwarp import cli
from simwarp.tasks import Command, Range, TaskError
from simwarp.tasks.framework import registry
from tests.tasks.framework.samples import Counter, SampleConfig


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("observation_names", ["a"], "observation_names must be a dict of groups to lists of names, got"),
        (
            "observation_names",
            {"camera": ["a"]},
            r"of groups that are rows of numbers \(policy\), got 'camera'",
        ),
        ("observation_names", {"other": []}, r"must be of groups that are rows of numbers \(policy\), got 'other'"),
        ("observation_names", {"policy": "a"}, "observation_names of 'policy' must be a list of names, got 'a'"),
        ("observation_names", {"policy": ["a", "b"]}, "must be 1 names, one per component, got 2"),
        ("action_names", ["a"], "action_names must be 2 names, one per component, got 1"),
        ("action_joints", [1, 2], "action_joints must be a list of names, got"),
        ("instruction", "two\nlines", "instruction must be a sentence on one line, got 'two"),
        ("instruction", 3, "instruction must be a sentence on one line, got 3"),
        ("action_scale", (1.0,), "action_scale must be 2 numbers, one per component of an action, got"),
        ("default_positions", (0.0, 0.0, 0.0), "default_positions must be 2 numbers"),
        ("action_size", 0, "action_size must be at least 1; one that nothing reads, where nothing is done, got 0"),
        ("commands", lambda task: {"speed": (0, 1)}, r"commands\(\) of 'speed' must be a Command\(values, low, high\)"),
        ("commands", lambda task: [], r"commands\(\) must be a dict of names to Command, got"),
    ],
)
def test_a_wrong_description_is_one_line(monkeypatch, name, value, message):
    monkeypatch.setattr(Counter, name, value)
    with pytest.raises(TaskError, match=f"task 'counter': .*{message}") as found:
        Counter(SampleConfig(), 2)
    assert "\n" not in str(found.value)


def test_a_right_description_passes(monkeypatch):
    monkeypatch.setattr(Counter, "observation_names", {"policy": ["steps"]})
    monkeypatch.setattr(Counter, "action_names", ("left", "right"))
    monkeypatch.setattr(Counter, "commands", lambda task: {"speed": Command(torch.zeros(2), 0.0, 1.0)})
    task = Counter(SampleConfig(), 2)
    assert task.observation_names == {"policy": ["steps"]}
    assert task.commands()["speed"].high == 1.0


TASK = """
import dataclasses
from simwarp.tasks import Range
from simwarp.tasks.locomotion.ant import AntConfig, AntTask

@dataclasses.dataclass(frozen=True)
class MineConfig(AntConfig):
    randomise: dict[str, Range] = dataclasses.field(default_factory=lambda: {"body_mass": Range(0.9, 1.1)})

class Mine(AntTask):
    config_type = MineConfig
"""


@pytest.fixture
def forgotten():
    """The registry forgets the task of a file, and the path its folder; those of the package may come in meanwhile."""
    path = sys.path.copy()
    yield
    registry._tasks.pop("mine", None)
    sys.modules.pop("mine", None)
    sys.path[:] = path


@pytest.mark.usefixtures("forgotten")
def test_redeclared_settings_are_json_on_the_command_line(tmp_path, monkeypatch, capsys):
    """Refused before: `unknown option --task.randomise; did you mean --task.randomise`."""
    (tmp_path / "mine.py").write_text(TASK)
    monkeypatch.chdir(tmp_path)
    command = ["eval", "mine.py:Mine", "--checkpoint", "zero", "--episodes", "2", "--task.max-episode-steps", "2"]
    assert cli.main([*command, "--task.randomise", '{"body_mass": {"low": 0.5, "high": 0.6}}']) == 0
    assert cli.main([*command, "--task.randomise", '{"bodymass": {"low": 0.5, "high": 0.6}}']) == 2
    assert "body_mass" in capsys.readouterr().err


def test_a_task_that_is_not_registered_is_called_as_its_class():
    class Unregistered(Counter):
        def rewards(self):
            return {"wrong": torch.ones(1, 1)}

    with pytest.raises(TaskError, match="task 'Unregistered'"):
        Unregistered(SampleConfig(), 2)


def test_their_values_are_those_of_the_class():
    @dataclasses.dataclass(frozen=True)
    class Own(SampleConfig):
        randomise: dict[str, Range] = dataclasses.field(default_factory=lambda: {"body_mass": Range(0.9, 1.1)})

    assert Own().randomise["body_mass"].high == 1.1
    assert Own(randomise={}).randomise == {}
