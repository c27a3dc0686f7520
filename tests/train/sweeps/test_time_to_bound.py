"""Time to a bound: when a run is there, how points are ordered by it, which runs are left."""

import math

import numpy as np
import pytest

from simwarp.tasks import InputError, replace_fields, task_class
from simwarp.train.config import default_config
from simwarp.train.runs.run_folder import RunFolder
from simwarp.train.sweeps.leaving import LeaveRule
from simwarp.train.sweeps.plan import SweepRun
from simwarp.train.sweeps.ranking import ranking, result_of
from simwarp.train.sweeps.run_state import RunRecord, RunState
from simwarp.train.sweeps.sweep_times import draw_times
from simwarp.train.sweeps.time_to_bound import (
    FARTHEST,
    WINDOW,
    iteration_seconds,
    parse_bound,
    score_text,
    seconds_of,
    time_to_bound,
)

FAST = task_class("fast")
REWARD_5 = (parse_bound("mean_reward>=5"),)


def rows(rewards, *, seconds=2.0, lengths=None):
    """Iterations of 100 steps that take so long."""
    lengths = lengths or [10.0] * len(rewards)
    return [
        {"iteration": f"{k + 1}", "env_steps": f"{100 * (k + 1)}", "mean_reward": f"{reward}",
         "mean_episode_length": f"{length}", "env_steps_per_s": f"{100 / seconds}"}
        for k, (reward, length) in enumerate(zip(rewards, lengths, strict=True))
    ]  # fmt: skip


def record(folder, gamma, seed, rewards, state=RunState.DONE, seconds=2.0):
    config = replace_fields(default_config(FAST), {"iterations": max(1, len(rewards)), "seed": seed})
    path = folder / f"{gamma}-{seed}"
    path.mkdir(exist_ok=True)
    table = rows(rewards, seconds=seconds)
    names = list(rows([0.0])[0])
    lines = [",".join(names), *(",".join(row[name] for name in names) for row in table)]
    (path / "progress.csv").write_text("\n".join([*lines, ""]))
    found = RunRecord(SweepRun(f"g={gamma}", {"g": gamma}, config, FAST.config_type(), RunFolder(path)), state)
    found.look()
    return found


@pytest.mark.parametrize(
    ("text", "bound"),
    [
        ("success>=0.9", ("success", 0.9, True)),
        (" loss/value <= 1e-3 ", ("loss/value", 1e-3, False)),
        ("mean_reward>=-5", ("mean_reward", -5.0, True)),
    ],
)
def test_bounds_are_read(text, bound):
    found = parse_bound(text)
    assert (found.column, found.value, found.at_least) == bound


@pytest.mark.parametrize("text", ["success", "success>0.9", "success>=x", "success>=nan", ">=0.9", "success>=inf"])
def test_what_is_no_bound_is_refused(text):
    with pytest.raises(InputError, match=r"^--until must be COLUMN>=NUMBER or COLUMN<=NUMBER, as success>=0.9, got"):
        parse_bound(text)


def test_a_column_that_no_task_has_is_refused():
    with pytest.raises(InputError, match=r"^--until must be one of iteration, .*, got 'sucess'$"):
        parse_bound("sucess>=0.9")


def test_the_time_is_that_of_the_iterations_until_the_mean_of_five_is_there():
    # one lucky iteration, then 5 for good from the eighth on: the mean of five is 5 at the twelfth
    found = time_to_bound(rows([0.0, 9.0, *[0.0] * 5, *[5.0] * 8]), REWARD_5, ())
    assert found.seconds == 12 * 2.0
    assert found.distance == 0.0
    assert found.score == -24.0
    # pauses between iterations are in none of their rates
    late = rows([5.0] * 5)
    late[3]["wall_s"] = "1000"
    assert time_to_bound(late, REWARD_5, ()).seconds == 10.0
    assert iteration_seconds([{"env_steps": "100", "env_steps_per_s": ""}]) == [0.0]


def test_all_bounds_have_to_be_reached_at_once():
    bounds = (*REWARD_5, parse_bound("mean_episode_length<=7"))
    rewards = [5.0] * 6 + [0.0] * 14
    apart = rows(rewards, lengths=[10.0] * 10 + [5.0] * 10)
    assert math.isnan(time_to_bound(apart, bounds, ()).seconds)
    together = rows([*rewards, *[6.0] * WINDOW], lengths=[10.0] * 10 + [5.0] * 15)
    assert time_to_bound(together, bounds, ()).seconds == 25 * 2.0


def test_the_distance_is_the_least_sum_of_shares():
    bounds = (*REWARD_5, parse_bound("mean_episode_length<=8"))
    # nearest at the beginning: 1 of 5 and 2 of 8
    found = time_to_bound(rows([4.0] * 5 + [0.0] * 9), bounds, ())
    assert found.distance == pytest.approx(1 / 5 + 2 / 8)
    assert time_to_bound(rows([5.0] * 4), REWARD_5, ()).distance == FARTHEST
    assert time_to_bound(rows(["nan"] * 9), REWARD_5, ()).distance == FARTHEST
    # of 0 there is no share
    assert time_to_bound(rows([-2.0] * 9), (parse_bound("mean_reward>=0"),), ()).distance == 2.0
    # values that are not known yet do not count
    assert time_to_bound(rows(["nan", "nan", 5.0, 5.0, 5.0]), REWARD_5, ()).seconds == 10.0


def test_success_is_read_from_ends_where_there_is_no_column():
    ended = [row | {"episodes": "4", "end/time_limit": "3"} for row in rows([0.0] * 6)]
    assert time_to_bound(ended, (parse_bound("success>=0.75"),), {"time_limit"}).seconds == 10.0


def results(records):
    return [result_of(each, "mean_reward", (), REWARD_5) for each in records]


def test_points_are_ordered_by_time_then_by_distance_and_failures_come_last(tmp_path):
    slow, quick, near, far = [0.0] * 5 + [5.0] * 5, [5.0] * 6, [4.0] * 9, [1.0] * 9
    records = [
        *(record(tmp_path, 0.1, seed, far) for seed in range(3)),
        *(record(tmp_path, 0.2, seed, slow) for seed in range(3)),
        *(record(tmp_path, 0.3, seed, near) for seed in range(3)),
        # one that never comes there does not decide a median of three
        *(record(tmp_path, 0.4, seed, rewards) for seed, rewards in enumerate((quick, far, quick))),
        # a rate half as high takes twice as long for the same iterations
        *(record(tmp_path, 0.5, seed, quick, seconds=3.9) for seed in range(3)),
        *(record(tmp_path, 0.6, seed, [], RunState.FAILED) for seed in range(3)),
        *(record(tmp_path, 0.7, seed, quick, RunState.STOPPED) for seed in range(3)),
    ]
    points = ranking(results(records))
    assert [point.values["g"] for point in points] == [0.4, 0.5, 0.2, 0.3, 0.1, 0.6, 0.7]
    assert [point.reached for point in points] == [2, 3, 3, 0, 0, 0, 0]
    best = points[0].as_json(1)
    assert (best["score"], best["time_to_bound_s"], best["reached"]) == (-10.0, 10.0, 2)
    assert math.isnan(best["worst"])
    assert best["best"] == -10.0
    assert math.isnan(points[3].as_json(4)["time_to_bound_s"])
    assert points[3].results[0].as_json()["distance"] == pytest.approx(0.2)
    texts = [score_text(point.interval.median) for point in points if point.interval is not None]
    assert texts == ["10", "19.5", "20", "20 % off", "80 % off", "-"]
    draw_times(tmp_path / "times.png", "many", REWARD_5, points)
    draw_times(tmp_path / "none.png", "none", REWARD_5, points[-1:])
    assert (tmp_path / "times.png").stat().st_size > (tmp_path / "none.png").stat().st_size > 3000


def test_half_of_two_seeds_is_no_time(tmp_path):
    records = [record(tmp_path, 0.1, seed, rewards) for seed, rewards in enumerate(([5.0] * 6, [4.0] * 6))]
    (point,) = ranking(results(records))
    assert point.interval is not None
    assert math.isnan(seconds_of(point.interval.median))
    assert score_text(point.interval.median) == "not reached"
    assert score_text(point.interval.high) == "10"


def test_a_run_is_left_when_it_is_there(tmp_path):
    rule = LeaveRule(REWARD_5, (), 2.0, 1)
    under_way = record(tmp_path, 0.1, 0, [5.0] * 4, RunState.RUNNING)
    assert rule.reason(under_way) == ""
    there = record(tmp_path, 0.1, 0, [5.0] * 5, RunState.RUNNING)
    assert rule.reason(there) == "reached after 10 s"
    assert LeaveRule((), (), 2.0, 1).reason(there) == ""


def test_a_run_is_left_that_is_slower_than_the_best_point_whose_seeds_have_all_ended(tmp_path):
    rule = LeaveRule(REWARD_5, (), 1.5, 3)
    quick = [record(tmp_path, 0.1, seed, [5.0] * 5) for seed in range(3)]
    slow = record(tmp_path, 0.2, 0, [0.0] * 8, RunState.RUNNING)
    for each in quick[:2]:
        rule.settled(each, result_of(each, "mean_reward", (), REWARD_5).score)
        assert rule.reason(slow) == ""
    rule.settled(quick[2], -math.inf)  # the median of three is that of the two that are there
    assert rule.reason(slow) == "left after 16 s, the best point took 10 s"
    # 15 s are 1.5 times 10 s: not yet more
    assert rule.reason(record(tmp_path, 0.2, 1, [0.0] * 6, RunState.RUNNING, seconds=2.5)) == ""
    # a point that is slower itself changes nothing
    for seed in range(3):
        rule.settled(record(tmp_path, 0.3, seed, [0.0] * 50 + [5.0] * 5), -110.0)
    assert rule.reason(record(tmp_path, 0.2, 2, [0.0] * 8, RunState.RUNNING)).startswith("left after 16 s")
    patient = LeaveRule(REWARD_5, (), math.inf, 1)
    patient.settled(quick[0], -10.0)
    assert patient.reason(record(tmp_path, 0.4, 0, [0.0] * 900, RunState.RUNNING)) == ""


@pytest.mark.parametrize(("seeds", "patience"), [(3, 1.0), (2, 2.0)])
def test_what_a_winner_is_does_not_depend_on_runs_that_are_left(tmp_path, seeds, patience):
    """Random times of five points, runs left as soon as the rule says so."""
    chance = np.random.default_rng(3)
    for trial in range(30):
        times = chance.integers(WINDOW, 40, size=(5, seeds))
        medians = np.median(times, axis=1)
        if np.count_nonzero(medians == medians.min()) > 1:
            continue
        folder = tmp_path / str(trial)
        folder.mkdir()
        rule, found = LeaveRule(REWARD_5, (), patience, seeds), []
        for point, seed in ((p, s) for p in chance.permutation(5) for s in range(seeds)):
            count = int(times[point, seed])
            rewards = [0.0] * (count - WINDOW) + [5.0] * WINDOW
            for done in range(1, count + 1):
                under_way = record(folder, int(point), seed, rewards[:done], RunState.RUNNING)
                if rule.reason(under_way):
                    break
            under_way.state = RunState.DONE
            result = result_of(under_way, "mean_reward", (), REWARD_5)
            rule.settled(under_way, result.score)
            found.append(result)
        assert ranking(found)[0].values["g"] == int(np.argmin(medians))
