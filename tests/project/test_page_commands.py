"""Every command on the pages is understood by the program that it calls."""

import json
import re
import shlex
import subprocess
import sys

import pytest

from simwarp.tasks.framework import registry
from tests.project.page_commands import (
    PLACEHOLDERS,
    ROOT,
    called,
    named_runs,
    pages,
    parse,
    place_files,
    place_robots,
    place_run,
    python_blocks,
    shell_blocks,
    spoken,
)
from tests.project.page_runs import NOT_RUN, lacks, program, reason, shortened

TASK_FILES = {
    "walker.py": ("walking.md", "class Walker(", {}),
    "mine.py": ("velocity.md", "class MineVelocity(", {}),
    "reach.py": ("write-a-task.md", "class ReachTask(", {}),
    "my_task.py": ("write-a-task.md", "class ReachTask(", {"ReachTask": "MyTask", '"reach"': '"my-task"'}),
    "stop_line.py": ("driving.md", "class StopLineTask(", {}),
    "centre.py": ("first_steps.md", "class CentreTask(", {}),
}
"""Files of tasks that commands name: the page and the block that they are saved from, and what the reader renames."""
INSTALLED = {"reach": "reach.py:ReachTask", "stop-line": "stop_line.py:StopLineTask", "my-task": "my_task.py:MyTask"}
"""Tasks that a page has the reader install, from these files."""
PACKAGES = {"my-robot", "my-quadruped", "my-go2"}
"""Packages that `new-task` writes on a page; parsed as another task, for these have only the options of all."""
TRAINED = {
    "walker": "walker.py:Walker", "mine-velocity": "mine.py:MineVelocity", "reach": "reach.py:ReachTask",
    "my-task": "my_task.py:MyTask", "centre": "centre.py:CentreTask", "fast": "fast",
    "hexapod-velocity": "hexapod-velocity",
}  # fmt: skip
"""Tasks that ship no policy: the reader has trained them."""
MEANT = {
    "driving.md": {"RUN": "runs/convoy/2026-01-31_12-00-00"},
    "velocity.md": {"RUN": "runs/quadruped-velocity/2026-01-31_12-00-00"},
    "maneuvers.md": {"NAME": "braking"},
    "vehicles.md": {"NAME": "step-steer"},
    "write-a-task.md": {"RUN": "runs/my-task/2026-01-31_12-00-00"},
}
"""Placeholders that stand for something else on a page."""
LATER = {"contributing.md": ["simwarp drive hmmwv --tire linear"]}
"""Commands that a page has for something that its reader adds: here the tire of the recipe."""
WITH_COMMANDS = [
    page for page in pages() if page.name != "CHANGELOG.md" and (shell_blocks(page) or spoken(page, {}))
]  # fmt: skip
"""The change log tells of commands as they were."""


def label(page):
    return str(page.relative_to(ROOT))


def forget(known):
    """Take tasks of a page's files out of the registry: others may have the same names, in another folder."""
    for name in registry._tasks.keys() - known:
        del registry._tasks[name]


@pytest.fixture
def known():
    """Tasks that are there before a page is read."""
    return frozenset({*registry._tasks, *registry._BUILT_IN})


@pytest.fixture
def reader(tmp_path, monkeypatch, known):
    """Make the folder of a reader who followed the pages, and enter it; its tasks are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)

    def prepare(text):
        (tmp_path / "new").mkdir()  # where a file of a task was moved to
        for name in TASK_FILES:
            for folder in (tmp_path, tmp_path / "new"):
                (folder / name).write_text(file_of_task(name), encoding="utf-8")
        used = {name for name, file in TRAINED.items() if name in text or file in text or name == "fast"}
        runs = {f"runs/{name}/2026-01-31_12-00-00" for name in used}
        for folder, task in named_runs("\n".join([text, *runs, PLACEHOLDERS["RUN"], *str(MEANT).split("'")])):
            if not (tmp_path / folder).exists():
                place_run(tmp_path / folder, TRAINED.get(task, task))
        place_files(tmp_path, text)
        if "robot" in text or "quadruped.urdf" in text:
            place_robots(tmp_path)
        return tmp_path

    yield prepare
    forget(known)


def as_installed(words):
    """The words with a task's file in the place of a name that only an installed package has."""
    if words[0] == "simwarp" and len(words) > 2:
        return [*words[:2], INSTALLED.get(words[2], words[2]), *words[3:]]
    return words


def as_there(words):
    """The words with another task in the place of a package that is not there, but where it is written."""
    if words[0] == "simwarp" and words[1] != "new-task":
        return [*words[:2], *("fast" if word in PACKAGES else word for word in words[2:3]), *words[3:]]
    return words


def file_of_task(name):
    """The text of such a file."""
    page, marker, renamed = TASK_FILES[name]
    code = next(block for block in python_blocks(ROOT / "docs" / page) if marker in block)
    for old, new in renamed.items():
        code = code.replace(old, new)
    return code


@pytest.mark.parametrize("name", TASK_FILES)
def test_a_block_that_is_saved_as_a_file_has_all_that_it_names(name):
    # Imports of blocks before it are not in its file
    ruff = [sys.executable, "-m", "ruff", "check", "--isolated", "--select", "F821", "--output-format", "concise", "-"]
    done = subprocess.run(ruff, input=file_of_task(name), capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_every_file_that_is_saved_from_a_page_is_tried():
    named = {name for page in pages() for name in re.findall(r"[Ss]aved? (?:this )?as `(\w+\.py)`", page.read_text())}
    assert named >= {"walker.py", "mine.py", "centre.py"}
    assert named <= TASK_FILES.keys()


@pytest.mark.long("docs/driving.md", "docs/results.md", "docs/training.md")
@pytest.mark.parametrize("page", WITH_COMMANDS, ids=label)
def test_the_commands_of_a_page_are_understood(page, reader, known):
    text = page.read_text(encoding="utf-8")
    folder, meant = reader(text), MEANT.get(page.name, {})
    commands = [words for block in shell_blocks(page) for words in called(block, folder, meant)]
    commands += spoken(page, meant)
    later = LATER.get(page.name, [])
    assert {shlex.join(words) for words in commands} >= set(later), "LATER has commands that are gone"
    wrong = []
    for words in commands:
        try:
            if any(word.startswith("new/") for word in words):
                forget(known)  # a file that was moved: in one process its task would be there twice
            if shlex.join(words) not in later:
                parse(as_there(as_installed(words)))
        except Exception as error:  # noqa: BLE001 - all of a page's mistakes at once
            wrong.append(f"{shlex.join(words)}\n    {type(error).__name__}: {error}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    "wrong",
    [
        "simwarp train pendulum --iteration 2",
        "simwarp eval off-road --obs state --grid obstacle=0,30",
        "simwarp sweep pendulum --seeds 0-4 --grid ppo.gama=0.9",
        "simwarp drive hmmwv --maneuver no-such",
        "simwarp bench no-such",
        "simwarp walk ant",
        "python benchmarks/robustness.py off-road --mapps",
        "python benchmarks/no_such.py",
        "torchrun --no-such 8 -m simwarp train ant",
        "torchrun --standalone -m simwarp train ant --no-such",
        "make no-such-target",
        "pip install 'simwarp[no-such]'",
        "ssh -L 1:2 machine simwarp view ant --no-such",
        "simwarp train 'pendulum",
    ],
)
def test_a_wrong_command_is_found(wrong, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def understood():
        for words in called(wrong, tmp_path):
            parse(words)

    with pytest.raises((Exception, SystemExit)):  # argparse leaves by SystemExit
        understood()


def test_blocks_name_their_language():
    # A block without a language, or under another name of it, would be tried by no test
    for page in pages():
        found = set(re.findall(r"^```(\w*\S*)\n.*?^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL))
        assert found <= {"python", "sh", "text", "toml", "{eval-rst}", "{toctree}"}, page.name


# ---- and run ---------------------------------------------------------------------------------------------------------


def runs_of(page, folder):
    """The commands of a page's blocks that are run, shortened."""
    meant = MEANT.get(page.name, {})
    commands = [as_installed(words) for block in shell_blocks(page) for words in called(block, folder, meant)]
    return [shortened(words) for words in commands if reason(words) is None and lacks(words) is None]


RUN = [page for page in pages() if any("simwarp " in block for block in shell_blocks(page))]


@pytest.mark.slow
@pytest.mark.parametrize("page", RUN, ids=label)
def test_the_commands_of_a_page_run(page, reader, tmp_path_factory):
    # In one process: a command finds what those before it wrote, and kernels are loaded once
    folder = reader(page.read_text(encoding="utf-8"))
    before = set()
    for earlier in RUN[: RUN.index(page)]:
        other = tmp_path_factory.mktemp("earlier")
        before |= {shlex.join(words) for words in runs_of(earlier, other)}
    commands = [words for words in runs_of(page, folder) if shlex.join(words) not in before or "runs" in words]
    report = folder / "codes.json"
    script = folder / "commands.py"
    script.write_text(program(commands, report), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(script)], cwd=folder, capture_output=True, text=True, timeout=3000, check=False
    )
    codes = json.loads(report.read_text(encoding="utf-8")) if report.exists() else []
    # 1: ran, and fell short of its aim, as two iterations do
    failed = [f"{shlex.join(words)}: {code}" for words, code, _ in codes if code not in {0, 1}]
    assert not failed, "\n".join([*failed, done.stderr[-4000:]])
    assert len(codes) == len(commands), done.stderr[-4000:]


def test_every_reason_not_to_run_a_command_is_used(tmp_path):
    folders = ((page, tmp_path / str(number)) for number, page in enumerate(pages()))
    commands = []
    for page, folder in folders:
        folder.mkdir()
        blocks = shell_blocks(page)
        commands += [as_installed(words) for block in blocks for words in called(block, folder)]
    used = {reason(words) for words in commands}
    assert used - {None} == set(NOT_RUN.values())
    assert None in used
