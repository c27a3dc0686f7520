"""Descriptions of tracks by belt, what is built of them, and one line for each mistake."""

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.vehicle.spec.belt_parts import BeltTrack, belt_of
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.vehicle_files import read_spec, to_json
from simwarp.vehicle.tracks.belt_construction import belt_inertia
from simwarp.vehicle.tracks.belt_path import rest_belt
from simwarp.vehicle.tracks.belts import Belts
from simwarp.vehicle.tracks.tracked_construction import add_tracked_vehicle
from tests.unit.vehicle.tracks.belt_vehicles import M113, drive, mass_of, reference_point, vehicle
from tests.unit.vehicle.tracks.test_track_construction import TWO_PINS
from tests.unit.vehicle.tracks.test_track_specs import DOUBLE

TRACK = belt_of(M113.left)


def test_a_file_and_back(tmp_path):
    """The file of a belt is that of the shoes with `belt` besides."""
    path = tmp_path / "belt.json"
    mine = belt_of(M113.left, friction=0.7, span_points=2)
    path.write_text(to_json(mine))
    assert read_spec(BeltTrack, path) == mine
    written, shoes = json.loads(to_json(mine)), json.loads(to_json(M113.left))
    shoes.pop("track", None)
    assert {key: written[key] for key in shoes} == shoes
    assert mine.shoe_track() == M113.left


def test_what_is_built():
    """A chassis and ten arms with all of the mass of the vehicle shoe by shoe, and two shafts."""
    sim, parts, _ = vehicle()
    builder = sim.model.builder
    assert mass_of(sim) == pytest.approx(11342.9, abs=0.1)  # printed by the recorded run
    assert len(parts.bodies) == len(builder.bodies) == 11
    assert len(parts.left.arms) == len(parts.right.arms) == 5
    assert sim.model.topology.row_count == 0, "no joint closes a loop"
    com = np.sum([body.mass * body.pose.position for body in builder.bodies], axis=0) / mass_of(sim)
    # printed by the recorded run, whose chains hang as laid, their idlers 0.09 m further ahead than tight ones: a fifth
    # of the mass, the middle of which moves by half of that
    np.testing.assert_allclose(com - reference_point(sim, parts), (-1.99754, -0.00171, 0.232), atol=0.02)


def test_inertia_of_the_belt():
    """All that turns, seen from the sprocket: kinetic energy of the parts at 1 rad/s, counted one by one."""
    speed = 10 * 0.154 / (2.0 * math.pi)
    turning = 0.4 + 0.883 + 63 * 18.02 * speed**2 + 1.12 * (speed / 0.255) ** 2 + 5 * 2.16 * (speed / 0.305) ** 2
    assert belt_inertia(TRACK) == pytest.approx(turning, rel=1e-12)


def mirrored(track):
    """The same track with its sprocket behind: x of all points changes its sign."""

    def turned(value):
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            changes: dict[str, Any] = {}
            for field in dataclasses.fields(value):
                old = getattr(value, field.name)
                points = ("hinge", "wheel_joint", "com", "location", "chassis_point", "arm_point", "carrier_point",
                          "slide")  # fmt: skip
                new = (-old[0], *old[1:]) if field.name in points else turned(old)
                if field.name == "products":
                    new = (-old[0], -old[1], old[2])
                changes[field.name] = new
            return dataclasses.replace(value, **changes)
        return tuple(turned(each) for each in value) if isinstance(value, tuple) else value

    x, y, z = track.idler_location
    return dataclasses.replace(
        track, idler=turned(track.idler), idler_location=(-x, y, z), road_wheels=turned(track.road_wheels)[::-1]
    )


def test_a_sprocket_behind_is_the_mirror_image():
    """Driven backwards, the mirror image of a vehicle moves as the vehicle does forwards."""
    chassis = M113.chassis.components[0]
    there = dataclasses.replace(chassis, com=(-chassis.com[0], 0.0, chassis.com[2]))
    behind = dataclasses.replace(M113, chassis=dataclasses.replace(M113.chassis, components=(there,)))
    found = []
    for spec, track, sign in ((M113, None, 1.0), (behind, mirrored, -1.0)):
        sim, parts, belts = vehicle(spec=spec, track=track)
        sim.step(1500)
        drive(sim, parts, sign * 2000.0, sign * 1000.0)
        sim.step(1500)
        point, v = reference_point(sim, parts), sim.body_velocity("chassis")
        found.append([sign * point[0], point[1], point[2], sign * v[0], v[1], *belts.tension.numpy()[0] / 1e5])
    np.testing.assert_allclose(found[1], found[0], rtol=2e-3, atol=2e-3)  # 3000 steps of rounding, in other orders
    assert found[0][3] > 0.5


MISTAKES: dict[str, tuple[Any, str]] = {
    "no friction at all": (lambda: belt_of(M113.left, friction=-0.1), "friction: must be zero or positive, got -0.1"),
    "no width": (lambda: belt_of(M113.left, width=0.0), "width: must be positive, got 0"),
    "no shear": (lambda: belt_of(M113.left, shear_length=0.0), "shear_length: must be positive, got 0"),
    "too many points": (lambda: belt_of(M113.left, span_points=17), "span_points: must be from 0 to 16, got 17"),
    "half a point": (lambda: belt_of(M113.left, ramp_points=0), "ramp_points: must be from 1 to 16, got 0"),
    "another word": (lambda: belt_of(M113.left, tension=1.0), "belt: must have fields of BeltLaw, got 'tension'"),
    "no wheels": (
        lambda: dataclasses.replace(TRACK, road_wheels=()), "road_wheels: must be one or more",
    ),
    "shoes with two pins": (
        lambda: dataclasses.replace(TRACK, shoe=TWO_PINS, sprocket=DOUBLE), "shoe: 'track-double-pin' is not there yet",
    ),
    "a short belt": (
        lambda: rest_belt(dataclasses.replace(TRACK, shoes=58)),
        "belt: 58 shoes of 0.154 m do not go around, some .* m are missing: .* use 6[0-2] shoes",
    ),
    "a long belt": (
        lambda: rest_belt(dataclasses.replace(TRACK, shoes=75)),
        "belt: must be tightened by its tensioner, got a tension of -.* 75 shoes of 0.154 m are .* too long",
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes(mistake):
    make, message = MISTAKES[mistake]
    with pytest.raises(SpecError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


def test_a_side_is_named_and_nothing_is_built():
    builder = sw.ModelBuilder()
    short = dataclasses.replace(TRACK, shoes=58)
    with pytest.raises(SpecError, match=r"right\.belt: 58 shoes"):
        add_tracked_vehicle(builder, dataclasses.replace(M113, left=TRACK, right=short))
    assert not builder.bodies
    add_tracked_vehicle(builder, dataclasses.replace(M113, left=TRACK, right=TRACK))
    with pytest.raises(SpecError, match="prefix: must be one that no other vehicle has, got '' again"):
        add_tracked_vehicle(builder, dataclasses.replace(M113, left=TRACK, right=TRACK))


def test_belts_of_nothing_and_of_one_track_twice():
    sim, parts, _ = vehicle()
    for listed in ([], [parts.left, parts.left]):
        with pytest.raises(sw.ModelError, match="Belts: parts must be one track or more, each once"):
            Belts(listed, sim.model)
    with pytest.raises(sw.ModelError, match="soil: preset must be"):
        Belts([parts.left], sim.model, soil="mud")
