"""Every wrong actuator is told in one line that names it, the rule, the value and the remedy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch

import simwarp as sw
from simwarp.actuators import Activation, Actuators, ActuatorSpec, Law, SitePull, Target
from simwarp.core.types import ModelError
from tests.unit.actuators.cart_and_wheel import SLIDE, bodies

ON: dict[str, Any] = {"name": "a", "terms": ((SLIDE, 1.0),)}
SERVO: dict[str, Any] = {**ON, "law": Law.SERVO}
MISTAKES: dict[str, tuple[Any, str]] = {
    "no list": (7, "specs must be a list, got 7; write specs="),
    "no spec": ([7], "specs must be a list of ActuatorSpec, got 7 among them"),
    "no name": ([{**ON, "name": ""}], "name must be a non-empty string"),
    "one name twice": ([ON, ON], "the name is taken by another actuator"),
    "no transmission": ([{"name": "a"}], "give terms or a site, got neither"),
    "two transmissions": ([{**ON, "site": SitePull(body=0)}], "give terms or a site, got both"),
    "no pair": ([{**ON, "terms": (3,)}], r"terms must be \(column, coefficient\) pairs, got \(3,\)"),
    "no such column": ([{**ON, "terms": ((2, 1.0),)}], "column must be in 0..1, got 2"),
    "no coefficient": ([{**ON, "terms": ((0, 0.0),)}], "coefficient must not be 0"),
    "no such body": ([{"name": "a", "site": SitePull(body=5)}], "site body must be a body index in 0..1, got 5"),
    "site on the world": ([{"name": "a", "site": SitePull(body=-1)}], "site body must be .* got -1"),
    "no such reference": (
        [{"name": "a", "site": SitePull(body=0, reference=9)}],
        "site reference must be a body index in 0..1 or WORLD, got 9",
    ),
    "its own reference": ([{"name": "a", "site": SitePull(body=0, reference=0)}], "body and reference must differ"),
    "no gear": ([{"name": "a", "site": SitePull(body=0, gear=(0.0,) * 6)}], "gear must not be zero throughout"),
    "gain": ([{**ON, "gain": (1.0, float("nan"), 0.0)}], "gain must be 3 finite numbers"),
    "range": ([{**ON, "ctrl_range": (1.0, 1.0)}], r"ctrl_range must be \(lower, upper\) with lower < upper"),
    "filter": ([{**ON, "activation": Activation.FILTER}], "time_constant must be finite and > 0 s, got 0.0"),
    "state's range": ([{**ON, "activation_range": (0.0, 1.0)}], "activation_range needs an activation"),
    "delay": ([{**ON, "delay": -1.0}], "delay must be zero or positive, got -1.0; give seconds"),
    "delay without step": ([{**ON, "delay": 0.01}], r"a delay needs the time of a sub-step, got None"),
    "stall": ([{**ON, "torque_speed": (0.0, 1.0)}], "torque_speed\\[0\\] must be positive"),
    "corner": ([{**ON, "torque_speed": (1.0, 1.0), "corner_speed": 1.0}], "corner_speed must be below the free speed"),
    "corner alone": ([{**ON, "corner_speed": 1.0}], "corner_speed needs torque_speed"),
    "servo without drive": ([SERVO], "a SERVO needs a PositionDrive on joint 'slide'"),
    "servo of two": ([{**SERVO, "terms": ((0, 1.0), (1, 1.0))}], "a SERVO moves one coordinate, got 2 terms"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_a_wrong_actuator_is_told(case: str) -> None:
    given, message = MISTAKES[case]
    model = bodies().finalize(1, "cpu")
    specs = [ActuatorSpec(**one) if isinstance(one, dict) else one for one in given] if isinstance(given, list) else 7
    with pytest.raises(ModelError, match=message) as caught:
        Actuators(model, specs)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def driven(**options: Any) -> sw.Model:
    return bodies(drive=sw.PositionDrive(stiffness=1.0, **options)).finalize(1, "cpu")


@pytest.mark.parametrize(
    ("specs", "message"),
    [
        ([{**SERVO, "force_range": (-1.0, 1.0)}], "force_range of a SERVO is that of its drive, which has none"),
        ([{**SERVO, "torque_speed": (1.0, 1.0)}], "a SERVO has no torque_speed"),
        ([SERVO, {**SERVO, "name": "b"}], "a drive has one target, but actuator 'a' writes it too"),
    ],
)
def test_a_wrong_servo_is_told(specs: list[dict[str, Any]], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        Actuators(driven(), [ActuatorSpec(**one) for one in specs])


def test_a_drive_can_follow_place_and_rate() -> None:
    specs = [ActuatorSpec(**SERVO), ActuatorSpec(**{**SERVO, "name": "b", "target": Target.VELOCITY})]
    assert Actuators(driven(), specs).names == ("a", "b")
    bounded = [ActuatorSpec(**{**SERVO, "force_range": (-1.0, 1.0)})]
    assert len(Actuators(driven(effort_limit=1.0), bounded)) == 1
    one_sided = [ActuatorSpec(**{**SERVO, "force_range": (-1.0, math.inf)})]
    assert len(Actuators(driven(effort_limit=(-1.0, math.inf)), one_sided)) == 1
    for limit in (8.0, (-1.0, 8.0), (-1.0, math.inf)):
        with pytest.raises(
            ModelError, match=r"that of its drive, \(-\d.*\), got \(-1.0, 1.0\); give the PositionDrive"
        ):
            Actuators(driven(effort_limit=limit), bounded)


def test_a_prescribed_coordinate_cannot_be_pulled() -> None:
    model = bodies(drive=sw.PrescribedSpeed()).finalize(1, "cpu")
    with pytest.raises(ModelError, match="joint 'slide' has a prescribed motion"):
        Actuators(model, [ActuatorSpec(**ON)])


def test_a_simulation_that_does_not_fit_is_told() -> None:
    model, other = (bodies().finalize(1, "cpu") for _ in range(2))
    late = Actuators(model, [ActuatorSpec(**ON, delay=0.01)], dt=1e-3)
    with pytest.raises(ModelError, match="they are of another model than the Simulation"):
        sw.Simulation(other, 1e-3, elements=[late])
    with pytest.raises(ModelError, match=r"delays were laid out for sub-steps of 0.001 s, the Simulation has 0.0005 s"):
        sw.Simulation(model, 1e-3, substeps=2, elements=[late])
    more = Actuators(model, [ActuatorSpec(**ON)])
    with pytest.raises(ModelError, match="two of them write the same coordinates or bodies"):
        sw.Simulation(model, 1e-3, elements=[late, more])


def test_wrong_numbers_for_the_arrays_are_told() -> None:
    model = bodies().finalize(2, "cpu")
    specs = [ActuatorSpec(**ON, delay=0.01), ActuatorSpec(name="b", terms=((1, 1.0),))]
    actuators = Actuators(model, specs, dt=1e-3, per_world=["delay"])
    actuators.delay[:, 0] = 0.01
    with pytest.raises(ModelError, match=r"actuators.delay: values must be .*build the actuators with the longest"):
        actuators.delay[1, 0] = 0.02
    with pytest.raises(ModelError, match=r"actuators\.delay: values must be"):
        actuators.delay[:, 1] = 0.001
    with pytest.raises(IndexError, match=r"Actuators\(per_world=\('gain',\)\) gives each its own"):
        actuators.gain[1] = (1.0, 0.0, 0.0)
    with pytest.raises(ModelError, match="per_world names an unknown parameter 'gian'; did you mean 'gain'"):
        Actuators(model, specs, dt=1e-3, per_world=["gian"])
    with pytest.raises(ModelError, match=r"action must be float32\(2, 2\)"):
        actuators.set_from_action(torch.zeros(2, 3))
    with pytest.raises(ModelError, match=r"float32\(2, 2\) \(worlds, actuators\), got float64\(2, 2\); convert it"):
        actuators.set_from_action(torch.zeros(2, 2, dtype=torch.float64))
    with pytest.raises(ModelError, match="no actuator 'B'; there are a, b"):
        actuators.column("B")
    assert actuators.column("b") == 1
    assert np.isinf(actuators.ctrl_range).all()
