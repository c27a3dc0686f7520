"""`self_collision` of the readers: which parts of a robot touch each other."""

from __future__ import annotations

import itertools
import warnings
from pathlib import Path
from typing import Any

import pytest

import simwarp as sw
from simwarp.importers.imported import Imported
from simwarp.importers.report import ImportedWarning
from simwarp.importers.self_collision import SelfCollision
from simwarp.model.model import meeting_pairs
from tests.reference.wrong_robots import ROBOTS, cylinder, urdf

LINKS = 6

MJCF = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 1" pos="0 0 -2"/>
  <body name="loose" pos="0 1 0"><freejoint/><geom name="loose" type="sphere" size=".1"/></body>
  {}
</worldbody></mujoco>"""


def chain(folder: Path, **options: Any) -> Imported:
    """Links thicker than they are long: each overlaps its neighbour and the one after it."""
    parts, _ = ROBOTS["links thicker than long"]
    (folder / "chain.urdf").write_text(urdf(parts))
    return sw.importers.load_urdf(folder / "chain.urdf", base="floating", **options)


def mjcf(folder: Path, **options: Any) -> Imported:
    """The same in MJCF, beside a floor and a loose ball; masks keep the links apart."""
    text = ""
    for index in reversed(range(LINKS)):
        place = "0 0 0" if index == 0 else "0.05 0 0"
        joint = "<freejoint/>" if index == 0 else f'<joint name="j{index}" axis="0 1 0"/><joint axis="0 0 1"/>'
        geom = f'<geom name="link{index}" type="box" size=".045 .04 .04" pos=".025 0 0" contype="1" conaffinity="0"/>'
        text = f'<body name="b{index}" pos="{place}">{joint}{geom}{text}</body>'
    (folder / "chain.xml").write_text(MJCF.format(text).replace('name="floor"', 'name="floor" conaffinity="1"'))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ImportedWarning)
        return sw.importers.load_mjcf(folder / "chain.xml", **options)


def steps_apart(robot: Imported) -> set[int]:
    """Between the links of a chain that may touch each other."""
    link_of = {shapes[0]: int(name[4]) for name, shapes in robot.shapes.items() if name.startswith("link")}
    pairs = [pair for pair in meeting_pairs(robot.builder) if set(pair) <= set(link_of)]
    counts = dict.fromkeys(range(1, LINKS), 0)
    for one, other in pairs:
        counts[abs(link_of[one] - link_of[other])] += 1
    for apart, count in counts.items():
        assert count in (0, LINKS - apart)  # all of a kind, or none
    return {apart for apart, count in counts.items() if count}


@pytest.mark.parametrize(
    ("choice", "expected"),
    [
        (None, {2, 3, 4, 5}),
        (True, {1, 2, 3, 4, 5}),
        (False, set()),
        ("adjacent-off", {2, 3, 4, 5}),
        ("overlapping-off", {3, 4, 5}),  # edges of 0.13 m reach over two joints, 0.1 m, not over three
    ],
)
def test_a_urdf(choice: Any, expected: set[int], tmp_path: Path) -> None:
    robot = chain(tmp_path, self_collision=choice)
    if choice == "overlapping-off":
        told = [line.name for line in robot.report.held if line.element == "overlapping pair"]
        assert len(told) == LINKS - 2  # those two joints apart
        assert all(" mm" in name for name in told)
    assert steps_apart(robot) == expected


@pytest.mark.parametrize(
    ("choice", "expected"),
    [
        (None, set()),
        (True, {1, 2, 3, 4, 5}),
        (False, set()),
        ("adjacent-off", {2, 3, 4, 5}),
        ("overlapping-off", set()),
    ],
)
def test_an_mjcf_whose_masks_keep_the_links_apart(choice: Any, expected: set[int], tmp_path: Path) -> None:
    """Two hinges on a body are a chain with a frame between: its ends are neighbours all the same."""
    robot = mjcf(tmp_path, self_collision=choice)
    assert steps_apart(robot) == expected
    floor, loose = robot.shapes["floor"][0], robot.shapes["loose"][0]
    links = [robot.shapes[f"link{index}"][0] for index in range(LINKS)]
    meeting = meeting_pairs(robot.builder)
    for link, other in itertools.product(links, (floor, loose)):
        assert tuple(sorted((link, other))) in meeting  # what is no part of the robot stays as it was


def test_a_robot_whose_overlapping_parts_are_kept_apart_starts_without_a_warning(tmp_path: Path) -> None:
    with pytest.warns(sw.InitialStateWarning, match=r"shapes overlap: 'link.' and 'link.' by"):
        sw.Simulation(chain(tmp_path).builder.finalize(1, "cpu"), 1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sim = sw.Simulation(chain(tmp_path, self_collision="overlapping-off").builder.finalize(1, "cpu"), 1e-3)
    assert not sim.check_state()
    assert sim.problems() == []


@pytest.mark.parametrize("choice", ["adjacent", "on", 1, 0.0, ["adjacent-off"]])
def test_other_choices_are_one_line(choice: Any, tmp_path: Path) -> None:
    with pytest.raises(sw.ModelError, match="self_collision must be True, False, 'adjacent-off' or") as caught:
        chain(tmp_path, self_collision=choice)
    assert "\n" not in str(caught.value)


def test_parts_of_other_robots_in_the_builder_stay(tmp_path: Path) -> None:
    """Two chains in one builder: the second one's choice is its own."""
    first = chain(tmp_path)
    before = meeting_pairs(first.builder)
    second = chain(tmp_path, builder=first.builder, prefix="b_", self_collision=False)
    own = {shape for shapes in second.shapes.values() for shape in shapes}
    after = meeting_pairs(first.builder)
    assert before <= after
    assert not [pair for pair in after if set(pair) <= own]
    assert [pair for pair in after if len(set(pair) & own) == 1]  # with the other robot


def test_a_fixed_base_is_a_neighbour_of_its_first_link(tmp_path: Path) -> None:
    parts, _ = ROBOTS["cylinders across each other"]
    assert cylinder(0.05, 0.1) in parts[0].shapes[0]
    (tmp_path / "arm.urdf").write_text(urdf(parts))
    choices: list[tuple[SelfCollision, bool]] = [(True, True), ("adjacent-off", False)]
    for choice, meets in choices:
        robot = sw.importers.load_urdf(tmp_path / "arm.urdf", base="fixed", self_collision=choice)
        pair = tuple(sorted((robot.shapes["link0"][0], robot.shapes["link1"][0])))
        assert (pair in meeting_pairs(robot.builder)) == meets
