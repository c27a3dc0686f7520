"""Height of the ground below a place, against rays from above."""

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenery
from simwarp.sensors import CameraConfig
from simwarp.sensors.scene import Visuals
from simwarp.viewer.free_camera import FreeCamera
from simwarp.viewer.ground_height import GroundHeight
from simwarp.viewer.studio import look_at

SIZE = (6.0, 4.0)
PLACES = np.array([[0.4, -0.3, 9.0], [1.3, 0.8, 9.0], [-1.7, 0.1, 9.0]])


def hills(seed):
    return scenery.hills(seed=seed, size=SIZE, spacing=0.25, amplitude=0.4, wavelength=(1.0, 2.0))


@pytest.fixture
def rough():
    builder = sw.ModelBuilder()
    shape = builder.add_shape_height_field(
        sw.WORLD, hills(0), size=SIZE, pose=sw.pose((0.2, 0.1, 0.5), (0, 0, np.sin(0.3), np.cos(0.3))), name="ground"
    )
    assets = [builder.add_height_field_asset(hills(seed), size=SIZE) for seed in range(3)]
    body = builder.add_body("b", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 0.0, 50.0)))
    builder.add_shape_sphere(body, radius=0.1)
    visuals = Visuals(builder)
    model = builder.finalize(3, "cpu", per_world=["shape_asset"])
    chosen = model.shape_asset.numpy()
    chosen[:, shape] = assets
    model.shape_asset.assign(chosen)
    return visuals.finalize(model), sw.Simulation(model, 0.01)


def test_heights_are_those_that_rays_meet_in_each_world(rough):

    scene, simulation = rough
    found = GroundHeight(scene, [0, 1, 2]).at(PLACES)
    config = CameraConfig(width=1, height=1, outputs=("depth",))
    camera = FreeCamera(scene, [0, 1, 2], config)
    eyes = [tuple(place) for place in PLACES]
    depths = camera.render(simulation.state, [look_at(eye, (*eye[:2], 0.0)) for eye in eyes])[:, 0, 0, 0]
    np.testing.assert_allclose(found, PLACES[:, 2] - depths, atol=1e-4)  # of 8 m, in float32
    assert np.ptp(found) > 0.05


def test_beside_a_field_there_is_nothing_or_the_plane(rough):
    scene, _ = rough
    assert (GroundHeight(scene, [0, 1, 2]).at(PLACES + 50.0) == -np.inf).all()
    builder = sw.ModelBuilder()
    builder.add_body("b", mass=1.0, inertia=(1.0, 1.0, 1.0))
    builder.add_shape_plane(sw.WORLD, pose=sw.pose((0.0, 0.0, -0.7)))
    builder.add_shape_height_field(sw.WORLD, hills(0) - 5.0, size=SIZE, name="low")
    visuals = Visuals(builder)
    model = builder.finalize(2, "cpu")
    np.testing.assert_allclose(GroundHeight(visuals.finalize(model), [0, 1]).at(PLACES[:2]), -0.7, atol=1e-7)
