"""What the seed decides: which results are known, and which are evaluated."""

import json

import pytest
from rich.console import Console

from benchmarks import seeds
from simwarp.tasks import replace_fields, task_class
from simwarp.train.config import default_config
from simwarp.train.runs.training import train

FAST = task_class("fast")


@pytest.fixture(scope="module")
def sweeps(tmp_path_factory):
    """Two sweeps of one seed, of a training that learns and one that does not."""
    root = tmp_path_factory.mktemp("sweeps")
    for name, rate in (("one", 1e-3), ("other", 1e-9)):
        changes = {"device": "cpu", "iterations": 1, "num_envs": 4, "seed": 3, "ppo.learning_rate": rate}
        config = replace_fields(default_config(FAST), changes)
        train("fast", config, FAST.config_type(), root=root / name, console=Console(quiet=True))
    return root


def evaluated(monkeypatch, *folders):
    monkeypatch.setattr("sys.argv", ["seeds", *map(str, folders), "--episodes", "4"])
    return seeds.main()


def test_a_policy_is_evaluated_once_and_another_one_anew(sweeps, tmp_path, monkeypatch):
    monkeypatch.setattr(seeds, "RESULTS", tmp_path)
    calls = []
    evaluate = seeds.evaluate

    def counted(*arguments):
        calls.append(arguments)
        return evaluate(*arguments)

    monkeypatch.setattr(seeds, "evaluate", counted)
    one, other = (next((sweeps / name).glob("*")) for name in ("one", "other"))
    for folder, count in ((one, 1), (one, 1), (other, 2), (other, 2)):
        evaluated(monkeypatch, folder)
        assert len(calls) == count
    content = json.loads((tmp_path / "fast.state.json").read_text())["3"]
    assert content["episodes"] == 4
    assert content["policy"]


def test_two_runs_of_one_seed_are_refused(sweeps, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(seeds, "RESULTS", tmp_path)
    with pytest.raises(SystemExit):
        evaluated(monkeypatch, *(next((sweeps / name).glob("*")) for name in ("one", "other")))
    assert "are both fast.state of seed 3: give the sweep of one setting" in capsys.readouterr().err
