"""Words of the command line: each is held to its option's type, and whatever is wrong is one line and code 2."""

import dataclasses
import enum
import sys
from pathlib import Path
from typing import Annotated

import pytest
import tyro

from simwarp import cli
from simwarp.cli import UsageError, options
from simwarp.cli.evaluation.grids import grid_points
from simwarp.cli.options import parse_options
from simwarp.tasks import TaskConfig

DEEP = "[" * 100_000 + "]" * 100_000


class Choice(enum.Enum):
    """Words."""

    A = "a"
    B = 2


@dataclasses.dataclass(frozen=True)
class Inner:
    """Nested."""

    count: int = 1


@dataclasses.dataclass(frozen=True)
class Options:
    """One of each type."""

    number: float = 1.0
    maybe: Annotated[float | None, tyro.conf.arg(metavar="m/s")] = None
    count: int = 1
    seed: int = 0
    sizes: tuple[int, ...] = (1,)
    delay: tuple[int, int] = (0, 0)
    several: float | tuple[float, ...] = 0.0
    name: str | None = None
    file: Path | None = None
    flag: bool = False
    unsure: bool | None = None
    choice: Choice = Choice.A
    many: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="TEXT")] = ()
    inner: Inner = dataclasses.field(default_factory=Inner)


def parse(*arguments: str) -> Options:
    return parse_options(Options, list(arguments), "test")


@pytest.mark.parametrize(
    ("arguments", "rule"),
    [
        (["--number", "x"], "--number must be a number, got 'x'"),
        (["--number", "nan"], "--number must be a finite number"),
        (["--number", "-inf"], "--number must be a finite number"),
        (["--number", "1e39"], "--number must be a finite number of at most 3.4e38, got '1e39'"),
        (["--number", "9" * 5000], "got '9999999999999999999999999999999999999999... (5000 characters)'"),
        (["--number", "1e-39"], "--number must be zero, or a number above 1.2e-38"),
        (["--number", "1_000"], "--number must be a number, got '1_000'"),
        (["--number", "٣"], "--number must be a number, got '٣'"),
        (["--maybe", "fast"], "--maybe must be a number [m/s], got 'fast'"),
        (["--maybe", "-1e308"], "--maybe must be a finite number"),
        (["--count", "1.5"], "--count must be a whole number, got '1.5'"),
        (["--count", "2147483648"], "--count must be a whole number from -2147483647 to 2147483647"),
        (["--count", "-" + "9" * 400], "--count must be a whole number from -2147483647 to 2147483647"),
        (["--count", "9" * 5000], "--count must be a whole number from -2147483647 to 2147483647"),
        (["--count", "1_0"], "--count must be a whole number"),
        (["--seed", str(2**63)], "--seed must be a whole number from 0 to 9223372036854775807"),
        (["--seed", "-1"], "--seed must be a whole number from 0 to 9223372036854775807"),
        (["--sizes", "1", str(2**31)], "--sizes must be a whole number from"),
        (["--delay", "0", "1e9"], "--delay must be a whole number, got '1e9'"),
        (["--several", "1", "inf"], "--several must be a finite number"),
        (["--inner.count", "10" * 20], "--inner.count must be a whole number from"),
        (["--inner.count=1x"], "--inner.count must be a whole number, got '1x'"),
        (["--name", "x" * 5000], "--name must be at most 4095 bytes long"),
        (["--file", "x" * 256], "--file must be a path whose names have at most 255 bytes"),
        (["--file", "a/" + "é" * 128 + "/b"], "--file must be a path whose names have at most 255 bytes"),
        (["--file", "x/" * 3000], "--file must be at most 4095 bytes long"),
        (["--count", "1", "--count", "2"], "--count is given twice; give it once"),
        (["--inner.count", "1", "--inner.count=2"], "--inner.count is given twice"),
        (["--count"], "--count"),
        (["--count", "--number", "1"], "--count"),
        (["--choice", "c" * 100_000], "--choice must be one of a, 2, got 'cccc"),
        (["--choice", "B"], "--choice must be one of a, 2, got 'B'"),
        (["--choice"], "--choice"),
        (["--coutn", "1"], "unknown option --coutn; did you mean --count"),
        (["--" + "x" * 100_000], "unknown option --xxxx"),
        (["stray"], "unexpected argument 'stray'"),
        (["--many", "a", "stray"], "stray"),
        (["--"], "unknown option --"),
        (["--flag=--"], "--flag takes no value, got '--'; write --flag alone"),
        (["--flag=a\nb"], "--flag takes no value, got 'a b'"),
        (["--no-flag=True"], "--no-flag takes no value, got 'True'; write --no-flag alone"),
        (["--unsure=--"], "--unsure must be True, False or None, got '--'"),
        (["--unsure", "yes"], "--unsure must be True, False or None, got 'yes'"),
    ],
)
def test_a_word_that_breaks_the_rule_of_its_type_is_named(arguments, rule):
    with pytest.raises(UsageError) as caught:
        parse(*arguments)
    assert rule in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_words_that_keep_the_rules_are_taken():
    found = parse(
        "--number", "-1e-30", "--maybe", "None", "--count=-2147483647", "--seed", str(2**63 - 1), "--sizes", "1", "2",
        "--delay", "0", "3", "--several", "1", "2.5", "--file", "é" * 127, "--name", "None", "--inner.count", "7",
    )  # fmt: skip
    assert found == Options(
        number=-1e-30, maybe=None, count=-2147483647, seed=2**63 - 1, sizes=(1, 2), delay=(0, 3), several=(1.0, 2.5),
        file=Path("é" * 127), inner=Inner(7),
    )  # fmt: skip
    assert parse("--inner.count", "2", "--choice", "2") == Options(inner=Inner(2), choice=Choice.B)


def test_the_last_of_several_flags_counts_and_texts_add_up():
    assert not parse("--flag", "--no-flag").flag
    assert parse("--no-flag", "--flag", "--flag").flag
    assert parse("--many", "a", "--many", "b").many == ("a", "b")


def test_help_works_beside_anything(capsys):
    for arguments in (["--help"], ["--count", "x", "--help"], ["-h", "--bogus", "stray"], ["--count", "--help"]):
        with pytest.raises(SystemExit) as caught:
            parse(*arguments)
        assert not caught.value.code
        assert "--inner.count" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments",
    [
        ["train", "fast", "--resume", "nothing"],
        ["train", "fast", "--obs", "x"],
        ["eval", "fast", "--grid", "randomise={}", ""],
        ["bench", "pendulum", "--obs", "x", "--worlds", "9" * 5000],
        ["drive", "none.json", "--dt", "x"],
        ["verify", "bogus", "--json"],
    ],
)
def test_help_of_a_command_works_beside_anything(capfd, arguments):
    assert cli.main([*arguments, "--help"]) == 0
    out, err = capfd.readouterr()
    assert out.startswith(f"usage: simwarp {arguments[0]}")
    assert "--json" in out
    assert err == ""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["list", ""], "argument 2, after 'list', must not be empty"),
        (["list", "--json", ""], "--json must not be empty"),
        (["list", "--json="], "--json must not be empty"),
        ([""], "argument 1 must not be empty"),
        (["list", "--json", "a\0b"], "--json must not hold a NUL byte"),
        (["list", "\udcff"], "argument 2, after 'list', must be UTF-8 text"),
        (["\udcff"], "argument 1 must be UTF-8 text"),
        (["x" * 100_000], "unknown command 'xxxxx"),
        (["list", *["x"] * 20_000], "unexpected argument 'x'"),
        (["list", *["--bogus"] * 3000], "unknown option --bogus"),
        (["list", DEEP], "unexpected argument"),
        (["drive", "gator", "--worlds", "9" * 5000], "--worlds must be a whole number from"),
        (["drive", "gator", "--device", "cuda:" + "9" * 400], "is not available"),
        (["drive", "x" * 5000 + ".json"], "cannot be read"),
        (["bench", "x" * 100_000], "unknown scene 'xxxx"),
        (["bench", "pendulum", "--worlds", "9" * 5000], "--worlds must be at most 4095 bytes long"),
        (["bench", "pendulum", "--worlds", "9" * 400], "worlds must be whole numbers"),
        (["bench", "pendulum", "--worlds", str(10**12)], "use fewer worlds"),
        (["bench", "pendulum", "--worlds", ",".join(["1"] * 100)], "worlds must be at most 64 numbers, got 100"),
        (["bench", "pendulum", "--seconds", "1e30"], "seconds must be at most 3600"),
        (["bench", "pendulum", "--dt", "1e-30"], "dt must be from 1e-09 to 10 s"),
        (["bench", "stack", "--worlds", "1", "--dt", "1e-9"], "use a larger dt"),
        (["bench", "gator", "--worlds", "1", "--dt", "1e-9"], "use a larger dt"),
        (["verify", "x" * 100_000], "unknown scene 'xxxx"),
    ],
)
def test_wrong_words_are_one_line_and_code_two(capfd, arguments, words):
    assert cli.main(arguments) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert words in err
    assert err.startswith("simwarp: ")
    assert err.count("\n") == 1
    assert len(err) < 2500


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (DEEP, "nested too deep"),
        ('{"policy": ' * 200 + "1" + "}" * 200, "nested too deep"),
        ('{"policy": {"noise": 1e400}}', "beyond float32"),
        ('{"policy": {"noise": ' + "9" * 5000 + "}}", "beyond 64 bits"),
        ('{"policy": {}, "policy": {}}', "policy: given twice"),
        ("[]", "must be a JSON object"),
        ("{", "broken JSON"),
    ],
)
def test_json_on_the_command_line_is_read_as_files_are(text, reason):
    kind = options.task_options("Command", options.CommonOptions, task=TaskConfig())
    with pytest.raises(UsageError) as caught:
        parse_options(kind, ["--task.sensing", text], "test")
    assert str(caught.value).startswith("--task.sensing: ")
    assert reason in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (["randomise={}"], "--grid randomise: takes one value of one of them, randomise.NAME.FIELD"),
        (['randomise={"body_mass": {"low": 1, "high": 2}},{}'], "--grid randomise: takes one value of one of them"),
        (["action_delay=0,1"], "--task.action-delay'. Expected 2 values"),
        (["curriculum=1"], "name one of its fields: curriculum.driver"),
        (["curriculum.upp=1"], "unknown option --task.curriculum.upp"),
        (["dt.real=1"], "unknown option --task.dt.real"),
        (["a b=1"], "--grid wants KEY=a,b,c"),
        (["..=1"], "--grid wants KEY=a,b,c"),
        (["dt=0.01,0.010"], "--grid dt has the value 0.01 twice"),
        (["substeps=1,2", "dt=0.01,1e-2"], "--grid dt has the value 0.01 twice"),
        (["dt=" + ",".join(f"{index / 1e6}" for index in range(1, 2000))], "has 1999 points, at most 1000"),
        (["dt=1e400"], "--task.dt must be a finite number"),
        (["substeps=" + "9" * 5000], "--task.substeps must be a whole number from"),
        (["dt=" + "1" * 100_000 + "x"], "--task.dt must be a number"),
    ],
)
def test_grids_that_cannot_be_are_one_line(texts, words):
    kind = options.task_options("Command", options.CommonOptions, task=TaskConfig())

    def parse_task(arguments: list[str]) -> TaskConfig:
        found: TaskConfig = parse_options(kind, arguments, "test").task
        return found

    with pytest.raises(UsageError) as caught:
        grid_points(texts, TaskConfig(), parse_task)
    assert words in str(caught.value)
    assert len(str(caught.value)) < 500


def test_a_grid_beside_an_option_of_the_same_field_is_refused():
    kind = options.task_options("Command", options.CommonOptions, task=TaskConfig())
    with pytest.raises(UsageError, match=r"--task\.dt is given twice"):
        grid_points(
            ["dt=0.01,0.02"], TaskConfig(), lambda words: parse_options(kind, ["--task.dt", "1", *words], "test").task
        )


def test_the_command_line_starts_without_the_engine():
    import subprocess

    code = "import sys, simwarp.cli; print(sorted({'warp', 'numpy', 'torch', 'tyro'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "[]\n"


def test_the_package_gives_its_names_when_they_are_asked_for():
    import simwarp
    from simwarp import api

    assert set(simwarp.__all__) == {*api.__all__, "to_torch"} <= set(dir(simwarp))
    assert all(getattr(simwarp, name) is getattr(api, name) for name in api.__all__)
    assert simwarp.core.rotation.__name__ == "simwarp.core.rotation"
    with pytest.raises(AttributeError, match="'simwarp' has no attribute 'nothing'"):
        simwarp.nothing  # type: ignore[attr-defined]  # noqa: B018


def test_a_wrong_name_with_an_underscore_is_not_called_an_old_one(capfd):
    assert cli.main(["train", "fast", "--task.max_episode_step", "4"]) == 2
    err = capfd.readouterr().err
    assert err.count("\n") == 1
    assert "unknown option --task.max_episode_step; did you mean --task.max-episode-steps" in err
