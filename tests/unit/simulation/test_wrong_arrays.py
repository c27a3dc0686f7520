"""Masks and values that do not fit: one line that names the call, the rule, what was given, and what helps."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import simwarp as sw
from simwarp.core.types import WORLD, ModelError
from simwarp.kinematics.inverse_kinematics import InverseKinematics
from simwarp.model.builder import ModelBuilder

WORLDS = 3


@pytest.fixture(scope="module")
def sim() -> sw.Simulation:
    builder = ModelBuilder()
    for name in ("upper", "fore"):
        builder.add_body(name, mass=1.0, inertia=(1, 1, 1))
    builder.add_joint_revolute("shoulder", WORLD, 0, axis=(0, 1, 0), anchor=(0, 0, 1))
    builder.add_joint_revolute("elbow", 0, 1, axis=(0, 1, 0), anchor=(0, 0, -1))
    return sw.Simulation(builder.finalize(WORLDS, "cpu"), 1e-3, threads=1)


CALLS: dict[str, Callable[[sw.Simulation, Any], None]] = {
    "reset": lambda sim, mask: sim.reset(mask),
    "begin_sensors": lambda sim, mask: sim.begin_sensors(mask),
    "set_joint_state": lambda sim, mask: sim.set_joint_state(mask, None, None),
    "measure": lambda sim, mask: sim.measure(mask),
}
SHAPE = "must have shape (3,) (worlds)"
EACH = "give one bool for each world"
MASKS: dict[str, tuple[Any, str]] = {
    "too short": ([True, False], f"{SHAPE}, got (2,); {EACH}"),
    "two axes": (np.ones((3, 1), bool), f"{SHAPE}, got (3, 1); {EACH}"),
    "a bool": (True, f"{SHAPE}, got (); {EACH}"),
    "ragged": ([[True], [True, False]], f"{SHAPE}, got [[True], [True, False]]; {EACH}"),
    "torch": (torch.ones(4, dtype=torch.bool), f"{SHAPE}, got (4,); {EACH}"),
    "warp": (wp.zeros(2, dtype=wp.bool, device="cpu"), f"{SHAPE}, got (2,); {EACH}"),
    "indices": ([0, 2, 1], f"must be of bool, got int64 (3,); {EACH}, not indices of worlds"),
    "text": ("abc", f"must be of bool, got 'abc'; {EACH}"),
    "nothing": ([None] * 3, f"must be of bool, got [None, None, None]; {EACH}"),
    "torch of integers": (
        torch.ones(3, dtype=torch.int64), "must be of bool, got a tensor of int64 (3,); compare it, as in `mask > 0`"
    ),
    "torch of floats": (
        torch.ones(3), "must be of bool, got a tensor of float32 (3,); compare it, as in `mask > 0`"
    ),
    "warp of integers": (
        wp.zeros(3, dtype=wp.int32, device="cpu"),
        "must be of bool, got a Warp array of int32 (3,); make it with dtype=wp.bool",
    ),
}  # fmt: skip


def refusal(call: Callable[[], object]) -> str:
    with pytest.raises(ModelError) as caught:
        call()
    message = str(caught.value)
    assert message.isprintable()
    return message


@pytest.mark.parametrize("mask", MASKS)
@pytest.mark.parametrize("call", CALLS)
def test_masks(sim, call, mask):
    value, message = MASKS[mask]
    assert refusal(lambda: CALLS[call](sim, value)) == f"{call}: world_mask {message}"


ROWS = "must have shape (3, 2) (worlds, dofs)"
VALUES: dict[str, tuple[Any, str]] = {
    "too many worlds": (np.zeros((4, 2)), f"{ROWS}, got (4, 2); give one row, or one for each world"),
    "too many dofs": ([[0.0] * 3] * 3, f"{ROWS}, got (3, 3); give one row, or one for each world"),
    "torch": (torch.zeros(3), f"{ROWS}, got (3,); tensors and Warp arrays need one row for each world"),
    "warp": (
        wp.zeros((1, 2), dtype=wp.float32, device="cpu"),
        f"{ROWS}, got (1, 2); tensors and Warp arrays need one row for each world",
    ),
    "no numbers": (
        [["a", "b"]], "must be finite numbers of shape (3, 2) (worlds, dofs), got [['a', 'b']]; pass an array"
    ),
    "complex tensor": (
        torch.zeros(3, 2, dtype=torch.complex64),
        "must be real numbers of shape (3, 2) (worlds, dofs), got a tensor of complex64 (3, 2); take its real part",
    ),
}  # fmt: skip


@pytest.mark.parametrize("value", VALUES)
@pytest.mark.parametrize("name", ["q", "qd"])
def test_coordinates_and_rates(sim, name, value):
    given, message = VALUES[value]
    arguments = {"q": None, "qd": None, name: given}
    assert refusal(lambda: sim.set_joint_state(None, **arguments)) == f"set_joint_state: {name} {message}"


def test_where_a_search_begins(sim):
    search = InverseKinematics(sim, "fore")
    rule = "InverseKinematics: start must be a Warp array of float32 of shape (3, 2) (worlds, dofs), got "
    remedy = "; leave it out to begin at the present coordinates"
    starts: tuple[tuple[Any, str], ...] = (
        (wp.zeros((3, 2), dtype=wp.float64, device="cpu"), "float64 (3, 2)"),
        (wp.zeros((3, 1), dtype=wp.float32, device="cpu"), "float32 (3, 1)"),
        ([0.0], "[0.0]"),
    )
    for start, given in starts:
        assert refusal(partial(search.solve, start)) == rule + given + remedy
