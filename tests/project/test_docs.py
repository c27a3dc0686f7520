"""What the documentation says is true: its code runs, its tables name what exists, its links lead somewhere."""

import contextlib
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest
import warp as wp

import simwarp as sw
import simwarp.model.model
from scripts.array_tables import with_tables
from scripts.stage_picture import PICTURE, picture
from simwarp.cli import COMMANDS
from simwarp.core.types import WorldStatus
from simwarp.model.joint_types import ELEMENTS
from tests.project.page_commands import pages, python_blocks

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").glob("*.md")])
OF_ROS = "ros2.md"
"""Its Python is a node, which needs ROS 2 and a simulation: tests/unit/ros2/test_rclpy_node.py runs it."""
WITH_CODE = [page for page in pages() if python_blocks(page) and page.name != OF_ROS]
"""Every page that has Python: none is left out."""
EXAMPLES = {
    "cart_pole.py": ["--worlds", "16", "--seconds", "2"],
    "balance_by_lqr.py": [],
    "rods.py": ["--seconds", "0.3", "--plot", "rods.png"],
    "meshes.py": ["--seconds", "0.02", "--picture", "meshes.png"],
    "four_bar.py": ["--seconds", "0.5", "--plot", "four_bar.png"],
    "drives.py": ["--seconds", "0.5"],
    "contacts.py": [],
    "drive_and_clone.py": ["--minutes", "0.01", "--no-open"],
    "scenery.py": ["--width", "80", "--plot", "scenery.png"],
    "import_robots.py": [],
    "plan_cart_pole.py": ["--samples", "8", "--seconds", "0.4", "--film", "swing.gif"],
    "plan_off_road.py": ["--samples", "6", "--seconds", "0.4", "--film", "gator.gif"],
    "plan_drift.py": ["--samples", "6", "--seconds", "0.4", "--film", "drift.gif"],
    "randomise.py": ["--worlds", "3", "--seconds", "4"],
    "own_network.py": ["--iterations", "1"],
    "rough_ground.py": ["--width", "40", "--levels", "0", "9", "--plot", "rough_ground.png"],
    "sensors.py": ["--worlds", "3", "--seconds", "1", "--plot", "sensors.png"],
    "train_cleanrl_style.py": ["--task", "fast", "--worlds", "32", "--steps", "20000", "--device", "cpu"],
    "train_sb3.py": ["--task", "fast", "--worlds", "32", "--steps", "20000"],
    "vehicles_on_ice.py": ["--worlds", "6", "--speed", "4", "--dt", "0.004", "--plot", "vehicles_on_ice.png"],
    "train_skrl.py": ["--task", "fast", "--worlds", "32", "--steps", "20000"],
}
NEEDS = {"drive_and_clone.py": "viser", "train_sb3.py": "stable_baselines3", "train_skrl.py": "skrl"}
"""Examples that run only where an extra is installed: its module."""
DTYPES = {
    "float32": wp.float32, "float64": wp.float64, "int32": wp.int32, "vec3": wp.vec3, "vec3d": wp.vec3d,
    "quat": wp.quat, "quatd": wp.quatd, "mat33": wp.mat33, "mat33d": wp.mat33d, "transform": wp.transform,
}  # fmt: skip


END = "<end of the block>"
DECIMAL = re.compile(r"(-?\d+\.\d+(?:e[+-]\d+)?)")
LONG = {
    "drive_and_clone.py",
    "train_cleanrl_style.py", "train_sb3.py", "train_skrl.py", "vehicles_on_ice.py", "scenery.py", "sensors.py",
    "randomise.py", "rough_ground.py",
    "driving.md", "edit-a-vehicle.md", "plan.md", "sensors.md", "training.md",
    "cart_pole.py", "contacts.py", "four_bar.py", "scenery.md", "tracks.md", "vehicles.md", "velocity.md", "walking.md",
    "write-a-task.md",
}  # fmt: skip
"""Examples and pages that take longest."""


def _long(value, name):
    return pytest.param(value, id=name, marks=[pytest.mark.slow] * (name in LONG))


def outputs(page):
    """What blocks of code print, as the page shows right below them: by number of the block."""
    found = re.findall(r"```python\n.*?```(?:\n\n```text\n(.*?)```)?", page.read_text(encoding="utf-8"), re.DOTALL)
    return {number: text for number, text in enumerate(found) if text}


def rows(page, heading, columns):
    """Rows of the tables after a heading line whose first cell is code: cells without backticks."""
    text = page.read_text(encoding="utf-8").partition(heading)[2]
    text = re.split(r"\n## ", text)[0]
    found = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:2] == "| "]
    return [[cell.replace("`", "") for cell in row] for row in found if len(row) == columns and row[0][0] == "`"]


def run(code_or_file, arguments, folder):
    """Run Python in a folder of its own; what it printed."""
    command = [sys.executable, *code_or_file, *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-4000:]
    return done.stdout


@pytest.mark.parametrize("page", [_long(page, page.name) for page in WITH_CODE])
def test_the_code_of_a_page_runs(page, tmp_path):
    # In a process of its own: the page registers a task, and must bring all of its imports
    assert python_blocks(page)
    script = tmp_path / "page.py"
    quiet = "import warp\nwarp.config.log_level = warp.LOG_WARNING\n"
    script.write_text(quiet + f"print({END!r})\n".join([*python_blocks(page), ""]), encoding="utf-8")
    printed = run([str(script)], [], tmp_path).split(f"{END}\n")
    for number, shown in outputs(page).items():
        found, wanted = (DECIMAL.split(text.rstrip()) for text in (printed[number], shown))
        assert found[::2] == wanted[::2], f"block {number}"
        # pages show three decimals; the last one may differ, as processors round float32 in different orders
        assert [float(x) for x in found[1::2]] == pytest.approx([float(x) for x in wanted[1::2]], abs=1.5e-3)


def test_every_page_of_the_documentation_is_read():
    # Names that the test of code had listed by hand, and pages that had none
    names = {str(page.relative_to(ROOT)) for page in pages()}
    assert names >= {"README.md", "CONTRIBUTING.md", "docs/scale-out.md", "docs/api/tasks.md", "benchmarks/README.md"}
    assert len(WITH_CODE) >= 17


def test_a_wrong_output_of_a_page_is_found(tmp_path):
    page = tmp_path / "page.md"
    for text, right in (("two 2.001", True), ("two 2.003", False), ("too 2.001", False), ("two 2.001\nmore", False)):
        page.write_text(f"```python\nprint('two', 2.0)\n```\n\n```text\n{text}\n```\n", encoding="utf-8")
        with contextlib.nullcontext() if right else pytest.raises(AssertionError):
            test_the_code_of_a_page_runs(page, tmp_path)


@pytest.mark.parametrize("name", [_long(name, name) for name in sorted(EXAMPLES)])
def test_an_example_runs(name, tmp_path):
    if name in NEEDS and importlib.util.find_spec(NEEDS[name]) is None:
        pytest.skip(f"the extra with {NEEDS[name]} is not installed")
    printed = run([str(ROOT / "examples" / name)], EXAMPLES[name], tmp_path)
    if name == "cart_pole.py":
        assert "upright: 16 of 16" in printed
    if name == "import_robots.py":
        angles = [float(angle) for angle in re.findall(r"1\.0000 kg, .* at (\S+) rad", printed)]
        assert len(angles) == 5
        # USD and STEP hold float32 numbers
        assert max(angles) - min(angles) < 1e-4
        assert min(angles) > 1.0
    if name == "randomise.py":
        # crossings are interpolated at 1 ms; the implicit spring is off by some (h w)^2, below 4e-4 for w < 20 rad/s
        difference = re.search(r"over 3 worlds: (\S+)", printed)
        assert difference is not None
        assert float(difference[1]) < 1e-3
    if name == "vehicles_on_ice.py":
        stops = {
            road: float(stop) for road, stop in re.findall(r"(ice|wet|dry) .* (\S+) \(\S+ to \S+\) .*up to", printed)
        }
        # 4 m/s and a friction of 0.9: not below v² / (2 mu g) = 0.9 m; on ice not below 4 m
        assert 0.8 < stops["dry"] < stops["wet"] < stops["ice"]
        assert stops["ice"] > 4.0
    if name == "own_network.py":
        differs = re.search(r"the file differs by (\S+) at most", printed)
        assert differs is not None
        assert float(differs[1]) <= 1e-5
    if name == "rough_ground.py":
        assert "20 patches" in printed
    if name == "sensors.py":
        # 20 frames of one second: the deviation of what is seen is off by a sixth, one in a thousand by half
        noises = re.findall(r"GPS noise (\S+) m, seen (\S+) m", printed)
        assert len(noises) == 3
        assert all(0.5 < float(seen) / float(asked) < 1.5 for asked, seen in noises)
        assert "accelerometers read 9.8" in printed
    if name == "drive_and_clone.py":
        assert "nobody drove" in printed
    elif name.startswith("train_"):
        returns = re.search(r"before (\S+), after \d+ steps (\S+)", printed)
        assert returns is not None
        assert float(returns[2]) > float(returns[1]) + 20.0  # best possible: 64


def test_every_example_is_run():
    assert {path.name for path in (ROOT / "examples").glob("*.py")} == set(EXAMPLES)


def test_the_task_of_the_guide_is_small():
    task = next(block for block in python_blocks(ROOT / "docs" / "write-a-task.md") if "class ReachTask" in block)
    assert len(task.splitlines()) <= 60


def test_the_parameter_table_is_that_of_the_code():
    listed = {
        name: (dtype, text)
        for name, dtype, text in rows(ROOT / "docs" / "conventions.md", "## Parameters that may differ per world", 3)
    }
    assert list(listed) == list(simwarp.model.model.PARAMETERS)
    for name, parameter in simwarp.model.model.PARAMETERS.items():
        dtype, text = listed[name]
        assert DTYPES[dtype] is parameter.dtype, name
        assert text.startswith(parameter.shape_text), name


def test_the_tables_of_arrays_are_made_from_their_declarations():
    page = ROOT / "docs" / "conventions.md"
    text = page.read_text(encoding="utf-8")
    assert with_tables(text) == text, "run: python -m scripts.array_tables"
    assert with_tables(text.replace("| `body_mass` ", "| `mass` ")) == text


def test_the_picture_of_the_stages_is_made_from_their_tables():
    assert PICTURE.read_text(encoding="utf-8") == picture(), "run: python -m scripts.stage_picture"


def test_the_joint_table_is_that_of_the_code():
    listed = {name: int(count) for name, count, *_ in rows(ROOT / "docs" / "conventions.md", "## Coordinates", 4)}
    assert listed == {kind.name: len(element.dofs) for kind, element in ELEMENTS.items()}


def test_the_array_tables_are_those_of_the_code():
    builder = sw.ModelBuilder()
    body = builder.add_body("body", mass=1.0, inertia=(1.0, 1.0, 1.0))
    builder.add_joint_prismatic("slide", sw.WORLD, body, axis=(1.0, 0.0, 0.0), limit=(-1.0, 1.0))
    builder.add_shape_sphere(body, radius=0.5)
    builder.add_shape_plane()
    sim = sw.Simulation(builder.finalize(2, "cpu"), dt=0.01, joint_reactions=True, joint_accelerations=True)
    listed = rows(ROOT / "docs" / "conventions.md", "## Arrays", 3)
    arrays: dict[str, wp.array] = {}
    for owner in (sim.state, sim.control, sim.diagnostics, sim.contacts):
        arrays |= {name: getattr(owner, name) for name in owner.FIELDS}
    bits = {row[0]: int(row[1]) for row in listed if row[1].isdigit()}
    assert bits == {flag.name: int(flag) for flag in WorldStatus if flag}
    assert {row[0] for row in listed} - bits.keys() == set(arrays)
    sizes = {"W": 2, "1 or W": 1, "B": 1, "J": 1, "dofs": 1, "box constraints": 1, "S": 2, "C": 1, "C or 0": 0}
    for name, shape, _ in listed:
        if name in arrays:
            cell = re.fullmatch(r"\(([^)]*)\) (\w+).*", shape)
            assert cell is not None, name
            dims, dtype = cell.groups()
            wanted = tuple(sizes[dim.strip()] for dim in dims.split(",") if dim.strip())
            implicit = name in sim.control.FIELDS and sim.control.FIELDS[name].transient
            # there is no implicit force element here
            assert arrays[name].shape == ((0, *wanted[1:]) if implicit else wanted), name
            assert DTYPES[dtype] is arrays[name].dtype, name


def test_the_reaction_has_the_sign_of_the_conventions():
    for order in (1, -1):
        builder = sw.ModelBuilder()
        weight = builder.add_body("weight", mass=2.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 0.0, -1.0)))
        ends = (sw.WORLD, weight)[::order]
        builder.add_joint_revolute("hinge", *ends, axis=(0.0, 1.0, 0.0), anchor=(0.0, 0.0, 0.0))
        sim = sw.Simulation(builder.finalize(1, "cpu"), dt=0.01, joint_reactions=True)
        sim.step()
        # float32: 2 kg x 9.81 m/s2 through one rounding each
        assert sim.diagnostics.joint_reaction_force.numpy()[0, 0].tolist() == pytest.approx(
            [0.0, 0.0, order * 19.62], abs=1e-4
        )


def test_the_command_table_is_that_of_the_code():
    listed = [row[0].split()[1] for row in rows(ROOT / "README.md", "## Commands", 2)]
    assert sorted(listed) == sorted(COMMANDS)
    for name in listed:
        assert callable(COMMANDS[name].load())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target.partition("#")[0]).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
@pytest.mark.sweep
def test_files_and_functions_that_a_page_names_exist(page):
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"`((?:simwarp|docs|examples|tests|tasks|train)/[\w/.-]*\w)`", text):
        assert (ROOT / name).exists(), name
    if page.name == "theory.md":
        source = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "simwarp").rglob("*.py"))
        for name in re.findall(r"`([a-z]+_[a-z_]+)`", text):
            assert re.search(rf"\b{name}\b", source), name
