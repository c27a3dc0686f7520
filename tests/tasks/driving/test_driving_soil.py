"""Driving tasks on soil: what is drawn for an episode, fresh ground at its start, ruts, room for them."""

import math

import numpy as np
import pytest
import torch

from simwarp.core.interop import to_torch
from simwarp.sensors import CameraConfig, Pinhole
from simwarp.sensors.cameras.camera import look_at
from simwarp.soil import PRESETS
from simwarp.tasks.driving.soil import SoilKind
from simwarp.tasks.randomisation.soil_draws import RIGID_MODULUS, RIGID_SHARE
from simwarp.viewer.free_camera import FreeCamera
from tests.tasks.driving.driving_checks import NAMES, driving, held, wheels

SOFT, HARD = PRESETS["soft"], PRESETS["hard"]
ROUND = 1e-5
"""Relative; parameters are drawn in float32, through a logarithm or an angle (1.2e-7 in values up to 20)."""


def parameters(task):
    """(W, 8) float64."""
    return task.soil.parameter[:, 0].double().numpy().copy()


def between(values, low, high):
    low, high = min(low, high), max(low, high)
    return bool(((values >= low * (1.0 - ROUND)) & (values <= high * (1.0 + ROUND))).all())


def ruts(task):
    """(W, wheels) depth below each wheel's centre [m]."""
    return to_torch(task.soil.element.sinkage).clone()


def drive(task, steps, steering=0.0, pedal=1.0):
    for _ in range(steps):
        task.step(held(task, steering, pedal))


# ---- parameters ------------------------------------------------------------------------------------------------


def test_every_preset_is_a_choice():
    assert {kind.value for kind in SoilKind} == {"none", "random", *PRESETS}


def test_without_soil_there_is_none():
    task, other = driving("off-road", 1), driving("off-road", 1, soil="soft")
    assert task.soil is None
    assert [axle.tire.template for axle in task.spec.axles] == ["tmeasy"] * 2
    assert [axle.tire.template for axle in other.spec.axles] == ["soil-rigid"] * 2


@pytest.mark.parametrize("name", PRESETS)
def test_a_named_soil_is_that_of_all_worlds(name):
    task = driving("off-road", 3, soil=name, obstacles=0)
    for _ in range(2):
        assert parameters(task) == pytest.approx(np.tile(PRESETS[name].values(), (3, 1)), rel=ROUND)
        task.restart()


def test_drawn_soils_are_between_soft_and_hard_or_nearly_rigid():
    task = driving("off-road", 512, soil="random", obstacles=0, friction=0.7, guard_steps=0, soil_pages=16)
    rows = parameters(task)
    rigid = rows[:, 0] > 2.0 * HARD.k_phi
    # five standard deviations of 512 draws
    assert abs(rigid.mean() - RIGID_SHARE) < 5.0 * math.sqrt(RIGID_SHARE * (1.0 - RIGID_SHARE) / 512)
    assert rows[rigid][:, [0, 2, 3, 4]] == pytest.approx(
        np.tile([RIGID_MODULUS, 1.0, 0.0, 0.7], (int(rigid.sum()), 1)), rel=ROUND
    )
    drawn = rows[~rigid]
    for column, (soft, hard) in enumerate(zip(SOFT.values(), HARD.values(), strict=True)):
        assert between(drawn[:, column], soft, hard)
    # uniform: means and spreads of the shares, five standard deviations of some 400 draws
    shares = np.stack([
        (np.log(drawn[:, 0]) - math.log(SOFT.k_phi)) / math.log(HARD.k_phi / SOFT.k_phi),
        (drawn[:, 2] - SOFT.exponent) / (HARD.exponent - SOFT.exponent),
        drawn[:, 3] / HARD.cohesion,
        (np.arctan(drawn[:, 4]) - SOFT.friction_angle) / (HARD.friction_angle - SOFT.friction_angle),
    ])  # fmt: skip
    off = 5.0 / math.sqrt(12.0 * len(drawn))
    assert np.abs(shares.mean(axis=1) - 0.5).max() < off
    assert np.abs(shares.std(axis=1) - math.sqrt(1.0 / 12.0)).max() < off
    apart = np.abs(np.corrcoef(shares) - np.eye(4))
    assert apart.max() < 5.0 / math.sqrt(len(drawn))  # each is drawn by itself


def test_draws_hang_on_seed_world_and_episode_alone():
    task = driving("off-road", 4, seed=3, soil="random", obstacles=0)
    first = parameters(task)
    assert len(np.unique(first[:, 0])) >= 3
    task.restart()
    second = parameters(task)
    assert (first != second).any(axis=1).all()
    task.restart(seed=3)
    assert (parameters(task) == first).all()
    assert (parameters(driving("off-road", 2, seed=3, first_world=2, soil="random")) == first[2:]).all()


def test_a_new_episode_has_fresh_soil_of_its_own_and_changes_no_other():
    task = driving("off-road", 3, soil="random", obstacles=0)
    drive(task, 12)
    element, before = task.soil.element, parameters(task)
    memory = {name: array.numpy().copy() for name, array in element.memory.items()}
    assert (memory["count"] > 16).all()
    before_wheels = wheels(task)[0][:, :, :2].numpy()
    assert (element.height(before_wheels).numpy() < -1e-4).all()
    task.begin_episodes(torch.tensor([False, True, False]))
    after = {name: array.numpy() for name, array in element.memory.items()}
    assert after["count"][1] <= 16  # below its four wheels: a page is 0.8 m wide
    assert (task.soil.element.height(before_wheels).numpy()[1] == 0.0).all()
    assert (parameters(task)[1] != before[1]).any()
    assert (parameters(task)[[0, 2]] == before[[0, 2]]).all()
    for name, values in after.items():
        assert (values[[0, 2]] == memory[name][[0, 2]]).all(), name


# ---- what it does ----------------------------------------------------------------------------------------------


def test_softer_ground_slows_down_and_leaves_deeper_ruts():
    speed, depth = [], []
    for soil in ("soft", "mid", "hard"):
        task = driving("off-road", 1, soil=soil, obstacles=0)
        drive(task, 30)
        speed.append(float(task.motion()[0, 0]))
        depth.append(float(ruts(task).mean()))
        nodes = task.soil.element
        page = int(nodes.memory["count"].numpy()[0])
        plastic = nodes.memory["node"].numpy()[0, : 64 * page, 0]
        assert plastic.max() == pytest.approx(ruts(task).max(), rel=0.5)  # of the same size as what is reported
        # two tracks of some 0.3 m; nodes of 0.1 m
        way = float((task.pose()[0][0, :2].norm() - task.config.radius).abs())
        assert (plastic > 0.0).sum() * 0.01 > 2.0 * 0.2 * way
    assert speed == sorted(speed)
    assert speed[0] > 1.0  # it gets away even there
    assert depth == sorted(depth, reverse=True)
    assert depth[0] > 5.0 * depth[2]


def test_a_vehicle_comes_to_rest_on_what_carries_it():
    task = driving("off-road", 8, seed=2, soil="random", obstacles=0)
    drive(task, 20, pedal=-1.0)  # two seconds
    assert task.motion().abs().max() < 0.02
    weight = 9.81 * float(to_torch(task.simulation.model.body_mass).sum(dim=1)[0])
    load = to_torch(task.soil.element.load).sum(dim=1)
    assert load.tolist() == pytest.approx([weight] * 8, rel=0.02)  # springs still move by a millimetre
    rigid = parameters(task)[:, 0] == RIGID_MODULUS
    deepest = ruts(task).amax(dim=1).numpy()
    assert rigid.any()
    assert (deepest[rigid] < 0.012).all()  # half of it between nodes 10 cm apart
    assert (deepest[~rigid] < 0.25).all()


@pytest.mark.parametrize("hills", [0.0, 1.0])
def test_an_episode_starts_at_rest_whatever_the_soil(hills):
    """Settled on mid soil, it stands on soft and on nearly rigid ground without a fall or a jump."""
    task = driving("off-road", 24, seed=2, soil="random", hills=hills, obstacles=0)
    rows = parameters(task)
    assert (rows[:, 0] < 3.0 * SOFT.k_phi).any()
    assert (rows[:, 0] == RIGID_MODULUS).any()
    place = task.pose()[0].clone()
    for _ in range(10):
        drive(task, 1, pedal=-1.0)
        # between nodes 10 cm apart a wheel of 0.3 m sinks 4 mm deeper than above one; hills lean
        assert (task.pose()[0] - place)[:, 2].abs().max() < (0.005 if hills == 0.0 else 0.01)


def test_nearly_rigid_soil_drives_as_the_rigid_ground_does(monkeypatch):
    monkeypatch.setattr("simwarp.tasks.driving.soil.RIGID_SHARE", 1.1)
    speeds = []
    for soil in ("none", "random"):
        task = driving("off-road", 1, soil=soil, obstacles=0)
        drive(task, 45)
        speeds.append(float(task.motion()[0, 0]))
    # the tires differ: those of rigid ground slip and have a rolling resistance
    assert speeds[1] == pytest.approx(speeds[0], rel=0.1)


def test_soil_lies_on_hills():
    task = driving("off-road", 8, soil="mid", hills=1.0, obstacles=0)
    drive(task, 15, pedal=-1.0)
    centre, _, radii, _ = wheels(task)
    ground = task.hills.height(centre[..., :2].double())
    below = ground - (centre[..., 2] - torch.tensor(radii).double())
    assert ground.abs().max() > 0.5
    assert (below > 0.0).all()
    assert (below < 0.12).all()  # twice what mid soil gives way on the flat; hills lean


@pytest.mark.parametrize("hills", [0.0, 1.0])
def test_ruts_are_seen(hills):
    """From straight above where a wheel stood, and where nothing ever was."""
    task = driving("off-road", 1, soil="soft", hills=hills, obstacles=0)
    sight = FreeCamera(
        task.scene(), [0, 0], CameraConfig(width=3, height=3, lens=Pinhole(fov=0.01), outputs=("depth",))
    )
    drive(task, 6)
    below = wheels(task)[0][0, 0, :2].numpy()
    places = [below, below + 8.0]
    drive(task, 25)
    poses = [look_at((*place, 20.0), (*place, 0.0), up=(1.0, 0.0, 0.0)) for place in places]
    seen = 20.0 - sight.render(task.simulation.state, poses)[:, 1, 1, 0]
    plain = [0.0, 0.0]
    if hills:
        plain = task.hills.height(torch.tensor(np.array(places))[None])[0].tolist()
    told = task.soil.element.height(np.array(places)).numpy()[0]
    assert seen.tolist() == pytest.approx(told.tolist(), abs=1e-4)  # float32 at 20 m, of 2e-6 each
    assert seen[0] < plain[0] - 0.05
    assert seen[1] == pytest.approx(plain[1], abs=1e-4)


@pytest.mark.parametrize("name", [name for name in NAMES if name != "off-road"])
def test_every_driving_task_goes_on_soil(name):
    task = driving(name, 2, soil="hard")
    place = task.pose()[0].clone()
    drive(task, 14)
    assert (task.episode_index == 0).all()
    assert ((task.pose()[0] - place).norm(dim=1) > 0.3).all()  # the slowest, of the hallway, speed up to 0.75 m/s
    assert bool(torch.isfinite(task.observe()["policy"]).all())


def test_the_ruts_of_an_episode_find_room():
    task = driving("off-road", 4, soil="hard", obstacles=0, goal_radius=1.0)
    place = task.pose()[0][:, :2].clone()
    drive(task, 60)
    assert (task.episode_index == 0).all()
    element = task.soil.element
    way = (task.pose()[0][:, :2] - place).norm(dim=1)
    assert way.min() > 25.0
    usual = element.pages / (8.0 * task.config.control_dt * task.config.max_episode_steps)
    assert (to_torch(element.memory["count"]) < usual * (way + 4.0)).all()  # 4 m: where it stood
    assert int(to_torch(element.recycled).sum()) == 0
    few = driving("off-road", 1, soil="hard", obstacles=0, soil_pages=16)
    drive(few, 30)
    assert int(to_torch(few.soil.element.recycled)[0]) > 0
    assert np.isfinite(few.pose()[0].numpy()).all()
