"""Bodies and wheels of vehicles: closed, in the size of their descriptions, on the bodies that move them."""

from __future__ import annotations

import numpy as np
import pytest

import simwarp as sw
from simwarp.scenery import VEHICLES, Label, add_vehicle_visual, add_visual, vehicle_visual, vehicle_visuals_of
from simwarp.sensors.cameras.camera import CameraConfig, look_at
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.scene import Visuals
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.vehicle_files import load_vehicle, vehicle_names
from simwarp.vehicle.suspensions import Side
from simwarp.viewer import FreeCamera
from tests.unit.scenery.scenery_meshes import assert_outward, color_of

CAMERAS = {"hmmwv": (1.5, 0.0, 0.875), "gator": (0.65, 0.0, 0.75), "artcar": (-0.075, 0.0, 0.15),
           "sedan": (1.5, 0.0, 0.875), "skid-steer": (0.3, 0.0, 0.3),
           "truck": (3.25, 0.0, 1.3), "truck-semitrailer": (3.25, 0.0, 1.3)}  # fmt: skip
"""Where the driving tasks mount their cameras, in the vehicle's frame [m]."""


def inside(mesh, point):
    """Whether a point is inside a mesh of solids: the solid angle of their triangles is 4 pi for each around it."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles] - np.asarray(point), 1, 0)
    la, lb, lc = (np.linalg.norm(p, axis=1) for p in (a, b, c))
    top = (a * np.cross(b, c)).sum(axis=1)
    bottom = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return 2.0 * np.arctan2(top, bottom).sum() > 2.0 * np.pi


@pytest.mark.parametrize("name", VEHICLES)
def test_bodies_and_wheels_are_closed_and_few_triangles(name):
    picture = vehicle_visuals_of(name)
    assert_outward(picture.body)
    assert len(picture.body.triangles) <= 900
    for wheel in picture.wheels:
        assert_outward(wheel)
        assert len(wheel.triangles) <= 300


@pytest.mark.parametrize("name", VEHICLES)
def test_wheels_have_the_size_of_their_tires(name):
    spec, picture = load_vehicle(name), vehicle_visuals_of(name)
    for index, wheel in enumerate(picture.wheels):
        tire = spec.axles[index // 2].tire
        low, high = wheel.vertices.min(axis=0), wheel.vertices.max(axis=0)
        # 14 corners on the circle
        assert np.linalg.norm(wheel.vertices[:, [0, 2]], axis=1).max() == pytest.approx(tire.radius)
        assert high[2] == pytest.approx(tire.radius, rel=0.03)
        np.testing.assert_allclose([-low[1], high[1]], 0.5 * tire.width, rtol=1e-9)
        # rims look outwards: hubs of the left wheels are on the left
        middle = wheel.vertices[np.linalg.norm(wheel.vertices[:, [0, 2]], axis=1) < 0.2 * tire.radius, 1]
        assert (np.abs(middle).max() == middle.max()) == (index % 2 == 0)


@pytest.mark.parametrize("name", VEHICLES)
def test_the_body_is_about_its_wheels_and_out_of_the_cameras_way(name):
    spec, picture = load_vehicle(name), vehicle_visuals_of(name)
    low, high = picture.body.vertices.min(axis=0), picture.body.vertices.max(axis=0)
    front, rear = picture.places[0], picture.places[-1]
    radius = spec.axles[0].tire.radius
    assert high[0] > front[0] + 0.5 * radius
    assert low[0] < rear[0] - 0.5 * radius
    # it clears the ground, also where the vehicle's frame is not level
    ground = min(front[2], rear[2]) - radius
    assert low[2] > ground + 0.15 * radius
    assert high[2] > front[2] + radius
    assert not inside(picture.body, CAMERAS[name])
    # and nothing is right before the lens but what is below it
    ahead = np.array(CAMERAS[name]) + np.array([0.3 * radius, 0.0, 0.0])
    assert not inside(picture.body, ahead)
    # what is inside is told to be
    assert inside(picture.body, (front[0] - radius, 0.0, front[2] + 0.6 * radius))


@pytest.mark.parametrize("name", VEHICLES)
def test_a_parked_vehicle_stands_on_the_ground(name):
    visual = vehicle_visual(name)
    assert_outward(visual.mesh)
    assert visual.lower[2] == pytest.approx(0.0, abs=1e-9)
    assert visual.label == Label.VEHICLE
    box = visual.proxies[0]
    low, high = box.pose.position - box.size, box.pose.position + box.size
    # mirrors, antenna and snorkel stand out, nothing else does
    out = ((visual.mesh.vertices < low - 0.02) | (visual.mesh.vertices > high + 0.02)).any(axis=1)
    assert out.mean() < 0.1
    assert (visual.lower < low + 0.1).all()
    assert (visual.upper > high - 0.1).all()


def test_colors_are_given():
    red = vehicle_visuals_of("sedan", color=(0.7, 0.02, 0.02)).body
    blue = vehicle_visuals_of("sedan").body
    assert (red.vertices == blue.vertices).all()
    assert color_of(red)[..., 0].mean() > 2.0 * color_of(blue)[..., 0].mean()


def test_an_unknown_vehicle_is_told_in_one_line():
    with pytest.raises(sw.ModelError, match=r"^vehicle visual: name must be one of hmmwv, .*, got 'hmmwvx'; say"):
        vehicle_visuals_of("hmmwvx")
    assert vehicle_visuals_of("hmmwv-reduced").body.vertices.shape == vehicle_visuals_of("hmmwv").body.vertices.shape


@pytest.mark.parametrize("name", vehicle_names())
def test_every_shipped_vehicle_is_seen_on_its_own_bodies(name):
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, load_vehicle(name), at=sw.pose((3.0, -2.0, 0.5)))
    visuals = Visuals(builder)
    instances = add_vehicle_visual(visuals, parts, prefix="car_")
    sides: tuple[Side, ...] = parts.sides
    wheels = [f"car_wheel_{k}" for k in range(len(sides))]
    names = [visuals.instances[index].name for index in instances]
    assert names[: len(sides) + 1] == ["car_body", *wheels]
    bodies = [visuals.instances[index].body for index in instances]
    assert bodies[: len(sides) + 1] == [parts.chassis, *(side.spindle for side in sides)]
    # trailers come last, each on a body of its own
    trailers = [unit.chassis for unit in parts.units[1:]]
    assert sorted(set(bodies[len(sides) + 1 :])) == trailers
    assert all(name.startswith("car_trailer_") for name in names[len(sides) + 1 :])
    # places of the picture are those of the wheels, but for the travel of the springs
    places = vehicle_visuals_of(name).places
    for place, side in zip(places, sides[: len(places)], strict=True):
        wheel = builder.bodies[side.spindle].pose.position - np.array([3.0, -2.0, 0.5])
        np.testing.assert_allclose(place[:2], wheel[:2], atol=5e-3)
        assert abs(place[2] - wheel[2]) < 0.06


def test_a_picture_of_a_parked_car_shows_it():
    builder = sw.ModelBuilder()
    visuals = Visuals(builder)
    add_visual(visuals, vehicle_visual("hmmwv"), name="truck")
    builder.add_body("far away", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 0.0, -100.0)))
    model = builder.finalize(world_count=1, device="cpu")
    scene = visuals.finalize(model, origin_body=sw.WORLD)
    config = CameraConfig(width=40, height=24, lens=Pinhole(fov=1.0), outputs=("semantic",))
    camera = FreeCamera(scene, [0], config)
    simulation = sw.Simulation(model, dt=0.01)
    seen = camera.render(simulation.state, [look_at((-9.0, 0.0, 1.4), (0.0, 0.0, 0.9))])[0, ..., 0]
    rows, columns = np.nonzero(seen == Label.VEHICLE)
    assert set(np.unique(seen)) == {-1, int(Label.VEHICLE)}
    # 2.15 m wide at 6.65 m; 40 pixels are 2 tan 0.5 wide at 1 m
    pixels = 20.0 / np.tan(0.5)
    assert np.ptp(columns) + 1 == pytest.approx(2.15 / 6.65 * pixels, abs=2.5)
    assert np.ptp(rows) + 1 == pytest.approx(1.84 / 7.0 * pixels, abs=3.0)
