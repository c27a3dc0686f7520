"""Comparisons of two devices: what differs is seen, in the state, in pictures and in ranges."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simwarp.bench import agreement
from simwarp.bench.agreement import POSITION, RANGE, compare, disagreements

SCENES = ["double-pendulum", "camera-flat", "lidar"]


@pytest.mark.parametrize("name", SCENES)
def test_a_device_agrees_with_itself(name):
    row = compare(name, "cpu", worlds=2, steps=2)
    assert row.agrees
    assert row.repeats
    assert row.position == 0.0
    assert row.frames == (None if name == "double-pendulum" else 0.0)
    assert disagreements([row]) == []


def compared(monkeypatch, *runs):
    """The row of runs that gave these arrays: of the host, of the device, of the device again."""
    turns = iter(runs)
    monkeypatch.setattr(agreement, "_arrays_after", lambda *args: (next(turns), 0.1))
    return compare("any", "cuda:0", 2)


def arrays(position=0.0, ranges=0.0, picture=0):
    state = {"body_x": np.full((2, 1, 3), position), "joint_q": np.zeros((2, 1))}
    lidar = np.full((2, 100), ranges, np.float32)
    lidar[:, 0] = np.inf  # a ray that met nothing
    return state | {"lidar": lidar, "camera": np.full((2, 100), picture, np.uint8)}


@pytest.mark.parametrize(
    ("other", "agrees"),
    [
        (arrays(), True),
        (arrays(position=0.9 * POSITION, ranges=0.9 * RANGE), True),
        (arrays(position=1.1 * POSITION), False),
        (arrays(position=np.nan), False),
        (arrays(ranges=1.1 * RANGE), False),
        (arrays(ranges=np.nan), False),
        (arrays(picture=1), False),
    ],
)
def test_what_differs_is_seen(monkeypatch, other, agrees):
    row = compared(monkeypatch, arrays(), other, other)
    assert row.repeats
    assert row.agrees == agrees
    assert bool(disagreements([row])) != agrees


def test_two_runs_that_differ_are_named(monkeypatch):
    row = compared(monkeypatch, arrays(), arrays(), arrays(ranges=1e-7))
    assert not row.agrees
    assert disagreements([dataclasses.replace(row, scene="lidar")]) == ["lidar: two runs differ"]
