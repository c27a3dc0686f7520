"""A short tracked vehicle on the CPU and on the emulated device; prints as JSON how they agree.

`python -m tests.emulated_cuda tests/emulated_cuda/tracks_on_device.py [NAME ...]`
"""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from typing import Any

import numpy as np
import warp as wp

import simwarp as sw
from simwarp.vehicle import (
    TRACK_SOLVER,
    VEHICLE_SOLVER,
    TrackedVehicle,
    add_tracked_vehicle,
    load_tracked_vehicle,
    per_world,
    with_belts,
)
from simwarp.vehicle.tracks.belt_tables_kernels import BeltParameter
from tests.emulated_cuda.device import device
from tests.emulated_cuda.settings import StreamOrder
from tests.unit.vehicle.tracks.short_vehicles import shortened

CASES: dict[str, tuple[bool, str | None, int]] = {
    "belts": (True, None, 5), "belts on soil": (True, "mid", 5), "chains": (False, None, 3),
}  # fmt: skip
"""Whether the tracks are belts, the soil below, and steps of 1 ms."""
INPUTS = np.array([[0.3, 1.0, 0.0, 0.0], [0.0, 0.5, 0.2, 0.0]], np.float32)
"""Of each world: steering, throttle, braking, clutch."""
VELOCITIES = np.array([[0.0, 0.0, 0.0], [0.5, 0.2, 0.0]])
"""With which each world begins [m/s]: at rest, where rounding chooses the signs of belts' speeds, and in motion."""
BELT_SPEED = 0.4
"""Of both belts in the world that moves [m/s]; less than the vehicle's, so that they slide."""
HEIGHT = 0.57
"""Of the sprockets' axes at the start [m]: tracks are on the ground, and a little in it."""
Arrays = dict[str, np.ndarray[Any, Any]]


def arrays(name: str, where: str, *, capture: bool = False) -> Arrays:
    """Motion and readings after some steps, the worlds driven in different ways."""
    on_belts, soil, steps = CASES[name]
    spec = shortened(load_tracked_vehicle("m113"))
    builder = sw.ModelBuilder()
    parts = add_tracked_vehicle(builder, with_belts(spec) if on_belts else spec, at=sw.pose((0.0, 0.0, HEIGHT)))
    if not on_belts:
        builder.add_shape_plane(material=sw.Material(friction=0.9))
    model = builder.finalize(len(INPUTS), where, per_world=per_world(), contact_capacity=None if on_belts else 120)
    vehicle = TrackedVehicle(parts, model, soil=soil)
    solver = VEHICLE_SOLVER if on_belts else dataclasses.replace(TRACK_SOLVER, max_iterations=10)
    sim = sw.Simulation(model, 1e-3, elements=[vehicle], solver=solver, check_start=False)
    vehicle.input.assign(INPUTS)
    sim.state.body_v.assign(sim.state.body_v.numpy() + VELOCITIES[:, None])
    if vehicle.belts is not None:
        rates = sim.state.joint_qd.numpy()
        radii = vehicle.belts.parameter.numpy()[0, :, BeltParameter.PITCH_RADIUS]
        rates[1, [model.joint_dof_start[belt.sprocket] for belt in vehicle.belts.parts]] = BELT_SPEED / radii
        sim.state.joint_qd.assign(rates)
    sim.step()
    if capture:
        with wp.ScopedCapture(where) as captured:
            sim.step()
        for _ in range(steps - 1):
            wp.capture_launch(captured.graph)
    else:
        sim.step(steps - 1)
    found = {
        "place": sim.state.body_x, "velocity": sim.state.body_v, "turning": sim.state.body_omega,
        "tension": vehicle.tension, "sprockets": vehicle.sprocket_speed,
    }  # fmt: skip
    return {key: np.asarray(array.numpy(), float) for key, array in found.items()}


def main(names: list[str]) -> None:
    """Run each case."""
    wp.config.log_level = wp.LOG_WARNING
    target, rows = device(), {}
    for name in names or list(CASES):
        begun = time.perf_counter()
        host, found = arrays(name, "cpu"), {}
        for seed, order, capture in ((1, StreamOrder.EAGER, False), (7, StreamOrder.LAZY, True)):
            target.seed, target.streams.order = seed, order
            found[seed] = arrays(name, "cuda:0", capture=capture)
            print(f"{name}: seed {seed} after {time.perf_counter() - begun:.0f} s", file=sys.stderr, flush=True)
        rows[name] = {
            "difference": {key: float(np.abs(host[key] - found[1][key]).max()) for key in host},
            "largest": {key: float(np.abs(host[key]).max()) for key in host},
            "apart": float(np.abs(host["velocity"][0] - host["velocity"][1]).max()),
            "equal": all(np.array_equal(found[1][key], found[7][key]) for key in host),
            "faults": [text for text, _ in target.faults.violations], "races": target.races()[0],
        }  # fmt: skip
    print(json.dumps(rows))


if __name__ == "__main__":
    main(sys.argv[1:])
