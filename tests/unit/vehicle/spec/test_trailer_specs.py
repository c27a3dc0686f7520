"""Descriptions of trailers: mistakes in one line each, places of axles, other tires, mirror images."""

import dataclasses

import numpy as np
import pytest

from simwarp.core.rotation import matrix_of
from simwarp.core.types import pose
from simwarp.model.builder import ModelBuilder
from simwarp.scenery import add_vehicle_visual
from simwarp.sensors import Visuals
from simwarp.vehicle.construction import add_chassis_box, add_vehicle, trailer_boxes
from simwarp.vehicle.reduced.reduction import reduce_vehicle
from simwarp.vehicle.spec.mirroring import mirrored
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import load_vehicle, plain, save_vehicle
from simwarp.vehicle.spec.vehicle_spec import SpecError

TRAINS = ("sedan-trailer", "truck-semitrailer")


@pytest.mark.parametrize(
    ("keys", "value", "words"),
    [
        ("hitch", None, "trailers[0].hitch: missing"),
        ("hitch.kind", "rope", "trailers[0].hitch.kind: must be"),
        ("hitch.towing_point", None, "trailers[0].hitch.towing_point: missing"),
        ("hitch.yaw_friction", -1, "trailers[0].hitch.yaw_friction: must be"),
        ("hitch.yaw_limit", 0, "trailers[0].hitch.yaw_limit: must be positive"),
        ("hitch.trailer_point", [-9.0, 0, 0], "ahead of the rearmost axle, or the trailer turns round"),
        ("hitch.trailer_point", [0, 0, 3.0], "as high above the trailer's wheels as the towing point is"),
        ("hitch.trailer_point", [4000, 0, 0], "give metres, not millimetres"),
        ("axles", [], "trailers[0].axles: must be one or more"),
        ("axles.0.steering", 0, "trailers[0].axles[0].steering: must be left out of a trailer"),
        ("axles.0.location", [-3900, 0, 0], "give metres, not millimetres"),
        ("chassis.size", [4000, 2000, 2000], "trailers[0].chassis.size: must be within"),
        ("axles.0.suspension.springs", [], "one or more where guide is 'leaf-springs'"),
    ],
)
def test_a_mistake_is_one_line_that_names_its_key(changed, keys, value, words):
    text = changed(f"trailers.0.{keys}", value, "sedan-trailer")
    assert words in text
    assert text.startswith("v.json: ")
    assert "\n" not in text
    assert len(text) < 300


def test_an_arm_that_is_far_off_is_named_with_its_trailer(changed):
    springs = plain(load_vehicle("sedan-trailer"))["trailers"][0]["axles"][0]["suspension"]["springs"]
    far = [{**springs[0], "chassis_point": [2.9, 0.7, 0.25]}]
    assert "trailers[0].axles[0].suspension" in changed("trailers.0.axles.0.suspension.springs", far, "sedan-trailer")


def test_a_reduced_vehicle_tows_nothing():
    with pytest.raises(SpecError, match=r"^trailers: must be left out"):
        dataclasses.replace(load_vehicle("sedan-14dof"), trailers=load_vehicle("sedan-trailer").trailers)
    with pytest.raises(SpecError, match=r"^trailers: must be left out of what is reduced, got 1 of 'sedan-trailer'"):
        reduce_vehicle(load_vehicle("sedan-trailer"))


@pytest.mark.parametrize("name", TRAINS)
def test_hitch_points_are_one_and_axles_lie_where_that_puts_them(name):
    spec = load_vehicle(name)
    unit, hitch = spec.units[1], spec.trailers[0].hitch
    np.testing.assert_allclose(np.add(unit.origin, hitch.trailer_point), hitch.towing_point, atol=1e-12)
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec)
    joint = builder.joints[parts.units[1].hitch]
    ends = [
        builder.bodies[body].pose.position + frame.position
        for body, frame in ((joint.parent, joint.frame0), (joint.child, joint.frame1))
    ]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)
    for index, axle in enumerate(spec.all_axles):
        left, right = (builder.bodies[side.spindle].pose.position for side in parts.sides[2 * index : 2 * index + 2])
        middle = 0.5 * (left + right) - (0.0, 0.0, spec.start_height)
        spindle = axle.suspension.spindle.com
        np.testing.assert_allclose(middle, np.add(axle.location, (spindle[0], 0.0, spindle[2])), atol=1e-12)
        assert index in parts.unit_of(index).axles
    assert sorted(body for each in parts.units for body in each.bodies) == list(parts.bodies)


@pytest.mark.parametrize("name", TRAINS)
def test_a_file_gives_the_train_back(name, tmp_path):
    spec = load_vehicle(name)
    save_vehicle(spec, tmp_path / "saved.json")
    assert load_vehicle(tmp_path / "saved.json") == spec


def test_options_reach_the_trailer_s_tires():
    for name in TRAINS:
        spec = load_vehicle(name)
        changed = with_options(spec, tire="rigid")
        assert {axle.tire.template for axle in changed.all_axles} == {"rigid"}
        assert [axle.location for axle in changed.all_axles] == [axle.location for axle in spec.all_axles]
        assert [axle.tire.width for axle in changed.all_axles] == [axle.tire.width for axle in spec.all_axles]


def test_a_mirror_image_has_its_trailer_mirrored():
    spec = load_vehicle("truck-semitrailer")
    (trailer,) = spec.trailers
    aside = dataclasses.replace(trailer, hitch=dataclasses.replace(trailer.hitch, towing_point=(-1.25, 0.1, 0.635)))
    spec = dataclasses.replace(spec, trailers=(aside,))
    assert mirrored(spec).trailers[0].hitch.towing_point == (-1.25, -0.1, 0.635)
    assert mirrored(mirrored(spec)) == spec


def test_boxes_of_trailers_meet_others_and_are_seen_as_what_they_stand_for():
    spec = load_vehicle("truck-semitrailer")
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec)
    assert trailer_boxes(builder, parts) == []
    box = add_chassis_box(builder, parts, half=(1.2, 1.25, 1.0), position=(2.0, 0.0, 1.3))
    (behind,) = trailer_boxes(builder, parts)
    shape = builder.shapes[behind]
    assert behind != box
    assert shape.body == parts.units[1].chassis
    np.testing.assert_allclose(2.0 * np.asarray(shape.size), spec.trailers[0].chassis.size)
    visuals = Visuals(builder)
    instances = add_vehicle_visual(visuals, parts, box=box)
    # nothing is drawn twice: a body, ten wheels, a trailer
    assert len(visuals.instances) == len(instances) == 12


@pytest.mark.parametrize("name", TRAINS)
def test_the_axes_of_a_hitch_turn_with_the_train(name):
    """Built towards +Y, coordinates of the hitch, with their friction and limits, are those of the towing vehicle."""
    frames = []
    for turn in ((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))):
        builder = ModelBuilder()
        parts = add_vehicle(builder, load_vehicle(name), at=pose((3.0, 1.0, 0.5), turn))
        joint = builder.joints[parts.units[1].hitch]
        frames.append([matrix_of(np.asarray(frame.rotation, float)) for frame in (joint.frame0, joint.frame1)])
    np.testing.assert_allclose(frames[0], frames[1], atol=1e-12)
