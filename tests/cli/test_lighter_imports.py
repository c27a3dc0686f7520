"""Help and lists print the same without torch, Warp and kernels as with them."""

import os
import subprocess
import sys
import textwrap

import pytest

from simwarp.cli.early.lighter_imports import FULL, REPLACED, StandIn, stand_ins


def said(*arguments: str, **variables: str) -> tuple[int, str, str]:
    done = subprocess.run(
        [sys.executable, "-m", "simwarp", *arguments], capture_output=True, text=True, timeout=120,
        env=os.environ | {"COLUMNS": "100"} | variables,
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


COMMANDS = (
    "list", "train --help", "train ant --help", "train off-road --help --obs camera",
    "sweep ant --help", "play hexapod --help", "eval convoy --help", "view hallway --help",
    "drive hmmwv --help", "bench ant --help", "export --help", "import --help",
    "verify --help", "record ant --task.dt x --help", "train nothing --help",
)  # fmt: skip


@pytest.mark.sweep
@pytest.mark.parametrize("words", COMMANDS)
def test_the_text_is_that_of_full_imports(words):
    assert said(*words.split()) == said(*words.split(), **{FULL: "1"})


@pytest.mark.parametrize(
    "words", [["list"], ["train", "ant", "--help"], ["sweep", "ant", "--help"], ["drive", "hmmwv", "--help"]]
)
def test_nothing_heavy_is_loaded(words):
    code = f"""
        import sys, simwarp.cli.early.lighter_imports as light
        light.run_in_full = lambda _: print("in full") or 0
        import simwarp.cli as cli
        cli.run_in_full = light.run_in_full
        cli.leave = sys.exit
        sys.argv = ["simwarp", *{words}]
        try:
            cli.main()
        except SystemExit:
            pass
        loaded = [name for name in {REPLACED} if getattr(sys.modules.get(name), "__file__", "")]
        print("loaded:", loaded)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("loaded: []\n")
    assert "in full" not in done.stdout


def test_a_package_that_stand_ins_break_is_imported_in_full(tmp_path):
    """Its task asks torch for something while it is imported, which a stand-in cannot know."""
    (tmp_path / "asking_tasks.py").write_text(
        "import torch\n\nassert torch.zeros(2).numel() == 2\n\n"
        "from simwarp.tasks import register\nfrom simwarp.tasks.pendulum import PendulumTask\n\n"
        'register("asking")(type("Asking", (PendulumTask,), {"summary": "asks torch"}))\n'
    )
    info = tmp_path / "asking-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: asking\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[simwarp.tasks]\nasking = asking_tasks\n")
    code, out, err = said("list", PYTHONPATH=os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    assert (code, "asks torch" in out) == (0, True), err


def test_a_stand_in_is_whatever_a_module_makes_of_it():
    with stand_ins():
        import rsl_rl.nowhere as package

        class Derived(package.Base):
            pass

        @package.decorated(option=1)
        def function():
            return 5

    assert Derived.__bases__ == (object,)
    assert function() == 5
    assert package.constant(7) == 7
    assert isinstance(package.a | package.b, StandIn)
    assert not isinstance(3, package.Number)
    for name in [name for name in sys.modules if name.startswith("rsl_rl.nowhere")]:
        del sys.modules[name]


def test_a_process_that_leaves_out_what_is_unused_can_learn():
    """torch's compiler, which an optimiser imports, goes through all modules: none may be in its way."""
    code = (
        "from simwarp.cli.early.lighter_imports import SERVICES, leave_unused_out\n"
        "leave_unused_out()\n"
        "import sys\n"
        "from simwarp.train.algorithm.trainer import Trainer\n"
        "assert sys.modules.keys() & SERVICES, 'nothing was left out'\n"
        "import torch\n"
        "weight = torch.nn.Parameter(torch.ones(1))\n"
        "optimizer = torch.optim.Adam([weight])\n"
        "weight.sum().backward()\n"
        "optimizer.step()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
