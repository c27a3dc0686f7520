"""Plans of a linear system against Riccati's recursion in float64."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

import simwarp as sw
from simwarp.planning import CrossEntropy, CrossEntropyConfig, Ilqr, IlqrConfig, Mppi, MppiConfig
from tests.unit.planning.linear_carts import (
    HORIZON,
    STEPS,
    cart,
    cost,
    end_cost,
    end_state_cost,
    first_cost,
    imagine,
    matrices,
    optimal_cost,
    state_cost,
    states,
)

SAMPLES = 64
KNOTS = {"horizon": HORIZON, "knots": 8, "iterations": 20, "seed": 3}


def mppi(real: sw.Simulation, worlds: int = SAMPLES, **options: Any) -> Mppi:
    config = MppiConfig(**{**KNOTS, "noise": 2.0, "temperature": 0.1, **options})
    return Mppi(imagine(real, worlds), cost, config, end_cost=end_cost)


def cem(real: sw.Simulation, worlds: int = SAMPLES, **options: Any) -> CrossEntropy:
    config = CrossEntropyConfig(**{**KNOTS, "noise": 5.0, "elites": 8, **options})
    return CrossEntropy(imagine(real, worlds), cost, config, end_cost=end_cost)


SAMPLERS: dict[str, Callable[..., Any]] = {"mppi": mppi, "cem": cem}


def test_the_step_is_the_linear_system_of_the_reference():
    sim = cart(1, (0.3, -0.7))
    sw.to_torch(sim.control.joint_force).fill_(5.0)
    sim.step(STEPS)
    a, b = matrices()
    # float32 speeds: ten steps of rounding at 0.7 m/s
    assert states(sim).numpy()[0] == pytest.approx(a @ (0.3, -0.7) + b[:, 0] * 5.0, abs=1e-6)


@pytest.mark.parametrize("worlds", [16, 50])
def test_ilqr_finds_the_optimum_of_a_linear_system_in_one_iteration(worlds):
    """Whatever the number of worlds that differences are taken in."""
    real = cart(1)
    planner = Ilqr(
        imagine(real, worlds), state_cost, IlqrConfig(horizon=HORIZON, iterations=1), end_cost=end_state_cost
    )
    planner.plan()
    # slopes are good to 1e-4 (float32 rates over steps of 1e-2), and the cost is flat about the optimum
    assert planner.cost == pytest.approx(optimal_cost(), rel=1e-6)
    a, b = matrices()
    value, gain = np.diag([10.0, 1.0]), np.zeros((1, 2))
    for _ in range(HORIZON):
        gain = np.linalg.solve(0.01 + b.T @ value @ b, b.T @ value @ a)
        value = np.diag([1.0, 0.1]) + a.T @ value @ (a - b @ gain)
    assert planner.gains[0].numpy() == pytest.approx(-gain, rel=1e-3)


def test_ilqr_keeps_to_bounds():
    real = cart(1, (8.0, 0.0))
    planner = Ilqr(imagine(real, 16), state_cost, IlqrConfig(horizon=HORIZON), end_cost=end_state_cost)
    assert planner.plan().item() == -20.0
    assert (planner.actions.abs() <= 20.0).all()
    assert planner.cost > optimal_cost((8.0, 0.0))


@pytest.mark.parametrize("name", SAMPLERS)
def test_samples_come_near_the_optimum(name):
    real = cart(1)
    planner = SAMPLERS[name](real)
    planner.plan()
    found = planner.best_cost.item() + first_cost()
    # lines between eight knots cost 0.2 % more than the optimum. Samples of 2 N about a plan add some 0.02 (2 N)² a
    # step, 1.6 in all; the mean of the ten or so that count leaves a tenth of it, 2 % of the optimum, the best half
    assert optimal_cost() - 1e-4 < found < 1.03 * optimal_cost()


@pytest.mark.parametrize("name", SAMPLERS)
def test_carts_are_driven_to_rest(name):
    """Receding horizon: in 3 s the cost falls to what is left of a linear regulator, within the noise of samples."""
    real = cart(1)
    planner = SAMPLERS[name](real, 32, iterations=2)
    force = sw.to_torch(real.control.joint_force)
    for _ in range(30):
        force.copy_(planner.plan())
        real.step(STEPS)
    place, speed = states(real)[0].tolist()
    assert abs(place) < 0.1
    assert abs(speed) < 0.3


@pytest.mark.parametrize("name", SAMPLERS)
def test_imagining_never_changes_the_real_worlds(name):
    real = cart(3)
    sw.to_torch(real.control.joint_force).fill_(1.0)
    real.step(4)
    before = {key: array.numpy().copy() for key, array in real.snapshot().arrays().items()}
    planner = SAMPLERS[name](real, 3 * 16, iterations=2)
    first = planner.plan()
    assert first.shape == (3, 1)
    for key, array in real.snapshot().arrays().items():
        assert array.numpy().tobytes() == before[key].tobytes(), key


@pytest.mark.parametrize("name", SAMPLERS)
def test_plans_are_the_same_bits_for_a_seed_and_any_number_of_threads(name):
    found = []
    before = torch.get_num_threads()
    try:
        for torch_threads, threads in ((1, 1), (2, 2)):
            torch.set_num_threads(torch_threads)
            real = cart(1)
            config: dict[str, Any] = {**KNOTS, "iterations": 2, "noise": 3.0}
            imagination = imagine(real, SAMPLES, threads=threads)
            if name == "mppi":
                planner: Any = Mppi(imagination, cost, MppiConfig(**config), end_cost=end_cost)
            else:
                planner = CrossEntropy(imagination, cost, CrossEntropyConfig(**config), end_cost=end_cost)
            for _ in range(3):
                planner.plan()
            found.append(planner.knots.numpy().tobytes())
    finally:
        torch.set_num_threads(before)
    assert found[0] == found[1]
    other = SAMPLERS[name](cart(1), iterations=2, seed=4)
    for _ in range(3):
        other.plan()
    assert other.knots.numpy().tobytes() != found[0]


def test_each_real_world_has_a_plan_of_its_own_as_if_it_were_alone():
    both, alone = cart(2), cart(1, (-0.5, 0.2))
    both.set_joint_state(None, np.array([[1.0], [-0.5]]), np.array([[0.0], [0.2]]))
    two, one = mppi(both, 2 * SAMPLES, iterations=3), mppi(alone, SAMPLES, iterations=3)
    assert torch.equal(two.plan()[1], one.plan()[0])
    assert torch.equal(two.knots[1], one.knots[0])


def test_a_plan_begins_where_the_last_one_goes_on():
    real = cart(1)
    planner = mppi(real, iterations=1, knots=None, noise=1e-6)
    start = torch.linspace(-1.0, 1.0, HORIZON).view(1, HORIZON, 1)
    planner.reset(start)
    planner.plan()
    assert torch.allclose(planner.knots, start, atol=1e-5)
    planner.plan()
    assert torch.allclose(planner.knots[0, :-1], start[0, 1:], atol=1e-5)
    assert torch.allclose(planner.knots[0, -1], start[0, -1], atol=1e-5)


@pytest.mark.parametrize("name", SAMPLERS)
def test_worlds_that_break_down_do_not_count(name):
    real = cart(1)
    sw.to_torch(real.control.joint_force).zero_()

    def breaking(sim: sw.Simulation, action: torch.Tensor) -> torch.Tensor:
        return torch.where(action[:, 0] > 0.0, torch.nan, cost(sim, action))

    config: dict[str, Any] = {"horizon": 5, "noise": 3.0}
    imagination = imagine(real, SAMPLES)
    if name == "mppi":
        planner: Any = Mppi(imagination, breaking, MppiConfig(**config))
    else:
        planner = CrossEntropy(imagination, breaking, CrossEntropyConfig(**config))
    planner.plan()
    assert torch.isfinite(planner.knots).all()
    imagination_of_none = imagine(real, SAMPLES)
    dead = Mppi(imagination_of_none, lambda sim, action: action[:, 0] * torch.nan, MppiConfig(**config))
    dead.plan()
    assert (dead.knots == 0.0).all()
