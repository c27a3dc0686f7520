"""Descriptions of tracked vehicles: files and back, and one line for each mistake."""

import dataclasses
import json
import math
from typing import Any

import pytest

from simwarp.vehicle.spec.parts import SpecError, merged
from simwarp.vehicle.spec.track_parts import DoublePinSprocket, ShoeTrack
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec
from simwarp.vehicle.tracks.shoe_construction import drum_radius, lay_track
from simwarp.vehicle.tracks.tracked_files import (
    TRACKED,
    load_tracked_vehicle,
    save_tracked_vehicle,
    tracked_vehicle_names,
)

M113 = load_tracked_vehicle("m113")
assert isinstance(M113.left, ShoeTrack)
TRACK: ShoeTrack = M113.left
SHOE, SPROCKET, IDLER = TRACK.shoe, TRACK.sprocket, TRACK.idler
WHEEL = IDLER.wheel
ARM = TRACK.road_wheels[0].suspension
DOUBLE = DoublePinSprocket(
    mass=27.0, inertia=(0.6, 0.9, 0.6), teeth=10, separation=0.278, backlash=0.02, assembly_radius=0.242,
    tip_radius=0.2715, arc_radius=0.0223, arc_center_height=0.2371, arc_center_offset=0.0464, friction=0.4,
)  # fmt: skip


def test_the_shipped_vehicle():
    """Its masses add up to what the recorded run printed, and both chains are laid."""
    assert tracked_vehicle_names() == ["m113", "m113-belt", "m113-double-pin"]
    mass = merged(M113.chassis.components)[0]
    for track in (M113.left, M113.right):
        assert isinstance(track, ShoeTrack)
        arms = sum(mount.suspension.arm.mass + mount.suspension.wheel.mass for mount in track.road_wheels)
        mass += track.sprocket.mass + track.idler.carrier.mass + track.idler.wheel.mass + arms
        mass += track.shoes * track.shoe.mass
        assert len(lay_track(track).angles) == track.shoes
    assert math.isclose(mass, 11342.9, abs_tol=0.05)  # printed with one digit
    assert (M113.left.shoes, M113.right.shoes) == (63, 64)
    assert math.isclose(M113.left.idler.tensioner.force, 270e3)


def test_a_drum_lies_as_deep_as_rollers_in_the_gaps():
    """Rollers 0.1145 m apart with their centres 0.226 m from the axis, less half a shoe's height."""
    assert math.isclose(drum_radius(TRACK), math.sqrt(0.226**2 - 0.05725**2) - 0.03, rel_tol=1e-12)


def test_a_file_and_back(tmp_path):
    path = tmp_path / "mine.json"
    save_tracked_vehicle(M113, path)
    assert load_tracked_vehicle(path) == M113


MISTAKES: dict[str, tuple[Any, dict[str, Any], str]] = {
    "no teeth": (SPROCKET, {"teeth": 0}, "teeth: must be at least 3, got 0"),
    "two teeth": (SPROCKET, {"teeth": 2}, "teeth: must be at least 3, got 2"),
    "a profile without gaps": (SPROCKET, {"tip_radius": 0.2}, "tip_radius: must be above the bottom of the gaps"),
    "a tensioner that slackens": (
        IDLER.tensioner, {"preload": -3e5}, r"preload: must leave a force > 0 N .* got -5e\+04 N; raise it",
    ),
    "a tensioner without length": (
        IDLER.tensioner, {"carrier_point": (0.5, -0.2, 0.0)}, "carrier_point: must be apart from chassis_point",
    ),
    "a tensioner across the slide": (IDLER, {"slide_angle": 0.1}, "tensioner: must be along the slide, at 0.1 rad"),
    "shoes that overlap": (SHOE, {"pitch": 0.1}, "ground_pad.size: must be shorter than the pitch of 0.1 m"),
    "rollers the wrong way round": (SHOE, {"roller_front": -0.1}, "roller_rear: must be behind roller_front -0.1 m"),
    "a gap as wide as the wheel": (WHEEL, {"gap": 0.2}, "gap: must be less than the width of 0.181 m, got 0.2"),
    "a wheel without mass": (WHEEL, {"mass": 0.0}, "mass: must be positive, got 0"),
    "an arm without length": (ARM, {"hinge": (0.0, -0.3, 0.0)}, "hinge: must be off the wheel's axis"),
    "no road wheels": (TRACK, {"road_wheels": ()}, "road_wheels: must be one or more"),
    "shoes of another kind": (TRACK, {"sprocket": DOUBLE}, "sprocket.template: must be one for shoes of template"),
    "a sprocket that shoes do not go around": (
        TRACK, {"sprocket": dataclasses.replace(SPROCKET, assembly_radius=0.07)}, "sprocket.assembly_radius: must",
    ),
    "two shoes": (TRACK, {"shoes": 2}, "shoes: must be at least 3, got 2"),
    "tracks in one place": (M113, {"track_offset": 0.0}, "track_offset: must be positive, got 0"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes(mistake):
    part, changes, message = MISTAKES[mistake]
    with pytest.raises(SpecError, match=message) as error:
        dataclasses.replace(part, **changes)
    assert "\n" not in str(error.value)


def test_the_file_and_the_key_are_named(tmp_path):
    text = json.loads((TRACKED / "m113.json").read_text())
    text["right"]["sprocket"]["teeth"] = 0
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(text))
    with pytest.raises(
        SpecError, match=r"mine\.json: right\.sprocket(\.sprocket-single-pin)?\.teeth: must be at least 3, got 0"
    ):
        load_tracked_vehicle(path)
    text["right"]["sprocket"]["template"] = "sprocket-no-pin"
    path.write_text(json.dumps(text))
    with pytest.raises(SpecError, match=r"mine\.json: right\.sprocket.*sprocket-single-pin"):
        load_tracked_vehicle(path)


def test_an_unknown_name():
    with pytest.raises(SpecError, match=r"tracked vehicle 'm114': not shipped \(did you mean 'm113'\?\); known: m113"):
        load_tracked_vehicle("m114")


def test_a_chain_that_does_not_close_tells_what_is_missing():
    short: ShoeTrack = dataclasses.replace(TRACK, shoes=61)
    with pytest.raises(SpecError, match=r"61 shoes of 0\.154 m does not close, 0\.2\d* m are missing; use 63 shoes"):
        lay_track(short)


def test_descriptions_compare_by_value():
    again = load_tracked_vehicle(TRACKED / "m113.json")
    assert isinstance(again, TrackedVehicleSpec)
    assert again == M113
    assert again is not M113
