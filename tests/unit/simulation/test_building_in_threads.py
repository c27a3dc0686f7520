"""Simulations that several threads build and step at a time: each records graphs of its own, and gets the bits that it
would get alone.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import pytest
import warp as wp

import simwarp as sw

WORLDS = 6
T = TypeVar("T")


def hinge(threads: int = 1, rate: float = 0.5) -> sw.Simulation:
    """A body on a hinge, of another mass in every world: columns of parameters are strided copies."""
    builder = sw.ModelBuilder()
    builder.add_body("bob", mass=1.0, inertia=(1, 1, 1))
    builder.add_joint_revolute("hinge", sw.WORLD, 0, anchor=(0, 0, 1), axis=(0, 1, 0))
    model = builder.finalize(WORLDS, "cpu", per_world=["body_mass"])
    model.body_mass[:, 0] = np.linspace(1.0, 2.0, WORLDS)
    sim = sw.Simulation(model, 0.01, threads=threads)
    sim.set_joint_state(None, [0.3], [rate])
    return sim


def swing(rate: float = 0.5) -> npt.NDArray[np.float64]:
    """A simulation's whole life: built, stepped, some worlds reset, stepped on, restored."""
    sim = hinge(rate=rate)
    sim.step(3)
    kept = sim.snapshot()
    sim.reset(np.arange(WORLDS) % 2 == 0)
    sim.step(2)
    after = sim.state.joint_x.numpy().copy()
    sim.restore(kept)
    sim.step(2)
    return np.concatenate([after, sim.state.joint_x.numpy()])


def in_another_thread(work: Callable[[], T]) -> T:
    with ThreadPoolExecutor(1) as other:
        return other.submit(work).result()


def test_one_is_built_and_stepped_while_another_thread_records():
    alone, sim = swing(), hinge()
    sim.step(2)
    expected = sim.state.joint_x.numpy().copy()
    sim.set_joint_state(None, [0.3], [0.5])
    with wp.ScopedCapture(device="cpu") as capture:
        sim.step()
        assert sim.model.device.is_capturing
        np.testing.assert_array_equal(in_another_thread(swing), alone)
        assert in_another_thread(lambda: sim.model.device.is_capturing) is False
    for _ in range(2):
        wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(sim.state.joint_x.numpy(), expected)


def test_each_thread_records_at_a_time_with_the_others():
    """Two threads in a capture of their own, at the same time: neither sees the launches of the other."""
    rates = (0.5, -0.8)
    expected = []
    for rate in rates:
        sim = hinge(rate=rate)
        sim.step(2)
        expected.append(sim.state.joint_x.numpy().copy())
    meet = threading.Barrier(2, timeout=60.0)

    def record(rate: float) -> npt.NDArray[np.float64]:
        sim = hinge(rate=rate)
        meet.wait()
        with wp.ScopedCapture(device="cpu") as capture:
            meet.wait()
            sim.step()
            meet.wait()
        for _ in range(2):
            wp.capture_launch(capture.graph)
        found: npt.NDArray[np.float64] = sim.state.joint_x.numpy().copy()
        return found

    with ThreadPoolExecutor(2) as both:
        np.testing.assert_array_equal(list(both.map(record, rates)), expected)


def test_many_threads_build_many():
    rates = [0.1 * k for k in range(24)]
    alone = [swing(rate) for rate in rates]
    with ThreadPoolExecutor(8) as pool:
        np.testing.assert_array_equal(list(pool.map(swing, rates)), alone)


@pytest.mark.parametrize("threads", [1, 2])
def test_a_step_is_recorded_whole_whatever_its_threads(threads):
    """Warp records launches of the thread that captures: the chunks of the others must not be left out."""
    sim, plain = hinge(threads), hinge(threads)
    before = sim.state.joint_x.numpy().copy()
    with wp.ScopedCapture(device="cpu") as capture:
        sim.step()
    np.testing.assert_array_equal(sim.state.joint_x.numpy(), before)  # recorded, not done
    for _ in range(3):
        wp.capture_launch(capture.graph)
    plain.step(3)
    np.testing.assert_array_equal(sim.state.joint_x.numpy(), plain.state.joint_x.numpy())
