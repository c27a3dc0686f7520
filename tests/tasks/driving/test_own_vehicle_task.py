"""A task of one's own, from public names: a vehicle of a JSON file, on other hills in every world and episode."""

import dataclasses

import numpy as np
import pytest
import torch

import simwarp as sw
from simwarp.scenery import height_at
from simwarp.tasks import make
from simwarp.tasks.driving import DrivingConfig, DrivingTask, Hills
from simwarp.tasks.framework import registry
from simwarp.vehicle import load_vehicle, save_vehicle
from tests.tasks.driving.driving_checks import SMALL

FIELDS, SIDE, WORLDS = 5, 60.0, 6


class MuleTask(DrivingTask[DrivingConfig]):
    """It stands on hills, and nothing else."""

    summary = "a vehicle of a file on hills"
    config_type = DrivingConfig
    chassis_half, chassis_place, camera_place = (1.35, 0.75, 0.35), (0.0, 0.0, 0.2), (0.65, 0.0, 0.75)
    per_world = (*DrivingTask.per_world, *Hills.model_arrays)

    def build_world(self, builder):
        self.hills = Hills(FIELDS, SIDE)
        self.hills.build(builder)

    def ground(self, model):
        return self.hills.terrain(model)

    def setup(self):
        self.hills.bind(self.simulation.model)
        super().setup()
        self.shown = torch.zeros(self.num_worlds, 2, device=self.device)

    def draw_world(self, world_mask):
        field = self.random.integers("field", 0, FIELDS)[:, 0]
        amplitude = self.random.uniform("amplitude", 0.5, 2.0)[:, 0]
        self.hills.show(world_mask, field, amplitude)
        drawn = torch.stack([field.float(), amplitude], dim=1)
        self.shown = torch.where(world_mask[:, None], drawn, self.shown)

    def start(self, world_mask):
        spot = torch.zeros(self.num_worlds, 2, device=self.device)
        place = torch.cat([spot, self.hills.height(spot[:, None])], dim=1)
        self.place_vehicle(world_mask, place, torch.zeros(self.num_worlds, device=self.device), self.hills.normal(spot))

    def measured(self):
        return self.motion()

    def exact_state(self):
        return self.motion()

    def rewards(self):
        return {"alive": torch.ones(self.num_worlds, device=self.device)}

    def terminations(self):
        return {}


@pytest.fixture
def mule(tmp_path):
    """Make the task with its vehicle in a file; further class variables may be given."""
    file = tmp_path / "mule.json"
    save_vehicle(dataclasses.replace(load_vehicle("gator"), name="mule"), file)

    def build(**variables):
        own = {"vehicle_name": str(file), "full_name": str(file), **SIZES, **variables}
        cls = type("MuleOnHills", (MuleTask,), own)
        registry.register("mule-on-hills")(cls)
        return make("mule-on-hills", WORLDS, **SMALL)

    yield build
    registry._tasks.pop("mule-on-hills", None)


SIZES = {name: getattr(MuleTask, name) for name in ("chassis_half", "chassis_place", "camera_place")}
"""They stand beside the name of the vehicle."""


def surface(task, points):
    """(W, N) heights, and z components of the normals, of what each world was told to show, at points (W, N, 2)."""
    step, found = 0.2, []
    for world, (field, amplitude) in enumerate(task.shown.tolist()):
        heights = task.hills.fields[int(field)]

        def at(shift, heights=heights, amplitude=amplitude, world=world):
            return amplitude * height_at(heights, (SIDE, SIDE), points[world] + np.array(shift))

        x, y = (at((step, 0.0)) - at((-step, 0.0))), (at((0.0, step)) - at((0.0, -step)))
        found.append([at((0.0, 0.0)), 1.0 / np.sqrt(1.0 + (x**2 + y**2) / (2.0 * step) ** 2)])
    return np.array(found)


def test_tires_stand_on_the_hills_of_their_world_and_episode(mule):
    task = mule()
    spindles = [side.spindle for side in task.parts.sides]
    radius = np.array([axle.tire.radius for axle in task.spec.axles for _ in range(2)])
    seen = []
    for _ in range(2):
        for _ in range(5):
            task.step(torch.tensor([[0.0, -1.0]] * WORLDS))  # on its brakes
        wheels = task.simulation.state.body_x.numpy()[:, spindles]
        height, upwards = np.moveaxis(surface(task, wheels[..., :2]), 1, 0)
        above = (wheels[..., 2] - height) * upwards
        # triangles of 1.5 m below a tire that looks 0.1 m around itself, and wheels that lean by some degrees: 2 cm;
        # other fields are off by more than a metre times their amplitude
        np.testing.assert_allclose(above, radius - task.vehicle.tires.deflection.numpy(), atol=0.02)
        assert (task.vehicle.tires.load.numpy() > 0.0).all()
        seen.append(task.shown.clone())
        assert len(seen[-1][:, 0].unique()) > 1
        task.begin_episodes(torch.arange(WORLDS) % 2 == 0)
    assert (seen[0] != seen[1]).any(dim=1).tolist() == [True, False] * (WORLDS // 2)  # only those that began anew


def test_its_picture_is_its_shape_on_wheels(mule):
    task = mule()
    names = [instance.name for instance in task.scene().visuals.instances]
    assert names == ["chassis_box", "hills", "wheel_0", "wheel_1", "wheel_2", "wheel_3"]
    camera = task.step(torch.zeros(WORLDS, 2)).observations["camera"]
    assert camera.shape == (WORLDS, 36, 40, 3)
    assert len({image.numpy().tobytes() for image in camera}) > 1  # each world sees its own hills


def test_it_may_look_like_a_shipped_one(mule):
    task = mule(looks_like="gator")
    instances = task.scene().visuals.instances
    assert [instance.name for instance in instances] == ["hills", "body", "wheel_0", "wheel_1", "wheel_2", "wheel_3"]
    assert instances[1].kind == sw.ShapeType.MESH
