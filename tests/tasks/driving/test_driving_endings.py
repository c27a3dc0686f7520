"""Driving tasks: every reason to end an episode comes about when it should, and none of the others with it; what is
paid at the end and on the way.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from simwarp.core.interop import to_torch
from simwarp.tasks.driving.convoy import ConvoyRewards
from simwarp.tasks.driving.convoy_kernels import DURATION
from simwarp.tasks.driving.driving_config import Observing
from simwarp.tasks.driving.off_road import OffRoadConfig, OffRoadRewards, OffRoadTask
from tests.tasks.driving.driving_checks import NAMES, chase, drive, driving, held, random_actions, reason, term


def every(task):
    return torch.ones(task.num_worlds, dtype=torch.bool)


def ahead(task, pedal=1.0):
    return lambda task: held(task, 0.0, pedal)


def block(task, away=4.0):
    """Move an obstacle into the way of the vehicle: its middle this far ahead [m]."""
    point, heading = task.pose()
    place = to_torch(task.simulation.model.shape_x)[:, task.obstacles.shapes[0]]
    to_torch(task.simulation.model.shape_enabled)[:, task.obstacles.shapes[0]] = 1
    place[:, 0], place[:, 1] = point[:, 0] + away * heading.cos(), point[:, 1] + away * heading.sin()
    place[:, 2] = point[:, 2] - 0.5


def tip(task):
    """Lay the vehicle on its side, where it is, above the ground."""
    point, heading = task.pose()
    normal = torch.tensor([0.0, 0.995, 0.1], dtype=torch.float64).expand(task.num_worlds, -1)
    task.place_vehicle(every(task), point + torch.tensor([0.0, 0.0, 2.0]), heading, normal / 0.99999)


def near_the_end(task):
    """The last 5 % of the path are left to the nearest leader."""
    task._begun.fill_(0.95)
    task.start(every(task))


def follow_lane(speed):
    def policy(task):
        _, _, points = task.lane()
        turn = torch.atan2(points[:, 1, 1], points[:, 1, 0])
        return held(task, (2.5 * turn).clamp(-1.0, 1.0), (speed - task.motion()[:, 0]).clamp(-1.0, 1.0))

    return policy


def leader_speed(task):
    """(W,) of the leaders, which speed up evenly [m/s]."""
    return 2.0 * task.time() / DURATION**2 * task.routes.length[task.route]


def follow_leader(task):
    """Where the leader has been: along the path, at its speed or a little faster."""
    point, _ = task.pose()
    arc, _ = task.routes.locate(task.route, point[:, :2])
    aim = task.routes.at(task.route, (arc + 5.0).unsqueeze(1))[:, 0, :2]
    distance = task.metrics()["distance"]
    return chase(task, aim, speed=leader_speed(task) + 0.5 * (distance - 14.0), gain=2.0)


def outwards(task):
    return chase(task, 3.0 * task.pose()[0][:, :2], speed=15.0)


CASES = {
    # task, options, what is done to it, policy, steps, failure is paid for (None: there is no such term), success
    "obstacle-avoidance goal": ("obstacle-avoidance", {"spread": 0.0, "end": 60.0}, None,
                                lambda t: chase(t, torch.tensor([[float(t.pose()[0][0, 0]) + 12.0, 4.0]]), speed=12.0)),
    "obstacle-avoidance collision": ("obstacle-avoidance", {"spread": 0.0}, None, ahead),
    "obstacle-avoidance off_road": ("obstacle-avoidance", {}, None, lambda t: held(t, 0.5, 1.0)),
    "obstacle-avoidance off_road_upset": ("obstacle-avoidance", {}, tip, ahead),
    "obstacle-avoidance time_limit": ("obstacle-avoidance", {"max_episode_steps": 20}, None,
                                      lambda t: held(t, 0.0, -1.0)),
    "off-road goal": ("off-road", {"obstacles": 0}, None, lambda t: chase(t, t.goal, speed=8.0)),
    "off-road collision": ("off-road", {}, block, ahead),
    "off-road off_map": ("off-road", {"border": 43.0}, None, outwards),
    "off-road upset": ("off-road", {}, tip, ahead),
    "off-road time_limit": ("off-road", {"max_episode_steps": 20}, None, lambda t: held(t, 0.0, -1.0)),
    "convoy goal": ("convoy", {}, near_the_end, follow_leader),
    "convoy collision": ("convoy", {}, lambda t: block(t, 6.0), ahead),
    "convoy bumped": ("convoy", {}, None, lambda t: chase(t, t.leaders(t.time())[:, 0, :2], speed=9.0)),
    "convoy lost": ("convoy", {"lost_distance": 22.5}, None, lambda t: held(t, 0.0, -1.0)),
    "convoy upset": ("convoy", {}, tip, ahead),
    "convoy time_limit": ("convoy", {"max_episode_steps": 10}, None, lambda t: held(t, 0.0, -1.0)),
    "hallway off_lane": ("hallway", {}, None, lambda t: held(t, 1.0)),
    "hallway upset": ("hallway", {}, tip, held),
    "hallway too_slow": ("hallway", {"pedals": True, "speed": 40.0}, None, lambda t: held(t, 0.0, -1.0)),
    "hallway time_limit": ("hallway", {"max_episode_steps": 3}, None, held),
    "barrier-track collision": ("barrier-track", {}, None, lambda t: held(t, 0.0, 1.0)),
    "barrier-track upset": ("barrier-track", {}, tip, held),
    "barrier-track too_slow": ("barrier-track", {"speed": 100.0}, None, lambda t: held(t, 0.0, -1.0)),
    "barrier-track time_limit": ("barrier-track", {"max_episode_steps": 3}, None, held),
}  # fmt: skip


def finish(name, options, prepare, policy, steps=400):
    task = driving(name, 1, seed=7, **options)
    if prepare is not None:
        prepare(task)
    if policy is ahead:
        policy = ahead(task)
    results, why = drive(task, policy, steps)
    return task, results, why


REPEATED = {f"{name} {end}" for name in ("off-road", "convoy", "barrier-track") for end in ("upset", "time_limit")}
"""Ends that all tasks have from the same code: those of two tasks stand for them."""


@pytest.mark.long("barrier-track too_slow", "convoy goal", "convoy lost", "off-road goal", "off-road off_map")
@pytest.mark.parametrize("case", [pytest.param(case, marks=[pytest.mark.slow] * (case in REPEATED)) for case in CASES])
def test_episodes_end_for_the_reason_that_is_played(case):
    expected = case.split()[1].removesuffix("_upset")
    task, results, why = finish(*CASES[case])
    assert why == expected
    last = results[-1]
    won = expected in task.success_reasons
    assert bool(last.success[0]) == won
    truncated = expected in ("time_limit", "too_slow")
    assert (bool(last.terminated[0]), bool(last.truncated[0])) == (not truncated, truncated)
    summary = task.drain_statistics()
    assert {name for name, count in summary.end_reasons.items() if count} == {expected}
    if "failure" in task.reward_terms:
        failures = torch.cat([term(task, result, "failure") for result in results])
        paid = 0.0 if won or truncated else task.config.rewards.failure
        assert failures.tolist() == [0.0] * (len(failures) - 1) + [paid]
    for prize in {"goal", "lap"} & set(task.reward_terms):
        prizes = torch.cat([term(task, result, prize) for result in results])
        assert prizes.tolist() == [0.0] * (len(prizes) - 1) + [task.config.reward_weights()[prize] * won]


@pytest.mark.parametrize("name", ["hallway", "barrier-track"])
def test_a_lap_ends_where_it_began(name):
    """The last part of one; whole ones are driven in a slow test."""
    speed = 1.5 if name == "hallway" else 8.0
    task = driving(name, 1, seed=7, speed=speed)
    left = 2.0 if name == "hallway" else 10.0
    task.progress += task.routes.length[task.route] - left
    results, why = drive(task, follow_lane(speed), 100)
    assert why == "lap"
    assert bool(results[-1].success[0])
    assert float(term(task, results[-1], "lap")) == task.config.rewards.lap
    gained = sum(float(term(task, result, "progress")) for result in results) / task.config.rewards.progress
    assert left <= gained < left + 0.15 * speed
    assert float(results[-1].metrics["laps"][0]) == pytest.approx(1.0, abs=0.02)


WHOLE: dict[str, tuple[str, dict[str, Any], Callable]] = {
    "off-road": ("off-road", {"obstacles": 0}, lambda t: chase(t, t.goal, speed=9.0)),
    "hills": ("off-road", {"obstacles": 0, "hills": 1.0, "hill_height": 5.0}, lambda t: chase(t, t.goal, speed=9.0)),
    "hallway": ("hallway", {"tracks": 8}, follow_lane(0.75)),
    "barrier-track": ("barrier-track", {"tracks": 8}, follow_lane(8.0)),
    "convoy": ("convoy", {"latest_start": 0.1}, follow_leader),
    "convoy generated": ("convoy", {"latest_start": 0.1, "generated": True}, follow_leader),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", WHOLE)
def test_every_episode_can_be_won_in_time(case):
    """By plain rules that know everything, on all tracks and many paths: goals are in reach, leaders are not too fast,
    turns not too narrow.
    """
    name, options, policy = WHOLE[case]
    task = driving(name, 8, seed=1, **options)
    won = torch.zeros(8, dtype=torch.bool)
    total = torch.zeros(8)
    for _ in range(task.config.max_episode_steps):
        result = task.step(policy(task))
        first = (result.end_reason >= 0) & ~won
        assert result.success[first].all()
        if "progress" in task.reward_terms:
            total += torch.where(won, 0.0, term(task, result, "progress") / task.config.rewards.progress)
        won |= first
        if won.all():
            break
    assert won.all()
    if name in ("hallway", "barrier-track"):
        assert total.min() > float(task.routes.length.min()) - 1.0


@pytest.mark.quick("obstacle-avoidance")
@pytest.mark.parametrize("name", NAMES)
def test_random_drives_end_for_named_reasons_only(name):
    task = driving(name, 8, max_episode_steps=12)
    ends = 0
    for action in random_actions(task, 25):
        result = task.step(action)
        ended = result.terminated | result.truncated
        assert torch.equal(ended, result.end_reason >= 0)
        assert not (result.terminated & result.truncated).any()
        assert (result.success <= ended).all()
        ends += int(ended.sum())
    summary = task.drain_statistics()
    assert sum(summary.end_reasons.values()) == ends >= 16
    assert "non_finite" not in {name for name, count in summary.end_reasons.items() if count}


# ---- rewards on the way ----------------------------------------------------------------------------------------


def way_left(task):
    """(W,) from the goal [m]."""
    point, _ = task.pose()
    goal = task.goal if task.name == "off-road" else torch.tensor([task.config.end, 0.0])
    return (goal - point[:, :2]).norm(dim=1)


@pytest.mark.parametrize("name", ["obstacle-avoidance", "off-road"])
def test_progress_adds_up_to_the_distance_gained(name):
    task = driving(name, 4, seed=2)
    before = way_left(task)
    total = torch.zeros(4)
    for action in random_actions(task, 25, seed=3):
        action[:, 1] = action[:, 1].abs()
        distance = way_left(task)
        result = task.step(action)
        assert (result.end_reason < 0).all()
        step = term(task, result, "progress") / task.config.rewards.progress
        total += step
        # a difference of distances of 40 to 100 m in float64
        assert step.tolist() == pytest.approx((distance - way_left(task)).tolist(), abs=1e-6)
    gained = before - way_left(task)
    assert total.tolist() == pytest.approx(gained.tolist(), abs=1e-4)
    assert gained.abs().max() > 1.0


@pytest.mark.parametrize("name", ["hallway", "barrier-track"])
def test_progress_along_a_lane_is_the_length_driven_of_it(name):
    speed = 1.0 if name == "hallway" else 6.0
    task = driving(name, 2, seed=3, speed=speed)
    driven, total = torch.zeros(2), torch.zeros(2)
    for _ in range(50):
        before, _ = task.pose()
        result = task.step(follow_lane(speed)(task))
        assert (result.end_reason < 0).all()
        driven += (task.pose()[0] - before)[:, :2].norm(dim=1)
        total += term(task, result, "progress") / task.config.rewards.progress
    # it cuts corners or swings out by a tenth of their radius at most
    assert total.tolist() == pytest.approx(driven.tolist(), rel=0.1)
    assert driven.min() > 2.0
    assert total.tolist() == pytest.approx(task.progress.tolist(), abs=1e-3)


def test_driving_back_is_taken_away_again():
    task = driving("hallway", 1, pedals=True, seed=3)
    total = 0.0
    for pedal in (0.5, -1.0):
        for _ in range(12):
            total += float(term(task, task.step(held(task, 0.0, pedal)), "progress"))
    assert total == pytest.approx(task.config.rewards.progress * float(task.progress[0]), abs=1e-5)


def behind(task, distance, angle):
    """Put the truck so far behind the leader, off its axis by an angle at the leader."""
    leader = task.leaders(task.time())[:, 0].double()
    way = leader[:, 2] + angle
    back = distance * torch.stack([way.cos(), way.sin()], dim=1)
    task.place_vehicle(every(task), torch.nn.functional.pad(leader[:, :2] - back, (0, 1)), leader[:, 2])


@pytest.mark.parametrize(("weight", "near", "softness"), [(0.1, 16.0, 4.0), (100.0, 16.0, 0.2)])
def test_following_is_paid_in_the_cone_behind_the_leader_by_distance(weight, near, softness):
    task = driving("convoy", 1, rewards=ConvoyRewards(following=weight), near=near, softness=softness)
    for distance in (8.0, 15.9, 16.1, 20.0, 29.0):
        for angle in (0.0, 0.77, -0.77, 0.8, -0.8, 2.0, math.pi):
            behind(task, distance, angle)
            original = weight * softness / (max(distance - 12.0 - 4.0, 0.0) + softness)
            expected = original if abs(angle) < math.pi / 4.0 else 0.0
            # places in float32 of 100 m: an error of 1e-5 m in the distance
            assert float(task.rewards()["following"]) == pytest.approx(expected, rel=2e-4, abs=1e-6)
    if weight == 100.0:
        behind(task, 20.0, 0.0)
        assert float(task.rewards()["following"]) == pytest.approx(20.0 / (4.0 + 0.2), rel=1e-4)


def test_a_difference_of_speeds_costs_where_it_is_asked_for():
    assert "speed" not in driving("convoy", 1).reward_terms
    task = driving("convoy", 1, rewards=ConvoyRewards(speed=-5.0), seed=1)
    for _ in range(10):
        result = task.step(held(task, 0.0, 0.3))
    seen = result.final_observations["policy"][0]
    leader, own = 10.0 * float(seen[8]), 10.0 * float(seen[10])
    assert float(term(task, result, "speed")) == pytest.approx(-5.0 * abs((leader - own) / (abs(own) + 0.05)), rel=1e-4)
    assert leader == pytest.approx(2.0 * 2.0 / DURATION**2 * float(task.routes.length[task.route]), rel=1e-5)


def test_leaders_speed_up_evenly_until_the_end_of_the_path():
    task = driving("convoy", 4, latest_start=0.0)
    length = task.routes.length[task.route]
    for time in (5.0, 20.0, 50.0):
        here, there = (task.leaders(torch.full((4,), t)) for t in (time - 0.1, time + 0.1))
        speed = (there - here)[..., :2].norm(dim=2) / 0.2
        expected = 2.0 * time / DURATION**2 * length
        # the chord of an arc that is 3 m long at most, in turns of 20 m and more
        assert speed[:, 0].tolist() == pytest.approx(expected.tolist(), rel=0.01)
    end = task.routes.at(task.route, length.unsqueeze(1))
    assert torch.allclose(task.leaders(torch.full((4,), DURATION * math.sqrt(0.95)))[:, :1], end, atol=1e-3)


def test_a_change_of_the_action_costs_where_it_is_asked_for():
    task = driving("off-road", 2, rewards=OffRoadRewards(change=-0.5))
    before = task.action.clone()
    for action in random_actions(task, 5):
        result = task.step(action)
        change = (task.action - before).norm(dim=1)
        assert term(task, result, "change").tolist() == pytest.approx((-0.5 * change).tolist(), abs=1e-6)
        before = task.action.clone()
    assert change.max() > 0.1


def test_driving_beside_the_middle_of_a_track_costs_by_the_metre():
    task = driving("barrier-track", 2, seed=4)
    at = task.routes.at(task.route, task.begun.unsqueeze(1))[:, 0].double()
    aside = torch.tensor([2.0, -3.0], dtype=torch.float64)
    place = at[:, :2] + aside.unsqueeze(1) * torch.stack([-at[:, 2].sin(), at[:, 2].cos()], dim=1)
    task.place_vehicle(every(task), torch.nn.functional.pad(place, (0, 1)), at[:, 2])
    assert task.rewards()["aside"].tolist() == pytest.approx([-0.01, -0.015], rel=2e-3)
    # points of the lane are 0.6 m apart, its turns have radii of 12 m or more: 0.3² / 24 m of sagitta
    assert task.lane()[0].tolist() == pytest.approx([2.0, -3.0], abs=5e-3)
    assert not task.outside().any()


def test_a_corner_in_the_barrier_is_a_collision_and_none_is_not():
    task = driving("barrier-track", 4, seed=4, tracks=1)
    # the side of the car, 0.9 m from its middle, 5 cm to either side of the border at 6.25 m
    aside = torch.tensor([5.3, 5.4, -5.3, -5.4], dtype=torch.float64)
    straight = np.abs(task.tracks[0].curvature) < 1e-9
    index = np.flatnonzero(straight[8:-8])[len(np.flatnonzero(straight)) // 2] + 8
    at = task.routes.at(task.route, torch.full((4, 1), float(task.tracks[0].arc[index])))[:, 0].double()
    place = at[:, :2] + aside.unsqueeze(1) * torch.stack([-at[:, 2].sin(), at[:, 2].cos()], dim=1)
    task.place_vehicle(every(task), torch.nn.functional.pad(place, (0, 1)), at[:, 2])
    assert task.outside().tolist() == [False, True, False, True]
    # turned, a corner 2.2 m ahead and 0.9 m aside of the middle comes first: cos 0.3 * 0.9 + sin 0.3 * 2.2 = 1.510 m
    aside = torch.tensor([4.70, 4.78, -4.70, -4.78], dtype=torch.float64)
    place = at[:, :2] + aside.unsqueeze(1) * torch.stack([-at[:, 2].sin(), at[:, 2].cos()], dim=1)
    turn = torch.tensor([0.3, 0.3, 0.3, -0.3])
    task.place_vehicle(every(task), torch.nn.functional.pad(place, (0, 1)), at[:, 2] + turn)
    assert task.outside().tolist() == [False, True, False, True]


@pytest.mark.quick("barrier-track", "convoy", "obstacle-avoidance")
@pytest.mark.parametrize("name", NAMES)
def test_a_vehicle_is_upset_beyond_sixty_degrees(name):
    task = driving(name, 4)
    lean = torch.tensor([math.radians(angle) for angle in (0.0, 58.0, 62.0, 62.0)], dtype=torch.float64)
    way = torch.tensor([0.0, 1.0, 2.0, -2.0], dtype=torch.float64)
    normal = torch.stack([lean.sin() * way.cos(), lean.sin() * way.sin(), lean.cos()], dim=1)
    task.place_vehicle(every(task), torch.zeros(4, 3), torch.zeros(4), normal)
    assert task.upset().tolist() == [False, False, True, True]


def test_a_map_ends_on_all_sides():
    task = driving("off-road", 8)
    place = torch.tensor([[59.9, 0, 0], [60.1, 0, 0], [-59.9, 0, 0], [-60.1, 0, 0]])
    place = torch.cat([place, place[:, [1, 0, 2]]])
    # 60 m, the vehicle's point of reference
    task.place_vehicle(every(task), place, torch.zeros(8))
    assert task.terminations()["off_map"].tolist() == 2 * [False, True, False, True]


def test_a_road_ends_at_the_side_of_the_truck():
    task = driving("obstacle-avoidance", 4)
    place = torch.zeros(4, 3)
    place[:, 1] = torch.tensor([6.25, 6.35, -6.25, -6.35])  # 7.5 m, less half a truck of 2.4 m
    task.place_vehicle(every(task), place, torch.zeros(4))
    assert task.terminations()["off_road"].tolist() == [False, True, False, True]


def test_a_truck_beside_the_road_or_on_its_side_does_not_arrive():
    task = driving("obstacle-avoidance", 3)
    place = torch.tensor([[100.5, 0.0, 0.0], [100.5, 7.2, 0.0], [100.5, 0.0, 2.0]])
    normal = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.995, 0.1]], dtype=torch.float64)
    task.place_vehicle(every(task), place, torch.zeros(3), normal / normal.norm(dim=1, keepdim=True))
    assert task.terminations()["goal"].tolist() == [True, False, False]
    assert (task.rewards()["goal"] > 0.0).tolist() == [True, False, False]


class ByMethods(OffRoadTask):
    """Overrides a method that is called between physics steps."""

    fused_physics = False

    def after_physics(self):
        super().after_physics()


@pytest.mark.parametrize("kind", [OffRoadTask, ByMethods])
@pytest.mark.parametrize("touched", [0, 17, 39])
@pytest.mark.sweep
def test_a_touch_that_is_over_before_the_step_is_counts(kind, touched, monkeypatch):
    task = kind(OffRoadConfig(obs=Observing.STATE, obstacles=1), 2)
    force = to_torch(task.simulation.contacts.shape_contact_force)[:, task.chassis_shape]
    steps: list[int] = []

    def step():
        force.zero_()
        if len(steps) == touched:
            force[0, 1] = 1.0
        steps.append(1)

    def run(times):
        for _ in range(times):
            task._physics.every.commands[0].launch()  # what stands for the task's methods
            step()

    monkeypatch.setattr(task.simulation, "step", step)
    if task._physics is not None:
        monkeypatch.setattr(task._physics, "run", run)
    task.advance(torch.zeros(2, 2))
    assert len(steps) == 40
    assert task.terminations()["collision"].tolist() == task.hit.tolist() == [True, False]
    steps += [1] * 40
    task.advance(torch.zeros(2, 2))
    assert task.terminations()["collision"].tolist() == [False, False]


def test_leader_and_truck_bump_when_their_outlines_overlap():
    task = driving("convoy", 1)
    own, other = 2.3, 2.45
    for distance, expected in ((own + other + 0.1, False), (own + other - 0.1, True)):
        behind(task, distance, 0.0)
        assert task.terminations()["bumped"].tolist() == [expected]
        away = task.leaders(task.time())[:, 0, :2] - task.pose()[0][:, :2]
        assert float(away.norm()) == pytest.approx(distance, abs=1e-3)
    for distance, expected in ((1.05 + 1.1 + 0.1, False), (1.05 + 1.1 - 0.1, True)):
        behind(task, distance, 0.5 * math.pi)  # beside it
        assert task.terminations()["bumped"].tolist() == [expected]


def test_metrics_of_a_convoy_are_mean_deviation_distance_and_hits():
    task = driving("convoy", 2, seed=1)
    deviations = []
    for _ in range(6):
        result = task.step(held(task, 0.4, 0.5))
        point, _ = task.pose()
        deviations.append(task.routes.distance(task.route, point[:, :2]))
    mean = torch.stack(deviations).mean(dim=0)
    assert result.metrics["path_deviation"].tolist() == pytest.approx(mean.tolist(), rel=1e-5)
    away = (task.leaders(task.time())[:, 0, :2].double() - point[:, :2]).norm(dim=1)
    assert result.metrics["distance"].tolist() == pytest.approx(away.tolist(), abs=1e-4)
    assert result.metrics["obstacle_hits"].tolist() == [0.0, 0.0]
    _, results, _ = finish(*CASES["convoy collision"])
    assert results[-1].metrics["obstacle_hits"].tolist() == [1.0]


def test_no_reason_is_given_while_an_episode_runs():
    task = driving("convoy", 1)
    assert reason(task, task.step(held(task))) is None
    assert task.end_reasons[0] == "non_finite"
    assert task.end_reasons[-1] == "time_limit"
