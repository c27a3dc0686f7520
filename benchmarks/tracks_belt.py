"""A tracked vehicle on belts: speed in many worlds, statics and starts beside a recorded run and shoe by shoe.

Run: python benchmarks/tracks_belt.py [--shoes] [--json FILE]       some ten seconds; --shoes: two minutes more, for the
same starts and turns shoe by shoe, on smooth sprockets
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import simwarp as sw
from benchmarks.tracks_at_rest import (
    RECORDED,
    TORQUE,
    simulation as shoe_simulation,
    vehicle as shoe_vehicle,
)
from simwarp.bench.machine import describe
from simwarp.core.rotation import rotate
from simwarp.vehicle import (
    VEHICLE_SOLVER,
    Belts,
    TrackedVehicleParts,
    add_tracked_vehicle,
    load_tracked_vehicle,
    with_belts,
)

WORLDS: Final = 64
STEPS: Final = 1000
SPEEDS: Final = {1: 1.001, 2: 2.416, 3: 3.587, 4: 4.604, 5: 5.517, 6: 6.313, 7: 6.944}
"""Seconds after the start -> m/s, Project Chrono with Coulomb friction (m113_SMCPC_SIMPLE_accel)."""
CASES: Final = {"straight": (TORQUE, TORQUE), "uneven": (500.0, 4000.0), "pivot": (-4600.0, 4600.0)}
"""Torques on the left and the right sprocket [N·m]."""


RECORDED_LOSSES: Final = {
    "sprocket_loss": 0.0, "dry_loss": 0.005, "rolling_loss": 0.0, "linear_loss": 0.0, "square_loss": 1.4e-3,
}  # fmt: skip
"""Of the recorded run, 250 N for (1 m/s)²: its friction, μ N tanh(5 v), hardly acts on the slow sliding of shoes."""


def vehicle(
    worlds: int = 1, dt: float = 1e-3, soil: str | None = None, **law: Any
) -> tuple[sw.Simulation, TrackedVehicleParts, Belts]:
    """The M113 on belts, on a plane, on one thread."""
    spec = load_tracked_vehicle("m113")
    left, right = (dataclasses.replace(track, brake=None) for track in (spec.left, spec.right))
    spec = dataclasses.replace(spec, left=left, right=right, driveline=None, engine=None, transmission=None)
    builder = sw.ModelBuilder()
    parts = add_tracked_vehicle(builder, with_belts(spec, **RECORDED_LOSSES | law))
    model = builder.finalize(worlds, "cpu")
    belts = Belts(parts.belts, model, soil=soil, alone=True)
    sim = sw.Simulation(model, dt, elements=[belts], solver=VEHICLE_SOLVER, check_start=False, threads=1)
    return sim, parts, belts


def drive(sim: sw.Simulation, parts: Any, left: float, right: float) -> None:
    """Torques on the sprockets from now on [N·m]."""
    force = sim.control.joint_force.numpy().copy()
    for side, torque in ((parts.left, left), (parts.right, right)):
        force[:, sim.model.builder.dof_start(side.sprocket)] = torque
    sim.control.joint_force.assign(force)


def speeds() -> dict[str, Any]:
    """World-steps of 1 ms per second of CPU time, driving."""
    found: dict[str, Any] = {}
    for name, soil, law in (
        ("plane, 33 points a belt", None, {}), ("plane, 21 points", None, {"span_points": 2, "ramp_points": 2}),
        ("soil, 33 points", "mid", {}),
    ):  # fmt: skip
        sim, parts, _ = vehicle(WORLDS, soil=soil, **law)
        drive(sim, parts, TORQUE, TORQUE)
        sim.step(STEPS)
        start = time.process_time()
        sim.step(STEPS)
        found[name] = round(WORLDS * STEPS / (time.process_time() - start))
        print(f"{name}: {found[name]} world-steps/s", flush=True)
    return found


def at_rest() -> dict[str, Any]:
    """Means of the last 2.5 of 10 s."""
    found: dict[str, Any] = {"recorded": RECORDED}
    sim, parts, belts = vehicle()
    sim.step(7500)
    rows = []
    for _ in range(250):
        sim.step(10)
        x, q = (np.asarray(value, np.float64) for value in (sim.body_position("chassis"), sim.body_rotation("chassis")))
        tension, idler = belts.tension.numpy()[0] / 1e3, belts.idler.numpy()[0] - 3.95
        arms = [[sim.joint_position(arm) for arm in side.arms] for side in (parts.left, parts.right)]
        rows.append([(x + rotate(q, parts.reference))[2], 2.0 * (q[3] * q[1] - q[0] * q[2]), *idler, *tension,
                     *arms[0], *arms[1]])  # fmt: skip
    means: list[float] = np.array(rows).mean(axis=0).round(4).tolist()
    names = list(RECORDED)
    found["belt"] = {**dict(zip(names[:6], means[:6], strict=True)), names[6]: means[6:11], names[7]: means[11:]}
    print(f"rest: {found['belt']}", flush=True)
    return found


def start() -> dict[str, Any]:
    """Speed after each second at full torque, beside the recorded run's [m/s]."""
    sim, parts, _ = vehicle()
    sim.step(5000)
    drive(sim, parts, TORQUE, TORQUE)
    found = {}
    for second, recorded in SPEEDS.items():
        sim.step(1000)
        found[f"{second} s"] = {"belt": round(float(sim.body_velocity("chassis")[0]), 3), "recorded": recorded}
    print(f"start: {found}", flush=True)
    return found


def beside_shoes() -> dict[str, Any]:
    """Speed and yaw rate 1, 2 and 3 s after the start, on belts and shoe by shoe [m/s, rad/s]."""
    found: dict[str, Any] = {}
    for name, torques in CASES.items():
        builder, shoe_parts = shoe_vehicle(True)
        shoes = shoe_simulation(builder.finalize(1, "cpu", contact_capacity=200), 60)
        belt, parts, _ = vehicle()
        belt.step(5000)
        shoes.step(3000)
        rows = []
        for sim, each in ((belt, parts), (shoes, shoe_parts)):
            drive(sim, each, *torques)
        for _ in range(3):
            row = {}
            for kind, sim, chassis in (("belt", belt, parts.chassis), ("shoes", shoes, shoe_parts.chassis)):
                sim.step(1000)
                v = np.linalg.norm(sim.body_velocity("chassis")[:2])
                row[kind] = [round(float(v), 3), round(float(sim.state.body_omega.numpy()[0, chassis, 2]), 3)]
            rows.append(row)
        found[name] = rows
        print(f"{name}: {rows}", flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shoes", action="store_true", help="the same starts shoe by shoe, too")
    parser.add_argument("--json", type=Path, help="file for the results")
    arguments = parser.parse_args()
    results = {
        "machine": describe(wp.get_device("cpu")), "speed": speeds(), "rest": at_rest(), "start": start(),
    }  # fmt: skip
    if arguments.shoes:
        results["beside shoes"] = beside_shoes()
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
