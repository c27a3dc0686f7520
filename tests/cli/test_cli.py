"""The command line as a user meets it: exit codes, one clear line for each mistake, JSON keys of the contract."""

import dataclasses
import json
import re
import subprocess
import sys
import types

import pytest

from simwarp import cli, tasks
from simwarp.cli import options
from simwarp.core.warp_start import COMPILING


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A working folder with one short run of the fast task."""
    path = tmp_path_factory.mktemp("work")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(path)
        options = ["--device", "cpu", "--num-envs", "8", "--iterations", "2", "--steps-per-iteration", "8"]
        assert cli.main(["train", "fast", *options, "--json", "train.json"]) == 0
    return path


@pytest.fixture
def simwarp(folder, monkeypatch, command):
    """Run a command in that folder: exit code, standard output, standard error."""
    monkeypatch.chdir(folder)
    return command


def test_train_writes_the_keys_of_the_contract_and_says_where_things_are(folder, simwarp):
    result = json.loads((folder / "train.json").read_text(encoding="utf-8"))
    assert {"run", "iterations", "env_steps", "env_steps_per_s", "wall_s"} <= set(result)
    assert {"mean_reward", "mean_episode_length"} <= set(result)
    assert result["iterations"] == 2
    assert result["env_steps"] == 2 * 8 * 8
    code, out, err = simwarp("train", "fast", "--resume", result["run"], "--iterations", "3")
    assert (code, err) == (0, "")
    assert re.search(r"iteration 3/3 .*reward .*episode .*env steps/s.*ETA", out)
    assert "\nrewards near 1\n" in out
    assert f"run folder      {result['run']}" in out
    assert "learning_curve.png" in out
    # The configuration of the run is the default: 8 worlds, not the task's 128
    assert json.loads((folder / result["run"] / "config.json").read_text())["train_config"]["num_envs"] == 8


def test_eval_keys_and_baselines(simwarp):
    code, out, err = simwarp("eval", "fast", "--episodes", "9", "--num-envs", "4", "--json", "-")
    assert code == 0
    result = json.loads(out)
    keys = {"episodes", "mean_return", "mean_episode_length", "success_rate", "success_ci95", "end_reasons"}
    assert keys | {"final_distance"} <= set(result)
    assert result["episodes"] == 9
    assert sum(result["end_reasons"].values()) == 9
    assert set(result["baselines"]) == {"zero", "random"}
    assert all(keys <= set(baseline) and baseline["episodes"] == 9 for baseline in result["baselines"].values())
    assert "zero action" in err
    assert "random" in err


@pytest.mark.slow
def test_eval_says_what_the_policy_sees_and_that_full_changes_nothing(simwarp):
    options = ("--episodes", "1", "--no-baselines", "--task.max-episode-steps", "2")
    code, _, err = simwarp("eval", "off-road", "--obs", "state", "--full", *options)
    assert code == 0
    assert "there is one model of the gator: --full changes nothing" in err
    code, out, err = simwarp("eval", "off-road", "--obs", "state", *options)
    assert code == 0
    assert "(--obs state)" in out
    assert "--full" not in err
    code, out, _ = simwarp(
        "eval", "off-road", "--checkpoint", "shipped", "--task.obstacles", "3", *options, "--json", "-"
    )
    told = json.loads(out)["task_config"]
    assert (code, told["obstacles"], told["obs"]) == (0, 3, "camera")
    code, _, err = simwarp("eval", "off-road", "--obs", "state", "--task.obstacles", "-3", *options)
    assert (code, err) == (2, "simwarp: --task.obstacles must be from 0 to 500, got -3\n")


def test_full_works_for_a_task_that_drives_no_known_vehicle(monkeypatch, capsys):
    monkeypatch.setattr(tasks, "task_class", lambda name: object)  # a task of somebody else, with the field alone
    config = types.SimpleNamespace(full=False)
    assert options.expand_shorthands(["--full"], "own", config) == ["--task.full"]
    assert capsys.readouterr().err == ""


def test_eval_over_a_grid(simwarp):
    code, out, _ = simwarp("eval", "fast", "--episodes", "4", "--grid", "bound=1.5,3.0", "--json", "-")
    assert code == 0
    assert [point["bound"] for point in json.loads(out)["grid"]] == [1.5, 3.0]


def test_eval_takes_a_run_folder_or_a_file_and_overrides_of_the_task(folder, simwarp):
    run = next((folder / "runs" / "fast").iterdir())
    newest = sorted((run / "checkpoints").iterdir())[-1]
    lengths = []
    for checkpoint in (run, newest):
        code, out, _ = simwarp(
            "eval", "fast", "--checkpoint", str(checkpoint), "--task.max-episode-steps", "5", "--episodes", "2",
            "--json", "-",
        )  # fmt: skip
        assert code == 0
        lengths.append(json.loads(out)["mean_episode_length"])
    assert lengths == [5.0, 5.0]


def test_play_writes_a_picture_and_a_video(folder, simwarp):
    code, out, err = simwarp("play", "fast", "--seconds", "0.2", "--num-envs", "2")
    # Where its kernels are not in the cache yet, a line says so
    told = [line for line in err.splitlines() if not line.startswith(f"simwarp: {COMPILING}")]
    assert (code, told) == (0, [])
    assert "wrote fast.mp4" in out
    assert (folder / "fast.mp4").read_bytes()[4:8] == b"ftyp"
    code, out, _ = simwarp("play", "fast", "--seconds", "0.2", "--video", "fast.png")
    assert code == 0
    assert (folder / "fast.png").stat().st_size > 1000
    code, out, _ = simwarp("play", "fast", "--seconds", "0.2", "--video", "a.gif", "--json", "-")
    assert code == 0
    assert json.loads(out)["video"] == "a.gif"
    assert isinstance(json.loads(out)["return"], float)
    assert (folder / "a.gif").read_bytes()[:4] == b"GIF8"


def test_list_names_everything(simwarp):
    code, out, _ = simwarp("list")
    assert code == 0
    assert re.search(r"^  pendulum  +\S", out, re.MULTILINE)
    code, out, _ = simwarp("list", "--json", "-")
    content = json.loads(out)
    assert {"tasks", "vehicles", "sensors", "scenes"} == set(content)
    names = {entry["name"] for entry in content["tasks"]}
    assert {"ant", "pendulum"} <= names
    assert "fast" not in names  # for tests alone


def test_doctor_reports(simwarp):
    code, out, _ = simwarp("doctor", "--json", "-")
    content = json.loads(out)
    assert {"device", "versions", "problems"} <= set(content)
    assert content["versions"]["torch"]
    assert code == (1 if content["problems"] else 0)
    assert all(item["problem"] and item["remedy"] for item in content["problems"])


def test_doctor_names_a_version_out_of_range():
    from simwarp.cli.doctor import examine_versions

    found = examine_versions({"rsl-rl-lib": "5.4.0", "torch": None, "numpy": "2.4.6"})
    assert [item.problem.split(";")[0] for item in found] == ["torch is missing", "rsl-rl-lib 5.4.0"]


def test_doctor_sees_a_gpu_that_the_libraries_do_not(monkeypatch):
    import torch

    from simwarp.cli import doctor

    monkeypatch.setattr(doctor, "_nvidia_smi", lambda: ["NVIDIA H200, 580.0"])
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
    facts, problems = doctor.examine_devices()
    assert facts["gpus"] == ["NVIDIA H200, 580.0"]
    assert any("torch" in item.problem for item in problems)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["trian", "fast"], "unknown command 'trian'; did you mean train?"),
        (["train"], "which task?"),
        (["train", "pendulm"], "unknown task 'pendulm'; did you mean pendulum?"),
        (["eval", "fats"], "unknown task 'fats'; did you mean fast"),
        (["train", "fast", "--num-envs", "0"], "num-envs must be at least 1, got 0"),
        (["train", "fast", "--num-envs", "-4"], "num-envs must be at least 1, got -4"),
        (["train", "fast", "--num-envs", "many"], "--num-envs"),
        (["train", "fast", "--num-worlds", "4"], "unknown option --num-worlds"),
        (["train", "fast", "--num-env", "4"], "did you mean --num-envs?"),
        (["train", "fast", "--device", "tpu"], "unknown device 'tpu'; available: cpu"),
        (["train", "fast", "--device", "cuda:99"], "unknown device 'cuda:99'"),
        (["train", "fast", "--ppo.gamma", "1.5"], "gamma must be in (0, 1], got 1.5"),
        (["train", "fast", "--ppo.learning-rat", "1"], "did you mean --ppo.learning-rate"),
        (["train", "fast", "--task.gain", "-1"], "gain must be positive, got -1.0"),
        (["train", "fast", "--task.gain", "nan"], "gain must be a finite number"),
        (["train", "fast", "--resume", "nowhere"], "run folder nowhere does not exist"),
        (["train", "fast", "--json", "no/such/folder.json"], "folder no/such does not exist"),
        (["train", "fast", "stray"], "unexpected argument 'stray'"),
        (["eval", "fast", "--checkpoint", "none.pt"], "checkpoint 'none.pt' does not exist"),
        (["eval", "fast", "--checkpoint", "train.json"], "truncated or not a checkpoint"),
        (["eval", "fast", "--episodes", "0"], "episodes must be at least 1, got 0"),
        (["eval", "fast", "--num-envs", "-1"], "num-envs must be at least 1, got -1"),
        (["eval", "fast", "--grid", "gain"], "--grid wants KEY=a,b,c"),
        (["eval", "fast", "--grid", "gian=1"], "unknown option --task.gian; did you mean --task.gain"),
        (["eval", "fast", "--grid", "gain=much"], "--task.gain must be a number, got 'much'"),
        (["play", "fast", "--num-envs", "0"], "num-envs must be from 1 to 64, got 0"),
        (["play", "fast", "--seconds", "-1"], "seconds must be positive"),
        (["play", "fast", "--video", "a.avi"], "must end in .mp4, .gif, .png or .jpg"),
        (["play", "fast", "--export-scene", "a.obj"], "must end in .glb or .pov, got 'a.obj'"),
        (["play", "fast", "--export-scene", "no/such/a.glb"], "folder no/such does not exist"),
        (["play", "fast", "--export-scene", "a.glb"], "task 'fast' has no bodies to export"),
        (["play", "fast", "--record", "a.mcap"], "task 'fast' has no bodies to record"),
        (["play", "fast", "--export-scene", "a.glb", "--video", "a.mp4"], "--export-scene takes the place of --video"),
        (["play", "fast", "--html", "a.html", "--video", "a.mp4"], "--html takes the place of --video"),
        (["play", "fast", "--export-scene", "a.glb", "--num-envs", "2", "--worlds", "0", "1"], "shows one world, got"),
        (["drive", "artcar", "--maneuver", "step-steer", "--export-scene", "a.gltf"], "must end in .glb or .pov"),
        (["drive", "artcar", "--maneuver", "step-steer", "--export-scene", "no/a.pov"], "folder no does not exist"),
        (["list", "--jsno", "-"], "did you mean --json?"),
        (["play", "my_task.py"], "task file 'my_task.py': name the class too, as in my_task.py:TaskClass"),
    ],
)
@pytest.mark.sweep
def test_a_mistake_gets_one_line_and_exit_code_2(simwarp, arguments, message):
    code, out, err = simwarp(*arguments)
    assert code == 2
    assert message in err
    assert err.startswith("simwarp: ")
    assert err.count("\n") == 1
    assert "Traceback" not in out + err


def test_checkpoints_of_another_task_or_cut_short_are_refused(folder, simwarp):
    run = next((folder / "runs" / "fast").iterdir())
    checkpoint = sorted((run / "checkpoints").iterdir())[0]
    code, _, err = simwarp("eval", "pendulum", "--checkpoint", str(checkpoint))
    assert (code, err.count("\n")) == (2, 1)
    assert "is of task 'fast', not 'pendulum'" in err
    (folder / "short.pt").write_bytes(checkpoint.read_bytes()[:-200])
    code, _, err = simwarp("play", "fast", "--checkpoint", "short.pt")
    assert (code, err) == (2, "simwarp: checkpoint short.pt is truncated or not a checkpoint\n")


def test_debug_shows_the_traceback(simwarp):
    from simwarp.tasks import InputError

    with pytest.raises(InputError):
        simwarp("train", "pendulm", "--debug")


@pytest.mark.parametrize(
    "arguments", [["--help"], ["train", "--help"], ["train", "fast", "--help"], ["list", "--help"]]
)
def test_help(simwarp, arguments):
    code, out, err = simwarp(*arguments)
    assert (code, err) == (0, "")
    assert "usage: simwarp" in out


def test_help_offers_every_field(simwarp):
    import dataclasses

    from simwarp.tasks import task_class
    from simwarp.train.config import NetworkConfig, PPOConfig, TrainConfig

    _, out, _ = simwarp("train", "fast", "--help")
    for prefix, kind in (("", TrainConfig), ("ppo.", PPOConfig), ("network.", NetworkConfig)):
        for field in dataclasses.fields(kind):
            if field.name not in ("ppo", "network"):
                # an underscore at the end keeps a name from a keyword, and is no part of the option
                assert f"--{prefix}{field.name.rstrip('_').replace('_', '-')}" in out
    for field in dataclasses.fields(task_class("fast").config_type):
        assert f"--task.{field.name.replace('_', '-')}" in out


def test_no_command_is_a_mistake(simwarp):
    code, out, _ = simwarp()
    assert code == 2
    assert "usage: simwarp" in out


def test_bench_and_verify_are_handed_their_arguments(simwarp, monkeypatch):
    import types
    from importlib.machinery import ModuleSpec

    for name, room in (("bench", "benching"), ("verify", "verifying")):
        seen: list[list[str]] = []
        module = types.ModuleType(f"simwarp.cli.{room}")
        module.__dict__["run"] = lambda arguments, seen=seen: seen.append(arguments) or 1
        module.__spec__ = ModuleSpec(module.__name__, None)
        monkeypatch.setitem(sys.modules, f"simwarp.cli.{room}", module)
        assert simwarp(name, "ant", "--worlds", "1,2")[0] == 1
        assert seen == [["ant", "--worlds", "1,2"]]


def test_help_needs_neither_torch_nor_tyro():
    code = "import sys, simwarp.cli as cli; cli.main(['--help']); print({'torch', 'tyro'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout.splitlines()[-1] == "set()"


def test_module_and_command_are_the_same():
    done = subprocess.run([sys.executable, "-m", "simwarp", "--version"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert re.fullmatch(r"simwarp \d+\.\d+\.\d+\n", done.stdout)


def test_nan_becomes_null_in_json(tmp_path):
    from simwarp.cli.options import CommonOptions

    target = tmp_path / "a.json"
    CommonOptions(json=str(target)).emit({"a": float("nan"), "b": [1.0, float("inf")], "c": {"d": 2}})
    assert json.loads(target.read_text()) == {"a": None, "b": [1.0, None], "c": {"d": 2}}


def test_doctor_tries_no_gpu_where_there_is_none(simwarp):
    code, _, err = simwarp("doctor", "--gpu", "--device", "cuda:7")
    assert code == 2
    assert "'cuda:7' is none that Warp finds" in err
    assert "\n" not in err.strip()


def test_a_trial_of_a_gpu_goes_on_where_something_fails(monkeypatch):
    """A report names all that is wrong: an error of one scene must not hide the others."""
    import io

    import warp as wp
    from rich.console import Console

    from simwarp.bench import agreement
    from simwarp.cli import gpu_trial

    fine = agreement.Agreement("ant", 2, 10, 1.0, repeats=True, position=1e-6, frames=None, agrees=True)
    rows = {
        "ant": fine,
        "stack": dataclasses.replace(fine, scene="stack", position=0.5, agrees=False),
        "camera": dataclasses.replace(fine, scene="camera", repeats=False, frames=0.5, agrees=False),
    }
    monkeypatch.setattr(agreement, "agreement_scenes", lambda: [*rows, "lidar"])
    monkeypatch.setattr(agreement, "compare", lambda name, device, worlds: rows[name])
    monkeypatch.setattr(wp, "get_cuda_devices", lambda: ["cuda:0"])
    monkeypatch.setattr(wp, "get_device", lambda name: wp.get_preferred_device())
    monkeypatch.setattr(gpu_trial.GpuTrial, "_train", lambda self: {"iterations": 5})
    facts, wrong = gpu_trial.GpuTrial("cuda:0", 2, Console(file=io.StringIO())).run()
    assert [row["scene"] for row in facts["scenes"]] == list(rows)
    assert facts["training"] == {"iterations": 5}
    assert [line.partition(":")[0] for line in wrong] == ["lidar", "stack", "camera"]
    assert "0.5 m from the CPU after 10 steps" in wrong[1]
