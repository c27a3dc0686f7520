"""A tracked vehicle, shoe by shoe, at rest and driven: cost of a step, iterations, pins, statics beside a recorded run.

Run: python benchmarks/tracks_at_rest.py [solvers driven rest teeth] [--quick] [--json FILE]    some five minutes;
--quick: one. Solvers and rest are on smooth sprockets, teeth is rest on toothed ones.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import warp as wp

import simwarp as sw
from simwarp.bench.machine import describe
from simwarp.core.rotation import rotate
from simwarp.vehicle import SprocketContact, TrackedVehicleParts, add_tracked_vehicle, load_tracked_vehicle

WHEEL_COMPLIANCE: Final = 7.6e-7
"""Sink over load [m/N] of a recorded box on an idler under 25 kN: 19 mm, by Hertz's law with the recorded moduli."""
GROUND_COMPLIANCE: Final = 1.9e-6
"""The same of half a shoe on the ground under 4 kN: 7.5 mm."""
TORQUE: Final = 2253.0
"""Of each sprocket in the recorded acceleration [N·m]."""

RECORDED: Final = {
    "z [m]": 0.5932, "pitch [rad]": 0.0104, "idler left [m]": -4.0391, "idler right [m]": -4.0860,
    "pins left [kN]": 91.0, "pins right [kN]": 66.4,
    "arms left [rad]": [0.000, -0.172, -0.206, -0.225, -0.182],
    "arms right [rad]": [-0.088, -0.209, -0.228, -0.254, -0.227],
}  # fmt: skip
"""Means of the last 2.5 of 10 s, Project Chrono, penalty contacts (m113_SMC_SIMPLE_rest10)."""

SOLVERS: Final[dict[str, dict[str, Any]]] = {
    "apgd": {}, "psor": {"solver": "psor"}, "spg": {"solver": "spg"},
    "apgd, dense": {"dense_rows": 600}, "padmm, dense": {"solver": "padmm", "dense_rows": 600},
    "interior point, dense": {"solver": "interior_point", "dense_rows": 600},
}  # fmt: skip


def vehicle(
    compliant: bool, sprocket: SprocketContact = SprocketContact.DRUM
) -> tuple[sw.ModelBuilder, TrackedVehicleParts]:
    """The M113 on a plane, on smooth sprockets or toothed ones."""
    spec = load_tracked_vehicle("m113")
    left, right = (dataclasses.replace(track, brake=None) for track in (spec.left, spec.right))
    spec = dataclasses.replace(spec, left=left, right=right, driveline=None, engine=None, transmission=None)
    builder = sw.ModelBuilder()
    wheels, ground = (WHEEL_COMPLIANCE, GROUND_COMPLIANCE) if compliant else (0.0, 0.0)
    parts = add_tracked_vehicle(builder, spec, sprocket=sprocket, wheel_compliance=wheels, ground_compliance=ground)
    builder.add_shape_plane(material=sw.Material(friction=0.9))
    return builder, parts


def simulation(model: sw.Model, iterations: int, dt: float = 1.0e-3, **options: Any) -> sw.Simulation:
    """One thread; without what models of unequal masses get besides."""
    solver = sw.SolverOptions(fallback=False, refinement=0, max_iterations=iterations, **options)
    return sw.Simulation(model, dt, solver=solver, joint_reactions=True, check_start=False, threads=1)


def readings(sim: sw.Simulation, parts: TrackedVehicleParts) -> dict[str, Any]:
    """What the recorded run tells, now."""
    force = np.linalg.norm(sim.diagnostics.joint_reaction_force.numpy()[0], axis=1)
    x, q = (np.asarray(value, np.float64) for value in (sim.body_position("chassis"), sim.body_rotation("chassis")))
    found: dict[str, Any] = {
        "z [m]": (x + rotate(q, parts.reference))[2], "pitch [rad]": 2.0 * (q[3] * q[1] - q[0] * q[2]),
    }  # fmt: skip
    for name, side in zip(("left", "right"), parts.chains, strict=True):
        idler = getattr(parts.spec, name).idler_location[0]
        found[f"idler {name} [m]"] = idler + sim.joint_position(side.tensioner)
        found[f"pins {name} [kN]"] = force[list(side.pins)].mean() / 1e3
        found[f"arms {name} [rad]"] = np.array([sim.joint_position(arm) for arm in side.arms])
    return found


def run(sim: sw.Simulation, parts: TrackedVehicleParts, seconds: float) -> dict[str, Any]:
    """Steps, and means of all that is read every tenth step; milliseconds are CPU time of a step alone."""
    rows, spent, steps = [], 0.0, round(seconds / sim.dt)
    for _ in range(steps // 10):
        start = time.process_time()
        sim.step(10)
        spent += time.process_time() - start
        report = sim.diagnostics
        rows.append({
            **readings(sim, parts), "iterations": float(report.iterations.numpy()[0]),
            "residual [m/s]": float(report.cone_residual.numpy()[0]),
            "contacts": float(report.constraint_count.numpy()[0]),
            "joint error [m]": float(report.position_error.numpy()[0].max()),
        })  # fmt: skip
    means = {key: np.round(np.mean([row[key] for row in rows], axis=0), 9).tolist() for key in rows[0]}
    return {"ms per step": round(1e3 * spent / (10 * len(rows)), 3), **means}


REST: Final[dict[SprocketContact, dict[str, tuple[bool, int, float]]]] = {
    SprocketContact.DRUM: {
        "rigid": (False, 100, 1e-3), "rigid, 30 iterations": (False, 30, 1e-3), "rigid, 2 ms": (False, 100, 2e-3),
        "compliant": (True, 100, 1e-3), "compliant, 300 iterations": (True, 300, 1e-3),
    },
    SprocketContact.TEETH: {
        "rigid": (False, 100, 1e-3), "rigid, 30 iterations": (False, 30, 1e-3), "compliant": (True, 100, 1e-3),
    },
}  # fmt: skip
"""Whether contacts are compliant, iterations, step [s]."""


def at_rest(seconds: float, sprocket: SprocketContact = SprocketContact.DRUM) -> dict[str, Any]:
    """Ten seconds after the release of the tensioners, the last 2.5 of them read."""
    found: dict[str, Any] = {"recorded": RECORDED}
    for name, (compliant, iterations, dt) in REST[sprocket].items():
        builder, parts = vehicle(compliant, sprocket)
        sim = simulation(builder.finalize(1, "cpu", contact_capacity=200), iterations, dt)
        sim.step(round(0.75 * seconds / dt))
        found[name] = run(sim, parts, 0.25 * seconds)
        print(f"{name}: {found[name]}", flush=True)
    return found


def solvers(steps: int) -> dict[str, Any]:
    """All solvers from one state at rest, with the impulses of the step before and without."""
    builder, parts = vehicle(False)
    model = builder.finalize(1, "cpu", contact_capacity=200)
    settled = simulation(model, 300)
    settled.step(3000)
    state, found = settled.snapshot(), {}
    for name, options in SOLVERS.items():
        for iterations in (1000,) if "dense" in name else (30, 100, 1000):
            sim = simulation(model, iterations, **options)
            row: dict[str, Any] = {}
            for start in ("cold", "warm"):
                sim.restore(state)
                if start == "cold":
                    sim.contacts.contact_impulse.zero_()
                sim.step()
                row[f"{start} residual [m/s]"] = float(sim.diagnostics.cone_residual.numpy()[0])
            row |= run(sim, parts, 1e-3 * steps)
            found[f"{name}, {iterations}"] = row
            shown = {key: value for key, value in row.items() if not isinstance(value, list)}
            print(f"{name}, {iterations}: {shown}", flush=True)
    return found


def driven() -> dict[str, Any]:
    """Full torque from rest on smooth and on toothed sprockets; speed after each half second [m/s]."""
    found: dict[str, Any] = {}
    runs = [(kind, iterations) for kind in SprocketContact for iterations in (30, 100, 300)]
    for kind, iterations in runs:
        builder, parts = vehicle(True, kind)
        sim = simulation(builder.finalize(1, "cpu", contact_capacity=200), iterations)
        sim.step(1500)
        force = sim.control.joint_force.numpy().copy()
        for side in (parts.left, parts.right):
            force[0, builder.dof_start(side.sprocket)] = TORQUE
        sim.control.joint_force.assign(force)
        rows = []
        for _ in range(6):
            row = run(sim, parts, 0.5)
            rows.append({"speed [m/s]": float(sim.body_velocity("chassis")[0]), **row})
        found[f"{kind.value}, {iterations} iterations"] = rows
        print(f"driven, {kind.value}, {iterations}: {[round(row['speed [m/s]'], 3) for row in rows]}", flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=[], metavar="PART", help="solvers, driven, rest or teeth; else all")
    parser.add_argument("--quick", action="store_true", help="shorter runs, without the slow solvers' means")
    parser.add_argument("--json", type=Path, help="file for the results; those of other parts in it stay")
    arguments = parser.parse_args()
    seconds = 2.0 if arguments.quick else 10.0
    parts: dict[str, Callable[[], dict[str, Any]]] = {
        "solvers": lambda: solvers(20 if arguments.quick else 60), "driven": driven, "rest": lambda: at_rest(seconds),
        "teeth": lambda: at_rest(seconds, SprocketContact.TEETH),
    }  # fmt: skip
    for name in arguments.parts or parts:
        if name not in parts:
            parser.error(f"part: must be one of {', '.join(parts)}, got {name!r}")
        found = parts[name]()
        if arguments.json is not None:
            kept = json.loads(arguments.json.read_text(encoding="utf-8")) if arguments.json.exists() else {}
            kept |= {"machine": describe(wp.get_device("cpu")), name: found}
            arguments.json.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
