"""Files of trajectories and dumps that are not what they should be: one line, no hang, no code."""

import io
import json
import os
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from simwarp import cli
from simwarp.core.files import FileError
from simwarp.tasks import InputError, make
from simwarp.tasks.framework.npz import read_arrays, write_arrays
from simwarp.tasks.framework.replay import replay
from simwarp.train.datasets.dataset_formats import load_trajectories
from simwarp.train.datasets.episodes import record
from simwarp.train.datasets.trajectories import save_trajectories
from simwarp.train.networks.policies import zero_policy

# ---- any file of arrays ----------------------------------------------------------------------------------------------


def npy(shape, dtype="<f4", data=b""):
    """The bytes of an array whose header claims what it likes."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": dtype, "fortran_order": False, "shape": shape})
    return stream.getvalue() + data


def archive(path, members, compression=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", compression) as file:
        for name, data in members.items():
            file.writestr(name, data)


def test_arrays_come_back_as_they_were(tmp_path):
    arrays = {
        "a": np.arange(6, dtype=np.float32).reshape(2, 3), "b/c": np.array([True, False]), "text": np.array("hello"),
        "none": np.zeros((0, 4), np.int64), "scalar": np.array(3.5), "columns": np.asfortranarray(np.eye(3)),
        "swapped": np.arange(3, dtype=">i4"),
    }  # fmt: skip
    write_arrays(tmp_path / "a.npz", arrays)
    found = read_arrays(tmp_path / "a.npz", "file")
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        assert np.array_equal(found[name], array), name
        assert found[name].dtype == array.dtype.newbyteorder("="), name
        assert found[name].flags.writeable


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ({"a.npy": npy((10**12,))}, "claims"),
        ({"a.npy": npy((2**40, 2**40))}, "claims"),
        ({"a.npy": npy((3,), data=bytes(8))}, "claims"),
        ({"a.npy": npy((-1,), data=bytes(4))}, "claims"),
        ({"a.npy": npy((1,), "|O", bytes(8))}, "claims"),
        ({"a.npy": npy((1,), [("x", "<f4")], bytes(4))}, "claims"),
        ({"a.npy": b""}, "no .npz file"),
        ({"a.npy": b"\x93NUMPY\x09\x00" + bytes(100)}, "no .npz file"),
        ({"a.npy": b"\x93NUMPY\x01\x00\x10\x00" + b"(" * 16}, "no .npz file"),
        ({"a.txt": b"hello"}, "members are not named arrays"),
    ],
)
def test_headers_that_lie_are_refused(tmp_path, members, message):
    archive(tmp_path / "a.npz", members)
    with pytest.raises(FileError, match=message):
        read_arrays(tmp_path / "a.npz", "file")


def test_what_would_unpack_to_more_than_there_is_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    archive(path, {"a.npy": npy((2**20,), "|i1", bytes(2**20))})
    data = path.read_bytes()
    # The sizes that the archive claims, in both of its places
    lies = data.replace((2**20 + 128).to_bytes(4, "little"), (2**31).to_bytes(4, "little"))
    assert lies != data
    path.write_bytes(lies)
    with pytest.raises(FileError, match="claims 2147483648 bytes"):
        read_arrays(path, "file")


def test_a_bomb_that_the_format_allows_is_held_to_the_memory(tmp_path, monkeypatch):
    path = tmp_path / "a.npz"
    archive(path, {"a.npy": npy((2**22,), "|i1", bytes(2**22))})
    monkeypatch.setattr("simwarp.core.memory.free_memory", lambda device: 2**20)
    with pytest.raises(FileError, match=r"its arrays need 8 MiB.*1 MiB are free"):
        read_arrays(path, "file")


def test_no_byte_that_is_cut_or_changed_hangs_or_escapes(tmp_path):
    path = tmp_path / "a.npz"
    write_arrays(path, {"a": np.arange(30, dtype=np.float32), "meta": np.array("{}")})
    data = path.read_bytes()
    for index in range(0, len(data), 7):
        for spoilt in (data[:index], data[:index] + bytes([data[index] ^ 0x40]) + data[index + 1 :]):
            path.write_bytes(spoilt)
            try:
                read_arrays(path, "file")
            except FileError as error:
                assert "\n" not in str(error)  # noqa: PT017


# ---- trajectories ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The arrays of a file that record wrote."""
    path = tmp_path_factory.mktemp("recorded") / "fast.npz"
    task = make("fast", 2, max_episode_steps=4)
    save_trajectories(path, record(task, zero_policy(task), 3, 0, {}))
    return read_arrays(path, "file")


def about(recorded, **changes):
    return np.array(json.dumps(json.loads(str(recorded["about"])) | changes))


SPOILT = {
    "text observations": (lambda a: {"observations/policy": np.array([["x"] * 2] * 12)}, "the trajectories hold"),
    "wide observations": (lambda a: {"observations/policy": np.zeros((12, 9), np.float32)}, "the trajectories hold"),
    "other numbers": (lambda a: {"observations/policy": a["observations/policy"].astype(np.float64)}, "float64"),
    "another group": (lambda a: {"observations/camera": np.zeros((12, 2), np.float32)}, "camera"),
    "NaN observed": (
        lambda a: {"observations/policy": a["observations/policy"] * np.nan},
        "NaN or infinity in 'policy'",
    ),
    "NaN actions": (lambda a: {"actions": a["actions"] * np.nan}, "NaN or infinity in 'actions'"),
    "infinite rewards": (lambda a: {"rewards": a["rewards"] + np.inf}, "NaN or infinity in 'rewards'"),
    "large actions": (lambda a: {"actions": a["actions"] + 1.5}, r"must lie in \[-1, 1\], got 1.5"),
    "negative actions": (lambda a: {"actions": a["actions"] - 3}, r"must lie in \[-1, 1\], got 3"),
    "whole actions": (lambda a: {"actions": a["actions"].astype(np.int64)}, "'actions' must be float32"),
    "flat actions": (lambda a: {"actions": a["actions"][:, 0]}, "'actions' must be float32 with 2 axes"),
    "wide actions": (lambda a: {"actions": np.zeros((12, 5), np.float32)}, "actions; task 'fast'"),
    "text actions": (lambda a: {"actions": np.array([["x"] * 2] * 12)}, "'actions' must be float32"),
    "a scalar": (lambda a: {"actions": np.array(1.0, np.float32)}, "with 2 axes"),
    "a huge episode": (lambda a: {"episode": a["episode"] + 10**9 * (np.arange(12) > 5)}, "numbered 0, 1, 2"),
    "reversed episodes": (lambda a: {"episode": a["episode"][::-1]}, "numbered 0, 1, 2"),
    "negative episodes": (lambda a: {"episode": a["episode"] - 2}, "numbered 0, 1, 2"),
    "episodes from one on": (lambda a: {"episode": a["episode"] + 1}, "numbered 0, 1, 2"),
    "fractions of episodes": (lambda a: {"episode": a["episode"] + 0.5}, "'episode' must be int64"),
    "endings as numbers": (lambda a: {"terminated": a["terminated"].astype(np.int64)}, "'terminated' must be bool"),
    "fewer rewards": (lambda a: {"rewards": a["rewards"][:-1]}, "as many rows"),
    "no rows": (lambda a: {name: a[name][:0] for name in a if name != "about"}, "at least one"),
    "no actions": (lambda a: {"actions": None}, "no column 'actions'"),
    "no observations": (lambda a: {"observations/policy": None}, "hold no 'observations/GROUP'"),
    "nothing about it": (lambda a: {"about": None}, "names no format 1"),
    "another format": (lambda a: {"about": about(a, format=2)}, "names no format 1"),
    "no JSON": (lambda a: {"about": np.array("{")}, "broken JSON"),
    "deep JSON": (lambda a: {"about": np.array("[" * 20_000)}, "broken JSON"),
    "a list": (lambda a: {"about": np.array("[]")}, "names no format 1"),
    "about in numbers": (lambda a: {"about": np.zeros(3)}, "names no format 1"),
    "another task": (lambda a: {"about": about(a, task="pendulum")}, "are of task 'pendulum', not 'fast'"),
    "no task": (lambda a: {"about": about(a, task=None)}, "are of task None, not 'fast'"),
    "no configuration": (lambda a: {"about": about(a, task_config=None)}, "names no task_config"),
    "a broken configuration": (lambda a: {"about": about(a, task_config={"dt": None})}, "dt must be"),
    "huge numbers": (lambda a: {"about": about(a, task_config={"substeps": 10**20})}, "beyond 64 bits"),
}


@pytest.mark.parametrize("kind", SPOILT)
def test_trajectories_that_are_none_get_one_line(recorded, tmp_path, monkeypatch, capsys, kind):
    change, message = SPOILT[kind]
    arrays = {name: array for name, array in {**recorded, **change(recorded)}.items() if array is not None}
    write_arrays(tmp_path / "spoilt.npz", arrays)
    monkeypatch.chdir(tmp_path)
    assert cli.main(["clone", "fast", "--data", "spoilt.npz", "--epochs", "1"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert len(err) < 900
    assert re.search(message, err)
    assert [path.name for path in tmp_path.iterdir()] == ["spoilt.npz"]


def test_what_was_recorded_is_read(recorded, tmp_path):
    write_arrays(tmp_path / "fine.npz", recorded)
    assert load_trajectories(tmp_path / "fine.npz", "fast").episodes == 3


# ---- dumps of broken worlds ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def dump():
    """The arrays of a dump from within an episode, so that the state is among them."""
    task = make("pendulum", 2, guard_steps=4)
    action = torch.zeros(2, 1)
    for _ in range(9):
        task.step(action)
    task.views.joint_qd[1] = torch.nan
    task.step(action)
    task.drain_statistics()
    assert task.guard is not None
    assert task.guard.dump is not None
    assert not json.loads(str(task.guard.dump["meta"]))["from_reset"]
    return task.guard.dump


def meta(dump, **changes):
    content = json.loads(str(dump["meta"])) | changes
    return {"meta": np.array(json.dumps({name: value for name, value in content.items() if value != "missing"}))}


def config(dump, **changes):
    return meta(dump, config=json.loads(str(dump["meta"]))["config"] | changes)


BROKEN_DUMPS = {
    "no meta": (lambda d: {"meta": None}, "no dump of a broken world"),
    "no text": (lambda d: {"meta": np.zeros(3)}, "no dump of a broken world"),
    "no JSON": (lambda d: {"meta": np.array("{")}, "broken JSON"),
    "a list": (lambda d: {"meta": np.array("[]")}, "no dump of a broken world"),
    "another format": (lambda d: meta(d, format="1"), "has format '1'"),
    "no seed": (lambda d: meta(d, seed="missing"), "seed: missing; give a whole number"),
    "null": (lambda d: meta(d, seed=None), "seed must be"),
    "a fraction": (lambda d: meta(d, world=0.5), "world must be"),
    "truth": (lambda d: meta(d, episode=True), "episode must be"),
    "a negative world": (lambda d: meta(d, world=-1), "world must be zero or positive"),
    "a huge world": (lambda d: meta(d, world=2**62), "world must be below 9007199254740992"),
    "a huge number": (lambda d: meta(d, seed=10**30), "beyond 64 bits"),
    "no steps": (lambda d: meta(d, replay_steps=0), "replay-steps must be"),
    "more steps than there were": (lambda d: meta(d, replay_steps=10**9, episode_steps=10**9), "rows of 'actions'"),
    "a level": (lambda d: meta(d, level=3.0), "level must be"),
    "an unknown name": (lambda d: meta(d, surprise=1), "surprise: unknown key"),
    "an unknown task": (lambda d: meta(d, task="nonsense"), "unknown task 'nonsense'"),
    "a task without physics": (lambda d: meta(d, task="fast"), "no physics"),
    "another task": (lambda d: meta(d, task="ant", config={}), "actions must be"),
    "a configuration": (lambda d: config(d, dt=None), "dt must be"),
    "a step": (lambda d: config(d, dt=-1.0), "dt must be positive"),
    "sub-steps": (lambda d: config(d, substeps=10**20), "beyond 64 bits"),
    "no actions": (lambda d: {"actions": None}, "0 rows of 'actions'"),
    "text for actions": (lambda d: {"actions": np.array([["x"]] * 9)}, "actions must be"),
    "a scalar": (lambda d: {"joint_q": np.array(1.0)}, "0 rows of 'joint_q'"),
    "whole numbers": (lambda d: {"joint_qd": np.zeros(d["joint_qd"].shape, np.int64)}, "joint_qd must be"),
    "wide actions": (lambda d: {"actions": np.repeat(d["actions"], 3, axis=1)}, "actions must be"),
    "no state": (lambda d: {name: None for name in d if name.startswith("start/state/")}, "start.state has no"),
    "another state": (
        lambda d: {name: d[name][..., None] for name in d if name.startswith("start/state/joint")}, "must be",
    ),
    "a state in words": (
        lambda d: {name: np.array("x") for name in d if name.startswith("start/state/joint_q")}, "must be",
    ),
    "no first action": (lambda d: {"start_action": None}, "start_action must be"),
}  # fmt: skip


@pytest.mark.parametrize("kind", BROKEN_DUMPS)
@pytest.mark.sweep
def test_dumps_that_are_none_get_one_line(dump, tmp_path, capsys, kind):
    change, message = BROKEN_DUMPS[kind]
    arrays = {name: array for name, array in {**dump, **change(dump)}.items() if array is not None}
    write_arrays(tmp_path / "spoilt.npz", arrays)
    assert cli.main(["replay", str(tmp_path / "spoilt.npz")]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert message in err
    assert len(err) < 900


def test_the_dump_itself_is_replayed(dump, tmp_path):
    write_arrays(tmp_path / "fine.npz", dump)
    report = replay(tmp_path / "fine.npz")
    assert report.steps < report.episode_step == 10


# ---- what stands where a file should be ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["empty", "text", "npy", "folder", "fifo", "device", "nowhere", "long"])
@pytest.mark.parametrize(
    "command",
    [["replay"], ["train", "fast", "--resume"], ["train", "fast", "--warm-start"], ["eval", "fast", "--checkpoint"],
     ["play", "fast", "--checkpoint"], ["record", "fast", "--checkpoint"], ["export"], ["clone", "fast", "--data"]],
    ids=lambda command: command[0],
)  # fmt: skip
def test_what_is_no_file_of_ours_gets_one_line(tmp_path, monkeypatch, capsys, kind, command):
    monkeypatch.chdir(tmp_path)
    path = Path({"device": "/dev/zero", "long": "x" * 300}.get(kind, kind))
    if kind == "empty":
        path.write_bytes(b"")
    elif kind == "text":
        path.write_text("hello", encoding="utf-8")
    elif kind == "npy":
        np.save("npy", np.zeros(3))
        Path("npy.npy").rename("npy")
    elif kind == "folder":
        path.mkdir()
    elif kind == "fifo":
        os.mkfifo(path)
    before = sorted(tmp_path.rglob("*"))
    assert cli.main([*command, str(path)]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert sorted(tmp_path.rglob("*")) == before


def test_no_code_of_a_file_is_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    class Evil:
        def __reduce__(self):
            return os.mkdir, ("evil",)

    np.savez("evil.npz", about=np.array([Evil()], dtype=object), meta=np.array([Evil()], dtype=object))
    assert cli.main(["clone", "fast", "--data", "evil.npz"]) == 2
    assert cli.main(["replay", "evil.npz"]) == 2
    with pytest.raises((FileError, InputError)):
        read_arrays(Path("evil.npz"), "file")
    assert not Path("evil").exists()
    capsys.readouterr()
