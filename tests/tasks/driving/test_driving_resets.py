"""Where episodes of driving tasks begin: clear of everything, on the ground, in the lane, with a goal to go for.

Geometry is read from the arrays that contact and tires work on, not from what the tasks remember about it.
"""

import numpy as np
import pytest
import torch

from simwarp.core.interop import to_torch
from simwarp.tasks import replace_fields
from simwarp.tasks.driving.convoy import LEADER_HALF
from simwarp.tasks.randomisation.randomisation_config import Curriculum, Driver
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import default_config
from tests.reference.routes import nearest_on_path
from tests.tasks.driving.driving_checks import (
    driving,
    gaps,
    obstacle_corners,
    vehicle_corners,
    wheel_gaps,
    wheels,
)

WORLDS = 64
RESTARTS = {"obstacle-avoidance": 160, "off-road": 40, "convoy": 54, "hallway": 160, "barrier-track": 160}
"""Of 64 worlds, for each of a task's variants: more than 10 000 episodes of every task; a few where time is short."""
SOME = pytest.param(4, id="some")
TEN_THOUSAND = pytest.param(None, id="ten-thousand", marks=pytest.mark.slow)

FIELDS: dict[str, tuple[str, dict]] = {
    "obstacle-avoidance": ("obstacle-avoidance", {}),
    "off-road": ("off-road", {"obstacles": 30}),
    "off-road 50": ("off-road", {"obstacles": 50}),
    "hills": ("off-road", {"obstacles": 30, "hills": 1.0}),
    "hills 50": ("off-road", {"obstacles": 50, "hills": 1.0, "hill_height": 5.0}),
    "convoy": ("convoy", {}),
    "convoy late": ("convoy", {"latest_start": 0.8}),
    "convoy generated": ("convoy", {"generated": True}),
}


@pytest.fixture(scope="module", params=FIELDS)
def field(request):
    name, options = FIELDS[request.param]
    return driving(name, WORLDS, seed=5, **options)


@pytest.mark.quick("obstacle-avoidance-some", "off-road-some")
@pytest.mark.parametrize("restarts", [SOME, TEN_THOUSAND])
def test_vehicles_start_clear_of_all_obstacles(field, restarts):
    # what the tasks promise: 15 m from the vehicle's middle, paths that stay free, a road whose first pillar is far
    clear = {"convoy": 0.5, "off-road": 12.5, "obstacle-avoidance": 20.0}[field.name]
    directions = 24 if field.name == "convoy" else 12
    seen, restarts = 0, restarts or RESTARTS[field.name]
    for _ in range(restarts):
        field.restart()
        corners, there = obstacle_corners(field)
        seen += int(there.sum())
        assert gaps(vehicle_corners(field), corners, there, directions).min() > clear
    wanted = {"convoy": 7.5, "off-road": getattr(field.config, "obstacles", 0) - 0.1, "obstacle-avoidance": 3}
    assert seen >= wanted[field.name] * WORLDS * restarts  # and nearly all that were asked for are there


def chassis_overlaps(field):
    """(W,) whether contact sees the chassis in something. One that stands in it need not press on it."""
    contacts = field.simulation.contacts
    own = (to_torch(contacts.contact_shape0) == field.chassis_shape) | (
        to_torch(contacts.contact_shape1) == field.chassis_shape
    )
    used = torch.arange(own.shape[1]) < to_torch(contacts.contact_count)[:, None]
    return (own & used & (to_torch(contacts.contact_gap) < 0.0)).any(dim=1)


@pytest.mark.sweep
def test_the_check_sees_an_obstacle_that_is_hit(field):
    """The geometry of these tests is that of contact: moved to where it says "touching", an obstacle is felt."""
    field.restart()
    corners, there = obstacle_corners(field)
    shape = next(index for index, shape in enumerate(field.builder.shapes) if shape.body == -1 and shape.mask)
    place = to_torch(field.simulation.model.shape_x)[:, shape]
    kept, point = place.clone(), field.pose()[0]
    there = there & (torch.arange(there.shape[1]) == 0)
    size = (corners[:, 0, :, :2] - kept[:, None, :2]).norm(dim=2).amax(dim=1)
    for away, felt in ((size + 4.0, False), (0.3 * size, True)):
        place[:, 0], place[:, 1] = point[:, 0] + away, point[:, 1]
        place[:, 2] = wheels(field)[0][..., 2].mean(dim=1) - 0.4 + kept[:, 2] * (field.name == "obstacle-avoidance")
        present = there[:, 0]
        moved = corners + (place - kept).view(WORLDS, 1, 1, 3)
        touching = gaps(vehicle_corners(field), moved, there) < 0.0
        assert torch.equal(touching, present & felt)
        field.simulation.step()
        assert torch.equal(chassis_overlaps(field), present & felt)
    place.copy_(kept)
    field.restart()


@pytest.mark.quick("barrier-track-some")
@pytest.mark.parametrize("restarts", [SOME, TEN_THOUSAND])
@pytest.mark.parametrize("name", ["hallway", "barrier-track"])
def test_vehicles_start_within_the_lane(name, restarts):
    task = driving(name, WORLDS, seed=5, tracks=3, start="anywhere")
    places: dict[tuple[int, float], np.ndarray] = {}
    for _ in range(restarts or RESTARTS[name]):
        task.restart()
        corners = vehicle_corners(task)[:, ::2, :2].numpy()  # those above them are at nearly the same places
        places |= dict(zip(zip(task.route.tolist(), task.begun.tolist(), strict=True), corners, strict=True))
    assert {route for route, _ in places} == {0, 1, 2}
    for index, track in enumerate(task.tracks):
        points = np.concatenate([corners for (route, _), corners in places.items() if route == index])
        _, aside = nearest_on_path(track.points, points, every=4)
        assert np.abs(aside).max() < 0.5 * track.width


@pytest.mark.parametrize("where", ["turn", "straight"])
def test_laps_begin_on_a_turn_or_a_straight_as_asked(where):
    task = driving("hallway", 16, start=where)
    track = task.tracks[0]
    for _ in range(20):
        index = np.searchsorted(track.arc, task.begun.numpy() + 1e-3, side="right") - 1
        assert ((track.curvature[index] != 0.0) == (where == "turn")).all()
        task.restart()


def test_wheels_stand_on_the_ground(field):
    field.restart()
    settled = 0.04 if field.name == "off-road" else 0.02  # what tires give way under the weight, flat on the ground
    bent = 0.0 if getattr(field, "hills", None) is None else 0.03 * field.config.hill_height / 3.0
    for _ in range(10):
        gap = wheel_gaps(field)
        # hills are 35 m long or longer: across a wheelbase of 2 m they bend by 1 or 2 cm for 3 m of height
        assert gap.min() > -settled - bent
        assert gap.max() < bent - 0.003
        centre, _, radii, _ = wheels(field)
        assert (np.abs(centre[..., 2].numpy() - centre[:, :1, 2].numpy()) < 1.5).all()
        assert min(radii) > 0.2
        field.restart()


@pytest.mark.parametrize("name", ["hallway", "barrier-track"])
def test_wheels_of_cars_on_tracks_stand_on_the_ground(name):
    task = driving(name, 32)
    gap = wheel_gaps(task)
    assert gap.min() > -0.05 * wheels(task)[2][0]
    assert gap.max() < 0.0


@pytest.mark.quick("convoy", "hills", "obstacle-avoidance")
def test_vehicles_stand_still_where_they_start_and_stay_there(field):
    """Put down on hills too, a vehicle neither jumps nor falls: brakes hold it."""
    field.restart()
    velocity, omega = (to_torch(getattr(field.simulation.state, name)) for name in ("body_v", "body_omega"))
    chassis = field.parts.chassis
    assert velocity[:, chassis].abs().max() < 0.01
    assert omega.abs().max() < 0.05
    start, _ = field.pose()
    field.input[:, 2] = 1.0
    fastest = 0.0
    for _ in range(round(0.3 / field.config.dt)):
        field.simulation.step()
        fastest = max(fastest, float(velocity[:, chassis, 2].abs().max()))
    field.input.zero_()
    moved = (field.pose()[0] - start).norm(dim=1).max()
    hilly = getattr(field, "hills", None) is not None
    assert fastest < (0.5 if hilly else 0.05)
    assert moved < (0.15 if hilly else 0.01)
    field.restart()


def test_the_goal_is_off_the_start_and_its_middle_can_be_reached():
    task = driving("off-road", WORLDS, obstacles=50, hills=1.0)
    for _ in range(10):
        task.restart()
        point, heading = task.pose()
        assert point[:, :2].norm(dim=1).numpy() == pytest.approx(task.config.radius, abs=0.1)
        assert task.goal.norm(dim=1).numpy() == pytest.approx(task.config.radius, abs=1e-4)
        apart = (task.goal - point[:, :2]).norm(dim=1)
        # a quarter of the circle at least lies between them
        assert apart.min() > np.sqrt(2.0) * task.config.radius - 0.1
        inward = -(point[:, 0] * heading.cos() + point[:, 1] * heading.sin()) / task.config.radius
        assert inward.min() > 0.997  # the reference point is above the wheels, on a slope a few centimetres aside
        # nothing stands on the goal, nor between it and the edge of the disc where it counts as reached
        corners, there = obstacle_corners(task)
        away = (corners[..., :2] - task.goal.view(-1, 1, 1, 2)).norm(dim=3).amin(dim=2)
        assert away[there].min() > task.config.goal_radius


def rectangle(at, half):
    signs = torch.tensor([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])
    x, y = (signs * torch.tensor(half[:2])).T
    cosine, sine = at[..., 2:].cos(), at[..., 2:].sin()
    return torch.stack([at[..., :1] + cosine * x - sine * y, at[..., 1:2] + sine * x + cosine * y], dim=-1).double()


@pytest.mark.quick("False")
@pytest.mark.parametrize("generated", [False, True])
def test_leaders_overlap_neither_each_other_nor_the_truck_nor_obstacles(generated):
    task = driving("convoy", WORLDS, generated=generated)
    every = torch.ones(WORLDS, 2, dtype=torch.bool)
    for _ in range(6):
        task.restart()
        for time in (0.0, 20.0, 40.0):
            leaders = rectangle(task.leaders(torch.full((WORLDS,), time)), LEADER_HALF)
            for index in range(3):
                others = leaders[:, [other for other in range(3) if other != index]]
                assert gaps(leaders[:, index], others, every).min() > 1.0
                corners, there = obstacle_corners(task)
                assert gaps(leaders[:, index], corners, there).min() > 0.0
            if time == 0.0:
                assert gaps(vehicle_corners(task), leaders, torch.ones(WORLDS, 3, dtype=torch.bool)).min() > 3.0


def test_all_sixteen_paths_are_driven_and_start_within_the_part_that_is_asked_for():
    task = driving("convoy", WORLDS, latest_start=0.5)
    seen, begun = set(), []
    for _ in range(20):
        task.restart()
        seen |= set(task.route.tolist())
        begun.append(task._begun.clone())
    share = torch.cat(begun)
    assert seen == set(range(16))
    assert share.min() >= 0.05
    assert 0.54 < share.max() < 0.55 + 1e-6


def trainer(name, worlds, **options):
    """What begins to train a task without a camera."""
    task = driving(name, worlds, **options)
    config = default_config(type(task), task.config)
    return Trainer(task, replace_fields(config, {"num_envs": worlds, "steps_per_iteration": 4, "ppo.mini_batches": 1}))


def test_a_curriculum_begins_with_the_first_episodes():
    curriculum = Curriculum(driver=Driver.ITERATION, first=0, last=10)
    task = trainer("off-road", 4, curriculum=curriculum).task
    assert task.difficulty.tolist() == [0.0] * 4
    assert not to_torch(task.simulation.model.shape_enabled)[:, task.obstacles.shapes].any()


@pytest.mark.quick("barrier-track")
@pytest.mark.parametrize("name", ["hallway", "barrier-track"])
def test_first_time_outs_are_spread_over_the_time_that_a_lap_may_take(name):
    begun = trainer(name, 64)
    task = begun.task
    share = task.episode_clock / task.step_limit()
    assert share.max() < 1.0
    assert share.std() > 0.2  # 0.29 of an even spread
    assert (task.step_limit() < task.config.max_episode_steps).all()
    begun.iterate()
    # 4 of some 400 to 900 steps later few clocks have run out: 0.4 to 1 % of 64
    assert int((task.episode_steps < 4).sum()) <= 4
