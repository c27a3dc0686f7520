"""A tracked vehicle beside recorded runs: at rest, at full throttle, braking, turning, over a half round.

The recorded runs are of Project Chrono 10, commit 7689fbc (BSD 3-clause): its M113 on penalty contacts, with friction
by Coulomb's law (`F_t = mu F_n tanh(5 v)`) unless said otherwise, at steps of 0.5 ms and, where two numbers stand,
0.25 ms. It is no converged model (its step alone changes speeds by 15 %), so that tolerances are wide.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD, Material, pose
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.driving.drivers import ScriptedDriver, ScriptSpec
from simwarp.vehicle.spec.track_parts import SimpleTrackDriveline
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_spec import Points
from simwarp.vehicle.tracks.shoe_construction import SprocketContact
from simwarp.vehicle.tracks.tracked_construction import add_tracked_vehicle
from simwarp.vehicle.tracks.tracked_files import load_tracked_vehicle
from simwarp.vehicle.tracks.tracked_vehicle import TRACK_SOLVER, TrackedVehicle
from simwarp.vehicle.vehicle import per_world
from simwarp.verify.check_result import CheckResult, below, near
from simwarp.verify.slip_friction import SlipFriction

Array = npt.NDArray[np.float64]

WHEEL_COMPLIANCE: Final = 7.6e-7
"""Sink over load [m/N] of a recorded box on an idler under 25 kN: 19 mm, by Hertz's law with the recorded moduli."""
GROUND_COMPLIANCE: Final = 1.9e-6
"""The same of half a shoe on the ground under 4 kN: 7.5 mm."""
SAMPLE: Final = 0.01
"""Between two readings [s]."""
SETTLE: Final = 1.5
"""Before a drive [s]."""
BALLS: Final = (".top0", ".top1", ".pad0", ".pad1", ".roller0", ".roller1")
"""Ends of the names of shoes' shapes with friction."""
HALF_ROUND: Final = 0.2
"""Radius of the obstacle [m]."""
OBSTACLE_AHEAD: Final = 5.0
"""Of its axis from the sprockets' [m]."""

RECORDED_SLIP: Final = 0.2
"""Speed of the recorded law of friction [m/s]."""
RECORDED: Final[dict[str, dict[str, tuple[float, float]]]] = {
    "rest": {
        "height [m]": (0.5932, 0.5981), "pitch [rad]": (0.0104, 0.0122), "ground load [kN]": (111.27, 111.27),
        "idler left [m]": (-4.0391, -4.0074), "idler right [m]": (-4.0860, -4.0751),
        "pin force left [kN]": (91.0, 105.9), "pin force right [kN]": (66.4, 71.0),
        **{f"arm {k} left [rad]": pair for k, pair in enumerate(
            ((0.000, 0.047), (-0.172, -0.153), (-0.206, -0.194), (-0.225, -0.217), (-0.182, -0.153)))},
        **{f"arm {k} right [rad]": pair for k, pair in enumerate(
            ((-0.088, -0.062), (-0.209, -0.184), (-0.229, -0.219), (-0.254, -0.249), (-0.227, -0.215)))},
    },
    "start": {"time to 2 m/s [s]": (1.63, 1.70), "time to 4 m/s [s]": (3.40, 3.91)},
    "half steering": {"yaw rate [rad/s]": (0.237, 0.266)},
    "full steering": {"yaw rate [rad/s]": (0.511, 0.511)},
    "half round": {
        "pitch nose up [rad]": (-0.125, -0.125), "pitch nose down [rad]": (0.181, 0.181),
        "from nose up to nose down [s]": (1.16, 1.16),
    },
}  # fmt: skip
"""Two recorded numbers of each: at rest on contacts of Hertz's law (means of the last 2.5 of 10 s) and of Coulomb's,
else at steps of 0.5 and 0.25 ms, where there are two."""
WIDENED: Final = {"rest": 0.05, "start": 0.1, "half steering": 0.1, "full steering": 0.25, "half round": 0.15}
"""Shares of the numbers by which ours may be outside them."""
LEAST: Final = {"[m]": 0.005, "[rad]": 0.02, "[kN]": 0.5, "[s]": 0.1, "[rad/s]": 0.0}
"""And at least by so much."""


@dataclasses.dataclass(frozen=True)
class Trial:
    """A tracked vehicle on a plane, with its readings every `SAMPLE`."""

    simulation: Simulation
    vehicle: TrackedVehicle
    rows: dict[str, list[Array]] = dataclasses.field(default_factory=dict)

    def run(self, seconds: float, until: Callable[[float], bool] = lambda speed: False) -> None:
        """Steps and reads, to the end or until a speed [m/s]."""
        every = round(SAMPLE / self.simulation.dt)
        for _ in range(round(seconds / SAMPLE)):
            self.simulation.step(every)
            for name, value in self.readings().items():
                self.rows.setdefault(name, []).append(value)
            if until(float(self.speed[-1])):
                return

    def pedals(self, *, throttle: float = 0.0, braking: float = 0.0) -> None:
        """Of all worlds, without a driver."""
        rows = np.zeros(self.vehicle.input.shape, np.float32)
        rows[:, 1:3] = throttle, braking
        self.vehicle.input.assign(rows)

    def readings(self) -> dict[str, Array]:
        """The present state of the first world."""
        vehicle, parts, sim = self.vehicle, self.vehicle.parts, self.simulation
        found = {
            "t": sim.state.world_time.numpy()[0], "position": vehicle.position.numpy()[0],
            "pitch": vehicle.angles.numpy()[0, 1], "velocity": vehicle.velocity_b.numpy()[0],
            "yaw_rate": vehicle.omega_b.numpy()[0, 2], "sprocket": vehicle.sprocket_speed.numpy()[0],
            "tension": vehicle.tension.numpy()[0], "joint_error": sim.diagnostics.position_error.numpy().max(),
        }  # fmt: skip
        for name, side in (("left", parts.left), ("right", parts.right)):
            found[f"arms {name}"] = np.array([sim.joint_position(arm) for arm in side.arms])
        for name, side in zip(("left", "right"), parts.chains, strict=bool(parts.chains)):
            found[f"idler {name}"] = sim.joint_position(side.tensioner)
            if sim.diagnostics.joint_reaction_force.size:
                force = sim.diagnostics.joint_reaction_force.numpy()[0, list(side.pins)]
                found[f"pins {name}"] = np.linalg.norm(force, axis=1).mean()
        return {name: np.array(value, float) for name, value in found.items()}

    def column(self, name: str) -> Array:
        """(samples, ...) of a reading."""
        return np.array(self.rows[name])

    @property
    def speed(self) -> Array:
        """(samples,) along the way [m/s]."""
        return np.asarray(np.hypot(*np.array(self.rows["velocity"])[:, :2].T))


def trial(
    spec: TrackedVehicleSpec, script: ScriptSpec | None = None, *, device: str = "cpu", dt: float = 1.0e-3,
    iterations: int = 100, compliant: bool = False, obstacle: bool = False, reactions: bool = False,
    sprocket: SprocketContact = SprocketContact.TEETH, slip_speed: float = 0.0,
) -> Trial:  # fmt: skip
    """The vehicle as laid, on a plane of friction 0.9; `slip_speed`: that of `SlipFriction` of all shoes, 0: dry."""
    builder = ModelBuilder()
    wheels, ground = (WHEEL_COMPLIANCE, GROUND_COMPLIANCE) if compliant else (0.0, 0.0)
    parts = add_tracked_vehicle(
        builder, spec, sprocket=sprocket, wheel_compliance=wheels, ground_compliance=ground
    )  # fmt: skip
    rough = Material(friction=0.9)
    builder.add_shape_plane(material=rough)
    if obstacle:
        half = 0.5**0.5
        lying = pose((OBSTACLE_AHEAD, 0.0, 0.0), (half, 0.0, 0.0, half))
        builder.add_shape_cylinder(WORLD, radius=HALF_ROUND, half_length=2.0, pose=lying, material=rough)
    model = builder.finalize(1, device, per_world=per_world(["shape_friction"]), contact_capacity=400)
    vehicle = TrackedVehicle(parts, model)
    shoes = [k for k, shape in enumerate(builder.shapes) if shape.name.endswith(BALLS)]
    law = [SlipFriction(model, shoes, slip_speed)] if slip_speed > 0.0 else []
    solver = dataclasses.replace(TRACK_SOLVER, max_iterations=iterations)
    drivers = [] if script is None else [ScriptedDriver(vehicle, script)]
    simulation = Simulation(
        model, dt, elements=[*law, *drivers, vehicle], solver=solver, check_start=False, joint_reactions=reactions
    )
    return Trial(simulation, vehicle)


def rest(device: str = "cpu", **options: object) -> tuple[Trial, dict[str, float]]:
    """Ten seconds from the release on, and means of the last 2.5 s; contacts sink as the recorded ones do."""
    spec = load_tracked_vehicle("m113")
    made = trial(spec, device=device, reactions=True, **{"compliant": True, **options})  # type: ignore[arg-type]
    made.run(10.0)
    last = {name: np.mean(values[-round(2.5 / SAMPLE) :], axis=0) for name, values in made.rows.items()}
    found = {"height [m]": float(last["position"][2]), "pitch [rad]": float(last["pitch"])}
    found["ground load [kN]"] = ground_load(made) / 1e3
    for name, track in (("left", spec.left), ("right", spec.right)):
        found[f"idler {name} [m]"] = track.idler_location[0] + float(last[f"idler {name}"])
        found[f"pin force {name} [kN]"] = float(last[f"pins {name}"]) / 1e3
        found |= {f"arm {k} {name} [rad]": float(angle) for k, angle in enumerate(last[f"arms {name}"])}
    return made, found


def ground_load(made: Trial) -> float:
    """Vertical force of the ground on the vehicle, mean of a tenth of a second [N]."""
    sim = made.simulation
    shapes = np.array([shape.body for shape in sim.model.builder.shapes])
    total, steps = 0.0, 100
    for _ in range(steps):
        sim.step()
        count = int(sim.contacts.contact_count.numpy()[0])
        pairs = np.stack([getattr(sim.contacts, f"contact_shape{k}").numpy()[0, :count] for k in (0, 1)])
        touching = shapes[pairs] == WORLD
        normal, impulse = (
            getattr(sim.contacts, f"contact_{name}").numpy()[0, :count] for name in ("normal_w", "impulse")
        )
        # along the normal from shape 0 to shape 1; what it lacks for the friction's part is level on a plane
        total += float(np.sum(impulse[:, 0] * normal[:, 2] * (touching[0].astype(float) - touching[1])))
    return total / steps / sim.dt


def after(points: Points, settle: float = SETTLE) -> Points:
    """Inputs that begin after the settling."""
    return tuple((time + settle, value) for time, value in points)


def simple(spec: TrackedVehicleSpec, *, legacy: bool = True) -> TrackedVehicleSpec:
    """On the simple driveline, with the recorded one's sign or the right one."""
    return dataclasses.replace(spec, driveline=SimpleTrackDriveline(legacy=legacy))


def accelerate_and_brake(device: str = "cpu", **options: object) -> tuple[Trial, dict[str, float]]:
    """Full throttle until 6.94 m/s, 10 s at most, then full brakes until 0.5 m/s, 3 s at most."""
    made = trial(simple(load_tracked_vehicle("m113")), device=device, **options)  # type: ignore[arg-type]
    made.run(SETTLE)
    made.pedals(throttle=1.0)
    made.run(10.0, until=lambda speed: speed >= 6.94)
    time, speed = made.column("t") - SETTLE, made.speed
    found = {f"time to {v:g} m/s [s]": first_time(time, speed, v) for v in (2.0, 4.0)}
    found |= {"speed at full throttle [m/s]": float(speed[-1]), "full throttle for [s]": float(time[-1])}
    start = made.column("position")[-1]
    made.pedals(braking=1.0)
    made.run(3.0, until=lambda speed: speed < 0.5)
    found["braking distance [m]"] = float(np.linalg.norm((made.column("position")[-1] - start)[:2]))
    found["joint error [m]"] = float(made.column("joint_error").max())
    return made, found


def first_time(time: Array, values: Array, bound: float) -> float:
    """The first time at which values reach a bound; NaN: they do not."""
    reached = np.flatnonzero(values >= bound)
    return float(time[reached[0]]) if reached.size else float("nan")


def turn(steering: float, device: str = "cpu", **options: object) -> tuple[Trial, dict[str, float]]:
    """Towards 5 m/s for 6 s on the braked differential, then steering rises in 0.2 s; means of the last 2 of 4.5 s."""
    script = ScriptSpec(
        speed=((0.0, 0.0), *after(((0.0, 0.0), (0.0, 5.0)))), brake_share=0.0,
        steering=after(((6.0, 0.0), (6.2, steering))),
    )  # fmt: skip
    made = trial(load_tracked_vehicle("m113"), script, device=device, **options)  # type: ignore[arg-type]
    made.run(SETTLE + 10.5)
    last = slice(-round(2.0 / SAMPLE), None)
    speed, rate = float(made.speed[last].mean()), float(made.column("yaw_rate")[last].mean())
    return made, {"yaw rate [rad/s]": rate, "speed [m/s]": speed, "radius [m]": speed / rate}


def cross(device: str = "cpu", **options: object) -> tuple[Trial, dict[str, float]]:
    """Towards 2 m/s over a half round that lies across, 5 m ahead."""
    script = ScriptSpec(speed=((0.0, 0.0), *after(((0.0, 0.0), (0.0, 2.0)))), brake_share=0.0)
    spec = simple(load_tracked_vehicle("m113"))
    made = trial(spec, script, device=device, obstacle=True, **options)  # type: ignore[arg-type]
    made.run(SETTLE + 8.0)
    pitch, time = made.column("pitch"), made.column("t") - SETTLE
    up, down = int(np.argmin(pitch)), int(np.argmax(pitch))
    return made, {
        "pitch nose up [rad]": float(pitch[up]), "pitch nose down [rad]": float(pitch[down]),
        "time of nose up [s]": float(time[up]), "from nose up to nose down [s]": float(time[down] - time[up]),
    }  # fmt: skip


def tracks(device: str = "cpu") -> list[CheckResult]:
    """The M113 shoe by shoe beside the recorded runs.

    Drives are on the recorded law of friction, three quarters of it at 0.2 m/s of slip; the start is on smooth
    sprockets, since teeth slide on their rollers by 4 % of the speed, which that law hardly feels at its step and feels
    more at half of it (docs/decisions.md#tracks). Turns compare yaw rates: radii are those times speeds. Tolerances:
    half the way between the two recorded numbers and the share of `WIDENED`.
    """
    law = {"iterations": 60, "slip_speed": RECORDED_SLIP}
    runs = {
        "rest": rest(device), "start": accelerate_and_brake(device, sprocket=SprocketContact.DRUM, **law),
        "half steering": turn(0.5, device, **law), "full steering": turn(1.0, device, **law),
        "half round": cross(device, **law),
    }  # fmt: skip
    rows = []
    for name, (made, found) in runs.items():
        for quantity, pair in RECORDED[name].items():
            middle, half = 0.5 * (pair[0] + pair[1]), 0.5 * abs(pair[1] - pair[0])
            share, least = WIDENED[name] * abs(middle), LEAST.get(quantity[quantity.index("[") :], 0.0)
            margin = least if quantity.endswith("[m]") and name == "rest" else max(share, least)
            rows.append(near("tracks", f"{name}, {quantity}", middle, found[quantity], half + margin))
        # exact joints: the chain's pitch, after the first half second, in which 270 kN are let go
        error = made.column("joint_error")[round(0.5 / SAMPLE) :].max()
        rows.append(below("tracks", f"{name}, error of the joints [m]", float(error), 1.0e-4))
    return rows
