"""From a person at the wheel to a policy: `examples/drive_and_clone.py`, driven by a script over the page's socket."""

import importlib
import json
import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("viser")

from simwarp import cli
from simwarp.core.warp_start import COMPILING
from simwarp.tasks import replace_fields, task_class
from simwarp.train.datasets.dataset_formats import load_trajectories
from simwarp.viewer.live.live_view import LiveView
from tests.unit.viewer.live.driving_page import DrivingPage

ROOT = Path(__file__).parents[2]


class Script:
    """Steers along the lane, as a page would: it reads the pose in the lane after each step, and sends keys."""

    def __init__(self, view):
        self.view, self.page = view, DrivingPage(view)
        self.task = view.subject.advance.__self__.task
        view.listeners.append(self.look)

    def look(self):
        _, _, ahead = self.task.lane()
        x, y = (float(value) for value in ahead[0, 2])
        self.page.state = {"steer": max(-1.0, min(1.0, 2.5 * math.atan2(y, x)))}


@pytest.fixture
def driven_by_a_script(monkeypatch):
    """Every view is driven by a script while it runs."""
    run = LiveView.run

    def driven(view, until=None):
        script = Script(view)
        try:
            run(view, until)
        finally:
            script.page.silent()

    monkeypatch.setattr(LiveView, "run", driven)


@pytest.fixture
def view(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        capfd.readouterr()
        code = cli.main(["view", *arguments, "--no-open", "--port", "0"])
        out, err = capfd.readouterr()
        return code, out, err

    return run


def test_what_is_driven_is_what_clone_reads(view, driven_by_a_script):
    code, out, err = view(
        "hallway", "--obs", "state", "--drive", "--worlds", "2", "--checkpoint", "random", "--speed", "0", "--seconds",
        "6", "--record-trajectories", "driven.npz",
    )  # fmt: skip
    # Where its kernels are not in the cache yet, a line says so
    told = [line for line in err.splitlines() if not line.startswith(f"simwarp: {COMPILING}")]
    assert (code, told) == (0, [])
    data = load_trajectories(Path("driven.npz"), "hallway")
    assert f"wrote driven.npz: {data.steps:,} steps driven by hand" in out
    assert data.steps > 50
    assert data.about["policy"] == "human"
    assert data.about["task_config"]["obs"] == "state"
    assert bool(data.truncated[-1]) or bool(data.terminated[-1])
    ends = np.flatnonzero(data.terminated | data.truncated)
    assert list(np.flatnonzero(np.diff(data.episode))) == list(ends[:-1])
    # the script steers to its preview: the actions are the person's, no random ones, and never jump
    assert np.abs(np.diff(data.actions[:, 0])).max() <= 0.1 / 0.3 + 1e-5
    # the observed action in force follows what was asked for
    assert np.abs(data.actions).max() > 0.0


@pytest.mark.slow
def test_interrupted_pages_keep_what_was_driven(view, driven_by_a_script, monkeypatch):
    count = []

    def interrupt(self):
        count.append(1)
        if len(count) == 40:
            raise KeyboardInterrupt

    from simwarp.cli.view.human_in_task import HumanInTask

    after = HumanInTask.after_step
    monkeypatch.setattr(HumanInTask, "after_step", lambda self: (after(self), interrupt(self)))
    code, out, _ = view(
        "hallway", "--obs", "state", "--drive", "--worlds", "1", "--checkpoint", "zero", "--seconds", "60",
        "--record-trajectories", "driven.npz",
    )  # fmt: skip
    assert code == 130
    assert load_trajectories(Path("driven.npz"), "hallway").steps <= 40
    assert "wrote driven.npz" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["ant", "--record-trajectories", "a.npz"], "nobody can drive in task 'ant'; driving tasks have a vehicle"),
        (["hallway", "--record-trajectories", "a.csv"], "--record-trajectories must end in .npz, got 'a.csv'"),
        (["ant", "--drive"], "--drive: 'ant' has no vehicle to drive"),
    ],
)
def test_what_nobody_can_drive(view, arguments, message):
    code, _, err = view(*arguments, "--worlds", "1", "--checkpoint", "zero")
    assert code == 2
    assert message in err
    assert err.count("\n") == 1 + err.count("compiling kernels")  # where no test before has loaded them


def test_a_person_drives_one_world_and_no_bit_of_another():
    from simwarp.cli.view.human_in_task import HumanInTask
    from simwarp.cli.view.task_subject import task_subject
    from simwarp.tasks import make
    from simwarp.train.networks.policies import zero_policy
    from simwarp.viewer.live.driving.human_driver import Inputs

    config = replace_fields(task_class("off-road").config_type(), {"obs": "state"})
    ends = []
    for person in (False, True):
        task = make("off-road", 3, device="cpu", seed=3, config=config)
        subject, loop = task_subject(task, zero_policy(task), 3)
        human = HumanInTask(loop, 3)
        for step in range(20):
            if person:
                human.give(1, Inputs(steering=0.5, throttle=1.0, braking=0.25))
                if step == 0:
                    subject.advance()
                    assert loop.actions[1].tolist() == [0.5, 0.75]
                    assert not loop.actions[[0, 2]].any()
                    continue
            subject.advance()
        ends.append(task.simulation.state.body_x.numpy().copy())
        human.leave(1)
        subject.advance()
        assert not loop.actions.any()
    plain, driven = ends
    assert np.array_equal(plain[[0, 2]], driven[[0, 2]])
    assert np.abs(plain[1] - driven[1]).max() > 0.5


@pytest.mark.slow
def test_the_example_from_the_wheel_to_a_trained_policy(tmp_path, monkeypatch, driven_by_a_script):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    example = importlib.import_module("drive_and_clone")
    told: list[Path] = []

    def run(*arguments):
        words = [*arguments, "--json", f"{arguments[0]}_{len(told)}.json"]
        code = cli.main([*words, "--port", "0"] if arguments[0] == "view" else words)
        told.append(Path(words[-1]))
        return code

    monkeypatch.setattr(example, "simwarp", run)
    monkeypatch.setattr(
        "sys.argv",
        [
            "drive_and_clone.py",
            "--minutes",
            "0.5",
            "--speed",
            "4",
            "--no-open",
            "--iterations",
            "12",
            "--num-envs",
            "8",
        ],
    )
    assert example.main() == 0
    _, clone, cloned, _, trained = (json.loads(path.read_text()) for path in told)
    assert clone["steps"] > 200
    print({"clone": clone, "cloned": cloned, "trained": trained})
    driven = load_trajectories(Path("driven.npz"), "hallway").about["mean_return"]
    print("driven", driven)
    assert driven > cloned["baselines"]["zero"]["mean_return"]
    # two minutes of driving: the clone gets further than no steering does, by more than chance among 16 episodes
    assert cloned["laps"] > 1.5 * cloned["baselines"]["zero"]["laps"]
    assert trained["checkpoint"].endswith("iteration_000012.pt")
