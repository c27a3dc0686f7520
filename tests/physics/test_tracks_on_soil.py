"""Shoes press the soil: loads, sinkage by Bekker's law, ruts, and what a soil leaves of the grip."""

import dataclasses

import numpy as np
import pytest

import simwarp as sw
from simwarp.soil import PRESETS, pads_of, soil_under_tracks
from simwarp.vehicle import TRACK_SOLVER, TrackedVehicle, add_tracked_vehicle, load_tracked_vehicle
from simwarp.vehicle.vehicle import per_world

SPEC = load_tracked_vehicle("m113")
WEIGHT = 11342.94 * 9.81


def on_soil(soil, worlds=1):
    builder = sw.ModelBuilder()
    parts = add_tracked_vehicle(builder, SPEC)
    model = builder.finalize(worlds, "cpu", per_world=per_world(), contact_capacity=300)
    vehicle = TrackedVehicle(parts, model)
    below = soil_under_tracks(vehicle, soil)
    solver = dataclasses.replace(TRACK_SOLVER, max_iterations=30)
    return sw.Simulation(model, 1e-3, elements=[vehicle, below], solver=solver, check_start=False), vehicle, below


def test_each_shoe_has_its_pads():
    _, vehicle, below = on_soil("mid")
    boxes = pads_of(vehicle)
    assert len(boxes) == 2 * (63 + 64) == len(below.shapes)
    width = max(abs(box.pose.position[1]) + box.half[1] for box in boxes)
    assert 2.0 * width == pytest.approx(0.379, abs=1e-3)  # of the M113's shoe


@pytest.mark.slow
@pytest.mark.parametrize("soil", ["mid", "hard"])
def test_soil_bears_the_weight_and_tracks_sink_as_plates_do(soil):
    """Uniform pressure of plates as long and wide as the tracks gives Bekker's least sinkage. The most: two shoes below
    each wheel carry all by their middle pads, and twice the weight, as of a load that is let go."""
    sim, vehicle, below = on_soil(soil)
    sim.step(3000)
    loads = []
    for _ in range(100):
        sim.step(5)
        loads.append(float(below.load.numpy().sum()))
    assert np.mean(loads) == pytest.approx(WEIGHT, rel=0.02)  # it still rocks on its torsion bars
    spec, length, width = PRESETS[soil], 2.667, 0.379  # between the first and the last road wheel's axis
    even = (WEIGHT / (2 * length * width * (spec.k_c / width + spec.k_phi))) ** (1.0 / spec.exponent)
    x, y, _ = SPEC.left.shoe.ground_pad.size
    most = (2.0 * WEIGHT / (20 * x * y * (spec.k_c / x + spec.k_phi))) ** (1.0 / spec.exponent)
    sinkage = below.sinkage.numpy()[0][below.load.numpy()[0] > 100.0]
    assert even < sinkage.max() < most
    assert vehicle.angles.numpy()[0, 0] == pytest.approx(0.0, abs=0.02)


@pytest.mark.slow
def test_soft_soil_leaves_less_grip_and_keeps_ruts():
    """Full throttle on soils of rising strength: never faster on the softer one; the ground behind stays pressed."""
    reached = {}
    for soil in ("soft", "hard"):
        sim, vehicle, _ = on_soil(soil)
        sim.step(1500)
        vehicle.input.assign(np.array([[0.0, 1.0, 0.0, 0.0]], np.float32))
        sim.step(2500)
        reached[soil] = float(vehicle.velocity_b.numpy()[0, 0])
        track = 0.245 * vehicle.sprocket_speed.numpy()[0].mean()
        assert 0.0 < reached[soil] < 1.1 * track, "tracks slip backwards, or roll"
        assert sim.diagnostics.position_error.numpy().max() < 1e-4
    assert reached["soft"] < reached["hard"]


def test_worlds_on_soil_do_not_matter_to_each_other():
    sim, vehicle, _ = on_soil("mid", worlds=2)
    alone, single, _ = on_soil("mid")
    rows = np.array([[0.0, 1.0, 0.0, 0.0], [0.3, 0.0, 1.0, 0.0]], np.float32)
    vehicle.input.assign(rows)
    single.input.assign(rows[:1])
    for each in (sim, alone):
        each.step(40)
    np.testing.assert_array_equal(sim.state.body_x.numpy()[0], alone.state.body_x.numpy()[0])
