"""A wheel of a HMMWV on its flexible tire: load over deflection, ripple as it rolls, energy, an edge of 5 cm."""

import dataclasses
import math

import numpy as np
import pytest

import simwarp as sw
from simwarp.vehicle import VEHICLE_SOLVER, load_vehicle, with_options
from simwarp.vehicle.tires.flexible_tires import TireShell

LOAD = 6250.0
"""Of a quarter of the vehicle [N]."""
DEFLECTION = 0.028
"""Under it, about [m]."""
DT = 1e-3


def shell_of(**parameters):
    tire = with_options(load_vehicle("hmmwv"), tire="flexible").axles[0].tire
    return TireShell(dataclasses.replace(tire, parameters={**tire.parameters, **parameters})), tire


def rolling(*, speed, edge=0.0, friction=0.9, **parameters):
    """A wheel under a quarter of the vehicle, with a damper to a carriage that slides ahead."""
    shell, tire = shell_of(**parameters)
    builder = sw.ModelBuilder()
    builder.add_shape_plane(material=sw.Material(friction=friction))
    across = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    if edge:
        builder.add_shape_cylinder(sw.WORLD, radius=edge, half_length=1.0, pose=sw.pose((1.5, 0.0, 0.0), across))
    at = sw.pose((0.0, 0.0, tire.radius + 0.5 * shell.values.thickness - DEFLECTION))
    carriage = builder.add_body("carriage", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=at)
    mass = LOAD / 9.81 - tire.mass - 20.0
    axle = builder.add_body("axle", mass=mass, inertia=(10.0, 10.0, 10.0), pose=at)
    inertia = np.array([0.5, 1.0, 0.5]) + shell.held_inertia()
    rim = builder.add_body("rim", mass=20.0 + shell.held_mass, inertia=tuple(inertia), pose=at)
    builder.add_joint_prismatic("ahead", sw.WORLD, carriage, axis=(1, 0, 0))
    # a third of critical on the tire's stiffness of 3.5e5 N/m
    builder.add_joint_prismatic("damper", carriage, axle, axis=(0, 0, 1), damping=1e4)
    builder.add_joint_revolute("spin", axle, rim, axis=(0, 1, 0), anchor=at.position)
    mesh = shell.add(builder, "tire", rim, at)
    model = builder.finalize(1, "cpu")
    sim = sw.Simulation(model, DT, solver=VEHICLE_SOLVER, threads=1)
    nodes, x = [mesh.bodies[node] for node in mesh.nodes], sim.state.body_x.numpy()[0]
    spin = speed / (tire.radius - 0.01)
    velocity, omega = (np.zeros((1, model.body_count, 3), np.float32) for _ in range(2))
    velocity[..., 0], omega[0, rim, 1] = speed, spin
    velocity[0, nodes] += np.cross((0.0, spin, 0.0), x[nodes] - x[rim])
    sim.state.body_v.assign(velocity)
    sim.state.body_omega.assign(omega)
    sim.measure()
    return sim, nodes, rim


def load(sim, nodes):
    """Of the road on the tire [N]."""
    return float(sim.contacts.body_contact_force.numpy()[0, nodes, 2].sum())


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Simulation. shapes overlap")
def test_its_load_ripples_by_less_than_three_percent_at_ten_metres_a_second_and_it_loses_energy():
    sim, nodes, _ = rolling(speed=10.0)
    sim.step(400)
    loads, energies = [], [float(sim.measure_energy().numpy()[0])]
    for step in range(600):
        sim.step(1)
        loads.append(load(sim, nodes))
        if step % 50 == 49:
            energies.append(float(sim.measure_energy().numpy()[0]))
    assert np.mean(loads) == pytest.approx(LOAD, rel=0.01)
    # nodes come down one row after the other, 150 rows a second
    assert np.std(loads) < 0.03 * LOAD
    # rolling takes work: never less than nothing within 50 ms, and a rolling resistance of 1 to 6 %
    assert (np.diff(energies) < 0.0).all()
    way = 0.6 * 10.0
    assert 0.01 < (energies[0] - energies[-1]) / (way * LOAD) < 0.06
    assert sim.state.world_status.numpy()[0] == 0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Simulation. shapes overlap")
def test_it_passes_an_edge_of_five_centimetres_at_ten_metres_a_second():
    sim, nodes, rim = rolling(speed=10.0, edge=0.05)
    sim.step(80)  # air presses the tire into its shape, which is work
    before = float(sim.measure_energy().numpy()[0])
    height = float(sim.state.body_x.numpy()[0, rim, 2])
    loads, heights = [], []
    for _ in range(320):
        sim.step(1)
        loads.append(load(sim, nodes))
        heights.append(float(sim.state.body_x.numpy()[0, rim, 2]))
    assert sim.state.world_status.numpy()[0] == 0
    assert float(sim.state.body_x.numpy()[0, rim, 0]) > 3.5
    # it bends over the edge: the axle rises by less than it, and is back within 0.2 s
    assert 1e-3 < max(heights) - height < 0.05
    assert abs(heights[-1] - height) < 0.01
    assert max(loads) > 1.5 * LOAD
    assert float(sim.measure_energy().numpy()[0]) < before


@pytest.mark.slow
def test_a_free_wheel_keeps_its_spin_for_ten_seconds():
    """In the air at 50 rad/s, h times which is 0.05: no growth, of neither spin nor energy."""
    shell, _ = shell_of(around=24, across=4)
    builder = sw.ModelBuilder((0.0, 0.0, 0.0))
    inertia = tuple(np.array([1.0, 2.0, 1.0]) + shell.held_inertia())
    rim = builder.add_body("rim", mass=20.0 + shell.held_mass, inertia=inertia)
    mesh = shell.add(builder, "tire", rim, sw.pose())
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT, threads=1)
    nodes, x = [mesh.bodies[node] for node in mesh.nodes], sim.state.body_x.numpy()[0]
    velocity, omega = (np.zeros((1, sim.model.body_count, 3), np.float32) for _ in range(2))
    omega[0, rim, 1] = 50.0
    velocity[0, nodes] = np.cross((0.0, 50.0, 0.0), x[nodes] - x[rim])
    sim.state.body_v.assign(velocity)
    sim.state.body_omega.assign(omega)
    sim.measure()
    # air and spin stretch it first
    sim.step(1000)
    spins, energies = [], []
    for _ in range(9):
        sim.step(1000)
        spins.append(float(sim.state.body_omega.numpy()[0, rim, 1]))
        energies.append(float(sim.measure_energy().numpy()[0]))
    # it never grows, and loses less than 1e-5 a turn, 64 turns: velocities are in float32
    assert np.diff(spins).max() < 1e-6 * 50.0
    assert spins[0] - spins[-1] < 64 * 1e-5 * 50.0
    assert np.diff(energies).max() < 1e-5 * energies[0]
    assert sim.state.world_status.numpy()[0] == 0
