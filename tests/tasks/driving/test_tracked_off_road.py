"""Off-road on tracks: starts, low rocks, high obstacles, soil, laws of worlds, settings, and shoes for belts."""

import json
import math

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env

from simwarp.core.interop import to_torch
from simwarp.tasks import InputError, make
from simwarp.tasks.driving.tracked_off_road import ROCK_HEIGHTS, ROOM
from simwarp.train.networks.policies import SHIPPED, network_policy
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.vehicle import BeltParameter
from tests.tasks.driving.driving_checks import SMALL, chase, copied, driving, held, random_actions, reason

NAME = "tracked-off-road"
SHOES = {"full": True, "dt": 0.001, "decimation": 200}
BARE = {"hills": 0.0, "obstacles": 0, "low_rocks": 0}


def tracked(worlds=2, **options):
    return driving(NAME, worlds, **{"obstacles": 4, "low_rocks": 60, **options})


@pytest.fixture(scope="module")
def rough():
    return tracked(4, seed=3)


def policy_rows(task, actions):
    return torch.stack([task.step(action).observations["policy"].clone() for action in actions])


def test_it_starts_at_rest_on_its_belts_and_stays_there(rough):
    rough.restart()
    place = rough.pose()[0].clone()
    weight = 9.81 * float(rough.simulation.model.body_mass.numpy()[0].sum())
    for _ in range(5):
        rough.step(held(rough, pedal=-1.0))
        assert not rough.hit.any()
    # on slopes of some degrees, whose cosine is above 0.97; it swings on its springs
    load = np.linalg.norm(rough.vehicle.belts.force.numpy().sum(axis=1), axis=1)
    np.testing.assert_allclose(load, weight, rtol=0.1)
    # tilted about its front end onto a plane, the rear is off curved ground by decimetres at most
    assert (rough.pose()[0] - place).norm(dim=1).max() < 0.5


def test_low_rocks_are_part_of_the_ground_and_leave_the_starts_free(rough):
    bare = tracked(1, low_rocks=0)
    config = rough.config
    rocks = [(with_ - without) * config.hill_height
             for with_, without in zip(rough.hills.fields, bare.hills.fields, strict=True)]  # fmt: skip
    at = np.linspace(-80.0, 80.0, rocks[0].shape[0])
    away = np.hypot(at[None], at[:, None])
    for field in rocks:
        assert field.min() > -1e-5  # float32 sums of numbers up to 2
        assert ROCK_HEIGHTS[0] < field.max() <= ROCK_HEIGHTS[1] + 1e-5
        # places keep off by ROOM; feet are 1.4 m wide
        assert np.abs(field[np.abs(away - config.radius) < ROOM - 1.5]).max() < 1e-5


def test_low_rocks_lift_it_and_are_no_collision():
    rocky, bare = (tracked(4, obstacles=0, low_rocks=count, seed=5) for count in (1200, 0))
    tilts = []
    for task in (rocky, bare):
        task.restart()
        seen = []
        for _ in range(40):
            task.step(chase(task, torch.zeros(4, 2), speed=3.0))
            assert not task.hit.any()
            seen.append(task.tilt().clone())
        tilts.append(torch.stack(seen).diff(dim=0).abs().mean())
    assert tilts[0] > 1.5 * tilts[1]


def test_a_high_obstacle_is_a_collision():
    task = tracked(1, hills=0.0, obstacles=1)
    task.restart()
    every, number = torch.ones(1, dtype=torch.bool), torch.zeros(1, 1)
    ahead = task.pose()[0][:, None, :2].float() * (1.0 - 8.0 / task.config.radius)
    kind = torch.zeros(1, 1, dtype=torch.int64)
    task.obstacles.fill(every, ahead, number, number, kind, number + 2.0, torch.ones(1, 1, dtype=torch.bool))
    for _ in range(40):
        result = task.step(held(task, pedal=1.0))
        if reason(task, result) is not None:
            break
    assert reason(task, result) == "collision"


def test_full_steering_turns_it_and_more_friction_turns_it_less():
    turned = []
    for friction in (0.5, 0.9):
        task = tracked(1, hills=0.0, obstacles=0, friction=friction)
        task.restart()
        for _ in range(20):
            task.step(held(task, pedal=1.0))
        start = task.pose()[1].clone()
        for _ in range(10):
            task.step(held(task, steering=1.0, pedal=1.0))
        turned.append(float((task.pose()[1] - start).remainder(2.0 * math.pi)))
    assert 0.5 < turned[0] < math.pi
    assert turned[1] < turned[0]


def tensioner_forces(task):
    """(W, 2) of the left and the right track."""
    belts, model = task.vehicle.belts, task.simulation.model
    if belts is not None:
        return belts.parameter.numpy()[..., BeltParameter.TENSIONER_FORCE].astype(float)
    places = [model.joint_dof_start[side.tensioner] for side in task.vehicle.parts.chains]
    return model.joint_preload.numpy()[:, places].astype(float)


@pytest.mark.parametrize("options", [{}, pytest.param(SHOES, marks=pytest.mark.slow)], ids=["belts", "shoes"])
def test_tension_is_drawn_for_each_world_and_episode(options):
    options = {**BARE, **options}
    built = tensioner_forces(tracked(1, **options))[0]
    assert (built != 0.0).all()
    task = tracked(4, seed=3, tension=(0.8, 1.2), **options)
    found = []
    for _ in range(2):
        task.restart()
        factor = tensioner_forces(task) / built
        # float32 of one factor and two forces
        np.testing.assert_allclose(factor[:, 0], factor[:, 1], rtol=1e-6)
        found.append(factor[:, 0])
    drawn = np.concatenate(found)
    assert ((drawn >= 0.8) & (drawn <= 1.2)).all()
    assert len(set(drawn)) == 8


def test_one_tension_is_that_of_all_worlds():
    task = tracked(2, tension=1.1, **BARE)
    task.restart()
    np.testing.assert_allclose(tensioner_forces(task), 1.1 * tensioner_forces(tracked(2, **BARE)), rtol=1e-6)


def test_tension_of_a_world_that_goes_on_stays():
    task = tracked(3, tension=(0.8, 1.2), **BARE)
    task.restart()
    before = tensioner_forces(task)
    task._reset_worlds(torch.tensor([False, True, False]))
    changed = (tensioner_forces(task) != before).all(axis=1)
    assert changed.tolist() == [False, True, False]


def test_soil_slows_it():
    speeds = []
    for soil in ("none", "soft"):
        task = tracked(1, hills=0.0, obstacles=0, soil=soil)
        task.restart()
        for _ in range(25):
            task.step(held(task, pedal=1.0))
        speeds.append(float(task.motion()[0, 0]))
    assert 0.3 < speeds[1] < 0.98 * speeds[0]


def test_the_seed_alone_decides_not_the_past(rough):
    actions = random_actions(rough, 6)
    rough.restart(seed=7)
    first = policy_rows(rough, actions)
    rough.restart(seed=7)
    assert torch.equal(policy_rows(rough, actions), first)


def test_worlds_do_not_depend_on_how_many_there_are_nor_on_each_other(rough):
    actions = random_actions(rough, 6)
    rough.restart(seed=7)
    all_rows = policy_rows(rough, actions)
    few = tracked(2, seed=7)
    few.restart(seed=7)
    assert torch.equal(policy_rows(few, actions[:, :2]), all_rows[:, :2])
    rough.restart(seed=7)
    actions[:, 1] = -1.0
    others = policy_rows(rough, actions)
    assert torch.equal(others[:, [0, 2, 3]], all_rows[:, [0, 2, 3]])
    assert not torch.equal(others[:, 1], all_rows[:, 1])


def test_a_saved_state_goes_on_exactly(rough):
    actions = random_actions(rough, 8)
    rough.restart(seed=2)
    policy_rows(rough, actions[:4])
    saved = rough.state_dict()
    rows = policy_rows(rough, actions[4:])
    rough.load_state_dict(saved)
    assert torch.equal(policy_rows(rough, actions[4:]), rows)


def test_by_camera_each_world_sees_its_own_ground():
    task = make(NAME, 2, seed=0, obstacles=4, low_rocks=60, **SMALL)
    seen = copied(task.restart())
    assert seen["camera"].shape == (2, 36, 40, 3)
    assert seen["policy"].shape == (2, 6)
    assert not torch.equal(seen["camera"][0], seen["camera"][1])
    after = task.step(held(task, pedal=1.0)).observations
    assert torch.isfinite(after["policy"]).all()


def test_gymnasium_checks_a_single_world():
    env = gym.make("simwarp/TrackedOffRoad-v0", obs="state", obstacles=2, low_rocks=20)
    check_env(env.unwrapped, skip_render_check=True)
    env.close()


@pytest.mark.parametrize(("options", "message"), [
    ({"low_rocks": -1}, "low-rocks"),
    ({"tension": (1.2, 0.8)}, "tension.*two in order"),
    ({"soil": "random"}, "soil.*one preset"),
    ({"variant": "thesis"}, "variant.*no tracks"),
    ({"tires": "rigid"}, "tires.*tracks have none"),
    ({"full": True}, "dt.*at most 0.001 with full"),
    ({**SHOES, "soil": "clay"}, "soil.*chains meet hard ground"),
])  # fmt: skip
def test_wrong_settings_are_named_in_a_line(options, message):
    with pytest.raises(InputError, match=message) as found:
        tracked(1, **options)
    assert "\n" not in str(found.value)


@pytest.mark.slow
def test_shoes_stand_on_the_same_ground():
    task = tracked(1, seed=3, **SHOES)
    task.restart()
    height = task.pose()[0][:, 2].clone()
    ground = task.hills.height(task.pose()[0][:, None, :2])[:, 0]
    assert task.vehicle.belts is None
    for _ in range(3):
        task.step(held(task, pedal=1.0))
        assert not task.hit.any()
    assert (task.pose()[0][:, 2] - height).abs().max() < 0.3
    assert ((height - ground - 0.62).abs() < 0.2).all()  # its point of reference is 0.62 m above level ground
    friction = to_torch(task.simulation.model.shape_friction)[:, task.hills.shape]
    assert friction.tolist() == pytest.approx([task.config.friction])


def test_provenance_says_what_the_policy_reached():
    record = json.loads((SHIPPED / f"{NAME}.state.json").read_text(encoding="utf-8"))
    assert record["command"][:3] == ["simwarp", "train", NAME]
    assert record["evaluation"]["policy"]["success_rate"] >= 0.9
    assert max(record["evaluation"][other]["success_rate"] for other in ("zero", "random")) < 0.02


@pytest.mark.slow
def test_the_shipped_policy_still_drives():
    content = load_checkpoint(SHIPPED / f"{NAME}.state.pt")
    task = make(NAME, 32, seed=11, obs="state")
    policy = network_policy(content, task)
    observations, arrived = task.restart(), torch.zeros(32, dtype=torch.bool)
    over = arrived.clone()
    for _ in range(task.config.max_episode_steps):
        result = task.step(policy(observations))
        observations = result.observations
        goal = result.end_reason == task.end_reasons.index("goal")
        arrived |= goal & ~over
        over |= result.end_reason >= 0
    # 94 % of 256 arrived; fewer than 26 of 32 do by chance once in a hundred
    assert int(arrived.sum()) >= 26
