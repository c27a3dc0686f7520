"""Robustness of policies: points of the axes and maps, rows that are kept, tables and pictures made of them."""

import csv
import json
import os
import signal
import sys
from pathlib import Path

import pytest
from PIL import Image

from benchmarks import robustness, robustness_points, robustness_report
from benchmarks.comparing import exit_code
from benchmarks.robustness import has_sun, main
from benchmarks.robustness_points import (
    AXES,
    COLUMNS,
    DRAWN,
    MAPS,
    NOMINAL,
    axes_of_task,
    changed,
    key_of,
    nominal_config,
    path_of,
    read_rows,
    thinned,
    wanted_points,
)
from benchmarks.robustness_report import labels_of, numbers_of, summary, tables
from simwarp.statistics.proportions import wilson_interval
from simwarp.tasks import replace_fields, task_class
from simwarp.tasks.driving.conditions import RANDOM_RANGES, Conditions
from simwarp.train.evaluation.grid import EvaluationStoppedError
from simwarp.train.networks.policies import find_policy

ROAD = "obstacle-avoidance"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(robustness_points, "RESULTS", tmp_path / "rows")
    monkeypatch.setattr(robustness_report, "PICTURES", tmp_path)
    return tmp_path


def write(label, counts, digest="abc", episodes=10):
    path = path_of(ROAD, "camera", label)
    path.parent.mkdir(exist_ok=True)
    new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(COLUMNS)
        for point, successes in counts.items():
            writer.writerow((digest, point, episodes, successes, 0, 0, 1.0, 90.0, json.dumps({"goal": successes}), 1.0))


def test_axes_are_all_conditions_and_those_of_the_task():
    assert set(AXES) == {*RANDOM_RANGES, "tires", "full"}
    road = axes_of_task(ROAD, "camera", tuple(AXES))
    assert set(road) == set(AXES)
    assert road["tires"].values == ("own", "fiala", "lugre", "pacejka2002", "pacejka89", "tmsimple")
    assert set(axes_of_task(ROAD, "state", tuple(AXES))) == {"friction", "mass", "action_delay", "tires", "full"}
    assert "full" not in axes_of_task("off-road", "camera", tuple(AXES))


def test_points_are_there_once_and_change_what_they_say():
    config = task_class(ROAD).config_type()
    axes = axes_of_task(ROAD, "camera", tuple(AXES))
    points = wanted_points(config, axes, tuple(MAPS))
    assert list(points)[:2] == [NOMINAL, DRAWN]
    on_axes = sum(len(axis.values) - 1 for axis in axes.values())
    cells = sum(
        key_of(config, changes) not in wanted_points(config, axes, ())
        for each in MAPS.values() for line in each.changes() for changes in line
    )  # fmt: skip
    assert len(points) == 2 + on_axes + cells
    configs = {json.dumps(str(changed(config, changes))) for changes in points.values()}
    assert len(configs) == len(points)  # no point stands for another one
    some = changed(config, points["friction=0.5 mass=1.4"])
    assert (some.friction, some.mass, some.fog) == (0.5, 1.4, 0.0)
    assert changed(config, points["action_delay=2"]).action_delay == (2, 2)
    assert changed(config, points["tires=fiala"]).tires == "fiala"
    assert changed(config, {"tires": "own"}) == config
    assert changed(config, points[DRAWN]).conditions is Conditions.RANDOM
    assert list(wanted_points(config, {"fog": axes["fog"]}, tuple(MAPS)))[2:] == [
        f"fog={value}" for value in axes["fog"].values if value
    ]  # a map needs both of its axes


def test_the_nominal_point_is_that_of_the_task_whatever_was_trained_in():
    source = find_policy(ROAD, Path("shipped"), obs="camera")
    drawn = {**source.content["task_config"], "conditions": "random", "fog": [0.0, 0.02], "friction": 0.4}
    object.__setattr__(source, "content", {**source.content, "task_config": drawn})
    config = nominal_config(source, ROAD)
    assert (config.conditions, config.fog, config.friction) == (Conditions.NOMINAL, 0.0, 0.9)
    assert (config.obs.value, config.camera_width) == ("camera", 80)


def test_harder_worlds_of_a_training_are_no_part_of_the_nominal_point():
    source = find_policy("off-road", Path("shipped"), obs="camera")
    trained = {**source.content["task_config"], **task_class("off-road").trained_in}
    object.__setattr__(source, "content", {**source.content, "task_config": trained})
    config = nominal_config(source, "off-road")
    assert (config.obstacles, config.hills, config.varied) == (30, 0.0, False)
    assert nominal_config(find_policy("hallway", Path("shipped"), obs="camera"), "hallway").tracks == 16


def test_a_corridor_has_no_sun():
    for task, sun in (("hallway", False), (ROAD, True)):
        config = nominal_config(find_policy(task, Path("shipped"), obs="camera"), task)
        assert has_sun(task, replace_fields(config, {"tracks": 1} if task == "hallway" else {})) is sun


def test_a_row_that_was_cut_off_is_none(folder):
    write("one", {NOMINAL: 9, "fog=0.05": 2})
    path = path_of(ROAD, "camera", "one")
    whole = path.read_text()
    for end in range(1, len(whole.splitlines()[-1]) - 3):
        path.write_text(whole[: -end - 1])
        assert read_rows(path).keys() <= {NOMINAL, "fog=0.05"}
    path.write_text(whole[:-12])
    assert list(read_rows(path)) == [NOMINAL]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nosuch"], "unknown task 'nosuch'"),
        (["pendulum"], "pendulum is no driving task"),
        ([ROAD, "--episodes", "0"], "--episodes must be at least 1, got 0"),
    ],
)
def test_what_cannot_be_evaluated_is_told_in_one_line(words, said, capsys):
    with pytest.raises(SystemExit, match="2"):
        sys.exit(exit_code("robustness", lambda: main(words)))
    assert said in capsys.readouterr().err


def test_a_coarse_axis_has_both_ends():
    assert thinned(AXES["friction"], 3).values == (0.3, 0.6, 1.1)
    assert thinned(AXES["image_delay"], 2).values == (0, 3)
    assert thinned(AXES["full"], 2).values == (False, True)
    tires = axes_of_task(ROAD, "camera", ("tires",))["tires"]
    assert thinned(tires, 2) == tires


def test_rows_count_for_the_policy_that_was_evaluated_last(folder):
    write("shipped", {NOMINAL: 9, "fog=0.02": 4})
    assert {point: row["successes"] for point, row in read_rows(path_of(ROAD, "camera", "shipped")).items()} == {
        NOMINAL: 9, "fog=0.02": 4,
    }  # fmt: skip
    write("shipped", {NOMINAL: 30}, episodes=30)
    assert read_rows(path_of(ROAD, "camera", "shipped"))[NOMINAL]["episodes"] == 30
    write("shipped", {NOMINAL: 1}, digest="other")
    assert list(read_rows(path_of(ROAD, "camera", "shipped"))) == [NOMINAL]
    assert len(read_rows(path_of(ROAD, "camera", "shipped"), "abc")) == 2


def test_tables_and_pictures_have_a_line_for_each_policy(folder):
    config = task_class(ROAD).config_type()
    points = wanted_points(config, axes_of_task(ROAD, "camera", ("fog", "light", "tires")), ("fog-light",))
    write("shipped", dict.fromkeys(points, 7))
    write("drawn", {point: 9 for point in points if point != "fog=0.02"})
    assert labels_of(ROAD, "camera", ["shipped"]) == ["shipped", "drawn"]
    assert main([ROAD, "--report-only"]) == 0
    numbers = json.loads((folder / "rows" / f"{ROAD}.camera.json").read_text())
    assert numbers["machine"]["cpu"]
    shipped = numbers["policies"]["shipped"]
    assert [cell["success"] for cell in shipped["axes"]["fog"]] == [0.7] * 7
    assert [cell["low"] for cell in shipped["axes"]["fog"]] == [wilson_interval(7, 10)[0]] * 7
    assert len(numbers["policies"]["drawn"]["axes"]["fog"]) == 6
    assert numbers["policies"]["drawn"]["maps"]["fog-light"][2][2] is None
    text = (folder / "rows" / f"{ROAD}.camera.md").read_text()
    assert "|  | 0.02 | 70.0 (40 to 89) | – |" in text
    assert text == tables(ROAD, numbers_of(ROAD, "camera", ["shipped", "drawn"]))
    with Image.open(folder / f"robustness_{ROAD}_camera.png") as image:
        assert image.size[0] == 1100


def test_a_summary_tells_the_worst_of_each_condition(folder, capsys):
    write("shipped", {NOMINAL: 9, DRAWN: 5, "fog=0.02": 4, "fog=0.05": 1, "friction=0.3": 10})
    write("drawn", {NOMINAL: 8, "fog=0.05": 9})
    rows = summary([ROAD], "camera", ["shipped"]).splitlines()
    assert rows[0] == f"| success [%] | {ROAD}, shipped | {ROAD}, drawn |"
    assert rows[2:4] == ["| nominal | 90 % of 10 | 80 % of 10 |", "| all drawn | 50 % of 10 | – |"]
    assert "| fog [1/m] | 10 at 0.05 | 80 at 0 |" in rows
    assert "| friction of the ground | 90 at 0.9 | – |" in rows
    assert "| mass of the chassis, factor | – | – |" in rows
    assert main([ROAD, "--summary"]) == 0
    assert rows[2] in capsys.readouterr().out


def test_nothing_is_evaluated_twice_and_an_interruption_keeps_what_is_there(folder, monkeypatch):
    arguments = [ROAD, "--obs", "state", "--episodes", "2", "--axes", "mass", "--maps"]
    evaluate, seen = robustness.evaluate_grid, []

    def stopped(task, policy, points, settings, **options):
        seen.append([point.label for point in points])
        if len(seen) == 1:
            evaluate(task, policy, points[:1], settings, **options)
            os.kill(os.getpid(), signal.SIGINT)
        evaluate(task, policy, points[1:] if len(seen) == 1 else points, settings, **options)

    monkeypatch.setattr(robustness, "evaluate_grid", stopped)
    assert main(arguments) == 130
    rows = read_rows(path_of(ROAD, "state", "shipped"))
    assert list(rows) == [NOMINAL]
    assert rows[NOMINAL]["episodes"] == 2
    masses = [value for value in AXES["mass"].values if value != 1.0]
    monkeypatch.setattr(robustness, "wanted_points", lambda *_: {NOMINAL: {}, "mass=2.0": {"mass": 2.0}})
    assert main(arguments) == 0
    assert seen == [
        ["conditions = nominal", "conditions = random", *(f"mass = {mass:g}" for mass in masses)],
        ["mass = 2"],
    ]
    assert list(read_rows(path_of(ROAD, "state", "shipped"))) == [NOMINAL, "mass=2.0"]
    assert main(arguments) == 0
    assert len(seen) == 2


def test_a_stopped_evaluation_says_so(folder, monkeypatch, capsys):
    def stop(*_, **__):
        raise EvaluationStoppedError("fog = 0.02", 3, {})

    monkeypatch.setattr(robustness, "evaluate_grid", stop)
    options = ["--obs", "state", "--episodes", "2"]
    assert main([ROAD, *options]) == 130
    assert "stopped at fog = 0.02; the same command goes on" in capsys.readouterr().err
