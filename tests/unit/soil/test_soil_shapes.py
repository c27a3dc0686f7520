"""Boxes, spheres and capsules on soil: closed forms, sums over several shapes of a body, laws."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.actuators import Actuators, ActuatorSpec, SitePull
from simwarp.scenes.contact import ANT_LIMB_RADIUS, ant
from simwarp.soil import (
    PRESETS,
    Soil,
    SoilBox,
    SoilCapsule,
    SoilCylinder,
    SoilShape,
    SoilSphere,
    soil_shapes,
    soil_under,
)  # fmt: skip
from simwarp.vehicle import VEHICLE_SOLVER, Vehicle, Vehicles, add_vehicle, load_vehicle, per_world, with_options
from tests.reference.soil_quadrature import bisect
from tests.unit.soil.soil_wheels import GRAVITY

PLATE = (0.25, 0.1, 0.05)
"""Half lengths of a plate of 0.1 m²."""


def pressed_shapes(shapes, *, load, start, soil="mid", spacing=0.02, dt=1e-3, seconds=6.0, turn=(0.0, 0.0, 0.0, 1.0)):
    """A body on the vertical whose weight is put on slowly; how deep it went, and the soil."""
    builder = sw.ModelBuilder()
    mass = load / GRAVITY
    body = builder.add_body("b", mass=mass, inertia=(0.1 * mass,) * 3, pose=sw.pose((0.003, 0.001, start), turn))
    builder.add_joint_prismatic("up", sw.WORLD, body, axis=(0, 0, 1))
    model = builder.finalize(1, "cpu")
    element = Soil(model, shapes, soil, spacing=spacing)
    simulation = sw.Simulation(model, dt, elements=[element], threads=1)
    steps = round(seconds / dt)
    for step in range(0, steps, 10):
        rest = load * max(0.0, 1.0 - step / (0.8 * steps))
        simulation.control.body_force.fill_(wp.vec3(0.0, 0.0, rest))
        simulation.step(10)
    return start - float(simulation.state.body_x.numpy()[0, 0, 2]), element, simulation


@pytest.mark.parametrize("spacing", [0.02, 0.05])
def test_a_plate_sinks_as_bekker_says(spacing):
    """z = (10 kN / (0.1 m² 2e6))^(1/1.1) = 0.0657 m: cells at its edges count for what lies below it."""
    depth, element, simulation = pressed_shapes(
        [SoilBox(body=0, half=PLATE)], load=1e4, start=PLATE[2], spacing=spacing, seconds=24.0
    )  # so slowly that it swings past the balance by 0.3 mm alone
    assert depth == pytest.approx(0.0657, rel=0.01)
    assert float(element.load.numpy()[0, 0]) == pytest.approx(1e4, rel=1e-3)
    simulation.control.body_force.fill_(wp.vec3(0.0, 0.0, 0.9e4))
    simulation.step(3000)
    up = depth - PLATE[2] + float(simulation.state.body_x.numpy()[0, 0, 2])
    assert up == pytest.approx(0.9e4 / 0.1 / PRESETS["mid"].elastic, rel=0.05)
    for share in np.linspace(0.9, 0.0, 300):  # slowly: put on at once, it would swing past
        simulation.control.body_force.fill_(wp.vec3(0.0, 0.0, float(share) * 1e4))
        simulation.step(10)
    again = PLATE[2] - float(simulation.state.body_x.numpy()[0, 0, 2])
    assert again == pytest.approx(depth, abs=0.1e-3)


def test_a_plate_with_cohesion_sinks_by_its_width():
    """Hard soil, 0.2 x 0.5 m: b = 0.143 m; 100 kPa: 0.0057 m."""
    depth, _, _ = pressed_shapes([SoilBox(body=0, half=PLATE)], load=1e4, start=PLATE[2], soil="hard")
    assert depth == pytest.approx(0.0057, rel=0.01)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0, 1.0), (math.sin(0.3), 0.0, 0.0, math.cos(0.3))])
def test_a_sphere_sinks_as_quadrature_says(turn):
    """F = 2 pi ∫ k z(r)^n r dr, z(r) = z - R + sqrt(R² - r²)."""
    radius, load, spec = 0.2, 3000.0, PRESETS["mid"]

    def carried(z: float) -> float:
        r = np.linspace(0.0, math.sqrt(radius**2 - (radius - z) ** 2), 4001)
        deep = np.maximum(z - radius + np.sqrt(radius**2 - r * r), 0.0)
        return float(2.0 * math.pi * np.trapezoid(spec.k_phi * deep**spec.exponent * r, r)) - load

    expected = bisect(carried, 1e-6, radius)
    depth, _, _ = pressed_shapes([SoilSphere(body=0, radius=radius)], load=load, start=radius, spacing=0.01, turn=turn)
    assert depth == pytest.approx(expected, rel=0.01)


def test_a_lying_capsule_bears_as_a_cylinder_with_two_half_balls():
    """Both at the same depth, and the capsule's own load."""
    across = sw.pose((0.0, 0.0, 0.0), (math.sin(0.25 * math.pi), 0.0, 0.0, math.cos(0.25 * math.pi)))
    capsule = SoilCapsule(body=0, radius=0.15, half_length=0.3, pose=across)
    depth, _, _ = pressed_shapes([capsule], load=5000.0, start=0.15, spacing=0.01)
    spec = PRESETS["mid"]
    x = np.linspace(0.0, math.sqrt(0.15**2 - (0.15 - depth) ** 2), 4001)
    pressure = spec.k_phi * np.maximum(depth - 0.15 + np.sqrt(0.15**2 - x * x), 0.0) ** spec.exponent
    known = 0.6 * 2.0 * np.trapezoid(pressure, x) + 2.0 * math.pi * np.trapezoid(pressure * x, x)
    assert known == pytest.approx(5000.0, rel=0.02)


def test_shapes_of_one_body_add_up():
    """Four quarters of a plate carry what the plate does, and their loads are the weight."""
    whole, _, _ = pressed_shapes([SoilBox(body=0, half=PLATE)], load=1e4, start=PLATE[2], spacing=0.01)
    a, b, c = PLATE
    quarters: list[SoilShape] = [
        SoilBox(body=0, half=(0.5 * a, 0.5 * b, c), pose=sw.pose((0.5 * i * a, 0.5 * j * b, 0.0)))
        for i in (-1.0, 1.0) for j in (-1.0, 1.0)
    ]  # fmt: skip
    depth, element, _ = pressed_shapes(quarters, load=1e4, start=c, spacing=0.01)
    # a cell on the border of two quarters belongs to one of them, for its share of it
    assert depth == pytest.approx(whole, rel=0.06)
    assert float(element.load.numpy()[0].sum()) == pytest.approx(1e4, rel=1e-3)
    assert element.load.numpy()[0].min() > 0.2e4


def dropped(*, corner: bool, dt: float = 1e-3, soil: str = "mid", worlds: int = 1, height: float = 0.3):
    """A box of 40 x 30 x 20 cm and 60 kg, let go flat or on a corner."""
    builder = sw.ModelBuilder()
    half, mass = np.array([0.2, 0.15, 0.1]), 60.0
    inertia = mass / 3.0 * (half @ half - half**2)
    q = np.array([0.3, 0.25, 0.1, 0.9]) if corner else np.array([0.0, 0.0, 0.0, 1.0])
    place = sw.pose((0.013, 0.007, height), tuple(q / np.linalg.norm(q)))
    body = builder.add_body("box", mass=mass, inertia=tuple(inertia), pose=place)
    model = builder.finalize(worlds, "cpu")
    element = Soil(model, [SoilBox(body=body, half=tuple(half))], soil, pages=64)
    return sw.Simulation(model, dt, elements=[element], threads=1), element


def energy_of(simulation):
    return float(simulation.measure_energy().numpy()[0])


@pytest.mark.parametrize("soil", ["soft", "mid", "hard"])
@pytest.mark.parametrize("corner", [False, True], ids=["flat", "corner"])
def test_a_dropped_box_comes_to_rest_and_gains_no_energy(corner, soil):
    simulation, element = dropped(corner=corner, soil=soil, dt=2e-3)
    start = energy_of(simulation)
    most = start
    for _ in range(150):
        simulation.step(10)
        most = max(most, energy_of(simulation))
    assert most <= start + 0.02 * 60.0 * GRAVITY * 0.3
    state = simulation.state
    assert np.abs(state.body_v.numpy()).max() < 0.02
    assert np.abs(state.body_omega.numpy()).max() < 0.1
    assert float(element.load.numpy()[0, 0]) == pytest.approx(60.0 * GRAVITY, rel=0.01)
    assert 0.0 < float(state.body_x.numpy()[0, 0, 2]) < 0.2


@pytest.mark.parametrize("corner", [False, True], ids=["flat", "corner"])
def test_longer_steps_come_to_the_same_place(corner):
    found = []
    for dt in (1e-3, 2e-3, 3e-3):
        simulation, _ = dropped(corner=corner, dt=dt)
        simulation.step(round(0.5 / dt))
        found.append(float(simulation.state.body_x.numpy()[0, 0, 2]))
    # it falls by 6 mm in a step of 3 ms: a quarter of that; on a corner it also tips over in this time
    assert found[1:] == pytest.approx([found[0]] * 2, abs=0.006 if corner else 0.0015)


def test_worlds_with_boxes_are_independent():
    plain, _ = dropped(corner=True, worlds=5)
    other, _ = dropped(corner=True, worlds=5)
    alone, _ = dropped(corner=True)
    pushed = np.zeros((5, 1, 3), np.float32)
    pushed[3] = (200.0, 50.0, 0.0)
    other.control.body_force.assign(pushed)
    for simulation in (plain, other, alone):
        simulation.step(400)
    for name in ("body_x", "body_rot", "body_v", "body_omega"):
        a, b, c = (getattr(simulation.state, name).numpy() for simulation in (plain, other, alone))
        np.testing.assert_array_equal(np.delete(a, 3, axis=0), np.delete(b, 3, axis=0), err_msg=name)
        np.testing.assert_array_equal(a[:1], c, err_msg=name)
    assert abs(other.state.body_x.numpy()[3, 0, 0] - plain.state.body_x.numpy()[3, 0, 0]) > 0.01


def ant_on_soil(soil="mid", drive=None):
    builder = ant(height=0.75, ground=False)
    model = builder.finalize(1, "cpu")
    feet = soil_shapes(model, [f"ankle_{leg}" for leg in range(4)])
    assert [type(foot) for foot in feet] == [SoilSphere] * 4
    element = Soil(model, feet, soil, spacing=0.02)
    return sw.Simulation(model, 2e-3, elements=[element], threads=1), element, model


def hold(simulation, target):
    """Torques of a stiff hinge towards angles."""
    q, qd = simulation.state.joint_q.numpy()[0], simulation.state.joint_qd.numpy()[0]
    force = simulation.control.joint_force.numpy()
    force[0] = 80.0 * (target - q) - 2.0 * qd
    simulation.control.joint_force.assign(force)


def test_an_ant_stands_and_walks_with_its_feet_in_the_soil():
    simulation, element, model = ant_on_soil()
    for _ in range(750):
        hold(simulation, np.zeros(8))
        simulation.step(1)
    weight = float(model.parameters.body_mass.numpy()[0].sum()) * GRAVITY
    loads = []
    for _ in range(200):
        hold(simulation, np.zeros(8))
        simulation.step(1)
        loads.append(float(element.load.numpy()[0].sum()))
    assert np.mean(loads) == pytest.approx(weight, rel=0.01)
    assert element.sinkage.numpy()[0].min() > 1e-3
    heights = simulation.state.body_x.numpy()[0, :, 2]
    assert heights.min() > 0.0
    start = simulation.state.body_x.numpy()[0, 0].copy()
    for step in range(1500):  # diagonal legs swing in turn
        phase = 2.0 * math.pi * step * 2e-3 * 1.5
        legs = np.array([0.0, math.pi, 0.0, math.pi])
        swing = np.array([1.0, 1.0, -1.0, -1.0]) * 0.4 * np.sin(phase + legs)
        lift = 0.3 * np.maximum(0.0, np.cos(phase + legs))
        hold(simulation, np.concatenate([swing, -lift]))
        simulation.step(1)
    there = simulation.state.body_x.numpy()[0, 0]
    assert np.isfinite(simulation.state.body_x.numpy()).all()
    assert np.hypot(*(there - start)[:2]) > 0.03
    assert there[2] > ANT_LIMB_RADIUS
    assert element.recycled.numpy().max() == 0


def test_shapes_of_a_model_are_those_of_its_bodies():
    builder = sw.ModelBuilder()
    body = builder.add_body("b", mass=1.0, inertia=(1.0, 1.0, 1.0))
    builder.add_shape_box(body, half=(0.1, 0.2, 0.3), pose=sw.pose((0.0, 0.0, -0.1)))
    builder.add_shape_cylinder(body, radius=0.2, half_length=0.1)
    builder.add_shape_capsule(body, radius=0.1, half_length=0.3)
    other = builder.add_body("c", mass=1.0, inertia=(1.0, 1.0, 1.0))
    builder.add_shape_cone(other, radius=0.2, half_length=0.1, name="tip")
    builder.add_body("bare", mass=1.0, inertia=(1.0, 1.0, 1.0))
    model = builder.finalize(1, "cpu")
    box, cylinder, capsule = soil_shapes(model, ["b"])
    assert isinstance(box, SoilBox)
    assert box.half == pytest.approx((0.1, 0.2, 0.3))
    assert box.pose.position == pytest.approx((0.0, 0.0, -0.1))
    assert isinstance(cylinder, SoilCylinder)
    assert (cylinder.radius, cylinder.half_length) == pytest.approx((0.2, 0.1))
    assert isinstance(capsule, SoilCapsule)
    assert (capsule.radius, capsule.half_length) == pytest.approx((0.1, 0.3))
    with pytest.raises(sw.ModelError, match="shape 'tip' must be a box, sphere, capsule or cylinder, got cone"):
        soil_shapes(model)
    with pytest.raises(sw.ModelError, match="body 'bare' must have a shape, got none"):
        soil_shapes(model, ["bare"])


def beside_actuators(soil_last: bool):
    """A box that settled on soil, pulled up along its own z with 100 N by an actuator on the same body."""
    builder = sw.ModelBuilder()
    body = builder.add_body("b", mass=60.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 0.0, 0.1)))
    model = builder.finalize(1, "cpu")
    soil = Soil(model, [SoilBox(body=body, half=(0.2, 0.15, 0.1))], pages=64)
    pull = SitePull(body=body, gear=(0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    actuators = Actuators(model, [ActuatorSpec(name="pull", site=pull)])
    parts: list[Any] = [actuators, soil] if soil_last else [soil, actuators]
    return sw.Simulation(model, 1e-3, elements=parts, threads=1), soil, actuators


def test_soil_adds_to_what_other_elements_do_to_a_body():
    simulation, soil, actuators = beside_actuators(soil_last=True)
    simulation.step(1500)
    assert float(soil.load.numpy()[0, 0]) == pytest.approx(60.0 * GRAVITY, rel=1e-3)
    actuators.ctrl.fill_(100.0)
    simulation.step(1500)
    assert float(soil.load.numpy()[0, 0]) == pytest.approx(60.0 * GRAVITY - 100.0, rel=1e-3)


def test_soil_comes_after_what_else_acts_on_its_bodies():
    with pytest.raises(sw.ModelError, match="act on body 'b' must come before the soil, got Actuators after"):
        beside_actuators(soil_last=False)


def test_a_vehicle_on_its_belly_is_carried_by_it():
    """Wheels in the air: the belly's box bears all but what the wheels' ruts do."""
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, with_options(load_vehicle("hmmwv"), tire="soil-rigid"))
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model)
    low = sw.pose((0.0, 0.0, -0.6))
    belly = SoilBox(body=parts.chassis, half=(1.5, 0.5, 0.3), pose=low)
    soil = soil_under(vehicle, "soft", shapes=[belly], pages=512)
    simulation = sw.Simulation(model, 1e-3, elements=[vehicle, soil], solver=VEHICLE_SOLVER, threads=1)
    simulation.step(3000)
    loads = soil.load.numpy()[0]
    weight = float(model.parameters.body_mass.numpy()[0].sum()) * GRAVITY
    assert loads.sum() == pytest.approx(weight, rel=0.01)
    assert loads[4] > 0.5 * weight


@pytest.mark.parametrize("several", [False, True])
def test_a_belly_adds_to_the_drag_of_one_vehicle_and_of_several(several):
    """In the air the soil bears nothing: the chassis slows down by its drag, as without a belly."""
    spec = with_options(load_vehicle("hmmwv"), tire="soil-rigid")
    spec = dataclasses.replace(spec, chassis=dataclasses.replace(spec.chassis, drag_coefficient=0.6, drag_area=4.0))
    speeds = []
    for belly in (False, True):
        builder = sw.ModelBuilder()
        parts = add_vehicle(builder, spec, at=sw.pose((0.0, 0.0, 50.0)), speed=60.0)
        model = builder.finalize(1, "cpu", per_world=per_world())
        vehicle = Vehicles([parts], model) if several else Vehicle(parts, model)
        soil = soil_under(vehicle, "mid", shapes=[SoilBox(body=parts.chassis, half=(2.0, 1.0, 0.2))] if belly else [])
        if belly:
            with pytest.raises(sw.ModelError, match="act on body 'chassis' must come before the soil"):
                sw.Simulation(model, 2e-3, elements=[soil, vehicle], solver=VEHICLE_SOLVER)
        simulation = sw.Simulation(model, 2e-3, elements=[vehicle, soil], solver=VEHICLE_SOLVER, threads=1)
        simulation.step(100)
        speeds.append(simulation.state.body_v.numpy()[0, parts.chassis, 0])
    assert speeds[0] == speeds[1] < 59.7
