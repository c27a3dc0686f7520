"""Flexible meshes on soil: what they carry, how deep they sink, momentum, worlds, and inputs that are refused."""

import dataclasses
import math

import numpy as np
import pytest

import simwarp as sw
from simwarp.soil import PRESETS, Bulldozing, Soil, SoilMesh, SoilWheel, soil_under
from simwarp.vehicle import VEHICLE_SOLVER, Vehicle, add_vehicle, load_vehicle, per_world, with_options
from simwarp.vehicle.tires.flexible_tires import TireShell

GRAVITY = 9.81
SPACING = 0.05


def hmmwv_tire(**parameters):
    found = with_options(load_vehicle("hmmwv"), tire="flexible").axles[0].tire
    return dataclasses.replace(found, parameters={**found.parameters, **parameters})


def sheet(*, side=0.5, cells=10, thickness=0.02, height=0.0, density=2000.0, lean=0.0, rubber=2e8, gravity=-GRAVITY):
    """A square sheet of uniform triangles, stiff like a plate, level or leaning about y."""
    along = np.linspace(-0.5 * side, 0.5 * side, cells + 1)
    x, y = (axis.ravel() for axis in np.meshgrid(along, along, indexing="ij"))
    corner = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    builder = sw.ModelBuilder((0.0, 0.0, gravity))
    points = np.stack([x, y, 0.0 * x], axis=1)
    turn = (0.0, math.sin(0.5 * lean), 0.0, math.cos(0.5 * lean))
    mesh = builder.add_shell(
        "plate", points, triangles, thickness=thickness,
        material=sw.flex.Elastic(young=rubber, poisson=0.3, density=density, damping_time=0.02),
        pose=sw.pose((0.013, 0.007, height), turn),
    )  # fmt: skip
    return builder, mesh


def simulated(builder, mesh, soil="mid", *, worlds=1, spacing=SPACING, dt=1e-3, per_world_names=(), **options):
    model = builder.finalize(world_count=worlds, device="cpu", per_world=list(per_world_names))
    element = Soil(model, [], soil, meshes=[SoilMesh(mesh=mesh)], spacing=spacing, **options)
    flex = sw.flex.Options(numerical_damping=1.0)
    return sw.Simulation(model, dt, elements=[element], threads=1, flex=flex), element


def momentum(sim):
    return (sim.model.body_mass.numpy()[0][:, None] * sim.state.body_v.numpy()[0]).sum(axis=0)


def test_a_plate_of_triangles_presses_by_the_law_of_plates():
    """A plate so heavy that a step hardly moves it: Bekker's pressure on all cells below it."""
    depth, soil = 0.03, PRESETS["mid"]
    builder, mesh = sheet(side=0.5, height=0.01 - depth, gravity=0.0, density=2e7)
    sim, element = simulated(builder, mesh)
    sim.step(1)
    # nodes of the ground below a square: 10 in a row, of which each has a cell of its own
    area = int(element.touched.numpy()[0, 0]) * SPACING**2
    assert area == pytest.approx(0.25, rel=1e-6)
    law = soil.k_phi * depth**soil.exponent
    # 1e5 kg get 1e-4 m/s, of which 50 kg of implicit soil feel 5 N
    assert float(element.load.numpy()[0, 0]) == pytest.approx(area * law, rel=1e-3)


def test_what_soil_gives_is_what_the_mesh_gets():
    builder, mesh = sheet(height=0.0, lean=0.05)
    sim, element = simulated(builder, mesh)
    sim.state.body_v.fill_((0.4, 0.1, -0.5))
    sim.measure()
    weight = np.array([0.0, 0.0, -GRAVITY]) * sim.model.body_mass.numpy()[0].sum()
    largest = 0.0
    for _ in range(60):
        before = momentum(sim)
        sim.step(1)
        change = (momentum(sim) - before) / 1e-3
        force = element.force_w.numpy()[0, 0]
        # float32 velocities of 121 nodes, over a step
        assert np.abs(change - weight - force).max() < 1e-3 * max(float(np.abs(force).max()), 100.0)
        largest = max(largest, float(np.abs(force).max()))
    assert largest > 300.0


@pytest.mark.slow
def test_it_comes_to_rest_and_stays():
    builder, mesh = sheet(height=0.01)
    sim, element = simulated(builder, mesh)
    sim.step(1500)
    weight = GRAVITY * sim.model.body_mass.numpy()[0].sum()
    assert float(element.load.numpy()[0, 0]) == pytest.approx(weight, rel=1e-3)
    start = sim.state.body_x.numpy()[0].copy()
    sim.step(500)
    # shear holds it: no creep
    assert np.abs(sim.state.body_x.numpy()[0] - start).max() < 1e-5


def test_energy_never_grows():
    """Thrown onto soil; the soil's own elastic energy, which is not in the sum, is that of 1e-4 m of unloading."""
    builder, mesh = sheet(height=0.03, lean=0.2, thickness=0.01, rubber=1e7)
    sim, _ = simulated(builder, mesh)
    sim.state.body_v.fill_((1.0, 0.0, -1.0))
    sim.measure()
    energies = [float(sim.measure_energy().numpy()[0])]
    for _ in range(100):
        sim.step(5)
        energies.append(float(sim.measure_energy().numpy()[0]))
    kinetic = 0.5 * 5.0 * 2.0
    # velocities lie half a step before positions: 9.81 * 1.4 m/s * half a millisecond * 5 kg is 0.03 J
    assert (np.diff(energies) < 0.01 * kinetic).all()
    assert energies[-1] < energies[0] - 0.9 * kinetic


@pytest.mark.slow
def test_worlds_do_not_know_of_each_other():
    def after(worlds, world):
        builder, mesh = sheet(height=0.02, lean=0.1)
        sim, element = simulated(builder, mesh, worlds=worlds)
        velocity = np.zeros_like(sim.state.body_v.numpy())
        velocity[:, :, 0] = 0.5
        velocity[world, :, 0] = 0.8
        sim.state.body_v.assign(velocity)
        sim.measure()
        sim.step(80)
        return sim.state.body_x.numpy()[world], element.force_w.numpy()[world]

    for one, two in zip(after(1, 0), after(3, 2), strict=True):
        assert (one == two).all()
    for one, two in zip(after(1, 0), after(1, 0), strict=True):
        assert (one == two).all()


def standing_wheel(soil, load=6250.0, *, mesh=True, steps=2400, **parameters):
    """A wheel that is let down slowly: (how far its axle is below its radius, deepest rut, nodes, load over weight)."""
    tire = hmmwv_tire(**parameters)
    shell = TireShell(tire)
    builder = sw.ModelBuilder()
    mass, place = load / GRAVITY, sw.pose((0.003, 0.001, tire.radius))
    own = mass - (tire.mass - shell.held_mass) if mesh else mass
    wheel = builder.add_body("wheel", mass=own, inertia=(20.0, 30.0, 20.0), pose=place)
    builder.add_joint_prismatic("up", sw.WORLD, wheel, axis=(0, 0, 1))
    flexible = shell.add(builder, "tire", wheel, place) if mesh else None
    model = builder.finalize(1, "cpu")
    shapes = [] if mesh else [SoilWheel(body=wheel, radius=tire.radius, width=tire.width)]
    element = Soil(model, shapes, soil, meshes=[] if flexible is None else [SoilMesh(mesh=flexible)])
    options = sw.flex.Options(numerical_damping=1.0)
    sim = sw.Simulation(model, 1e-3, elements=[element], threads=1, flex=options)
    force, balance = np.zeros((1, model.body_count, 3), np.float32), []
    for step in range(0, steps, 10):
        force[0, wheel, 2] = load * max(0.0, 1.0 - step / (0.7 * steps))
        sim.control.body_force.assign(force)
        sim.step(10)
        if step >= steps - 400:
            balance.append(float(element.load.numpy()[0, 0]) / load)
    sunk = tire.radius - float(sim.state.body_x.numpy()[0, wheel, 2])
    return sunk, float(element.sinkage.numpy()[0, 0]), int(element.touched.numpy()[0, 0]), float(np.mean(balance))


@pytest.mark.slow
def test_a_tire_sinks_less_the_softer_it_is_and_more_than_a_plate():
    """From a rigid tire of the same shape to a plate of the same area, at one load on mid soil."""
    load, law = 6250.0, PRESETS["mid"]
    rigid = standing_wheel("mid", load, young=4e8, pressure=1.2e6)
    usual = standing_wheel("mid", load)
    soft = standing_wheel("mid", load, pressure=0.8e5)
    plate = (load / (usual[2] * SPACING**2 * law.k_phi)) ** (1.0 / law.exponent)
    assert rigid[1] > usual[1] > soft[1] > plate
    for sunk, rut, _, balance in (rigid, usual, soft):
        # it still swings on its air by a hundredth of its load: the mean over 0.4 s, more than a period
        assert balance == pytest.approx(1.0, abs=0.01)
        # the tire's own deflection comes on top
        assert sunk > rut - 0.02


@pytest.mark.slow
def test_a_vehicle_on_flexible_tires_drives_as_on_rigid_ones_that_its_soil_is_softer_than():
    found = []
    for tire in ("soil-rigid", "flexible"):
        builder = sw.ModelBuilder()
        parts = add_vehicle(builder, with_options(load_vehicle("hmmwv"), tire=tire), speed=3.0)
        model = builder.finalize(1, "cpu", per_world=per_world())
        vehicle = Vehicle(parts, model)
        soil = soil_under(vehicle, "mid")
        sim = sw.Simulation(model, 1e-3, elements=[vehicle, soil], solver=VEHICLE_SOLVER, threads=1)
        vehicle.input.assign(np.array([[0.0, 0.5, 0.0, 0.0]], np.float32))
        loads = []
        for _ in range(10):
            sim.step(100)
            loads.append(vehicle.tires.load.numpy()[0].sum())
        assert soil.recycled.numpy()[0] == 0
        assert np.mean(loads[2:]) == pytest.approx(GRAVITY * sum(b.mass for b in builder.bodies), rel=0.05)
        assert (vehicle.tires.deflection.numpy()[0] > 0.03).all()
        found.append(float(sim.state.body_v.numpy()[0, parts.chassis, 0]))
    # 4.2 m/s; treads differ: that of the flexible tire is round
    assert found[1] == pytest.approx(found[0], rel=0.05)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"bulldozing": Bulldozing()}, "bulldozing must be None below meshes"),
        ({"spacing": 0.0}, "spacing must be positive"),
        ({"pages": 3}, "pages"),
    ],
)
def test_what_meshes_do_not_take_is_one_line(options, line):
    builder, mesh = sheet()
    model = builder.finalize(1, "cpu")
    with pytest.raises(sw.ModelError, match=line) as error:
        Soil(model, [], "mid", meshes=[SoilMesh(mesh=mesh)], **{"spacing": SPACING, **options})
    assert "\n" not in str(error.value)


def test_meshes_of_others_twice_or_held_are_refused():
    (builder, mesh), (_, other) = sheet(), sheet()
    model = builder.finalize(1, "cpu")
    with pytest.raises(sw.ModelError, match="'plate' must be one of the model's"):
        Soil(model, [], "mid", meshes=[SoilMesh(mesh=other)])
    with pytest.raises(sw.ModelError, match="got 'plate' twice"):
        Soil(model, [], "mid", meshes=[SoilMesh(mesh=mesh)] * 2)
    with pytest.raises(sw.ModelError, match="mesh"):
        SoilMesh(mesh="plate")  # type: ignore[arg-type]
    with pytest.raises(sw.ModelError, match="shapes must be at least one"):
        Soil(model, [])
    sim = simulated(*sheet())[0]
    with pytest.raises(sw.ModelError, match="imprint must be of a soil without meshes"):
        sim.elements[0].imprint()
