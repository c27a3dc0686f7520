"""The study of off-road on soil: what it compares, its committed rows, and that it trains only what they lack."""

import dataclasses
import json
import shutil

import pytest

from benchmarks import soil_training
from benchmarks.comparing import Budget
from benchmarks.soil_training import GROUNDS, STUDY
from simwarp.tasks.driving.driving_config import Observing
from simwarp.tasks.driving.off_road import OffRoadConfig
from simwarp.tasks.driving.soil import SoilKind


def test_arms_differ_in_the_ground_alone():
    (soil, soft), (rigid, hard) = (STUDY.settings(name, 0) for name in ("random", "rigid"))
    assert soil == rigid
    assert isinstance(soft, OffRoadConfig)
    assert isinstance(hard, OffRoadConfig)
    assert (soft.soil, hard.soil) == (SoilKind.RANDOM, SoilKind.NONE)
    assert dataclasses.replace(soft, soil=SoilKind.NONE) == hard
    assert hard.obs is Observing.STATE
    # What `simwarp train off-road --obs state` made the committed rows with
    assert (soil.iterations, soil.num_envs, soil.steps_per_iteration) == (120, 256, 32)


def test_committed_rows_give_the_picture_and_nothing_is_trained(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr(soil_training.comparing, "train", lambda study, missing, *more: asked.append(missing))
    rows = (STUDY.out / "success.json").read_bytes()
    assert soil_training.work([], picture=tmp_path / "soil.png") == 0
    assert (tmp_path / "soil.png").stat().st_size > 5000
    assert (STUDY.out / "success.json").read_bytes() == rows
    numbers = soil_training.read_numbers(STUDY)
    assert all(set(seed["reached"]) == set(GROUNDS) for arm in numbers.values() for seed in arm.values())
    soil_training.work(["--seeds", "2"], picture=tmp_path / "soil.png")
    assert asked == [[], [("random", 1), ("rigid", 1)]]


@pytest.mark.slow
def test_rows_are_made_once_and_outlive_their_runs(monkeypatch, tmp_path):
    monkeypatch.setattr(soil_training, "GROUNDS", ("none",))
    study = dataclasses.replace(STUDY, budget=Budget(1, 4, 2), out=tmp_path / "out", runs=tmp_path / "runs")
    assert soil_training.work([], study, tmp_path / "soil.png") == 0
    rows = (study.out / "success.json").read_bytes()
    numbers = json.loads(rows)
    assert {arm: list(seeds) for arm, seeds in numbers.items()} == {"random": ["0"], "rigid": ["0"]}
    assert numbers["rigid"]["0"]["reached"]["none"]["episodes"] == 2
    assert {path.name for path in study.out.glob("*.csv")} == {"random.0.csv", "rigid.0.csv"}
    run = study.runs / "rigid-4x1,seed=0"
    kept = shutil.copytree(run, tmp_path / "kept")
    shutil.rmtree(study.runs)
    soil_training.work([], study, tmp_path / "soil.png")
    assert (study.out / "success.json").read_bytes() == rows
    assert not study.runs.exists()
    # A run that is handed over takes the place of its seed: the same policy on the same episodes
    soil_training.work(["--rigid", str(kept)], study, tmp_path / "soil.png")
    assert (study.out / "success.json").read_bytes() == rows
