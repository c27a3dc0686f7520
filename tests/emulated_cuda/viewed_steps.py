"""A page beside steps of the emulated device; prints as JSON which steps it showed, and whether it waited for one.

`python -m tests.emulated_cuda tests/emulated_cuda/viewed_steps.py [--unsynchronised]`
"""

from __future__ import annotations

import json
import sys

import numpy as np
import warp as wp

import simwarp as sw
from simwarp.scenes import ant
from simwarp.viewer.live import LiveView
from tests.emulated_cuda.device import device
from tests.emulated_cuda.settings import StreamOrder

CUDA = "cuda:0"
WORLDS, STEPS = 3, 12
SHOWN = [2, 0]


def simulation() -> sw.Simulation:
    """Ants that fall, each from another height."""
    found = sw.Simulation(ant().finalize(WORLDS, CUDA), 0.01)
    found.set_joint_state(None, None, np.linspace(0.0, 1.0, WORLDS * found.model.dof_count).reshape(WORLDS, -1))
    return found


def places(sim: sw.Simulation) -> np.ndarray:
    """(S, B, 3) of the shown worlds."""
    return np.asarray(sim.state.body_x.numpy()[SHOWN])


def step_of(found: np.ndarray, truth: list[np.ndarray]) -> int:
    """After which step the bodies were there; -1: after none."""
    return next((index for index, each in enumerate(truth) if np.array_equal(found, each)), -1)


def main(arguments: list[str]) -> None:
    """Look at steps whose streams run as late as they may."""
    wp.config.log_level = wp.LOG_WARNING
    target = device()
    target.streams.order = StreamOrder.EAGER
    sim = simulation()
    truth = [places(sim)]
    for _ in range(STEPS):
        sim.step()
        truth.append(places(sim))
    sim = simulation()
    view = LiveView(sim, worlds=SHOWN, port=0)
    if "--unsynchronised" in arguments:
        wp.Event.is_complete = property(lambda self: True)  # type: ignore[assignment, method-assign]
    target.streams.order = target.settings.streams
    shown, waited = [], []
    for _ in range(STEPS):
        sim.step()
        marker = target.streams.at(wp.get_stream(CUDA).cuda_stream).last
        view.page.frame(waits=False)
        waited.append(bool(marker is not None and marker.done))
        shown.append(step_of(view.page.bodies.positions, truth))
    view.page.frame()
    last = step_of(view.page.bodies.positions, truth)
    view.stop()
    print(
        json.dumps({"shown": shown, "waited": waited, "last": last, "faults": [t for t, _ in target.faults.violations]})
    )


if __name__ == "__main__":
    main(sys.argv[1:])
