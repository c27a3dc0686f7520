"""Binary files: checkpoints, trajectories, dumps of broken worlds, snapshots; with flipped bits, and wrong inside."""

import copy
import io
import json
import pickle
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from hypothesis import strategies as st

from tests.campaign.hostile import ACCEPT, EITHER, REFUSE, Value, Verdict, either, refused, shorten
from tests.campaign.oracle import CallAttack, CommandAttack
from tests.campaign.strategies_commands import SHORT, TRAINING
from tests.campaign.strategies_json import at, hostile_like, places, spoiled


class Changed(NamedTuple):
    """The bytes of a spoiled file, what was done, and whether it must be refused."""

    data: bytes
    how: str
    verdict: Verdict


# ---- bytes -----------------------------------------------------------------------------------------------------------


class _Payload:
    """Makes a folder if somebody lets a pickle run code."""

    def __reduce__(self) -> Any:
        import os

        return os.mkdir, ("code-was-run",)


def _zip(members: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(name, data)
    return buffer.getvalue()


def _header_of(shape: str) -> bytes:
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


def _other_files() -> list[bytes]:
    array = io.BytesIO()
    np.save(array, np.zeros(3))
    objects = io.BytesIO()
    np.savez(objects, actions=np.array([_Payload()], dtype=object), meta=np.array("{}"), about=np.array("{}"))
    huge = _header_of("(1000000000000000,)")
    bomb = _zip(
        {"actions.npy": huge + bytes(2**20), "meta.npy": huge, "about.npy": huge, "archive/data.pkl": bytes(2**24)}
    )
    return [
        b"",
        b"\0",
        bytes(100),
        b"text\n",
        array.getvalue(),
        objects.getvalue(),
        pickle.dumps(_Payload()),
        bomb,
        pickle.dumps({"format": 1, "task": _Payload()}, protocol=2),
        _zip({}),
        _zip({"../../escaped": b"x"}),
        _zip({"archive/data.pkl": pickle.dumps(_Payload()), "archive/version": b"3\n", "archive/byteorder": b"little"}),
    ]


OTHER_FILES = _other_files()
"""Files of other kinds, some of them meant to harm."""


@st.composite
def spoiled_bytes(draw: st.DrawFn, data: bytes, sealed: bool = True) -> Changed:
    """A file with a few bits flipped, cut, overwritten, or another one altogether.

    Args:
        data: the good file.
        sealed: whether a checksum covers every byte of it: without one, only what changes nothing may be accepted.
    """
    how = draw(st.sampled_from(("flip", "flip", "flip", "cut", "zero", "other", "more")))
    verdict = REFUSE if sealed else EITHER
    if how == "other":
        other = draw(st.sampled_from(OTHER_FILES))
        return Changed(other, f"another file, of {len(other)} bytes: {shorten(other, 60)}", REFUSE)
    place = draw(st.integers(0, len(data) - 1))
    if how == "cut":
        return Changed(data[:place], f"cut after byte {place}", REFUSE)
    if how == "more":
        return Changed(data + b"\0" * 10, "ten bytes more", EITHER)
    changed = bytearray(data)
    if how == "zero":
        changed[place : place + 64] = bytes(len(changed[place : place + 64]))
    else:
        changed[place] ^= 1 << draw(st.integers(0, 7))
    same = bytes(changed) == data
    return Changed(bytes(changed), f"{how} at byte {place}: {changed[place]:02x}", EITHER if same else verdict)


def byte_attacks(
    kind: str,
    data: bytes,
    read: Callable[[Path], Any],
    same: Callable[[Any, Any], bool],
    folder: Path,
    sealed: bool = False,
) -> st.SearchStrategy[CallAttack]:
    """Spoiled copies for a reader; one that is accepted must hold what the good file does."""
    path = folder / f"attacked{kind}"
    path.write_bytes(data)
    good = read(path)

    def attack(made: Changed) -> CallAttack:
        def call() -> None:
            path.write_bytes(made.data)
            assert same(good, read(path)), "accepted, but the content is another one"
            assert not Path("code-was-run").exists()

        return CallAttack(f"{kind}: {made.how}", made.verdict, (path.name,), call)

    return spoiled_bytes(data, sealed).map(attack)


def equal(left: Any, right: Any) -> bool:
    """Whether two nested values are equal, bit by bit."""
    if isinstance(left, dict) or isinstance(right, dict):
        return left.keys() == right.keys() and all(equal(left[key], right[key]) for key in left)
    if isinstance(left, list | tuple):
        return len(left) == len(right) and all(equal(*pair) for pair in zip(left, right, strict=True))
    if isinstance(left, torch.Tensor):
        left, right = left.numpy(), right.numpy()
    if isinstance(left, np.ndarray):
        return left.dtype == right.dtype and left.shape == right.shape and left.tobytes() == right.tobytes()
    return bool(left == right)


# ---- checkpoints: whole files that are wrong inside ------------------------------------------------------------------

USES = (
    ("eval", "fast", "--checkpoint=attacked.pt", "--episodes=2", "--no-baselines", "=".join(SHORT)),
    ("export", "attacked.pt", "--format=torchscript", "--output=out.ts"),
    ("train", "fast", *(f"{a}={b}" for a, b in TRAINING), "--warm-start=attacked.pt"),
)
"""What reads a checkpoint and is quick about it."""

READ_BY_ALL = {"task", "task_config", "train_config", "actor_state_dict"}


def _hostile_tensor(old: torch.Tensor) -> st.SearchStrategy[Value]:
    wrong: list[Any] = [None, "x", 3, [], {}, old.new_zeros((*old.shape, 2)), torch.zeros(7, 7, 7)]
    broken = [
        torch.full_like(old, float("nan")) if old.is_floating_point() else old - 5,
        old.to(torch.int64),
        old.double(),
        old.to(torch.complex64),
    ]
    return st.sampled_from([*refused(*wrong), *either(*broken)])


@st.composite
def spoiled_checkpoints(draw: st.DrawFn, content: dict[str, Any], save: Callable[[dict[str, Any]], bytes]) -> Changed:
    """A checkpoint whose checksum is right and whose content is not."""
    value = copy.deepcopy(content)
    top = draw(st.sampled_from(sorted(READ_BY_ALL)))
    path = draw(st.sampled_from([path for path in places(content) if path[0] == top]))
    owner, key = at(value, path[:-1]), path[-1]
    words = ".".join(map(str, path))
    if draw(st.integers(0, 4)) == 0:
        del owner[key]
        needed = len(path) == 1 or path[0] == "actor_state_dict"
        return Changed(save(value), f"{words} left out", REFUSE if needed else EITHER)
    old = owner[key]
    new, verdict = draw(_hostile_tensor(old) if isinstance(old, torch.Tensor) else hostile_like(old))
    owner[key] = new
    return Changed(save(value), f"{words} = {shorten(new)}", verdict)


@st.composite
def checkpoint_commands(
    draw: st.DrawFn, content: dict[str, Any], save: Callable[[dict[str, Any]], bytes]
) -> CommandAttack:
    """Something that reads a checkpoint, given one that is wrong inside."""
    made, words = draw(spoiled_checkpoints(content, save)), draw(st.sampled_from(USES))
    if words[0] == "train" and made.how.startswith("task_config"):
        made = made._replace(verdict=EITHER)  # a warm start takes the networks alone
    return _command(words, "attacked.pt", made)


def _command(words: tuple[str, ...], name: str, made: Changed) -> CommandAttack:
    what = f"simwarp {' '.join(words)}  where {name} has {made.how}"
    return CommandAttack(what, made.verdict, (name, "task", *_fields(made.how)), words, ((name, made.data),))


def _fields(how: str) -> tuple[str, ...]:
    """The names of a place such as task_config.curriculum.up: an error may name the last ones."""
    place = how.partition(" ")[0]
    return tuple(part for part in place.replace("/", ".").split(".") if not part.isdigit() and len(part) > 1)


# ---- arrays ----------------------------------------------------------------------------------------------------------


def save_arrays(arrays: dict[str, Any]) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def _spoil_array(old: np.ndarray) -> list[Value]:
    """Arrays that cannot stand in the place of another."""
    longer = np.concatenate([old, old]) if old.ndim else np.zeros(2)
    wrong = [
        longer,
        np.array("x"),
        np.full(old.shape, "x"),
        np.zeros((*old.shape, 2)),
        old[:0] if old.ndim else np.zeros(0),
        np.full(old.shape, 1j),
    ]
    return refused(*wrong)


def _column_values(name: str, old: np.ndarray) -> list[Value]:
    """What is wrong in a column of trajectories."""
    found = _spoil_array(old)
    rows = len(old)
    if name.startswith("observations/"):
        found += refused(np.full(old.shape, np.nan), np.full(old.shape, np.inf), np.full(old.shape, 1e300), old[:, :1])
    if name == "actions":
        found += refused(old + 3.0, np.full(old.shape, np.nan), old[:, :1], np.full(old.shape, -np.inf))
    if name == "rewards":
        found += refused(np.full(old.shape, np.nan), np.full(old.shape, np.inf), np.full(old.shape, 1e300))
    if name == "episode":
        found += refused(
            old[::-1].copy(), old - 1, np.full(rows, 10**9), np.full(rows, 2**62), old + 0.5, np.full(rows, np.nan)
        )
    return found


@st.composite
def spoiled_trajectories(draw: st.DrawFn, arrays: dict[str, np.ndarray]) -> Changed:
    """Trajectories with a column left out or wrong, or with words about them that are."""
    name = draw(st.sampled_from(sorted(arrays)))
    changed = dict(arrays)
    if draw(st.integers(0, 9)) == 0:
        del changed[name]
        return Changed(save_arrays(changed), f"{name} left out", REFUSE)
    if name == "about":
        return draw(_spoiled_words(arrays, name, {"format", "task", "task_config"}))
    value, verdict = draw(st.sampled_from(_column_values(name, arrays[name])))
    changed[name] = value
    return Changed(save_arrays(changed), f"{name} = {shorten(value)} of {value.shape}", verdict)


@st.composite
def _spoiled_words(draw: st.DrawFn, arrays: dict[str, np.ndarray], name: str, needed: set[str]) -> Changed:
    """The JSON text of a file of arrays, spoiled."""
    made = draw(spoiled(json.loads(str(arrays[name]))))
    text = made.data.decode("utf-8", "surrogateescape").replace("\0", "\ue000")  # an array cannot end in NUL
    place = made.how.partition(" ")[0].split(".")[0]
    kept = made.verdict if place in needed or made.anywhere else EITHER
    how = f"{name}: {made.how}"
    if "byte order mark" in how or "\udcff" in text or "\ue000" in text:
        # such bytes have no place in an array of text: what takes it may stand in any string
        text, kept = text.encode("utf-8", "replace").decode(), EITHER
    return Changed(save_arrays({**arrays, name: np.array(text)}), how.replace(f"{name}: ", ""), kept)


@st.composite
def trajectory_commands(draw: st.DrawFn, arrays: dict[str, np.ndarray]) -> CommandAttack:
    """`clone` of trajectories that are wrong inside."""
    words = ("clone", "fast", "--data=attacked.npz", "--epochs=1")
    return _command(words, "attacked.npz", draw(spoiled_trajectories(arrays)))


META = {"format", "task", "config", "seed", "world", "episode", "episode_steps", "replay_steps", "from_reset"}


@st.composite
def dump_commands(draw: st.DrawFn, arrays: dict[str, np.ndarray]) -> CommandAttack:
    """`replay` of dumps that are wrong inside."""
    name = draw(st.sampled_from(("meta", "meta", "actions", "joint_q", "joint_qd")))
    changed = dict(arrays)
    if name == "meta":
        made = draw(_spoiled_words(arrays, name, META))
        if made.how.startswith("config.guard_steps"):
            made = made._replace(verdict=EITHER)  # a replay keeps none
    elif draw(st.integers(0, 5)) == 0:
        del changed[name]
        made = Changed(save_arrays(changed), f"{name} left out", REFUSE)
    else:
        value, verdict = draw(st.sampled_from(_spoil_array(arrays[name])))
        if value.shape[1:] == arrays[name].shape[1:] and len(value) > len(arrays[name]):
            verdict = EITHER  # the last rows count
        made = Changed(save_arrays(changed | {name: value}), f"{name} = {shorten(value)} of {value.shape}", verdict)
    return _command(("replay", "attacked.npz"), "attacked.npz", made)


# ---- run folders -----------------------------------------------------------------------------------------------------

RESUME = ("train", "fast", *(f"{a}={b}" for a, b in TRAINING if a != "--iterations"), "--iterations=3", "--resume=run")
RUN_USES = (
    RESUME,
    ("eval", "fast", "--checkpoint=run", "--episodes=2", "--no-baselines", "=".join(SHORT)),
    ("export", "run", "--format=torchscript", "--output=out.ts"),
)
LOGS = [
    b"",
    b"\xff\xfe\0",
    b"iteration\n",
    b"iteration,mean_reward\nx,y\n",
    b"iteration\n999999999999999999999\n",
    b"\0" * 50,
    b"a,b\n1,2,3\n,,,\n",
    b'iteration\n"1',
    b"iteration\n-5\n1e3\nnan\n",
    b"iteration\n" + b"9" * 5000,
]
"""What may stand in progress.csv: a log never stops a resume."""


@st.composite
def run_commands(draw: st.DrawFn, run: Path) -> CommandAttack:
    """A command that reads a run folder of which one file is damaged."""
    files = {
        f"run/{path.relative_to(run)}": path.read_bytes()
        for path in run.rglob("*")
        if path.suffix in (".json", ".csv", ".pt")
    }
    words = draw(st.sampled_from(RUN_USES))
    what = draw(
        st.sampled_from(("config", "config", "config", "provenance", "progress", "checkpoint", "checkpoint", "gone"))
    )
    newest = max(name for name in files if name.endswith(".pt"))
    if what in ("config", "provenance"):
        name = f"run/{what}.json"
        made = draw(spoiled(json.loads(files[name])))
        files[name] = made.data
        added = made.how.startswith("a key beside") and "." not in made.how
        verdict, how = (made.verdict if what == "config" and not added else EITHER), made.how
    elif what == "progress":
        name, verdict = "run/progress.csv", ACCEPT
        files[name] = draw(st.sampled_from(LOGS))
        how = shorten(files[name], 60)
    elif what == "checkpoint":
        made_bytes = draw(spoiled_bytes(files[newest]))
        name, how, verdict = newest, made_bytes.how, made_bytes.verdict
        files[name] = made_bytes.data
    else:
        name = draw(st.sampled_from(("run/config.json", "run/provenance.json", newest)))
        del files[name]
        how, verdict = "left out", REFUSE if name == "run/config.json" else EITHER
    names = (name.rpartition("/")[2], "run", *_fields(how))
    text = f"simwarp {' '.join(words)}  where {name} has {how}"
    return CommandAttack(text, verdict, names, words, tuple(sorted(files.items())))
