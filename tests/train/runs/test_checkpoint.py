"""Checkpoints: every bit is under the checksum, those of before load and say so, and no content gets far unchecked."""

import copy
import io
import random
import shutil
import zipfile

import pytest
import torch

from simwarp import cli
from simwarp.tasks import InputError
from simwarp.train.networks.policies import SHIPPED
from simwarp.train.runs.checkpoint import checkpoint_bytes, inference_only, load_checkpoint, save_checkpoint, sealed
from simwarp.train.runs.run_folder import RunFolder
from tests.train.runs.trained_run import run


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    return run(tmp_path_factory.mktemp("trained"))


@pytest.fixture(scope="module")
def content(trained):
    return load_checkpoint(trained.latest_checkpoint())


@pytest.fixture(scope="module")
def small(content):
    """The bytes of a checkpoint without the worlds."""
    return checkpoint_bytes(inference_only(content))


@pytest.fixture
def folder(trained, tmp_path):
    """A run folder to break."""
    return RunFolder(shutil.copytree(trained.path, tmp_path / "run"))


def without_seal(data):
    """The archive as an older simwarp wrote it."""
    return data[:-81] + b"\0\0"


def loads(path, data):
    path.write_bytes(data)
    try:
        load_checkpoint(path)
    except InputError:
        return False
    return True


def equal(left, right):
    if isinstance(left, torch.Tensor):
        return left.dtype == right.dtype and torch.equal(left, right)
    if isinstance(left, dict):
        return left.keys() == right.keys() and all(equal(left[key], right[key]) for key in left)
    return left == right


def test_no_flipped_bit_goes_unseen(tmp_path, small):
    chance = random.Random(13)
    # The end, with the directory of the archive and the seal, bit by bit; the rest by chance
    end = range(8 * (len(small) - 110), 8 * len(small))
    for bit in (*end, *chance.sample(range(8 * len(small)), 400)):
        data = bytearray(small)
        data[bit // 8] ^= 1 << bit % 8
        assert not loads(tmp_path / "flipped.pt", data), bit


def test_no_missing_or_added_byte_goes_unseen(tmp_path, small):
    lengths = (1, 2, 22, 64, 78, 79, 80, 81, 82, 101, len(small) // 2)
    for length in lengths:
        assert not loads(tmp_path / "short.pt", small[:-length]), length
        assert not loads(tmp_path / "long.pt", small + small[-length:]), length
    assert not loads(tmp_path / "long.pt", small + b"\0")


def test_other_programs_read_it_as_before(tmp_path, small, content):
    archive = zipfile.ZipFile(io.BytesIO(small))
    assert archive.testzip() is None
    assert archive.comment.startswith(b"simwarp sha256 ")
    assert equal(torch.load(io.BytesIO(small), weights_only=True), inference_only(content))


def test_a_checkpoint_of_before_loads_and_says_once_that_it_has_no_checksum(tmp_path, small, content, capfd):
    path = tmp_path / "old.pt"
    path.write_bytes(without_seal(small))
    assert sealed(path.read_bytes()) == small
    for _ in range(2):
        assert equal(load_checkpoint(path), inference_only(content))
    err = capfd.readouterr().err
    assert err.count("\n") == 1
    assert f"{path} carries no checksum" in err
    load_checkpoint(SHIPPED / "pendulum.pt")
    assert capfd.readouterr().err == ""


def test_damaged_numbers_of_one_of_before_are_seen(tmp_path, small):
    data = bytearray(without_seal(small))
    weights = data.index(torch.load(io.BytesIO(small))["actor_state_dict"]["mlp.0.weight"].numpy().tobytes())
    data[weights + 5] ^= 4
    path = tmp_path / "old.pt"
    path.write_bytes(data)
    with pytest.raises(InputError, match="damaged: its records"):
        load_checkpoint(path)


def test_an_archive_that_unpacks_to_more_than_it_has_is_refused(tmp_path, small):
    path = tmp_path / "bomb.pt"
    with zipfile.ZipFile(io.BytesIO(small)) as source, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as target:
        for item in source.infolist():
            target.writestr(item.filename, bytes(10**7) if item.filename.endswith("/data/0") else source.read(item))
    with pytest.raises(InputError, match="damaged: its records"):
        load_checkpoint(path)


def test_shipped_policies_have_their_checksum():
    files = sorted(SHIPPED.glob("*.pt"))
    assert len(files) >= 10
    for path in files:
        assert path.read_bytes()[-79:-64] == b"simwarp sha256 "
        load_checkpoint(path)


@pytest.mark.parametrize("name", ["train", "eval", "play", "record", "export"])
def test_a_broken_newest_checkpoint_names_the_newest_good_one(folder, tmp_path, capfd, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    newest, older, oldest = reversed(folder.checkpoint_files())
    newest.write_bytes(newest.read_bytes()[:-1])
    older.write_bytes(b"")
    arguments = {
        "train": ["fast", "--resume", str(folder.path), "--iterations", "9"],
        "export": [str(folder.path)],
    }.get(name, ["fast", "--checkpoint", str(folder.path)])
    assert cli.main([name, *arguments]) == 2
    err = capfd.readouterr().err
    assert err.count("\n") == 1
    assert f"{newest} is truncated" in err
    assert f"the newest good one is {oldest}: move the damaged one away" in err
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_doing_what_the_error_says_goes_on_from_there(folder):
    for path in folder.checkpoint_files()[1:]:
        path.write_bytes(b"torn")
    with pytest.raises(InputError, match="move the damaged one away"):
        run(folder.path.parent, resume=folder.path, iterations=4)
    for path in folder.checkpoint_files()[1:]:
        path.unlink()
    run(folder.path.parent, resume=folder.path, iterations=4)
    assert [path.stem for path in folder.checkpoint_files()] == [f"iteration_{n:06d}" for n in (1, 2, 3, 4)]


WRONG: list = [
    None, True, -1, 10**30, 1e308, float("nan"), "x" * 3000, [], {}, torch.zeros(0), torch.zeros(2, 3, 4),
    torch.zeros(1).expand(10**6, 10**5), torch.tensor(0),
]  # fmt: skip


@pytest.mark.quick("actor_state_dict", "format", "task_config")
@pytest.mark.parametrize("key", ["format", "task", "iteration", "train_config", "task_config", "actor_state_dict"])
def test_no_wrong_type_of_what_every_checkpoint_has_gets_far(folder, content, capfd, key):
    path = folder.latest_checkpoint()
    for value in WRONG:
        if key.endswith("config") and isinstance(value, dict):
            continue  # fields that are left away have their defaults
        save_checkpoint(path, content | {key: value})
        for arguments in (["eval", "fast", "--checkpoint", str(path), "--episodes", "1"], ["export", str(path)]):
            code = cli.main(arguments)
            err = capfd.readouterr().err
            assert (code, err.count("\n")) == (2, 1), (value, err)
            assert len(err) < 900


def places(value, path=()):
    """Where something stands within nested values."""
    if path:
        yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from places(item, (*path, key))


def changed(content, path, value):
    content = copy.deepcopy(content)
    owner = content
    for key in path[:-1]:
        owner = owner[key]
    if value is places:
        del owner[path[-1]]
    else:
        owner[path[-1]] = value
    return content


TRAINING = ("critic_state_dict", "optimizer_state_dict", "torch_rng", "cuda_rng", "worlds", "memories", "window")


def may_be(content, place, value):
    """Whether a value may stand there: the one that does, one that older checkpoints lack, that of other worlds."""
    there = content
    for key in place:
        there = there[key]
    if place == ("window",) and (value == [] or (isinstance(value, torch.Tensor) and not value.numel())):
        return True  # no episodes that are remembered: the means begin anew
    if isinstance(value, torch.Tensor):
        return place == ("worlds", "episode_index") and value.dim() == 1
    if value is places or value in ([], {}):
        return place[0] == "memories" or place[:2] in (("optimizer_state_dict", "state"), ("worlds", "extra"))
    return type(value) is type(there) and value == there


@pytest.mark.quick("mlp")
@pytest.mark.parametrize("kind", ["mlp", "recurrent"])
def test_no_wrong_type_of_what_a_resumed_run_needs_gets_far(tmp_path, kind):
    options = {"network.kind": kind, "network.memory": 4, "ppo.mini_batches": 2, "network.hidden": (8,)}
    folder = run(tmp_path, **options)
    path = folder.latest_checkpoint()
    content = load_checkpoint(path)
    chance = random.Random(5)
    found = [place for place in places(content) if place[0] in TRAINING]
    for place in chance.sample(found, 60):
        value = chance.choice([*WRONG, places])
        if may_be(content, place, value):
            continue
        save_checkpoint(path, changed(content, place, value))
        with pytest.raises(InputError) as caught:
            run(tmp_path, resume=folder.path, iterations=4, **options)
        assert len(str(caught.value)) < 900, place
        assert "\n" not in str(caught.value), place


@pytest.mark.parametrize("key", ["torch_rng", "cuda_rng", "worlds", "window", "critic_state_dict"])
def test_what_is_missing_is_named(folder, content, key):
    save_checkpoint(folder.latest_checkpoint(), {name: item for name, item in content.items() if name != key})
    with pytest.raises(InputError, match=f"no '{key}'|holds only a policy"):
        run(folder.path.parent, resume=folder.path, iterations=4)
