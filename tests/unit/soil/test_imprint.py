"""Shapes pressed into fresh soil where they stand: nothing falls when an episode begins."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.core.types import ShapeType
from simwarp.soil import PRESETS, Soil, SoilBox, soil_under
from simwarp.vehicle import VEHICLE_SOLVER, Vehicle, add_vehicle, load_vehicle, per_world, place_vehicle, with_options
from simwarp.vehicle.tires.tires import ground
from tests.unit.soil.test_soil_shapes import ant_on_soil, hold

BOX = (0.2, 0.15, 0.1)


def settled(worlds=2, soil="mid", seconds=3.0, **options):
    """A HMMWV that came to rest on soil, with its brakes on."""
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, with_options(load_vehicle("hmmwv"), tire="soil-rigid"))
    model = builder.finalize(worlds, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model)
    element = soil_under(vehicle, soil, pages=256, **options)
    simulation = sw.Simulation(model, 1e-3, elements=[vehicle, element], solver=VEHICLE_SOLVER, threads=1)
    vehicle.input.assign(np.tile([0.0, 0.0, 1.0, 0.0], (worlds, 1)))
    simulation.step(round(1000 * seconds))
    element.keep_forces()
    return simulation, vehicle, element


def moved_in(simulation, vehicle, seconds=1.0):
    """Greatest way of the chassis from where it is [m], (W,)."""
    start = simulation.state.body_x.numpy()[:, vehicle.parts.chassis].copy()
    most = np.zeros(len(start))
    for _ in range(round(10 * seconds)):
        simulation.step(100)
        way = np.linalg.norm(simulation.state.body_x.numpy()[:, vehicle.parts.chassis] - start, axis=1)
        most = np.maximum(most, way)
    return most


@pytest.mark.parametrize("soil", ["soft", "mid", "hard", "clay"])
def test_a_vehicle_that_was_moved_stays_at_rest(soil):
    simulation, vehicle, element = settled(soil=soil)
    place = np.array([[20.013, 7.021], [-11.0, 3.3]])
    place_vehicle(simulation, vehicle, place, np.array([0.7, -2.0]))
    kept = simulation.snapshot()
    element.imprint()
    # what is promised is 1 mm; nodes lie otherwise below the wheels than where they settled
    moved = moved_in(simulation, vehicle).max()
    assert moved < 0.1e-3
    simulation.restore(kept)
    assert moved_in(simulation, vehicle).max() > 4.0 * moved  # without, it shifts, on soft soil by 9 mm


def test_another_soil_bears_it_at_the_same_depth():
    """Randomised soils: of each what carries the vehicle where it stands."""
    simulation, vehicle, element = settled(worlds=3, per_world=True)
    values = element.parameter.numpy()
    for world, soil in enumerate(("soft", "mid", "hard")):
        values[world] = PRESETS[soil].values()
    element.parameter.assign(values)
    place_vehicle(simulation, vehicle, np.tile([5.0, 9.0], (3, 1)), 1.0)
    kept = simulation.snapshot()
    element.imprint()
    assert moved_in(simulation, vehicle).max() < 1e-3
    simulation.restore(kept)
    assert moved_in(simulation, vehicle)[0] > 0.1  # without, it falls into the soft soil


def test_resting_shifts_are_the_way_to_the_depth_of_another_soil():
    """Lowered by them and pressed in, the vehicle stands as deep as one that settled on that soil."""
    simulation, vehicle, element = settled(worlds=2, per_world=True)
    values = element.parameter.numpy()
    for world, soil in enumerate(("soft", "mid")):
        values[world] = PRESETS[soil].values()
    element.parameter.assign(values)
    place_vehicle(simulation, vehicle, np.tile([5.0, 9.0], (2, 1)), 1.0)
    shifts = element.resting_shifts().numpy().copy()
    x = simulation.state.body_x.numpy()
    x[:, :, 2] += shifts.mean(axis=1)[:, None]
    simulation.state.body_x.assign(x)
    simulation.measure()
    element.imprint()
    assert moved_in(simulation, vehicle).max() < 1e-3
    # what quadrature says of 6300 N; dropped, a vehicle sinks deeper
    depths = element.sinkage.numpy().mean(axis=1)
    assert depths == pytest.approx([0.248, 0.0565], rel=0.03)


def test_worlds_that_are_not_in_the_mask_stay_bit_by_bit():
    simulation, vehicle, element = settled(worlds=4)
    plain, _, _ = settled(worlds=4)
    place_vehicle(simulation, vehicle, np.array([8.0, 8.0]), 0.3, [False, False, True, False])
    element.imprint([False, False, True, False])
    for each in (simulation, plain):
        each.step(200)
    for world in (0, 1, 3):
        np.testing.assert_array_equal(simulation.state.body_x.numpy()[world], plain.state.body_x.numpy()[world])


def test_a_recorded_imprint_reads_its_mask_when_it_runs():
    simulation, vehicle, element = settled(worlds=2)
    place_vehicle(simulation, vehicle, np.array([8.0, 8.0]), 0.3)
    mask: wp.array = wp.array([False, False], dtype=wp.bool, device="cpu")
    launches = element.record_imprint(simulation, mask)
    kept = simulation.snapshot()
    mask.assign(np.array([False, True]))
    for launch in launches:
        launch.launch()
    assert (moved_in(simulation, vehicle) < 1e-3).tolist() == [False, True]
    recorded = simulation.state.body_x.numpy()[1].copy()
    simulation.restore(kept)
    element.imprint(np.array([False, True]))
    moved_in(simulation, vehicle)
    np.testing.assert_array_equal(simulation.state.body_x.numpy()[1], recorded)


def test_a_box_stays_on_a_height_field_that_leans():
    """Settled on flat ground, laid on a slope of 10 % in its settled depth."""
    lean = math.atan(0.1)
    x = np.linspace(-10.0, 10.0, 41)
    builder = sw.ModelBuilder()
    body = builder.add_body("box", mass=60.0, inertia=(1.0, 1.0, 1.5), pose=sw.pose((0.0, 0.0, 0.1)))
    slope = builder.add_height_field_asset(np.tile(-np.tan(lean) * np.maximum(x, 0.0), (41, 1)), size=(20.0, 20.0))
    model = builder.finalize(1, "cpu")
    field = ground("cpu", kind=ShapeType.HEIGHT_FIELD, asset=slope)
    soil = Soil(model, [SoilBox(body=body, half=BOX)], "soft", pages=64, ground=field)
    simulation = sw.Simulation(model, 1e-3, elements=[soil], threads=1)
    state = simulation.state
    state.body_x.assign([[[-5.0, 0.003, 0.1]]])
    simulation.measure()
    simulation.step(1500)
    soil.keep_forces()
    depth = 0.1 - state.body_x.numpy()[0, 0, 2]
    assert depth > 5e-3
    n = np.array([math.sin(lean), 0.0, math.cos(lean)])
    start = np.array([5.0, 0.003, -0.5]) + (0.1 - depth) * n
    state.body_x.assign(start[None, None])
    state.body_rot.assign([[[0.0, math.sin(0.5 * lean), 0.0, math.cos(0.5 * lean)]]])
    state.body_v.zero_()
    state.body_omega.zero_()
    simulation.measure()
    soil.imprint()
    simulation.step(1000)
    assert np.linalg.norm(state.body_x.numpy()[0, 0] - start) < 1e-3
    assert np.abs(state.body_v.numpy()).max() < 1e-3


def test_an_ants_feet_are_pressed_in():
    simulation, soil, _ = ant_on_soil()
    for _ in range(1500):
        hold(simulation, np.zeros(8))
        simulation.step(1)
    soil.keep_forces()
    place = simulation.state.body_x.numpy().copy()
    place[0, :, :2] += (3.007, -2.003)
    simulation.state.body_x.assign(place)
    for name in ("body_v", "body_omega"):
        getattr(simulation.state, name).zero_()
    simulation.measure()
    soil.imprint()
    for _ in range(250):
        hold(simulation, np.zeros(8))
        simulation.step(1)
    # its drives are springs of torque, set anew in each step: the torso sways by a millimetre on soft hinges
    assert np.abs(simulation.state.body_x.numpy()[0, 0] - place[0, 0]).max() < 2e-3


def test_bad_input_is_one_line():
    builder = sw.ModelBuilder()
    body = builder.add_body("b", mass=1.0, inertia=(1.0, 1.0, 1.0))
    model = builder.finalize(2, "cpu")
    soil = Soil(model, [SoilBox(body=body, half=BOX)], pages=64)
    with pytest.raises(sw.ModelError, match=r"soil: imprint must follow sw\.Simulation"):
        soil.imprint()
    sw.Simulation(model, 1e-3, elements=[soil], threads=1)
    with pytest.raises(sw.ModelError, match=r"soil: imprint: world_mask must have shape \(2,\)"):
        soil.imprint([True])
    with pytest.raises(sw.ModelError, match="soil: keep_forces: world_mask must be of bool"):
        soil.keep_forces([0, 1])
