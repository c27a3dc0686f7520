"""Variants of tasks: the same class, as the thesis has it; held to what it prints, and to slow references."""

import copy
import dataclasses
import math
import pickle
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from scipy import stats

from simwarp.cli.options import CommonOptions, option_names, task_options
from simwarp.core.interop import to_torch
from simwarp.tasks import (
    InputError,
    Variant,
    config_from_plain,
    config_to_plain,
    config_to_train_in,
    make,
    replace_fields,
    task_class,
    task_names,
)
from simwarp.tasks.adapters.gym_env import env_id
from simwarp.tasks.framework.registry import variant_names
from simwarp.train.config import default_config
from tests.tasks.driving.driving_checks import reason, term

SHIPPED = [name for name in task_names() if task_class(name).__module__.startswith("simwarp.tasks")]
VARIED = [name for name in SHIPPED if variant_names(name)]
DRIVING = ("convoy", "hallway", "obstacle-avoidance", "off-road")


@dataclasses.dataclass(frozen=True)
class Row:
    """What the thesis has of a task, and where it is silent, its code."""

    spaces: dict[str, tuple[tuple[int, ...], type]]
    actions: int
    period: float  # of the actions [s]
    time: float  # of an episode [s]
    terms: dict[str, float]
    ends: tuple[str, ...]


ROWS = {
    "obstacle-avoidance": Row(
        {"camera": ((45, 80, 3), np.uint8)}, 2, 0.099, 19.8, {"failure": 0.0, "progress": 100.0 / 3.0, "goal": 3000.0},
        ("goal", "collision", "off_road"),
    ),
    "hallway": Row(
        {"camera": ((90, 160, 3), np.uint8)}, 1, 0.1, 40.0, {"progress": 10.0, "lap": 0.0, "failure": -200.0},
        ("off_lane", "upset", "lap", "too_slow"),
    ),
    "convoy": Row(
        {"camera": ((45, 80, 3), np.uint8), "policy": ((5,), np.float32)}, 2, 0.2, 60.0,
        {"following": 100.0, "failure": -2000.0}, ("collision", "bumped", "lost", "upset", "goal"),
    ),
    "off-road": Row(
        {"camera": ((45, 80, 3), np.uint8), "policy": ((5,), np.float32)}, 2, 0.1, 20.0,
        {"progress": 10.0, "goal": 2500.0, "failure": -250.0, "timeout": -400.0},
        ("goal", "collision", "off_map", "upset", "timeout"),
    ),
    "ant": Row(
        {"policy": ((30,), np.float32)}, 8, 0.01, 100.0,
        {"progress": 1.0, "alive": 1.0, "energy": -0.2, "joint_pos_limits": -3.0}, ("torso_contact", "arena"),
    ),
    **dict.fromkeys(
        ("racer3-reach", "irb120-reach"),
        Row(
            {"policy": ((18,), np.float32)}, 6, 0.001, 2.0,
            {"near": 1.0, "contact": -1000.0, "fingers": -1.0, "energy": -0.001, "joint_pos_limits": -2.0},
            ("contact",),
        ),
    ),
}  # fmt: skip


def thesis(name, worlds=2, **changes):
    """A task in its variant; without a camera where only what is driven counts."""
    return make(name, worlds, variant="thesis", **changes)


def blind(name, worlds=2, **changes):
    return thesis(name, worlds, **({"obs": "state"} if name in DRIVING else {}), **changes)


def rolled(task, steps, seed=0, *, low=-1.0):
    """Results of random actions, each with what `look` saw before and after the step."""
    generator = torch.Generator().manual_seed(seed)
    shape = (steps, task.num_worlds, task.action_size)
    yield from low + (1.0 - low) * torch.rand(*shape, generator=generator)


# ---- what a variant is -----------------------------------------------------------------------------------------------


def test_the_table_has_every_task_that_has_a_variant():
    assert set(ROWS) == set(VARIED)
    for name in SHIPPED:
        kind = task_class(name).config_type
        assert variant_names(name) == [*kind.VARIANTS]
        # one that inherits the field and has no variants refuses all
        assert (hasattr(kind(), "variant") and len(kind.VARIANTS) > 0) == (name in VARIED)


@pytest.mark.parametrize("name", VARIED)
def test_the_default_is_as_it_was(name):
    config: Any = task_class(name).config_type()
    assert config.variant is Variant.SIMWARP
    assert "simwarp" not in config.VARIANTS
    plain = config_to_plain(config)
    del plain["variant"]  # of an older run
    assert config_from_plain(type(config), plain) == config


@pytest.mark.parametrize("name", VARIED)
def test_it_sets_the_fields_that_are_not_given(name):
    cls = task_class(name)
    kind: Any = cls.config_type
    whole = kind(variant="thesis")
    assert whole == kind(variant=Variant.THESIS) == replace_fields(kind(), {"variant": "thesis"})
    assert whole == config_from_plain(kind, config_to_plain(whole)) == config_from_plain(kind, {"variant": "thesis"})
    assert whole == config_to_train_in(cls, variant="thesis") == config_to_train_in(cls, student=True, variant="thesis")
    for key, value in kind.VARIANTS["thesis"].items():
        owner, _, field = key.rpartition(".")
        assert getattr(getattr(whole, owner) if owner else whole, field) == value
        assert getattr(getattr(kind(), owner) if owner else kind(), field) != value
    steps = whole.max_episode_steps + 1
    given = kind(variant="thesis", max_episode_steps=steps)
    assert given == replace_fields(kind(), {"variant": "thesis", "max_episode_steps": steps})
    assert given == dataclasses.replace(whole, max_episode_steps=steps)
    assert replace_fields(whole, {"variant": "simwarp"}) == kind()
    assert copy.deepcopy(whole) == pickle.loads(pickle.dumps(whole)) == whole
    assert vars(whole).keys() == vars(kind()).keys() == {field.name for field in dataclasses.fields(kind)}
    weight = next(iter(whole.reward_weights()))
    read = config_from_plain(kind, {"variant": "thesis", "rewards": {weight: 0.25}})
    assert read == replace_fields(whole, {f"rewards.{weight}": 0.25})


def test_what_is_no_variant_is_refused():
    with pytest.raises(InputError, match="variant must be one of simwarp, thesis, got 'chrono'"):
        make("ant", variant="chrono")
    with pytest.raises(InputError, match="no field 'variant'"):
        make("pendulum", variant="thesis")
    with pytest.raises(InputError, match="variant"):
        config_to_train_in(task_class("pendulum"), variant="thesis")


@pytest.mark.parametrize("name", VARIED)
def test_training_has_its_own_defaults(name):
    cls = task_class(name)
    kind: Any = cls.config_type
    seen = default_config(cls, kind(variant="thesis"))
    usual = default_config(cls)
    assert usual.ppo.reward_scale == 1.0
    kinds = {"obstacle-avoidance": "nature-cnn", "hallway": "nature-cnn", "convoy": "early-fusion",
             "off-road": "early-fusion"}  # fmt: skip
    assert seen.network.kind.value == kinds.get(name, "thesis-mlp")
    assert seen.network.critic.value == "same"
    if name in DRIVING:  # by state there is nothing to see
        assert default_config(cls, kind(variant="thesis", obs="state")).network.kind.value == "mlp"


@pytest.mark.parametrize("name", VARIED)
def test_what_a_variant_sets_is_an_option_that_a_page_names(name):
    kind: Any = task_class(name).config_type
    options = option_names(task_options("Options", CommonOptions, task=kind(variant="thesis")))
    page = Path(__file__).parents[2].joinpath("docs", "driving.md").read_text(encoding="utf-8")
    for key, value in kind.VARIANTS["thesis"].items():
        option = f"--task.{key.replace('_', '-')}"
        assert option in options
        if isinstance(value, bool):  # numbers stand in the table of the variant
            assert f"`{option}`" in page
    assert f"| `{name}`" in page.partition("## As in the thesis")[2] or f", `{name}`" in page


# ---- spaces, actions, time -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=VARIED)
def built(request):
    return request.param, thesis(request.param)


def test_spaces_terms_and_ends_are_those_of_the_table(built):
    name, task = built
    row, config = ROWS[name], task.config
    numpy = {torch.uint8: np.uint8, torch.float32: np.float32}
    spaces = {group: (shape, numpy[task.observation_dtypes[group]]) for group, shape in task.observation_shapes.items()}
    assert spaces == row.spaces
    assert task.action_size == row.actions
    assert config.control_dt == pytest.approx(row.period)
    assert config.control_dt * config.max_episode_steps == pytest.approx(row.time)
    weights = config.reward_weights()
    assert {term: weights[term] for term in task.reward_terms} == pytest.approx(row.terms)
    assert tuple(task.end_reasons) == ("non_finite", *row.ends, "time_limit")
    for group, names in task.observation_names.items():
        assert len(names) == task.observation_shapes[group][0]


@pytest.mark.parametrize("name", VARIED)
def test_it_has_a_gymnasium_id_of_its_own(name):
    identity = env_id(name, "thesis")
    assert identity == env_id(name).replace("-v0", "Thesis-v0")
    env: Any = gym.make(identity)
    assert env.unwrapped.task.config.variant is Variant.THESIS
    boxes = getattr(env.observation_space, "spaces", {"policy": env.observation_space})
    assert {group: (box.shape, box.dtype.type) for group, box in boxes.items()} == ROWS[name].spaces
    assert env.action_space.shape == (ROWS[name].actions,)
    check_env(env.unwrapped, skip_render_check=True)
    vector = gym.make_vec(identity, num_envs=2)
    assert vector.single_observation_space == env.observation_space
    usual: Any = gym.make(env_id(name))
    assert usual.unwrapped.task.config.variant is Variant.SIMWARP


# ---- worlds and starts -----------------------------------------------------------------------------------------------


def uniform(values, low, high):
    """Whether numbers are uniform between two: the test of Kolmogorov and Smirnov, at one in ten thousand."""
    return stats.kstest(np.asarray(values, dtype=float).ravel(), stats.uniform(low, high - low).cdf).pvalue > 1e-4


def test_three_pillars_stand_anywhere_across_the_road():
    task = blind("obstacle-avoidance", 64)
    pillars = to_torch(task.simulation.model.shape_x)[:, task.pillars]
    assert pillars.shape == (64, 3, 3)
    assert torch.equal(pillars[0, :, 0], torch.tensor([25.0, 50.0, 75.0]).double())
    assert uniform(pillars[..., 1], -5.0, 5.0)
    place, heading = task.pose()
    assert place[:, :2].abs().max() < 5e-3  # as it settled
    assert heading.abs().max() < 1e-3


def test_off_road_starts_head_anywhere_and_goals_lie_opposite():
    task = blind("off-road", 64)
    place, heading = task.pose()
    angle = torch.atan2(place[:, 1], place[:, 0])
    assert torch.allclose(place[:, :2].norm(dim=1), torch.tensor(40.0).double(), atol=1e-3)
    assert uniform(angle, -math.pi, math.pi)
    assert uniform(heading, -math.pi, math.pi)
    away = torch.atan2(torch.sin(heading - angle), torch.cos(heading - angle))
    assert uniform(away, -math.pi, math.pi)  # not towards the middle
    assert torch.allclose(task.goal.norm(dim=1), torch.tensor(40.0).double(), atol=1e-3)
    turn = torch.atan2(task.goal[:, 1], task.goal[:, 0]) - angle - math.pi
    assert uniform(torch.atan2(turn.sin(), turn.cos()), -0.5 * math.pi, 0.5 * math.pi)
    assert task.obstacles.radius.shape[1] == 30
    ways = task.obstacles.place
    assert ways.abs()[task.obstacles.radius >= 0.0].max() <= 40.0
    usual: Any = make("off-road", 64, obs="state")
    place, heading = usual.pose()
    back = torch.atan2(-place[:, 1], -place[:, 0]).float() - heading
    assert torch.atan2(back.sin(), back.cos()).abs().max() < 1e-3


def test_sixteen_paths_pass_eight_obstacles():
    task = blind("convoy", 64)
    assert len(task.routes.length) == 16
    assert task.obstacles.radius.shape[1] == 8
    assert uniform(task._begun, 0.05, 0.55)


def test_the_hallway_begins_in_turns_between_cones_of_the_printed_colours():
    task = blind("hallway", 8)
    track = task.tracks[0]
    arc = task._arc.numpy()
    curvature = np.interp(arc, track.arc, np.abs(track.curvature))
    assert (curvature > 0.0).all()
    usual: Any = make("hallway", 1, obs="state")
    for each, first in ((task, "red"), (usual, "green")):
        mesh = each.course_mesh(track, 0)
        colours, points = mesh.color.mean(axis=1), mesh.vertices[mesh.triangles].mean(axis=1)
        strong = {
            "red": (colours[:, 0] > 3.0 * colours[:, 1]) & (colours[:, 0] > 3.0 * colours[:, 2]),
            "green": (colours[:, 1] > 1.5 * colours[:, 0]) & (colours[:, 1] > 1.5 * colours[:, 2]),
        }
        left = {colour: side_of(track, points[chosen, :2], 0.7) for colour, chosen in strong.items()}
        second = "green" if first == "red" else "red"
        assert left[first] > 0.9
        assert left[second] < 0.1


def side_of(track, points, near):
    """Share of the points near a lane that lie to the left of its middle."""
    away = points[:, None] - track.points[None]
    nearest = np.linalg.norm(away, axis=2).argmin(axis=1)
    away = away[np.arange(len(points)), nearest]
    heading = track.heading[nearest]
    aside = np.cos(heading) * away[:, 1] - np.sin(heading) * away[:, 0]
    close = np.abs(aside) < near
    return float((aside[close] > 0.0).mean())


@pytest.mark.parametrize("name", ["ant", "racer3-reach"])
def test_robots_start_in_the_pose_they_are_built_in(name):
    task = thesis(name, 16)
    assert task.views.joint_q[:, -task.action_size :].abs().max() < 1e-6
    assert task.views.joint_qd.abs().max() < 1e-6
    if name == "racer3-reach":
        x, y = task._target[:, 0] + 0.52, task._target[:, 1]
        assert uniform(x, -0.05, 0.05)
        assert uniform(y, -0.05, 0.05)
        still = thesis(name, 16, fixed_target=True)
        assert torch.allclose(still._target, torch.tensor([-0.52, 0.0, 0.015]).double(), atol=1e-9)


# ---- rewards and ends, against references in NumPy -------------------------------------------------------------------


def test_obstacle_avoidance_is_paid_by_progress_and_the_end():
    task = blind("obstacle-avoidance", 4)
    way = lambda: np.hypot(100.0 - task.pose()[0][:, 0].numpy(), task.pose()[0][:, 1].numpy())  # noqa: E731
    for action in rolled(task, 12, low=0.5):
        before = way()
        result = task.step(action)
        running = ~result.terminated.numpy()
        expected = 0.1 * (before - way()) / 0.003
        assert np.allclose(term(task, result, "progress").numpy()[running], expected[running], rtol=1e-5, atol=1e-4)
        assert not term(task, result, "failure").any()
    to_torch(task.simulation.model.shape_x)[:, task.pillars, 1] = 7.0
    task.place_vehicle(torch.ones(4, dtype=torch.bool), torch.tensor([[99.9, 0.0, 0.0]]).expand(4, 3), torch.zeros(4))
    for _ in range(40):
        result = task.step(torch.tensor([[0.0, 1.0]]).expand(4, 2))
        if result.terminated.all():
            break
    assert {reason(task, result, world) for world in range(4)} == {"goal"}
    assert term(task, result, "goal").tolist() == [3000.0] * 4


def test_the_second_action_of_obstacle_avoidance_is_throttle_alone():
    task = blind("obstacle-avoidance", 3)
    for _ in range(8):
        task.step(torch.tensor([[0.0, -1.0], [0.0, 0.0], [0.0, 1.0]]))
    assert torch.allclose(task.input[:, 1], torch.tensor([0.0, 0.5, 1.0]))
    assert not task.input[:, 2].any()
    assert task.motion()[0, 0] < task.motion()[1, 0] < task.motion()[2, 0]
    usual: Any = make("obstacle-avoidance", 1, obs="state")
    for _ in range(8):
        usual.step(torch.tensor([[0.0, -1.0]]))
    assert usual.input[0, 1:3].tolist() == [0.0, 1.0]


def along(track, points):
    """Length along a closed track of the nearest place of its middle, of all its segments [m]."""
    start, side = track.points[:-1], np.diff(track.points, axis=0)
    found = []
    for point in points:
        share = np.clip(((point - start) * side).sum(axis=1) / (side * side).sum(axis=1), 0.0, 1.0)
        nearest = np.linalg.norm(start + share[:, None] * side - point, axis=1).argmin()
        found.append(track.arc[nearest] + share[nearest] * np.linalg.norm(side[nearest]))
    return np.array(found)


def test_the_hallway_is_paid_by_the_way_along_the_lane():
    task = blind("hallway", 2)
    track = task.tracks[0]
    place = lambda: task.pose()[0][:, :2].numpy().copy()  # noqa: E731
    total = np.zeros(2)
    begun, moved = place(), np.zeros(2)
    for action in rolled(task, 20):
        begun = place()
        result = task.step(0.3 * action)
        assert not result.terminated.any()
        gain = along(track, place()) - along(track, begun)
        gain -= np.round(gain / track.length) * track.length
        moved += 10.0 * gain
        total += term(task, result, "progress").numpy()
    assert np.allclose(total, moved, rtol=2e-2, atol=0.05)  # its table has nodes 6 cm apart
    assert total.min() > 1.0


def test_a_convoy_is_paid_in_the_cone_behind_its_leader():
    task = blind("convoy", 16, latest_start=0.8)
    seen = 0
    for action in rolled(task, 25):
        result = task.step(action)
        leader = task.leaders(task.time())[:, 0].double().numpy()
        place, running = task.pose()[0].numpy(), ~(result.terminated | result.truncated).numpy()
        away = leader[:, :2] - place[:, :2]
        c, s = np.cos(leader[:, 2]), np.sin(leader[:, 2])
        x, y = c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]
        # the follower's bearing from the leader, whose forward axis is Y there: [5/4 pi, 7/4 pi] is behind it
        bearing = np.mod(np.arctan2(-x, y), 2.0 * math.pi)
        inside = (bearing >= 1.25 * math.pi) & (bearing <= 1.75 * math.pi)
        expected = np.where(inside, 20.0 / (np.maximum(np.hypot(x, y) - 16.0, 0.0) + 0.2), 0.0)
        given = term(task, result, "following").numpy()
        assert np.allclose(given[running], expected[running], rtol=2e-3, atol=1e-3)
        failed = result.terminated.numpy() & (term(task, result, "failure").numpy() != 0.0)
        assert (term(task, result, "failure").numpy()[failed] == -2000.0).all()
        seen += int(running.sum())
    assert seen > 100


def test_off_road_is_paid_by_progress_and_every_end_has_its_price():
    task = blind("off-road", 4, obstacles=0, max_episode_steps=12)
    way = lambda: np.linalg.norm(task.goal.numpy() - task.pose()[0][:, :2].numpy(), axis=1)  # noqa: E731
    for step, action in enumerate(rolled(task, 12, low=0.2)):
        before = way()
        result = task.step(action)
        if step < 11:
            expected = (before - way()) / 0.1
            assert np.allclose(term(task, result, "progress").numpy(), expected, rtol=1e-4, atol=1e-3)
            assert not result.terminated.any()
            assert not term(task, result, "timeout").any()
    assert [reason(task, result, world) for world in range(4)] == ["timeout"] * 4
    assert result.terminated.all()
    assert term(task, result, "timeout").tolist() == [-400.0] * 4
    every, level = torch.ones(4, dtype=torch.bool), torch.zeros(4, 3)
    task.place_vehicle(every, torch.cat([task.goal.float(), level[:, :1]], dim=1), torch.zeros(4))
    result = task.step(torch.zeros(4, 2))
    assert [reason(task, result, world) for world in range(4)] == ["goal"] * 4
    assert term(task, result, "goal").tolist() == [2500.0] * 4
    task.place_vehicle(every, torch.tensor([[61.0, 0.0, 0.0]]).expand(4, 3), torch.zeros(4))
    result = task.step(torch.zeros(4, 2))
    assert [reason(task, result, world) for world in range(4)] == ["off_map"] * 4
    assert term(task, result, "failure").tolist() == [-250.0] * 4


def test_off_road_observes_five_numbers_in_plain_units():
    task = thesis("off-road", 3, camera_width=40, camera_height=36, obstacles=1)
    for _ in range(3):
        seen = task.step(torch.tensor([[0.5, 1.0]]).expand(3, 2)).observations["policy"]
    place, heading = task.pose()
    away = (task.goal - place[:, :2]).numpy()
    c, s = np.cos(heading.numpy()), np.sin(heading.numpy())
    ahead, left = c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]
    expected = np.stack([ahead, left, np.arctan2(left, ahead), heading.numpy(), task.motion()[:, 0].numpy()], axis=1)
    # within five deviations of the receiver, 0.1 m and 0.05 m/s, and of the gyroscope's heading
    assert (np.abs(seen.numpy() - expected) < [0.7, 0.7, 0.03, 0.02, 0.3]).all()


def test_a_convoy_observes_five_numbers_in_plain_units():
    task = thesis("convoy", 3, camera_width=40, camera_height=36)
    for _ in range(3):
        seen = task.step(torch.tensor([[0.0, 1.0]]).expand(3, 2)).observations["policy"]
    place, heading = task.pose()
    leader = task.leaders(task.time())[:, 0]
    ahead = task.leaders(task.time() + 0.005)[:, 0]
    speed = (ahead - leader)[:, :2].norm(dim=1) / 0.005
    expected = torch.cat([
        leader[:, :2] - place[:, :2].float(), heading[:, None], task.motion()[:, :1], speed[:, None],
    ], dim=1)  # fmt: skip
    assert ((seen - expected).abs() < torch.tensor([0.6, 0.6, 0.02, 0.3, 0.05])).all()


def test_the_ant_is_paid_by_equation_8_1():
    task = thesis("ant", 4)
    limits = np.array([[-math.pi / 3.0, math.pi / 3.0]] * 4 + [[-math.pi / 2.0, math.pi / 4.0]] * 4)
    touched_limits = 0.0
    for action in rolled(task, 120, low=0.4):
        before = task.views.body_q[:, 0, :2].double().numpy().copy()
        result = task.step(action)
        after, running = task.views.body_q[:, 0, :2].double().numpy(), ~result.terminated.numpy()
        speed = (np.hypot(1000.0 - before[:, 0], before[:, 1]) - np.hypot(1000.0 - after[:, 0], after[:, 1])) / 0.01
        q, qd = (values[:, -8:].double().numpy() for values in (task.views.joint_q, task.views.joint_qd))
        power = -0.2 * (30.0 * task.action.double().numpy() * qd).sum(axis=1)
        share = np.abs((2.0 * q - limits.sum(axis=1)) / (limits[:, 1] - limits[:, 0]))
        ends = -3.0 * (share > 0.98).sum(axis=1)
        expected = {"progress": speed, "alive": np.ones(4), "energy": power, "joint_pos_limits": ends}
        for name, value in expected.items():
            given = term(task, result, name).numpy()
            assert np.allclose(given[running], value[running], rtol=2e-3, atol=2e-2), name
        touched_limits += float(ends.sum())
        assert torch.equal(term(task, result, "alive"), 1.0 - 2.0 * result.terminated.float())
    assert touched_limits < 0.0


def test_the_arm_is_paid_by_equation_9_1():
    task = thesis("racer3-reach", 4)
    ranges = [joint.limit for joint in task.arm.joints]
    for action in rolled(task, 40):
        result = task.step(action)
        seen = result.observations["policy"].double().numpy()
        q, rate, target, grip = seen[:, :6], seen[:, 6:12], seen[:, 12:15], seen[:, 15:]
        distance = np.linalg.norm(target - grip, axis=1)
        stops = np.array(
            [abs(2.0 * q[:, k] - low - high) / (high - low) > 0.98 for k, (low, high) in enumerate(ranges)]
        )
        expected = {
            "near": 1.0 / (distance + 1e-4),
            "energy": -0.001 * np.linalg.norm(task.action.double().numpy() * rate, axis=1),
            "joint_pos_limits": -2.0 * stops.sum(axis=0),
            "contact": np.zeros(4),
            "fingers": np.zeros(4),
        }
        for name, value in expected.items():
            assert np.allclose(term(task, result, name).numpy(), value, rtol=1e-4, atol=1e-5), name
