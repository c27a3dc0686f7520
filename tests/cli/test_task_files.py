"""`path/to/file.py:TaskClass` in the place of a task's name: trained, played and resumed without being installed."""

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from simwarp import cli
from simwarp.cli.view.view_target import ViewTarget, find_target
from simwarp.tasks import InputError, make, task_class
from simwarp.tasks.framework import registry, task_class_import
from simwarp.tasks.framework.task_class_import import name_of_class
from simwarp.train.runs.checkpoint import load_checkpoint

SOURCE = """
    import dataclasses

    import torch
    from distances import GAIN
    from simwarp.tasks import Drawing, Line, Task, TaskConfig


    @dataclasses.dataclass(frozen=True)
    class LineConfig(TaskConfig):
        max_episode_steps: int = 20
        gain: float = GAIN
        '''Way of a full action [m].'''


    class OnALine(Task[LineConfig]):
        config_type = LineConfig
        physics = False
        success_reasons = frozenset()
        training = {"iterations": 1, "num_envs": 8, "steps_per_iteration": 8}

        def setup(self):
            self.x = torch.zeros(self.num_worlds, 1, device=self.device)

        def apply(self, action):
            self.x.add_(action, alpha=self.config.gain)

        def observations(self):
            return {"policy": self.x}

        def rewards(self):
            return {"near": 1.0 - self.x[:, 0].abs()}

        def terminations(self):
            return {}

        def reset(self, world_mask):
            self.x.masked_fill_(world_mask[:, None], 1.0)

        def drawing(self):
            tip = torch.nn.functional.pad(self.x, (0, 2))
            return Drawing((Line(torch.stack([0 * tip, tip], dim=1), "tab:blue"),), ((-2.0, 2.0), (-2.0, 2.0)))


    class NoTask:
        pass


    class HalfATask(Task):
        def apply(self, action):
            pass


    class Pendulum(OnALine):
        pass
"""
WORD = "line.py:OnALine"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with a file of tasks in it; what is loaded from it is forgotten afterwards."""
    monkeypatch.setattr(registry, "_tasks", dict(registry._tasks))
    monkeypatch.setattr(task_class_import, "_modules", {})
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "distances", raising=False)
    monkeypatch.chdir(tmp_path)
    Path("line.py").write_text(textwrap.dedent(SOURCE), encoding="utf-8")
    Path("distances.py").write_text("GAIN = 0.125\n", encoding="utf-8")
    return tmp_path


def forget():
    """As a new process begins: nothing is known of the file."""
    registry._tasks.pop("on-a-line", None)
    task_class_import._modules.clear()


def trained(capfd):
    """The run folder of one iteration."""
    assert cli.main(["train", WORD, "--device", "cpu", "--json", "train.json"]) == 0
    result = json.loads(Path("train.json").read_text())
    assert result["task"] == "on-a-line"
    printed = capfd.readouterr().out
    assert "worlds of 'on-a-line'" in printed
    assert f"simwarp play {WORD}  or  simwarp eval {WORD}" in printed
    return Path(result["run"])


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("MyTask", "my-task"), ("Reach", "reach"), ("LQRTask", "lqr-task"), ("Ant2Legs", "ant2-legs"),
        ("_Hidden_Task", "hidden-task"),
    ],
)  # fmt: skip
def test_the_name_is_that_of_the_class(kind, name):
    assert name_of_class(kind) == name


def test_a_class_of_a_file_is_a_task_for_python_too(folder):
    task = make(WORD, 3, gain=0.5)
    assert (task.name, task.num_worlds, task.config.gain) == ("on-a-line", 3, 0.5)
    assert task_class("./line.py:OnALine") is task_class("on-a-line") is type(task)
    assert make(WORD).config.gain == 0.125  # of the file beside it
    assert registry.task_word("on-a-line") == WORD
    assert registry.task_word("pendulum") == "pendulum"


def test_a_registered_class_keeps_its_name(folder):
    text = textwrap.dedent(SOURCE).replace("class OnALine", "@register('rail')\nclass OnALine")
    Path("rail.py").write_text(text.replace("Task, TaskConfig", "Task, TaskConfig, register"), encoding="utf-8")
    assert task_class("rail.py:OnALine").name == "rail"
    assert task_class("rail.py:OnALine") is task_class("rail")


@pytest.mark.slow
def test_train_eval_play_record_clone_by_the_same_words(folder, capfd):
    run = trained(capfd)
    assert run.parent == Path("runs/on-a-line")
    saved = json.loads((run / "config.json").read_text())
    remembered = f"{folder}/line.py:OnALine"
    assert (saved["task"], saved["task_file"]) == ("on-a-line", remembered)
    (checkpoint,) = (run / "checkpoints").iterdir()
    assert load_checkpoint(checkpoint)["task_file"] == remembered
    assert cli.main(["eval", WORD, "--episodes", "4", "--no-baselines", "--json", "eval.json"]) == 0
    assert json.loads(Path("eval.json").read_text())["mean_episode_length"] == 20
    assert cli.main(["play", "--video", "line.png", "--seconds", "0.1", WORD]) == 0  # options may come first
    assert Path("line.png").stat().st_size > 1000
    assert cli.main(["record", WORD, "--episodes", "4"]) == 0
    assert cli.main(["clone", WORD, "--data", "on-a-line.npz", "--epochs", "1"]) == 0
    assert f"simwarp train {WORD} --warm-start on-a-line_clone.pt" in capfd.readouterr().out
    assert cli.main(["bench", WORD, "--worlds", "2", "--seconds", "0.05", "--json", "bench.json"]) == 0
    assert json.loads(Path("bench.json").read_text())["scene"] == "on-a-line"
    assert cli.main(["train", WORD, "--resume", str(run), "--iterations", "2", "--device", "cpu"]) == 0


def test_a_run_is_enough_where_its_file_is_still_there(folder, capfd):
    run = str(trained(capfd))
    forget()
    assert cli.main(["train", "--resume", run, "--iterations", "2", "--device", "cpu"]) == 0
    assert "done after 2 iterations" in capfd.readouterr().out
    commands = (
        ["play", run, "--seconds", "0.1"],
        ["eval", run, "--episodes", "2", "--no-baselines"],
        ["record", run, "--episodes", "2"],
        ["export", run, "--format", "torchscript"],
    )
    for command in commands:
        forget()
        assert cli.main(command) == 0, command
    assert Path("on-a-line.mp4").is_file()
    assert cli.main(["play", run, "--checkpoint", run]) == 2
    assert "has a policy of its own: leave --checkpoint away" in capfd.readouterr().err


def test_a_run_whose_file_is_gone_says_so_and_plays_from_another(folder, capfd):
    run = str(trained(capfd))
    Path("line.py").rename("moved.py")
    for command in (["play", run], ["train", "--resume", run, "--iterations", "2"], ["export", run]):
        forget()
        assert cli.main(command) == 2
        err = capfd.readouterr().err
        assert f"needs task 'on-a-line': file '{folder}/line.py' does not exist" in err
        assert err.count("\n") == 1
    forget()
    assert cli.main(["play", "moved.py:OnALine", "--checkpoint", run, "--seconds", "0.1"]) == 0


def test_a_run_of_an_installed_task_plays_by_its_folder_too(folder, capfd):
    assert cli.main(["train", "fast", "--device", "cpu", "--num-envs", "4", "--iterations", "1"]) == 0
    (run,) = Path("runs/fast").iterdir()
    assert cli.main(["eval", str(run), "--episodes", "2", "--no-baselines", "--json", "eval.json"]) == 0
    assert json.loads(Path("eval.json").read_text())["checkpoint"].startswith(str(run))


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("gone.py:OnALine", "gone.py' does not exist; give path/to/file.py:TaskClass"),
        ("line.py:OnALin", "has no class 'OnALin'; did you mean OnALine?"),
        ("line.py:", "which class of"),
        ("line.py:NoTask", "'NoTask' in"),
        ("line.py:HalfATask", "write observations, reset, rewards, terminations"),
        ("line.py:Pendulum", "would be called 'pendulum', which another task is called; rename the class"),
        ("line.txt:OnALine", "is given as path/to/file.py:TaskClass, got 'line.txt:OnALine'"),
        ("broken.py:Any", "cannot be imported (line 2): ModuleNotFoundError: No module named 'not_there'"),
        ("wrong.py:Any", "cannot be imported (line 1): SyntaxError"),
        ("leaves.py:Any", "cannot be imported (line 1): SystemExit: 3"),
    ],
)
@pytest.mark.parametrize("command", ["train", "play"])
def test_mistakes_get_one_line(folder, capfd, command, word, message):
    Path("broken.py").write_text("import sys\nimport not_there\n")
    Path("wrong.py").write_text("def f(:\n")
    Path("leaves.py").write_text("raise SystemExit(3)\n")
    assert cli.main([command, word]) == 2
    err = capfd.readouterr().err
    assert message in err
    assert err.count("\n") == 1


def test_a_colon_tells_a_task_from_a_model(folder):
    assert find_target("line.py:OnALine") == ViewTarget("task", "line.py:OnALine")
    assert find_target("line.py:OnALine").title == "OnALine"
    assert find_target("line.py") == ViewTarget("model", "line.py", True)


def test_view_records_a_task_of_a_file(folder):
    pytest.importorskip("viser")
    Path("swing.py").write_text(
        "from simwarp.tasks.pendulum import PendulumTask\n\n\nclass MyPendulum(PendulumTask):\n    pass\n"
    )
    words = ["view", "swing.py:MyPendulum", "--record", "line.viser", "--seconds", "0.1", "--worlds", "1"]
    assert cli.main([*words, "--task.max-episode-steps", "50"]) == 0
    assert Path("line.viser").stat().st_size > 1000


@pytest.mark.parametrize(
    "beside",
    ["", pytest.param("assert float(torch.linspace(0.0, 1.0, 3)[1]) == 0.5\n", marks=pytest.mark.slow, id="computes")],
)
def test_help_lists_the_options_of_the_task(folder, beside):
    """Also where the file computes with torch when it is imported, which stand-ins for torch cannot."""
    with Path("line.py").open("a", encoding="utf-8") as file:
        file.write(beside)
    env = {key: value for key, value in os.environ.items() if key != "SIMWARP_FULL_IMPORTS"}
    root = str(Path(cli.__file__).resolve().parents[2])
    command = [sys.executable, "-m", "simwarp", "train", WORD, "--help"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=env | {"PYTHONPATH": root})
    assert done.returncode == 0, done.stderr
    assert "usage: simwarp train line.py:OnALine" in done.stdout
    assert "--task.gain" in done.stdout
    assert "(default: 0.125)" in done.stdout


def test_a_run_whose_class_got_another_name(folder, capfd):
    run = trained(capfd)
    saved = json.loads((run / "config.json").read_text())
    Path("line.py").write_text(
        Path("line.py").read_text().replace("class OnALine", "@register('rail')\nclass OnALine")
        .replace("Task, TaskConfig", "Task, TaskConfig, register"), encoding="utf-8",
    )  # fmt: skip
    forget()
    with pytest.raises(InputError, match=r"is of task 'on-a-line', and .* is now called 'rail'"):
        registry.task_class_of(saved, "run x")
