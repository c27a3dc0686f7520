"""Stops of joints by world: a lower one above the upper one is refused where it is written, or told by `problems`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import simwarp as sw
from simwarp.core.types import WORLD, Dof, ModelError
from simwarp.model.builder import ModelBuilder

WORLDS = 3
LIMITS = ("joint_limit_lower", "joint_limit_upper")
HINGE, REACH, TURN = 0, 1, 2


def built(per_world: tuple[str, ...] = LIMITS) -> sw.Model:
    """A hinge within -1..1, and a slide within 0.2..0.5 that may turn within -0.3..0.3."""
    builder = ModelBuilder()
    for name in ("arm", "rod"):
        builder.add_body(name, mass=1.0, inertia=(1, 1, 1))
    builder.add_joint_revolute("hinge", WORLD, 0, axis=(0, 1, 0), limit=(-1, 1))
    builder.add_joint_cylindrical(
        "thread", WORLD, 1, axis=(0, 0, 1), dofs=(Dof(limit=(0.2, 0.5)), Dof(limit=(-0.3, 0.3)))
    )
    return builder.finalize(WORLDS, "cpu", per_world=per_world)


WRITES: dict[str, Callable[[Any, np.ndarray], None]] = {
    "slice": lambda array, values: array.__setitem__(slice(None), values),
    "column": lambda array, values: array.__setitem__((slice(None), REACH), values[:, REACH]),
    "row": lambda array, values: array.__setitem__(1, values[1]),
    "element": lambda array, values: array.__setitem__((1, REACH), float(values[1, REACH])),
    "row of a view": lambda array, values: array[1].__setitem__(REACH, float(values[1, REACH])),
    "assign": lambda array, values: array.assign(values),
    "tensor": lambda array, values: array.__setitem__(slice(None), torch.from_numpy(values)),
    "warp": lambda array, values: array.__setitem__(slice(None), wp.array(values, dtype=float, device="cpu")),
}


@pytest.mark.parametrize("write", WRITES.values(), ids=WRITES)
@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        (
            "joint_limit_lower", 0.75,
            "0.75 of joint 'thread' (coordinate 0) in world 1 must be at most its upper stop 0.5; give less,",
        ),
        (
            "joint_limit_upper", 0.125,
            "0.125 of joint 'thread' (coordinate 0) in world 1 must be at least its lower stop 0.2; give more,",
        ),
    ],
)  # fmt: skip
def test_a_stop_beyond_the_other_one_is_refused(write, name, value, message):
    model = built()
    array = getattr(model, name)
    before = array.numpy().copy()
    wrong = before.copy()
    wrong[1, REACH] = value
    with pytest.raises(ModelError) as caught:
        write(array, wrong)
    other = next(each for each in LIMITS if each != name)
    assert str(caught.value) == f"model.{name}: {message} or write {other} first"
    np.testing.assert_array_equal(array.numpy(), before)


def crossed(sim):
    """Lines on stops that crossed, without those on coordinates that start outside."""
    lines = [line.partition("; outside limits")[0] for line in sim.problems()]
    return [line for line in lines if "crossed" in line]


def test_stops_move_one_after_the_other_and_may_meet():
    model = built()
    model.joint_limit_upper[1, HINGE] = 3.0
    model.joint_limit_lower[1, HINGE] = 2.0  # above the upper stop as it was built
    with pytest.raises(ModelError, match=r"2 of joint 'hinge' in world 0 must be at most its upper stop 1"):
        model.joint_limit_lower[:, HINGE] = 2.0
    model.joint_limit_lower[1, HINGE] = 3.0
    model.joint_limit_upper.fill_(1e30)
    model.joint_limit_lower.fill_(-1e30)
    assert crossed(sw.Simulation(model, 1e-3)) == []


def test_stops_that_are_filled_and_zeroed():
    model = built()
    with pytest.raises(ModelError, match=r"2 of joint 'hinge' in world 0 must be at most its upper stop 1"):
        model.joint_limit_lower.fill_(2.0)
    with pytest.raises(ModelError, match=r"0 of joint 'thread' \(coordinate 0\) in world 0 must be at least"):
        model.joint_limit_upper.zero_()


@pytest.mark.parametrize("per_world", [(), LIMITS[:1], LIMITS[1:]])
def test_stops_that_worlds_share(per_world):
    model = built(per_world)
    if per_world == LIMITS[1:]:
        model.joint_limit_upper[2, HINGE] = 0.0
        where = r"in world 2 must be at most its upper stop 0;"
    else:
        where = r"in world 0 must be at most its upper stop 1;" if per_world else r"in all worlds must be at most"
    with pytest.raises(ModelError, match=rf"1\.5 of joint 'hinge' {where}"):
        model.joint_limit_lower[0, HINGE] = 1.5
    model.joint_limit_lower[0, HINGE] = -0.5


@pytest.mark.parametrize("per_world", [(), LIMITS[:1], LIMITS])
def test_stops_that_crossed_through_a_torch_view_are_problems(per_world):
    """A view writes the memory itself, which nobody can check; so does what is written on a GPU."""
    model = built(per_world)
    sim = sw.Simulation(model, 1e-3)
    assert crossed(sim) == []
    sw.to_torch(model.joint_limit_lower)[-1, TURN] = 0.5
    worlds = [WORLDS - 1] if per_world else range(WORLDS)
    assert crossed(sim) == [
        f"world {world}: stops of joint 'thread' (coordinate 1) crossed: lower 0.5 is above upper 0.3; write them in "
        "order"
        for world in worlds
    ]
