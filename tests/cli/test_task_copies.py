"""Shipped tasks are copied out of the package as the page says, renamed, and trained."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import simwarp.tasks

PAGE = Path(__file__).parents[2] / "docs" / "write-a-task.md"
COPIES = {
    "pendulum": ("pendulum*.py", "pendulum.py", "PendulumTask", []),
    "ant": ("locomotion/ant*.py", "ant.py", "AntTask", []),
    "obstacle-avoidance": (
        "driving/obstacle_avoidance*.py", "obstacle_avoidance.py", "ObstacleAvoidanceTask", ["--obs", "state"]
    ),
}  # fmt: skip
"""Name -> files, the one of the class, the class, and options of its training."""


def as_the_page_says(name):
    """The commands of the page, for another task where it is not the ant."""
    text = PAGE.read_text(encoding="utf-8")
    block = re.search(r"```text\n(folder=.*?)```", text, re.DOTALL)
    assert block is not None
    files, file, kind, options = COPIES[name]
    words = {
        "locomotion/ant*.py": files, "my-ant/ant.py": f"my-{name}/{file}", "AntTask": kind, "my-ant": f"my-{name}",
        '"ant"': f'"{name}"',
    }  # fmt: skip
    script = re.sub("|".join(map(re.escape, words)), lambda match: words[match[0]], block[1])
    return script.rstrip() + " " + " ".join([*options, "--json", "train.json"]) + "\n"


@pytest.mark.slow
@pytest.mark.parametrize("name", COPIES)
def test_a_copy_is_renamed_and_trained(name, tmp_path):
    programs = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}
    script = f"set -e\n{as_the_page_says(name)}"
    done = subprocess.run(["bash", "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "train.json").read_text())
    assert (result["task"], result["iterations"]) == (f"my-{name}", 2)
    # The kernels beside it are its own
    copied = {path.name for path in (tmp_path / f"my-{name}").glob("*.py")}
    assert copied == {path.name for path in Path(simwarp.tasks.__path__[0]).glob(COPIES[name][0])}


def test_files_of_a_folder_import_each_other(tmp_path):
    (tmp_path / "gains.py").write_text("GAIN = 0.5\n")
    (tmp_path / "still.py").write_text(
        "from simwarp.tasks.pendulum import PendulumTask\nfrom . import gains\nfrom .gains import GAIN\n"
        "class Still(PendulumTask):\n    summary = f'gain {GAIN + gains.GAIN}'\n"
    )
    kind = simwarp.tasks.task_class(f"{tmp_path}/still.py:Still")
    assert kind.summary == "gain 1.0"
