"""The script of the ablations on driving: what it compares and reports; it learns nothing here."""

import dataclasses
import importlib.util
import json
import sys
from pathlib import Path

import pytest

from benchmarks import comparing
from benchmarks.comparing import Budget
from simwarp.tasks import config_to_plain, replace_fields
from simwarp.tasks.driving.driving_config import Frame, Observing
from simwarp.tasks.driving.lapping import Start
from simwarp.tasks.randomisation.randomisation_config import Curriculum, Driver
from simwarp.train.config import NetworkKind

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "driving_ablations.py"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("driving_ablations", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


def asked(script, options):
    return {name: script.ABLATIONS[name].asked(options, name) for name in options.ablations}


@pytest.fixture
def usual(script, tmp_path):
    """The studies of a plain call."""
    options = script.parse(["--out", str(tmp_path)])
    return asked(script, options)


def settings(study):
    return {name: study.settings(name, 1) for name in study.arms}


def test_arms_differ_in_what_they_are_compared_by(usual):
    assert list(usual) == ["fusion", "frame", "curriculum", "start", "minibatch"]
    same = {
        "fusion": lambda train, task: (replace_fields(train, {"network.kind": NetworkKind.MLP}), task),
        "frame": lambda train, task: (train, dataclasses.replace(task, goal_frame=Frame.VEHICLE)),
        "curriculum": lambda train, task: (train, dataclasses.replace(task, curriculum=Curriculum())),
        "start": lambda train, task: (train, dataclasses.replace(task, start=Start.TURN)),
        "minibatch": lambda train, task: (replace_fields(train, {"ppo.mini_batches": 4}), task),
    }
    for name, study in usual.items():
        made = settings(study)
        for arm, known in study.arms.items():
            if known.against:
                assert made[arm] != made[known.against]
                assert same[name](*made[arm]) == same[name](*made[known.against]), (name, arm)


def differing(found, wanted, path=""):
    """Names of the values that differ, where both have them."""
    for key in found.keys() & wanted.keys():
        if isinstance(found[key], dict) and isinstance(wanted[key], dict):
            yield from differing(found[key], wanted[key], f"{path}{key}.")
        elif found[key] != wanted[key]:
            yield path + key


def test_committed_runs_were_trained_as_the_studies_say_whatever_defaults_have_become(script):
    images = {"camera_rate", "camera_width", "camera_height"}  # of runs by state, which have no camera
    checked = 0
    for name, study in script.ABLATIONS.items():
        for path in (comparing.ROOT / "benchmarks" / "results" / "driving" / name).glob("*-*.json"):
            result = json.loads(path.read_text(encoding="utf-8"))
            arm, seed = path.stem.rsplit("-", 1)
            train, task = map(config_to_plain, study.settings(arm, int(seed)))
            assert not set(differing(result["train_config"], train)), path
            free = images if task["obs"] == "state" else {"camera_rate"}
            assert set(differing(result["task_config"], task)) <= free, path
            checked += 1
    assert checked >= 42


def test_the_findings_are_those_of_the_thesis(usual):
    made = {name: settings(study) for name, study in usual.items()}
    kinds = {arm: train.network.kind for arm, (train, _) in made["fusion"].items()}
    assert kinds == {"early": NetworkKind.EARLY_FUSION, "late": NetworkKind.LATE_FUSION}
    task = made["fusion"]["late"][1]
    assert (task.obs, task.camera_width, task.camera_height) == (Observing.CAMERA, 48, 36)
    frames = {(task.goal_frame, task.obstacles) for _, task in made["frame"].values()}
    assert frames == {(axes, count) for axes in Frame for count in (0, 30)}
    hills = {arm: task for arm, (_, task) in made["curriculum"].items()}
    assert {(task.hills, task.obstacles) for task in hills.values()} == {(1.0, 30)}
    rising = hills["curriculum"].curriculum
    iterations = usual["curriculum"].budget.iterations
    assert rising.driver is Driver.ITERATION
    assert 0.0 < rising.at_iteration(iterations // 2) < rising.at_iteration(iterations) == 1.0
    assert hills["at-once"].curriculum.driver is Driver.NONE
    assert {arm: task.start for arm, (_, task) in made["start"].items()} == {
        "turn": Start.TURN,
        "straight": Start.STRAIGHT,
    }
    assert usual["start"].evaluation == {"start": Start.ANYWHERE}
    assert {train.ppo.mini_batches for train, _ in made["minibatch"].values()} == {2, 4, 16, 64}
    for name in ("frame", "curriculum", "start", "minibatch"):
        for train, task in made[name].values():
            assert task.obs is Observing.STATE
            assert (train.seed, train.network.kind) == (1, NetworkKind.MLP)


def test_all_findings_take_an_afternoon_and_a_dry_run_says_so(script, usual, capsys, tmp_path):
    seconds = 0.0
    for name, study in usual.items():
        _, each = script.cost(name, study)
        seconds += len(study.missing()) * each
    assert 1.0 < seconds / 3600.0 < 3.1
    assert script.work(script.parse(["--dry-run", "--out", str(tmp_path / "none")])) == 0
    told = capsys.readouterr().out
    assert f"about {seconds / 3600.0:.1f} h" in told
    assert not (tmp_path / "none").exists()
    budgets = script.parse(["--ablations", "frame,start", "--iterations", "7", "--evaluations", "2", "--seeds", "1"])
    assert budgets.ablations == ["frame", "start"]
    short = asked(script, budgets)
    assert short["frame"].budget == Budget(7, 64, 100)
    assert short["start"].budget == Budget(7, 64, 32, 2)
    with pytest.raises(SystemExit):
        script.parse(["--ablations", "frame,fusoin"])


def stand_in(monkeypatch, script, name):
    """Let a task without physics have a ablation's arms and budget."""
    ablation = script.ABLATIONS[name]
    arms = {arm: dataclasses.replace(known, task={}) for arm, known in ablation.arms.items()}
    quick = {"task": "fast", "arms": arms, "config": {}, "evaluation": {}}
    quick["quantities"] = {"final_return": comparing.RETURN, "area": comparing.AREA}
    monkeypatch.setitem(script.ABLATIONS, name, dataclasses.replace(ablation, **quick))


@pytest.mark.slow
def test_runs_are_done_once_reported_and_drawn(script, monkeypatch, capsys, tmp_path):
    for name in ("curriculum", "minibatch"):
        stand_in(monkeypatch, script, name)
    small = ["--ablations", "curriculum,minibatch", "--seeds", "1", "--num-envs", "8", "--episodes", "4"]
    small += [
        "--iterations",
        "2",
        "--evaluations",
        "2",
        "--out",
        str(tmp_path / "out"),
        "--runs",
        str(tmp_path / "runs"),
    ]
    options = script.parse([*small, "--plot", "--picture", str(tmp_path / "curves.png")])
    assert script.work(options) == 0
    told = capsys.readouterr().out
    assert "| at-once minus curriculum | " in told
    assert "| parts-64 minus parts-4 | " in told
    assert (tmp_path / "curves.png").stat().st_size > 5000
    files = sorted((tmp_path / "out").rglob("*-0.json"))
    assert len(files) == 2 + 4
    result = json.loads((tmp_path / "out" / "curriculum" / "at-once-0.json").read_text(encoding="utf-8"))
    assert len(result["evaluations"]["env_steps"]) == 2
    summary = json.loads((tmp_path / "out" / "minibatch" / "summary.json").read_text(encoding="utf-8"))
    assert set(summary["differences"]) == {"parts-2", "parts-16", "parts-64"}
    times = [path.stat().st_mtime_ns for path in files]
    assert script.work(options) == 0
    assert [path.stat().st_mtime_ns for path in files] == times
