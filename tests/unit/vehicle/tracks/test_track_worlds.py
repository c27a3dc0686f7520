"""Tracks in runs, files and worlds: motion repeats bit for bit, goes on from snapshots, differs where worlds do."""

import dataclasses
import functools

import numpy as np
import pytest

import simwarp as sw
from simwarp.soil import soil_under_tracks
from simwarp.vehicle import (
    TRACK_SOLVER,
    VEHICLE_SOLVER,
    ScriptedDriver,
    ScriptSpec,
    TrackedVehicle,
    add_tracked_vehicle,
    load_tracked_vehicle,
    per_world,
)
from simwarp.vehicle.tracks.belt_tables_kernels import BeltParameter

SCRIPT = ScriptSpec(
    throttle=((0.0, 0.0), (0.02, 1.0)), steering=((0.03, 0.0), (0.06, 1.0)), braking=((0.0, 0.2), (0.02, 0.0))
)
CASES = {
    "chains": ("m113", None), "chains with two pins": ("m113-double-pin", None), "chains on soil": ("m113", "mid"),
    "belts": ("m113-belt", None), "belts on soil": ("m113-belt", "mid"),
}  # fmt: skip
"""A shipped vehicle, and the soil below."""
OUTPUTS = (
    "tension", "sprocket_speed", "position", "angles", "velocity_b", "acceleration_b", "omega_b", "drive_torque",
)  # fmt: skip


def build(name):
    """A builder with the vehicle, and its parts."""
    builder = sw.ModelBuilder()
    return builder, add_tracked_vehicle(builder, load_tracked_vehicle(name))


def simulate(builder, parts, soil=None, worlds=1, own=()):
    """The vehicle in worlds, driven by `SCRIPT`."""
    model = builder.finalize(worlds, "cpu", per_world=per_world(own), contact_capacity=300 if parts.chains else None)
    belts = {} if parts.chains else {"soil": soil, "randomised": True}
    vehicle = TrackedVehicle(parts, model, **belts)
    elements = [ScriptedDriver(vehicle, SCRIPT), vehicle]
    if parts.chains and soil is not None:
        elements.append(soil_under_tracks(vehicle, soil))
    solver = dataclasses.replace(TRACK_SOLVER, max_iterations=10) if parts.chains else VEHICLE_SOLVER
    return sw.Simulation(model, 1e-3, elements=elements, solver=solver, check_start=False), vehicle


@functools.cache
def on_ground(case):
    """Builder and parts with the plane that chains without soil stand on: models may share them."""
    name, soil = CASES[case]
    builder, parts = build(name)
    if parts.chains and soil is None:
        builder.add_shape_plane(material=sw.Material(friction=0.9), name="ground")
    return builder, parts


def made(case, **options):
    builder, parts = on_ground(case)
    return simulate(builder, parts, CASES[case][1], **options)


def bits(sim, vehicle):
    """All that a snapshot holds and a vehicle reports, by name."""
    found = {name: array.numpy().tobytes() for name, array in sim.snapshot().arrays().items()}
    return found | {name: getattr(vehicle, name).numpy().tobytes() for name in OUTPUTS}


def differing(first, second):
    assert first.keys() == second.keys()
    return [name for name in first if first[name] != second[name]]


@pytest.mark.parametrize("case", CASES)
def test_a_run_repeats_bit_for_bit_however_its_steps_are_called(case):
    at_once, singly = made(case), made(case)
    at_once[0].step(40)
    for _ in range(40):
        singly[0].step()
    assert not differing(bits(*at_once), bits(*singly))
    assert np.abs(at_once[1].sprocket_speed.numpy()).max() > 1e-3, "something moves"


@pytest.mark.parametrize("case", CASES)
def test_a_snapshot_amid_a_run_goes_on_bit_for_bit_also_from_a_file(case, tmp_path):
    sim, vehicle = made(case)
    sim.step(20)
    kept = sim.snapshot()
    kept.save(tmp_path / "run.npz")
    sim.step(20)
    first = bits(sim, vehicle)
    sim.restore(kept)
    sim.step(20)
    assert not differing(first, bits(sim, vehicle))
    other, same_vehicle = made(case)
    other.step(3)
    other.restore(sw.Snapshot.load(tmp_path / "run.npz", other))
    other.step(20)
    assert not differing(first, bits(other, same_vehicle))


@pytest.mark.parametrize("case", CASES)
def test_a_model_read_back_from_its_file_moves_alike(case, tmp_path):
    name, soil = CASES[case]
    builder, parts = build(name)
    sw.save_model(builder, tmp_path / "model.json")
    found = []
    for each in (builder, sw.load_model(tmp_path / "model.json")):
        sim, vehicle = simulate(each, parts, soil)
        sim.step(20)
        found.append(bits(sim, vehicle))
    assert not differing(*found)


def tensioners(parts, model):
    return [model.joint_dof_start[side.tensioner] for side in parts.chains]


@pytest.mark.parametrize("case", ["chains", "belts"])
def test_each_world_has_its_own_tension_and_friction_and_no_effect_on_others(case):
    """Tensioners 0.8, 1 and 1.2 times as built, the ground's friction 0.2, 0.5 and 0.8, a start sideways at 1 m/s."""
    shares, frictions = np.array([0.8, 1.0, 1.2]), np.array([0.2, 0.5, 0.8])
    own = ("joint_preload", "shape_friction") if case == "chains" else ()

    def run(worlds):
        sim, vehicle = made(case, worlds=len(worlds), own=own)
        if vehicle.belts is None:
            model = sim.model
            preload, friction = model.joint_preload.numpy(), model.shape_friction.numpy()
            preload[:, tensioners(vehicle.parts, model)] *= shares[worlds][:, None]
            friction[:, model.shape_names.index("ground")] = frictions[worlds]
            model.joint_preload.assign(preload)
            model.shape_friction.assign(friction)
        else:
            force = vehicle.belts.parameter.numpy()
            force[:, :, BeltParameter.TENSIONER_FORCE] *= shares[worlds][:, None]
            vehicle.belts.parameter.assign(force)
            vehicle.belts.ground_friction.assign(frictions[worlds].astype(np.float32))
        velocity = sim.state.body_v.numpy()
        velocity[..., 1] = 1.0
        sim.state.body_v.assign(velocity)
        sim.step(60)
        sideways = sim.state.body_v.numpy()[:, vehicle.parts.chassis, 1]
        return sim.state.body_x.numpy(), vehicle.tension.numpy(), sideways

    x, tension, sideways = run([0, 1, 2])
    assert (np.diff(tension, axis=0) > 0.05 * tension[1]).all(), "the more force, the more tension"
    assert (np.diff(sideways) < -0.03).all(), "the more friction, the slower"
    for world in range(3):
        alone_x, alone_tension, _ = run([world])
        np.testing.assert_array_equal(x[world], alone_x[0])
        np.testing.assert_array_equal(tension[world], alone_tension[0])
    again, *_ = run([2, 1, 0])
    np.testing.assert_array_equal(again[::-1], x)
