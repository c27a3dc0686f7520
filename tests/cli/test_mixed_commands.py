"""Commands on a task over several models."""

import json

import pytest

FEW = ["--checkpoint", "zero", "--task.obs", "state", "--task.max-episode-steps", "2", "--task.guard-steps", "0"]
THREE = ["--task.vehicle", "hmmwv,gator,sedan"]


@pytest.mark.slow
def test_eval_tells_of_each_model(command):
    words = [*FEW, *THREE, "--episodes", "7", "--no-baselines"]
    code, out, err = command("eval", "obstacle-avoidance", *words, "--json", "-")
    assert code == 0
    found = json.loads(out)
    assert {name: each["episodes"] for name, each in found["models"].items()} == {"hmmwv": 3, "gator": 2, "sedan": 2}
    assert found["episodes"] == 7
    assert found["task_config"]["vehicle"] == "hmmwv,gator,sedan"
    rows = [line.split()[0] for line in err.splitlines() if line.strip()]
    start = rows.index("policy")
    assert rows[start : start + 4] == ["policy", "hmmwv", "gator", "sedan"]


@pytest.mark.slow
def test_play_shows_a_world_of_each(command, tmp_path):
    target = tmp_path / "three.png"
    code, _, err = command(
        "play", "obstacle-avoidance", *FEW, *THREE, "--seconds", "0.2", "--size", "64", "48", "--video", str(target)
    )
    assert (code, err) == (0, "")
    assert target.stat().st_size > 1000


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--task.vehicle", "tank"], "vehicle must be different ones of hmmwv, gator, sedan"),
        (["--task.mix", "vehicle"], "mix must be a field and at least two different values"),
        (["--task.mix", "size=1,2"], "has no field 'size'"),
        ([*THREE, "--task.mix-shares", "1", "2"], "mix-shares must be 3 numbers, one for each of hmmwv, gator, sedan"),
        ([*THREE, "--episodes", "2"], "3 models (hmmwv, gator, sedan) need a world each, got 2"),
    ],
)
def test_what_cannot_be_mixed_is_one_line(command, words, text):
    code, out, err = command("eval", "obstacle-avoidance", "--checkpoint", "zero", "--task.obs", "state", *words)
    assert code == 2
    assert out == ""
    assert text in err
    assert err.count("\n") == 1
