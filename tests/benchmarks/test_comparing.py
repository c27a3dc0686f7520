"""What the scripts share that compare ways to train, on a task without physics."""

import argparse
import dataclasses
import json

import numpy as np
import pytest
from rich.console import Console

from benchmarks import comparing
from benchmarks.comparing import Arm, Budget, Quantity, Study
from simwarp.tasks import InputError
from simwarp.train.algorithm.learner import TrainingError
from simwarp.train.runs.run_lock import writing

QUIET = Console(quiet=True)
QUANTITIES = {"final_return": comparing.RETURN, "area": comparing.AREA}


def study(folder, **changes):
    plain = Study(
        task="fast",
        arms={"few": Arm("few"), "many": Arm("many", "few", train={"ppo.mini_batches": 8}, task={"gain": 0.2})},
        budget=Budget(4, 8, 6, 2),
        quantities=QUANTITIES,
        title="few or many",
        out=folder / "out",
        runs=folder / "runs",
        seeds=2,
        config={"max_episode_steps": 20},
        evaluation={"start_radius": 0.5},
    )
    return dataclasses.replace(plain, **changes)


@pytest.mark.slow
def test_arms_train_with_their_own_settings_and_are_evaluated_with_the_same(tmp_path):
    asked = study(tmp_path)
    comparing.run_missing(asked, QUIET)
    assert asked.missing() == []
    results = comparing.load(asked)
    assert [run["seed"] for run in results["many"]] == [0, 1]
    result = results["many"][1]
    assert result["train_config"]["ppo"]["mini_batches"] == 8
    assert result["train_config"]["seed"] == 1
    assert (result["task_config"]["gain"], result["task_config"]["start_radius"]) == (0.2, 1.0)
    assert (result["evaluation_config"]["gain"], result["evaluation_config"]["start_radius"]) == (0.2, 0.5)
    assert result["evaluation_config"]["max_episode_steps"] == 20
    assert result["evaluation"]["episodes"] == 6
    # 8 worlds, 16 steps: the policies after two and after four iterations
    evaluations = result["evaluations"]
    assert evaluations["env_steps"] == [256.0, 512.0]
    assert evaluations["mean_reward"][-1] == pytest.approx(result["final_return"], abs=1e-4)
    assert result["area"] == pytest.approx(np.mean(evaluations["mean_reward"]), abs=1e-4)
    assert len(result["curve"]["env_steps"]) == 4
    summary = comparing.write_summary(asked, results)
    assert json.loads((asked.out / "summary.json").read_text(encoding="utf-8")) == summary
    assert set(summary["differences"]) == {"many"}
    assert "| many | " in comparing.table(summary["differences"], "paired", QUANTITIES)


@pytest.mark.slow
def test_a_run_goes_on_from_its_last_checkpoint(tmp_path, monkeypatch):
    asked = study(tmp_path, seeds=1, arms={"few": Arm("few")})

    def killed(*arguments):
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(comparing, "assess", killed)
        with pytest.raises(MemoryError):
            comparing.run_missing(asked, QUIET)
    assert asked.missing() == [("few", 0)]
    run = asked.runs / "few-8x4,seed=0"
    (run / "checkpoints" / "iteration_000004.pt").unlink()
    comparing.run_missing(asked, QUIET)
    assert asked.missing() == []
    assert list(run.parent.iterdir()) == [run]
    assert comparing.load(asked)["few"][0]["curve"]["env_steps"] == [128.0, 256.0, 384.0, 512.0]


@pytest.mark.slow
def test_a_failed_run_is_named_and_the_others_have_their_results(tmp_path):
    asked = study(tmp_path, seeds=1, arms={"good": Arm("good"), "bad": Arm("bad")}, jobs=2)
    bad = comparing.sweep_run(asked, "bad", 0)
    bad.prepare(asked.task)
    damaged = bad.folder.checkpoint_path(2)
    damaged.parent.mkdir(exist_ok=True)
    damaged.write_bytes(b"no checkpoint")
    with pytest.raises(TrainingError, match=r"1 runs failed: bad-8x4,seed=0: .*iteration_000002\.pt"):
        comparing.run_missing(asked, QUIET)
    assert asked.missing() == [("bad", 0)]
    assert [result["configuration"] for result in comparing.load(asked)["good"]] == ["good"]


def test_two_commands_do_not_train_one_study(tmp_path):
    asked = study(tmp_path)
    asked.runs.mkdir()
    with writing(asked.runs), pytest.raises(InputError, match="is being written"):
        comparing.run_missing(asked, QUIET)
    assert not list(asked.runs.glob("*,seed=*"))


def test_a_field_may_follow_from_the_budget(tmp_path):
    arms = {"short": Arm("short", task={"max_episode_steps": lambda budget: 5 * budget.iterations})}
    asked = study(tmp_path, arms=arms)
    options = argparse.Namespace(
        out=tmp_path, runs=tmp_path, seeds=3, device="cpu", jobs=2, iterations=6, evaluations=3
    )
    longer = asked.asked(options, "name")
    assert (asked.settings("short", 0)[1].max_episode_steps, longer.settings("short", 0)[1].max_episode_steps) == (
        20,
        30,
    )
    assert longer.budget == Budget(6, 8, 6, 3)
    assert (longer.out, longer.seeds, longer.jobs) == (tmp_path / "name", 3, 2)
    # A study without evaluations on the way gets none by an option that is meant for others
    assert dataclasses.replace(asked, budget=Budget(4, 8, 6)).asked(options).budget == Budget(6, 8, 6)


@pytest.mark.slow
def test_results_of_another_budget_are_refused(tmp_path):
    asked = study(tmp_path, seeds=1, arms={"few": Arm("few")}, budget=Budget(1, 8, 2))
    comparing.run_missing(asked, QUIET)
    result = comparing.load(asked)["few"][0]
    assert result["budget"] == {"iterations": 1, "num_envs": 8, "episodes": 2}
    assert "evaluations" not in result
    assert result["area"] == pytest.approx(result["curve"]["mean_reward"][0])
    with pytest.raises(InputError, match="give another --out"):
        comparing.load(dataclasses.replace(asked, budget=Budget(1, 8, 3)))


def test_runs_are_done_seed_by_seed(tmp_path):
    asked = study(tmp_path)
    assert asked.missing() == [("few", 0), ("many", 0), ("few", 1), ("many", 1)]


def test_intervals_are_students():
    found = comparing.interval([1.0, 2.0, 3.0, 4.0, 5.0])
    assert found.mean == 3.0
    assert found.half == pytest.approx(2.776 * np.sqrt(2.5 / 5.0), rel=1e-3)
    assert np.isnan(comparing.interval([1.0]).half)


def test_differences_are_paired_by_seed():
    def result(seed, value):
        return {"seed": seed, "wall_s": 1.0, "area": value}

    # Seeds differ a lot, pairs hardly: only pairing sees the difference
    first = [result(seed, 100.0 * seed) for seed in range(4)]
    other = [result(seed, 100.0 * seed + 5.0 + 0.1 * seed) for seed in (3, 0, 1, 2)]
    arms = {"first": Arm("first"), "other": Arm("other", "first")}
    summary = comparing.summarise({"first": first, "other": other}, arms, {"area": Quantity("area", "", 0)})
    difference = summary["differences"]["other"]["area"]
    assert difference["mean"] == pytest.approx(5.15)
    assert difference["half"] < 0.3
    assert summary["means"]["other"]["area"]["half"] > 100.0
    alone = comparing.summarise({"other": other}, arms, {"area": Quantity("area", "", 0)})
    assert alone["differences"] == {}


def test_the_area_is_the_mean_over_steps():
    assert comparing.area({"env_steps": [0.0, 1.0, 4.0], "mean_reward": [0.0, 2.0, 2.0]}) == pytest.approx(7.0 / 4.0)
