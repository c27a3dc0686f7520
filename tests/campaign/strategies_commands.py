"""Command lines: every option of every command, found by asking, with hostile values; and lines that are odd."""

import dataclasses
import enum
import functools
import typing
from pathlib import Path
from typing import Any, NamedTuple

from hypothesis import strategies as st

from simwarp.cli import COMMANDS
from tests.campaign.hostile import (
    ACCEPT,
    EITHER,
    REFUSE,
    Value,
    deep_json,
    either,
    float_texts,
    integer_texts,
    odd_texts,
    refused,
    shorten,
)
from tests.campaign.options import Option, is_mapping, kinds_of, options_of
from tests.campaign.oracle import CommandAttack


class Base(NamedTuple):
    """A command line that is right and quick.

    Attributes:
        command: its name.
        first: what comes before the options, such as the task.
        options: pairs of option and value that keep it small.
        runs: whether it is run; the others get only what must be refused before anything is built.
    """

    command: str
    first: tuple[str, ...] = ()
    options: tuple[tuple[str, str], ...] = ()
    runs: bool = True

    def words(self, without: str = "") -> tuple[str, ...]:
        """Its arguments, one option left out."""
        kept = [f"{name}={value}" if value else name for name, value in self.options if name != without]
        return (self.command, *self.first, *kept)


TRAINING = (
    ("--num-envs", "4"),
    ("--steps-per-iteration", "4"),
    ("--iterations", "1"),
    ("--device", "cpu"),
    ("--ppo.epochs", "1"),
)
POLICY = ("--checkpoint", "good/fast.pt")
SHORT = ("--task.max-episode-steps", "4")
BASES = (
    Base("list"),
    Base("completions", ("bash",)),
    Base("train", ("fast",), TRAINING),
    Base("train", ("pendulum",), TRAINING),
    Base("distill", ("fast",), (("--teacher", "good/fast.pt"), *TRAINING[:-1])),
    Base("eval", ("fast",), (POLICY, ("--episodes", "2"), ("--no-baselines", ""), SHORT)),
    Base("play", ("fast",), (POLICY, ("--seconds", "0.01"), ("--num-envs", "1"))),
    Base("record", ("fast",), (POLICY, ("--episodes", "2"), SHORT)),
    Base("record", ("fast",), (POLICY, ("--episodes", "2"), ("--format", "lerobot"), SHORT)),
    Base("record", ("fast",), (POLICY, ("--episodes", "2"), ("--format", "minari"), SHORT)),
    Base("clone", ("fast",), (("--data", "good/fast.npz"), ("--epochs", "1"))),
    Base("export", ("good/fast.pt",), (("--format", "torchscript"), ("--output", "out.ts"))),
    Base("new-task", ("my-arm",)),
    Base("import", ("good/arm.urdf",), (("--base", "fixed"),)),
    Base("replay", ("good/broken.npz",)),
    Base("bench", ("pendulum",), (("--worlds", "1"), ("--seconds", "0.02"))),
    Base("verify", ("free-spin",)),
    Base("doctor"),
    Base("drive", ("sedan",), (("--maneuver", "good/short.csv"), ("--dt", "0.01")), runs=False),
    Base("drive", ("sedan",), (("--maneuver", "constant-radius"),), runs=False),
    Base("drive", ("sedan",), (("--maneuver", "reference-accel"), ("--road", "iso8608:C:1")), runs=False),
    Base("fit", ("good/fit.toml",), (("--iterations", "1"),), runs=False),
    Base("trim", ("sedan",), (("--ride-height", "design"), ("--toe", "0.1")), runs=False),
    Base("export-fmu", ("sedan",), (("--dt", "0.002"), ("--output", "sedan.fmu")), runs=False),
    Base("reduce", ("sedan",), (("--rows", "3"), ("--columns", "3"), ("--output", "reduced.json")), runs=False),
    Base("rig", ("steering", "sedan"), (("--points", "5"), ("--device", "cpu"))),
    Base("rig", ("tire", "sedan"), (("--points", "5"), ("--loads", "4000")), runs=False),
    Base("rig", ("suspension", "sedan"), (("--points", "5"),), runs=False),
    Base("rig", ("full-car", "sedan"), (("--points", "5"),), runs=False),
    Base("view", ("four-bar",), (("--worlds", "1"), ("--seconds", "0.1")), runs=False),
    Base("ros2", ("four-bar",), (("--seconds", "0.1"), ("--real-time-factor", "0")), runs=False),
    Base("ros2", ("gator",), (("--lock-step", ""), ("--wait-timeout", "0.1")), runs=False),
    Base("sensor-demo", runs=False),
    Base("sweep", ("fast",), (("--seeds", "0-1"), ("--iterations", "1")), runs=False),
    *(Base("train", (task,), TRAINING, runs=False) for task in ("ant", "hexapod", "off-road", "hallway", "convoy")),
    *(Base("eval", (task,), (("--episodes", "2"),), runs=False) for task in ("ant", "off-road", "pendulum")),
)
UNKNOWN = tuple(Base(name, runs=False) for name in COMMANDS if name not in {base.command for base in BASES})
"""Commands that came later: nothing is known of their arguments."""

NOT_RUN = {"--compile", "--peers"}
"""Flags that take minutes."""

FOLDERS = {("eval", "plot"), ("verify", "plots"), ("new-task", "output"), ("sweep", "out")}
ENDINGS = {
    "json": "",
    "video": ".gif",
    "html": ".html",
    ("view", "record"): ".html",
    "csv": ".csv",
    "plot": ".png",
    "out": ".png",
    ("sensor-demo", "data"): ".npz",
    ("record", "output"): ".npz",
    ("clone", "output"): ".pt",
    ("export", "output"): ".ts",
    ("trim", "output"): ".json",
    ("reduce", "output"): ".json",
    ("export-fmu", "output"): ".fmu",
}
"""Options that name a file to write, and its ending."""

INPUTS = {"checkpoint", "resume", "warm-start", "data", "reference"}
ONE_OF_SOME = {"device", "tire", "powertrain", "driveline", "maneuver", "obs"}
"""Texts that must name something there is."""

SIZES = {
    "num-envs",
    "worlds",
    "panel",
    "steps-per-iteration",
    "hidden",
    "guard-steps",
    "substeps",
    "decimation",
    "action-delay",
    "camera-width",
    "camera-height",
    "obstacles",
    "max-episode-steps",
}
"""Whole numbers that something is allocated or repeated by: 10**15 of them fit nowhere."""

TIMES = {"seconds", "duration"}

BAD_NAMES = [
    "",
    "folder",
    "missing/x",
    "notes.txt/x",
    "a" * 256,
    "ü" * 200,
    "a" * 5000,
    "../",
    ".",
    "/",
    "x\0y",
    "\ud800",
]
BAD_INPUTS = [
    "",
    "missing",
    "folder",
    "notes.txt",
    "notes.txt/x",
    "null",
    "pipe",
    "dangling",
    "a" * 256,
    "a" * 5000,
    "x\0y",
    "\ud800",
    "\udcff",
    "good/short.csv",
    "../",
    "/",
    "~",
]
BAD_MAPPINGS = [
    "",
    "x",
    "[]",
    "1",
    "null",
    "true",
    "NaN",
    "{",
    '{"a"}',
    "'",
    '{"no_such_thing": {"low": 1, "high": 2}}',
    '{"body_mass": null}',
    '{"body_mass": 3}',
    '{"body_mass": []}',
    '{"body_mass": {}}',
    '{"body_mass": {"low": 1}}',
    '{"body_mass": {"low": NaN, "high": 1}}',
    '{"body_mass": {"low": 0, "high": Infinity}}',
    '{"policy": {"noise": -1}}',
    '{"body_mass": {"low": 2, "high": 1}}',
    '{"body_mass": {"low": "1", "high": 2}}',
    '{"body_mass": {"lo": 1}}',
    '{"body_mass": {"low": 0, "high": 1e39}}',
    '{"body_mass": {"low": 0, "high": 1e308}}',
    '{"policy": {"noise": 1e39}}',
    f'{{"body_mass": {{"low": 0, "high": {"9" * 400}}}}}',
    '{"policy": {"delay": [0, 1e3]}}',
    '{"policy": {"noise": "x"}}',
    '{"policy": {"delay": [0, 1000000000000000]}}',
    '{"policy": {"delay": null}}',
    '{"policy": {"noise": null}}',
    '{"body_mass": {"low": 1, "low": 1, "high": 1}}',
    deep_json(),
    deep_json('{"a":', "}"),
    f'{{"a": {deep_json()}}}',
    '{"body_mass": {"low": 1, "high": 2, "mode": "x"}}',
    '{"body_mass": {"low": 1, "high": 2, "only": [3]}}',
    '{"body_mass": {"low": 1, "high": 2, "only": ["nobody"]}}',
    '{"body_mass": {"low": 1, "high": 2, "when": []}}',
]
BAD_GRIDS = [
    "",
    "=",
    "x",
    "=1",
    "gain=",
    "gain",
    "gain=nan",
    "gain=x",
    "gain=1,1",
    "gain=1,,2",
    "no-such=1",
    "randomise={}",
    "randomise=1",
    "sensing=[]",
    "gain=1e39",
    "gain=" + "9" * 400,
    "max-episode-steps=1.5",
    "action-delay=0",
    "curriculum=1",
    "curriculum.up=x",
    "\ud800=1",
    "gain=\udcff",
    "gain.x=1",
    ".",
]
BAD_COUNTS = ["", "x", "1,", ",", "1.5", "nan", "-1", "0", "1,0", "9" * 400, str(10**20), str(10**15), "1;2", "\ud800"]


def values_of(base: Base, option: Option) -> st.SearchStrategy[tuple[Value, ...]]:
    """Words for an option: usually one, several for a tuple."""
    kinds = kinds_of(option)
    kind = kinds[0] if len(kinds) == 1 else next((item for item in kinds if item in (int, float)), kinds[0])
    if typing.get_origin(kind) is tuple and option.word != "grid":
        return _tuple_values(kind, option)
    # an option that may be left out takes the word None
    fits = _one_value(base, option, kind).filter(lambda value: value.value != "None" or kinds == (option.kind,))
    return fits.map(lambda value: (value,))


def _one_value(base: Base, option: Option, kind: Any) -> st.SearchStrategy[Value]:
    if option.word == "grid":
        return st.sampled_from(refused(*BAD_GRIDS))
    if (base.command, option.word) == ("bench", "worlds"):
        return st.sampled_from(refused(*BAD_COUNTS))
    if is_mapping(kind):
        return st.sampled_from([*refused(*BAD_MAPPINGS), Value("{}", EITHER)])
    if kind is bool:
        return odd_texts.map(lambda text: Value(text, REFUSE))
    if kind is int:
        return _sized(option, integer_texts)
    if kind is float:
        return st.one_of(float_texts, st.just(Value("1e30", REFUSE))) if option.word in TIMES else float_texts
    if (isinstance(kind, type) and issubclass(kind, enum.Enum)) or typing.get_origin(kind) is typing.Literal:
        return odd_texts.map(lambda text: Value(text, REFUSE))
    return _text_values(base, option)


def _sized(option: Option, texts: st.SearchStrategy[Value]) -> st.SearchStrategy[Value]:
    large = st.integers(10**15, 10**18).map(lambda number: Value(str(number), REFUSE))
    return st.one_of(texts, large) if option.word in SIZES else texts


def _tuple_values(kind: Any, option: Option) -> st.SearchStrategy[tuple[Value, ...]]:
    """One hostile item, or a wrong number of them."""
    items = typing.get_args(kind)
    if items[0] is str:  # any word will do, or none of this kind of target
        return odd_texts.map(lambda text: (Value("1", EITHER), Value(text, EITHER)))
    texts = integer_texts if items[0] is int else float_texts
    one = _sized(option, texts)
    if Ellipsis in items:
        return st.one_of(one.map(lambda value: (value,)), one.map(lambda value: (Value("1", ACCEPT), value)))
    good = tuple(Value("1", ACCEPT) for _ in items)
    wrong = st.sampled_from([good[:-1], (*good, good[0])]).map(
        lambda words: tuple(Value(text, REFUSE) for text, _ in words)
    )
    spoiled = st.builds(
        lambda value, place: (*good[:place], value, *good[place + 1 :]), one, st.integers(0, len(good) - 1)
    )
    return st.one_of(wrong, spoiled)


def _text_values(base: Base, option: Option) -> st.SearchStrategy[Value]:
    key = (base.command, option.word)
    if key in FOLDERS or (key == ("record", "output") and "--format" in dict(base.options)):
        bad = [name for name in BAD_NAMES if name not in ("folder", "../", ".", "/", "missing/x")]
        return st.sampled_from([*refused(*bad, "notes.txt", "pipe"), Value("new-folder", EITHER)])
    ending = ENDINGS.get(key, ENDINGS.get(option.word))
    if ending is not None and not (option.word == "data" and key not in ENDINGS):
        bad = [name + ending if name not in ("", "../", ".", "/", "folder") else name for name in BAD_NAMES]
        good = either(*(f"{name}{ending}" for name in ("new", "notes", "null", "link", "dangling", "full")))
        return st.sampled_from([*refused(*bad, *(["wrong.zzz"] if ending not in ("", ".csv", ".pt") else [])), *good])
    if option.word in INPUTS:
        return st.one_of(st.sampled_from(refused(*BAD_INPUTS)), odd_texts.map(lambda text: Value(text, REFUSE)))
    if option.word in ONE_OF_SOME:
        bad = [
            "cuda:99",
            "cpu:-1",
            "cuda:",
            "gpu",
            "meta",
            "cuda:99999999999999999999",
            "missing.json",
            "notes.txt",
            "null",
        ]
        return st.one_of(st.sampled_from(refused(*bad)), odd_texts.map(lambda text: Value(text, REFUSE)))
    return odd_texts.map(lambda text: Value(text, EITHER))


def outputs_of(word: str) -> tuple[str, ...]:
    """Bystanders that a command may write to when it is told so: the file, or what the link leads to."""
    stem, _, ending = word.partition(".")
    return (
        (word, f"notes.{ending}" if ending else "notes.txt")
        if stem in ("notes", "link", "dangling", "null", "full")
        else ()
    )


@functools.cache
def all_options() -> tuple[tuple[Base, Option], ...]:
    """Every option of every line; those of the lines that are run twice, so that each command has its share."""
    pairs = [
        (base, option)
        for base in (*BASES, *(base for base in BASES if base.runs), *UNKNOWN)
        for option in options_of(base.command, base.first)
        if option.name not in ("--debug", *NOT_RUN)
    ]
    return tuple(pairs)


@st.composite
def option_attacks(draw: st.DrawFn) -> CommandAttack:
    """A good line with one option gone wrong."""
    base, option = draw(st.sampled_from(all_options()))
    values = draw(values_of(base, option).filter(lambda values: base.runs or any(v.verdict is REFUSE for v in values)))
    words = [value.value for value in values]
    verdicts = {value.verdict for value in values}
    verdict = REFUSE if REFUSE in verdicts else EITHER
    glued = draw(st.booleans()) or words[0].startswith("-")
    spoiled = [f"{option.name}={words[0]}"] if glued and len(words) == 1 else [option.name, *words]
    if kinds_of(option) == (bool,):
        spoiled = [f"{option.name}={words[0]}"]
    line = (*base.words(option.name), *spoiled)
    return CommandAttack(
        f"simwarp {' '.join(shorten(word) for word in line)}",
        verdict,
        names_of(option, words),
        line,
        outputs=outputs_of(words[0]),
    )


def names_of(option: Option, words: list[str]) -> tuple[str, ...]:
    """What an error may call an option: itself, the one it belongs to, the key of a grid, the value."""
    parts = [part for part in option.name.lstrip("-").split(".") if part not in ("task", "ppo", "network")]
    keys = [word.partition("=")[0] for word in words] if option.word == "grid" else []
    return (*parts, *keys, *words, *(word.rstrip("/") for word in words))


def _odd(base: Base, *words: str, names: tuple[str, ...] = ()) -> CommandAttack:
    line = (*base.words(), *words)
    return CommandAttack(f"simwarp {' '.join(shorten(word) for word in line)}", REFUSE, names or words, line)


@st.composite
def odd_lines(draw: st.DrawFn) -> CommandAttack:
    """Unknown commands, options and things; missing values; too many words."""
    base = draw(st.sampled_from(BASES))
    text = draw(odd_texts)
    options = options_of(base.command, base.first)
    kind = draw(st.sampled_from(("command", "option", "value", "word", "first")))
    if kind == "command":
        line = (text or "-", *base.words()[1:])
        known = text in COMMANDS or text.startswith("-")
        return CommandAttack(
            f"simwarp {' '.join(map(shorten, line))}", EITHER if known else REFUSE, ("command", text), line
        )
    if kind == "option":
        name = draw(
            st.sampled_from(["--no-such-option", "--seeed=1", "--task.zzz", "--ppo.zzz=1", "-z", "---", "--task="])
        )
        return _odd(base, name, names=(name.partition("=")[0],))
    if kind == "value" and options:
        option = draw(st.sampled_from(options))
        if kinds_of(option) != (bool,) and typing.get_origin(option.kind) is not tuple:
            return _odd(base, option.name, names=(option.word,))
    if kind == "first" and base.first:
        changed = base._replace(first=(text.lstrip("-") or "x",))
        names = (
            base.first[0],
            "task",
            "scene",
            "vehicle",
            "name",
            "run",
            "file",
            "checkpoint",
            *changed.first,
            text.rstrip("/"),
        )
        attack = _odd(changed, names=names)
        return dataclasses.replace(attack, verdict=EITHER) if base.command == "new-task" else attack
    return _odd(base, "surplus", names=("surplus",))


CONTROLS = tuple(
    CommandAttack(f"simwarp {' '.join(line)}", ACCEPT, (), line)
    for base in BASES
    for line in ((*base.words(),), (*base.words(), "--help"))
    if (base.runs and base.command != "doctor") or "--help" in line
)
"""Lines that are right: a program that refuses everything fails too."""


def default_lines() -> list[CommandAttack]:
    """Every option of the quick lines with its own default, written out."""
    lines = []
    for base in (base for base in BASES if base.runs and base.command not in ("doctor", "play", "verify")):
        for option in options_of(base.command, base.first):
            small = dict(base.options).get(option.name)
            default = option.default.value if isinstance(option.default, enum.Enum) else option.default
            if small is None and isinstance(default, (int, float, str, Path)) and not isinstance(default, bool):
                line = (*base.words(), f"{option.name}={default}")
                if option.word not in ("num-envs", "episodes"):
                    lines.append(CommandAttack(f"simwarp {' '.join(line)}", ACCEPT, (), line))
    return lines


def command_lines() -> st.SearchStrategy[CommandAttack]:
    """Mostly hostile; some that are right."""
    hostile = st.one_of(option_attacks(), option_attacks(), option_attacks(), odd_lines())
    right = st.one_of(st.sampled_from(CONTROLS), st.sampled_from(default_lines()))
    return st.integers(0, 19).flatmap(lambda number: right if number == 0 else hostile)
