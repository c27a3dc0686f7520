# mypy: disable-error-code="index"
"""Drivers: the kernels against slow references in float64, worlds that do not see each other, paths driven, resets."""

import dataclasses
import math

import numpy as np
import pytest
import warp as wp

from simwarp.core.types import ModelError, pose
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.maneuvers import lane_change_path
from simwarp.vehicle.driving.path_tracking import (
    InteractiveDriver,
    LookAhead,
    PathTracker,
    PathTrackingSpec,
    PIDGains,
    Stanley,
    Unicycle,
    look_ahead_for,
)
from simwarp.vehicle.driving.paths import Path, bezier, circle, path_tables, read_path, smooth
from simwarp.vehicle.paths_kernels import PathTables, nearest_on_path
from simwarp.vehicle.placing import place_vehicle
from simwarp.vehicle.results.chassis_motion import matrices
from simwarp.vehicle.results.results import deviation
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import SpecError
from simwarp.vehicle.vehicle import Vehicle, per_world
from tests.reference.drivers import TrackingReference, approach, nearest

GATOR, HMMWV = load_vehicle("gator"), load_vehicle("hmmwv")
EIGHT = np.stack([40 * np.sin(np.linspace(0, 2 * np.pi, 81)), 20 * np.sin(np.linspace(0, 4 * np.pi, 81))], axis=1)[:-1]
"""Crosses itself at the origin."""
PATHS = (
    circle(25.0),
    circle(-12.0, start=(3.0, -1.0)),
    lane_change_path(20.0),
    smooth(EIGHT, closed=True),
    Path(np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [0.0, 30.0]]), closed=True),
)


def build(spec, worlds, x=(0.0, 0.0)):
    """Vehicle and model, at rest."""
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec, at=pose((*x, spec.start_height)))
    model = builder.finalize(world_count=worlds, device="cpu", per_world=per_world())
    return Vehicle(parts, model), model


def frame_of(sim, vehicle, world):
    """Place, axes, forward speed and yaw rate of a vehicle's frame of reference."""
    state, parts = sim.state, vehicle.parts
    rotation = matrices(state.body_rot.numpy()[world, parts.chassis].astype(float))
    arm = rotation @ parts.reference
    v = state.body_v.numpy()[world, parts.chassis].astype(float)
    omega = state.body_omega.numpy()[world, parts.chassis].astype(float)
    speed = (v + np.cross(omega, arm)) @ rotation[:, 0]
    return state.body_x.numpy()[world, parts.chassis] + arm, rotation, speed, omega @ rotation[:, 2]


# ---- paths -----------------------------------------------------------------------------------------------------------


@wp.kernel
def search(
    paths: PathTables, path: wp.array[int], hint: wp.array[int], x: wp.array[wp.vec2d],
    segment: wp.array[int], found: wp.array2d[float],
):  # fmt: skip
    k = wp.tid()
    point = nearest_on_path(path[k], hint[k], x[k], paths)
    segment[k] = point.segment
    found[k, 0] = point.distance
    found[k, 1] = point.arc
    found[k, 2] = point.curvature
    found[k, 3] = point.tangent[0]
    found[k, 4] = point.tangent[1]


def searched(path, hint, x):
    """Segment and (distance, arc, curvature, tangent) of many places at once."""
    n = len(x)
    segment, found = wp.zeros(n, dtype=int, device="cpu"), wp.zeros((n, 5), dtype=float, device="cpu")
    wp.launch(
        search, dim=n, device="cpu",
        inputs=[
            path_tables(PATHS, "cpu"), wp.array(path, dtype=int, device="cpu"),
            wp.array(hint, dtype=int, device="cpu"), wp.array(x, dtype=wp.vec2d, device="cpu"), segment, found,
        ],
    )  # fmt: skip
    return segment.numpy(), found.numpy()


def test_search_agrees_with_the_reference_near_and_far_from_where_it_was():
    rng = np.random.default_rng(5)
    path = np.arange(400) % len(PATHS)
    x = rng.uniform(-50.0, 50.0, (400, 2))
    hint = np.array([rng.integers(-1, len(PATHS[p].points) - 1) for p in path])
    hint[:100] = -1
    segment, found = searched(path, hint, x)
    for k in range(400):
        truth = nearest(PATHS[path[k]], int(hint[k]), x[k])
        expected = [truth.distance, truth.arc, truth.curvature, *truth.tangent]
        if segment[k] != truth.segment:
            # two segments as far within rounding: at corners, or in the middle of a circle
            assert abs(abs(truth.distance) - abs(found[k, 0])) < 1e-4
            continue
        assert found[k] == pytest.approx(expected, rel=2e-5, abs=2e-5)


def test_distance_arc_and_curvature_of_a_circle():
    angle = np.linspace(0.1, 6.0, 40)
    for radius, index in ((25.0, 0), (-12.0, 1)):
        side = math.copysign(1.0, radius)
        size = abs(radius) - 2.0  # two metres inside
        center = np.array([0.0, radius]) + (np.array([3.0, -1.0]) if index else 0.0)
        x = center + size * np.stack([np.sin(angle), -side * np.cos(angle)], axis=1)
        _, found = searched([index] * 40, [-1] * 40, x)
        assert found[:, 0] == pytest.approx(2.0 * side, abs=0.01)
        assert found[:, 1] == pytest.approx(abs(radius) * angle, abs=0.05)
        assert found[:, 2] == pytest.approx(1.0 / radius, rel=1e-3)
        assert found[:, 3] == pytest.approx(np.cos(angle), abs=0.02)


def test_search_stays_on_its_branch_where_a_path_crosses_itself():
    path = PATHS[3]
    hint, arcs = -1, []
    # a quarter of a metre beside the path; the crossing is passed twice, in two directions
    normal = path.tangents() @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    for point, left in zip(path.points[5:-5], normal[5:-5], strict=True):
        segment, found = searched([3], [hint], [point + 0.25 * left])
        hint = int(segment[0])
        arcs.append(found[0, 1])
        assert found[0, 0] == pytest.approx(0.25, abs=0.02)
    assert np.all(np.diff(arcs) > 0.0)
    assert arcs[-1] - arcs[0] > 0.9 * path.length


def test_loops_go_round_and_open_paths_go_straight_on():
    square, lane = PATHS[4], PATHS[2]
    last = len(square.points) - 2
    segment, found = searched([4, 4], [last, 0], [(2.0, 0.3), (-0.3, 28.0)])
    assert segment.tolist() == [0, last]
    assert found[:, 0] == pytest.approx([0.3, -0.3])
    segment, found = searched([2, 2], [-1, -1], [(-7.0, 0.5), (200.0, -0.5)])
    assert found[:, 0] == pytest.approx([0.5, -0.5], abs=1e-4)
    assert found[:, 1] == pytest.approx([-7.0, lane.length + 200.0 - lane.points[-1, 0]], abs=1e-3)


def test_path_files(tmp_path):
    file = tmp_path / "path.txt"
    file.write_text("4 3\n0 0 0.1\n10 0 0\n20 5 0\n30 5 0\n")
    path = read_path(file)
    assert np.diff(path.arc).max() < 0.6
    for point in ((0, 0), (10, 0), (20, 5), (30, 5)):
        assert np.linalg.norm(path.points - np.array(point), axis=1).min() < 1e-12
    # continuous curvature: no corner anywhere, none at the ends
    assert np.abs(np.diff(path.curvature())[2:-2]).max() < 0.02
    assert abs(path.curvature()[0]) < 0.02
    file.write_text("2 9\n0 0 0 -1 0 0 5 0 0\n10 10 0 10 5 0 10 11 0\n")
    curve = read_path(file, spacing=0.1)
    assert curve.tangents()[0] == pytest.approx([1.0, 0.0], abs=0.02)
    assert curve.tangents()[-1] == pytest.approx([0.0, 1.0], abs=0.02)
    half = 0.125 * (np.array([0, 0]) + 3 * np.array([5, 0]) + 3 * np.array([10, 5]) + np.array([10, 10]))
    assert np.linalg.norm(curve.points - half, axis=1).min() < 0.06


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "line 1 must be"),
        ("3 4\n", "line 1 must be"),
        ("3 3\n0 0 0\n1 0 0\n", "must hold 3 points"),
        ("2 3\n0 0 0\n1 0\n", "point 2 must be 3 numbers"),
        ("2 3\n0 0 0\n1 0 x\n", "point 2 must be 3 numbers"),
        ("2 9\n0 0 0\n1 0 0\n", "point 1 must be 9 numbers"),
        ("2 3\n1 0 0\n1 0 0\n", "must differ"),
    ],
)
def test_a_path_file_with_a_mistake_is_one_error(tmp_path, text, words):
    file = tmp_path / "path.txt"
    file.write_text(text)
    with pytest.raises(SpecError, match=words):
        read_path(file)


def test_paths_of_nothing_are_refused(tmp_path):
    with pytest.raises(SpecError, match="cannot be read"):
        read_path(tmp_path / "none.txt")
    for points in (np.zeros((1, 2)), np.zeros((2, 3)), np.array([[0.0, 0.0], [np.nan, 1.0]])):
        with pytest.raises(SpecError, match="two or more finite points"):
            Path(points)
    with pytest.raises(SpecError, match="other than zero"):
        circle(0.0)
    with pytest.raises(SpecError, match="one or more"):
        PathTrackingSpec(paths=(), speed=1.0)
    with pytest.raises(SpecError, match="speed"):
        PathTrackingSpec(paths=PATHS, speed=-1.0)
    with pytest.raises(SpecError, match="derivative"):
        PathTrackingSpec(paths=PATHS, speed=1.0, steering=Stanley(gains=PIDGains(proportional=1.0, derivative=1.0)))


def test_a_closed_smooth_path_has_no_seam():
    ring = smooth(np.array([[10.0, 0.0], [0.0, 10.0], [-10.0, 0.0], [0.0, -10.0]]), closed=True, spacing=0.1)
    assert ring.points[0] == pytest.approx(ring.points[-1])
    assert ring.curvature()[0] == pytest.approx(ring.curvature()[-1])
    assert ring.curvature() == pytest.approx(0.1, rel=0.4)
    assert isinstance(bezier(ring.points[:2], ring.points[:2], ring.points[:2]), Path)


# ---- path tracking against its reference ----------------------------------------------------------------------------

PID_SPEC = PathTrackingSpec(
    paths=PATHS, speed=5.0,
    steering=LookAhead(distance=3.0, gains=PIDGains(proportional=0.3, integral=0.1, derivative=0.05)),
    speed_gains=PIDGains(proportional=0.4, integral=0.2, derivative=0.01), start=0.05, ramp=0.5,
)  # fmt: skip
STANLEY_SPEC = dataclasses.replace(
    PID_SPEC, ramp=0.0,
    steering=Stanley(axle=1.0, gains=PIDGains(proportional=2.0, integral=0.3), dead_zone=0.05, full_angle=0.4),
)  # fmt: skip
UNICYCLE_SPEC = dataclasses.replace(
    PID_SPEC,
    steering=Unicycle(full_yaw_rate=1.5, approach=4.0, center=0.5, gains=PIDGains(proportional=0.2, integral=0.3)),
)


@pytest.mark.quick("stanley")
@pytest.mark.parametrize("spec", [PID_SPEC, STANLEY_SPEC, UNICYCLE_SPEC], ids=["look-ahead", "stanley", "unicycle"])
def test_trackers_agree_with_their_reference(spec):
    worlds, dt = len(PATHS), 2e-3
    vehicle, model = build(GATOR, worlds)
    driver = PathTracker(vehicle, spec)
    driver.path.assign(np.arange(worlds, dtype=np.int32))
    speeds = np.array([5.0, 3.0, 4.0, 6.0, 0.5])
    driver.target_speed.assign(speeds.astype(np.float32))
    sim = Simulation(model, dt, elements=[driver, vehicle])
    references = [TrackingReference(spec, PATHS[world], speeds[world]) for world in range(worlds)]
    seen = []
    for step in range(1500):
        if step == 700:
            # slow down: throttles close, then brakes come
            speeds = 0.3 * speeds
            driver.target_speed.assign(speeds.astype(np.float32))
            for truth, speed in zip(references, speeds, strict=True):
                truth.target = speed
        time = float(sim.time.numpy()[0])
        expected = [truth.step(dt, time, *frame_of(sim, vehicle, world)) for world, truth in enumerate(references)]
        sim.step()
        inputs = vehicle.input.numpy()[:, :3].copy()
        # single precision of speeds and distances, and an integral over 1500 steps of it
        assert inputs == pytest.approx(np.array(expected), abs=2e-3), step
        seen.append(inputs)
    history = np.array(seen)
    assert np.abs(history[:, :, 0]).max() > 0.1
    assert history[100:, :, 1].max() > 0.5
    assert history[700:, :, 2].max() > 0.05


def test_worlds_do_not_see_each_other():
    def drive(count, which):
        vehicle, model = build(GATOR, count)
        driver = PathTracker(vehicle, PID_SPEC)
        driver.path.assign(np.array(which, dtype=np.int32))
        sim = Simulation(model, 2e-3, elements=[driver, vehicle])
        for _ in range(600):
            sim.step()
        return vehicle.input.numpy().copy(), sim.state.body_x.numpy().copy()

    inputs, x = drive(4, [0, 1, 3, 1])
    for world, path in enumerate((0, 1, 3)):
        alone_inputs, alone_x = drive(1, [path])
        assert np.array_equal(inputs[world], alone_inputs[0])
        assert np.array_equal(x[world], alone_x[0])
    assert np.array_equal(x[1], x[3])
    assert not np.array_equal(x[0], x[1])


# ---- driving ---------------------------------------------------------------------------------------------------------


@pytest.mark.quick("look-ahead")
@pytest.mark.parametrize("law", ["look-ahead", "stanley"])
def test_an_hmmwv_follows_a_circle(law):
    """Either law stays within 0.5 m of a circle of 30 m: a proportional law keeps what it needs to steer 0.23."""
    steering = look_ahead_for(HMMWV) if law == "look-ahead" else Stanley(axle=HMMWV.axles[0].location[0])
    run = followed(circle(30.0), steering, 8.0, 35.0)
    assert deviation(run, circle(30.0)).max() < 0.5
    assert run["speed_mps"][-1] == pytest.approx(8.0, abs=0.1)
    # more than once around
    assert np.trapezoid(run["speed_mps"], run["t_s"]) > 2.0 * math.pi * 30.0


@pytest.mark.quick("stanley")
@pytest.mark.parametrize("law", ["look-ahead", "stanley"])
def test_an_hmmwv_follows_a_lane_change(law):
    """12 m/s through ISO 3888-1, whose lanes leave 0.5 m to a side of a vehicle of 2.2 m and less."""
    steering = look_ahead_for(HMMWV, 0.5, 12.0) if law == "look-ahead" else Stanley(axle=HMMWV.axles[0].location[0])
    path = lane_change_path(100.0)
    run = followed(path, steering, 12.0, 24.0)
    assert run["x_m"][-1] > 225.0
    assert deviation(run, path).max() < 0.45
    assert abs(run["y_m"][-1]) < 0.05
    assert run["y_m"].max() == pytest.approx(3.5, abs=0.45)


def followed(path, steering, speed, duration):
    """A run of an HMMWV along a path."""
    from simwarp.vehicle.driving.maneuver_spec import Maneuver

    follow = PathTrackingSpec(
        paths=(path,), speed=speed, steering=steering, speed_gains=PIDGains(proportional=0.5, integral=0.1), start=1.0
    )
    what = Maneuver(name="follow", follow=follow, duration=duration)
    return Drive(set_up(HMMWV, what, device="cpu", dt=2e-3)).run()


# ---- memory ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spec", [PID_SPEC, STANLEY_SPEC, UNICYCLE_SPEC], ids=["look-ahead", "stanley", "unicycle"])
def test_a_reset_restores_what_a_tracker_remembers(spec):
    vehicle, model = build(GATOR, 3)
    driver = PathTracker(vehicle, spec)
    sim = Simulation(model, 2e-3, elements=[driver, vehicle])

    def go(steps):
        for _ in range(steps):
            sim.step()
        return {name: array.numpy().copy() for name, array in {**driver.memory, "input": vehicle.input}.items()}

    first = go(400)
    assert np.abs(first["steering_sum"]).min() > 0.0
    sim.reset(np.array([True, False, True]))
    assert driver.memory["segment"].numpy().tolist() == [-1, first["segment"][1], -1]
    assert driver.memory["steering_sum"].numpy()[0] == 0.0
    again = go(400)
    for name, values in first.items():
        assert np.array_equal(again[name][[0, 2]], values[[0, 2]]), name
    assert again["arc"][1] > first["arc"][1]
    shot = sim.snapshot()
    onward = go(200)
    sim.restore(shot)
    repeated = go(200)
    for name, values in onward.items():
        assert np.array_equal(repeated[name], values), name


# ---- interactive -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("gain", "rate"),
    [(4.0, None), (None, (2.0, 1.0, 0.5, 4.0)), ((4.0, 8.0, 2.0, 1.0), 1.5), (None, None), (0.0, None)],
)
def test_interactive_inputs_lag_as_their_reference_does(gain, rate):
    vehicle, model = build(GATOR, 2)
    driver = InteractiveDriver(vehicle, gain=gain, rate=rate)
    sim = Simulation(model, 5e-3, elements=[driver, vehicle])
    rng = np.random.default_rng(3)
    value = np.zeros((2, 4))
    four_gain = np.broadcast_to(np.inf if gain is None else gain, (4,)).astype(float)
    four_rate = np.broadcast_to(np.inf if rate is None else rate, (4,)).astype(float)
    for step in range(120):
        if step % 40 == 0:
            target = rng.uniform(-1.5, 1.5, (2, 4))
            driver.target.assign(target.astype(np.float32))
        value = np.array([approach(v, t, four_gain, four_rate, 5e-3) for v, t in zip(value, target, strict=True)])
        sim.step()
        assert vehicle.input.numpy() == pytest.approx(value, abs=1e-5)
    sim.reset()
    assert not vehicle.input.numpy().any()
    assert not driver.target.numpy().any()


def test_interactive_rates_are_checked():
    vehicle, _ = build(GATOR, 1)
    for wrong in (-1.0, float("nan"), (1.0, 2.0, -3.0, 4.0)):
        with pytest.raises(SpecError, match="rate"):
            InteractiveDriver(vehicle, rate=wrong)


def test_a_vehicle_that_is_placed_elsewhere_is_on_the_nearest_part_of_its_path():
    """On the way back of a hairpin, 100 m along the path from where it settled; world 0 stays at its beginning."""
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 40)
    bend = np.stack([200.0 + 15.0 * np.cos(turn), 15.0 + 15.0 * np.sin(turn)], axis=1)
    hairpin = Path(np.concatenate([[[0.0, 0.0], [200.0, 0.0]], bend[1:], [[0.0, 30.0]]]))
    builder = ModelBuilder()
    parts = add_vehicle(builder, HMMWV, at=pose((0.0, 0.0, HMMWV.start_height)))
    vehicle = Vehicle(parts, builder.finalize(2, "cpu", per_world=per_world()))
    tracker = PathTracker(vehicle, PathTrackingSpec(paths=(hairpin,), speed=5.0))
    sim = Simulation(vehicle.model, 2e-3, elements=[tracker, vehicle])
    sim.step(50)
    sim.keep_as_initial()
    sim.reset()
    before = tracker.arc.numpy()[0]
    place_vehicle(sim, vehicle, [(0.0, 0.0), (150.0, 30.0)], [0.0, np.pi], world_mask=[False, True])
    sim.step()
    assert abs(tracker.distance.numpy()).max() < 0.05
    # 200 m there, half a circle of 15 m, 50 m back; steered is the point 5 m ahead
    assert tracker.arc.numpy()[1] == pytest.approx(200.0 + 15.0 * np.pi + 50.0 + 5.0, abs=0.3)
    assert tracker.arc.numpy()[0] == pytest.approx(before, abs=0.1)
    with pytest.raises(ModelError, match=r"restart: world_mask must have shape \(2,\) .*got \(3,\); give one bool"):
        tracker.restart([True] * 3)
