"""What driving tasks are made of, against slow references and the truth: routes, fans of ranges, hills, navigation."""

import math

import numpy as np
import pytest
import torch

from simwarp.core.interop import to_torch
from simwarp.scenery.course import convoy_path, detour
from simwarp.scenery.tracks import indoor_track, race_track
from simwarp.tasks.driving.navigation import PLACE_NOISE, RATE_BIAS, RATE_NOISE, SPEED_NOISE
from simwarp.tasks.driving.ranging import RangeFan
from simwarp.tasks.driving.routes import Routes
from tests.reference.routes import first_hit, nearest_on_path, place_at
from tests.tasks.driving.driving_checks import (
    SMALL,
    driving,
    ground_heights,
    obstacle_corners,
    random_actions,
    turned,
)

CPU = torch.device("cpu")
# paths, step of the routes, how far aside, least radius of the turns [m]
ROUTES = {
    "convoy": ([convoy_path(index) for index in (0, 1, 6, 11)], 0.5, 4.0, 8.0),
    "detours": ([detour(seed).path for seed in range(3)], 0.5, 3.0, 8.0),
    "indoor": ([indoor_track(seed).path for seed in range(3)], 0.0625, 0.4, 0.8),
    "race": ([race_track(seed).path for seed in range(2)], 0.625, 6.0, 12.0),
}


@pytest.fixture(params=ROUTES)
def routed(request):
    paths, step, aside, radius = ROUTES[request.param]
    return Routes(paths, step, CPU), paths, step, aside, radius


def wrapped(angle):
    return np.arctan2(np.sin(angle), np.cos(angle))


def test_places_along_routes(routed):
    routes, paths, step, _, radius = routed
    rng = np.random.default_rng(0)
    for index, path in enumerate(paths):
        assert float(routes.length[index]) == pytest.approx(path.length, rel=1e-6)
        arc = np.concatenate([rng.uniform(-0.3, 1.4, 60) * path.length, [0.0, path.length]])
        at = routes.at(torch.tensor([index]), torch.tensor(arc, dtype=torch.float32)[None])[0].double().numpy()
        expected = np.array([place_at(path.points, path.closed, value) for value in arc])
        # a chord of the length of a step instead of the arc, twice (the path's own points are not nearer together),
        # and lengths of 500 m in float32; beyond an open end its direction counts: 0.01 rad over 0.4 lengths
        beyond = 0.0 if path.closed else 0.02 * np.maximum(np.abs(arc - 0.5 * path.length) - 0.5 * path.length, 0.0)
        assert (np.linalg.norm(at[:, :2] - expected, axis=1) < step**2 / (4.0 * radius) + 1e-3 + beyond).all()
        ahead, back = (
            np.array([place_at(path.points, path.closed, value + shift) for value in arc]) for shift in (step, -step)
        )
        way = np.arctan2(ahead[:, 1] - back[:, 1], ahead[:, 0] - back[:, 0])
        assert np.abs(wrapped(at[:, 2] - way)).max() < step / radius + 0.01


def test_headings_of_laps_have_no_jump():
    path = indoor_track(0).path
    routes = Routes([path], 0.0625, CPU)
    arc = torch.linspace(-path.length, 2.0 * path.length, 4000)[None]
    heading = routes.at(torch.tensor([0]), arc)[0, :, 2].double()
    assert heading.diff().abs().max() < 3.0 * path.length / 4000 / 0.8 + 0.06
    assert abs(float(heading[-1] - heading[0])) == pytest.approx(3.0 * 2.0 * math.pi, abs=0.01)


def beside(paths, aside, count, rng):
    """Places near paths: which path, and where."""
    route = rng.integers(0, len(paths), count)
    places = np.empty((count, 2))
    for row, index in enumerate(route):
        arc = rng.uniform(0.02, 0.98) * paths[index].length
        here, ahead = (place_at(paths[index].points, paths[index].closed, value) for value in (arc, arc + 0.05))
        way = (ahead - here) / np.linalg.norm(ahead - here)
        places[row] = here + rng.uniform(-aside, aside) * np.array([-way[1], way[0]])
    return route, places


def test_places_beside_routes_are_found(routed):
    routes, paths, step, aside, radius = routed
    route, places = beside(paths, aside, 200, np.random.default_rng(1))
    chosen, points = torch.tensor(route), torch.tensor(places)
    arc, left = (values.double().numpy() for values in routes.locate(chosen, points))
    away = routes.distance(chosen, points).double().numpy()
    for row, index in enumerate(route):
        path = paths[index]
        expected, off = nearest_on_path(path.points, places[row : row + 1])
        along = arc[row] - expected[0]
        if path.closed:
            along -= path.length * round(along / path.length)
        # seen from the nearest point of the route, half a step away: its tangent stands for the arc
        bend = 0.5 * step / radius
        assert abs(along) < 0.5 * step * abs(off[0]) / (radius - aside) + step * bend + 2e-3
        assert left[row] == pytest.approx(off[0], abs=step * bend + 0.5 * bend * bend * abs(off[0]) + 2e-3)
        assert abs(off[0]) - step * bend - 2e-3 < away[row] < math.hypot(off[0], 0.5 * step) + step * bend + 2e-3


def test_ranges_are_those_of_the_first_disc_met():
    rng = np.random.default_rng(2)
    reach, rays, width = 20.0, 25, math.radians(240.0)
    fan = RangeFan(rays, width, reach, CPU)
    places = rng.uniform(-25.0, 25.0, (6, 12, 2))
    radii = rng.uniform(0.3, 4.0, (6, 12))
    radii[:, ::5] = -1.0  # not there
    radii[5] = -1.0
    places[4, 1], radii[4, 1] = (0.5, 0.2), 2.0  # around the vehicle
    found = fan.ranges(torch.tensor(places).float(), torch.tensor(radii).float()).double().numpy()
    angles = np.linspace(-0.5 * width, 0.5 * width, rays)
    for world in range(6):
        for ray, angle in enumerate(angles):
            direction = np.array([math.cos(angle), math.sin(angle)])
            expected = first_hit(places[world], radii[world], direction, reach)
            assert found[world, ray] == pytest.approx(expected, abs=5e-3)
    assert (found[4] == 0.0).all()
    assert (found[5] == reach).all()


def test_a_fan_goes_from_right_to_left():
    fan = RangeFan(5, math.pi, 10.0, CPU)
    left = fan.ranges(torch.tensor([[[0.0, 5.0]]]), torch.tensor([[1.0]]))[0]
    assert left.tolist() == pytest.approx([10.0, 10.0, 10.0, 10.0, 4.0])
    assert RangeFan(1, math.pi, 10.0, CPU).ranges(torch.tensor([[[5.0, 0.0]]]), torch.tensor([[1.0]])).tolist() == [
        [4.0]
    ]


@pytest.fixture(scope="module")
def hilly():
    return driving("off-road", 16, seed=3, hills=1.0, hill_height=4.0)


def test_heights_of_hills_are_those_of_the_ground_that_tires_stand_on(hilly):
    rng = np.random.default_rng(3)
    places = rng.uniform(-79.9, 79.9, (16, 300, 2))
    found = hilly.hills.height(torch.tensor(places)).double().numpy()
    expected = ground_heights(hilly, places)
    assert np.ptp(expected) > 4.0
    # slopes of up to 0.5 and places of 80 m in float32
    assert np.abs(found - expected).max() < 1e-4
    shape = hilly.hills.shape
    model, terrain = hilly.simulation.model, hilly.vehicle.tires.terrain
    assert (model.shape_asset.numpy()[:, shape] == terrain.asset.numpy()).all()
    assert (model.shape_size.numpy()[:, shape] == terrain.scale.numpy()).all()
    assert len(set(terrain.asset.numpy().tolist())) > 3


def test_normals_of_hills_are_those_of_the_ground_around(hilly):
    places = np.random.default_rng(4).uniform(-60.0, 60.0, (16, 2))
    normal = hilly.hills.normal(torch.tensor(places)).double().numpy()
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0)
    ring = np.array([[math.cos(a), math.sin(a)] for a in np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)])
    around = places[:, None] + 1.2 * ring
    height = ground_heights(hilly, around)
    for world in range(16):
        # the plane of least squares through the ground around it
        rows = np.column_stack([around[world], np.ones(24)])
        slope = np.linalg.lstsq(rows, height[world], rcond=None)[0]
        plane = np.array([-slope[0], -slope[1], 1.0]) / np.linalg.norm([slope[0], slope[1], 1.0])
        # triangles of 1.5 m bend by 0.02 rad from one to the next
        assert math.acos(min(1.0, float(plane @ normal[world]))) < 0.02


def test_obstacles_are_within_the_discs_that_ranges_are_measured_to():
    task = driving("off-road", 16, obstacles=50, hills=1.0)
    corners, there = obstacle_corners(task)
    centre = task.obstacles.place.double()
    reach = (corners[..., :2] - centre.unsqueeze(2)).norm(dim=3).amax(dim=2)
    radius = task.obstacles.radius.double()
    assert (reach <= radius + 1e-4)[there].all()
    assert (radius[~there] < 0.0).all()
    # what is not there is under the ground, and what is there stands in it
    low, high = corners[..., 2].amin(dim=2), corners[..., 2].amax(dim=2)
    assert (high < -90.0)[~there].all()
    ground = torch.tensor(ground_heights(task, centre.numpy()))
    assert (low < ground + 1e-5)[there].all()  # the branches of a spruce begin on the ground
    assert (high > ground + 0.4)[there].all()


# ---- navigation ------------------------------------------------------------------------------------------------


def errors(task, steps):
    """Errors of place (steps, W, 2), heading (steps, W) and speed (steps, W); heading 0 after the first episode."""
    rows = []
    running = torch.ones(task.num_worlds)
    for action in random_actions(task, steps, seed=1):
        action[:, 1] = action[:, 1].abs() * (1.0 if task.name == "off-road" else 0.4)
        result = task.step(action)
        running *= result.end_reason < 0
        place, heading, speed = task.navigation.estimate()
        point, truth = task.pose()
        v, omega, rotation = (
            to_torch(getattr(task.simulation.state, name))[:, task.parts.chassis]
            for name in ("body_v", "body_omega", "body_rot")
        )
        arm = turned(rotation, torch.tensor(task.parts.reference).expand(task.num_worlds, -1))
        velocity = v + torch.linalg.cross(omega, arm.float())
        measured = to_torch(task.navigation.sensors[0].position)
        # no older than the state: in float32 and in degrees of latitude, but for a millimetre
        assert (measured[:, :2] - point[:, :2]).norm(dim=1).max() < 2e-3
        turn = (heading - truth).double()
        turn = running * torch.atan2(turn.sin(), turn.cos())
        rows.append((place - point[:, :2], turn, speed - velocity[:, :2].norm(dim=1)))
    assert running.sum() >= 0.5 * task.num_worlds
    return [torch.stack(parts) for parts in zip(*rows, strict=True)]


@pytest.mark.quick("convoy")
@pytest.mark.parametrize("name", ["off-road", "convoy"])
def test_navigation_errs_as_much_as_it_says(name):
    options = {"obstacles": 0, "border": 70.0} if name == "off-road" else {"lost_distance": 60.0}
    task = driving(name, 12, seed=2, **SMALL, **options)
    steps = 40 if name == "off-road" else 20
    place, heading, speed = errors(task, steps)
    count = place.numel()
    # standard deviations and means of that many numbers: five sigma
    assert float(place.std()) == pytest.approx(PLACE_NOISE, rel=5.0 / math.sqrt(2.0 * count))
    assert abs(float(place.mean())) < 5.0 * PLACE_NOISE / math.sqrt(count)
    lag = torch.stack([place[1:], place[:-1]]).flatten(1)
    assert abs(float(torch.corrcoef(lag)[0, 1])) < 5.0 / math.sqrt(count)
    assert float(speed[steps // 2 :].std()) == pytest.approx(SPEED_NOISE, rel=0.3)
    period = task.config.control_dt
    time = period * (torch.arange(steps) + 1.0)
    bound = torch.sqrt((RATE_BIAS * time) ** 2 + RATE_NOISE**2 * period * time)
    # turning round with a body that leans by 0.05 rad adds a thousandth of the turn
    assert (heading.abs() < 4.5 * bound.unsqueeze(1) + 5e-3).all()
    assert heading.abs().max() > 0.5 * bound[steps // 2]


def test_navigation_on_hills_knows_the_heading_to_a_few_degrees():
    task = driving("off-road", 12, seed=2, **SMALL, obstacles=0, border=70.0, hills=1.0)
    _, heading, _ = errors(task, 25)
    # on slopes of up to 0.3 rad yaw is not the turn of the heading
    assert heading[0].abs().max() < 0.03
    assert heading.abs().max() < 0.15


@pytest.mark.quick("convoy")
@pytest.mark.parametrize("name", ["off-road", "convoy"])
def test_a_new_episode_begins_with_its_heading_known(name):
    task = driving(name, 6, seed=2, **SMALL, max_episode_steps=4)
    for action in random_actions(task, 4, seed=1):
        result = task.step(action)
    assert bool((result.end_reason >= 0).all())
    _, truth = task.pose()
    turn = task.navigation.heading - truth
    # float32, after turns that ended anywhere
    assert torch.atan2(turn.sin(), turn.cos()).abs().max() < 1e-5
