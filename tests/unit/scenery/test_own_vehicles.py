"""Pictures of vehicles that are not shipped: like one of these in their own size, or drawn from their shapes."""

import dataclasses

import numpy as np
import pytest

import simwarp as sw
from simwarp.scenery import Label, add_vehicle_visual, vehicle_visuals_of
from simwarp.sensors import Visuals
from simwarp.vehicle import add_chassis_box, add_vehicle, load_vehicle, save_vehicle


def own_vehicle(length=1.0, size=1.0, axles=2):
    """The sedan under another name, with axles further from each other and larger tires."""
    spec = load_vehicle("sedan")
    front, rear = spec.axles

    def scaled(axle, x):
        tire = dataclasses.replace(axle.tire, radius=size * axle.tire.radius)
        return dataclasses.replace(axle, location=(x, *axle.location[1:]), tire=tire)

    ahead, behind = length * front.location[0], length * rear.location[0]
    places = np.linspace(ahead, behind, axles)
    chosen = [scaled(front, ahead), *(scaled(rear, float(x)) for x in places[1:])]
    return dataclasses.replace(spec, name="delivery", axles=tuple(chosen), driveline=None, engine=None,
                               transmission=None, wheelbase=None)  # fmt: skip


def shown(spec, *, box=False, **options):
    """What is added for a vehicle: its parts, its shape in contacts, its visuals and the instances."""
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, spec)
    shape = add_chassis_box(builder, parts, half=(2.0, 0.8, 0.4), position=(0.1, 0.0, 0.2)) if box else None
    visuals = Visuals(builder)
    indices = add_vehicle_visual(visuals, parts, box=shape, **options)
    return parts, visuals, [visuals.instances[index] for index in indices]


@pytest.mark.parametrize("axles", [2, 3])
def test_a_vehicle_without_a_body_is_drawn_from_its_shapes(axles):
    spec = own_vehicle(axles=axles)
    parts, visuals, (body, *wheels) = shown(spec, box=True)
    box = next(shape for shape in visuals.builder.shapes if shape.name == "chassis_box")
    assert body.body == parts.chassis
    assert visuals.builder.shapes[body.shape] is box  # what contacts meet is what is seen
    assert [wheel.body for wheel in wheels] == [side.spindle for side in parts.sides]
    assert len(wheels) == 2 * axles
    for wheel, side in zip(wheels, range(2 * axles), strict=True):
        mesh = visuals.meshes[wheel.asset]
        radius = np.linalg.norm(np.asarray(mesh.vertices)[:, [0, 2]], axis=1).max()
        assert radius == pytest.approx(spec.axles[side // 2].tire.radius, rel=1e-6)
    assert {each.appearance.label for each in (body, *wheels)} == {int(Label.VEHICLE)}


def test_without_a_shape_it_is_the_box_of_its_description():
    spec = own_vehicle()
    parts, _, (body, *_) = shown(spec)
    assert body.kind == sw.ShapeType.BOX
    np.testing.assert_allclose(body.size, np.multiply(0.5, spec.chassis.size), rtol=1e-6)
    np.testing.assert_allclose(body.pose.position, np.add(parts.reference, spec.chassis.size_center), atol=1e-9)


def test_a_shipped_body_takes_the_place_of_the_shape():
    parts, visuals, (body, *_) = shown(load_vehicle("sedan"), box=True)
    assert body.body == parts.chassis
    assert all(instance.shape < 0 for instance in visuals.instances)


@pytest.mark.parametrize(("length", "size"), [(1.0, 1.0), (1.4, 1.0), (0.5, 0.5), (1.2, 1.6)])
@pytest.mark.parametrize("like", ["sedan", "hmmwv", "gator", "artcar"])
def test_a_body_fits_the_wheels_of_another_vehicle(like, length, size):
    spec = own_vehicle(length, size)
    picture, shipped = vehicle_visuals_of(like, spec=spec), vehicle_visuals_of(like)
    front, rear = picture.places[0, 0], picture.places[-1, 0]
    radius = spec.axles[0].tire.radius
    low, high = picture.body.vertices.min(axis=0), picture.body.vertices.max(axis=0)
    # it overhangs the axles by the shipped one's share of the wheelbase, and clears the ground
    overhangs = []
    for each in (picture, shipped):
        points, places = each.body.vertices[:, 0], each.places[:, 0]
        overhangs.append(np.array([points.max() - places[0], places[-1] - points.min()]) / (places[0] - places[-1]))
    # a shipped body leans by 0.2 m at most over its wheelbase: its ends move by 1 % of it
    np.testing.assert_allclose(overhangs[0], overhangs[1], atol=0.02)
    assert low[0] < rear - 0.5 * radius
    assert high[0] > front + 0.5 * radius
    assert low[2] > min(picture.places[0, 2], picture.places[-1, 2]) - 0.9 * radius
    track, before = np.ptp(picture.places[:, 1]), np.ptp(shipped.places[:, 1])
    assert high[1] - low[1] == pytest.approx(
        np.ptp(shipped.body.vertices[:, 1]) * track / before, rel=0.03
    )  # a share within 2 % is that of the shipped one


def test_a_description_that_is_alike_has_the_shipped_picture():
    for name in ("sedan", "hmmwv-reduced"):
        found, shipped = vehicle_visuals_of(name, spec=load_vehicle(name)), vehicle_visuals_of(name)
        np.testing.assert_array_equal(found.body.vertices, shipped.body.vertices)


def test_a_vehicle_may_be_like_a_shipped_one():
    _, visuals, (body, *_) = shown(own_vehicle(1.3), box=True, like="hmmwv")
    assert body.kind == sw.ShapeType.MESH
    assert all(instance.shape < 0 for instance in visuals.instances)
    with pytest.raises(sw.ModelError, match="vehicle visual: name must be one of"):
        shown(own_vehicle(), like="tractor")


def test_a_vehicle_of_a_file_keeps_its_picture(tmp_path):
    file = tmp_path / "delivery.json"
    save_vehicle(own_vehicle(1.2), file)
    _, _, (body, *wheels) = shown(load_vehicle(str(file)), box=True)
    assert body.kind == sw.ShapeType.BOX
    assert len(wheels) == 4
