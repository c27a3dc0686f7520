"""Ranges of the stops of joints: those that could cross are refused, and others stay in order when they are drawn."""

import itertools

import pytest

from simwarp.core.interop import to_torch
from simwarp.core.types import WORLD
from simwarp.tasks import InputError, Range, TaskConfig
from tests.tasks.randomisation.idle_task import IdleTask

LOWER, UPPER = "joint_limit_lower", "joint_limit_upper"


class Arm(IdleTask):
    """Two hinges with stops at -1 and 1."""

    name = "arm"

    def build(self, builder):
        for name in ("upper", "fore"):
            builder.add_body(name, mass=1.0, inertia=(1.0, 1.0, 1.0))
        builder.add_joint_revolute("shoulder", WORLD, 0, axis=(0, 1, 0), limit=(-1, 1))
        builder.add_joint_revolute("elbow", 0, 1, axis=(0, 1, 0), limit=(-1, 1))


def arm(ranges, worlds=64):
    return Arm(TaskConfig(randomise=ranges), worlds)


NARROW, TIE = "narrow the range", "narrow the ranges, or give both the same draw"


@pytest.mark.parametrize(
    ("ranges", "joint", "lower", "upper", "remedy"),
    [
        ({LOWER: Range(0.5, 1.5, mode="set")}, "shoulder", 1.5, 1, NARROW),
        ({LOWER: Range(0.5, 1.5, mode="set", only="elbow")}, "elbow", 1.5, 1, NARROW),
        ({UPPER: Range(-3.0, 0.0, mode="add")}, "shoulder", -1, -2, NARROW),
        ({LOWER: Range(0.0, 4.0, mode="add", grows=True)}, "shoulder", 3, 1, NARROW),
        ({LOWER: Range(-0.5, 0.5, mode="set"), UPPER: Range(0.2, 0.8, mode="set")}, "shoulder", 0.5, 0.2, TIE),
        (  # the same word, but one number for both hinges here, and one for each there
            {LOWER: Range(0, 3, mode="add", draw="a", shared=True), UPPER: Range(0, 3, mode="add", draw="a")},
            "shoulder", 2, 1, TIE,
        ),
        (  # of an episode here, of each step there
            {LOWER: Range(0, 3, mode="add", draw="a"), UPPER: Range(0, 3, mode="add", draw="a", when="step")},
            "shoulder", 2, 1, TIE,
        ),
    ],
)  # fmt: skip
def test_ranges_whose_stops_could_cross(ranges, joint, lower, upper, remedy):
    with pytest.raises(InputError) as caught:
        arm(ranges, 2)
    name = next(iter(ranges))
    assert str(caught.value) == (
        f"randomise '{name}': the stops of joint '{joint}' of task 'arm' could cross, lower {lower:g} above upper "
        f"{upper:g}; {remedy}"
    )


@pytest.mark.parametrize(
    "ranges",
    [
        {LOWER: Range(0.5, 1.5), UPPER: Range(0.1, 2.0)},
        {LOWER: Range(-0.5, 0.5, mode="set"), UPPER: Range(0.5, 0.8, mode="set")},  # they may meet
        {name: Range(-3.0, 3.0, mode="add", draw="both") for name in (LOWER, UPPER)},  # they shift together
        {name: Range(-3.0, 3.0, mode="add", draw="both", grows=True, shared=True) for name in (LOWER, UPPER)},
    ],
)
def test_ranges_whose_stops_stay_in_order(ranges):
    task = arm(ranges)
    model = task.simulation.model
    for level, _ in itertools.product((1.0, 0.4), range(3)):
        task.level.fill_(level)
        task.restart()
        lower, upper = to_torch(model.joint_limit_lower), to_torch(model.joint_limit_upper)
        assert (lower <= upper).all()
        assert len(set(lower[:, 0].tolist())) > 32
    assert not any("crossed" in line for line in task.simulation.problems())  # the arm may start outside them
