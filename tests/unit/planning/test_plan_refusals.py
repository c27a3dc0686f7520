"""Bad input of planners: one line that names the thing, the rule, the value and the remedy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

import simwarp as sw
from simwarp.planning import (
    ActionSpline,
    CrossEntropy,
    CrossEntropyConfig,
    Ilqr,
    Imagination,
    Mppi,
    MppiConfig,
    Spline,
)
from simwarp.tasks import InputError, make
from tests.unit.planning.linear_carts import cart, cost, imagine, state_cost


def anything(value: Any) -> Any:
    return value


def free_body(worlds: int) -> sw.Simulation:
    builder = sw.ModelBuilder()
    builder.add_body("stone", mass=1.0, inertia=(1, 1, 1))
    return sw.Simulation(builder.finalize(worlds, "cpu"), 0.01)


def pair(**options: Any) -> Imagination:
    return Imagination(cart(1), cart(4), **{"act": lambda action: None, "action_size": 1, **options})


REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "the same worlds": (lambda: same(), "imagined must be worlds of its own"),
    "a task and a simulation": (
        lambda: Imagination(make("pendulum", 1, device="cpu"), cart(2)), "must be two tasks or two Simulations, got ",
    ),
    "no act": (lambda: pair(act=None), "Simulations need act=function"),
    "no size": (lambda: pair(action_size=None), "Simulations need act=function"),
    "act of tasks": (
        lambda: Imagination(make("pendulum", 1, device="cpu"), make("pendulum", 2, device="cpu"), action_size=1),
        "must be left out for tasks",
    ),
    "steps": (lambda: pair(steps=0), "steps must be an integer >= 1, got 0"),
    "no such world": (lambda: pair(worlds=[1]), "each of worlds must be an integer >= 0 and <= 0, got 1"),
    "no world": (lambda: pair(worlds=[]), "as many worlds for each of 0 real ones"),
    "odd worlds": (
        lambda: Imagination(cart(3), cart(4), act=lambda action: None, action_size=1),
        "as many worlds for each of 3 real ones, got 4; take 6",
    ),
    "bounds": (lambda: pair(low=1.0, high=1.0), "low must be below high"),
    "bounds of others": (lambda: pair(low=(0.0, 0.0)), "low must be one number, or 1 for the action, got 2"),
    "one sample": (
        lambda: Mppi(imagine(cart(2), 2), cost), "samples must be 2 or more, got 1",
    ),
    "noise of others": (
        lambda: Mppi(imagine(cart(1), 4), cost, MppiConfig(noise=(1.0, 2.0))), "noise must be one number or 1",
    ),
    "elites": (
        lambda: CrossEntropy(imagine(cart(1), 4), cost, CrossEntropyConfig(elites=5)),
        "elites must be at most the 4 samples of a plan, got 5",
    ),
    "knots": (lambda: ActionSpline(5, 6, Spline.LINEAR, "cpu"), "knots must be from 1 to the horizon's 5 steps, got 6"),
    "cubic": (lambda: ActionSpline(9, 3, Spline.CUBIC, "cpu"), "knots must be from 4 to the horizon's 9 steps, got 3"),
    "temperature": (lambda: MppiConfig(temperature=0.0), "temperature must be positive, got 0.0"),
    "horizon": (lambda: MppiConfig(horizon=0), "horizon must be at least 1, got 0"),
    "spline": (lambda: MppiConfig(spline="smooth"), "spline must be one of hold, linear, cubic, got 'smooth'"),
    "seed": (lambda: MppiConfig(seed=-1), "seed must be zero or positive, got -1"),
    "cost of one number": (
        lambda: Mppi(imagine(cart(1), 4), lambda sim, action: action.sum()).plan(),
        "cost must return a tensor (4,), one for each world, got ()",
    ),
    "cost of a list": (
        lambda: Mppi(imagine(cart(1), 4), anything(lambda sim, action: [1.0])).plan(),
        "cost must return a tensor (4,), one for each world, got [1.0]",
    ),
    "ilqr of tasks": (
        lambda: Ilqr(Imagination(make("pendulum", 1, device="cpu"), make("pendulum", 2, device="cpu")), state_cost),
        "must be of Simulations, got tasks",
    ),
    "ilqr for two": (lambda: Ilqr(imagine(cart(2), 4), state_cost), "plans are for one real world, got 2"),
    "ilqr of a free body": (
        lambda: Ilqr(
            Imagination(free_body(1), free_body(2), act=lambda action: None, action_size=1), state_cost
        ),
        "got a body without a joint",
    ),
}  # fmt: skip


def same() -> object:
    sim = cart(2)
    return Imagination(sim, sim, act=lambda action: None, action_size=1)


@pytest.mark.parametrize(("call", "told"), REFUSED.values(), ids=REFUSED)
def test_one_line_says_what_is_wrong(call, told):
    with pytest.raises((sw.ModelError, InputError)) as caught:
        call()
    assert told in str(caught.value)
    assert str(caught.value).isprintable()


# ---- splines ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", Spline)
def test_a_spline_goes_through_its_knots(kind):
    spline = ActionSpline(13, 5, kind, "cpu")
    knots = torch.as_tensor(np.random.default_rng(0).normal(size=(2, 5, 3)))
    # knots lie at every third control step; sums of five terms in float64
    assert spline.actions(knots)[:, ::3].numpy() == pytest.approx(knots.numpy(), abs=1e-12)


def test_between_knots_a_spline_holds_or_goes_straight_or_smoothly():
    at = torch.arange(13, dtype=torch.float64).view(1, 13, 1)
    knots = at[:, ::3]
    assert ActionSpline(13, 5, Spline.HOLD, "cpu").actions(knots)[0, :4, 0].tolist() == [0.0, 0.0, 0.0, 3.0]
    assert ActionSpline(13, 5, Spline.LINEAR, "cpu").actions(knots).numpy() == pytest.approx(at.numpy(), abs=1e-12)
    cubes = ActionSpline(13, 5, Spline.CUBIC, "cpu").actions(knots**3)
    assert cubes.numpy() == pytest.approx((at**3).numpy(), rel=1e-12, abs=1e-9)


def test_a_shifted_spline_is_one_step_later():
    spline = ActionSpline(13, 5, Spline.CUBIC, "cpu")
    at = torch.arange(0.0, 13.0, 3.0, dtype=torch.float64).view(1, 5, 1)
    assert spline.shifted(at**2)[0, :4].numpy() == pytest.approx(((at + 1.0) ** 2)[0, :4].numpy(), abs=1e-9)
    assert spline.shifted(at**2)[0, 4].item() == pytest.approx(144.0)


def test_one_knot_is_held():
    spline = ActionSpline(4, 1, Spline.LINEAR, "cpu")
    assert spline.actions(torch.ones(1, 1, 2)).tolist() == torch.ones(1, 4, 2).tolist()
