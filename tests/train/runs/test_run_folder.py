"""Run folders: what is newest, what is dropped, and what a log or a configuration that is broken does not stop."""

import json
import os
import shutil
from pathlib import Path

import pytest
from rich.console import Console

from simwarp import cli
from simwarp.core.files import FileError
from simwarp.tasks import InputError
from simwarp.train.runs.progress_table import ProgressTable, read_progress
from simwarp.train.runs.run_folder import RunFolder, check_root, latest_run
from tests.train.runs.trained_run import QUIET, run


def folder_of(path, *iterations):
    folder = RunFolder(path)
    folder.checkpoints.mkdir(parents=True)
    for iteration in iterations:
        folder.checkpoint_path(iteration).write_bytes(b"")
    return folder


def names(folder):
    return [path.name for path in folder.checkpoint_files()]


def test_checkpoints_are_sorted_by_number(tmp_path):
    folder = folder_of(tmp_path, 999_998, 1_000_000, 999_999, 25, 10**17)
    assert names(folder) == [
        "iteration_000025.pt", "iteration_999998.pt", "iteration_999999.pt", "iteration_1000000.pt",
        f"iteration_{10**17}.pt",
    ]  # fmt: skip


def test_what_is_no_checkpoint_of_the_run_is_left_alone(tmp_path):
    folder = folder_of(tmp_path, 1, 2, 3)
    others = ["iteration_best.pt", "iteration_000009.pt.bak", "iteration_.pt", "iteration_-00004.pt"]
    for name in others:
        (folder.checkpoints / name).write_bytes(b"")
    (folder.checkpoints / "iteration_000008.pt").mkdir()
    assert names(folder) == ["iteration_000001.pt", "iteration_000002.pt", "iteration_000003.pt"]
    folder.save({"iteration": 4}, keep=2)
    assert names(folder) == ["iteration_000003.pt", "iteration_000004.pt"]
    assert all((folder.checkpoints / name).exists() for name in others)


def test_the_millionth_checkpoint_is_kept_and_the_one_before_it_goes(tmp_path):
    folder = folder_of(tmp_path, 999_998, 999_999)
    folder.save({"iteration": 1_000_000}, keep=1)
    assert names(folder) == ["iteration_1000000.pt"]


def write_run(root, name, started=None, obs="state", config=None):
    folder = folder_of(root / "hallway" / name, 1)
    content = {"task": "hallway", "train_config": {}, "task_config": {"obs": obs}}
    (folder.path / "config.json").write_text(json.dumps(content) if config is None else config, encoding="utf-8")
    if started is not None:
        (folder.path / "provenance.json").write_text(json.dumps({"started": started}), encoding="utf-8")
    return folder


STAMP = "2026-03-01_12-00-00"


def newest(root, obs=None):
    found = latest_run(root, "hallway", obs)
    assert found is not None
    return found.path.name


def test_the_newest_run_is_the_one_that_began_last(tmp_path):
    write_run(tmp_path, f"{STAMP}-9", "2026-03-01T12:00:00+00:00")
    write_run(tmp_path, f"{STAMP}-12", "2026-03-01T12:00:00+00:00")
    assert newest(tmp_path) == f"{STAMP}-12"
    # Another name, another time zone: what counts is when it began
    write_run(tmp_path, "a-name-of-mine", "2026-03-01T13:30:00+01:00")
    assert newest(tmp_path) == "a-name-of-mine"
    write_run(tmp_path, "zzz", "2026-03-01T11:00:00+00:00")
    assert newest(tmp_path) == "a-name-of-mine"


def test_without_a_provenance_the_name_counts(tmp_path):
    for name in ("zzz", STAMP, f"{STAMP}-9", f"{STAMP}-12", "2026-02-28_23-59-59-99"):
        write_run(tmp_path, name)
    assert newest(tmp_path) == f"{STAMP}-12"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "null",
        "[1]",
        '{"started": null}',
        '{"started": 5}',
        '{"started": "x"}',
        '{"started": "9999-99-99"}',
        "[" * 5000,
    ],
)
def test_a_broken_provenance_is_as_good_as_none(tmp_path, text):
    for name in ("2026-03-01_12-00-00", "2026-03-01_12-00-02"):
        write_run(tmp_path, name)
    broken = write_run(tmp_path, "2026-03-01_12-00-01")
    (broken.path / "provenance.json").write_text(text, encoding="utf-8")
    assert newest(tmp_path) == "2026-03-01_12-00-02"
    shutil.rmtree(tmp_path / "hallway" / "2026-03-01_12-00-02")
    assert newest(tmp_path) == "2026-03-01_12-00-01"


@pytest.mark.parametrize("text", ["", "null", "{}", '{"task": "hallway", "train_config": {}, "task_config": null}'])
def test_a_run_without_a_readable_configuration_does_not_hide_the_others(tmp_path, text):
    write_run(tmp_path, "2026-03-01_12-00-00")
    write_run(tmp_path, "2026-03-01_12-00-01", config=text)
    assert newest(tmp_path, "state") == "2026-03-01_12-00-00"
    assert latest_run(tmp_path, "hallway", "camera") is None


@pytest.mark.parametrize("root", ["nowhere", "file", "x" * 300])
def test_no_runs_where_there_are_none(tmp_path, root):
    (tmp_path / "file").write_text("")
    assert latest_run(tmp_path / root, "fast") is None


def test_where_no_run_can_be_made_is_said_before_any_work(tmp_path, capfd):
    (tmp_path / "file").write_text("")
    for root in (tmp_path / "file", tmp_path / "file" / "runs"):
        with pytest.raises(FileError, match=r"--runs: '.*file' is no folder"):
            check_root(root)
        assert cli.main(["train", "fast", "--runs", str(root)]) == 2
        out, err = capfd.readouterr()
        assert "building" not in out
        assert err.count("\n") == 1
    check_root(tmp_path / "new" / "runs")


# ---- progress.csv ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    return run(tmp_path_factory.mktemp("trained"))


@pytest.fixture
def folder(trained, tmp_path):
    return RunFolder(shutil.copytree(trained.path, tmp_path / "fast" / "run"))


def spoil(text, kind):
    lines = text.split(b"\r\n")
    return {
        "not UTF-8": b"\r\n".join([*lines[:2], b"\xff\xfe\x00" + lines[2], *lines[3:]]),
        "half a line": text[:-20],
        "other columns": b"\r\n".join([*lines[:2], b"1,2,3", *lines[3:]]),
        "words for numbers": text.replace(lines[2], lines[2].replace(b",", b",x", 1)),
        "a huge iteration": text.replace(lines[2], b"9" * 5000 + lines[2]),
        "a line without end": text.replace(lines[2], b"," * 200_000),
        "no header": b"\r\n".join(lines[1:]),
        "zeros": bytes(len(text)),
        "nothing": b"",
    }[kind]


@pytest.mark.parametrize(
    ("kind", "left"),
    [
        ("not UTF-8", [1, 3]), ("half a line", [1, 2]), ("other columns", [1, 3]), ("words for numbers", [1, 3]),
        ("a huge iteration", [1, 3]), ("a line without end", [1, 3]), ("no header", []), ("zeros", []), ("nothing", []),
    ],
)  # fmt: skip
@pytest.mark.sweep
def test_a_log_never_stops_a_resume_and_keeps_what_can_be_read(folder, capfd, kind, left):
    folder.progress.write_bytes(spoil(folder.progress.read_bytes(), kind))
    assert [int(row["iteration"]) for row in read_progress(folder.progress)] == left
    run(folder.path.parent, resume=folder.path, iterations=4, console=Console(width=500))
    assert [int(row["iteration"]) for row in read_progress(folder.progress)] == [*left, 4]
    said = [line for line in capfd.readouterr().out.splitlines() if "could not be read and are dropped" in line]
    assert len(said) == (kind not in ("nothing", "zeros"))
    assert all(str(folder.progress) in line for line in said)


def test_columns_with_commas_survive(tmp_path):
    table = ProgressTable(tmp_path / "progress.csv", ["iteration", "reward/a, b", 'reward/"c"'])
    table.append({"iteration": 1, "reward/a, b": 0.5, 'reward/"c"': 2})
    assert read_progress(table.path) == [{"iteration": "1", "reward/a, b": "0.5", 'reward/"c"': "2"}]


# ---- config.json -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("place", "value", "named"),
    [
        (("train_config",), None, "train_config must be"),
        (("task_config",), [], "task_config must be"),
        (("task",), 3, "task must be"),
        (("train_config", "ppo"), None, "ppo must be"),
        (("train_config", "ppo", "gamma"), None, "ppo.gamma must be"),
        (("train_config", "ppo", "gamma"), "0.9", "ppo.gamma must be"),
        (("train_config", "ppo", "gama"), 1, "ppo.gama: unknown key (did you mean 'gamma'?)"),
        (("train_config", "network", "hidden"), [64, None], "network.hidden[1] must be"),
        (("train_config", "network", "hidden"), [10**9, 10**9], "network.hidden[0] must be from 1 to 16384"),
        (("train_config", "network", "kind"), "mpl", "network.kind must be one of mlp"),
        (("train_config", "num_envs"), True, "num-envs must be"),
        (("train_config", "num_envs"), 8.0, "num-envs must be"),
        (("train_config", "seed"), 10**30, "beyond 64 bits"),
        (("train_config", "device"), None, "device must be"),
        (("train_config", "spread_start"), 1, "spread-start must be true or false"),
        (("task_config", "dt"), None, "dt must be"),
        (("task_config", "dt"), 1e300, "beyond float32"),
        (("task_config", "action_delay"), [1], "action-delay must be a list of 2"),
        (("task_config", "randomise"), {"body_mass": {}}, "randomise 'body_mass'"),
        (("task_config", "curriculum"), {"driver": 3}, "curriculum.driver must be one of"),
        (("task_config", "nonsense"), 1, "nonsense: unknown key; known: "),
    ],
)
def test_values_of_a_wrong_type_are_named_with_their_file(trained, tmp_path, capfd, place, value, named):
    config = trained.load_config()
    owner = config
    for key in place[:-1]:
        owner = owner[key]
    owner[place[-1]] = value
    folder = folder_of(tmp_path / "fast" / "run")
    shutil.copy(trained.latest_checkpoint(), folder.checkpoints)
    (folder.path / "config.json").write_text(json.dumps(config), encoding="utf-8")
    assert cli.main(["train", "fast", "--resume", str(folder.path), "--iterations", "9"]) == 2
    err = capfd.readouterr().err
    assert err.count("\n") == 1
    assert "config.json" in err
    assert named in err


@pytest.mark.parametrize("command", ["eval", "play", "record", "export"])
def test_a_run_whose_configuration_is_wrong_is_refused_although_its_checkpoint_is_right(
    trained, tmp_path, capfd, command
):
    config = trained.load_config()
    config["train_config"]["ppo"]["gamma"] = None
    folder = folder_of(tmp_path / "run")
    shutil.copy(trained.latest_checkpoint(), folder.checkpoints)
    (folder.path / "config.json").write_text(json.dumps(config), encoding="utf-8")
    path = str(folder.path)
    assert cli.main([command, *([path] if command == "export" else ["fast", "--checkpoint", path])]) == 2
    err = capfd.readouterr().err
    assert err.count("\n") == 1
    assert "config.json: train_config: ppo.gamma must be a number" in err


@pytest.mark.parametrize("command", ["train", "eval", "play", "record", "export"])
@pytest.mark.parametrize("text", [b"", b"{", b"null", b"\xff", b"[" * 100_000, b'{"task": 1, "task": 2}'])
def test_a_broken_configuration_is_one_line_for_every_command(trained, tmp_path, capfd, command, text):
    folder = folder_of(tmp_path / "run")
    shutil.copy(trained.latest_checkpoint(), folder.checkpoints)
    (folder.path / "config.json").write_bytes(text)
    path = str(folder.path)
    arguments = {"train": ["fast", "--resume", path], "export": [path]}.get(command, ["fast", "--checkpoint", path])
    assert cli.main([command, *arguments]) == 2
    err = capfd.readouterr().err
    assert err.count("\n") == 1
    assert "config.json" in err


@pytest.mark.parametrize("kind", ["file", "folder", "fifo", "device", "nowhere"])
def test_what_is_no_run_is_not_resumed(tmp_path, kind):
    path = Path("/dev/zero") if kind == "device" else tmp_path / kind
    if kind == "file":
        path.write_text("")
    elif kind == "folder":
        path.mkdir()
    elif kind == "fifo":
        os.mkfifo(path)
    with pytest.raises(InputError, match="run"):
        run(tmp_path, resume=path, console=QUIET)
