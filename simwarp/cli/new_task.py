"""``simwarp new-task``: a package of its own with a task that trains, a test that passes, and a page that explains."""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import keyword
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final

import tyro

from simwarp.cli import DONE, UsageError, shortened
from simwarp.cli.options import CommonOptions, parse_options, split_path
from simwarp.cli.robots.robot_sources import Base, RobotOptions, load_file
from simwarp.core.files import output_error
from simwarp.core.operating_system import is_reserved

LONGEST: Final = 64
"""Characters of a name: it stands in names of files and of classes."""

FOLDERS: Final = ("tests",)
"""That the package has beside its module."""

_PYPROJECT = """[build-system]
requires = ["setuptools>=77"]
build-backend = "setuptools.build_meta"

[project]
name = "@name@"
version = "0.1.0"
description = "A simwarp task: @summary@"
requires-python = ">=3.11"
dependencies = ["simwarp"]

[project.optional-dependencies]
dev = ["pytest"]

# Importing this module registers the task: `simwarp list` then shows it.
[project.entry-points."simwarp.tasks"]
@name@ = "@module@.task"

[tool.setuptools]
packages = ["@module@"]
@data@
[tool.pytest.ini_options]
testpaths = ["tests"]
pythonpath = ["."]
"""

_INIT = '''"""The simwarp task `@name@`."""
'''

_TASK = '''"""An arm on a hinge, moved against gravity by a torque motor, has to point where it is told.

Change `build` for other bodies and joints; the other methods work in torch, for all worlds (W) at once.
"""

import dataclasses

import simwarp as sw
import torch
from simwarp.tasks import Positive, Task, TaskConfig, register


@dataclasses.dataclass(frozen=True)
class @Class@Config(TaskConfig):
    """Each field is an option of the command line, as --task.torque."""

    max_episode_steps: int = 200
    """Control steps after which an episode is truncated."""
    torque: Positive = 4.0
    """Torque of a full action [N m]."""
    max_rate: Positive = 20.0
    """Angular speed at which an episode fails [rad/s]."""


@register("@name@")
class @Class@Task(Task[@Class@Config]):
    """Observation `policy` (W, 5): direction of the arm, its rate, direction of the target."""

    summary = "an arm on a hinge points at a random angle"
    config_type = @Class@Config
    action_size = 1
    # Defaults of `simwarp train @name@`; a dot reaches into ppo and network
    training = {"iterations": 60, "num_envs": 128, "ppo.gamma": 0.97}

    def build(self, builder):
        """One world: a 0.6 m arm that turns about the y axis, in gravity."""
        arm = builder.add_body("arm", mass=0.5, inertia=(0.001, 0.015, 0.015), pose=sw.pose((0.3, 0, 0)))
        builder.add_joint_revolute("hinge", sw.WORLD, arm, axis=(0, -1, 0), anchor=(0, 0, 0), damping=0.05)

    def setup(self):
        """Buffers of the task's own, allocated once and written in place."""
        self.hinge = self.simulation.model.dof("hinge")
        self.target = torch.zeros(self.num_worlds, device=self.device)

    def apply(self, action):
        """`action` is (W, 1) in [-1, 1] and holds for one control step."""
        self.views.joint_force[:, self.hinge] = action[:, 0] * self.config.torque

    def observations(self):
        """Named groups, each (W, ...)."""
        q, qd = self.views.joint_q[:, self.hinge], self.views.joint_qd[:, self.hinge]
        return {"policy": torch.stack([q.sin(), q.cos(), 0.1 * qd, self.target.sin(), self.target.cos()], dim=1)}

    def rewards(self):
        """Named terms, each (W,); the reward is their sum."""
        error = 1.0 - torch.cos(self.views.joint_q[:, self.hinge] - self.target)
        return {"near": torch.exp(-4.0 * error), "effort": -0.01 * self.action[:, 0].square()}

    def terminations(self):
        """Named failures and goals, each (W,) bool."""
        return {"too_fast": self.views.joint_qd[:, self.hinge].abs() > self.config.max_rate}

    def metrics(self):
        """The metrics of `simwarp eval`; `success` decides about success."""
        error = (1.0 - torch.cos(self.views.joint_q[:, self.hinge] - self.target)).clamp(0.0, 2.0)
        return {"final_error": torch.acos(1.0 - error), "success": error < 0.005}

    def reset(self, world_mask):
        """A new episode in the worlds of the mask, nothing in the others: choose with torch.where."""
        target = self.random.uniform("target", -1.5, 1.5)[:, 0]
        self.target.copy_(torch.where(world_mask, target, self.target))
        start = self.random.uniform("start", -1.5, 1.5)
        self.simulation.set_joint_state(world_mask, start, torch.zeros_like(start))

    def extra_state(self):
        """State of the task's own that a checkpoint must keep."""
        return {"target": self.target}

    def load_extra_state(self, state):
        """Take it back."""
        self.target.copy_(state["target"])
'''

_TEST = '''"""Tests of the task; run with pytest."""

import dataclasses

import pytest
import torch
from simwarp.tasks import InputError, make
from simwarp.train import default_config, train

import @module@.task as mine


def test_a_step_returns_what_it_should():
    task = make("@name@", num_worlds=4, seed=1)
    result = task.step(torch.zeros(4, 1))
    assert result.observations["policy"].shape == (4, 5)
    assert torch.isfinite(result.rewards).all()
    assert task.reward_terms == ["near", "effort"]


def test_episodes_repeat_with_their_seed():
    def play(seed):
        task = make("@name@", num_worlds=4, seed=seed)
        return torch.stack([task.step(torch.full((4, 1), 0.3)).rewards for _ in range(20)])

    assert torch.equal(play(1), play(1))
    assert not torch.equal(play(1), play(2))


def test_torque_moves_the_arm():
    task = make("@name@", num_worlds=2)
    before = task.views.joint_q[:, task.hinge].clone()
    for _ in range(10):
        task.step(torch.tensor([[1.0], [-1.0]]))
    moved = task.views.joint_q[:, task.hinge] - before
    # 4 N m against the 1.5 N m of the arm's weight
    assert moved[0] > 0 > moved[1]


def test_impossible_values_are_refused():
    with pytest.raises(InputError, match="torque must be positive"):
        make("@name@", torque=-1.0)


def test_it_trains(tmp_path):
    config = dataclasses.replace(default_config(mine.@Class@Task), iterations=2, num_envs=8, device="cpu")
    result = train("@name@", config, mine.@Class@Config(), root=tmp_path)
    assert result.iterations == 2
'''

_README = """# @name@

A task for simwarp: an arm on a hinge points where it is told. `@module@/task.py` is the place to change.

```sh
pip install -e '.[dev]'
pytest
simwarp train @name@
simwarp eval @name@
simwarp play @name@ --video @name@.gif
```

`pip install -e .` makes the task known to the `simwarp` command through the entry point in `pyproject.toml`.
"""


@dataclasses.dataclass(frozen=True)
class NewTaskOptions(CommonOptions):
    """Write a package with a working task, its test and an entry point, outside of simwarp itself."""

    output: Path | None = None
    """Folder to make; by default NAME in the working folder. It must not exist, or be empty."""
    robot: Path | None = None
    """File of a robot that the task is about: it stands, or reaches goals where its base is fixed. See `import`."""
    velocity: tyro.conf.FlagCreatePairsOff[bool] = False
    """The robot follows commanded velocities."""
    base: Base | None = None
    """Of a URDF: its root link is welded to the world, or floats."""
    allow: tuple[str, ...] = ()
    """Kinds of refused elements of the robot's file to drop."""
    packages: tuple[str, ...] = ()
    """Folders of a URDF's packages, NAME=FOLDER each."""
    density: float | None = None
    """Of all parts of a STEP file, or of the links of a URDF whose mass it does not tell [kg/m³]."""
    pose: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="JOINT=VALUE,...")] = ()
    """Where joints stand at the start [rad or m]; * and ? in a name stand for letters; may be given again."""


_DATA = """
[tool.setuptools.package-data]
@module@ = ["robot.json"]
"""


def files(name: str, options: NewTaskOptions | None = None) -> dict[str, str]:
    """Return the files of the package of a task: path -> text.

    Args:
        name: of the task.
        options: those of a task about a robot; None: the arm on a hinge.
    """
    module = name.replace("-", "_")
    words = {"@name@": name, "@module@": module, "@Class@": "".join(word.capitalize() for word in name.split("-"))}
    words |= {"@summary@": "an arm on a hinge points where it is told", "@data@": ""}
    templates = {
        "pyproject.toml": _PYPROJECT,
        "README.md": _README,
        f"{module}/__init__.py": _INIT,
        f"{module}/task.py": _TASK,
        f"tests/test_{module}.py": _TEST,
    }
    as_they_are = {}
    if options is not None and options.robot is not None:
        from simwarp.cli.robots.robot_task import robot_files

        path = options.robot
        _, robot = load_file(path, RobotOptions(options.base, options.allow, options.packages, options.density))
        templates |= robot_files(name, module, robot, path.name, velocity=options.velocity, pose=options.pose)
        as_they_are = {where: templates.pop(where) for where in list(templates) if where.endswith(".json")}
        words |= {"@summary@": f"the robot of {path.name}", "@data@": _DATA.replace("@module@", module)}
    written = {path: re.sub(r"@\w+@", lambda match: words[match[0]], text) for path, text in templates.items()}
    return written | as_they_are


def check_name(name: str) -> None:
    """Refuse a name that no task, package and module can all have.

    Raises:
        UsageError: it is none, or another thing has it already.
    """
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name):
        rule = "a task's name is lower-case letters, digits and single hyphens, as my-task"
        raise UsageError(f"{rule}; got '{shortened(name)}'")
    if len(name) > LONGEST:
        raise UsageError(f"a task's name has at most {LONGEST} characters, got '{shortened(name)}'")
    module = name.replace("-", "_")
    from importlib.util import find_spec

    from simwarp.tasks import task_names

    if name in task_names():
        raise UsageError(f"there is a task '{name}' already; choose another name")
    if is_reserved(module):
        raise UsageError(f"'{name}' is a device of Windows, which takes no folder of this name; choose another name")
    if keyword.iskeyword(module) or module in FOLDERS or find_spec(module) is not None:
        raise UsageError(f"there is a Python module '{module}' already; choose another name")


def write_package(target: Path, texts: Mapping[str, str]) -> None:
    """Write all files below a folder, or none of them.

    Raises:
        UsageError: no folder can be there.
        OutputError: the disk did not take it.
    """
    made: list[Path] = []
    try:
        _write_all(target, texts, made)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO):
            raise output_error(target, error, needed=sum(map(len, texts.values()))) from error
        raise UsageError(f"cannot write '{target}': {error.strerror}") from error
    finally:
        for path in reversed(made):  # empty when all is written
            with contextlib.suppress(OSError):
                path.rmdir() if path.is_dir() else path.unlink()


def _write_all(target: Path, texts: Mapping[str, str], made: list[Path]) -> None:
    """Write files with the folders they need; what is made so far stands in the list, which is emptied in the end."""
    for relative, text in texts.items():
        file = target / relative
        for folder in reversed([folder for folder in file.parents if not folder.exists()]):
            folder.mkdir()
            made.append(folder)
        made.append(file)
        file.write_text(text, encoding="utf-8")
    made.clear()


def _is_empty(target: Path) -> bool:
    """Return True if nothing is there, or an empty folder.

    Raises:
        UsageError: it cannot be looked at.
    """
    try:
        return not (target.exists() or target.is_symlink()) or (target.is_dir() and not any(target.iterdir()))
    except OSError as error:
        raise UsageError(f"cannot write '{target}': {error.strerror}") from None


def run(arguments: list[str]) -> int:
    """Write the package."""
    path, arguments = split_path(arguments, "new-task", "NAME")
    options = parse_options(NewTaskOptions, arguments, "simwarp new-task NAME")
    name = str(path)
    check_name(name)
    target = options.output or Path(name)
    options.check(options.robot)
    for flag in ("velocity", "base", "allow", "packages", "density", "pose"):
        if options.robot is None and getattr(options, flag):
            raise UsageError(f"--{flag} is about a robot: add --robot FILE, or leave it away")
    if not _is_empty(target):
        raise UsageError(f"cannot write '{target}': it exists and is not an empty folder")
    written = files(name, options)
    write_package(target, written)
    console = options.console()
    for relative in written:
        console.print(f"wrote {target / relative}", highlight=False, soft_wrap=True)
    if options.base == "floating" and not options.pose:
        note = "note   joints start at 0; legs learn sooner from bent knees: --pose JOINT=ANGLE, or HOME in task.py"
        console.print(note, highlight=False, soft_wrap=True)
    console.print(
        f"next   cd {target} && pip install -e '.[dev]' && pytest && simwarp train {name}",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
    options.emit({"task": name, "folder": str(target), "files": sorted(written)})
    return DONE
