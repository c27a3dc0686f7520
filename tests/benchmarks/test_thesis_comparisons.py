"""The script of the thesis's comparisons, with budgets in which nothing is learnt."""

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from simwarp.tasks import replace_fields
from simwarp.train.runs.progress_table import read_progress

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "thesis_comparisons.py"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("thesis_comparisons", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


def command(folder, *arguments):
    fixed = ["--num-envs", "8", "--episodes", "4", "--out", str(folder / "out"), "--runs", str(folder / "runs")]
    return [sys.executable, str(SCRIPT), *fixed, "--picture", str(folder / "curves.png"), *arguments]


def run(folder, *arguments):
    return subprocess.run(command(folder, *arguments), cwd=folder, capture_output=True, text=True, timeout=300)


@pytest.mark.slow
def test_runs_are_done_once_and_reported_with_intervals(tmp_path):
    small = ["--seeds", "2", "--iterations", "2", "--configurations", "baseline,quaternion"]
    done = run(tmp_path, *small, "--plot")
    assert done.returncode == 0, done.stderr
    files = sorted((tmp_path / "out").glob("*-?.json"))
    assert [path.stem for path in files] == ["baseline-0", "baseline-1", "quaternion-0", "quaternion-1"]
    result = json.loads(files[2].read_text(encoding="utf-8"))
    assert result["task_config"]["orientation"] == "quaternion"
    assert result["train_config"]["num_envs"] == 8
    assert result["curve"]["env_steps"] == [256.0, 512.0]
    assert {"cpu", "versions"} <= set(result["machine"])
    assert result["command"].startswith("python benchmarks/thesis_comparisons.py")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert set(summary["means"]) == {"baseline", "quaternion"}
    assert summary["differences"]["quaternion"]["area"]["half"] > 0.0
    assert "| quaternion | " in done.stdout
    assert (tmp_path / "curves.png").stat().st_size > 5000
    times = [path.stat().st_mtime_ns for path in files]
    again = run(tmp_path, *small)
    assert again.returncode == 0, again.stderr
    assert again.stdout.splitlines()[:4] == done.stdout.splitlines()[:4]
    assert [path.stat().st_mtime_ns for path in files] == times
    other = run(tmp_path, *small[:2], "--iterations", "3", "--report-only")
    assert other.returncode == 2
    assert "give another --out" in other.stderr


@pytest.mark.slow
def test_an_interrupted_run_goes_on_where_it_was(tmp_path):
    arguments = ["--seeds", "1", "--iterations", "40", "--configurations", "baseline"]
    process = subprocess.Popen(command(tmp_path, *arguments), cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    run_folder = tmp_path / "runs" / "baseline-8x40,seed=0"
    while len(read_progress(run_folder / "progress.csv")) < 1:
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGINT)
    rest = process.stderr.read()
    assert process.wait(timeout=120) == 130, rest
    assert "the same command goes on" in rest
    assert list((tmp_path / "out").glob("*.json")) == []
    assert len(list((tmp_path / "runs").rglob("iteration_*.pt"))) == 1
    done = run(tmp_path, *arguments)
    assert done.returncode == 0, done.stderr
    assert (run_folder / "train.log").read_text().count("iteration 1/40") == 1  # the first ones were not done again
    result = json.loads((tmp_path / "out" / "baseline-0.json").read_text(encoding="utf-8"))
    assert len(result["curve"]["env_steps"]) == 40


def test_the_configurations_differ_in_one_thing_each(script):
    names = list(script.CONFIGURATIONS)
    made = {name: script.STUDY.settings(name, 0) for name in names}
    train, task = made["baseline"]
    assert made["unscaled"] == (replace_fields(train, {"network.normalise": False}), task)
    assert made["kl-penalty"][0].ppo.objective.value == "kl-penalty"
    assert made["kl-penalty"][1] == made["unscaled"][1] == task
    assert made["quaternion"][0] == train
    assert train.network.normalise
    assert not task.scaled
