"""Worlds with vehicles do not know of each other, and everything that a vehicle remembers is kept and brought back."""

from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.drivers import ScriptedDriver, ScriptSpec
from simwarp.vehicle.driving.path_tracking import PathTracker, PathTrackingSpec, PIDGains
from simwarp.vehicle.driving.paths import circle
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world
from tests.physics.sample_vehicles import shipped

STEPS = 1200
SCRIPT = ScriptSpec(steering=((0.0, 0.0), (0.5, 0.2), (1.0, -0.2)), speed=((0.0, 10.5),))
FOLLOW = PathTrackingSpec(
    paths=(circle(30.0), circle(-25.0)), speed=12.0, speed_gains=PIDGains(proportional=0.5, integral=0.1)
)


class Batch:
    """Vehicles at 9 m/s that a script or a path tracker accelerates, so that the HMMWV changes gear at 9.8 m/s."""

    def __init__(self, worlds, *, name="hmmwv", follow=True):
        builder = ModelBuilder()
        self.parts = add_vehicle(builder, shipped(name), speed=9.0)
        self.model = builder.finalize(worlds, "cpu", per_world=per_world())
        self.vehicle = Vehicle(self.parts, self.model, randomised=True)
        self.driver: Any = PathTracker(self.vehicle, FOLLOW) if follow else ScriptedDriver(self.vehicle, SCRIPT)
        self.sim = sw.Simulation(self.model, 2.0e-3, elements=[self.driver, self.vehicle], solver=VEHICLE_SOLVER)

    def advance(self, steps=STEPS):
        """Steps; returns everything that a run consists of."""
        for _ in range(steps):
            self.sim.step()
        return self.content()

    def content(self):
        state = self.sim.state
        found = {name: getattr(state, name).numpy().copy() for name in state.NAMES}
        for part in (self.driver, self.vehicle):
            found |= {f"{type(part).__name__}.{key}": array.numpy().copy() for key, array in part.memory.items()}
        found["load"] = self.vehicle.tires.load.numpy().copy()
        return found


def same(run, other, worlds=slice(None), others=None, *, reports=True):
    """Bit by bit; reports are those of the last step, which no snapshot and no reset brings back."""
    for name, values in run.items():
        if name == "load" and not reports:
            continue
        image = other[name][worlds if others is None else others]
        assert values[worlds].tobytes() == image.tobytes(), name


@pytest.mark.parametrize("name", ["hmmwv", "hmmwv-reduced", "gator"])
def test_another_world_s_friction_and_driver_change_nothing_here(name):
    plain, mixed = Batch(5, name=name), Batch(5, name=name)
    friction = mixed.vehicle.tires.ground_friction.numpy()
    friction[3] = 0.15
    mixed.vehicle.tires.ground_friction.assign(friction)
    mixed.driver.target_speed.assign(np.array([12.0, 12.0, 12.0, 4.0, 12.0]))
    mixed.driver.path.assign(np.array([0, 0, 0, 1, 0]))
    run, other = plain.advance(), mixed.advance()
    same(run, other, [0, 1, 2, 4])
    assert np.abs(run["body_x"][3] - other["body_x"][3]).max() > 1.0


def test_the_number_of_worlds_changes_nothing():
    runs = {worlds: Batch(worlds).advance() for worlds in (1, 2, 17)}
    for worlds in (2, 17):
        for world in range(worlds):
            same(runs[1], runs[worlds], [0], [world])


@pytest.mark.parametrize("follow", [True, False])
def test_a_snapshot_repeats_the_run(follow):
    batch = Batch(3, follow=follow)
    first_gear = batch.vehicle.gear.numpy().copy()
    batch.advance(500)
    kept = batch.sim.snapshot()
    middle = batch.content()
    run = batch.advance(700)
    # what is remembered has been at work: gears changed, the controller's integral grew, tires stood on bristles
    assert (batch.vehicle.gear.numpy() > first_gear).all()
    key = "PathTracker.speed_sum" if follow else "ScriptedDriver.error_sum"
    assert np.abs(run[key] - middle[key]).min() > 0.0
    batch.sim.restore(kept)
    same(middle, batch.content(), reports=False)
    same(run, batch.advance(700))


@pytest.mark.parametrize("follow", [True, False])
def test_a_reset_world_repeats_its_run_and_the_others_go_on(follow):
    batch, untouched = Batch(3, follow=follow), Batch(3, follow=follow)
    start = batch.content()
    run = batch.advance(800)
    untouched.advance(800)
    batch.sim.reset(np.array([False, True, False]))
    same(start, batch.content(), [1], reports=False)
    again, further = batch.advance(800), untouched.advance(800)
    same(run, again, [1])
    same(further, again, [0, 2])


def test_a_standing_vehicle_keeps_its_bristles_over_a_snapshot():
    still = Batch(2)
    still.driver.target_speed.assign(np.zeros(2))
    still.advance(2500)
    assert np.abs(still.sim.state.body_v.numpy()[:, still.parts.chassis, 0]).max() < 0.1
    kept = still.sim.snapshot()
    assert np.abs(still.vehicle.tires.state.numpy()).max() > 0.0
    run = still.advance(300)
    still.sim.restore(kept)
    same(run, still.advance(300))
