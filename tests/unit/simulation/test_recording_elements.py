"""Force elements that call back while a Simulation is built, or record what is no launch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes


class Element(sw.ForceElement):
    """Records what it is told to."""

    def __init__(self, act: Callable[[Any], Any]) -> None:
        self._act = act

    def record(self, simulation: Any, dt: float) -> Any:
        return self._act(simulation)


def built(act: Callable[[Any], Any]) -> sw.Simulation:
    return sw.Simulation(scenes.pendulum().finalize(2, "cpu"), 1e-3, elements=[Element(act)])


NOTHING = "nothing"
CALLS: dict[str, Callable[[Any], Any]] = {
    "step": lambda sim: sim.step(),
    "reset": lambda sim: sim.reset(np.array([True, False])),
    "snapshot": lambda sim: sim.snapshot(),
    "set_joint_state": lambda sim: sim.set_joint_state(None, np.zeros((2, 1)), np.zeros((2, 1))),
    "measure_energy": lambda sim: sim.measure_energy(),
}


@pytest.mark.parametrize("call", CALLS)
def test_a_call_back_is_one_line_that_says_when(call: str) -> None:
    with pytest.raises(sw.ModelError, match=r"Element\.record: steps, resets and snapshots must wait until") as caught:
        built(CALLS[call])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("made", "words"), [(None, "return \\(\\) for none"), ([print], "take what shares.record returns")]
)
def test_what_is_no_launch_is_refused(made: Any, words: str) -> None:
    with pytest.raises(sw.ModelError, match=words):
        built(lambda _: made)


def test_errors_of_the_element_itself_pass() -> None:
    with pytest.raises(AttributeError, match="nothing"):
        built(lambda _: getattr(np.zeros(1), NOTHING))


def test_no_launches_are_fine() -> None:
    simulation = built(lambda _: ())
    simulation.step()
    assert simulation.time.numpy() == pytest.approx(1e-3)
