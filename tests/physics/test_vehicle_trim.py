"""Standing vehicles come to rest, and trimmed ones where they were asked to."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.analysis import StaticResult, solve_static
from simwarp.vehicle import (
    VEHICLE_SOLVER,
    SpecError,
    Vehicle,
    VehicleSpec,
    add_vehicle,
    load_vehicle,
    per_world,
    save_vehicle,
    spring_lengths,
    stance,
    travel_table,
    trim,
    with_options,
)
from simwarp.vehicle.spec.parts import ForceLine
from simwarp.vehicle.stances import stop_at
from simwarp.vehicle.suspensions.alignment import free_length, tierod_length, with_tierod_turned
from simwarp.vehicle.tires.parameter_vector_kernels import Common
from tests.physics.sample_vehicles import samples, shipped

SPRUNG = ("hmmwv", "hmmwv-reduced", "gator", "artcar", "sedan")
HEIGHT = 5.0e-4
"""To which a ride height holds [m]."""
ANGLE = math.radians(0.01)
"""To which toe and camber hold [rad]."""


def simulated(spec: VehicleSpec, friction: float = 0.9, *, plates: bool = False) -> tuple[sw.Simulation, Vehicle]:
    """A vehicle on full brakes above a plane; on plates, its tires have no grip."""
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, spec)
    if any(side.meets_shapes for side in parts.sides):
        builder.add_shape_plane(material=sw.Material(friction=friction))
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicle: Any = Vehicle(parts, model)
    vehicle.tires.ground_friction.fill_(1e-6 if plates else friction)
    if plates:
        values = vehicle.tires.parameter.numpy()
        values[:, :, [Common.FRICTION_LOWER, Common.FRICTION_UPPER]] = (0.0, 1e-6)
        vehicle.tires.parameter.assign(values)
    inputs = vehicle.input.numpy()
    inputs[:, 2] = 1.0
    vehicle.input.assign(inputs)
    return sw.Simulation(model, 1e-3, elements=[vehicle], solver=VEHICLE_SOLVER), vehicle


def measured(vehicle: Vehicle, sim: sw.Simulation) -> list[tuple[float, float, float]]:
    """Ride height [m], toe and camber [rad] of each axle, from the outputs and the axes of the wheels alone."""
    x, y, z, w = np.asarray(sim.state.body_rot.numpy()[0], np.float64).T
    # y axes of the bodies
    axes = np.stack([2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)], axis=1)
    _, pitch, yaw = vehicle.angles.numpy()[0].astype(float)
    height = float(vehicle.position.numpy()[0, 2])
    spec, sides, found = vehicle.parts.spec, vehicle.parts.sides, []
    for index, axle in enumerate(spec.axles):
        ahead = axle.location[0] + axle.suspension.spindle.com[0]
        toes, cambers = [], []
        for side in sides[2 * index : 2 * index + 2]:
            axis = axes[side.spindle]
            toes.append(-side.side * (math.atan2(-axis[0], axis[1]) - yaw))
            cambers.append(-side.side * math.asin(axis[2]))
        found.append((height - ahead * math.sin(pitch), float(np.mean(toes)), float(np.mean(cambers))))
    return found


def sprung_axles(spec: VehicleSpec) -> list[bool]:
    return [bool(getattr(axle.suspension, "springs", ())) for axle in spec.axles]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "options"),
    [
        *((name, {}) for name in (*SPRUNG, "skid-steer")),
        *(("hmmwv", {"tire": tire}) for tire in ("fiala", "pacejka89", "pacejka2002", "lugre", "tmsimple", "rigid")),
        ("hmmwv", {"powertrain": "simplemap", "driveline": "simple"}), ("hmmwv", {"powertrain": "cvt"}),
        ("sedan", {"powertrain": "shafts", "driveline": "fwd"}), ("gator", {"driveline": "rwd"}),
        ("skid-steer", {"tire": "rigid"}),
    ],
)  # fmt: skip
def test_a_vehicle_on_its_brakes_comes_to_rest(name: str, options: dict[str, str]) -> None:
    """Brakes, bristles and drivelines: wheels carry its weight, and nothing moves by a tenth of a millimetre in half a
    second that follows. Rates that are left are below 2e-5 m/s; the solver of rigid contacts leaves ten times that.
    """
    sim, vehicle = simulated(with_options(load_vehicle(name), **options))
    found: StaticResult = solve_static(sim)
    assert found.by_contacts or name == "skid-steer"
    sim.step()
    model = sim.model
    weight = 9.81 * float(np.asarray(model.body_mass.numpy()[0], np.float64).sum())
    assert vehicle.tires.load.numpy()[0].sum() == pytest.approx(weight, rel=2e-3)
    before = sim.state.body_x.numpy()[0].copy()
    sim.step(500)
    np.testing.assert_allclose(sim.state.body_x.numpy()[0], before, atol=1e-4)


@pytest.mark.slow
def test_no_side_forces_are_left_on_plates_and_equilibria_are_one() -> None:
    """With grip, the way down decides; without, where it started does not."""
    spec = load_vehicle("hmmwv")
    raised = dataclasses.replace(spec, start_height=spec.start_height + 0.08)
    low, high = stance(spec), stance(raised)
    for one, other in zip(low.axles, high.axles, strict=True):
        assert abs(one.side_force) < 1.0
        assert one.ride_height == pytest.approx(other.ride_height, abs=HEIGHT)
        assert one.toe == pytest.approx(other.toe, abs=ANGLE)


@pytest.mark.slow
@pytest.mark.parametrize("name", SPRUNG)
def test_a_trimmed_vehicle_settles_as_asked_for(name: str) -> None:
    """Below its design height, and with some toe on every axle; dropped on plates it comes to rest there by its dampers
    alone, read by other means. What is not asked of an axle stays.
    """
    spec = load_vehicle(name)
    before = stance(spec)
    lift = 0.03 * spec.axles[0].tire.radius
    can = sprung_axles(spec)
    heights = [
        axle.ride_height + axle.travel - lift if each else None for axle, each in zip(before.axles, can, strict=True)
    ]
    toes = [math.radians(0.1 + 0.1 * index) if each else None for index, each in enumerate(can)]
    trimmed = trim(spec, ride_height=heights, toe=toes)
    sim, vehicle = simulated(trimmed, plates=True)
    sim.step(6000)
    for index, (height, toe, _) in enumerate(measured(vehicle, sim)):
        if can[index]:
            assert height == pytest.approx(heights[index], abs=HEIGHT)
            assert toe == pytest.approx(toes[index], abs=ANGLE)
        else:
            assert trimmed.axles[index] == spec.axles[index]
    for name_ in ("chassis", "steerings", "driveline", "engine", "transmission", "start_height"):
        assert getattr(trimmed, name_) == getattr(spec, name_)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gator", "hmmwv-reduced"])
def test_a_trim_is_idempotent_survives_its_file_and_leads_back(name: str, tmp_path: Any) -> None:
    spec = load_vehicle(name)
    before = stance(spec).axles
    can = sprung_axles(spec)
    asked: Any = {
        "ride_height": ["design" if each else None for each in can],
        "toe": [0.001 if each else None for each in can],
        "camber": [-0.004 if each else None for each in can],
    }
    trimmed = trim(spec, **asked)
    assert trim(trimmed, **asked) is trimmed
    save_vehicle(trimmed, tmp_path / "mine.json")
    assert load_vehicle(tmp_path / "mine.json") == trimmed
    back = trim(
        trimmed,
        ride_height=[axle.ride_height if each else None for axle, each in zip(before, can, strict=True)],
        toe=[axle.toe if each else None for axle, each in zip(before, can, strict=True)],
        camber=[axle.camber if each else None for axle, each in zip(before, can, strict=True)],
    )
    for index, each in enumerate(can):
        if each:
            old: Any = spec.axles[index].suspension
            new: Any = back.axles[index].suspension
            for line, other in zip(old.springs, new.springs, strict=True):
                assert free_length(other) == pytest.approx(free_length(line), abs=HEIGHT)
            # 0.01° of a steering arm of 0.2 m
            assert tierod_length(new) == pytest.approx(tierod_length(old), abs=5e-5)
            assert new.camber == pytest.approx(old.camber, abs=2.0 * ANGLE)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["macpherson-strut", "multi-link", "solid-axle", "trailing-arm", "bushings"])
def test_every_template_is_trimmed(name: str) -> None:
    """To its design height without toe, on the axles that have springs and a tie rod."""
    trimmed = trim(samples()[name], ride_height="design", toe=0.0)
    for axle, found in zip(trimmed.axles, stance(trimmed).axles, strict=True):
        assert abs(found.travel) < HEIGHT
        if tierod_length(axle.suspension) is not None:
            assert abs(found.toe) < ANGLE


@pytest.mark.slow
def test_the_sedan_stands_as_designed_and_rolls_straight() -> None:
    """Wheels where they are built, no toe; less than 50 N of side force on any of them at 5 m/s."""
    spec = load_vehicle("sedan")
    for standing, rolling in zip(stance(spec).axles, stance(spec, speed=5.0).axles, strict=True):
        assert abs(standing.travel) < HEIGHT
        assert abs(standing.toe) < ANGLE
        assert abs(rolling.side_force) < 50.0
        assert rolling.ride_height == pytest.approx(standing.ride_height, abs=HEIGHT)


@pytest.mark.parametrize("speed", [-1.0, math.nan, math.inf])
def test_a_speed_that_is_none_is_one_line(speed):
    with pytest.raises(SpecError, match="speed: must be >= 0 m/s and finite, got"):
        stance(shipped("artcar"), speed=speed)


@pytest.mark.slow
def test_heights_beyond_the_travel_are_refused_with_its_ends() -> None:
    spec = load_vehicle("hmmwv")
    with pytest.raises(
        SpecError, match=r"^ride_height: must be from 0\.\d+ to 0\.\d+ m at axle 0 of 'hmmwv', .*got 0.7"
    ):
        trim(spec, ride_height=0.7)
    with pytest.raises(SpecError, match=r"^ride_height: must be from .* at axle 1 of 'hmmwv', .*got 0.05"):
        trim(spec, ride_height=(None, 0.05))


@pytest.mark.parametrize(
    ("name", "asked", "says"),
    [
        ("hmmwv", {}, "hmmwv: one of ride_height, toe and camber must be given to trim it"),
        ("hmmwv", {"ride_height": (0.5, 0.5, 0.5)}, r"ride_height: must be one value, or one per axle .* \(2\), got 3"),
        ("hmmwv", {"ride_height": "low"}, r"ride_height: must be a height \[m\] or 'design', got 'low'"),
        ("hmmwv", {"ride_height": math.nan}, "ride_height: must be a height"),
        ("hmmwv", {"toe": "design"}, r"toe: must be an angle \[rad\], got 'design'"),
        ("hmmwv", {"toe": True}, "toe: must be an angle"),
        ("hmmwv", {"camber": math.inf}, "camber: must be an angle"),
        ("hmmwv", {"toe": 1.0}, "toe: must be within 0.349 rad, got 1; angles are in radians"),
        ("gator", {"toe": (0.0, 0.0)}, "toe: must be left out of axle 1 of 'gator', which has no tie rod"),
        ("gator", {"ride_height": (0.3, 0.3)}, "ride_height: must be left out of axle 1 of 'gator', which has no spr"),
        ("gator", {"camber": (None, 0.0)}, "camber: must be left out of axle 1 of 'gator', which is rigid"),
        ("skid-steer", {"ride_height": 0.17}, "ride_height: must be left out of 'skid-steer', every axle of which has"),
        ("skid-steer", {"toe": 0.0}, "toe: must be left out of 'skid-steer', every axle of which has no tie rod"),
    ],
)
def test_wishes_that_cannot_be_had_are_one_line(name: str, asked: dict[str, Any], says: str) -> None:
    with pytest.raises(SpecError, match=f"^{says}") as caught:
        trim(load_vehicle(name), **asked)
    assert "\n" not in str(caught.value)


def test_a_turned_tie_rod_goes_about_the_kingpin() -> None:
    """Balls of the arms stay; outer ball, wheel and upright keep their distance to the kingpin; it can be undone."""
    old: Any = load_vehicle("hmmwv").axles[0].suspension
    new: Any = with_tierod_turned(old, math.radians(1.5))
    bottom, top = np.array(old.lower_arm_upright), np.array(old.upper_arm_upright)
    axis = (top - bottom) / np.linalg.norm(top - bottom)
    assert (new.lower_arm_upright, new.upper_arm_upright, new.springs) == (
        old.lower_arm_upright, old.upper_arm_upright, old.springs
    )  # fmt: skip
    for before, after in (
        (old.tierod_upright, new.tierod_upright), (old.spindle.com, new.spindle.com), (old.upright.com, new.upright.com)
    ):  # fmt: skip
        distances = [np.linalg.norm(np.cross(axis, np.subtract(point, bottom))) for point in (before, after)]
        assert distances[0] == pytest.approx(distances[1], abs=1e-12)
        assert np.subtract(after, before) @ axis == pytest.approx(0.0, abs=1e-12)
    # the kingpin leans by 12°: the heading turns by its cosine, the top by its sine times what it leans back
    assert new.toe == pytest.approx(math.radians(1.5), rel=0.03)
    assert tierod_length(new) != tierod_length(old)
    again: Any = with_tierod_turned(new, -math.radians(1.5))
    assert again.toe == pytest.approx(old.toe, abs=1e-12)
    np.testing.assert_allclose(again.tierod_upright, old.tierod_upright, atol=1e-12)


def test_lengths_of_springs_over_travel_are_those_of_the_linkage() -> None:
    """A single wishbone turns about x: the spring's end goes round the hinge with the arm.

    The closed form leaves the steering by travel out, 0.12 rad of a wheel 0.06 m beside its kingpin: it lifts the
    wheel's centre by (1 - cos 0.12) 0.06 m times the arm's slope of 0.1, 4e-5 m.
    """
    spec = load_vehicle("gator")
    axle: Any = spec.axles[0]
    arm = axle.suspension
    travels = np.linspace(-0.04, 0.04, 5)
    found = spring_lengths(spec, 0, travels)
    centers = travel_table(spec, 0, travels).center[:, 0]
    hinge, tip = np.array(arm.arm_chassis)[1:], np.array(arm.arm_upright)[1:]
    line = arm.springs[0]
    for length, center, travel in zip(found[:, 0], centers, travels, strict=True):
        assert center[2] == pytest.approx(axle.location[2] + arm.spindle.com[2] + travel, abs=1e-5)
        turn = _angle_for(hinge, tip, np.array(arm.spindle.com)[1:] - tip, travel)
        cos, sin = math.cos(turn), math.sin(turn)
        end = np.array(line.arm_point)[1:] - hinge
        moved = hinge + np.array([cos * end[0] - sin * end[1], sin * end[0] + cos * end[1]])
        across = line.arm_point[0] - line.chassis_point[0]
        expected = math.hypot(across, *(moved - np.array(line.chassis_point)[1:]))
        assert length == pytest.approx(expected, abs=1e-4)
    assert spring_lengths(spec, 0, [0.0])[0, 0] == pytest.approx(
        math.dist(line.chassis_point, line.arm_point), abs=1e-6
    )


def _angle_for(hinge: Any, tip: Any, offset: Any, travel: float) -> float:
    """Turn of an arm with upright and wheel about x at which the wheel's centre has risen by `travel`, by bisection."""
    start = tip + offset - hinge
    low, high = -1.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        rise = math.sin(middle) * start[0] + math.cos(middle) * start[1] - start[1]
        low, high = (middle, high) if rise < travel else (low, middle)
    return 0.5 * (low + high)


def test_stops_are_told_by_their_lengths() -> None:
    points: Any = {"chassis_point": (0.0, 0.5, 0.3), "arm_point": (0.0, 0.5, 0.0)}
    spring = ForceLine(**points, stiffness=1e4, min_length=0.2, max_length=0.4, bump_curve=((0.0, 0.0), (0.1, 1e4)))
    assert [stop_at(spring, length)[0] for length in (0.19, 0.2, 0.3, 0.4, 0.42)] == ["bump", "", "", "", "rebound"]
    assert stop_at(spring, 0.42)[1] == pytest.approx(0.02)
    damper = ForceLine(**points, damper_map=((0.2, 0.21, 0.39, 0.4), (-1.0, 1.0), ((0.0,) * 4, (0.0,) * 4)))
    assert [stop_at(damper, length)[0] for length in (0.205, 0.3, 0.395)] == [
        "hydraulic bump", "", "hydraulic rebound",
    ]  # fmt: skip
    assert stop_at(ForceLine(**points, stiffness=1e4), 0.01) == ("", 0.0)


@pytest.mark.slow
def test_travels_and_loads_of_a_stance() -> None:
    """Loads carry the weight; the springs of a reduced axle carry what the wheel does not weigh, by their geometry."""
    spec = shipped("hmmwv-reduced")
    found = stance(spec)
    mass = spec.chassis.components[0].mass
    for axle in spec.axles:
        suspension = axle.suspension
        mass += 2.0 * (suspension.spindle.mass + suspension.upright.mass + axle.wheel.mass + axle.tire.mass)
    mass += sum(mount.steering.link.mass for mount in spec.steerings)
    assert sum(2.0 * axle.load for axle in found.axles) == pytest.approx(9.81 * mass, rel=1e-3)
    for axle, spec_axle in zip(found.axles, spec.axles, strict=True):
        line, law = axle.lines[0], spec_axle.suspension.springs[0]
        assert line.force == pytest.approx(law.stiffness * (law.rest_length - line.length), rel=1e-6)
        assert line.stop == ""
