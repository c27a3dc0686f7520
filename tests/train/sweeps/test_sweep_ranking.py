"""Scores of runs, intervals of medians, the order of points."""

import math
import random

import pytest

from simwarp.tasks import InputError, replace_fields, task_class
from simwarp.train.config import default_config
from simwarp.train.runs.progress_table import series
from simwarp.train.runs.run_folder import RunFolder
from simwarp.train.sweeps.plan import SweepRun
from simwarp.train.sweeps.ranking import median_interval, ranking, result_of
from simwarp.train.sweeps.run_state import RunRecord, RunState
from simwarp.train.sweeps.sweep_curves import draw_curves, draw_search

FAST = task_class("fast")


def record(folder, gamma, seed, values, state=RunState.DONE):
    """A run whose mean reward rises to some values, one per iteration."""
    config = replace_fields(default_config(FAST), {"iterations": max(1, len(values)), "seed": seed})
    path = folder / f"{gamma}-{seed}"
    path.mkdir()
    lines = ["iteration,env_steps,mean_reward,env_steps_per_s,episodes,end/time_limit,end/out_of_bounds"]
    lines += [f"{i + 1},{100 * (i + 1)},{value},50.0,4,3,1" for i, value in enumerate(values)]
    (path / "progress.csv").write_text("\n".join([*lines, ""]))
    run = SweepRun(f"gamma={gamma}", {"ppo.gamma": gamma}, config, FAST.config_type(), RunFolder(path))
    found = RunRecord(run, state)
    found.look()
    return found


def results(records):
    return [result_of(item, "mean_reward", ()) for item in records]


def test_a_median_lies_between_order_statistics_of_known_coverage():
    five = median_interval([3.0, 1.0, 2.0, 5.0, 4.0])
    assert (five.median, five.low, five.high) == (3.0, 1.0, 5.0)
    assert five.coverage == pytest.approx(1.0 - 2.0 / 2**5)
    three = median_interval([1.0, 2.0, 9.0])
    assert three.coverage == pytest.approx(0.75)
    # Eight values: the second from below and from above miss it with 2 (1 + 8) / 2^8
    eight = median_interval(list(range(8)))
    assert (eight.median, eight.low, eight.high) == (3.5, 1, 6)
    assert eight.coverage == pytest.approx(1.0 - 18.0 / 256.0)
    one = median_interval([2.0])
    assert (one.median, one.low, one.high, one.coverage) == (2.0, 2.0, 2.0, 0.0)


def test_the_interval_holds_the_true_median_as_often_as_it_says():
    chance = random.Random(7)
    draws = 4000
    for count in (3, 5, 12):
        # Skewed: the median of an exponential distribution is ln 2
        held, said = 0, 0.0
        for _ in range(draws):
            found = median_interval([chance.expovariate(1.0) for _ in range(count)])
            held += found.low <= math.log(2.0) <= found.high
            said = found.coverage
        # four standard deviations of a share of 4000 draws
        assert held / draws == pytest.approx(said, abs=4.0 * math.sqrt(said * (1.0 - said) / draws))


def test_points_are_ordered_by_the_median_and_a_failed_run_is_worse_than_any(tmp_path):
    records = [
        *(record(tmp_path, 0.9, seed, [score]) for seed, score in enumerate((1.0, 2.0, 30.0))),  # the highest mean
        *(record(tmp_path, 0.95, seed, [score]) for seed, score in enumerate((5.0, 4.0, 6.0))),
        *(record(tmp_path, 0.99, seed, [score]) for seed, score in enumerate((50.0, 60.0))),
        record(tmp_path, 0.99, 2, [], RunState.FAILED),
        *(record(tmp_path, 1.0, seed, [70.0], RunState.STOPPED) for seed in range(2)),
    ]
    random.Random(1).shuffle(records)
    points = ranking(results(records))
    assert [point.values["ppo.gamma"] for point in points] == [0.99, 0.95, 0.9, 1.0]
    best = points[0].as_json(1)
    assert (best["rank"], best["score"], best["failed"], best["seeds"]) == (1, 50.0, 1, 2)
    assert best["low"] == best["worst"] == -math.inf
    assert points[1].as_json(2)["score"] == 5.0
    assert points[1].as_json(2)["scores"] == {"0": 5.0, "1": 4.0, "2": 6.0}
    # Two that did not end tell nothing, whatever they had reached
    assert points[3].interval is None
    assert math.isnan(points[3].as_json(None)["score"])


def test_most_runs_failed_comes_last_of_those_that_ended(tmp_path):
    records = [
        record(tmp_path, 0.9, 0, [100.0]),
        *(record(tmp_path, 0.9, seed, [], RunState.FAILED) for seed in (1, 2)),
        *(record(tmp_path, 0.8, seed, [-5.0]) for seed in range(3)),
    ]
    assert [point.values["ppo.gamma"] for point in ranking(results(records))] == [0.8, 0.9]


def test_equal_medians_are_ordered_by_the_worst_seed(tmp_path):
    records = [record(tmp_path, 0.8, seed, [score]) for seed, score in enumerate((0.0, 2.0, 3.0))]
    records += [record(tmp_path, 0.9, seed, [score]) for seed, score in enumerate((1.0, 2.0, 3.0))]
    assert [point.values["ppo.gamma"] for point in ranking(results(records))] == [0.9, 0.8]


def test_a_score_is_the_mean_of_the_last_tenth(tmp_path):
    found = result_of(record(tmp_path, 0.9, 0, [0.0] * 18 + [3.0, 5.0]), "mean_reward", ())
    assert found.score == 4.0
    assert found.steps[-1] == 2000.0
    assert found.train_s == pytest.approx(20 * 100 / 50.0)
    early = result_of(record(tmp_path, 0.9, 1, ["nan", 2.0]), "mean_reward", ())
    assert early.score == 2.0


def test_success_is_counted_from_the_ends_of_episodes(tmp_path):
    found = result_of(record(tmp_path, 0.9, 0, [1.0]), "success", {"time_limit"})
    assert found.score == pytest.approx(0.75)
    assert math.isnan(series([{"episodes": "0"}], "success", {"goal"})[0])
    # Tasks that measure it otherwise have no such ends: the column tells, and without it nothing does
    assert series([{"episodes": "4", "success": "0.25"}], "success", ()) == [0.25]
    assert math.isnan(series([{"episodes": "4", "end/time_limit": "4"}], "success", ())[0])
    with pytest.raises(InputError, match=r"--rank-by: progress.csv has no column 'rewrad', but iteration, env_steps"):
        result_of(record(tmp_path, 0.9, 1, [1.0]), "rewrad", ())


def test_progress_tells_iteration_reward_and_time_left(tmp_path):
    found = record(tmp_path, 0.9, 0, [1.0, 2.0])
    found.run = SweepRun(
        "", {}, replace_fields(found.run.config, {"iterations": 12}), FAST.config_type(), found.run.folder
    )
    found._size = -1
    found.look()
    assert (found.iteration, found.reward) == (2, 2.0)
    assert found.seconds_left == pytest.approx(10 * 100 / 50.0)


def test_pictures_are_drawn_of_anything(tmp_path):
    records = [record(tmp_path, 0.9, seed, [1.0, 2.0 + seed]) for seed in range(3)]
    records += [record(tmp_path, 0.99, 0, [], RunState.FAILED), record(tmp_path, 0.8, 0, ["nan"], RunState.STOPPED)]
    records += [record(tmp_path, 0.01 * gamma, 0, [gamma]) for gamma in range(30)]
    points = ranking(results(records))
    draw_curves(tmp_path / "curves.png", "many", "mean_reward", points)
    draw_search(tmp_path / "search.png", "many", "mean_reward", points)
    draw_curves(tmp_path / "none.png", "none", "mean_reward", points[-1:])
    for name in ("curves.png", "search.png", "none.png"):
        assert (tmp_path / name).stat().st_size > 3000
