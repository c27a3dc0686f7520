"""Joint reactions balance what soil really gave in a step, F - D dv / h."""

from __future__ import annotations

import numpy as np
import pytest

import simwarp as sw
from simwarp.soil import Soil, SoilWheel, soil_under
from simwarp.vehicle import VEHICLE_SOLVER, Vehicle, add_vehicle, load_vehicle, per_world, with_options
from tests.unit.soil.soil_wheels import GRAVITY, RADIUS, WIDTH


@pytest.mark.parametrize("soil", ["mid", "hard"])
def test_a_wheels_joint_bears_what_the_soil_does_not_in_every_step(soil):
    """A wheel that falls on soil while its joint accelerates it: m dv / h = soil + joint + weight, moments likewise."""
    builder = sw.ModelBuilder()
    mass, spin = 100.0, (3.0, 5.0, 3.0)
    sled = builder.add_body("sled", mass=300.0, inertia=(9.0, 9.0, 9.0), pose=sw.pose((0.0, 0.0, RADIUS + 0.05)))
    wheel = builder.add_body("wheel", mass=mass, inertia=spin, pose=sw.pose((0.0, 0.0, RADIUS + 0.05)))
    builder.add_joint_prismatic("up", sw.WORLD, sled, axis=(0, 0, 1))
    motor = sw.VelocityMotor(effort_limit=800.0)
    turn = builder.add_joint_revolute("turn", sled, wheel, axis=(0, 1, 0), drive=motor)
    model = builder.finalize(1, "cpu")
    element = Soil(model, [SoilWheel(body=wheel, radius=RADIUS, width=WIDTH)], soil)
    dt = 2e-3
    simulation = sw.Simulation(model, dt, elements=[element], threads=1, joint_reactions=True)
    simulation.control.joint_target_qd.fill_(5.0)
    state, touched = simulation.state, 0
    for _ in range(250):
        before, spinning = state.body_v.numpy()[0, wheel].copy(), state.body_omega.numpy()[0, wheel].copy()
        simulation.step()
        gained = mass * (state.body_v.numpy()[0, wheel] - before) / dt
        turned = spin[1] * (state.body_omega.numpy()[0, wheel] - spinning)[1] / dt
        soils, moment = element.force_w.numpy()[0, 0], element.torque_w.numpy()[0, 0]
        joint = simulation.diagnostics.joint_reaction_force.numpy()[0, turn]
        torque = simulation.diagnostics.joint_reaction_torque.numpy()[0, turn]
        size = float(np.abs(soils).max()) + mass * GRAVITY
        # single precision: differences of velocities of 1 m/s over 2 ms, of 100 kg
        np.testing.assert_allclose(joint, gained - soils + (0, 0, mass * GRAVITY), atol=2e-4 * size + 0.02)
        assert float(torque[1]) == pytest.approx(turned - float(moment[1]), abs=2e-4 * size * RADIUS + 0.02)
        touched += int(element.touched.numpy()[0, 0] > 0)
    assert touched > 150


def test_a_parked_hmmwvs_wheels_press_on_their_joints():
    """With the load less the wheel's weight, to 1 %: it stands still."""
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, with_options(load_vehicle("hmmwv"), tire="soil-rigid"))
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model)
    soil = soil_under(vehicle, "mid")
    simulation = sw.Simulation(
        model, 1e-3, elements=[vehicle, soil], solver=VEHICLE_SOLVER, threads=1, joint_reactions=True
    )
    simulation.step(4000)
    masses = model.parameters.body_mass.numpy()[0]
    loads = soil.load.numpy()[0]
    reactions = simulation.diagnostics.joint_reaction_force.numpy()[0]
    assert loads.sum() == pytest.approx(masses.sum() * GRAVITY, rel=1e-3)
    for wheel, side in enumerate(parts.sides):
        borne = float(loads[wheel]) - float(masses[side.spindle]) * GRAVITY
        assert -float(reactions[side.spin][2]) == pytest.approx(borne, rel=0.01)
