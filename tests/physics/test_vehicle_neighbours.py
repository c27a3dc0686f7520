"""Vehicles among others in one world that they do not touch: each equals itself alone, and takes as much room."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.step_sizes import step_layouts, step_sizes
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.drivers import ScriptedDriver, ScriptSpec
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, Vehicles, per_world
from tests.physics.sample_vehicles import shipped

STEPS = 450
SCRIPTS = (
    # at full throttle through a gear change, around both bends, then on the brakes
    ScriptSpec(
        steering=((0.0, 0.0), (0.2, 0.0), (0.4, 0.4), (0.7, -0.3)), throttle=((0.0, 0.6), (0.5, 0.9), (0.55, 0.0)),
        braking=((0.0, 0.0), (0.6, 0.0), (0.65, 0.8)),
    ),
    ScriptSpec(steering=((0.0, 0.0), (0.2, -0.2)), throttle=((0.0, 0.3), (0.5, 0.9))),
)  # fmt: skip
SPEEDS = (9.0, 5.0)


def run(name: str, numbers: tuple[int, ...], *, as_one: bool = False) -> dict[int, dict[str, np.ndarray]]:
    """Vehicles of their numbers, 50 m apart, in one world: everything that there is of each after a run.

    `as_one`: one force element acts for all of them.
    """
    builder, spec = ModelBuilder(), shipped(name)
    places = {number: sw.pose((0.0, 50.0 * number, spec.start_height)) for number in numbers}
    parts = [
        add_vehicle(builder, spec, at=places[number], prefix=f"v{number}_", speed=SPEEDS[number]) for number in numbers
    ]
    model = builder.finalize(2, "cpu", per_world=per_world())
    vehicles: Any = [Vehicle(each, model, randomised=True) for each in parts]
    if as_one:
        vehicles = Vehicles(parts, model, randomised=True)
    drivers: list[Any] = [
        ScriptedDriver(vehicle, SCRIPTS[number]) for number, vehicle in zip(numbers, vehicles, strict=True)
    ]
    sim = sw.Simulation(
        model,
        2e-3,
        elements=[*drivers, *([vehicles] if as_one else vehicles)],
        solver=VEHICLE_SOLVER,
        joint_reactions=True,
    )
    sim.advance(STEPS)
    found: dict[int, dict[str, np.ndarray]] = {}
    for index, number in enumerate(numbers):
        bodies = [k for k, body in enumerate(model.body_names) if body.startswith(f"v{number}_")]
        joints = [k for k, joint in enumerate(model.joint_names) if joint.startswith(f"v{number}_")]
        starts = model.joint_dof_start
        dofs = [dof for joint in joints for dof in range(starts[joint], starts[joint + 1])]
        mine = {
            key: getattr(sim.state, key).numpy()[:, bodies] for key in ("body_x", "body_rot", "body_v", "body_omega")
        }
        mine |= {key: getattr(sim.state, key).numpy()[:, dofs] for key in ("joint_x", "joint_q", "joint_qd")}
        for key in ("joint_reaction_force", "joint_reaction_torque"):
            mine[key] = getattr(sim.diagnostics, key).numpy()[:, joints]
        told = ("position", "angles", "velocity_b", "omega_b", "acceleration_b", "gear", "engine_speed", "drive_torque")
        mine |= {key: getattr(vehicles[index], key).numpy() for key in told}
        mine["load"] = vehicles[index].tires.load.numpy()
        found[number] = mine
    return found


@pytest.mark.parametrize("name", ["hmmwv", "gator", "sedan", "artcar", "skid-steer"])
def test_a_vehicle_among_others_equals_itself_alone(name):
    both, as_one = run(name, (0, 1)), run(name, (0, 1), as_one=True)
    for number in (0, 1):
        for key, values in run(name, (number,))[number].items():
            assert values.tobytes() == both[number][key].tobytes(), (number, key)
            assert values.tobytes() == as_one[number][key].tobytes(), (number, key)


CROSSING = ((0.0, 0.0), (0.0, 60.0), (9.0, 60.0))
"""Places of three vehicles [m]; the last drives backwards into the one before it."""


def on_rigid_tires(numbers: tuple[int, ...]) -> tuple[dict[int, dict[str, np.ndarray]], np.ndarray]:
    """Vehicles with boxes for bodies that roll on a floor: all there is of each, and their positions in time."""
    builder, spec = ModelBuilder(), with_options(shipped("hmmwv"), tire="rigid")
    builder.add_shape_plane(material=sw.Material(friction=0.9), name="floor")
    for number in numbers:
        x, y = CROSSING[number]
        speed = -6.0 if number == 2 else 6.0
        parts = add_vehicle(
            builder, spec, at=sw.pose((x, y, spec.start_height)), prefix=f"v{number}_", speed=speed,
            gear=-1 if number == 2 else None,
        )  # fmt: skip
        builder.add_shape_box(parts.chassis, half=(2.3, 1.05, 0.3), name=f"v{number}_box", group=2, mask=2)
    model = builder.finalize(1, "cpu", per_world=per_world())
    sim = sw.Simulation(model, 2e-3, solver=dataclasses.replace(VEHICLE_SOLVER, fallback=False))
    track = []
    for _ in range(50):
        sim.advance(10)
        track.append(sim.state.body_x.numpy()[0].copy())
    state, found = sim.state, {}
    for number in numbers:
        bodies = [k for k, name in enumerate(model.body_names) if name.startswith(f"v{number}_")]
        found[number] = {
            key: getattr(state, key).numpy()[:, bodies] for key in ("body_x", "body_rot", "body_v", "body_omega")
        }
        found[number]["force"] = sim.contacts.body_contact_force.numpy()[:, bodies]
    chassis = [k for k, name in enumerate(model.body_names) if name.endswith("_chassis")]
    return found, np.array(track)[:, chassis]


def test_a_vehicle_that_rolls_beside_a_crash_equals_itself_alone():
    alone, _ = on_rigid_tires((0,))
    crash, tracks = on_rigid_tires((1, 2))
    together, _ = on_rigid_tires((0, 1, 2))
    for part in (alone, crash):
        for number, mine in part.items():
            for key, values in mine.items():
                assert values.tobytes() == together[number][key].tobytes(), (number, key)
    gap = tracks[:, 1, 0] - tracks[:, 0, 0] - 4.6
    assert gap[0] > 3.0
    assert -0.3 < gap.min() < 0.1  # they meet, and their bodies do not pass through each other


def test_scratch_of_a_world_grows_by_the_number_of_vehicles():
    room: dict[int, int] = {}
    for count in (1, 2, 4, 8):
        builder, spec = ModelBuilder(), shipped("hmmwv")
        for number in range(count):
            place = sw.pose((0.0, 50.0 * number, spec.start_height))
            add_vehicle(builder, spec, at=place, prefix=f"v{number}_")
        model = builder.finalize(1, "cpu", per_world=per_world())
        assert model.row_groups.row_counts == [22] * count
        layouts = step_layouts(model, step_sizes(model, VEHICLE_SOLVER.dense_rows, False), 1)
        room[count] = sum(4 * int(np.prod(layout.shape)) for layout in layouts.values())
    for count in (2, 4, 8):
        assert room[count] <= 1.1 * count * room[1]
