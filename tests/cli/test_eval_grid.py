"""`simwarp eval --grid`: combinations, tables, files, mistakes, and what an interruption leaves."""

import json
import signal
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from rich.console import Console

from simwarp import cli
from simwarp.cli import UsageError
from simwarp.cli.evaluation.eval_report import Report
from simwarp.cli.evaluation.grids import grid_axes, grid_points
from simwarp.cli.options import expand_shorthands, parse_options, task_options
from simwarp.statistics.proportions import wilson_interval
from simwarp.tasks import task_class
from simwarp.train.evaluation.evaluation import Evaluation
from simwarp.train.evaluation.grid import GridPoint, GridSettings, PointResult
from simwarp.train.networks.policies import PolicySource

USUAL = {"episodes", "mean_return", "mean_episode_length", "success_rate", "success_ci95", "end_reasons"}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A folder of runs with one short run of the fast task."""
    path = tmp_path_factory.mktemp("trained") / "runs"
    options = ["--device", "cpu", "--num-envs", "8", "--iterations", "2", "--steps-per-iteration", "8"]
    assert cli.main(["train", "fast", *options, "--runs", str(path)]) == 0
    return path


@pytest.fixture
def evaluate(runs, tmp_path, monkeypatch, capfd):
    """Evaluate the fast task in a folder of its own: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        capfd.readouterr()
        code = cli.main(["eval", "fast", "--episodes", "4", "--runs", str(runs), *arguments])
        out, err = capfd.readouterr()
        return code, out, err

    return run


@pytest.mark.slow
def test_every_combination_is_evaluated(evaluate, tmp_path):
    code, out, err = evaluate("--grid", "bound=1.5,3.0", "--grid", "start-radius=0.2,0.5,1", "--json", "a.json")
    assert (code, err) == (0, "")
    content = json.loads((tmp_path / "a.json").read_text())
    places = [(point["bound"], point["start_radius"]) for point in content["grid"]]
    assert places == [(1.5, 0.2), (1.5, 0.5), (1.5, 1.0), (3.0, 0.2), (3.0, 0.5), (3.0, 1.0)]
    assert content["keys"] == {"bound": [1.5, 3.0], "start_radius": [0.2, 0.5, 1.0]}
    assert not content["interrupted"]
    for point in content["grid"]:
        assert {*USUAL, "final_distance"} <= point.keys()
        assert point["success_ci95"] == list(wilson_interval(round(point["success_rate"] * 4), 4))
        assert "baselines" not in point
    assert "bound \\ start radius" in out
    assert "point 6/6  bound = 3, start_radius = 1  success" in out
    folder = tmp_path / "fast-eval"
    worlds = [f"worlds_bound={b}_start_radius={r}.png" for b in ("1.5", "3") for r in ("0.2", "0.5", "1")]
    assert content["files"] == [f"fast-eval/{name}" for name in ("results.json", "success.png", "paths.png", *worlds)]
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        ["results.json", "success.png", "paths.png", *worlds]
    )
    assert json.loads((folder / "results.json").read_text()) == content
    with Image.open(folder / "success.png") as image:
        assert image.format == "PNG"
    assert "wrote fast-eval: results.json, success.png, paths.png" in out


@pytest.mark.slow
def test_a_second_grid_leaves_the_first_ones_files_alone(evaluate, tmp_path):
    for _ in range(2):
        assert evaluate("--grid", "gain=0.1")[0] == 0
    assert (tmp_path / "fast-eval-2" / "results.json").is_file()
    assert evaluate("--grid", "gain=0.1", "--plot", "mine")[0] == 0
    assert (tmp_path / "mine" / "success.png").is_file()


def test_one_key_makes_a_list_and_baselines_are_asked_for(evaluate):
    code, out, err = evaluate("--grid", "gain=0.05,0.1", "--baselines", "--json", "-")
    assert code == 0
    assert all(set(point["baselines"]) == {"zero", "random"} for point in json.loads(out)["grid"])
    assert "fast: zero action, 4 episodes per point" in err
    assert "ended by" in err


def test_without_a_grid_files_are_written_where_asked_for(evaluate, tmp_path):
    code, out, _ = evaluate("--no-baselines", "--json", "-")
    assert code == 0
    assert not {"baselines", "files", "grid"} & json.loads(out).keys()
    assert list(tmp_path.iterdir()) == []
    assert evaluate("--plot", "out")[0] == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["paths.png", "results.json", "worlds.png"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--grid", "gain=1", "--grid", "gain=2"], "--grid has the key gain twice"),
        (["--grid", "gain=1,2,1"], "--grid gain has the value 1 twice"),
        (["--grid", "gain=1,,2"], "--grid wants KEY=a,b,c, got 'gain=1,,2'"),
        (["--grid", "curriculum.upp=1"], "unknown option --task.curriculum.upp"),
        # The last point breaks a rule: known before the first one is evaluated
        (["--grid", "bound=3,2", "--grid", "start-radius=1,2.5"], "bound must be larger than start-radius, got 2.0"),
        (["--plot", "no/such"], "folder no does not exist"),
        (["--plot", __file__], "must name a folder"),
        (["--full"], "task 'fast' has only one model of what it drives: leave --full away"),
    ],
)
def test_a_mistake_gets_one_line_and_leaves_nothing(evaluate, tmp_path, arguments, message):
    code, out, err = evaluate(*arguments)
    assert (code, out) == (2, "")
    assert message in err
    assert err.startswith("simwarp: ")
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_an_interruption_keeps_what_was_learned(evaluate, tmp_path, monkeypatch):
    task = task_class("fast")
    acts: Any = task.apply
    asked: list[bool] = []

    def apply(self, action):
        if self.config.bound == 3.0 and not asked:
            asked.append(True)
            signal.raise_signal(signal.SIGINT)
        acts(self, action)

    monkeypatch.setattr(task, "apply", apply)
    code, out, err = evaluate("--grid", "bound=1.5,3.0,4.0", "--json", "a.json")
    assert (code, err) == (130, "")
    content = json.loads((tmp_path / "a.json").read_text())
    assert [point["bound"] for point in content["grid"]] == [1.5]
    assert content["interrupted"]
    assert content["unfinished"] == {"at": "bound = 3", "episodes": 0, "end_reasons": {}}
    assert content["keys"] == {"bound": [1.5, 3.0, 4.0]}
    assert "interrupted at bound = 3" in out
    assert json.loads((tmp_path / "fast-eval" / "results.json").read_text()) == content
    assert (tmp_path / "fast-eval" / "success.png").is_file()


def test_an_interrupted_baseline_leaves_the_policys_numbers(evaluate, tmp_path, monkeypatch):
    task = task_class("fast")
    acts: Any = task.apply
    asked: list[bool] = []

    def apply(self, action):
        # Its first step is the probe of a new task, which has no statistics yet
        if hasattr(self, "_statistics") and not action.any() and not asked:
            asked.append(True)
            signal.raise_signal(signal.SIGINT)
        acts(self, action)

    monkeypatch.setattr(task, "apply", apply)
    code, out, _ = evaluate("--json", "-")
    content = json.loads(out)
    assert code == 130
    assert content.keys() >= USUAL
    assert (content["unfinished"]["at"], content["interrupted"]) == ("zero action", True)


def test_a_point_that_fails_does_not_take_the_others_with_it(evaluate, tmp_path, monkeypatch):
    task = task_class("fast")
    rewards = task.rewards

    def broken(self):
        found = rewards(self)
        return {"near": found["near"] * float("nan")} if self.config.bound == 3.0 else found

    monkeypatch.setattr(task, "rewards", broken)
    code, _, err = evaluate("--grid", "bound=1.5,3.0")
    assert code == 1
    assert "reward 'near' was NaN" in err
    content = json.loads((tmp_path / "fast-eval" / "results.json").read_text())
    assert (len(content["grid"]), content["interrupted"]) == (1, True)


def driving(arguments) -> Any:
    """The options of a driving task, as `simwarp eval` reads them."""
    config = task_class("obstacle-avoidance").config_type()
    kind = task_options("Eval", type("Nothing", (), {}), task=config)
    words = expand_shorthands(arguments, "obstacle-avoidance", config)
    return parse_options(kind, words, "simwarp eval").task


def test_the_full_model_is_one_flag():
    assert not driving([]).full
    assert driving(["--full"]).full
    assert driving(["--task.full"]).full
    assert not driving(["--full", "--no-full"]).full


def test_values_of_all_kinds_make_points():
    points: Any = grid_points(["full=no,True", "friction=0.5,1"], driving([]), driving)
    assert [tuple(point.values.values()) for point in points] == [
        (False, 0.5), (False, 1.0), (True, 0.5), (True, 1.0),
    ]  # fmt: skip
    assert [point.config.full for point in points] == [False, False, True, True]
    nested: Any = grid_points(["curriculum.driver=none,progress", "curriculum.up=0.1"], driving([]), driving)
    assert nested[1].values == {"curriculum.driver": "progress", "curriculum.up": 0.1}
    assert nested[1].config.curriculum.up == 0.1
    with pytest.raises(UsageError, match="--grid full must be true or false, got 'maybe'"):
        grid_points(["full=maybe"], driving([]), driving)
    with pytest.raises(UsageError, match="a policy knows one kind of observations"):
        grid_points(["obs=state,camera"], driving([]), driving)
    assert grid_axes(["a-b= 1 , -2"]) == {"a_b": ["1", "-2"]}
    with pytest.raises(UsageError, match="friction must be positive, got -1"):
        grid_points(["friction=-1"], driving([]), driving)


def test_a_grid_reaches_into_settings_by_name():
    base = driving(["--task.sensing", '{"policy": {"noise": 0.5}}'])
    grids = ["sensing.policy.delay=0 0,1 2", "sensing.camera.delay=0 1", "randomise.body_mass=0.9,1.2"]
    points: Any = grid_points(grids, base, driving)
    assert [tuple(point.values.values()) for point in points] == [
        ("0 0", "0 1", 0.9), ("0 0", "0 1", 1.2), ("1 2", "0 1", 0.9), ("1 2", "0 1", 1.2),
    ]  # fmt: skip
    sensing, mass = points[3].config.sensing, points[3].config.randomise["body_mass"]
    assert (sensing["policy"].noise, sensing["policy"].delay) == (0.5, (1, 2))
    assert (sensing["camera"].noise, sensing["camera"].delay) == (0.0, (0, 1))
    assert (mass.low, mass.high, mass.only) == (1.2, 1.2, ())
    ranges: Any = grid_points(["fog=0 0.03,0.01", "action-delay=0 0,0 2"], driving([]), driving)
    assert [(point.config.fog, point.config.action_delay) for point in ranges] == [
        ((0.0, 0.03), (0, 0)), ((0.0, 0.03), (0, 2)), (0.01, (0, 0)), (0.01, (0, 2)),
    ]  # fmt: skip
    assert ranges[1].label == "fog = 0.0 0.03, action_delay = 0 2"
    for words, message in (
        ("sensing=1", "takes one value of one of them, sensing.NAME.FIELD=a,b,c"),
        ("sensing.policy=1", "name one of its fields: sensing.policy.noise, sensing.policy.bias"),
        ("sensing.camera=1", "name one of its fields: sensing.camera.noise, sensing.camera.bias"),
        ("sensing.policy.noises=1", "'policy'.noises: unknown key .did you mean 'noise'"),
        ("randomise.body_mass.low=1", "'body_mass'.high: missing"),
    ):
        with pytest.raises(UsageError, match=message):
            grid_points([words], base, driving)


@pytest.mark.parametrize(
    ("width", "parts"), [(110, ["bound \\ gain"]), (80, ["return", "ended by"]), (38, ["interval"])]
)
def test_a_table_is_never_cut(width, parts, capsys, tmp_path):
    evaluation = Evaluation(200, 9.1, 1.2, 100.0, 2, 1.0, wilson_interval(200, 200), {"time_limit": 200}, {})
    config = task_class("fast").config_type()
    points = [GridPoint({"bound": bound, "gain": gain}, config) for bound in (1, 2, 3, 4) for gain in range(6)]
    results = [PointResult(point, {"policy": evaluation}, None, 1.0) for point in points]
    source = PolicySource(Path("a.pt"), {}, "policy")
    Report("fast", source, GridSettings(episodes=200, seed=1), points, None, results).show(Console(width=width))
    out = capsys.readouterr().out
    assert "…" not in out
    for part in parts:
        assert part in out
    assert max(map(len, out.splitlines())) <= width
    assert out.count("98.1") == 24
