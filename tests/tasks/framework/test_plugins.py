"""Tasks of other packages: found through their entry point, and isolated when they are broken."""

import os
import subprocess
import sys
import textwrap

import pytest

TASK = """
import torch
from simwarp.tasks import Task, TaskConfig, register

@register("throwaway")
class Throwaway(Task):
    summary = "from elsewhere"
    physics = False
    def setup(self): self.x = torch.zeros(self.num_worlds, 1)
    def apply(self, action): self.x.add_(action)
    def observations(self): return {"policy": self.x}
    def rewards(self): return {"x": self.x[:, 0].clone()}
    def terminations(self): return {}
    def reset(self, world_mask): self.x.masked_fill_(world_mask[:, None], 0.0)
"""


def package(folder, source):
    """A distribution as pip leaves it in site-packages."""
    (folder / "throwaway_tasks.py").write_text(textwrap.dedent(source), encoding="utf-8")
    info = folder / "throwaway-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: throwaway\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text("[simwarp.tasks]\nthrowaway = throwaway_tasks\n", encoding="utf-8")


def python(folder, code):
    env = os.environ | {"PYTHONPATH": str(folder)}
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, timeout=300)


def test_an_entry_point_adds_a_task_and_its_gymnasium_id(tmp_path):
    package(tmp_path, TASK)
    code = """
        import gymnasium, simwarp.tasks as tasks
        print("throwaway" in tasks.task_names(), tasks.make("throwaway", 2).num_worlds)
        print(gymnasium.make_vec("simwarp/Throwaway-v0", num_envs=2).num_envs)
    """
    done = python(tmp_path, textwrap.dedent(code))
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-3:] == ["True", "2", "2"]


@pytest.mark.quick("import no_such_module")
@pytest.mark.parametrize("source", ["raise RuntimeError('broken plugin')", "import no_such_module"])
def test_a_broken_package_takes_no_built_in_task_away(tmp_path, source):
    package(tmp_path, source)
    done = python(tmp_path, "import simwarp.tasks as tasks; print(tasks.task_names())")
    assert done.returncode == 0, done.stderr
    assert "pendulum" in done.stdout
    assert "throwaway" in done.stderr


@pytest.mark.slow
def test_the_list_of_built_in_tasks_is_what_their_modules_register():
    code = """
        import importlib, json, pkgutil
        from importlib.resources import files
        import simwarp.tasks
        from simwarp.tasks.framework import registry
        for module in pkgutil.walk_packages(simwarp.tasks.__path__, "simwarp.tasks."):
            if "adapter" not in module.name:
                importlib.import_module(module.name)
        listed = json.loads((files("simwarp.tasks") / "built_in.json").read_text())
        found = {name: task.__module__.removeprefix("simwarp.tasks.") for name, task in registry._tasks.items()}
        assert found == listed, (found, listed)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_a_built_in_name_is_refused_before_its_module_was_asked_for():
    code = """
        from simwarp.tasks import InputError, Task, register, task_class
        from simwarp.tasks.framework import registry
        assert "hexapod" not in registry._tasks
        class Mine(Task): pass
        try:
            register("hexapod")(Mine)
        except InputError as error:
            print(error)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=120)
    assert "two tasks want the name 'hexapod': simwarp.tasks.locomotion.hexapod" in done.stdout, done.stderr
