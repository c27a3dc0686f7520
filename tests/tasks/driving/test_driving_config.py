"""Driving tasks: wrong settings are named in a line, options do what they say, and Gymnasium's rules are kept."""

import functools
import math
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
import pytest
import torch

from simwarp.core.interop import to_torch
from simwarp.tasks import InputError, TaskError, TaskVectorEnv, make, task_class
from simwarp.tasks.driving import DrivingConfig, DrivingTask, Observing
from simwarp.tasks.driving.hallway import HallwayRewards
from simwarp.tasks.driving.off_road import GROUND_TEXTURES, OffRoadConfig, OffRoadTask
from simwarp.tasks.randomisation.randomisation_config import Curriculum, Driver, Range
from simwarp.train.config import default_config, student_config
from tests.tasks.adapters import test_gym_conformance as rules
from tests.tasks.driving.driving_checks import NAMES, SMALL, driving, held, obstacle_corners, random_actions

WRONG = [
    *((name, "friction", 0.0, "positive") for name in NAMES),
    ("off-road", "soil_spacing", 0.0, "positive"),
    ("convoy", "soil_pages", 15, "at least 16"),
    ("off-road", "camera_width", 35, "at least 36"),
    ("hallway", "camera_height", 20, "at least 36"),
    ("convoy", "camera_fov", 3.2, r"in \(0, 3.14159\)"),
    ("convoy", "camera_rate", 0.0, "positive"),
    ("barrier-track", "dt", 0.0, "positive"),
    ("barrier-track", "friction", math.nan, "a finite number"),
    ("obstacle-avoidance", "action_rise_time", (0.5, -1.0), "zero or positive"),
    ("obstacle-avoidance", "spread", 7.6, r"in \[0, 7.5\]"),
    ("obstacle-avoidance", "end", -1.0, "positive"),
    ("off-road", "obstacles", -1, "from 0 to 500"),
    ("off-road", "obstacle_scale", 0.0, r"in \(0, 4\]"),
    ("off-road", "hills", -0.1, "zero or positive"),
    ("off-road", "hills", 4.0, "at most 10 m / hill_height"),
    ("off-road", "obstacles", 501, "from 0 to 500"),
    ("off-road", "obstacle_scale", 4.1, r"in \(0, 4\]"),
    ("off-road", "hill_height", 5.5, r"in \(0, 5\]"),
    ("off-road", "border", 40.0, r"in \(radius, 72\] m"),
    ("off-road", "border", 73.0, r"in \(radius, 72\] m"),
    ("off-road", "half", 61.0, r"in \(0, border\]"),
    ("off-road", "goal_radius", 40.0, r"in \(0, radius\)"),
    ("off-road", "clearance", 1.0, r"in \[2, radius\) m"),
    ("convoy", "latest_start", 0.81, r"in \[0, 0.8\]"),
    ("convoy", "cone", 0.0, r"in \(0, 3.14159\]"),
    ("convoy", "near", 30.0, r"in \(0, lost_distance\)"),
    ("convoy", "softness", 0.0, "positive"),
    ("hallway", "tracks", 0, "from 1 to 64"),
    ("barrier-track", "tracks", 65, "from 1 to 64"),
    ("hallway", "first_track", -1, "zero or positive"),
    ("hallway", "speed", 0.0, "positive"),
    ("barrier-track", "patience", 1.0, "above 1"),
]


@pytest.mark.parametrize(("name", "field", "value", "rule"), WRONG)
def test_a_wrong_value_is_named_with_its_rule_in_a_line(name, field, value, rule):
    with pytest.raises(InputError, match=f"^{field.replace('_', '-')} must be {rule}") as error:
        make(name, **{"obs": "state", field: value})
    assert "\n" not in str(error.value)
    assert str(error.value).endswith(repr(value))


@pytest.mark.parametrize(
    ("name", "field"),
    [
        ("off-road", "obs"),
        ("off-road", "soil"),
        ("off-road", "goal_frame"),
        ("convoy", "place_frame"),
        ("hallway", "start"),
    ],
)
def test_an_unknown_choice_is_named_with_those_that_there_are(name, field):
    with pytest.raises(InputError, match=f"^{field.replace('_', '-')} must be one of .*, got 'nowhere'"):
        driving(name, **{field: "nowhere"})


def test_rise_times_are_as_many_as_actions():
    with pytest.raises(InputError, match="action-rise-time has 3 values, task 'hallway' 1 actions"):
        make("hallway", obs="state", action_rise_time=(0.5, 0.5, 0.5))


# ---- options ---------------------------------------------------------------------------------------------------


@pytest.mark.quick("0.5")
@pytest.mark.parametrize("rise", [0.5, 0.0])
def test_the_speed_of_the_hallway_is_held(rise):
    """Whether or not actions are limited in their rate, which is what decides how often the controller is asked."""
    task = driving("hallway", 2, seed=2, action_rise_time=rise, rewards=HallwayRewards(failure=0.0))
    every = torch.ones(2, dtype=torch.bool)
    speeds = []
    for _ in range(60):
        task.step(held(task))
        if float(task.lane()[0].abs().max()) > 0.2:  # back to the middle of the lane, without touching the controller
            at = task.routes.at(task.route, task._arc.unsqueeze(1))[:, 0].double()
            rates = [to_torch(getattr(task.simulation.state, name)) for name in ("body_v", "body_omega")]
            before = [rate.clone() for rate in rates]
            task.place_vehicle(every, torch.nn.functional.pad(at[:, :2], (0, 1)), at[:, 2])
            for rate, value in zip(rates, before, strict=True):
                rate.copy_(value)
        speeds.append(task.motion()[:, 0].clone())
    assert torch.stack(speeds[40:]).mean() == pytest.approx(task.config.speed, abs=0.03)


@pytest.mark.parametrize("name", ["obstacle-avoidance", "off-road"])
def test_actions_reach_their_end_in_the_rise_time(name):
    task = driving(name, 1, action_rise_time=(0.5, 1.0))
    steering, pedal = [], []
    for _ in range(12):
        task.step(held(task, 1.0, -1.0))
        steering.append(float(task.action[0, 0]))
        pedal.append(float(task.action[0, 1]))
    period = task.config.control_dt
    assert steering[:4] == pytest.approx([(step + 1) * period / 0.5 for step in range(4)], abs=1e-4)
    assert pedal[:9] == pytest.approx([-(step + 1) * period for step in range(9)], abs=1e-4)
    assert (steering[-1], pedal[-1]) == (1.0, -1.0)


def test_obstacles_are_as_large_as_asked_for():
    usual, large = (driving("off-road", 4, seed=3, obstacles=6, obstacle_scale=scale) for scale in (1.0, 2.5))
    there = large.obstacles.radius >= 0.0
    assert there.any()
    # the sizes that contact works with, of the same draws
    sizes = [to_torch(task.simulation.model.shape_size)[:, task.obstacles.shapes] for task in (usual, large)]
    assert (sizes[1] / sizes[0]).numpy() == pytest.approx(np.full(sizes[0].shape, 2.5), rel=1e-5)
    assert (large.obstacles.radius / usual.obstacles.radius)[there].tolist() == pytest.approx(
        [2.5] * int(there.sum()), rel=1e-5
    )


def test_obstacles_that_find_no_room_are_not_counted():
    task = driving("off-road", 8, half=10.0, radius=16.0, border=60.0, clearance=15.0, goal_radius=5.0)
    enabled = to_torch(task.simulation.model.shape_enabled)[:, task.obstacles.shapes].sum(dim=1)
    assert enabled.min() < 30
    assert task.metrics()["obstacles_present"].tolist() == enabled.tolist()


def test_ground_textures_differ_between_worlds_and_episodes():
    task = driving("off-road", 24, **SMALL | {"obstacles": 0})
    shown = to_torch(task.scene().texture)[:, task._ground]
    first = shown.clone()
    assert len(set(first.tolist())) == len(GROUND_TEXTURES)
    task.restart()
    assert (shown != first).any()


def test_what_a_task_writes_itself_is_not_drawn():
    for name in ("shape_x", "joint_friction"):
        with pytest.raises(InputError, match=f"randomise '{name}': task 'off-road' writes it itself; leave it away"):
            driving("off-road", randomise={name: Range(0.5, 1.5)})


def test_a_curriculum_brings_obstacles_first_and_hills_after():
    curriculum = Curriculum(driver=Driver.PROGRESS)
    task = driving("off-road", 4, hills=1.0, obstacles=20, curriculum=curriculum)
    task.on_iteration(0)
    for level, count, rise in ((0.0, 0, 0.0), (0.25, 10, 0.0), (0.5, 20, 0.0), (0.75, 20, 1.5), (1.0, 20, 3.0)):
        task.level.fill_(level)
        task.restart()
        _, there = obstacle_corners(task)
        assert (there.sum(dim=1) - count).abs().max() <= 1
        scale = task.vehicle.tires.terrain.scale.numpy()[:, 2]
        assert scale == pytest.approx(max(rise, 1e-3))


def test_a_level_that_changes_leaves_running_episodes_alone():
    curriculum = Curriculum(driver=Driver.PROGRESS)
    task = driving("off-road", 2, obstacles=20, curriculum=curriculum)
    before = task.obstacles.radius.clone()
    task.level.fill_(0.0)
    task.step(held(task))
    assert torch.equal(task.obstacles.radius, before)


def test_tracks_of_other_numbers_are_other_tracks():
    first, second = driving("hallway", 1), driving("hallway", 1, first_track=1)
    several = driving("hallway", 8, tracks=2)
    assert float(first.routes.length[0]) != float(second.routes.length[0])
    assert several.routes.length.tolist() == [float(first.routes.length[0]), float(second.routes.length[0])]


def test_less_friction_brakes_less():
    ways = []
    for friction in (0.9, 0.2):
        task = driving("off-road", 1, obstacles=0, friction=friction)
        for _ in range(25):
            task.step(held(task, 0.0, 1.0))
        speed = float(task.motion()[0, 0])
        for _ in range(8):
            task.step(held(task, 0.0, -1.0))
        ways.append(speed - float(task.motion()[0, 0]))
    assert ways[1] < 0.5 * ways[0]


# ---- Gymnasium -------------------------------------------------------------------------------------------------

VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "state": ("obstacle-avoidance", {"obs": "state"}),
    "camera": ("barrier-track", SMALL | {"tracks": 2}),  # sixteen take seconds to build
}


@pytest.fixture(params=VARIANTS)
def variant(request, monkeypatch):
    """The rules' environments get the options of a variant; the name of its task."""
    name, options = VARIANTS[request.param]
    monkeypatch.setattr(gym, "make", functools.partial(gym.make, **options))
    monkeypatch.setattr(gym, "make_vec", functools.partial(gym.make_vec, **options))
    return name


strict = rules.strict


@pytest.mark.quick("state")
def test_gymnasium_checks_a_single_world(variant):
    rules.test_the_single_world_passes_the_checker(variant)
    rules.test_the_single_world_passes_the_passive_checker_and_the_order_of_calls(variant)


@pytest.mark.quick("state")
def test_spaces_and_steps_of_a_vector(variant):
    assert isinstance(rules.vector(variant), gym.vector.VectorEnv)
    rules.test_spaces_and_metadata_of_a_vector(variant)
    rules.test_steps_of_a_vector(variant)


@pytest.mark.quick("state")
def test_a_vector_is_deterministic(variant):
    actions = [env_actions.sample() for env_actions in [rules.vector(variant).action_space] for _ in range(8)]
    env, other = rules.vector(variant, max_episode_steps=3), rules.vector(variant, max_episode_steps=3)
    first = rules.trajectory(env, 3, actions)
    assert rules.data_equivalence(first, rules.trajectory(other, 3, actions), exact=True)
    assert rules.data_equivalence(first, rules.trajectory(env, 3, actions), exact=True)
    assert not rules.data_equivalence(first, rules.trajectory(env, 4, actions))


def test_an_image_is_bytes_in_its_space():
    env = TaskVectorEnv("convoy", 2, **SMALL)
    assert isinstance(env.single_observation_space, gym.spaces.Dict)
    space = env.single_observation_space["camera"]
    assert isinstance(space, gym.spaces.Box)
    assert (space.shape, space.dtype, space.low.min(), space.high.max()) == ((36, 40, 3), "uint8", 0, 255)


def test_the_first_world_of_a_vector_is_the_single_one(monkeypatch):
    monkeypatch.setattr(gym, "make", functools.partial(gym.make, obs="state"))
    monkeypatch.setattr(gym, "make_vec", functools.partial(gym.make_vec, obs="state"))
    assert len(rules.vector("obstacle-avoidance").single_observation_space.shape) == 1  # no camera
    rules.test_the_first_world_of_a_vector_is_the_single_one("obstacle-avoidance")


def test_images_are_kept_apart_from_what_the_simulation_overwrites():
    env = TaskVectorEnv("obstacle-avoidance", 2, **SMALL)
    first, _ = env.reset(seed=0)
    kept = first["camera"].copy()
    for action in random_actions(env.task, 3).numpy():
        env.step(abs(action))
    assert (first["camera"] == kept).all()


def test_another_vehicle_brings_its_own_measures():
    """An ARTcar of 0.6 m drove in the collision box of a truck of 4.6 m, without a word."""

    class Small(OffRoadTask):
        vehicle_name = full_name = "artcar"

    with pytest.raises(InputError, match="got no chassis_half, chassis_place, camera_place; write") as found:
        Small(OffRoadConfig(), 1)
    assert "\n" not in str(found.value)


def test_a_setup_without_its_parents_is_named():
    class Forgetful(OffRoadTask):
        def setup(self):
            self.mine = torch.zeros(self.num_worlds, device=self.device)

    with pytest.raises(TaskError, match=r"task 'Forgetful': its setup\(\) must call super\(\).setup\(\) first"):
        Forgetful(OffRoadConfig(), 1)


@pytest.mark.parametrize("name", NAMES)
def test_by_camera_a_policy_begins_by_driving(name):
    """Who holds the brake learns nothing: the reward is for the way. A student has a teacher, and begins as drawn."""
    task = task_class(name)
    mean = default_config(task).network.init_mean
    assert mean[0] == 0.0  # straight ahead
    assert len(mean) == (1 if name == "hallway" else 2)  # it works its pedals itself
    assert all(pedal > 0.0 for pedal in mean[1:])
    assert student_config(task).network.init_mean == ()


class OwnDrive(DrivingTask):
    """A task of one's own, which says nothing of its training."""


class OwnSteering(OwnDrive):
    """One that steers alone."""

    action_size = 1


class OwnTraining(OwnSteering):
    """One that says how it is trained."""

    action_size = 1
    training_by_obs: ClassVar[dict[str, Any]] = {"camera": {"network.init_mean": (0.2,)}}


@pytest.mark.parametrize(
    ("task", "mean"),
    [(DrivingTask, (0.0, 0.3)), (OwnDrive, (0.0, 0.3)), (OwnSteering, (0.0,)), (OwnTraining, (0.2,))],
)
def test_a_task_of_ones_own_begins_by_driving_too(task, mean):
    assert default_config(task, DrivingConfig()).network.init_mean == mean
    assert default_config(task, DrivingConfig(obs=Observing.STATE)).network.init_mean == ()
    assert student_config(task, DrivingConfig()).network.init_mean == ()
