"""A user's program is type-checked in the environment of `make setup`: its mistakes are found, and nothing else."""

import re
import shutil
import subprocess
import sys

import pytest

MISTAKES = """
import simwarp as sw
from simwarp.tasks import Range, make
from simwarp.train import train


def weigh(model: sw.Model) -> float:
    return float(model.body_mass.numpy().sum())


def main() -> None:
    builder = sw.ModelBuilder()
    cart = builder.add_body("cart", mass=1.0, inertia=(1.0, 1.0, 1.0))
    builder.add_joint_prismatic("slide", sw.WORLD, cart, axis=(1.0, 0.0, 0.0))
    builder.add_joint_revolute("hinge", 0, cart, axis=(0.0, 1.0, 0.0), dampening=0.1)  # wrong: no such option
    builder.add_body("pole", mass="heavy", inertia=(1.0, 1.0, 1.0))  # wrong: mass
    simulation = sw.Simulation(builder.finalize(2, "cpu"), dt="0.01")  # wrong: dt
    simulation.stepp()  # wrong: no such method
    spec = sw.vehicle.load("hmmwv")
    print(spec.axlez)  # wrong: no such attribute
    sw.sensors.Camera(1)  # wrong: no scene
    task = make("pendulum", "many")  # wrong: no number
    task.restart()["policy"].flop()  # wrong: no such method of a tensor
    print(Range("low", 1.0), task.num_worlds)  # wrong: no number
    q: int = sw.to_torch(simulation.state.joint_q)  # wrong: a tensor
    train(task)  # wrong: a task is no name
    print(sw.nothing, q)  # wrong: no such name
    print(weigh(simulation.model), sw.State.NAMES)
"""


CHECKERS = {
    "mypy": [sys.executable, "-m", "mypy", "--no-incremental"],
    "pyright": ["pyright", "--pythonpath", sys.executable],
}


@pytest.mark.slow
@pytest.mark.parametrize("checker", list(CHECKERS))
def test_mistakes_are_found_and_nothing_else(checker, tmp_path):
    if shutil.which(CHECKERS[checker][0]) is None:
        pytest.skip(f"{checker} is not installed")
    (tmp_path / "program.py").write_text(MISTAKES)
    command = [*CHECKERS[checker], "program.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    found = {int(line) for line in re.findall(r"program\.py:(\d+):[\d: -]*error", done.stdout)}
    assert found == {number for number, line in enumerate(MISTAKES.splitlines(), 1) if "# wrong" in line}, done.stdout
