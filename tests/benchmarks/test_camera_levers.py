"""The script that times ways to train by camera: what counts as reached, what a lever changes, and its table."""

import csv
import dataclasses
import sys
from pathlib import Path

import pytest

from benchmarks import camera_levers
from benchmarks.camera_levers import (
    LEVERS,
    Case,
    check_result,
    main,
    newest,
    options_of,
    reached,
    stopped_at,
    table,
)
from simwarp.tasks import InputError, task_class
from simwarp.train.runs.run_files import write_json
from simwarp.train.runs.run_folder import RunFolder

GOAL = frozenset({"goal"})


def run_of(folder, shares, episodes=64):
    """A run folder whose progress has so many episodes an iteration, of which these shares arrived."""
    with RunFolder(folder).progress.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(("iteration", "env_steps", "episodes", "end/goal", "end/collision"))
        for index, share in enumerate(shares, start=1):
            arrived = round(share * episodes)
            rows.writerow((index, 1000 * index, episodes, arrived, episodes - arrived))
    return folder


def case(lever, task="obstacle-avoidance"):
    return Case(task, lever, 1, (), (), Path("runs"), 60.0)


def test_nine_of_ten_of_the_last_256_episodes(tmp_path):
    # the mean of four iterations is 0.9 for the first time with the sixth: (0.75 + 0.875 + 1 + 1) / 4 = 0.906
    run = run_of(tmp_path, (0.0, 0.5, 0.75, 0.875, 1.0, 1.0, 0.0))
    assert reached(run, GOAL, 0) == {"iteration": 6, "env_steps": 6000.0}
    assert reached(run_of(tmp_path, (1.0, 1.0, 1.0)), GOAL, 0) is None  # 192 episodes
    assert reached(run_of(tmp_path, (0.875,) * 20), GOAL, 0) is None


def test_iterations_in_which_the_teacher_led_do_not_count(tmp_path):
    run = run_of(tmp_path, (1.0,) * 4 + (0.5,) * 4 + (1.0,) * 4)
    assert reached(run, GOAL, 0) == {"iteration": 4, "env_steps": 4000.0}
    assert reached(run, GOAL, 4) == {"iteration": 12, "env_steps": 12000.0}
    assert reached(run, GOAL, 10) is None


def test_levers_that_hang_on_the_task():
    usual = task_class("hallway").config_type()
    drawn = "--network.init-mean"  # without a number, as it is given before another option
    assert options_of(case("ppo-repeat", "hallway")) == [drawn, "--task.decimation", str(2 * usual.decimation)]
    [*_, rate] = options_of(case("ppo-rate", "hallway"))
    assert float(rate) == pytest.approx(0.5 / usual.control_dt)
    assert options_of(case("ppo")) == [drawn]
    assert options_of(case("start")) == []
    assert options_of(case("distill-both")) == options_of(case("distill-small")) + options_of(case("distill-bfloat16"))


def test_the_newest_run_is_the_last_that_has_begun(tmp_path):
    assert newest(tmp_path) is None
    for name in ("2026-01-01_00-00-00", "2026-01-02_00-00-00"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "config.json").touch()
    (tmp_path / "2026-01-03_00-00-00").mkdir()  # nothing in it yet
    assert newest(tmp_path) == tmp_path / "2026-01-02_00-00-00"


def test_a_table_has_a_line_for_each_way_and_says_what_was_not_reached():
    one = {"task": "off-road", "lever": "ppo", "seed": 1, "seconds": 90.0, "success_rate": 0.95}
    results = [one | {"reached": {"iteration": 3, "env_steps": 30_000.0}},
               one | {"seed": 2, "seconds": 600.0, "success_rate": 0.5, "reached": None}]  # fmt: skip
    assert table(results).splitlines()[2:] == [
        "| `off-road` | PPO, begins as drawn | 1, 2 | 1.5, not in 10.0 | 30 000 | 95.0 %, 50.0 % |"
    ]


def test_a_training_that_fails_is_no_measurement(tmp_path):
    one = dataclasses.replace(case("ppo"), runs=tmp_path)
    with pytest.raises(InputError, match=r"began no run: .*no such thing"):
        stopped_at([sys.executable, "-c", "import sys; sys.exit('no such thing')"], tmp_path, one, 0)
    begins = f"import pathlib, sys; run = pathlib.Path({str(tmp_path / one.task / 'a')!r}); run.mkdir(parents=True);"
    begins += "(run / 'config.json').write_text('{}'); import time; time.sleep(1.0); sys.exit('not enough memory')"
    with pytest.raises(InputError, match=r"ended with exit code 1: not enough memory"):
        stopped_at([sys.executable, "-c", begins], tmp_path, one, 0)


def test_results_of_another_limit_or_teacher_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "obstacle-avoidance.ppo-1.json"
    write_json(path, {"limit_s": 60.0, "extra": "", "teacher_extra": "--iterations 5"})
    with pytest.raises(
        InputError, match=r"was measured with teacher_extra '--iterations 5', not '': give another --out"
    ):
        check_result(path, case("ppo"))
    write_json(path, {})  # older ones do not say
    check_result(path, case("ppo"))


def test_results_that_are_there_are_not_measured_again(tmp_path, monkeypatch, capsys):
    asked = []

    def measure(wanted):
        asked.append((wanted.lever, wanted.seed))
        return {"task": wanted.task, "lever": wanted.lever, "seed": wanted.seed, "seconds": 60.0,
                "reached": {"iteration": 1, "env_steps": 1000.0}, "success_rate": 1.0}  # fmt: skip

    monkeypatch.setattr(camera_levers, "measure", measure)
    there = measure(case("ppo"))
    write_json(tmp_path / "obstacle-avoidance.ppo-1.json", there)
    asked.clear()
    for _ in range(2):
        monkeypatch.setattr("sys.argv", ["x", "obstacle-avoidance", "--levers", "ppo,distill", "--out", str(tmp_path)])
        main()
    assert asked == [("distill", 1), ("ppo", 2), ("distill", 2)]
    assert f"| `obstacle-avoidance` | {LEVERS['distill'].label} | 1, 2 | 1.0, 1.0 |" in capsys.readouterr().out
    monkeypatch.setattr("sys.argv", ["x", "obstacle-avoidance", "--levers", "magic"])
    with pytest.raises(SystemExit):
        main()
    assert "--levers must be of ppo, " in capsys.readouterr().err
