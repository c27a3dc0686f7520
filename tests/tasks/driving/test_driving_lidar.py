"""Driving by lidar: the range image is that of the world around, and policies learn from it."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from simwarp.core.interop import to_torch
from simwarp.tasks import InputError, config_to_train_in, make, replace_fields, task_class
from simwarp.tasks.driving.off_road import OffRoadConfig
from simwarp.train.algorithm.distillation import DistillationConfig
from simwarp.train.algorithm.distiller import Distiller
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import CriticSees, NetworkKind, default_config, student_config
from simwarp.train.networks.policies import find_policy
from simwarp.train.runs.saved_distillation import lesson_by
from tests.tasks.driving.driving_checks import NAMES, copied, driving, obstacle_corners, random_actions, turned

SMALL = {"obs": "lidar", "lidar_rows": 6, "lidar_columns": 61}
BESIDE = {"obstacle-avoidance": 3, "off-road": 6, "convoy": 6, "hallway": 3, "barrier-track": 3}
"""Entries of `policy` beside a camera or a lidar."""


@pytest.mark.quick("off-road")
@pytest.mark.parametrize("name", NAMES)
def test_each_task_is_seen_by_lidar(name):
    few = {"tracks": 2} if name == "barrier-track" else {}
    task = driving(name, 2, seed=1, max_episode_steps=4, **SMALL, **few)
    assert task.observation_shapes == {"policy": (BESIDE[name],), "lidar": (6, 61, 1)}
    rows = [copied(task.restart(seed=1))]
    for action in random_actions(task, 6):
        rows.append(copied(task.step(action).observations))
    images = torch.stack([groups["lidar"] for groups in rows])
    assert float(images.min()) >= 0.0
    assert float(images.max()) <= 1.0
    assert images.flatten(2).std(dim=2).min() > 0.02  # something is near, something is not
    assert not torch.equal(images[0], images[-1])
    exact, state = task.observations_of("state"), driving(name, 1)
    assert exact is not None
    assert tuple(exact["policy"].shape[1:]) == state.observation_shapes["policy"]
    assert torch.equal(task.observe_privileged(), exact["policy"])


def test_the_lidar_has_sixteen_rows_of_nine_hundred_beams():
    config = OffRoadConfig()
    assert (config.lidar_rows, config.lidar_columns) == (16, 900)


def points_of(task):
    """Points of the range image (W, rows, columns, 3) [m], by angles written out; their ranges; the sensors (W, 2)."""
    config, lidar = task.config, task.lidar
    ranges = (1.0 - task.observations()["lidar"][..., 0].double()) * config.lidar_range
    azimuth = torch.linspace(0.5, -0.5, config.lidar_columns, dtype=torch.float64) * config.lidar_fan
    elevation = torch.linspace(1.0, -1.0, config.lidar_rows, dtype=torch.float64)[:, None] * math.radians(15.0)
    ray = torch.stack(
        [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin().expand(-1, len(azimuth))], -1
    )
    place, turn = (to_torch(array)[0].double() for array in (lidar.mount.position, lidar.mount.rotation))
    chassis = to_torch(task.simulation.state.body_q)[:, task.parts.chassis].double()
    body = turned(turn.expand(*ray.shape[:2], 4), ray)
    eye = chassis[:, :3] + turned(chassis[:, 3:], place.expand(len(chassis), 3))
    directions = turned(chassis[:, None, None, 3:].expand(-1, *ray.shape[:2], 4), body.expand(len(chassis), -1, -1, -1))
    return eye[:, None, None] + ranges.unsqueeze(-1) * directions, ranges, eye[:, :2].numpy()


@pytest.mark.slow
def test_what_is_seen_above_the_ground_is_an_obstacle_and_none_near_is_missed():
    task = driving("off-road", 6, seed=3, obs="lidar", obstacles=120, lidar_columns=300)
    points, ranges, eyes = points_of(task)
    corners, there = obstacle_corners(task)
    seen = 0
    for world in range(task.num_worlds):
        # Nearer than 1.5 m is the vehicle's own frame; at the end of the range nothing is seen
        chosen = (ranges[world] > 1.5) & (ranges[world] < 29.9)
        found = points[world][chosen].numpy()
        assert np.abs(found[found[:, 2] < 0.3][:, 2]).max() < 0.3  # the ground is flat
        high = found[found[:, 2] > 0.3]
        middle = corners[world][there[world]][..., :2].mean(dim=1).numpy()
        reach = (corners[world][there[world]][..., :2].numpy() - middle[:, None]).max(axis=(1, 2))
        away = np.linalg.norm(high[:, None, :2] - middle, axis=2) - 2.0 * reach - 0.5
        # Pictures of trees have crowns beyond the trunk that is touched
        crowns = np.linalg.norm(high[:, None, :2] - middle, axis=2).min(axis=1) < 3.5
        assert ((away.min(axis=1) < 0.0) | crowns).all()
        eye, heading = eyes[world], float(task.pose()[1][world])
        for index, place in enumerate(middle):
            offset = place - eye
            angle = math.remainder(math.atan2(offset[1], offset[0]) - heading, 2.0 * math.pi)
            # Beams are 2 degrees apart: 0.7 m at 20 m, of which the ground has 0.3 m
            tall = corners[world][there[world]][index, :, 2].max() > 1.2
            if tall and 4.0 < np.linalg.norm(offset) < 20.0 and abs(angle) < math.radians(90.0):
                column = round((0.5 - angle / task.config.lidar_fan) * (task.config.lidar_columns - 1))
                # It, or something before it, is above the ground
                beams = points[world, :, column].numpy()
                far = np.linalg.norm(beams[:, :2] - eye, axis=1)
                assert ((beams[:, 2] > 0.3) & (far < np.linalg.norm(offset) + reach[index])).any()
                seen += 1
    assert seen >= 5


def lidar_config(student=False):
    fields = {**SMALL, "max_episode_steps": 6}
    return replace_fields(config_to_train_in(task_class("off-road"), student=student), fields)


@pytest.mark.parametrize("name", NAMES)
def test_the_network_is_one_that_sees_ranges(name):
    cls = task_class(name)
    network = default_config(cls, replace_fields(cls.config_type(), {"obs": "lidar"})).network
    camera = default_config(cls, replace_fields(cls.config_type(), {"obs": "camera"})).network
    assert network.kind is NetworkKind.MULTI_INPUT
    assert (network.critic, network.init_mean) == (CriticSees.PRIVILEGED, camera.init_mean)


def test_ppo_learns_from_ranges_and_so_does_a_student_of_the_shipped_policy():
    cls, small = task_class("off-road"), {"num_envs": 4, "steps_per_iteration": 4, "device": "cpu", "threads": 1}
    config = replace_fields(default_config(cls, lidar_config()), small)
    trainer = Trainer(make("off-road", 4, config=lidar_config()), config)
    assert math.isfinite(trainer.iterate().values["loss/value"])
    shipped = find_policy("off-road", None, Path("none"), "state")
    lesson = lesson_by(shipped.path, "off-road", DistillationConfig(mini_batches=2))
    config = replace_fields(student_config(cls, lidar_config(student=True)), small)
    student = Distiller(make("off-road", 4, config=lidar_config(student=True)), config, lesson)
    assert math.isfinite(student.iterate().values["loss/behavior"])


@pytest.mark.parametrize(
    ("field", "value", "rule"),
    [
        ("lidar_rows", 0, "from 1 to 1024"),
        ("lidar_columns", 70_000, "at most 65536"),
        ("lidar_fan", 7.0, r"in \(0, 6.28319\]"),
        ("lidar_range", 0.0, "positive"),
    ],
)
def test_a_wrong_lidar_is_named_with_its_rule(field, value, rule):
    with pytest.raises(InputError, match=f"{field.replace('_', '-')}.*{rule}"):
        dataclasses.replace(OffRoadConfig(), **{field: value})
