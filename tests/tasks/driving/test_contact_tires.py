"""Driving tasks on rigid and flexible tires: these stand on shapes, which nothing else meets, and move with resets."""

import json

import numpy as np
import pytest
import torch

from simwarp.core.interop import to_torch
from simwarp.core.rotation import matrix_of
from simwarp.tasks import InputError, Range
from simwarp.vehicle import SpecError
from tests.tasks.driving.driving_checks import NAMES, driving, held

TIRE = {
    "template": "flexible", "mass": 37.6, "inertia": [3.84, 6.69, 3.84], "radius": 0.467, "width": 0.254,
    "parameters": {"around": 16, "across": 4, "damping_time": 0.01},
}  # fmt: skip
"""The HMMWV's with few cells, which take a tenth of the time."""


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    path = tmp_path_factory.mktemp("tires") / "coarse.json"
    path.write_text(json.dumps(TIRE))
    return str(path)


@pytest.fixture(scope="module")
def bent(coarse):
    """Three worlds on flexible tires, with air of their own."""
    air = {"flexible_pressure": Range(0.5, 1.5), "flexible_young": Range(0.9, 1.1, only="axle0.left.tire")}
    return driving("obstacle-avoidance", 3, tires=coarse, randomise=air)


def weight(task):
    """Of world 0 [N]."""
    return 9.81 * float(task.simulation.model.body_mass.numpy()[0].sum())


def nodes_of(task):
    return [side.mesh.bodies[node] for side in task.parts.sides for node in side.mesh.nodes]


def from_chassis(task):
    """(W, nodes, 3) nodes of the tires in axes of the chassis [m]."""
    state = task.simulation.state
    x, q = state.body_x.numpy(), state.body_rot.numpy()[:, task.parts.chassis]
    away = x[:, nodes_of(task)] - x[:, task.parts.chassis, None]
    return np.stack([rows @ matrix_of(one) for one, rows in zip(q, away, strict=True)])


@pytest.mark.parametrize("name", NAMES)
def test_rigid_tires_stand_on_the_ground_and_the_chassis_touches_nothing(name):
    task = driving(name, 2, tires="rigid", obstacles=0) if name == "off-road" else driving(name, 2, tires="rigid")
    height = task.pose()[0][:, 2].clone()
    loads = []
    for _ in range(8):
        task.step(held(task, pedal=-1.0))
        loads.append(task.vehicle.tires.load.numpy()[0].sum())
        assert not task.hit.any()
    # it swings on its springs; all of its weight is on the tires in the mean
    assert np.mean(loads) == pytest.approx(weight(task), rel=0.05)
    assert (task.pose()[0][:, 2] - height).abs().max() < 0.05


@pytest.mark.slow
def test_flexible_tires_carry_it_and_it_drives_off(bent):
    bent.restart()
    loads = []
    for _ in range(8):
        bent.step(held(bent))
        loads.append(bent.vehicle.tires.load.numpy().sum(axis=1))
    assert np.mean(loads) == pytest.approx(weight(bent), rel=0.05)
    for _ in range(10):
        bent.step(held(bent, pedal=1.0))
        assert not bent.hit.any()
    assert bent.motion()[:, 0].min() > 1.0


@pytest.mark.slow
def test_a_reset_takes_the_nodes_along_and_leaves_other_worlds(bent):
    bent.restart()
    settled = from_chassis(bent)
    for _ in range(10):
        bent.step(held(bent, steering=0.5, pedal=1.0))
    assert np.abs(from_chassis(bent) - settled).max() > 0.1  # wheels have turned
    before = bent.simulation.state.body_x.numpy().copy()
    bent.begin_episodes(torch.tensor([False, True, False]))
    after = bent.simulation.state.body_x.numpy()
    assert (after[[0, 2]] == before[[0, 2]]).all()
    # places are in double precision
    assert from_chassis(bent)[1] == pytest.approx(settled[1], abs=1e-9)


@pytest.mark.slow
def test_a_vehicle_is_placed_with_its_nodes(bent):
    bent.restart()
    settled = from_chassis(bent)
    place, heading = torch.tensor([[7.0, -3.0, 0.5]]).expand(3, 3), torch.tensor([2.0, 0.3, -1.0])
    bent.place_vehicle(torch.tensor([True, True, False]), place, heading)
    assert bent.pose()[0][:2, :2] == pytest.approx(place[:2, :2].double(), abs=1e-6)
    # turned by quaternions in double precision
    assert from_chassis(bent) == pytest.approx(settled, abs=1e-9)
    assert not bent.simulation.state.body_v.numpy()[:2, nodes_of(bent)].any()
    bent.restart()


@pytest.mark.slow
def test_air_and_rubber_are_drawn_as_other_parameters_are(bent):
    bent.restart()
    model = bent.simulation.model
    pressure, young = model.flexible_pressure.numpy(), model.flexible_young.numpy()
    assert pressure.shape == young.shape == (3, 4)
    assert (np.abs(pressure / 2.4e5 - 1.0) <= 0.5).all()
    assert len(np.unique(pressure)) == 12
    assert len(np.unique(young[:, 0])) == 3
    assert (young[:, 1:] == np.float32(4e7)).all()


@pytest.mark.slow
def test_worlds_and_observations_are_those_of_other_tires(coarse):
    bent, plain = (driving("obstacle-avoidance", 2, tires=tires) for tires in (coarse, None))
    found, known = bent.restart(), plain.restart()
    assert {name: (one.shape, one.dtype) for name, one in found.items()} == {
        name: (one.shape, one.dtype) for name, one in known.items()
    }
    assert bent.pose()[0][:, :2] == pytest.approx(plain.pose()[0][:, :2], abs=0.02)
    alone = driving("obstacle-avoidance", 1, tires=coarse)
    alone.restart()
    for _ in range(3):
        one, two = alone.step(held(alone, 0.3, 1.0)), bent.step(held(bent, 0.3, 1.0))
    assert torch.equal(one.observations["policy"][0], two.observations["policy"][0])


@pytest.mark.slow
@pytest.mark.parametrize("tires", ["rigid", "flexible"])
def test_tires_in_contact_stand_on_hills(tires):
    task = driving("off-road", 2, tires=tires, hills=1.0, obstacles=0)
    task.restart()
    spindles = [side.spindle for side in task.parts.sides]
    for _ in range(3):
        task.step(held(task, pedal=-1.0))
    place = to_torch(task.simulation.state.body_x)[:, spindles]
    ground = task.hills.height(place[..., :2])
    radii = torch.tensor([task.spec.axles[side.axle].tire.radius for side in task.parts.sides])
    # tires give way by centimetres, slopes of a tenth lift the centre by a two-hundredth of the radius
    assert (place[..., 2] - ground - radii).abs().max() < 0.06


def test_friction_is_drawn_for_tires_in_contact():
    task = driving("obstacle-avoidance", 3, tires="rigid", friction=(0.2, 0.6))
    drawn = to_torch(task.vehicle.tires.ground_friction)
    assert len(drawn.unique()) == 3
    task.step(held(task))
    shapes = [side.shape for side in task.parts.sides]
    friction = to_torch(task.simulation.model.shape_friction)[:, shapes]
    assert torch.equal(friction, drawn[:, None].expand(-1, 4))


def test_the_ground_of_tires_is_not_seen():
    task = driving("obstacle-avoidance", 1, tires="rigid", obs="camera", camera_width=40, camera_height=36)
    assert "tire_ground" in task.simulation.model.shape_names
    assert not [name for name in task.scene().names if "ground" in name]


def test_a_vehicle_without_such_a_tire_is_refused_in_a_line():
    with pytest.raises(SpecError, match="unknown tire 'flexible'") as caught:
        driving("hallway", 1, tires="flexible")
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_mesh_that_is_not_there_is_named_in_a_line(coarse):
    with pytest.raises(InputError, match=r"there is no 'axle0\.left'") as caught:
        driving(
            "obstacle-avoidance", 1, tires=coarse, randomise={"flexible_pressure": Range(0.5, 1.5, only="axle0.left")}
        )
    assert "\n" not in str(caught.value)
