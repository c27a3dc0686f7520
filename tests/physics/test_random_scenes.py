"""Random models with contacts: finite or flagged, worlds independent, every flagged world named."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import WorldStatus
from tests.reference.random_scenes import random_scene, random_speeds

STATE = ("body_x", "body_rot", "body_v", "body_omega", "joint_q", "joint_qd")


@dataclasses.dataclass
class Outcome:
    """What one model did."""

    seed: int
    flags: int
    lines: list[str]
    fastest: float
    built_speed: float
    seconds: float


def start(seed: int, worlds: list[int]) -> sw.Simulation:
    """The model with these of its worlds."""
    builder, dt = random_scene(seed)
    sim = sw.Simulation(builder.finalize(len(worlds), "cpu"), dt, solver=sw.SolverOptions(max_iterations=200))
    v = sim.state.body_v.numpy() + np.array([random_speeds(builder, world) for world in worlds], np.float32)
    sim.state.body_v.assign(v)
    sim.measure()
    return sim


def check_model(seed: int, worlds: int, steps: int) -> Outcome:
    """Steps one model and asserts the three laws."""
    began = time.perf_counter()
    sim = start(seed, list(range(worlds)))
    built = float(np.linalg.norm(sim.state.body_v.numpy(), axis=2).max())
    alone = [0, worlds // 2, worlds - 1]
    few = start(seed, alone)
    for _ in range(steps):
        sim.step()
        few.step()
    status = sim.state.world_status.numpy()
    named = {int(line.split()[1].rstrip(":")) for line in sim.problems()}
    finite = np.ones(worlds, bool)
    for name in STATE:
        values = getattr(sim.state, name).numpy()
        same = np.array_equal(values[alone], getattr(few.state, name).numpy(), equal_nan=True)
        assert same, f"model {seed}: {name} of worlds {alone} differs when they run alone"
        finite &= np.isfinite(values.reshape(worlds, -1)).all(axis=1)
    flagged = (status & WorldStatus.NON_FINITE) != 0
    assert (finite | flagged).all(), f"model {seed}: worlds {np.nonzero(~finite & ~flagged)[0]} are not flagged"
    troubled = set(np.nonzero((status != 0) | (sim.contacts.contact_overflow.numpy() > 0))[0].tolist())
    assert troubled <= named, f"model {seed}: problems() leaves out {sorted(troubled - named)}"
    v = sim.state.body_v.numpy()[~flagged]
    fastest = float(np.linalg.norm(v, axis=2).max(initial=0.0))
    return Outcome(seed, int(flagged.sum()), sim.problems(), fastest, built, time.perf_counter() - began)


@pytest.mark.parametrize("seed", range(4))
def test_random_models(seed: int) -> None:
    check_model(seed, 10, 50)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100))
def test_many_random_models(seed: int) -> None:
    check_model(seed, 100, 200)
