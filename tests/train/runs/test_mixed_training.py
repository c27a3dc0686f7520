"""A run over several models: recorded, resumed, evaluated and exported as any other, and model by model."""

import dataclasses

import pytest
import torch
from rich.console import Console

from simwarp.cli.view.shown_model import shown_config
from simwarp.tasks import InputError, make, replace_fields
from simwarp.tasks.framework import registry
from simwarp.train.config import default_config
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.export import ExportFormat, export_model, export_policy
from simwarp.train.networks.policies import network_policy, random_policy
from simwarp.train.runs.progress_table import read_progress
from simwarp.train.runs.run_folder import open_run
from simwarp.train.runs.training import train
from tests.tasks.framework.chain_task import ChainConfig, ChainTask
from tests.tasks.framework.test_task_threads import bits, different

MIX = ChainConfig(mix="links=1,2", mix_shares=(3.0, 1.0))
SMALL = {"num_envs": 8, "steps_per_iteration": 6, "device": "cpu", "save_interval": 1, "logger": "csv"}


@pytest.fixture(autouse=True)
def chain():
    registry.register("chain")(ChainTask)
    yield
    registry._tasks.pop("chain", None)


def run(root, iterations, resume=None, config=MIX):
    settings = replace_fields(default_config(ChainTask), {**SMALL, "iterations": iterations})
    result = train("chain", settings, config, root=root, resume=resume, console=Console(quiet=True))
    return open_run(root / "chain" / result.run.rpartition("/")[2])


def test_a_resumed_run_equals_one_that_was_not_interrupted(tmp_path):
    whole = run(tmp_path / "whole", 4)
    parts = run(tmp_path / "parts", 2)
    run(tmp_path / "parts", 4, resume=parts.path)
    (_, first), (_, second) = whole.load_latest(), parts.load_latest()
    assert different(bits(first["worlds"]), bits(second["worlds"])) == []
    assert different(bits(first["actor_state_dict"]), bits(second["actor_state_dict"])) == []
    assert first["task_config"]["mix"] == "links=1,2"


def test_what_is_recorded_by_model_adds_up(tmp_path):
    rows = read_progress(run(tmp_path, 3).progress)
    for row in rows:
        for name in ("episodes", "end/turned", "end/time_limit"):
            assert float(row[name]) == float(row[f"model/1/{name}"]) + float(row[f"model/2/{name}"])
        assert row["model/1/return"]
        assert row["model/2/success"]
        assert row["model/2/reward/rate"]


def test_a_run_goes_on_with_the_same_models_alone(tmp_path):
    folder = run(tmp_path, 1)
    with pytest.raises(InputError, match=r"--task.mix was 'links=1,2', is 'links=1,3'"):
        run(tmp_path, 2, resume=folder.path, config=dataclasses.replace(MIX, mix="links=1,3"))


def test_an_evaluation_tells_of_each_model():
    task = make("chain", 6, config=MIX, seed=1)
    found = evaluate(task, random_policy(task), 12, seed=2)
    assert [*found.by_model] == ["1", "2"]
    assert [each.episodes for each in found.by_model.values()] == [2 * group.count for group in task.model_groups]
    weighted = sum(each.mean_return * each.episodes for each in found.by_model.values()) / found.episodes
    assert found.mean_return == pytest.approx(weighted, rel=1e-12)
    plain = found.as_json()
    assert plain["models"]["2"]["episodes"] == found.by_model["2"].episodes
    assert "by_model" not in plain
    assert "reach" in plain["models"]["1"]
    for group in task.model_groups:
        single = make("chain", group.count, links=int(group.name), first_world=group.rows.start)
        alone = evaluate(single, random_policy(single), 2 * group.count, seed=2)
        assert alone == found.by_model[group.name]


def test_a_task_of_one_model_has_no_word_of_models():
    task = make("chain", 4, seed=1)
    assert "models" not in evaluate(task, random_policy(task), 4, seed=2).as_json()


def test_one_policy_of_all_models_is_exported(tmp_path):
    folder = run(tmp_path, 1)
    done = export_policy(folder.path, ExportFormat.TORCHSCRIPT, tmp_path / "chain.ts")
    assert done.max_difference < 1e-5
    with pytest.raises(InputError, match="writes one model, and the policy drives several: 1, 2; leave it away"):
        export_model(folder.path, tmp_path / "chain.xml")


def test_a_policy_of_several_models_acts_in_one(tmp_path):
    content = run(tmp_path, 1).load_latest()[1]
    whole, single = make("chain", 4, config=MIX), make("chain", 1, links=2, first_world=3)
    seen = whole.restart(0)["policy"]
    assert torch.equal(seen[3:], single.restart(0)["policy"])
    actions = network_policy(content, whole)({"policy": seen})
    # Rows of products of other shapes may be summed in another order
    torch.testing.assert_close(network_policy(content, single)({"policy": seen[3:]}), actions[3:], rtol=1e-5, atol=1e-6)


def test_one_model_is_shown_and_the_others_are_named():
    said: list[str] = []
    assert shown_config(MIX, said.append) == ChainConfig(links=1)
    assert said == ["showing '1', one of 2 models; --task.links 2 shows another"]
    assert shown_config(ChainConfig(links=2), said.append) == ChainConfig(links=2)
    assert len(said) == 1
