"""A mirrored vehicle, steered the other way, drives the mirrored run; unmirrored it does not."""

import dataclasses
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.drivers import ScriptedDriver, ScriptSpec
from simwarp.vehicle.results.channels import Recorder
from simwarp.vehicle.spec.mirroring import mirrored
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import vehicle_names
from simwarp.vehicle.spec.vehicle_spec import SpecError
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world
from tests.physics.sample_vehicles import pinned_axle, samples, shipped, vehicle

ODD = ("y_m", "yaw_rad", "roll_rad", "yawrate_radps", "latacc_com_mps2")
EVEN = ("x_m", "z_m", "pitch_rad", "speed_mps")
SIDES = (("Fz_FL_N", "Fz_FR_N"), ("Fz_RL_N", "Fz_RR_N"), ("omega_FL_radps", "omega_FR_radps"),
         ("omega_RL_radps", "omega_RR_radps"))  # fmt: skip


def lopsided(spec: Any) -> Any:
    """A chassis heavier on its left and of inertia that no plane mirrors."""
    part = spec.chassis.components[0]
    load = 0.01 * min(part.inertia)
    part = dataclasses.replace(part, com=tuple(np.add(part.com, (0.0, 0.05, 0.0))), products=(load, load, 2.0 * load))
    return dataclasses.replace(spec, chassis=dataclasses.replace(spec.chassis, components=(part,)))


def step_steer(spec: Any, steering: float, speed: float, seconds: float = 5.0) -> Recorder:
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec, speed=speed)
    model = builder.finalize(1, "cpu", per_world=per_world())
    car = Vehicle(parts, model)
    script = ScriptSpec(steering=((0.0, 0.0), (1.0, 0.0), (1.2, steering)), speed=((0.0, speed),))
    sim = sw.Simulation(model, 1.0e-3, elements=[ScriptedDriver(car, script), car], solver=VEHICLE_SOLVER)
    recorder = Recorder(sim, car)
    for step in range(round(seconds / sim.dt)):
        sim.step()
        if step % 10 == 0:
            recorder.sample()
    return recorder


def apart(run: Recorder, other: Recorder) -> dict[str, float]:
    """Largest difference of every column from its mirror image, over the column's own size."""
    found = {}
    pairs = [(name, name, -1.0) for name in ODD] + [(name, name, 1.0) for name in EVEN]
    pairs += [(a, b, 1.0) for left, right in SIDES for a, b in ((left, right), (right, left))]
    for name, image, sign in pairs:
        column = run.column(name)
        found[name] = float(np.abs(column - sign * other.column(image)).max() / max(np.abs(column).max(), 0.01))
    return found


# Two runs of one motion in float32 whose sums have other orders: 6e-8 per operation, and nothing that grows, since
# the motion is stable. The lateral acceleration is a difference over 10 ms, loads come from stiff tires.
TOLERANCE = 1.0e-4


@pytest.mark.quick("hmmwv-reduced-12.0")
@pytest.mark.parametrize(("name", "speed"), [("hmmwv", 12.0), ("hmmwv-reduced", 12.0), ("gator", 6.0), ("sedan", 12.0)])
def test_the_mirror_image_drives_the_mirrored_run(name, speed):
    spec = lopsided(shipped(name))
    run = step_steer(spec, 0.3, speed)
    found = apart(run, step_steer(mirrored(spec), -0.3, speed))
    assert max(found.values()) < TOLERANCE, found
    # what it is that was mirrored: the vehicle itself, steered the other way, drives otherwise
    assert max(apart(run, step_steer(spec, -0.3, speed)).values()) > 100.0 * TOLERANCE
    assert abs(run.column("yaw_rad")[-1, 0]) > 0.5


@pytest.mark.slow
def test_a_property_file_of_one_side_mirrors_with_the_vehicle():
    """Tires measured on the left are mirrored on the right: the vehicle has a mirror image, and none with `either`."""
    spec = lopsided(with_options(shipped("sedan"), tire="pacejka2002"))
    run = step_steer(spec, 0.3, 12.0)
    found = apart(run, step_steer(mirrored(spec), -0.3, 12.0))
    assert max(found.values()) < TOLERANCE, found
    alike = with_tire_parameters(spec, measured_side="either")
    image = with_tire_parameters(mirrored(spec), measured_side="either")
    assert max(apart(step_steer(alike, 0.3, 12.0), step_steer(image, -0.3, 12.0)).values()) > 100.0 * TOLERANCE


def coasting_drift(spec: Any) -> float:
    """How far a vehicle that rolls straight ahead at 20 m/s is beside its line after 189 m [m]."""
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec, speed=20.0)
    model = builder.finalize(1, "cpu", per_world=per_world())
    car = Vehicle(parts, model)
    sim = sw.Simulation(model, 1.0e-3, elements=[car], solver=VEHICLE_SOLVER)
    start = car.position.numpy()[0].copy()
    while car.position.numpy()[0, 0] - start[0] < 189.0:
        sim.step(100)
        assert sim.time.numpy()[0] < 20.0
    return float(car.position.numpy()[0, 1] - start[1])


@pytest.mark.slow
def test_a_sedan_on_tires_of_one_side_rolls_straight():
    """What is left comes from the driveline, whose shaft turns one way: 0.05 m with symmetric tires, too."""
    spec = with_options(shipped("sedan"), tire="pacejka2002")
    assert abs(coasting_drift(spec)) < 0.05
    # the conicity and plysteer of the same curves on both sides
    assert coasting_drift(with_tire_parameters(spec, measured_side="either")) > 1.0


def test_a_reaction_that_keeps_its_sign_breaks_the_symmetry():
    """Full throttle with the HMMWV's reaction: its sign belongs to the mirror."""
    spec = shipped("hmmwv")
    half = dataclasses.replace(mirrored(spec), driveline=spec.driveline)
    run = step_steer(spec, 0.3, 12.0, 3.0)
    good = apart(run, step_steer(mirrored(spec), -0.3, 12.0, 3.0))["roll_rad"]
    assert apart(run, step_steer(half, -0.3, 12.0, 3.0))["roll_rad"] > 100.0 * good


@pytest.mark.parametrize("name", vehicle_names())
def test_twice_mirrored_is_the_vehicle_itself(name):
    spec = lopsided(shipped(name))
    assert mirrored(mirrored(spec)) == spec
    assert mirrored(spec) != spec


def test_a_pinned_axle_takes_its_pin_along():
    spec = vehicle(samples()["macpherson-strut"].axles[0].suspension, pinned_axle())
    axle: Any = spec.axles[1]
    off = dataclasses.replace(axle.suspension, pin=(0.0, 0.1, 0.15))
    spec = dataclasses.replace(spec, axles=(spec.axles[0], dataclasses.replace(axle, suspension=off)))
    image: Any = mirrored(spec).axles[1].suspension
    assert image.pin == (0.0, -0.1, 0.15)


def test_what_has_no_mirror_image_is_named():
    with pytest.raises(SpecError, match=r"axles\[0\].suspension.draglink_chassis: must be absent"):
        mirrored(samples()["solid-axle"])
    marked = with_options(shipped("hmmwv"), tire="pacejka2002")  # by its property file
    odd = with_tire_parameters(marked, measured_side="either")
    with pytest.raises(SpecError, match=r"axles\[0\].tire.parameters.measured_side: must be left or right"):
        mirrored(odd)
    assert mirrored(marked).axles[0].tire == marked.axles[0].tire
    tir = {**marked.axles[0].tire.parameters["tir"], "USE_MODE": -4.0}  # the same image on both sides
    with pytest.raises(SpecError, match=r"measured_side: must be left or right to mirror the vehicle, got None"):
        mirrored(with_tire_parameters(marked, tir=tir))
    spaced = with_tire_parameters(marked, tir={**tir, "USE_MODE": 4.0, "TYRESIDE": "Left "})
    assert mirrored(spaced).axles[0].tire == spaced.axles[0].tire
    again = with_tire_parameters(odd, measured_side="left")
    assert mirrored(again).axles[0].tire == again.axles[0].tire


def with_tire_parameters(spec, **changes):
    """A vehicle with parameters of its tires changed."""
    axles = [
        dataclasses.replace(axle, tire=dataclasses.replace(axle.tire, parameters={**axle.tire.parameters, **changes}))
        for axle in spec.axles
    ]
    return dataclasses.replace(spec, axles=tuple(axles))
