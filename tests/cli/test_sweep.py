"""`simwarp sweep` as a user meets it: real trainings in processes of their own, killed, interrupted, failing."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from simwarp.cli.training_sweep import parse_seeds, read_plan, search_words
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.progress_table import read_progress
from simwarp.train.runs.run_folder import open_run

SMALL = ["--device", "cpu", "--num-envs", "8", "--steps-per-iteration", "4"]


@pytest.fixture
def simwarp(tmp_path, monkeypatch, command):
    """Run a command in an empty folder: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)
    return command


def start(folder, *arguments):
    command = [sys.executable, "-m", "simwarp", "sweep", "fast", *SMALL, *arguments]
    with (folder / "told").open("ab") as told:
        return subprocess.Popen(command, cwd=folder, stdout=told, stderr=subprocess.STDOUT)


def wait_until(condition, folder):
    deadline = time.monotonic() + 240.0
    while not condition():
        assert time.monotonic() < deadline, (folder / "told").read_text()
        time.sleep(0.02)


def iterations(run):
    return len(read_progress(run / "progress.csv"))


def writers(folder):
    """Numbers of the processes that write runs."""
    return [json.loads(path.read_text() or "{}").get("pid") for path in folder.glob("*/writer.json")]


# ---- words -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "seeds"), [("0-4", [0, 1, 2, 3, 4]), ("3", [3]), ("7,0-1", [7, 0, 1]), (" 1 , 2 ", [1, 2])]
)
def test_seeds(text, seeds):
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--seed", "3"], "--seed: a sweep takes several, --seeds 0-4"),
        (["--seeds", "4-1"], "--seeds 4-1: the second number must not be below the first one"),
        (["--seeds", "x"], "--seeds must be whole numbers and ranges such as 0-4 or 0,2,7, got 'x'"),
        (["--seeds", "1,0-3"], "--seeds names a seed twice, got '1,0-3'; give each once"),
        (["--seeds", "0-99999"], "--seeds 0-99999: at most 10000 runs are made; give fewer"),
        (["--grid", "ppo.gama=1,2"], "unknown option --ppo.gama; did you mean --ppo.gamma"),
        (["--grid", "ppo.gamma=0.9,1.5"], "--ppo.gamma must be in (0, 1], got 1.5"),
        (["--grid", "task.gain=0.1,-1"], "--task.gain must be positive, got -1.0"),
        (["--grid", "task.bound=3,0.5"], "--task.bound must be larger than start-radius, got 0.5"),
        (["--grid", "ppo.gamma=0.9,0.90"], "--grid ppo.gamma has the value 0.9 twice: leave one away"),
        (["--grid", "ppo=1"], "--grid ppo: name one of its fields: ppo.objective"),
        (["--grid", "seed=1,2"], "--grid seed: is an option of the sweep itself, --seeds"),
        (["--grid", "threads=1,2"], "--grid threads: is an option of the sweep itself, --threads"),
        (["--grid", "network.hidden=64 64,x"], "--network.hidden must be a whole number, got 'x'"),
        (["--grid", "network.normalise=maybe"], "--grid network.normalise must be true or false, got 'maybe'"),
        (["--search", "ppo.gamma=0.9"], "--search wants KEY=low:high, KEY=low:high:log or KEY=a,b,c"),
        (["--search", "ppo.gamma=0.9:1.5"], "--ppo.gamma must be in (0, 1], got 1.5"),
        (["--search", "ppo.lam=0:1:log"], "--search ppo.lam: the logarithm needs numbers above zero, got 0"),
        (["--search", "ppo.lam=1:0"], "--search ppo.lam: the second number must be above the first one, got 1:0"),
        (["--search", "network.kind=mlp,mpl"], "--network.kind must be one of mlp"),
        (["--search", "ppo.lam=0:1", "--grid", "ppo.gamma=0.9,1"], "--grid and --search: give one of them"),
        (["--jobs", "0"], "--jobs must be at least 1, got 0"),
        (["--until", "success"], "--until must be COLUMN>=NUMBER or COLUMN<=NUMBER, as success>=0.9, got 'success'"),
        (["--until", "sucess>=1"], "--until must be one of iteration, "),
        (["--until", "success>=1", "--rank-by", "success"], "--until and --rank-by: runs are ranked by one of them"),
        (["--until", "success>=1", "--patience", "0.5"], "--patience must be at least 1, got 0.5"),
        (["--slurm", "timeout_min=3"], "--slurm is of jobs of a cluster: give --launcher slurm, too"),
        (["--slurm", "timeout", "--launcher", "slurm"], "--slurm wants KEY=VALUE, got 'timeout'"),
    ],
)
def test_one_line_names_what_is_wrong_before_anything_is_made(simwarp, tmp_path, words, told):
    code, _, err = simwarp("sweep", "fast", *words)
    assert code == 2
    assert err.startswith(f"simwarp: {told}")
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "package", "told"),
    [
        (["--search", "ppo.lam=0:1"], "optuna", "--search needs the package optuna: pip install 'simwarp[sweep]'"),
        (["--launcher", "slurm"], "submitit", "--launcher slurm needs the package submitit: pip install"),
    ],
)
def test_what_is_not_installed_is_named_with_its_extra(simwarp, monkeypatch, words, package, told):
    monkeypatch.setitem(sys.modules, package, None)
    code, _, err = simwarp("sweep", "fast", *words)
    assert (code, err.count("\n")) == (2, 1)
    assert err.startswith(f"simwarp: {told}")


def test_a_grid_is_a_product_and_its_runs_are_those_of_train(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["--seeds", "0-1", "--grid", "ppo.gamma=0.9,0.99", "--grid", "network.hidden=8,16 16", "--threads", "5"]
    plan = read_plan("fast", [*words, "--jobs", "2", "--grid", "task.gain=0.1"])
    runs = plan.grid_runs()
    assert (plan.total, plan.jobs, len(runs)) == (8, 2, 8)
    assert [run.seed for run in runs] == [0] * 4 + [1] * 4
    assert {run.config.threads for run in runs} == {2}
    points = {(run.config.ppo.gamma, run.config.network.hidden) for run in runs}
    assert points == {(0.9, (8,)), (0.9, (16, 16)), (0.99, (8,)), (0.99, (16, 16))}
    assert runs[1].folder.path.name == "ppo.gamma=0.9,network.hidden=16x16,task.gain=0.1,seed=0"
    assert runs[1].values == {"ppo.gamma": 0.9, "network.hidden": [16, 16], "task.gain": 0.1}
    # One more value, seed or job is the same sweep
    more = read_plan("fast", ["--grid", "ppo.gamma=0.5", "--grid", "network.hidden=8", "--grid", "task.gain=1"])
    assert more.folder == plan.folder
    assert more.folder.parts[:2] == ("runs", "sweeps")
    assert read_plan("fast", [*words, "--grid", "task.gain=0.1", "--ppo.lam", "0.5"]).folder != plan.folder


def test_the_defaults_of_a_point_are_those_of_its_observations():
    plan = read_plan("hallway", ["--grid", "task.obs=state,camera"])
    networks = {run.values["task.obs"]: run.config.network.kind.value for run in plan.grid_runs()}
    assert networks == {"state": "mlp", "camera": "early-fusion"}


def test_words_of_a_search():
    assert search_words(["a-b=1:2:log", "c=x, y"]) == {"a_b": [":", "1", "2", "log"], "c": ["x", "y"]}
    plan = read_plan("fast", ["--search", "ppo.epochs=1:4", "--search", "ppo.learning_rate=1e-4:1e-2:log"])
    epochs, rate = plan.space["ppo.epochs"], plan.space["ppo.learning_rate"]
    assert (epochs.low, epochs.high, epochs.log) == (1, 4, False)
    assert isinstance(epochs.low, int)
    assert (rate.low, rate.high, rate.log) == (1e-4, 1e-2, True)
    (run, *_) = plan.trial(7, {"ppo.epochs": 3, "ppo.learning_rate": 1.23456789012e-3})
    assert (run.config.ppo.epochs, run.config.ppo.learning_rate) == (3, 1.23456789012e-3)
    assert run.name == "trial-007,seed=0"


# ---- trainings -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_pendulum_over_seeds_and_values(simwarp, tmp_path):
    # Steps enough that pendulums fall: a run in which no episode ended has no score
    words = ["sweep", "pendulum", *SMALL[:4], "--steps-per-iteration", "32", "--iterations", "3", "--seeds", "0-1"]
    words += ["--grid", "ppo.gamma=0.9,0.99", "--jobs", "2", "--out", "s", "--json", "s.json"]
    code, out, err = simwarp(*words)
    assert (code, err) == (0, "")
    content = json.loads((tmp_path / "s.json").read_text())
    assert {"runs", "ranking", "failed"} <= set(content)
    assert content == json.loads((tmp_path / "s" / "results.json").read_text())
    assert [run["state"] for run in content["runs"]] == ["done"] * 4
    assert content["failed"] == []
    scores = [point["score"] for point in content["ranking"]]
    assert scores == sorted(scores, reverse=True)
    assert [point["rank"] for point in content["ranking"]] == [1, 2]
    for run in content["runs"]:
        folder = open_run(Path(run["run"]))
        saved = folder.load_config()
        assert saved["train_config"]["ppo"]["gamma"] == run["values"]["ppo.gamma"]
        assert saved["train_config"]["seed"] == run["seed"]
        assert (folder.path / "train.log").read_text().count("done after 3 iterations") == 1
        assert load_checkpoint(folder.latest_checkpoint())["iteration"] == 3
        # three iterations: the last one is the last tenth
        assert run["score"] == pytest.approx(float(read_progress(folder.progress)[-1]["mean_reward"]))
    assert (tmp_path / "s" / "curves.png").stat().st_size > 10_000
    assert "ppo.gamma=0.9,seed=1  done  reward" in out
    # Again: nothing is trained, the same comes out
    times = [path.stat().st_mtime_ns for path in sorted((tmp_path / "s").glob("*/progress.csv"))]
    code, out, err = simwarp(*words)
    assert (code, err) == (0, "")
    assert out.count("done before") == 4
    again = json.loads((tmp_path / "s.json").read_text())
    assert again["ranking"] == content["ranking"]
    assert [path.stat().st_mtime_ns for path in sorted((tmp_path / "s").glob("*/progress.csv"))] == times
    # A run is one of `simwarp train`: the others know what to do with it
    code, _, err = simwarp("eval", content["runs"][0]["run"], "--episodes", "2", "--no-baselines")
    assert (code, err) == (0, "")


@pytest.mark.slow
def test_points_are_ranked_by_the_time_to_a_bound(simwarp, tmp_path):
    """A learning rate of nothing never learns to keep a pendulum up for 40 steps; a usual one does at once."""
    words = ["sweep", "pendulum", "--device", "cpu", "--num-envs", "64", "--iterations", "60", "--seeds", "0"]
    words += ["--grid", "ppo.learning_rate=1e-9,3e-3", "--ppo.schedule", "fixed", "--out", "s", "--json", "s.json"]
    words += ["--until", "mean_episode_length>=60"]
    code, out, err = simwarp(*words)
    assert (code, err) == (0, "")
    content = json.loads((tmp_path / "s.json").read_text())
    assert content["until"] == ["mean_episode_length>=60"]
    best, other = content["ranking"]
    assert [best["values"]["ppo.learning_rate"], other["values"]["ppo.learning_rate"]] == [3e-3, 1e-9]
    assert (best["reached"], other["reached"], other["score"]) == (1, 0, None)
    quick = next(run for run in content["runs"] if run["values"] == best["values"])
    rows = read_progress(Path(quick["run"]) / "progress.csv")
    assert len(rows) < 60  # it was ended where it was there
    lengths = [float(row["mean_episode_length"] or "nan") for row in rows]
    means = [sum(lengths[k - 4 : k + 1]) / 5 for k in range(4, len(rows))]
    first = next(k for k, mean in enumerate(means, 4) if mean >= 60.0)
    batch = float(rows[0]["env_steps"])
    seconds = sum(batch / float(row["env_steps_per_s"]) for row in rows[: first + 1])
    # rates have one digit behind the point, of thousands
    assert quick["time_to_bound_s"] == pytest.approx(seconds, rel=1e-6)
    assert best["time_to_bound_s"] == quick["time_to_bound_s"]
    assert "reached after" in out
    assert (tmp_path / "s" / "curves.png").stat().st_size > 10_000
    # again: nothing is trained
    code, out, _ = simwarp(*words)
    assert (code, out.count("done before")) == (0, 2)
    assert json.loads((tmp_path / "s.json").read_text())["ranking"] == content["ranking"]
    assert len(read_progress(Path(quick["run"]) / "progress.csv")) == len(rows)


@pytest.mark.slow
def test_a_run_of_a_sweep_is_bit_by_bit_that_of_train(simwarp, tmp_path):
    options = [*SMALL, "--iterations", "2", "--threads", "1", "--ppo.gamma", "0.9"]
    assert simwarp("sweep", "fast", *options, "--seeds", "3", "--out", "s")[0] == 0
    assert simwarp("train", "fast", *options, "--seed", "3")[0] == 0
    (alone,) = (tmp_path / "runs" / "fast").iterdir()
    rows = [read_progress(path / "progress.csv") for path in (alone, tmp_path / "s" / "seed=3")]
    assert [row["loss/value"] for row in rows[0]] == [row["loss/value"] for row in rows[1]]


@pytest.mark.slow
def test_after_kill_9_of_the_sweep_the_same_command_finishes_it(tmp_path):
    words = ["--seeds", "0-1", "--grid", "ppo.gamma=0.9,0.99", "--iterations", "300", "--save-interval", "10"]
    words += ["--jobs", "2", "--out", "s", "--json", "s.json"]
    folder = tmp_path / "s"
    begun = [folder / f"ppo.gamma={gamma},seed=0" for gamma in ("0.9", "0.99")]
    process = start(tmp_path, *words)
    wait_until(lambda: all(iterations(run) > 20 for run in begun), tmp_path)
    process.kill()
    process.wait()
    # One of its trainings dies with it, the other goes on by itself
    dead, alive = begun
    os.kill(json.loads((dead / "writer.json").read_text())["pid"], signal.SIGKILL)
    wait_until(lambda: iterations(alive) > 25 or not (alive / "writer.json").exists(), tmp_path)
    assert start(tmp_path, *words).wait(timeout=280) == 0, (tmp_path / "told").read_text()
    content = json.loads((tmp_path / "s.json").read_text())
    assert [run["state"] for run in content["runs"]] == ["done"] * 4
    assert sorted(path.name for path in folder.iterdir() if path.is_dir()) == sorted(
        f"ppo.gamma={gamma},seed={seed}" for gamma in ("0.9", "0.99") for seed in (0, 1)
    )
    # The dead one was resumed, not begun anew; and every iteration is there once
    assert len(list(dead.glob("provenance_*.json"))) == 2
    assert "iteration 1/300" not in (dead / "train.log").read_text().partition("its lock was of")[2]
    for run in folder.glob("*/progress.csv"):
        assert [int(row["iteration"]) for row in read_progress(run)] == list(range(1, 301))
    assert writers(folder) == []


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_saves_the_runs_and_the_same_command_goes_on(tmp_path, number):
    words = ["--seeds", "0-2", "--iterations", "200", "--save-interval", "100000", "--jobs", "2", "--out", "s"]
    folder = tmp_path / "s"
    process = start(tmp_path, *words)
    wait_until(lambda: all(iterations(folder / f"seed={seed}") > 2 for seed in (0, 1)), tmp_path)
    pids = writers(folder)
    process.send_signal(number)
    assert process.wait(timeout=120) == 130
    assert len(pids) == 2
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    assert "3 of 3 runs are not finished" in (tmp_path / "told").read_text()
    reached = {}
    for seed in (0, 1):
        run = folder / f"seed={seed}"
        reached[seed] = load_checkpoint(open_run(run).latest_checkpoint())["iteration"]
        assert reached[seed] == iterations(run) > 2
    assert not (folder / "seed=2").exists()
    assert start(tmp_path, *words).wait(timeout=240) == 0
    told = (tmp_path / "told").read_text()
    for seed in (0, 1):
        assert f"seed={seed}  running  resumed after iteration {reached[seed]}" in told
    assert [iterations(folder / f"seed={seed}") for seed in range(3)] == [200] * 3


@pytest.mark.slow
def test_a_run_that_fails_is_named_and_the_others_go_on(simwarp, tmp_path):
    words = ["sweep", "fast", *SMALL, "--iterations", "2", "--seeds", "0", "--out", "s", "--json", "s.json"]
    words += ["--grid", "network.kind=nature-cnn,mlp"]  # an image network, which a point has no images for
    code, out, err = simwarp(*words)
    assert code == 1
    content = json.loads((tmp_path / "s.json").read_text())
    assert [run["state"] for run in content["runs"]] == ["failed", "done"]
    (failed,) = content["failed"]
    assert failed["name"] == "network.kind=nature-cnn,seed=0"
    assert "takes images" in failed["reason"]
    assert err.startswith("simwarp: run s/network.kind=nature-cnn,seed=0 failed: observation 'policy'")
    assert [point["values"]["network.kind"] for point in content["ranking"]] == ["mlp", "nature-cnn"]
    assert content["ranking"][1]["score"] is None
    code, out, err = simwarp(*words)
    assert (code, "failed before" in out, "tried again with --retry" in out) == (1, True, True)
    # Another configuration in the same folder is refused
    code, out, err = simwarp(*words[:3], "cpu", "--num-envs", "16", *words[6:])
    assert (code, "was made with num-envs = 8, not 16: give another --out" in err) == (2, True)


@pytest.mark.slow
def test_two_sweeps_do_not_write_one_folder(tmp_path):
    words = ["--seeds", "0", "--iterations", "100000", "--out", "s"]
    process = start(tmp_path, *words)
    wait_until(lambda: iterations(tmp_path / "s" / "seed=0") > 0, tmp_path)
    assert start(tmp_path, *words).wait(timeout=120) == 2
    assert f"is being written by process {process.pid}" in (tmp_path / "told").read_text()
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=120) == 130


@pytest.mark.slow
def test_a_warm_start_is_that_of_every_run(simwarp, tmp_path):
    assert simwarp("train", "fast", *SMALL, "--iterations", "1", "--network.hidden", "8")[0] == 0
    (run,) = (tmp_path / "runs" / "fast").iterdir()
    words = ["sweep", "fast", *SMALL, "--iterations", "1", "--seeds", "1", "--critic-warmup", "1", "--out", "s"]
    assert simwarp(*words, "--warm-start", str(run))[0] == 0
    weights = [
        load_checkpoint(open_run(path).latest_checkpoint())["actor_state_dict"] for path in (run, tmp_path / "s/seed=1")
    ]
    # Only the critic learnt: the actor's layers are still those that it started from
    layers = [key for key in weights[0] if key.startswith("mlp.")]
    assert layers
    for key in layers:
        assert weights[0][key].equal(weights[1][key])


@pytest.mark.slow
def test_a_search_goes_on_with_more_trials(simwarp, tmp_path):
    pytest.importorskip("optuna")
    words = ["sweep", "fast", *SMALL, "--iterations", "2", "--seeds", "0-1", "--jobs", "2", "--out", "s"]
    words += ["--search", "ppo.learning_rate=1e-4:1e-1:log", "--search", "network.activation=elu,tanh"]
    assert simwarp(*words, "--trials", "2")[0] == 0
    first = json.loads((tmp_path / "s" / "results.json").read_text())
    assert len(first["runs"]) == 4
    code, out, _ = simwarp(*words, "--trials", "3", "--json", "s.json")
    assert (code, out.count("done before")) == (0, 4)
    content = json.loads((tmp_path / "s.json").read_text())
    points = [tuple(point["values"].items()) for point in content["ranking"]]
    assert len(set(points)) == 3
    assert {tuple(point["values"].items()) for point in first["ranking"]} < set(points)
    assert all(1e-4 <= point["values"]["ppo.learning_rate"] <= 1e-1 for point in content["ranking"])
    assert (tmp_path / "s" / "search.png").stat().st_size > 3000
    code, _, err = simwarp(*words[:-2], "--trials", "3")
    assert code == 2
    assert "s holds a search over ppo.learning_rate, network.activation" in err


@pytest.mark.slow
def test_jobs_of_a_cluster_train_the_same_runs(simwarp, tmp_path):
    pytest.importorskip("submitit")
    words = ["sweep", "fast", *SMALL, "--iterations", "2", "--seeds", "0", "--out", "s", "--json", "s.json"]
    words += ["--launcher", "slurm", "--slurm", "cluster=local", "--grid", "network.kind=mlp,nature-cnn"]
    assert simwarp(*words)[0] == 1
    content = json.loads((tmp_path / "s.json").read_text())
    # in the order in which the cluster begins them
    assert sorted(run["state"] for run in content["runs"]) == ["done", "failed"]
    assert "takes images" in content["failed"][0]["reason"]
    code, _, err = simwarp(*words, "--slurm", "slurm_partitoin=x")
    assert (code, err.count("\n")) == (2, 1)
