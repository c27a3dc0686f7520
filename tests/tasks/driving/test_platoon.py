"""A convoy of simulated vehicles: what followers see, drivers at the head, touches between vehicles, ends of each."""

import math

import pytest
import torch

from simwarp.core.interop import to_torch
from simwarp.tasks import InputError
from simwarp.tasks.driving.convoy import LEADER_HALF, MAP_HALF
from simwarp.tasks.driving.convoy_kernels import APART, DURATION, LENGTHS, SPEED
from simwarp.tasks.driving.navigation import PLACE_NOISE
from simwarp.tasks.driving.platoon import PlatoonTask
from simwarp.tasks.framework.step_check import check_step
from tests.tasks.driving.driving_checks import SMALL, driving

SIMULATED = {"leaders": "simulated"}
FOUR = {**SIMULATED, "leading": 1, "followers": 3}


def platoon(worlds=2, *, seed=1, **options):
    return driving("convoy", worlds, seed=seed, **{**FOUR, "latest_start": 0.0, **options})


def held(task, steering=0.0, pedal=0.0):
    """(W, N, 2): the same for all followers."""
    return torch.tensor([steering, pedal]).expand_as(task.action).clone()


def places(task):
    """(W, V, 3) float64: x, y and heading, as the vehicles themselves measure them."""
    point, angles = to_torch(task.vehicles.position), to_torch(task.vehicles.angles)
    return torch.cat([point[..., :2], angles[..., 2:].double()], dim=2)


def scheduled(task, vehicle):
    """(W, 3) place and heading where the path has a vehicle now; negative ones are ahead of the first."""
    count = task.config.leading + task.config.followers
    gone = task.time() / DURATION
    share = task._begun + APART * (count - 2 - vehicle) + gone * gone
    return task.routes.at(task.route, (share * task.routes.length[task.route]).unsqueeze(1))[:, 0].double()


def seen_from(own, other):
    """(W, 2) a place in another one's axes."""
    away, c, s = other[:, :2] - own[:, :2], own[:, 2].cos(), own[:, 2].sin()
    return torch.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], dim=1)


@pytest.mark.parametrize("options", [SIMULATED, FOUR], ids=["three lead one", "one leads three"])
def test_followers_see_the_vehicles_ahead_and_the_path_where_there_is_none(options):
    task = driving("convoy", 2, seed=1, **options)
    assert isinstance(task, PlatoonTask)
    for step in range(6):
        result = task.step(held(task, 0.1, 0.4 if step < 4 else -0.2))
    at, observed = places(task), result.observations["policy"].view(2, task.agents, 34).double()
    velocity = to_torch(task.vehicles.velocity_b)
    for agent in range(task.agents):
        vehicle = task.config.leading + agent
        row, own = observed[:, agent], at[:, vehicle]
        for index in range(3):
            ahead = vehicle - 1 - index
            other = at[:, ahead] if ahead >= 0 else scheduled(task, ahead)
            # Metres of float32 places some 100 m from the origin, over 20 m
            assert torch.allclose(row[:, 2 * index : 2 * index + 2], seen_from(own, other) / LENGTHS, atol=3e-6)
        turn = at[:, vehicle - 1, 2] - own[:, 2]
        assert torch.allclose(row[:, 6:8], torch.stack([turn.sin(), turn.cos()], dim=1), atol=1e-5)
        # A level chassis: speed in its axes and along its heading are one
        assert torch.allclose(row[:, 8] * SPEED, velocity[:, vehicle - 1, 0].double(), atol=0.02)
        assert torch.allclose(row[:, 10] * SPEED, velocity[:, vehicle, 0].double(), atol=0.02)


def test_vehicles_start_settled_on_the_path_one_behind_the_other():
    task = platoon(4)
    task.restart(seed=3)
    at, length = places(task), task.routes.length[task.route]
    for vehicle in range(4):
        wanted = scheduled(task, vehicle)
        assert torch.allclose(at[:, vehicle, :2], wanted[:, :2], atol=1e-4)
        assert (at[:, vehicle, 2] - wanted[:, 2]).sin().abs().max() < 1e-4
    gaps = (at[:, :-1, :2] - at[:, 1:, :2]).norm(dim=2)
    assert (gaps < APART * length.unsqueeze(1) + 0.05).all()
    assert not task.touched.any()
    heights = to_torch(task.vehicles.position)[..., 2].clone()
    for _ in range(5):
        task.step(held(task, 0.0, -1.0))
    # The head drives off: its nose rises by millimetres
    assert (to_torch(task.vehicles.position)[..., 2] - heights).abs().max() < 0.02


def test_drivers_take_the_head_along_the_path_in_time():
    task = driving("convoy", 2, seed=2, latest_start=0.0, **SIMULATED)
    driven = 0
    for _ in range(120):
        task.step(held(task, 0.0, -1.0))
        if task.episode_index.max() > 0:
            break
        driven += 1
        reached = places(task)[:, :3].clone()
        wanted = torch.stack([scheduled(task, vehicle) for vehicle in range(3)], dim=1)
        off = task.deviation[:, :3].clone()
    assert driven >= 30
    assert off.max() < 0.6
    assert (reached[..., :2] - wanted[..., :2]).norm(dim=2).max() < 3.0


def test_who_runs_into_the_one_ahead_is_bumped_and_brakes_and_others_go_on():
    task = platoon(2)
    ended = {}
    action = held(task, 0.0, -1.0)
    action[0, 1] = torch.tensor([0.0, 1.0])  # in world 0 the second follower runs into the first
    for step in range(60):
        result = task.step(action)
        for world, agent in (result.end_reason >= 0).nonzero().tolist():
            ended[world, agent] = step, task.end_reasons[int(result.end_reason[world, agent])]
        if (0, 1) in ended:
            break
    assert ended == {(0, 1): (step, "bumped")}
    gap = (places(task)[0, 1, :2] - places(task)[0, 2, :2]).norm()
    assert 4.0 < gap < 2 * task.chassis_half[0] + 0.6, "bumper to bumper, and not in one another"
    for _ in range(6):
        result = task.step(action)
    assert result.acting.tolist() == [[True, False, True], [True, True, True]]
    assert (task.action[0, 1] == torch.tensor([0.0, -1.0])).all()
    assert to_torch(task.vehicles.input)[0, 2, 2] == 1.0
    assert (result.end_reason == -1).all(), "who was struck from behind goes on"
    assert task.episode_index.tolist() == [0, 0]


def test_what_one_follower_does_is_nothing_to_those_it_does_not_touch_bit_for_bit():
    ours, theirs = platoon(2), platoon(2)
    for step in range(12):
        free = ours.step(held(ours, 0.0, 0.3))
        other = held(theirs, 0.0, 0.3)
        other[1, 2] = torch.tensor([0.4, -1.0 if step % 2 else 0.1])
        push = theirs.step(other)
        first, second = (each.observations["policy"] for each in (free, push))
        assert torch.equal(first[0], second[0])
        assert torch.equal(first[1, :2], second[1, :2])
    assert not torch.equal(first[1, 2], second[1, 2])


def test_a_saved_convoy_goes_on_exactly():
    task = platoon(2, soil="mid")
    for _ in range(4):
        task.step(held(task, 0.05, 0.6))
    saved = task.state_dict()
    ahead = [task.step(held(task, -0.1, 0.3)).observations["policy"].clone() for _ in range(4)]
    off = task.deviation.clone()
    other = platoon(2, soil="mid", seed=4)
    other.load_state_dict(saved)
    for wanted in ahead:
        assert torch.equal(other.step(held(other, -0.1, 0.3)).observations["policy"], wanted)
    assert torch.equal(other.deviation, off)


def test_worlds_begin_anew_one_by_one_as_a_fresh_task_does():
    task, fresh = platoon(2), platoon(2)
    for _ in range(3):
        task.step(held(task, 0.1, 0.5))
    task.begin_episodes(torch.tensor([False, True]))
    assert task.deviation[1].max() == 0.0
    assert task.deviation[0].max() > 0.0
    fresh.begin_episodes(torch.tensor([True, True]))
    for _ in range(4):
        got, wanted = (each.step(held(each, 0.0, 0.2)).observations["policy"] for each in (task, fresh))
        assert torch.equal(got[1], wanted[1])


def test_followers_on_soil_stand_in_it_with_all_wheels():
    task = platoon(1, soil="mid")
    task.step(held(task, 0.0, 0.3))
    sinkage = to_torch(task.soil.element.sinkage)
    assert sinkage.shape == (1, 16)
    assert (sinkage > 0.02).all()
    assert (sinkage < 0.12).all()


def test_a_control_step_of_a_convoy_fits_into_one_graph():
    assert check_step(platoon(1)).problems() == []


def test_wrong_convoys_are_refused_in_one_line():
    with pytest.raises(InputError, match="followers must be 1 where leaders are ghosts"):
        driving("convoy", 1, followers=2)
    with pytest.raises(InputError, match="leading must be 3 where leaders are ghosts"):
        driving("convoy", 1, leading=1)
    with pytest.raises(InputError, match="obs must be state or camera where there are several followers"):
        driving("convoy", 1, obs="lidar", **FOUR)
    with pytest.raises(InputError, match="drive-on must be False where leaders are ghosts"):
        driving("convoy", 1, drive_on=True)
    with pytest.raises(InputError, match="scattered must be 0 without generated paths"):
        driving("convoy", 1, scattered=10)
    with pytest.raises(InputError, match="leaders must be one of ghosts, simulated"):
        driving("convoy", 1, leaders="parked")


def test_pictures_and_maps_show_every_vehicle():
    task = driving("convoy", 1, obs="camera", camera_width=40, camera_height=36, **SIMULATED)
    bodies = {task.simulation.model.body_names[body] for body in task.scene().body.tolist() if body >= 0}
    assert {f"v{vehicle}_chassis" for vehicle in range(4)} <= bodies
    outlines = task.vehicle_lines()
    at = places(task)
    assert len(outlines) == 4
    for vehicle, line in enumerate(outlines):
        middle = line.points[:, :4, :2].double().mean(dim=1)
        assert torch.allclose(middle, at[:, vehicle, :2], atol=1e-4)
    assert task.step(torch.zeros(1, 2)).observations["camera"].float().std() > 1.0
    assert math.isfinite(float(task.metrics()["distance"][0]))


def test_obstacles_are_seen_where_they_stand_and_nothing_else_is_moved_to_them():
    task = driving("convoy", 2, obs="camera", camera_width=40, camera_height=36, **SIMULATED)
    scene, place = task.scene(), task.obstacles.place
    seen = to_torch(scene.x)
    slots = [scene.instance(f"obstacle_{slot}_visual") for slot in range(task.obstacles.count)]
    there = task.obstacles.radius > 0.0
    assert there.any()
    assert torch.allclose(seen[:, slots, :2][there], place[there].double(), atol=1e-5)
    others = [index for index in range(len(scene.names)) if index not in slots]
    assert "v0_body" in [scene.names[index] for index in others]
    assert seen[:, others].norm(dim=2).max() < 5.0  # on bodies, or the ground


def test_each_follower_sees_the_one_ahead_by_a_camera_and_instruments_of_its_own():
    task = platoon(2, **SMALL)
    for _ in range(6):
        seen = task.step(held(task, 0.0, 0.2)).observations
    assert seen["camera"].shape == (2, 3, 36, 40, 3)
    assert seen["policy"].shape == (2, 3, 6)
    images = seen["camera"].float()
    assert all((images[:, one] - images[:, other]).abs().mean() > 3.0 for one, other in ((0, 1), (1, 2), (0, 2)))
    # The one ahead is red and stands in the middle of each picture; beside it there is grass
    redness = (images[..., 0] - images[..., 1])[..., 15:30, :].mean(dim=(0, 2))
    assert (redness[:, 16:24].mean(dim=1) > redness[:, :8].mean(dim=1) + 5.0).all()
    at, noise = places(task), []
    for agent in range(3):
        truth = seen_from(at[:, agent + 1], at[:, agent]) / LENGTHS
        noise.append(seen["policy"][:, agent, :2].double() - truth)
        assert noise[-1].abs().max() < 5.0 * PLACE_NOISE / LENGTHS + 0.01
    assert not torch.allclose(noise[0], noise[1], atol=1e-5), "receivers err each by itself"
    alone = driving("convoy", 2, seed=1, latest_start=0.0, **SMALL, **SIMULATED)
    assert alone.step(torch.zeros(2, 2)).observations["camera"].shape == (2, 36, 40, 3)


def test_a_saved_convoy_by_camera_goes_on_exactly():
    task = platoon(2, **SMALL, drive_on=True, conditions="random")
    for _ in range(3):
        task.step(held(task, 0.0, 1.0))
    saved = task.state_dict()
    ahead = [task.step(held(task, 0.1, 0.3)).observations for _ in range(2)]
    last = {name: group.clone() for name, group in ahead[-1].items()}
    other = platoon(2, seed=4, **SMALL, drive_on=True, conditions="random")
    other.load_state_dict(saved)
    for _ in range(2):
        result = other.step(held(other, 0.1, 0.3))
    assert all(torch.equal(result.observations[name], last[name]) for name in last)
    assert torch.equal(other.touches, task.touches)


def test_who_drives_on_is_not_ended_by_touches_which_are_counted():
    task = platoon(2, drive_on=True, lost_distance=200.0)
    action = held(task, 0.0, -1.0)
    action[0, 1] = torch.tensor([0.0, 1.0])  # in world 0 the second follower runs into the first
    for _ in range(30):
        result = task.step(action)
        assert (result.end_reason == -1).all()
    assert result.acting.all()
    bumps = result.metrics["bumps"]
    assert bumps[0, 1] >= 1.0
    assert bumps[1].max() == 0.0
    assert result.metrics["obstacle_hits"].max() == 0.0
    assert torch.equal(task.touches[..., 1].float(), bumps)
    task.begin_episodes(torch.tensor([True, False]))
    assert task.touches.max() == 0


def test_an_obstacle_on_the_way_is_counted_once_while_it_is_touched():
    task = platoon(1, drive_on=True, lost_distance=200.0)
    task.restart(seed=3)
    # A rock in front of the last one, which presses against it
    ahead = places(task)[0, 3, :2] + 6.0 * torch.stack([places(task)[0, 3, 2].cos(), places(task)[0, 3, 2].sin()])
    count = task.obstacles.count
    place = ahead.view(1, 1, 2).expand(1, count, 2).clone()
    place[:, 1:] += 500.0
    zeros, ones = torch.zeros(1, count), torch.ones(1, count)
    kinds = torch.zeros(1, count, dtype=torch.int64)
    task.obstacles.fill(torch.tensor([True]), place, zeros, zeros, kinds, 1.5 * ones, ones.bool())
    action = held(task, 0.0, -1.0)
    action[0, 2, 1] = 0.6
    hits = []
    for _ in range(25):
        result = task.step(action)
        assert (result.end_reason == -1).all()
        hits.append(int(result.metrics["obstacle_hits"][0, 2]))
    assert hits[0] == 0
    assert 1 <= hits[-1] <= 3, "while it presses there is one touch, but for a bounce"
    assert result.metrics["obstacle_hits"][0, :2].max() == 0.0
    assert result.metrics["bumps"].max() == 0.0


def test_scattered_obstacles_stand_anywhere_but_on_the_way_and_change_nothing_else():
    plain = platoon(3, generated=True, generated_paths=4)
    task = platoon(3, generated=True, generated_paths=4, scattered=60)
    for each in (plain, task):
        each.restart(seed=3)
    assert torch.equal(task.obstacles.radius[:, :12], plain.obstacles.radius[:, :12])
    assert torch.equal(task.obstacles.place[:, :12], plain.obstacles.place[:, :12])
    place, radius = task.obstacles.place[:, 12:], task.obstacles.radius[:, 12:]
    there = radius > 0.0
    assert (there.sum(dim=1) > 40).all()
    assert (radius[there].max() / radius[there].min()) > 5.0, "of various sizes"
    away = place.abs().flatten(0, 1).max(dim=0).values
    assert (away > torch.tensor(MAP_HALF) * 0.8).all()
    assert (away < torch.tensor(MAP_HALF)).all()
    for world in range(3):
        route = task.route[world].expand(60)
        near = task.routes.distance(route, place[world]) - radius[world]
        assert near[there[world]].min() > LEADER_HALF[1] + 1.4
