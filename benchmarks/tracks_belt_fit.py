"""The M113 on belts beside the M113 shoe by shoe, with the same inputs: what both do, and the ratio.

Run: python benchmarks/tracks_belt_fit.py [CASE ...] [--belt] [--json FILE]

All cases take ten minutes of one core, half an hour of a busy one. The file is written after each, so that a stopped
run loses one case; cases that are not named keep what the file has. --belt runs belts alone, beside the shoes of the
file.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import simwarp as sw
from benchmarks.tracks_at_rest import GROUND_COMPLIANCE, TORQUE, WHEEL_COMPLIANCE
from simwarp.bench.machine import describe
from simwarp.soil import soil_under_tracks
from simwarp.vehicle import (
    TRACK_SOLVER,
    VEHICLE_SOLVER,
    SprocketContact,
    TrackedVehicle,
    TrackedVehicleSpec,
    add_tracked_vehicle,
    load_tracked_vehicle,
    per_world,
    with_belts,
)
from simwarp.vehicle.results.chassis_motion import ChassisMotion
from simwarp.vehicle.results.track_readings import TrackReadings

Array = npt.NDArray[np.float64]

RESULTS: Final = Path(__file__).resolve().parent / "results" / "tracks_belt_fit.json"
DT: Final = 1.0e-3
EVERY: Final = 10
"""Steps between two samples, at which inputs change too."""
SETTLING: Final = 3.0
"""On the brakes, before a case's zero [s]."""
GRAVITY: Final = 9.81
MASS: Final = 11342.94
"""Of the vehicle, on belts as shoe by shoe [kg]."""
TORQUE_TO_ACCELERATE: Final = 13200.0 * 0.245
"""Of both sprockets, per acceleration [N·m·s²/m]: the vehicle with what turns in it, at the pitch radius; within 6 % of
it on drums and on teeth."""
BEHIND: Final = 2.0
"""Of the hull's middle from the frame of reference [m]."""
LEVEL: Final = 0.619
"""Its height at rest on hard ground, by belt as shoe by shoe [m]."""
DRUM, TEETH = SprocketContact.DRUM, SprocketContact.TEETH


@dataclasses.dataclass(frozen=True, kw_only=True)
class Inputs:
    """What acts from one sample to the next."""

    steer: float = 0.0
    throttle: float = 0.0
    brake: float = 0.0
    torque: tuple[float, float] = (0.0, 0.0)
    """On the left and the right sprocket, of a vehicle without engine [N·m]."""
    pull: float = 0.0
    """On the chassis, backwards [N]."""


class Rig:
    """One of the two vehicles, on the brakes at first."""

    def __init__(self, case: Case, on_belts: bool) -> None:
        spec = case.spec()
        builder = sw.ModelBuilder(gravity=case.gravity)
        if on_belts:
            spec = with_belts(spec, smooth_sprocket=case.sprocket is DRUM)
        parts = add_tracked_vehicle(
            builder, spec, sprocket=case.sprocket, wheel_compliance=WHEEL_COMPLIANCE,
            ground_compliance=GROUND_COMPLIANCE,
        )  # fmt: skip
        material = sw.Material(friction=case.friction)
        if case.heights is not None:
            x = np.linspace(-10.0, 30.0, 1601)
            rows = np.tile(case.heights(x), (3, 1))
            builder.add_shape_height_field(
                sw.WORLD, rows, size=(40.0, 8.0), pose=sw.pose((10.0, 0.0, 0.0)), material=material, name="ground"
            )
        elif case.soil is None:
            builder.add_shape_plane(material=material)
        model = builder.finalize(1, "cpu", per_world=per_world(), contact_capacity=400)
        ground = sw.vehicle.ground_of(model, "ground") if on_belts and case.heights is not None else None
        self.vehicle = TrackedVehicle(parts, model, ground=ground, soil=case.soil if on_belts else None)
        elements: list[Any] = [self.vehicle]
        if self.vehicle.belts is not None:
            self.vehicle.belts.ground_friction.fill_(case.friction)
        elif case.soil is not None:
            elements.append(soil_under_tracks(self.vehicle, case.soil))
        solver = VEHICLE_SOLVER if on_belts else TRACK_SOLVER
        self.sim = sw.Simulation(model, DT, elements=elements, solver=solver, check_start=False, threads=1)
        self._readings = TrackReadings(self.sim, self.vehicle)
        self._sprockets = [builder.dof_start(side.sprocket) for side in (parts.left, parts.right)]

    def read(self) -> dict[str, float]:
        """The columns of a record, now."""
        motion = ChassisMotion.of(self.sim, self.vehicle, slice(0, 1))
        return {name: float(value[0]) for name, value in
                {**motion.columns(), **self._readings.read(motion, slice(0, 1))}.items()}  # fmt: skip

    def act(self, inputs: Inputs) -> None:
        """Inputs of the steps to come."""
        row = [[inputs.steer, inputs.throttle, inputs.brake, 0.0]]
        self.vehicle.input.assign(np.array(row, np.float32))
        control, chassis = self.sim.control, self.vehicle.parts.chassis
        force = np.zeros(control.joint_force.shape, np.float32)
        force[0, self._sprockets] = inputs.torque
        control.joint_force.assign(force)
        pull = np.zeros((1, self.sim.model.body_count, 3), np.float32)
        ahead = ChassisMotion.of(self.sim, self.vehicle, slice(0, 1)).rotation[0, :, 0]
        pull[0, chassis] = -inputs.pull * ahead
        control.body_force.assign(pull)


Script = Callable[[float, Mapping[str, float]], Inputs]
"""Inputs by the time since the brakes were released [s] and the record's columns of now."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Case:
    """Two runs with the same inputs.

    Attributes:
        script: makes a function of time and readings; each run has its own.
        seconds: after the settling.
        read: figures by name, of the columns of a run's samples.
        engine: the vehicle has its engine, gears and braked differential; else torque acts on the sprockets.
        sprocket: of the shoes.
        friction: of the ground.
        slope: rise per run.
        heights: by place [m], of a height field that both meet.
        soil: preset.
    """

    script: Callable[[], Script]
    seconds: float
    read: Callable[[Mapping[str, Array]], dict[str, float]]
    engine: bool = False
    sprocket: SprocketContact = DRUM
    friction: float = 0.9
    slope: float = 0.0
    heights: Callable[[Array], Array] | None = None
    soil: str | None = None

    def spec(self) -> TrackedVehicleSpec:
        """Of the vehicle shoe by shoe."""
        spec = load_tracked_vehicle("m113")
        return spec if self.engine else dataclasses.replace(spec, driveline=None, engine=None, transmission=None)

    @property
    def gravity(self) -> tuple[float, float, float]:
        """A slope is a plane under a gravity that leans."""
        angle = math.atan(self.slope)
        return (-GRAVITY * math.sin(angle), 0.0, -GRAVITY * math.cos(angle))

    def run(self, *, on_belts: bool) -> dict[str, float]:
        """Figures of one of the two vehicles."""
        rig, script, samples = Rig(self, on_belts), self.script(), []
        rig.act(Inputs(brake=1.0))
        rig.sim.step(round(SETTLING / DT))
        for k in range(round(self.seconds / (EVERY * DT))):
            now = rig.read()
            inputs = script(k * EVERY * DT, now)
            rig.act(inputs)
            samples.append({
                **now, "t_s": k * EVERY * DT, "torque_Nm": sum(inputs.torque), "pull_N": inputs.pull,
            })  # fmt: skip
            rig.sim.step(EVERY)
        columns = {name: np.array([sample[name] for sample in samples]) for name in samples[0]}
        return self.read(columns)


def always(inputs: Inputs) -> Callable[[], Script]:
    """The same inputs all the time."""
    return lambda: lambda t, now: inputs


def braked(speed: float, when: float) -> Callable[[], Script]:
    """A speed held by torque on both sprockets, and full brakes from a time on."""

    def make() -> Script:
        driving = held(speed, engine=False)()
        return lambda t, now: driving(t, now) if t < when else Inputs(brake=1.0)

    return make


def torque_until(seconds: float, after: Inputs) -> Callable[[], Script]:
    """The recorded torque on both sprockets, then something else."""
    return lambda: lambda t, now: Inputs(torque=(TORQUE, TORQUE)) if t < seconds else after


def held(speed: float, *, engine: bool, steer: float = 0.0, steered: float = math.inf, most: float = 6000.0
         ) -> Callable[[], Script]:  # fmt: skip
    """A speed held by throttle or by torque on both sprockets, and steering from a time on."""

    def make() -> Script:
        total = 0.0

        def script(t: float, now: Mapping[str, float]) -> Inputs:
            nonlocal total
            error = speed - now["speed_mps"]
            wanted = 0.5 * error + 0.3 * total
            throttle = min(max(wanted, 0.0), 1.0)
            if throttle == wanted:
                total += EVERY * DT * error
            turn = steer * min(max((t - steered) / 0.2, 0.0), 1.0)
            if engine:
                return Inputs(steer=turn, throttle=throttle)
            return Inputs(torque=(most * throttle, most * throttle))

        return script

    return make


def towed(speed: float, slip: float) -> Callable[[], Script]:
    """A carriage holds the vehicle at a speed, while torque holds its belts at that of a slip."""

    def make() -> Script:
        total = 0.0

        def script(t: float, now: Mapping[str, float]) -> Inputs:
            nonlocal total
            ramp = min(t / 1.0, 1.0)
            track = 0.5 * (now["track_speed_L_mps"] + now["track_speed_R_mps"])
            error = ramp * speed / (1.0 - slip) - track
            total += EVERY * DT * error
            torque = min(max(3.0e4 * error + 6.0e4 * total, -12000.0), 12000.0)
            pull = 5.0e5 * (now["speed_mps"] - ramp * speed)
            return Inputs(torque=(torque, torque), pull=pull)

        return script

    return make


def mean(columns: Mapping[str, Array], name: str, start: float, end: float = math.inf) -> float:
    """Of a column between two times."""
    chosen = (columns["t_s"] >= start) & (columns["t_s"] < end)
    return float(columns[name][chosen].mean())


def at(columns: Mapping[str, Array], name: str, when: float) -> float:
    """Of a column about a time: mean of a tenth of a second."""
    return mean(columns, name, when - 0.05, when + 0.05)


def read_start(columns: Mapping[str, Array]) -> dict[str, float]:
    found = {f"speed at {when:g} s [m/s]": at(columns, "speed_mps", when) for when in (1.0, 2.0, 3.0)}
    found["swing of the pitch [rad]"] = float(np.ptp(columns["pitch_rad"]))
    if columns["drive_Nm"].any():
        found["drive torque [N·m]"] = mean(columns, "drive_Nm", 0.5, 3.0)
    return found


def read_coast(columns: Mapping[str, Array]) -> dict[str, float]:
    start, end = at(columns, "speed_mps", 2.6), at(columns, "speed_mps", 4.4)
    return {"speed lost in 1.8 s [m/s]": start - end}


def read_hold(columns: Mapping[str, Array]) -> dict[str, float]:
    """Torque less what the change of speed takes: both vehicles weigh the same."""
    start, end = 2.9, 4.9
    acceleration = (at(columns, "speed_mps", end) - at(columns, "speed_mps", start)) / (end - start)
    torque = mean(columns, "torque_Nm", start, end) - TORQUE_TO_ACCELERATE * acceleration
    return {
        "torque of both sprockets [N·m]": torque,
        "speed [m/s]": mean(columns, "speed_mps", 2.9),
    }  # fmt: skip


def read_brake(columns: Mapping[str, Array]) -> dict[str, float]:
    time, speed = columns["t_s"], columns["speed_mps"]
    braking = time >= 2.5
    stopped = int(np.argmax(braking & (speed < 0.05)))
    first = int(np.argmax(braking))
    return {
        "speed before [m/s]": float(speed[first]),
        "way [m] over square of the speed": float(columns["x_m"][stopped] - columns["x_m"][first]) / speed[first] ** 2,
        "swing of the pitch [rad]": float(np.ptp(columns["pitch_rad"][braking])),
    }


def read_slope(columns: Mapping[str, Array]) -> dict[str, float]:
    return {
        "speed at 3 s [m/s]": at(columns, "speed_mps", 3.0), "way after 4 s [m]": float(np.ptp(columns["x_m"])),
        "drive torque [N·m]": mean(columns, "drive_Nm", 1.0),
        "swing of the pitch [rad]": float(np.ptp(columns["pitch_rad"])),
    }  # fmt: skip


def read_turn(columns: Mapping[str, Array]) -> dict[str, float]:
    return {
        "yaw rate [rad/s]": mean(columns, "yawrate_radps", 4.0), "speed [m/s]": mean(columns, "speed_mps", 4.0),
        "outer track [m/s]": mean(columns, "track_speed_R_mps", 4.0),
        "drive torque [N·m]": mean(columns, "drive_Nm", 4.0),
    }  # fmt: skip


def read_wide_turn(columns: Mapping[str, Array]) -> dict[str, float]:
    """The inner track turns, too."""
    return read_turn(columns) | {"inner track [m/s]": mean(columns, "track_speed_L_mps", 4.0)}


def read_pivot(columns: Mapping[str, Array]) -> dict[str, float]:
    return {
        "angle after 2 s [rad]": at(columns, "yaw_rad", 2.0) - float(columns["yaw_rad"][0]),
        "yaw rate at 2.5 s [rad/s]": mean(columns, "yawrate_radps", 2.25, 2.75),
        "track [m/s]": mean(columns, "track_speed_R_mps", 2.25, 2.75),
    }


def read_bump(columns: Mapping[str, Array]) -> dict[str, float]:
    time, pitch, z = columns["t_s"], columns["pitch_rad"], columns["z_m"]
    up, down = int(pitch.argmin()), int(pitch.argmax())
    return {
        "nose up [rad]": float(pitch.min()), "nose down [rad]": float(pitch.max()),
        "from one to the other [s]": float(time[down] - time[up]),
        "highest [m]": float(z.max()), "lowest [m]": float(z.min()),
        "speed [m/s]": mean(columns, "speed_mps", 1.0),
    }  # fmt: skip


def lowered(columns: Mapping[str, Array]) -> float:
    """How much lower the hull's middle is than at rest on hard ground, from 2 s on [m]."""
    return LEVEL - mean(columns, "z_m", 2.0) - BEHIND * mean(columns, "pitch_rad", 2.0)


def read_soil(columns: Mapping[str, Array]) -> dict[str, float]:
    return {
        "speed at 2 s [m/s]": at(columns, "speed_mps", 2.0), "speed at 3 s [m/s]": at(columns, "speed_mps", 2.9),
        "hull lower than on hard ground [m]": lowered(columns), "pitch [rad]": mean(columns, "pitch_rad", 2.0),
    }  # fmt: skip


def read_tow(columns: Mapping[str, Array]) -> dict[str, float]:
    track = 0.5 * (columns["track_speed_L_mps"] + columns["track_speed_R_mps"])
    late = columns["t_s"] >= 2.0
    return {
        "speed over that of the tracks": float(columns["speed_mps"][late].mean() / track[late].mean()),
        "pull over weight": mean(columns, "pull_N", 2.0) / (MASS * GRAVITY),
        "torque of both sprockets [N·m]": mean(columns, "torque_Nm", 2.0),
        "hull lower than on hard ground [m]": lowered(columns),
    }  # fmt: skip


def half_round(x: Array) -> Array:
    """Of 0.2 m, 3 m ahead."""
    height: Array = np.sqrt(np.clip(0.04 - (x - 3.0) ** 2, 0.0, None))
    return height


def step_up(x: Array) -> Array:
    """To 0.3 m over a face of 45 degrees, 3 m ahead."""
    height: Array = np.clip(x - 3.0, 0.0, 0.3)
    return height


FULL: Final = always(Inputs(torque=(TORQUE, TORQUE)))
CASES: Final[dict[str, Case]] = {
    "start": Case(script=FULL, seconds=3.1, read=read_start),
    "start, teeth": Case(script=FULL, seconds=3.1, read=read_start, sprocket=TEETH),
    "full throttle": Case(
        script=always(Inputs(throttle=1.0)), seconds=3.1, engine=True,
        read=read_start,
    ),
    "full throttle, teeth": Case(
        script=always(Inputs(throttle=1.0)), seconds=3.1, engine=True, sprocket=TEETH,
        read=read_start,
    ),
    "coast": Case(script=torque_until(2.5, Inputs()), seconds=4.5, read=read_coast),
    "hold 2 m/s": Case(script=held(2.0, engine=False), seconds=5.0, read=read_hold),
    "hold 2 m/s, teeth": Case(script=held(2.0, engine=False), seconds=5.0, read=read_hold, sprocket=TEETH),
    "hold 4 m/s": Case(script=held(4.0, engine=False), seconds=5.0, read=read_hold),
    "brake": Case(script=braked(2.0, 2.5), seconds=4.5, read=read_brake, sprocket=TEETH),
    "slope 0.3, hold 1 m/s": Case(
        script=held(1.0, engine=False, most=12000.0), seconds=5.0, slope=0.3, read=read_hold
    ),
    "slope 0.3, full throttle": Case(
        script=always(Inputs(throttle=1.0)), seconds=4.0, engine=True, slope=0.3, read=read_slope
    ),
    "turn, half steering": Case(
        script=held(3.0, engine=True, steer=0.5, steered=2.0), seconds=6.0, engine=True, friction=0.3,
        read=read_wide_turn,
    ),
    "turn, full steering": Case(
        script=held(3.0, engine=True, steer=1.0, steered=2.0), seconds=6.0, engine=True, friction=0.3, read=read_turn
    ),
    "turn, full steering, friction 0.5": Case(
        script=held(3.0, engine=True, steer=1.0, steered=2.0), seconds=6.0, engine=True, friction=0.5, read=read_turn
    ),
    "pivot, friction 0.3": Case(
        script=always(Inputs(torque=(-3000.0, 3000.0))), seconds=2.8, friction=0.3, read=read_pivot
    ),
    "pivot, friction 0.5": Case(
        script=always(Inputs(torque=(-5000.0, 5000.0))), seconds=2.8, friction=0.5, read=read_pivot
    ),
    "half round": Case(script=held(2.0, engine=False), seconds=5.5, heights=half_round, read=read_bump),
    "step": Case(script=held(2.0, engine=False), seconds=4.5, heights=step_up, read=read_bump),
    "soil mid": Case(script=FULL, seconds=3.0, soil="mid", read=read_soil),
    "soil clay": Case(script=FULL, seconds=3.0, soil="clay", read=read_soil),
    "towed, mid": Case(script=towed(1.0, 0.2), seconds=3.5, soil="mid", read=read_tow),
    "towed, clay": Case(script=towed(1.0, 0.2), seconds=3.5, soil="clay", read=read_tow),
}  # fmt: skip
"""By name."""
APART: Final = frozenset({
    ("start", "swing of the pitch [rad]"),
    ("start, teeth", "speed at 1 s [m/s]"),
    ("start, teeth", "swing of the pitch [rad]"),
    ("full throttle", "swing of the pitch [rad]"),
    ("full throttle, teeth", "swing of the pitch [rad]"),
    ("brake", "swing of the pitch [rad]"),
    ("pivot, friction 0.3", "angle after 2 s [rad]"),
    ("step", "nose down [rad]"),
    ("soil mid", "pitch [rad]"),
    ("soil clay", "hull lower than on hard ground [m]"),
    ("soil clay", "pitch [rad]"),
    ("towed, mid", "pull over weight"),
    ("towed, mid", "torque of both sprockets [N·m]"),
    ("towed, mid", "hull lower than on hard ground [m]"),
    ("slope 0.3, full throttle", "way after 4 s [m]"),
})  # fmt: skip
"""Case and figure that differ by more than a tenth; docs/decisions.md says why."""


def compared(belt: Mapping[str, float], shoes: Mapping[str, float]) -> dict[str, dict[str, float | None]]:
    """Both values of each figure and their ratio."""
    return {
        name: {
            "belt": round(belt[name], 4), "shoes": round(shoes[name], 4),
            "ratio": round(belt[name] / shoes[name], 3) if shoes[name] else None,
        }
        for name in belt
    }  # fmt: skip


def print_rows(name: str, figures: Mapping[str, Mapping[str, float | None]]) -> None:
    """Print the rows of a case."""
    for figure, row in figures.items():
        ratio = row["ratio"]
        mark = "" if ratio is not None and abs(ratio - 1.0) <= 0.1 else "  *"
        print(f"{name:34s} {figure:36s} {row['belt']:>9.4g} {row['shoes']:>9.4g} {ratio or math.nan:>6.3f}{mark}",
              flush=True)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", nargs="*", help=f"all of them when none is named: {'; '.join(CASES)}")
    parser.add_argument("--belt", action="store_true", help="run belts alone, beside the shoes of the file")
    parser.add_argument("--json", type=Path, default=RESULTS, help="file for the results")
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.case) - set(CASES))
    if unknown:
        parser.error(f"case must be one of {', '.join(map(repr, CASES))}, got {unknown[0]!r}")
    file: Path = arguments.json
    results: dict[str, Any] = {"machine": describe(wp.get_device("cpu")), "cases": {}}
    if file.exists():
        results["cases"] = json.loads(file.read_text(encoding="utf-8"))["cases"]
    print(f"{'case':34s} {'figure':36s} {'belt':>9s} {'shoes':>9s} {'ratio':>6s}")
    for name in arguments.case or CASES:
        case, before = CASES[name], results["cases"].get(name)
        belt = case.run(on_belts=True)
        if arguments.belt and before is not None and before.keys() == belt.keys():
            shoes = {figure: row["shoes"] for figure, row in before.items()}
        else:
            shoes = case.run(on_belts=False)
        results["cases"][name] = compared(belt, shoes)
        print_rows(name, results["cases"][name])
        file.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
