"""A page beside steps of a GPU: poses arrive by a pinned copy with an event, and nobody waits for the steps."""

from __future__ import annotations

import json

import pytest

from tests.emulated_cuda.emulated_runs import HERE, run_emulated, skip_where_unavailable
from tests.emulated_cuda.settings import StreamOrder

pytest.importorskip("viser")
pytestmark = pytest.mark.slow
PROGRAM = str(HERE / "viewed_steps.py")
LATEST = 3
"""Steps that a frame may be behind: a copy is queued in one frame, and found to have arrived two frames later."""


def looked_at(order: StreamOrder, *arguments: str):
    """What the page showed."""
    skip_where_unavailable()
    return json.loads(run_emulated(PROGRAM, *arguments, streams=order).splitlines()[-1])


def is_in_time(shown: list[int]) -> bool:
    """Whether each frame is a state that there was, none older than the one before, nor too old."""
    whole = all(each >= 0 for each in shown) and shown == sorted(shown)
    return whole and all(step - each <= LATEST for step, each in enumerate(shown, start=1))


@pytest.mark.parametrize("order", list(StreamOrder))
def test_frames_are_whole_states_that_have_just_been(order):
    found = looked_at(order)
    assert is_in_time(found["shown"]), found
    assert found["last"] == len(found["shown"])  # a frame that waits has the present
    assert found["faults"] == []
    if order is StreamOrder.LAZY:
        assert not any(found["waited"])


def test_a_missing_event_is_found():
    found = looked_at(StreamOrder.LAZY, "--unsynchronised")
    assert not is_in_time(found["shown"]), found
