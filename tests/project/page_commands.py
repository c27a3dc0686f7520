"""Commands of the pages: those that a shell makes of a ```sh block, and the parsers of the programs they call."""

from __future__ import annotations

import argparse
import contextlib
import functools
import json
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from packaging.requirements import Requirement

from simwarp.cli import COMMANDS, check_words

ROOT = Path(__file__).resolve().parents[2]
SHELL = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
PYTHON = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)

PROGRAMS = ("simwarp", "python", "torchrun", "make", "pip", "pytest", "pre-commit", "srun", "scontrol", "ssh", "sh")
"""Programs that the blocks call: a shell finds a recorder in the place of each."""

RECORDER = """#!/bin/bash
name="$(basename "$0")"
line="$(printf '%s\\x1f' "$name" "$@")"
printf '%s\\x1e' "$line" >> "$RECORDED"
[ "$name" = scontrol ] && echo head
[ "$name $1" = "simwarp new-task" ] && mkdir -p "$2"
exit 0
"""
"""Writes down what it is called with, in one go: a block may start two programs at once. `scontrol` names a host, and
`new-task` makes the folder that a block enters.
"""

PLACEHOLDERS = {
    "TASK": "obstacle-avoidance", "TARGET": "ant", "RUN": "runs/ant/2026-01-31_12-00-00", "NAME": "my-robot",
    "FILE": "robot.urdf", "SCENE": "ant", "VEHICLE": "hmmwv", "FOLDER": "folder", "DIR": "folder", "O": "state",
    "V": "4", "S": "1", "M": "step-steer",
}  # fmt: skip
"""Words in capitals that stand for one of many, and one of them."""

VEHICLE_FILES = {"heavier.json": "hmmwv-reduced", "my_hmmwv.json": "hmmwv", "trimmed.json": "hmmwv"}
"""Files that Python of the pages writes, and commands on them read: the vehicle that stands in them."""


def pages() -> list[Path]:
    """Every Markdown page of the checkout that people read."""
    return sorted(
        [
            *ROOT.glob("*.md"),
            *(ROOT / "docs").rglob("*.md"),
            *(ROOT / "benchmarks").glob("*.md"),
            *(ROOT / "simwarp" / "vehicle").rglob("*.md"),
        ]
    )


def python_blocks(page: Path) -> list[str]:
    """The Python of a page, block by block."""
    return PYTHON.findall(page.read_text(encoding="utf-8"))


def shell_blocks(page: Path) -> list[str]:
    """The shell sessions of a page, block by block."""
    return SHELL.findall(page.read_text(encoding="utf-8"))


def called(block: str, folder: Path, meant: Mapping[str, str] | None = None) -> list[list[str]]:
    """Return the commands that a shell makes of a block, run by `bash` itself in a folder.

    Placeholders are words of capitals that stand alone, such as RUN; `meant` tells what for.

    Its words, quotes, globs, variables and continued lines are bash's; programs are recorders that do nothing.
    """
    recorders, recorded = folder / ".recorders", folder / ".recorded"
    if not recorders.is_dir():
        recorders.mkdir()
        for name in PROGRAMS:
            (recorders / name).write_text(RECORDER, encoding="utf-8")
            (recorders / name).chmod(0o755)
        activate = folder / ".venv" / "bin" / "activate"
        activate.parent.mkdir(parents=True)
        activate.touch()
        for name in ("pip", "pre-commit"):
            (activate.parent / name).symlink_to(recorders / name)
    recorded.write_text("", encoding="utf-8")
    environment = {
        "PATH": f"{recorders}:/usr/bin:/bin", "RECORDED": str(recorded), "HOME": str(folder),
        "SLURM_NNODES": "2", "SLURM_JOB_ID": "1", "SLURM_JOB_NODELIST": "head",
    }  # fmt: skip
    # A mistake of one line must not hide behind the next one
    done = subprocess.run(
        ["/bin/bash", "-eu", "-c", f"{block}\nwait"], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, f"bash refuses the block: {done.stderr}\n{block}"
    lines = recorded.read_text(encoding="utf-8").split("\x1e")[:-1]
    return [[_filled(word, meant or {}) for word in line.split("\x1f")[:-1]] for line in lines]


def spoken(page: Path, meant: Mapping[str, str]) -> list[list[str]]:
    """Return the commands in the text and tables of a page, with something for each placeholder.

    A name alone, such as `simwarp train`, or one with an option and no target, such as `simwarp play --html`, speaks of
    the command and calls nothing.

    Args:
        page: to read.
        meant: what placeholders stand for on this page, before `PLACEHOLDERS`.
    """
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    found = []
    for code in re.findall(r"`([^`]+)`", text):
        words = shlex.split(code.replace(" ...", "")) if re.match(r"(simwarp|python) [^|]", code) else []
        words = [word for word in words if not re.fullmatch(r"\[.*|.*\]", word)]
        if _is_call(words):
            found.append([_filled(word, {**PLACEHOLDERS, **meant}) for word in words])
    return found


def _is_call(words: list[str]) -> bool:
    if len(words) < 2 or words[0] != "simwarp" or words[1] not in COMMANDS:
        return len(words) > 1
    # what needs a target says so in its usage, such as TASK
    return len(words) > 2 and not (words[2].startswith("-") and COMMANDS[words[1]].usage.isupper())


def _filled(word: str, meant: Mapping[str, str]) -> str:
    return re.sub(r"\b[A-Z]+\b(?!=)", lambda match: meant.get(match[0], match[0]), word)


# ---- parsers ---------------------------------------------------------------------------------------------------------


class _ParsedError(BaseException):
    """The command line was understood; what it asks for is not done."""


def _stop(*_: Any, **__: Any) -> None:
    raise _ParsedError


def _stopping(function: Any) -> Any:
    """Return a parser that ends the command as soon as it has understood the words."""

    def parse(*args: Any, **kwargs: Any) -> None:
        function(*args, **kwargs)
        raise _ParsedError

    return parse


def parse_simwarp(words: list[str]) -> None:
    """Parse the words after `simwarp` as the command does; grids and sweeps with all of their points.

    Raises:
        AssertionError: the command did something without parsing.
        Exception: what the command raises on wrong input.
    """
    if words[:1] in (["--help"], ["--version"]):
        return
    check_words(words)
    run = COMMANDS[words[0]].load()
    stop: Any
    if words[0] == "eval":
        stop = mock.patch("simwarp.cli.evaluation.evaluating.evaluate_grid", _stop)
    elif words[0] == "sweep":
        from simwarp.cli import training_sweep

        stop = mock.patch.object(training_sweep, "read_plan", _stopping(training_sweep.read_plan))
    elif words[0] == "drive":
        stop = contextlib.ExitStack()
        stop.enter_context(mock.patch.multiple("simwarp.cli.drive.drive_command", _drive=_stop, run_batch=_stop))
        if {"--vary", "--search"} & set(words):
            stop.enter_context(mock.patch("simwarp.cli.drive.drive_search.DesignSearch", _stop))
            stop.enter_context(mock.patch("simwarp.study.monte_carlo.MonteCarlo.drive_nominal", _stop))
    elif words[0] == "bench":
        stop = mock.patch.multiple("simwarp.cli.benching", _rows=_stop, _count_on_emulated_device=_stop)
    else:
        from simwarp.cli import options

        stop = mock.patch.object(options.tyro, "cli", _stopping(options.tyro.cli))
    with stop, contextlib.suppress(_ParsedError):
        if "--help" in words:
            with contextlib.suppress(SystemExit):  # which has printed what there is
                run(words[1:])
            return
        run(words[1:])
        raise AssertionError(f"simwarp {shlex.join(words)} parsed nothing")


def _parse_python(words: list[str]) -> None:
    """Parse the words after `python`: a script of the checkout, a module of it, pytest, or a program on an emulator."""
    if words[:2] == ["-m", "pytest"]:
        _parse_pytest(words[2:])
        return
    if words[:2] == ["-m", "simwarp"]:
        parse_simwarp(words[2:])
        return
    if words[0].endswith("tests/emulated_cuda") or words[:2] == ["-m", "tests.emulated_cuda"]:
        program = words[2:] if words[0] == "-m" else words[1:]
        if not program[0].isupper():
            _parse_python(program)
        return
    if words[0] == "-m":
        file, target, words = ROOT / f"{words[1].replace('.', '/')}.py", words[1], words[2:]
    else:
        file, target, words = ROOT / words[0], str(ROOT / words[0]), words[1:]
    assert file.is_file(), f"{file} does not exist"
    if not re.search(r"ArgumentParser|study_parser", file.read_text(encoding="utf-8")):
        assert not words, f"{file.name} takes no options, got {words}"
        return
    parse = argparse.ArgumentParser.parse_args
    with (
        mock.patch.object(sys, "argv", [target, *words]),
        mock.patch.object(sys, "path", [str(ROOT), str(ROOT / "benchmarks"), *sys.path]),
        mock.patch.object(argparse.ArgumentParser, "parse_args", _stopping(parse)),
        contextlib.suppress(_ParsedError),
    ):
        run = runpy.run_path if os.sep in target else runpy.run_module
        run(target, run_name="__main__")
        raise AssertionError(f"python {target} parsed nothing")


def _parse_pytest(words: list[str]) -> None:
    for before, word in zip(["", *words], words, strict=False):
        if not word.startswith("-") and before not in ("-m", "-k", "-p"):
            assert (ROOT / word).exists(), word


def _parse_torchrun(words: list[str]) -> None:
    from torch.distributed.run import parse_args

    parsed = parse_args(words)
    assert (parsed.module, parsed.training_script) == (True, "simwarp"), words
    parse_simwarp(parsed.training_script_args)


def _parse_make(words: list[str]) -> None:
    done = _dry_run(tuple(words))
    assert done.returncode == 0, done.stderr


@functools.cache
def _dry_run(words: tuple[str, ...]) -> subprocess.CompletedProcess[str]:
    """What `make` would do for a target, which pages name again and again."""
    return subprocess.run(["make", "--dry-run", *words], cwd=ROOT, capture_output=True, text=True)


def _parse_pip(words: list[str]) -> None:
    """Parse `pip install`: every extra is one of the package's, every other name a requirement."""
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert words[0] == "install", words
    for word in words[1:]:
        if word.startswith("-"):
            continue
        path, _, extras = word.partition("[")
        if path == "." or path.endswith(".whl"):
            name, options = project["name"], set(extras.rstrip("]").split(",")) - {""}
        else:
            requirement = Requirement(word)
            name, options = requirement.name, requirement.extras
        if name == project["name"]:
            assert options <= project["optional-dependencies"].keys(), word


def parse(words: list[str]) -> None:
    """Parse a command as the program that it calls does, and do nothing of it."""
    name, rest = words[0], words[1:]
    if name in ("srun", "ssh"):
        # Options and host of these are the reader's; what they start on the other machine is ours
        start = next(index for index, word in enumerate(rest) if word in PROGRAMS)
        parse(rest[start:])
    elif name == "sh":
        assert rest[0] == "bundle/install.sh", rest
    elif name not in ("pytest", "pre-commit", "scontrol"):
        parsers = {
            "simwarp": parse_simwarp, "python": _parse_python, "torchrun": _parse_torchrun, "make": _parse_make,
            "pip": _parse_pip,
        }  # fmt: skip
        parsers[name](rest)


# ---- what the reader has ---------------------------------------------------------------------------------------------


def _checkpoint(task: str) -> dict[str, Any]:
    """Return a checkpoint of a task: the shipped one, or that of another task under its name."""
    from simwarp.tasks import config_to_plain, task_class
    from simwarp.tasks.framework.registry import origin_of
    from simwarp.train.config import default_config
    from simwarp.train.runs.checkpoint import load_checkpoint

    shipped = sorted((ROOT / "train" / "shipped").glob(f"{task}.*pt"))
    if shipped:
        return load_checkpoint(shipped[0])
    cls = task_class(task)
    own = {"train_config": default_config(cls), "task_config": cls.config_type()}
    plain = {name: config_to_plain(config) for name, config in own.items()}
    return load_checkpoint(ROOT / "train" / "shipped" / "pendulum.pt") | origin_of(cls.name) | plain


def place_run(folder: Path, task: str) -> None:
    """Make the folder of a run of a task: its configuration and a checkpoint."""
    from simwarp.train.runs.checkpoint import save_checkpoint

    content = _checkpoint(task)
    (folder / "checkpoints").mkdir(parents=True)
    save_checkpoint(folder / "checkpoints" / "iteration_000001.pt", content)
    kept = {name: content[name] for name in ("task", "task_file", "train_config", "task_config") if name in content}
    (folder / "config.json").write_text(json.dumps(kept), encoding="utf-8")


def place_files(folder: Path, text: str) -> None:
    """Make what commands of a page go on from and others on it write: recorded episodes, and clones of them."""
    from simwarp.train.runs.checkpoint import save_checkpoint

    for task, data, clone in re.findall(r"simwarp clone (\S+) --data (\S+) --output (\S+)", text):
        content = _checkpoint(task)
        about = {"format": 1, "task": task, "task_config": content["task_config"]}
        with np.load(ROOT / "tests" / "data" / "before" / "trajectories.npz") as kept:
            np.savez(folder / data, **{**kept, "about": np.array(json.dumps(about))})
        save_checkpoint(folder / clone, content)
    for name in set(re.findall(r"train/shipped/\S+\.pt", text)):  # policies of the checkout
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, folder / name)
    for file, vehicle in VEHICLE_FILES.items():
        if file in text:
            from simwarp.vehicle import load_vehicle, save_vehicle

            save_vehicle(load_vehicle(vehicle), folder / file)
    made = re.search(r"```python\n((?:(?!```).)*barred\.json.*?)```", text, re.DOTALL)
    if made is not None:
        with contextlib.chdir(folder):
            exec(made[1], {})


LEG = """<link name="{0}_HIP"><inertial><mass value="1"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{0}_HAA" type="revolute"><parent link="base"/><child link="{0}_HIP"/><origin xyz="{1} {2} 0"/>
<axis xyz="1 0 0"/><limit lower="-.7" upper=".7" effort="40" velocity="10"/></joint>"""
PART = """<link name="{0}_{3}"><inertial><origin xyz="0 0 -.15"/><mass value="1"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 -.15"/><geometry><cylinder radius=".03" length=".3"/></geometry></collision></link>
<joint name="{0}_{1}" type="revolute"><parent link="{0}_{2}"/><child link="{0}_{3}"/><origin xyz="0 0 {4}"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="40" velocity="10"/></joint>"""


def place_robots(folder: Path) -> None:
    """Make robots with the names that pages give to the reader's: an arm, a quadruped, and one in MJCF."""
    from tests.cli.test_import_command import URDF
    from tests.cli.test_new_task_robot import WALKER

    legs = ""
    for name, x, y in (("LF", 0.3, 0.2), ("RF", 0.3, -0.2), ("LH", -0.3, 0.2), ("RH", -0.3, -0.2)):
        legs += LEG.format(name, x, y)
        legs += PART.format(name, "HFE", "HIP", "THIGH", 0.0) + PART.format(name, "KFE", "THIGH", "SHANK", -0.3)
    trunk = (
        '<link name="base"><inertial><mass value="20"/><inertia ixx=".5" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        '</inertial><collision><geometry><box size=".7 .3 .2"/></geometry></collision></link>'
    )
    files = {
        "robot.urdf": URDF, "quadruped.urdf": f'<robot name="quadruped">{trunk}{legs}</robot>', "robot.xml": WALKER,
        "go2.xml": WALKER,
    }  # fmt: skip
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")


def named_runs(text: str) -> Iterator[tuple[str, str]]:
    """Yield the run folders that a text names, with their tasks."""
    yield from re.findall(r"\b(runs/([\w-]+)/[\w.-]+)", text)
