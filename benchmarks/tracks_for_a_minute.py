"""A tracked vehicle, shoe by shoe, for a minute on a plane, hills and soil: do chains hold, and stay on their wheels?

Run: python benchmarks/tracks_for_a_minute.py [plane hills soil] [--seconds 60] [--json FILE]    minutes each
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import simwarp as sw
from simwarp.bench.machine import describe
from simwarp.core.rotation import matrix_of
from simwarp.scenery import hills, steepness
from simwarp.soil import Soil, soil_under_tracks
from simwarp.vehicle import (
    TRACK_SOLVER,
    ScriptedDriver,
    ScriptSpec,
    TrackedVehicle,
    add_tracked_vehicle,
    load_tracked_vehicle,
    per_world,
)

Array = npt.NDArray[np.float64]

GROUNDS: Final = ("plane", "hills", "soil")
DT: Final = 1.0e-3
EVERY: Final = 10
"""Steps between two readings."""
RELEASED: Final = 0.5
"""Time that the tensioners' release takes [s]: joint errors count from then on."""
BRAKED: Final = 2.0
"""Before the drive [s]."""
SPEED: Final = 3.0
"""That the driver holds [m/s]."""
GENTLE: Final = 0.8
"""Steering, of the inner sprocket's brake: the vehicle turns on this friction; with half of it, it hardly does."""
FRICTION: Final = 0.6
"""Of the ground."""
FIELD: Final = (500.0, 500.0)
"""Sides of the hills [m]: more than the way of a minute in each direction."""
HEIGHT: Final = 3.0
"""Of the hills, above or below their mean [m]."""
WAVES: Final = (15.0, 45.0)
"""Shortest and longest hills [m]."""


def simulation(ground: str) -> tuple[sw.Simulation, TrackedVehicle, Soil | None]:
    """The M113 on a ground, with a driver who starts, holds a speed and turns gently to both sides."""
    builder = sw.ModelBuilder()
    material = sw.Material(friction=FRICTION)
    at = None
    if ground == "hills":
        heights = hills(3, size=FIELD, spacing=0.5, amplitude=HEIGHT, wavelength=WAVES)
        heights = sw.scenery.flattened(heights, FIELD, [(-2.0, 0.0, 6.0)])
        level = float(sw.scenery.height_at(heights, FIELD, [(-2.0, 0.0)])[0])
        print(f"hills: slopes up to {math.tan(steepness(heights, FIELD)):.2f}", flush=True)
        builder.add_shape_height_field(sw.WORLD, heights - level, size=FIELD, material=material)
    elif ground == "plane":
        builder.add_shape_plane(material=material)
    parts = add_tracked_vehicle(builder, load_tracked_vehicle("m113"), at=at)
    model = builder.finalize(1, "cpu", per_world=per_world(), contact_capacity=400)
    vehicle = TrackedVehicle(parts, model)
    soil = soil_under_tracks(vehicle, "mid") if ground == "soil" else None
    driver = ScriptedDriver(vehicle, script())
    elements = [each for each in (driver, vehicle, soil) if each is not None]
    sim = sw.Simulation(model, DT, elements=elements, solver=TRACK_SOLVER, check_start=False, threads=1)
    return sim, vehicle, soil


def script() -> ScriptSpec:
    """Brakes, a speed held from then on, and from the tenth second turns of eight seconds to either side."""
    turns: list[tuple[float, float]] = [(10.0, 0.0)]
    for number in range(6):
        start, side = 10.0 + 10.0 * number, 1.0 if number % 2 == 0 else -1.0
        turns += [(start + 1.0, side * GENTLE), (start + 8.0, side * GENTLE), (start + 9.0, 0.0)]
    return ScriptSpec(
        braking=((0.0, 1.0), (BRAKED, 1.0), (BRAKED, 0.0)), speed=((0.0, -1.0), (BRAKED, -1.0), (BRAKED, SPEED)),
        steering=tuple(turns),
    )  # fmt: skip


def turns_around(chain: Array, centers: Array) -> Array:
    """(n,) how often a closed line (m, 2) goes around each of some points (n, 2)."""
    away = chain[None] - centers[:, None]
    angle = np.unwrap(np.arctan2(away[..., 1], away[..., 0]), axis=1)
    last = np.arctan2(away[:, 0, 1], away[:, 0, 0])
    closing = np.angle(np.exp(1j * (last - angle[:, -1])))
    return np.asarray((angle[:, -1] + closing - angle[:, 0]) / (2.0 * np.pi))


class ChainWatch:
    """Whether both chains go around all of their wheels, how far aside shoes are, and teeth that were skipped."""

    def __init__(self, sim: sw.Simulation, vehicle: TrackedVehicle) -> None:
        self._sim, self._vehicle = sim, vehicle
        self._front: list[int | None] = [None, None]
        self._passed = [0, 0]
        self._turned = [self._teeth(k) for k in range(2)]

    def _teeth(self, k: int) -> float:
        """That a sprocket has turned by."""
        parts = self._vehicle.parts
        track = (parts.spec.left, parts.spec.right)[k]
        return self._sim.joint_position(parts.chains[k].sprocket) * track.sprocket.teeth / (2.0 * np.pi)

    def read(self) -> dict[str, float]:
        """Of the present state: whether both are on [1: yes], metres aside, teeth between sprocket and chain."""
        parts, state = self._vehicle.parts, self._sim.state
        x, q = state.body_x.numpy()[0], state.body_rot.numpy()[0].astype(float)
        origin = x[parts.chassis] + matrix_of(q[parts.chassis]) @ parts.reference
        seen = (x - origin) @ matrix_of(q[parts.chassis])  # all bodies in the vehicle's frame of reference
        on, aside, skipped = 1.0, 0.0, 0.0
        for k, (side, track) in enumerate(zip(parts.chains, (parts.spec.left, parts.spec.right), strict=True)):
            chain, hub = seen[list(side.shoes)], np.array(track.sprocket_location)
            wheels = seen[[side.idler, *side.road_wheels]][:, [0, 2]]
            around = turns_around(chain[:, [0, 2]], np.vstack([hub[[0, 2]], wheels]))
            on = min(on, float(np.all(np.abs(np.abs(around) - 1.0) < 1e-6)))
            offset = parts.spec.track_offset * (1.0, -1.0)[k]
            aside = max(aside, float(np.abs(chain[:, 1] - offset).max()))
            skipped = max(skipped, abs(self._slip(k, chain, hub)))
        return {"on": on, "aside": aside, "skipped": skipped}

    def _slip(self, k: int, chain: Array, hub: Array) -> float:
        """Teeth by which the sprocket has turned more than shoes have passed the place ahead of it."""
        away = chain[:, [0, 2]] - hub[[0, 2]]
        before = int(np.argmin(np.abs(np.arctan2(away[:, 1], away[:, 0])) + (np.hypot(*away.T) > 0.5) * 10.0))
        last, count = self._front[k], len(chain)
        if last is not None:
            self._passed[k] += (before - last + count // 2) % count - count // 2
        self._front[k] = before
        return self._teeth(k) - self._turned[k] - self._passed[k]


def run(ground: str, seconds: float) -> dict[str, Any]:
    """Drive; what was met from the end of the release on."""
    sim, vehicle, soil = simulation(ground)
    watch = ChainWatch(sim, vehicle)
    rows: list[dict[str, float]] = []
    spent, printed = 0.0, time.monotonic()
    for number in range(round(seconds / DT) // EVERY):
        begun = time.process_time()
        sim.step(EVERY)
        spent += time.process_time() - begun
        report, position = sim.diagnostics, vehicle.position.numpy()[0]
        left, right = (float(value) for value in vehicle.tension.numpy()[0] / 1e3)
        row = {
            "t": DT * EVERY * (number + 1), "joint error": float(report.position_error.numpy().max()),
            "residual": float(report.cone_residual.numpy()[0]), "contacts": float(report.constraint_count.numpy()[0]),
            "left": left, "right": right, "speed": float(np.hypot(*vehicle.velocity_b.numpy()[0, :2])),
            "x": float(position[0]), "y": float(position[1]), "z": float(position[2]),
            "yaw": float(vehicle.angles.numpy()[0, 2]), **watch.read(),
            "sinkage": 0.0 if soil is None else float(soil.sinkage.numpy().max()),
        }  # fmt: skip
        rows.append(row)
        if not all(math.isfinite(value) for value in row.values()):
            print(f"{ground}: not finite at {row['t']:.2f} s", flush=True)
            break
        if number % 500 == 0 or time.monotonic() - printed > 30.0:
            printed = time.monotonic()
            figures = {key: round(value, 6) for key, value in row.items()}
            print(f"{ground}: {figures}", flush=True)
    return {"ms per step": round(1e3 * spent / (EVERY * len(rows)), 3), **summary(rows)}


def summary(rows: list[dict[str, float]]) -> dict[str, Any]:
    """Greatest and mean values of a run, from the end of the release on."""
    column = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    later = column["t"] > RELEASED
    driven = column["t"] > BRAKED
    error = column["joint error"]
    yaw = np.unwrap(column["yaw"])
    path = np.hypot(np.diff(column["x"]), np.diff(column["y"])).sum()
    found: dict[str, Any] = {
        "seconds": float(column["t"][-1]), "finite": bool(all(np.isfinite(each).all() for each in column.values())),
        "chains on all wheels": bool(column["on"].min() == 1.0), "shoes aside, at most [m]": column["aside"].max(),
        "teeth between sprocket and chain, at most": column["skipped"].max(),
        "joint error during the release, at most [m]": error[~later].max(),
        "joint error after it, at most [m]": error[later].max(), "at [s]": column["t"][later][error[later].argmax()],
        "joint error, mean [m]": error[later].mean(),
        "residual, mean [m/s]": column["residual"][later].mean(),
        "residual, 99 of 100 below [m/s]": np.quantile(column["residual"][later], 0.99),
        "residual, at most [m/s]": column["residual"][later].max(),
        "contacts, mean": column["contacts"][later].mean(), "contacts, at most": column["contacts"].max(),
        "way [m]": path, "speed, mean [m/s]": column["speed"][driven].mean(),
        "headings passed [rad]": yaw.max() - yaw.min(), "heights passed [m]": column["z"].max() - column["z"].min(),
        "sinkage, at most [m]": column["sinkage"].max(),
    }  # fmt: skip
    for side in ("left", "right"):
        tension = column[side][driven]
        found[f"tension {side}: least, mean, greatest [kN]"] = [tension.min(), tension.mean(), tension.max()]
    return {key: np.round(value, 9).tolist() if not isinstance(value, bool) else value for key, value in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("grounds", nargs="*", default=[], metavar="GROUND", help=f"of {', '.join(GROUNDS)}; else all")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--json", type=Path, help="file for the results; those of other grounds in it stay")
    arguments = parser.parse_args()
    for ground in arguments.grounds or GROUNDS:
        if ground not in GROUNDS:
            parser.error(f"ground: must be one of {', '.join(GROUNDS)}, got {ground!r}")
        found = run(ground, arguments.seconds)
        print(f"{ground}: {json.dumps(found, indent=1)}", flush=True)
        if arguments.json is not None:
            kept = json.loads(arguments.json.read_text(encoding="utf-8")) if arguments.json.exists() else {}
            kept |= {"machine": describe(wp.get_device("cpu")), ground: found}
            arguments.json.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
