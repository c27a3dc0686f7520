"""The shipped policies that walk: where they come from is written down, and they still follow commands."""

import json

import pytest

from simwarp.tasks import config_to_plain, make, replace_fields, task_class
from simwarp.tasks.framework.registry import config_to_train_in
from simwarp.train.config import task_config_from_plain
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.policies import SHIPPED, find_policy, network_policy
from simwarp.train.runs.checkpoint import load_checkpoint

GROUNDS = {"state": "flat", "scan": "rough"}
TITLES = [f"quadruped-velocity.{obs}" for obs in GROUNDS]


@pytest.mark.parametrize("title", TITLES)
def test_provenance_says_how_to_make_it_again_and_what_it_reached(title):
    record = json.loads((SHIPPED / f"{title}.json").read_text(encoding="utf-8"))
    name, obs = title.split(".")
    assert record["command"][:3] == ["simwarp", "train", name]
    assert len(record["git"]["revision"]) == 40
    assert {"python", "torch", "warp-lang", "rsl-rl-lib"} <= set(record["versions"])
    saved = load_checkpoint(SHIPPED / f"{title}.pt")["task_config"]
    config = config_to_plain(task_config_from_plain(task_class(name), saved))
    # The one with a scan was trained before robots had the clock of a gait
    begun = config_to_train_in(task_class(name)) if obs == "state" else task_class(name).config_type()
    today = replace_fields(begun, {"obs": obs, "ground": GROUNDS[obs]})
    assert config == config_to_plain(today)
    # Who stands never falls: what tells a policy from it is the errors, at least three times as large
    reached, standing = (record["evaluation"][which] for which in ("policy", "zero"))
    assert reached["episodes"] >= 256
    assert reached["success_rate"] >= 0.95
    for error in ("speed_error", "turn_error"):
        assert 3.0 * reached[error] <= standing[error]


@pytest.mark.slow
@pytest.mark.parametrize("title", TITLES)
def test_it_still_walks(title):
    name = title.split(".")[0]
    content = find_policy(name, SHIPPED / f"{title}.pt").content
    task = make(name, 32, seed=77, config=task_config_from_plain(task_class(name), content["task_config"]))
    result = evaluate(task, network_policy(content, task), 32, seed=77)
    # 28 of 32 or fewer happen to a policy of 97 % once in 60 draws; the draw is always the same one
    assert result.success_rate * 32 >= 28
    # The bounds on a plane, which rough ground keeps as well
    assert result.metrics["speed_error"] <= 0.25
    assert result.metrics["turn_error"] <= 0.2
