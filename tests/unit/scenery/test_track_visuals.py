"""Bodies of tracked vehicles: closed, in the size of their descriptions, on what moves them, in few batches."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import rotate
from simwarp.scenery import Label, add_tracked_vehicle_visual
from simwarp.scenery.track_bodies import (
    OLIVE,
    hull_mesh,
    shoe_mesh,
    shoe_width,
    sprocket_mesh,
    tooth_outline,
    track_wheel_mesh,
)
from simwarp.sensors.scene import Visuals
from simwarp.vehicle import add_tracked_vehicle, load_tracked_vehicle, tracked_vehicle_names
from simwarp.vehicle.spec.track_parts import SinglePinSprocket
from tests.unit.scenery.scenery_meshes import assert_outward

SPEC = load_tracked_vehicle("m113")
TRACK = SPEC.left
WHEEL = TRACK.road_wheels[0].suspension.wheel


def built(**options):
    builder = sw.ModelBuilder()
    parts = add_tracked_vehicle(builder, SPEC, **options)
    visuals = Visuals(builder)
    visuals.hide(*(each.shape for each in visuals.instances))
    return builder, parts, visuals


@pytest.mark.parametrize("name", tracked_vehicle_names())
def test_every_shipped_vehicle_is_drawn(name):
    """Hull, and of each side sprocket, idler, five wheels and all shoes at least; wheels and shoes where they are."""
    spec = load_tracked_vehicle(name)
    builder = sw.ModelBuilder()
    parts = add_tracked_vehicle(builder, spec)
    visuals = Visuals(builder)
    found = add_tracked_vehicle_visual(visuals, parts)
    assert len(found) >= 1 + 2 * 7 + 63 + 64
    named = {visuals.instances[index].name: visuals.instances[index] for index in found}
    for side, track, sign in (("left", spec.left, 1.0), ("right", spec.right, -1.0)):
        for k, mount in enumerate(track.road_wheels):
            shown = named[f"{side}_wheel_{k}"]
            body = builder.bodies[shown.body].pose
            at = body.position + rotate(body.rotation, shown.pose.position)
            x, y, z = mount.location
            wanted = (x, sign * (spec.track_offset + y), z + spec.start_height)
            np.testing.assert_allclose(at, wanted, atol=1e-9)


def test_bodies_are_closed_and_few_triangles():
    meshes = {
        "hull": (hull_mesh(SPEC, OLIVE), 900), "sprocket": (sprocket_mesh(TRACK.sprocket), 1000),
        "shoe": (shoe_mesh(TRACK.shoe, shoe_width(TRACK)), 100), "wheel": (track_wheel_mesh(WHEEL), 700),
        "idler": (track_wheel_mesh(TRACK.idler.wheel, rubber=False), 700),
        "single": (track_wheel_mesh(dataclasses.replace(WHEEL, gap=0.0)), 300),
    }  # fmt: skip
    for name, (mesh, most) in meshes.items():
        assert_outward(mesh)
        assert len(mesh.triangles) <= most, name


def test_teeth_reach_the_tips_and_gaps_their_seat():
    sprocket = TRACK.sprocket
    assert isinstance(sprocket, SinglePinSprocket)
    outline = tooth_outline(sprocket)
    radius = np.linalg.norm(outline, axis=1)
    assert radius.min() == pytest.approx(sprocket.roller_seat)
    assert radius.max() == pytest.approx(sprocket.tip_radius)
    assert np.count_nonzero(np.isclose(radius, sprocket.roller_seat)) == sprocket.teeth
    # one gap points straight down
    assert outline[int(np.argmin(outline[:, 1] + np.abs(outline[:, 0])))] == pytest.approx([0.0, -0.211], abs=0.03)
    # all arc centres are as far from their arcs as the description says
    first = outline[: len(outline) // sprocket.teeth]
    center = np.array([0.0, -sprocket.arc_center_radius])
    np.testing.assert_allclose(np.linalg.norm(first - center, axis=1), sprocket.arc_radius, rtol=1e-12)


def test_wheels_and_shoes_have_the_sizes_of_the_description():
    wheel = track_wheel_mesh(WHEEL).vertices
    assert np.linalg.norm(wheel[:, [0, 2]], axis=1).max() == pytest.approx(WHEEL.radius)
    np.testing.assert_allclose([wheel[:, 1].min(), wheel[:, 1].max()], [-0.5 * WHEEL.width, 0.5 * WHEEL.width])
    rubber = np.linalg.norm(wheel[:, [0, 2]], axis=1) > 0.9 * WHEEL.radius
    assert np.abs(wheel[rubber, 1]).min() >= 0.5 * WHEEL.gap - 1e-9  # nothing fills the gap there
    shoe = shoe_mesh(TRACK.shoe, shoe_width(TRACK)).vertices
    pad = TRACK.shoe.ground_pad
    assert shoe[:, 2].min() == pytest.approx(pad.center[2] - 0.5 * pad.size[2])
    assert np.abs(shoe[:, 0]).max() < 0.5 * TRACK.shoe.pitch + 0.011  # a pin's radius beyond the pin


def test_the_hull_is_clear_of_its_tracks():
    hull = hull_mesh(SPEC, OLIVE).vertices
    inner, outer = (SPEC.track_offset + side * 0.5 * shoe_width(TRACK) for side in (-1.0, 1.0))
    beside = (np.abs(hull[:, 1]) > inner) & (np.abs(hull[:, 1]) < outer)
    assert hull[beside, 2].min() > TRACK.sprocket.assembly_radius + 0.5 * TRACK.shoe.height
    assert hull[:, 2].min() > -0.574 + 0.3  # above the ground


def test_instances_move_with_their_bodies_and_shoes_share_a_mesh():
    builder, parts, visuals = built(prefix="a_")
    added = add_tracked_vehicle_visual(visuals, parts, color=(0.3, 0.2, 0.1))
    found = {visuals.instances[index].name: visuals.instances[index] for index in added}
    assert len(found) == len(added) == 1 + 127 + 2 * (1 + 1 + 1 + 5 + 5)  # hull; shoes; sprocket, idler, carrier, ...
    assert found["a_hull"].body == parts.chassis
    assert found["a_right_wheel_3"].body == parts.right.road_wheels[3]
    assert found["a_left_sprocket"].body == builder.joints[parts.left.sprocket].child
    assert {found[f"a_left_shoe_{k}"].body for k in range(63)} == set(parts.left.shoes)
    assert len({each.asset for name, each in found.items() if "shoe" in name}) == 2
    assert {each.appearance.label for each in found.values()} == {int(Label.VEHICLE)}


def test_a_fixed_hull_is_where_its_sprockets_are():
    at = sw.pose((3.0, -1.0, 2.0), (0.0, 0.0, np.sin(0.3), np.cos(0.3)))
    _, parts, visuals = built(hull_fixed=True, at=at)
    hull = visuals.instances[add_tracked_vehicle_visual(visuals, parts)[0]]
    np.testing.assert_allclose(hull.pose.position, at.position, atol=1e-12)
    np.testing.assert_allclose(hull.pose.rotation, at.rotation, atol=1e-12)


def test_the_page_shows_sixteen_vehicles_in_few_batches():
    pytest.importorskip("viser")
    from simwarp.viewer.live.batches import Batches

    builder, parts, visuals = built()
    add_tracked_vehicle_visual(visuals, parts)
    scene = visuals.finalize(builder.finalize(16, "cpu"))
    batches = Batches(scene, range(16)).batches
    shoes = [batch for batch in batches if len(batch.rows) in (16 * 63, 16 * 64)]
    assert len(shoes) == 2  # 2 032 shoes in two draw calls
    assert len(batches) <= 30
