"""Parts of an axle that cannot reach each other are refused when a vehicle is read; what the linkage can do is not."""

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest

from simwarp.vehicle import SpecError, VehicleSpec, load_vehicle, vehicle_names
from simwarp.vehicle.spec import vehicle_spec
from simwarp.vehicle.spec.plausibility import lengths
from simwarp.vehicle.spec.reach import AROUND_WHEEL, BESIDE_ARM, FOLLOWED
from simwarp.vehicle.spec.vehicle_files import to_json
from simwarp.vehicle.spec.vehicle_spec import AntirollBar
from simwarp.vehicle.suspensions.kinematics import hold_axle
from tests.physics.sample_vehicles import samples

FAR = 2.5
"""Of a foot that is moved away from its arm, in radii of the tire."""


def barred(spec: VehicleSpec, foot: tuple[float, float, float], drop: float, width: float = 0.3) -> VehicleSpec:
    """The vehicle with a bar on its front axle whose left link stands on a point of the axle's frame."""
    axle = spec.axles[0]
    bar = AntirollBar(
        location=tuple(np.add(axle.location, foot) - (width, foot[1], drop)), arm_mass=1.0,
        arm_inertia=(0.05, 0.005, 0.05), arm_length=foot[1], arm_width=width, droplink_height=drop, stiffness=5e3,
    )  # fmt: skip
    return dataclasses.replace(spec, axles=(dataclasses.replace(axle, antiroll_bar=bar), *spec.axles[1:]))


def refusal(make: Any) -> str:
    with pytest.raises(SpecError) as caught:
        make()
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 300
    return text


def middle_of_arm(spec: VehicleSpec) -> tuple[float, float, float]:
    """A point on the part that holds a bar, two thirds of the way to its ball."""
    suspension: Any = spec.axles[0].suspension
    match suspension.template:
        case "single-wishbone":
            ends = (suspension.arm_chassis, suspension.arm_upright)
        case "trailing-arm":
            ends = (suspension.pivot, suspension.spindle.com)
        case "multi-link":
            ends = (suspension.trailing_link_chassis, suspension.trailing_link_upright)
        case "solid-axle":
            ends = ((0.0, 0.0, 0.0), suspension.knuckle_lower)
        case "double-wishbone-reduced":
            ends = (suspension.lower_arm_upright, suspension.lower_arm_upright)
        case _:
            ends = (np.add(suspension.lower_arm_front, suspension.lower_arm_back) / 2.0, suspension.lower_arm_upright)
    x, y, z = (np.asarray(ends[0]) + 2.0 * np.asarray(ends[1])) / 3.0
    return float(x), float(y), float(z)


@pytest.mark.parametrize("name", vehicle_names())
def test_every_hardpoint_that_is_far_off_is_refused_by_its_key(name, tmp_path):
    """Moved along the vehicle to just beyond the bound, which is below that of all lengths; as files, with the file."""
    spec = load_vehicle(name)
    found = 0
    for index, axle in enumerate(spec.axles):
        center = axle.suspension.spindle.com
        reach = max(AROUND_WHEEL * axle.tire.radius, 2.0 * abs(center[1]))
        for key, _, value in lengths(axle.suspension, f"axles[{index}].suspension"):
            if not isinstance(value, tuple) or value == center:
                continue
            beside = math.dist(value[1:], center[1:])
            text = to_json(spec)
            data = json.loads(text)
            holder: Any = data
            path = [int(word) if word.isdigit() else word for word in key.replace("[", ".").replace("]", "").split(".")]
            for step in path[:-1]:
                holder = holder[step]
            holder[path[-1]] = [center[0] + 1.001 * math.sqrt(reach**2 - beside**2), *value[1:]]
            (tmp_path / "far.json").write_text(json.dumps(data))
            said = refusal(lambda: load_vehicle(tmp_path / "far.json"))
            assert said.startswith(f"far.json: {key}: must be within {reach:.4g} m of the wheel's centre")
            found += 1
    rigid = all(axle.suspension.template == "rigid-suspension" for axle in spec.axles)
    assert rigid or found > 5


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("name", ["hmmwv", "hmmwv-reduced", "gator", "sedan"])
def test_a_bar_far_from_its_axle_is_refused(name, axis):
    spec = load_vehicle(name)
    foot = middle_of_arm(spec)
    radius = spec.axles[0].tire.radius
    barred(spec, foot, -0.4 * radius)
    moved = [FAR * radius if number == axis else 0.0 for number in range(3)]
    away = (foot[0] + moved[0], foot[1] + moved[1], foot[2] + moved[2])
    said = refusal(lambda: barred(spec, away, -0.4 * radius))
    assert said.startswith(
        f"axles[0].antiroll_bar: its drop link must end within {BESIDE_ARM * radius:.4g} m of the arm"
    )
    # the foot at the arm, the bar itself far away
    if axis == 2:
        drop = -1.3 * max(AROUND_WHEEL * radius, 2.0 * spec.axles[0].suspension.spindle.com[1])
        assert "axles[0].antiroll_bar.location: must be within" in refusal(lambda: barred(spec, foot, drop))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hmmwv", "gator", "sedan", "trailing-arm", "macpherson-strut"])
def test_links_that_are_refused_do_not_reach_and_others_do(name, monkeypatch):
    """The bench closes the linkage with a little more than the length that an error names at every travel, with three
    quarters of it not.
    """
    spec = {**samples(), **{each: load_vehicle(each) for each in ("hmmwv", "gator", "sedan")}}[name]
    foot, radius = middle_of_arm(spec), spec.axles[0].tire.radius
    travels = np.linspace(-FOLLOWED * radius, FOLLOWED * radius, 15)
    said = refusal(lambda: barred(spec, foot, -1e-3))
    assert said.startswith("axles[0].antiroll_bar.droplink_height: must be long enough for the bar's end to follow")
    enough = float(said.rpartition("; ")[2].removesuffix(" is enough"))
    assert -0.2 * radius < enough < -1e-3
    # the wheel does not rise by quite what its arm's ball does
    assert hold_axle(barred(spec, foot, 1.2 * enough), 0, travels, travels).reached.all()
    monkeypatch.setattr(vehicle_spec, "check_reach", lambda *_: None)
    assert not hold_axle(barred(spec, foot, 0.75 * enough), 0, travels, travels).reached.all()


def test_trailing_arms_of_any_length_lead_a_wheel_straight_up():
    spec = samples()["trailing-arm"]
    axle: Any = spec.axles[1]
    long = dataclasses.replace(axle.suspension, pivot=(5.0, 0.8, 0.0), pivot_axis=(0.0, 1.0, 0.0))
    dataclasses.replace(spec, axles=(spec.axles[0], dataclasses.replace(axle, suspension=long)))
    far = dataclasses.replace(axle.suspension, arm=dataclasses.replace(axle.suspension.arm, com=(5.0, 0.8, 0.0)))
    said = refusal(lambda: dataclasses.replace(spec, axles=(spec.axles[0], dataclasses.replace(axle, suspension=far))))
    assert said.startswith("axles[1].suspension.arm.com: must be within")


def test_a_lever_too_short_for_the_travel_has_another_remedy():
    spec = load_vehicle("hmmwv")
    said = refusal(lambda: barred(spec, middle_of_arm(spec), -0.1, width=0.01))
    assert said.endswith("no length is enough there: make arm_width longer or move location")


def test_bars_on_every_template_that_holds_one():
    for name, spec in samples().items():
        if getattr(spec.axles[0].suspension, "springs", ()):
            barred(spec, middle_of_arm(spec), -0.15)
            assert "antiroll_bar" in refusal(lambda spec=spec: barred(spec, (2.0, 0.5, 0.0), -0.15)), name
