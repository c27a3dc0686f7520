"""What policies of driving tasks see: shapes and sizes of numbers, exact places, and images that show what is there, on
the side where it is, in its colours.
"""

import itertools
import math

import numpy as np
import pytest
import torch

from simwarp.core.interop import to_torch
from simwarp.tasks.driving.convoy import LEADER_HALF
from simwarp.tasks.driving.convoy_kernels import DURATION
from tests.tasks.driving.driving_checks import (
    NAMES,
    SMALL,
    copied,
    driving,
    held,
    obstacle_corners,
    random_actions,
    turned,
    vehicle_corners,
)

# what documentation says: entries of `policy` with exact places, beside a camera, and the camera's own image
SHAPES = {
    "obstacle-avoidance": (38, 3, (45, 80, 3)),
    "off-road": (38, 6, (45, 80, 3)),
    "convoy": (34, 6, (45, 80, 3)),
    "hallway": (17, 3, (45, 80, 3)),
    "barrier-track": (18, 3, (45, 80, 3)),
}
WIDTH, HEIGHT = 80, 45


@pytest.mark.quick(
    "barrier-track-state",
    "convoy-state",
    "hallway-state",
    "hallway-camera",
    "obstacle-avoidance-state",
    "obstacle-avoidance-camera",
    "off-road-state",
)
@pytest.mark.parametrize("obs", ["state", "camera"])
@pytest.mark.parametrize("name", NAMES)
def test_observations_are_as_documented_and_of_reasonable_size(name, obs):
    exact, beside, image = SHAPES[name]
    task = driving(name, 2, seed=1, obs=obs, max_episode_steps=8)
    expected = {"policy": (exact,)} if obs == "state" else {"policy": (beside,), "camera": image}
    assert task.observation_shapes == expected
    assert task.observation_dtypes["policy"] == torch.float32
    assert task.observation_dtypes.get("camera", torch.uint8) == torch.uint8
    rows = [copied(task.restart(seed=1))]
    for action in random_actions(task, 12):
        result = task.step(action)
        rows += [copied(result.observations), copied(result.final_observations)]
    for groups in rows:
        assert {key: group.shape[1:] for key, group in groups.items()} == expected
    numbers = torch.stack([groups["policy"] for groups in rows])
    assert torch.isfinite(numbers).all()
    assert (numbers.abs() < 3.0).float().mean() > 0.99
    assert numbers.abs().max() < 10.0
    if obs == "camera":
        images = torch.stack([groups["camera"] for groups in rows]).float()
        assert images.flatten(2).std(dim=2).min() > 10.0  # none is of one colour
        assert not torch.equal(images[0], images[-1])


def test_a_hallway_with_pedals_has_an_entry_and_an_action_more():
    task = driving("hallway", 1, pedals=True)
    assert task.action_size == 2
    assert task.observation_shapes == {"policy": (18,)}


@pytest.mark.parametrize("name", ["obstacle-avoidance", "convoy"])
def test_the_full_model_is_seen_as_the_reduced_one_is(name):
    reduced, full = (driving(name, 2, seed=1, full=choice) for choice in (False, True))
    assert full.observation_shapes == reduced.observation_shapes
    assert full.simulation.model.body_count > reduced.simulation.model.body_count
    seen, known = (task.restart(seed=1)["policy"] for task in (full, reduced))
    assert (seen - known).abs().max() < 0.05
    for _ in range(10):
        result = full.step(held(full, 0.1, 0.5))
        assert (result.end_reason < 0).all()
    assert full.motion()[:, 0].min() > 0.1


# ---- exact observations ----------------------------------------------------------------------------------------


def local(task, places):
    """Places (W, N, 2) ahead of the vehicle and to its left, in float64, as a rotation matrix tells."""
    point, heading = task.pose()
    rows = []
    for world in range(task.num_worlds):
        angle = float(heading[world])
        turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
        rows.append((places[world].double().numpy() - point[world, :2].numpy()) @ turn.T)
    return np.array(rows)


def test_exact_observations_off_road_tell_goal_motion_and_ranges():
    task = driving("off-road", 4, seed=2)
    for action in random_actions(task, 12):
        task.step(action)
    seen = task.observations()["policy"].double().numpy()
    goal = local(task, task.goal.unsqueeze(1))[:, 0]
    _, heading = task.pose()
    assert seen[:, :2] == pytest.approx(goal / 40.0, abs=1e-5)
    assert seen[:, 2] == pytest.approx(np.arctan2(goal[:, 1], goal[:, 0]) / math.pi, abs=1e-5)
    assert seen[:, 3] == pytest.approx(heading.sin().numpy(), abs=1e-5)
    assert seen[:, 4] == pytest.approx(heading.cos().numpy(), abs=1e-5)
    assert seen[:, 5] == pytest.approx(task.motion()[:, 0].numpy() / 8.0, abs=1e-5)
    assert seen[:, 10:12] == pytest.approx(task.action.numpy(), abs=1e-6)
    assert seen[:, -1] == pytest.approx(np.linalg.norm(goal, axis=1) / 40.0, abs=1e-5)
    # the ray straight ahead, and the ones 20 degrees to either side of it
    place, heading = task.pose()
    task.obstacles.place[:] = place[:, None, :2].float()
    task.obstacles.radius[:] = -1.0
    ahead = torch.stack([heading.cos(), heading.sin()], dim=1)
    left = torch.stack([-heading.sin(), heading.cos()], dim=1)
    task.obstacles.place[:, 0] += 10.0 * ahead
    task.obstacles.place[:, 1] += 10.0 * (math.cos(math.radians(40.0)) * ahead + math.sin(math.radians(40.0)) * left)
    task.obstacles.radius[:, :2] = 1.0
    near = task.observations()["policy"][:, 12:37]
    assert near.topk(2).indices.sort(dim=1).values.tolist() == [[12, 16]] * 4
    hit = (near > 0.0).nonzero()[:, 1].unique().tolist()
    assert hit == [12, 16]
    assert near[:, 12].tolist() == pytest.approx([1.0 - 9.0 / 20.0] * 4, abs=1e-4)


def test_exact_observations_of_the_convoy_tell_where_the_leaders_are():
    task = driving("convoy", 4, seed=2)
    for _ in range(6):
        task.step(held(task, 0.1, 0.3))
    seen = task.observations()["policy"].double().numpy()
    leaders = task.leaders(task.time())
    assert seen[:, :6].reshape(4, 3, 2) == pytest.approx(local(task, leaders[..., :2]) / 20.0, abs=1e-5)
    turn = (leaders[:, 0, 2] - task.pose()[1]).numpy()
    assert seen[:, 6] == pytest.approx(np.sin(turn), abs=1e-5)
    assert seen[:, 7] == pytest.approx(np.cos(turn), abs=1e-5)
    assert seen[:, 9] == pytest.approx(np.linalg.norm(seen[:, :2], axis=1), abs=1e-5)
    assert seen[:, 0].min() > 0.0  # ahead


@pytest.mark.parametrize("name", ["hallway", "barrier-track"])
def test_exact_observations_of_a_lane_tell_its_course(name):
    task = driving(name, 4, seed=2, speed=1.0 if name == "hallway" else 6.0)
    for _ in range(8):
        task.step(held(task, 0.2, 0.5))
    seen = task.observations()["policy"].double().numpy()
    aside, turn, _ = task.lane()
    arc, _ = task.routes.locate(task.route, task.pose()[0][:, :2])
    ahead = task.preview * torch.arange(1, 6)
    arcs = (arc.unsqueeze(1) + ahead).numpy()
    tracks = [task.tracks[route] for route in task.route.tolist()]
    places = torch.tensor(np.stack([track.at(row)[..., :2] for track, row in zip(tracks, arcs, strict=True)]))
    # the lane's points are those of the track, but for the chords of its turns
    assert seen[:, 3:13].reshape(4, 5, 2) == pytest.approx(local(task, places) / (5.0 * task.preview), abs=5e-3)
    assert seen[:, 0] == pytest.approx(aside.numpy() / task.lane_half, abs=1e-5)
    assert seen[:, 1] == pytest.approx(np.sin(turn.numpy()), abs=1e-5)


def test_the_next_two_pillars_are_those_that_are_not_passed():
    task = driving("obstacle-avoidance", 4, seed=2)
    pillars = to_torch(task.simulation.model.shape_x)[:, task.pillars]
    every = torch.ones(4, dtype=torch.bool)
    for x, following in ((0.0, (0, 1)), (27.9, (0, 1)), (28.2, (1, 2)), (60.0, (2, None)), (90.0, (None, None))):
        place = torch.tensor([[x, -2.0, 0.0]]).expand(4, -1)
        task.place_vehicle(every, place, torch.full((4,), 0.2))
        seen = task.observations()["policy"][:, 9:13].view(4, 2, 2).double().numpy() * 25.0
        for slot, index in enumerate(following):
            expected = [[50.0, 0.0]] * 4 if index is None else local(task, pillars[:, [index], :2])[:, 0]
            assert seen[:, slot] == pytest.approx(np.array(expected), abs=1e-3)


@pytest.mark.quick("vehicle")
@pytest.mark.parametrize("frame", ["vehicle", "world"])
def test_a_goal_is_measured_in_the_frame_that_is_asked_for(frame):
    off_road = driving("off-road", 4, seed=2, goal_frame=frame, obstacles=0, **SMALL)
    convoy = driving("convoy", 4, seed=2, place_frame=frame, **SMALL)
    for task, target, unit in (
        (off_road, off_road.goal, 40.0), (convoy, convoy.leaders(convoy.time())[:, 0, :2].double(), 20.0),
    ):  # fmt: skip
        seen = task.observations()["policy"][:, :2].double().numpy() * unit
        away = (target - task.pose()[0][:, :2]).numpy()
        expected = local(task, target.unsqueeze(1))[:, 0] if frame == "vehicle" else away
        assert seen == pytest.approx(expected, abs=0.5)  # the receiver's noise is 0.1 m
        assert np.abs(expected - (away if frame == "vehicle" else local(task, target.unsqueeze(1))[:, 0])).max() > 5.0


# ---- images ----------------------------------------------------------------------------------------------------


def pictures(task):
    """(W, height, width, 3) of the present state, as numbers."""
    task.simulation.begin_sensors(torch.ones(task.num_worlds, dtype=torch.bool))
    return to_torch(task.camera.data).int()


def pixels(points, task):
    """Where points (W, ..., 3) of the world appear, by the pinhole's rule: columns, rows, and how far ahead [m]."""
    chassis, config = task.parts.chassis, task.config
    focal = 0.5 * config.camera_width / math.tan(0.5 * config.camera_fov)
    mount = torch.tensor(np.asarray(task.camera_place) + task.parts.reference)
    places = points.double().reshape(task.num_worlds, -1, 3) - to_torch(task.simulation.state.body_x)[
        :, chassis
    ].unsqueeze(1)
    back = to_torch(task.simulation.state.body_rot)[:, chassis].double() * torch.tensor([-1.0, -1.0, -1.0, 1.0])
    x, y, z = (turned(back.unsqueeze(1), places) - mount).numpy().reshape(*points.shape).transpose(-1, *range(
        points.dim() - 1
    ))  # fmt: skip
    return 0.5 * config.camera_width - focal * y / x, 0.5 * config.camera_height - focal * z / x, x


def changed(first, second):
    """First and last column in which two images differ, (W, 2)."""
    different = (first != second).any(dim=3).any(dim=1)
    index = torch.arange(different.shape[1])
    low = torch.where(different, index, 9999).amin(dim=1)
    high = torch.where(different, index, -1).amax(dim=1)
    return torch.stack([low, high], dim=1).numpy()


def test_pillars_are_seen_where_they_stand_and_are_blue():
    task = driving("obstacle-avoidance", 3, obs="camera")
    pillars = to_torch(task.simulation.model.shape_x)[:, task.pillars[0] : task.pillars[0] + 3]
    pillars[:, :, 1] = 500.0
    empty = pictures(task).clone()
    pillars[:, 0, 1] = torch.tensor([4.0, 0.0, -5.0], dtype=torch.float64)
    full = pictures(task).clone()
    corners, _ = obstacle_corners(task)
    column, _, _ = pixels(corners[:, 0], task)
    span = changed(full, empty)
    # shadows of the sun fall to one side of the pillars: those of the image's upper half are none
    upper = changed(full[:, :20], empty[:, :20])
    assert upper[:, 0] == pytest.approx(column.min(axis=1), abs=1.0)
    assert upper[:, 1] == pytest.approx(column.max(axis=1) - 1.0, abs=1.0)
    assert span[0, 1] < 0.5 * WIDTH < span[2, 0]  # to the left, and to the right
    assert upper[1].mean() == pytest.approx(0.5 * WIDTH - 0.5, abs=1.0)
    blue = full[1, 10, WIDTH // 2]
    assert blue[2] > 2 * blue[0]
    assert blue[2] > 2 * blue[1]


def test_an_obstacle_off_road_is_seen_where_it_stands():
    task = driving("off-road", 3, obs="camera", seed=4, obstacles=3)
    point, heading = task.pose()
    count, angle = task.obstacles.count, torch.tensor([0.5, 0.0, -0.5])
    way = heading + angle
    place = (point[:, None, :2] + 12.0 * torch.stack([way.cos(), way.sin()], dim=1).unsqueeze(1)).float()
    place = place.expand(-1, count, -1)
    zero = torch.zeros(3, count)
    shown = []
    for present in (False, True):
        task.obstacles.fill(
            torch.ones(3, dtype=torch.bool), place, zero, zero, zero.long(), zero + 1.0,
            torch.full((3, count), present) & (torch.arange(count) == 0),
        )  # fmt: skip
        shown.append(pictures(task).clone())
    corners, there = obstacle_corners(task)
    assert there.sum(dim=1).tolist() == [1] * 3
    column, _, _ = pixels(corners[:, 0], task)
    # above the horizon, where no shadow falls; it is a little narrower there than at its foot
    upper = changed(*(image[:, : HEIGHT // 2] for image in shown))
    narrower = 0.2 * np.ptp(column, axis=1)
    for found, corner in ((upper[:, 0], column.min(axis=1)), (WIDTH - 1 - upper[:, 1], WIDTH - column.max(axis=1))):
        assert (found > corner - 1.5).all()
        assert (found < corner + 1.5 + narrower).all()
    assert upper[0, 1] < 0.5 * WIDTH < upper[2, 0]
    assert abs(upper[1].mean() - 0.5 * WIDTH) < 3.0
    rock = shown[1][1, HEIGHT // 2 - 1, WIDTH // 2].float()
    assert rock.max() < 1.5 * rock.min()  # grey
    sky = shown[1][:, 0].float().mean(dim=(0, 1))
    assert sky[2] > sky[0]  # blue


@pytest.mark.parametrize("rate", [None, 50.0])
def test_an_image_shows_the_leaders_at_its_own_moment(rate):
    task = driving("convoy", 2, obs="camera", seed=5, camera_rate=rate)
    task.episode_steps.fill_(100)  # 20 s later they drive some 3 m/s, here again before the truck
    task._begun -= (task.time() / DURATION).square()
    task.step(held(task))
    assert (2.0 * task.time() / DURATION**2 * task.routes.length[task.route]).min() > 2.0
    seen = task.observations()["camera"].int().clone()
    task.show_leaders(task.time())
    assert torch.equal(seen, pictures(task))
    task.show_leaders(task.time() - 0.05)
    assert not torch.equal(seen, pictures(task))


def test_leaders_are_seen_where_they_drive():
    task = driving("convoy", 3, obs="camera", seed=5, lost_distance=60.0)
    for _ in range(8):
        task.step(held(task, 0.0, 0.2))
    seen = task.observations()["camera"].int().clone()
    leaders = task.leaders(task.time())
    enabled = to_torch(task.scene().enabled)[:, task._ghosts]
    scene_x = to_torch(task.scene().x)[:, task._ghosts]
    assert (scene_x[..., :2] - leaders[..., :2]).norm(dim=2).max() < 1e-4  # float32 at some 100 m
    to_torch(task.scene().enabled)[:, task._ghosts] = 0
    without = pictures(task).clone()
    to_torch(task.scene().enabled)[:, task._ghosts] = enabled
    signs = torch.tensor([[x, y] for x in (-1.0, 1.0) for y in (-1.0, 1.0)]) * torch.tensor(LEADER_HALF[:2])
    cosine, sine = leaders[:, :1, 2].cos(), leaders[:, :1, 2].sin()
    outline = torch.stack(
        [
            leaders[:, :1, 0] + cosine * signs[:, 0] - sine * signs[:, 1],
            leaders[:, :1, 1] + sine * signs[:, 0] + cosine * signs[:, 1],
            torch.full((3, 4), 1.0),
        ],
        dim=2,
    )
    column, _, depth = pixels(outline, task)
    assert depth.min() > 5.0
    span = changed(seen[:, : HEIGHT // 2], without[:, : HEIGHT // 2])
    for world in range(3):
        low, high = np.clip([column[world].min(), column[world].max()], 0.0, WIDTH)
        middle = 0.5 * (low + high)
        assert span[world, 0] <= middle <= span[world, 1] + 1
        red = seen[world] - without[world]
        inside = red[: HEIGHT // 2, int(low) : max(int(high), int(low) + 1)]
        assert (inside != 0).any()


def test_cones_are_green_on_the_left_and_red_on_the_right():
    task = driving("hallway", 8, obs="camera", seed=1, start="straight")
    image = pictures(task).numpy()
    seen = {1.0: 0, -1.0: 0}
    for side in seen:
        feet = torch.tensor(task.tracks[0].marks(0.8, side))
        feet[:, 2] = 0.1  # of 0.25 m
        column, row, depth = pixels(feet.expand(8, -1, -1), task)
        inside = (depth > 0.6) & (depth < 1.8) & (column > 3) & (column < 157) & (row > 3) & (row < 78)
        for world, mark in zip(*np.nonzero(inside), strict=True):
            red, green, blue = image[world, int(row[world, mark]), int(column[world, mark])]
            seen[side] += 1
            assert green > 1.8 * red if side > 0.0 else red > 1.8 * green
            assert max(red, green) > 1.8 * blue
    assert min(seen.values()) >= 4


@pytest.mark.quick("hallway", "obstacle-avoidance")
@pytest.mark.parametrize("name", NAMES)
def test_an_image_is_of_the_moment_at_which_it_is_seen(name):
    task = driving(name, 2, seed=1, **SMALL)
    for action in random_actions(task, 5).abs():
        task.step(action)
        assert to_torch(task.camera.timestamp).tolist() == pytest.approx(to_torch(task.simulation.time).tolist())


def test_an_image_is_as_old_as_its_rate_says_and_no_older():
    slow = driving("barrier-track", 2, seed=1, **SMALL, camera_rate=5.0)
    images = [copied(slow.restart(seed=1))["camera"]]
    for action in random_actions(slow, 4).abs():
        images.append(copied(slow.step(action).observations)["camera"])
    same = [bool(torch.equal(first, second)) for first, second in itertools.pairwise(images)]
    assert same == [True, False, True, False]


@pytest.mark.slow
def test_the_vehicle_does_not_block_its_camera():
    for name in NAMES:
        task = driving(name, 1, seed=1, **SMALL)
        first = pictures(task).clone()
        enabled = task.scene().enabled
        body = [index for index, title in enumerate(task.scene().names) if title == "body" or title.startswith("wheel")]
        to_torch(enabled)[:, body] = 0
        share = float((pictures(task) != first).any(dim=3).float().mean())
        # the hood may be in sight at the lower edge, and its shadow on the road
        assert share < 0.35, name
        assert not (pictures(task) != first)[:, : first.shape[1] // 2].any(), name
        assert vehicle_corners(task).isfinite().all()
