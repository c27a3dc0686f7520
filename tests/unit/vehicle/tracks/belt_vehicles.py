"""Vehicles on belts for tests: the M113, a plain one, and what tests read of them."""

import dataclasses

import numpy as np

import simwarp as sw
from simwarp.core.rotation import rotate
from simwarp.vehicle.spec.belt_parts import belt_of
from simwarp.vehicle.tracks.belts import Belts
from simwarp.vehicle.tracks.tracked_construction import add_tracked_vehicle
from simwarp.vehicle.tracks.tracked_files import load_tracked_vehicle
from simwarp.vehicle.vehicle import VEHICLE_SOLVER
from tests.unit.vehicle.tracks.undriven_vehicles import undriven

M113 = undriven(load_tracked_vehicle("m113"))
GRAVITY = 9.81
RECORDED_LOSSES = {
    "sprocket_loss": 0.0, "dry_loss": 0.005, "rolling_loss": 0.0, "linear_loss": 0.0, "square_loss": 1.4e-3,
}  # fmt: skip
"""Of Project Chrono's runs, where friction hardly acts at the speeds at which shoes slide."""


def vehicle(
    *, law=None, track=None, spec=M113, worlds=1, dt=1e-3, gravity=(0.0, 0.0, -GRAVITY), at=None, terrain=None,
    symmetric=False, **options,
):  # fmt: skip
    """A simulation, the vehicle's parts and its belts.

    Args:
        law: fields of `BeltLaw`, beside the recorded losses.
        track: what to make of both tracks before they become belts.
        terrain: adds ground to a builder, and returns its name.
        symmetric: both belts are the left one.
    """
    sides = [spec.left, spec.left if symmetric else spec.right]
    if track is not None:
        sides = [track(side) for side in sides]
    left, right = (belt_of(side, **RECORDED_LOSSES | (law or {})) for side in sides)
    builder = sw.ModelBuilder(gravity=gravity)
    parts = add_tracked_vehicle(builder, dataclasses.replace(spec, left=left, right=right), at=at)
    name = None if terrain is None else terrain(builder)
    model = builder.finalize(worlds, "cpu")
    if name is not None:
        options["ground"] = sw.vehicle.ground_of(model, name)
    belts = Belts(parts.belts, model, alone=True, **options)
    sim = sw.Simulation(model, dt, elements=[belts], solver=VEHICLE_SOLVER, check_start=False, threads=1)
    return sim, parts, belts


def undamped(side):
    """A track without dampers."""
    mounts = tuple(
        dataclasses.replace(mount, suspension=dataclasses.replace(mount.suspension, damping=0.0, shock=None))
        for mount in side.road_wheels
    )
    tensioner = dataclasses.replace(side.idler.tensioner, damping=0.0)
    return dataclasses.replace(
        side, road_wheels=mounts, idler=dataclasses.replace(side.idler, tensioner=tensioner)
    )  # fmt: skip


def mass_of(sim):
    return sum(body.mass for body in sim.model.builder.bodies)


def drive(sim, parts, left, right):
    """Torques on the sprockets from now on [N·m]."""
    force = sim.control.joint_force.numpy().copy()
    for side, torque in ((parts.left, left), (parts.right, right)):
        force[:, sim.model.builder.dof_start(side.sprocket)] = torque
    sim.control.joint_force.assign(force)


def reference_point(sim, parts):
    return np.asarray(sim.body_position("chassis")) + rotate(sim.body_rotation("chassis"), parts.reference)


def pitch(sim):
    q = sim.body_rotation("chassis")
    return 2.0 * (q[3] * q[1] - q[0] * q[2])


def arm_angles(sim, side):
    return np.array([sim.joint_position(arm) for arm in side.arms])


def evaluate(sim, belts, times=1, dt=None):
    """Forces of the present state, again and again, while nothing moves but what the belts remember."""
    launches = belts.record(sim, sim.dt if dt is None else dt)
    for _ in range(times):
        for launch in launches:
            launch.launch()
