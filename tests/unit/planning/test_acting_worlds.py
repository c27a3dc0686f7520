"""Whatever has actions is planned for as a task is: plans know tasks by what they offer alone."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import torch

import simwarp as sw
from simwarp.planning import Imagination, Mppi, MppiConfig
from tests.unit.planning.linear_carts import FULL, HORIZON, STEPS, cart, cost, imagine, states

CONFIG = MppiConfig(horizon=HORIZON, noise=5.0 / FULL, temperature=0.1)


class PushedCarts:
    """Carts that take shares of the full force."""

    agents, action_size = 1, 1

    def __init__(self, worlds: int) -> None:
        self.num_worlds, self.device, self.simulation = worlds, torch.device("cpu"), cart(worlds)
        self._force = sw.to_torch(self.simulation.control.joint_force)

    def look_ahead(self, action: torch.Tensor) -> None:
        self._force.copy_(FULL * action)
        self.simulation.step(STEPS)

    def copy_worlds(self, source: Any, targets: Any = None, *, of: Any = None) -> None:
        self.simulation.copy_worlds(source, targets, of=None if of is None else of.simulation)


def test_worlds_of_another_class_are_planned_for():
    real, imagined = PushedCarts(2), PushedCarts(32)
    planner = Mppi(
        Imagination(real, imagined), lambda worlds, action: cost(worlds.simulation, FULL * action), CONFIG
    )  # fmt: skip
    begin = states(real.simulation).abs().sum(dim=1)
    for _ in range(30):
        real.look_ahead(planner.plan())
    assert (states(real.simulation).abs().sum(dim=1) < 0.2 * begin).all()


def test_they_get_the_plans_that_a_simulation_gets():
    own = Mppi(
        Imagination(PushedCarts(1), PushedCarts(16)),
        lambda worlds, action: cost(worlds.simulation, FULL * action), CONFIG,
    )  # fmt: skip
    plain = Mppi(imagine(cart(1), 16), cost, MppiConfig(horizon=HORIZON, noise=5.0, temperature=0.1))
    # the same draws, in units of the bounds here and of the force there: rounding of float32
    torch.testing.assert_close(FULL * own.plan(), plain.plan(), rtol=1e-4, atol=1e-4)


def test_planning_does_not_load_tasks():
    code = "import simwarp.planning, sys; print(sorted(name for name in sys.modules if name == 'simwarp.tasks'))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().splitlines()[-1] == "[]"
