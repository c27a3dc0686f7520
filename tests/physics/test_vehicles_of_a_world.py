"""Several vehicles in every world: batches, snapshots, resets, placing one of them, names and errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.model.builder import ModelBuilder
from simwarp.scenery import add_vehicle_visual, convoy_visuals
from simwarp.sensors.scene import Visuals
from simwarp.vehicle import (
    VEHICLE_SOLVER,
    PathTracker,
    PathTrackingSpec,
    Recorder,
    ScriptedDriver,
    ScriptSpec,
    SpecError,
    Vehicle,
    Vehicles,
    add_chassis_box,
    add_payload,
    add_vehicle,
    circle,
    maneuver,
    per_world,
    place_vehicle,
    set_up_convoy,
    with_options,
)
from simwarp.vehicle.results.channels import COLUMNS
from tests.physics.sample_vehicles import shipped

FULL = ScriptSpec(throttle=((0.0, 1.0),))
STATE = ("body_x", "body_rot", "body_v", "body_omega", "joint_q", "joint_qd")


class Row:
    """Vehicles 8 m apart in each of some worlds, at full throttle."""

    def __init__(self, worlds: int, *, count: int = 3, speed: float = 9.0) -> None:
        spec = shipped("hmmwv")
        builder = ModelBuilder()
        self.parts = [
            add_vehicle(
                builder, spec, at=sw.pose((-8.0 * number, 0.0, spec.start_height)), prefix=f"v{number}_", speed=speed
            )
            for number in range(count)
        ]  # fmt: skip
        for each in self.parts:
            add_payload(builder, each, mass=100.0)
        model: Any = builder.finalize(worlds, "cpu", per_world=per_world())
        self.vehicles = Vehicles(self.parts, model)
        self.driver = ScriptedDriver(self.vehicles, FULL)
        self.sim = sw.Simulation(model, 2.0e-3, elements=[self.driver, self.vehicles], solver=VEHICLE_SOLVER)

    def told(self, worlds: Any = slice(None)) -> list[bytes]:
        arrays = [getattr(self.sim.state, name) for name in STATE]
        arrays += [self.vehicles.gear, self.vehicles.engine_speed, self.vehicles.tires.load]
        return [np.ascontiguousarray(array.numpy()[worlds]).tobytes() for array in arrays]


def test_arrays_have_an_axis_of_vehicles():
    row = Row(2)
    row.sim.step(10)
    assert row.vehicles.input.shape == (2, 3, 4)
    assert row.vehicles.tires.load.shape == (2, 12)
    assert len(row.vehicles) == 3
    for number, vehicle in enumerate(row.vehicles):
        assert vehicle.position.numpy() == pytest.approx(row.vehicles.position.numpy()[:, number])
        assert (
            vehicle.tires.load.numpy().tolist()
            == row.vehicles.tires.load.numpy()[:, 4 * number : 4 * number + 4].tolist()
        )
        assert vehicle.position.numpy()[0, 0] == pytest.approx(-8.0 * number + 0.24, abs=0.1)
    row.vehicles[1].input[:, 0] = 0.5
    assert row.vehicles.input.numpy()[:, :, 0].tolist() == [[0.0, 0.5, 0.0]] * 2


def test_worlds_are_apart():
    calm, disturbed = Row(4), Row(4)
    disturbed.sim.state.body_v[3] = disturbed.sim.state.body_v.numpy()[3] + 0.1
    for each in (calm, disturbed):
        each.sim.step(200)
    assert calm.told(slice(0, 3)) == disturbed.told(slice(0, 3))
    assert calm.told(3) != disturbed.told(3)


def test_a_snapshot_goes_on_through_a_gear_change():
    """The couplings of the gears are no memory: they follow from the gears."""
    row = Row(2)
    before = row.sim.snapshot()
    gears = row.vehicles.gear.numpy().copy()
    row.sim.step(700)
    there = row.told()
    assert (row.vehicles.gear.numpy() != gears).all()
    row.sim.restore(before)
    row.sim.step(700)
    assert row.told() == there


def test_a_masked_reset_starts_one_world_anew():
    row, fresh = Row(3), Row(3)
    row.sim.step(700)
    row.sim.reset(np.array([False, True, False]))
    others = row.told([0, 2])
    row.sim.step(300)
    fresh.sim.step(300)
    assert row.told(1) == fresh.told(1)
    assert row.told([0, 2]) != others


def test_one_of_them_is_placed():
    row = Row(2)
    row.sim.step(50)
    before = row.sim.state.body_x.numpy().copy()
    place_vehicle(row.sim, row.vehicles[1], (40.0, 25.0), 1.0, np.array([True, False]))
    after = row.sim.state.body_x.numpy()
    moved = np.abs(after - before).max(axis=2) > 1.0
    mine = [*row.parts[1].bodies, row.sim.model.body("v1_payload")]
    assert sorted(np.flatnonzero(moved[0]).tolist()) == sorted(mine)
    assert not moved[1].any()
    assert row.vehicles.position.numpy()[0, 1, :2] == pytest.approx((40.0, 25.0))


def test_names_take_the_prefix():
    spec, builder = shipped("hmmwv-reduced"), ModelBuilder()
    parts = [add_vehicle(builder, spec, at=sw.pose((9.0 * k, 0.0, 1.0)), prefix=f"v{k}_") for k in (0, 1)]
    boxes = [add_chassis_box(builder, each, half=(2.0, 1.0, 0.5)) for each in parts]
    for each in parts:
        add_payload(builder, each, mass=10.0)
    assert [builder.shapes[box].name for box in boxes] == ["v0_chassis_box", "v1_chassis_box"]
    assert {"v0_payload", "v1_payload"} < {body.name for body in builder.bodies}
    visuals = Visuals(builder)
    for each in parts:
        add_vehicle_visual(visuals, each, like="hmmwv")
    assert {"v0_body", "v1_body", "v1_wheel_3"} < {instance.name for instance in visuals.instances}


def recorded(*, as_one: bool) -> np.ndarray:
    """Rows of the second of two vehicles, which follows a circle while torch works the pedals of the first."""
    spec, builder = shipped("hmmwv-reduced"), ModelBuilder()
    parts = [
        add_vehicle(
            builder, spec, at=sw.pose((0.0, 30.0 * k, spec.start_height)), prefix=f"v{k}_", speed=6.0
        )
        for k in (0, 1)
    ]  # fmt: skip
    model = builder.finalize(2, "cpu", per_world=per_world())
    acting: Any = [Vehicle(each, model) for each in parts]
    if as_one:
        acting = Vehicles(parts, model)
    follow = PathTrackingSpec(paths=(circle(20.0),), speed=6.0)
    tracker = PathTracker(acting[1], follow)
    sim = sw.Simulation(
        model, 2.0e-3, elements=[tracker, *([acting] if as_one else acting)], solver=VEHICLE_SOLVER
    )  # fmt: skip
    sw.to_torch(acting[0].input)[:, 1] = 0.7
    place_vehicle(sim, acting[1], (0.0, 0.0))
    place_vehicle(sim, acting[0], (0.0, 60.0))
    rows = [Recorder(sim, vehicle, slice(0, 2)) for vehicle in acting]
    for _ in range(4):
        sim.step(100)
        for each in rows:
            each.sample()
    return np.stack([each.table() for each in rows])


def test_drivers_recorders_and_torch_take_one_of_several():
    found = recorded(as_one=True)
    assert np.array_equal(found, recorded(as_one=False))
    steer = found[1, -1, :, COLUMNS.index("steer")]
    assert (np.abs(steer) > 0.01).all()
    assert (found[0, -1, :, COLUMNS.index("throttle")] == np.float32(0.7)).all()


def test_equal_prefixes_are_refused():
    spec, builder = shipped("hmmwv-reduced"), ModelBuilder()
    add_vehicle(builder, spec, prefix="v0_")
    with pytest.raises(SpecError, match=r"^prefix: must be one that no other vehicle has, got 'v0_' again; .*$"):
        add_vehicle(builder, spec, prefix="v0_")


def test_unlike_vehicles_are_refused():
    builder = ModelBuilder()
    parts = [
        add_vehicle(builder, shipped(name), at=sw.pose((9.0 * k, 0.0, 1.0)), prefix=f"v{k}_")
        for k, name in enumerate(("hmmwv", "hmmwv-reduced"))
    ]
    model = builder.finalize(1, "cpu", per_world=per_world())
    with pytest.raises(ModelError, match=r"^Vehicles: vehicles must be alike, got 'hmmwv' and 'hmmwv-reduced'"):
        Vehicles(parts, model)
    with pytest.raises(ModelError, match=r"^Vehicles: parts must be of at least one vehicle, got none"):
        Vehicles([], model)


def test_one_of_several_is_no_element():
    row = Row(1)
    with pytest.raises(ModelError, match="vehicle 1 is one of 3 `Vehicles`, which act together; pass those"):
        sw.Simulation(row.sim.model, 2.0e-3, elements=[row.vehicles[1]], solver=VEHICLE_SOLVER)


def test_rigid_tires_of_several_report_their_own():
    spec, builder = with_options(shipped("hmmwv-reduced"), tire="rigid"), ModelBuilder()
    parts = [add_vehicle(builder, spec, at=sw.pose((9.0 * k, 0.0, spec.start_height)), prefix=f"v{k}_") for k in (0, 1)]
    add_payload(builder, parts[1], mass=1000.0)
    builder.add_shape_plane()
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicles = Vehicles(parts, model)
    vehicles.input[:, :, 2] = 1.0
    sim = sw.Simulation(model, 1.0e-3, elements=[vehicles], solver=VEHICLE_SOLVER)
    sim.step(1500)
    weight = [float(vehicle.tires.load.numpy().mean() * 4.0) for vehicle in vehicles]
    # at rest but for the last of the springs' motion
    assert weight[1] - weight[0] == pytest.approx(9810.0, rel=0.02)


def test_a_convoy_drives_on():
    spec = shipped("hmmwv-reduced")
    convoy = set_up_convoy(spec, maneuver("step-steer", spec, speed=4.0), vehicles=3, worlds=2, device="cpu", dt=2e-3)
    convoy.simulation.step(2000)
    x = convoy.vehicles.position.numpy()[..., 0]
    # all do the same at another place: float32 rounds it
    assert np.diff(x, axis=1) == pytest.approx(np.full((2, 2), -10.0), abs=1e-3)
    assert (x[:, 0] > 4.0).all()
    visuals = convoy_visuals(convoy)
    visuals.add_plane(name="road")
    scene = visuals.finalize(convoy.simulation.model)
    assert scene.instance("v0_body") < scene.instance("v2_wheel_3") < scene.instance("road")
    with pytest.raises(SpecError, match=r"^gap: must be above the boxes' length, 4\.6 m, got 4\.0$"):
        set_up_convoy(spec, convoy.maneuver, gap=4.0)


def test_a_vehicle_alone_is_one_of_one():
    builder = ModelBuilder()
    parts = add_vehicle(builder, shipped("hmmwv"))
    vehicle = Vehicle(parts, builder.finalize(2, "cpu", per_world=per_world()))
    assert vehicle.input.shape == (2, 4)
    assert {array.shape[0] for array in vehicle.memory.values()} == {2}
    assert "coupling_coefficient" not in vehicle.memory
