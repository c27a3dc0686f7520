"""Cameras inside steps: mounts that move, clocks, resets, snapshots, and worlds that do not know of each other."""

import dataclasses
import math

import numpy as np
import pytest
import torch

import simwarp as sw
from simwarp.core.interop import to_torch
from simwarp.core.rotation import matrix_of
from simwarp.core.types import ModelError
from simwarp.sensors.cameras.camera import Camera, CameraConfig, look_at
from simwarp.sensors.cameras.image_processing import Imaging
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.scene import Visuals

SMALL = CameraConfig(schedule=Schedule(rate=100.0), width=16, height=10, lens=Pinhole(fov=1.2))
NOISY = dataclasses.replace(SMALL, samples=2, imaging=Imaging(noise_sigma=0.05))


def spinning_world(start=(0.0, 0.0, 0.5)):
    """A body that carries cameras past boxes, turning as it goes."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_body("car", mass=1.0, inertia=(1, 1, 1), pose=sw.pose(start), velocity=(1.0, 0.5, 0.0),
                     omega=(0.0, 0.0, 2.0))  # fmt: skip
    builder.add_shape_plane(name="ground")
    visuals = Visuals(builder)
    draws = np.random.default_rng(4)
    for index in range(12):
        place = np.array(start) + np.array([4.0 * math.cos(index), 4.0 * math.sin(index), 0.0])
        visuals.add_box(
            sw.WORLD, half=draws.uniform(0.2, 0.6, 3), pose=sw.pose(place), color=draws.uniform(0.1, 1.0, 3)
        )
    return builder, visuals


def run(steps=0, worlds=1, config=SMALL, mount=None, start=(0.0, 0.0, 0.5), dt=0.01, **options):
    """A simulation with one camera on the car, after some steps."""
    builder, visuals = spinning_world(start)
    model = builder.finalize(worlds, "cpu")
    where = Mount("car", sw.pose((0.3, 0.1, 0.2))) if mount is None else mount
    camera = Camera(visuals.finalize(model), where, config, **options)
    sim = sw.Simulation(model, dt, sensors=[camera])
    for _ in range(steps):
        sim.step()
    return sim, camera


def test_a_camera_goes_with_its_body():
    sim, camera = run(steps=30)
    x, q = sim.state.body_x.numpy()[0, 0], sim.state.body_rot.numpy()[0, 0]
    turn = matrix_of(q)
    eye = x + turn @ (0.3, 0.1, 0.2)
    builder, visuals = spinning_world()
    model = builder.finalize(1, "cpu")
    fixed = Camera(visuals.finalize(model), Mount(sw.WORLD, look_at(eye, eye + turn[:, 0])), SMALL)
    sw.Simulation(model, 0.01, sensors=[fixed])
    assert np.abs(camera.data.numpy().astype(int) - fixed.data.numpy().astype(int)).max() <= 1


def test_pictures_are_as_sharp_far_from_the_origin():
    near, far = (run(steps=5, start=start)[1].data.numpy()[0].astype(int) for start in ((0, 0, 0.5), (3e5, -4e5, 0.5)))
    # the tops of the boxes are the same; float64 places of 5e5 m are good to 1e-10 m
    assert np.abs(near - far).max() <= 1


def test_a_mount_of_ones_own_per_world():
    def picture(worlds, change):
        builder, visuals = spinning_world()
        model = builder.finalize(worlds, "cpu")
        camera = Camera(visuals.finalize(model), Mount("car"), SMALL, per_world=("mount",))
        change(camera.mount)
        sw.Simulation(model, 0.01, sensors=[camera])
        return camera.data.numpy()

    def place(mount):
        mount.position[1:2] = [[0.0, 0.0, 1.0]]

    both = picture(2, place)
    assert not np.array_equal(both[0], both[1])
    np.testing.assert_array_equal(both[0], picture(1, lambda mount: None)[0])


def test_a_world_does_not_know_how_many_others_there_are():
    one, three = run(7, worlds=1, config=NOISY)[1], run(7, worlds=3, config=NOISY)[1]
    np.testing.assert_array_equal(one.data.numpy()[0], three.data.numpy()[0])
    assert not np.array_equal(three.data.numpy()[1], three.data.numpy()[0])  # noise of its own


def test_the_same_seed_gives_the_same_pictures():
    first, again = (run(5, config=NOISY, seed=7)[1].data.numpy() for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, run(5, config=NOISY, seed=8)[1].data.numpy())


def test_a_picture_comes_late_by_its_lag():
    late = dataclasses.replace(SMALL, schedule=Schedule(rate=50.0, lag=0.03))
    sharp = [run(step)[1].data.numpy()[0] for step in range(8)]
    sim, camera = run(config=late)
    shown = [camera.data.numpy()[0].copy()]
    for _ in range(7):
        sim.step()
        shown.append(camera.data.numpy()[0].copy())
    # frames of steps 2 and 4 are there at steps 5 and 7
    for step, source in enumerate((0, 0, 0, 0, 0, 2, 2, 4)):
        np.testing.assert_array_equal(shown[step], sharp[source])
    assert camera.timestamp.numpy()[0] == pytest.approx(0.04)


def test_worlds_of_random_phase_take_turns():
    config = dataclasses.replace(SMALL, schedule=Schedule(rate=10.0, phase="random"))
    sim, camera = run(worlds=12, config=config)
    changed = np.zeros(12, int)
    last = camera.data.numpy().copy()
    for step in range(10):
        sim.step()
        new = camera.data.numpy()
        moved = (new != last).reshape(12, -1).any(axis=1)
        changed += moved
        assert step < 9 or len(set(camera.frames.phase.numpy())) > 3
        last = new.copy()
    assert (changed <= 1).all()
    assert changed.sum() >= 9


def test_a_reset_shows_the_start_again_and_leaves_other_worlds_alone():
    sim, camera = run(worlds=2)
    start = camera.data.numpy().copy()
    for _ in range(6):
        sim.step()
    moved = camera.data.numpy().copy()
    assert not np.array_equal(start, moved)
    sim.reset(np.array([True, False]))
    np.testing.assert_array_equal(camera.data.numpy()[0], start[0])
    np.testing.assert_array_equal(camera.data.numpy()[1], moved[1])


def test_a_snapshot_holds_a_frame_that_is_being_collected():
    config = dataclasses.replace(NOISY, schedule=Schedule(rate=10.0, window=0.06, lag=0.03))
    sim, camera = run(14, config=config)
    kept = sim.snapshot()
    for _ in range(9):
        sim.step()
    wanted = camera.data.numpy().copy()
    sim.reset()
    for _ in range(3):
        sim.step()
    sim.restore(kept)
    for _ in range(9):
        sim.step()
    np.testing.assert_array_equal(camera.data.numpy(), wanted)


def test_outputs_are_shared_with_torch():
    sim, camera = run(config=dataclasses.replace(SMALL, outputs=("depth", "rgb", "semantic")))
    tensors = {name: to_torch(array) for name, array in camera.outputs.items()}
    assert {name: (tuple(t.shape), t.dtype) for name, t in tensors.items()} == {
        "depth": ((1, 10, 16, 1), torch.float32),
        "rgb": ((1, 10, 16, 3), torch.uint8),
        "semantic": ((1, 10, 16, 1), torch.int32),
    }
    assert camera.data is camera.outputs["depth"]
    before = tensors["rgb"].clone()
    for _ in range(5):
        sim.step()
    assert not torch.equal(before, tensors["rgb"])


def test_two_cameras_share_a_scene():
    builder, visuals = spinning_world()
    model = builder.finalize(1, "cpu")
    scene = visuals.finalize(model)
    first = Camera(scene, Mount("car"), SMALL, name="left")
    second = Camera(scene, Mount("car"), dataclasses.replace(SMALL, groups=2), name="right", lights=first.lights)
    sim = sw.Simulation(model, 0.01, sensors=[first, second])
    for _ in range(3):
        sim.step()
    alone = run(3, mount=Mount("car"))[1]
    np.testing.assert_array_equal(first.data.numpy(), alone.data.numpy())
    assert second.data.numpy()[0, 0, 0].tolist() != alone.data.numpy()[0, -1, 0].tolist()


def test_what_cannot_be_mounted_is_refused():
    with pytest.raises(ModelError, match=r"'camera'.*no body 'cat'; did you mean 'car'"):
        run(mount=Mount("cat"))
    with pytest.raises(ModelError, match=r"rate must be positive, got 0\.0; give frames per second \[Hz\]"):
        Schedule(rate=0.0)
    with pytest.raises(ModelError, match=r"lag must be zero or positive, got -0\.1; give seconds, 0 for none"):
        Schedule(rate=1.0, lag=-0.1)
    camera = run()[1]
    with pytest.raises(ModelError, match="belongs to the Lights"):
        Camera(camera.scene, Mount("car"), lights=camera.lights, per_world=("sun_color",), name="b")
