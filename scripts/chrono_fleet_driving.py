"""Driving tests for vehicles of files that nobody drove before: do they stand, accelerate, steer and brake plausibly?

Every test has a law or a second computation behind it:

- standing: the tires bear the weight, it stands nearly level, and nothing moves any more;
- accelerating: full throttle moves it forwards, straight on, and no faster than grip allows;
- steering: both ways by the same input, at two speeds. The curvature is that of a bicycle with as many axles as the
  vehicle has: headings of its wheels as the linkages hold them, loads as the springs share them, and cornering
  stiffness and trail of each tire as the rig of the tires measures them at that load. What the bicycle's curvature is
  at speed against a crawl says which sign understeer must have;
- braking: full brakes stop it in no less than friction needs, and in no more than the brakes' torque does.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.reachable_speeds import held_speed
from simwarp.vehicle.rigs.tire_rig import tire_forces
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.suspensions.wheel_axes import steer_angles
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

Array = npt.NDArray[np.float64]

STEP: Final = 1.0e-3
"""Of the simulations [s]."""
GRAVITY: Final = 9.81
SETTLING: Final = 10.0
"""Until a vehicle that is dropped on its springs is looked at [s]."""
WEIGHT_ERROR: Final = 1.0e-3
"""Of the loads' sum, against the weight."""
LEVEL: Final = np.radians(5.0)
"""Largest pitch or roll of a vehicle that stands plausibly: at 3 m of wheelbase 0.26 m, more than a tire flattens and a
spring sinks together."""
QUIET: Final = 0.01
"""Speed of a vehicle that stands [m/s]: it would take 100 s for a metre."""
GRIP: Final = 1.15
"""More than any of these tires has on this road: 1.0 of Fiala's, on 0.9 where 0.8 is what it was measured on: 1.125."""
SLIDING: Final = 0.5
"""Less than the friction of any of these tires that is dragged over a dry road with its wheel blocked."""
THROTTLE_TIME: Final = 15.0
"""Of full throttle from rest [s]."""
LEAST_SPEED: Final = 3.0
"""That a vehicle must have reached by then [m/s]: 0.2 m/s² on the average, a slope of 2 %."""
STRAIGHT_TIME: Final = 5.0
STRAIGHT: Final = 0.1
"""Way sideways over the way ahead, in the first `STRAIGHT_TIME` seconds of full throttle with straight steering: 6°.
The torque of shafts along the vehicle loads the wheels of one side more, and nobody steers against it.
"""
CRAWL: Final = 3.0
"""Speed at which sideslip hardly counts [m/s]."""
FAST: Final = 12.0
"""Speed of the other tests, or what a vehicle can hold [m/s]."""
SIDE_ACCELERATION: Final = 2.0
"""Of the turn at speed, as the crawl would have it [m/s²]: far from the limit, above what scatters."""
CRAWL_STEERING: Final = 0.15
"""Of the full steering, to either side."""
MOST_STEERING: Final = 2.0
"""That a vehicle which hardly steers gets at speed, against the crawl's: still a small one."""
PROBE: Final = np.radians(1.0)
"""Slip angle at which the rig takes a tire's cornering stiffness: that of the turn at speed, half to twice."""
BICYCLE: Final = 0.15
"""Share by which the curvature may leave that of the bicycle, which knows no camber, no rolling losses and no drive."""
UNSTEERED: Final = 5.0e-4
"""Difference of curvatures that does not count [1/m]. A differential that locks up to 100 N·m turns a car with a track
of 1.8 m and tires of 0.47 m by 190 N·m against its curve: 0.0006/m on 2.5 m of wheelbase and 100 kN/rad of each axle.
"""
NEUTRAL: Final = 0.03
"""Understeer that is too small to ask for a sign, as a share of the curvature."""
PULL: Final = 0.002
"""Curvature that straight steering may leave [1/m]: wheels 0.3° off on a wheelbase of 2.5 m, what aligning leaves."""
WIDE: Final = 30.0
"""A circle at full steering from which on a vehicle steers little [m]: trucks do with half of it."""
SPARE: Final = 1.1
"""Of a speed that full throttle must have reached for a vehicle to be driven there."""
LEAST_WHEELS: Final = 3
"""On the ground, of a vehicle that still drives."""
COAST: Final = 3.0
"""Before a vehicle that rolls steers or brakes [s]."""
TURN: Final = 8.0
"""Until a turn is steady [s]."""
LOOKED_AT: Final = 2.0
"""For which it is then looked at [s]: an automatic that shifts to and fro nods, and steers by its springs."""
LOOKS: Final = 0.1
"""Between looks [s]."""


@dataclasses.dataclass(frozen=True)
class Turn:
    """A steady turn, half the difference between those to either side, so that what is not symmetric drops out.

    Attributes:
        speed: [m/s].
        curvature: yaw rate over speed [1/m].
        bicycle: what the bicycle has at that speed [1/m].
        wheels: what it would have at a crawl with those headings of its wheels [1/m].
        bias: half the sum of the curvatures to either side [1/m].
        tightest: curvature of full steering to the left and to the right, positive where it turns that way [1/m].
    """

    speed: float
    curvature: float
    bicycle: float
    wheels: float
    bias: float
    tightest: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Driven:
    """How a vehicle drove.

    Attributes:
        weight: [N].
        loads: (wheels,) at rest [N].
        tilt: larger of pitch and roll at rest [rad].
        moving: speed at rest [m/s].
        reached: speed after full throttle [m/s].
        sideways: way sideways over the way ahead.
        crawl, turn: slow and at speed.
        braked_from: speed [m/s].
        stopping: distance [m].
        brake_limit: deceleration that the brakes' torque and sliding wheels allow at the least [m/s²].
    """

    weight: float
    loads: Array
    tilt: float
    moving: float
    reached: float
    sideways: float
    crawl: Turn
    turn: Turn
    braked_from: float
    stopping: float
    brake_limit: float

    @property
    def understeer(self) -> float:
        """Share of the curvature of its wheels' headings that is lost at speed; negative: it turns in."""
        return 1.0 - self.turn.curvature / self.turn.wheels

    @property
    def expected_understeer(self) -> float:
        """The same of the bicycle."""
        return 1.0 - self.turn.bicycle / self.turn.wheels

    @property
    def little_steering(self) -> str:
        """Sides to which full steering takes it round no circle that a yard has, in words; empty where it does."""
        wide = [side for side, each in zip(("left", "right"), self.crawl.tightest, strict=True) if each < 1.0 / WIDE]
        return "" if not wide else "steers little" if len(wide) > 1 else f"steers little to the {wide[0]}"

    def faults(self) -> list[str]:
        """What is not plausible; empty where all is."""
        return [*self._standing(), *self._accelerating(), *self._steering(), *self._braking()]

    def _standing(self) -> list[str]:
        found = []
        total = float(self.loads.sum()) / self.weight
        if abs(total - 1.0) > WEIGHT_ERROR:
            found.append(f"its tires bear {total:.4f} of the weight")
        if (self.loads <= 0.0).any():
            found.append("a wheel hangs in the air")
        if self.tilt > LEVEL:
            found.append(f"it stands {np.degrees(self.tilt):.1f}° out of level")
        if self.moving > QUIET:
            found.append(f"it moves by {self.moving:.2g} m/s at rest")
        return found

    def _accelerating(self) -> list[str]:
        if not LEAST_SPEED < self.reached < GRIP * GRAVITY * THROTTLE_TIME:
            return [f"full throttle for {THROTTLE_TIME:.0f} s takes it to {self.reached:.2g} m/s"]
        return [f"it drifts {self.sideways:.0%} sideways under throttle"] if self.sideways > STRAIGHT else []

    def _steering(self) -> list[str]:
        found = []
        for name, turn in (("a crawl", self.crawl), ("speed", self.turn)):
            share = turn.curvature / turn.bicycle
            if not turn.curvature > 0.0:
                found.append(f"steered to the left it turns to the right at {name}")
            elif not abs(turn.curvature - turn.bicycle) < max(BICYCLE * turn.bicycle, UNSTEERED):
                found.append(f"it turns by {share:.2f} of what its wheels' headings ask for at {name}")
            if abs(turn.bias) > max(PULL, 0.5 * turn.curvature):
                found.append(f"it turns by {turn.bias:.4f}/m with straight steering at {name}")
        if abs(self.expected_understeer) > NEUTRAL and self.understeer * self.expected_understeer < 0.0:
            found.append(f"understeer has the wrong sign: {self.understeer:.2f} for {self.expected_understeer:.2f}")
        return found

    def _braking(self) -> list[str]:
        energy = 0.5 * self.braked_from**2
        if not np.isfinite(self.stopping):
            return ["it does not stop"]
        if self.stopping < energy / (GRIP * GRAVITY):
            return [f"it stops in {self.stopping:.1f} m, sooner than friction allows"]
        if self.stopping > 1.2 * energy / self.brake_limit:
            return [f"it stops in {self.stopping:.1f} m, {energy / self.brake_limit:.1f} m would do"]
        return []


def drive(spec: VehicleSpec) -> Driven:
    """Drives a vehicle on level ground through all tests."""
    rest = _Run(spec, 0.0, worlds=1)
    rest.let(SETTLING, lambda: (0.0, 0.0, 1.0))
    loads, tilt = rest.loads[0], float(np.abs(rest.vehicle.angles.numpy()[0, :2]).max())
    moving = float(np.abs(rest.vehicle.velocity_b.numpy()[0]).max())
    start = rest.place()
    heading = float(rest.vehicle.angles.numpy()[0, 2])
    rest.let(STRAIGHT_TIME, lambda: (0.0, 1.0, 0.0))
    way = (rest.place() - start) @ [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
    rest.let(THROTTLE_TIME - STRAIGHT_TIME, lambda: (0.0, 1.0, 0.0))
    reached = float(rest.vehicle.velocity_b.numpy()[0, 0])
    fast = held_speed(spec, FAST)
    crawl = _turn(spec, CRAWL, CRAWL_STEERING, reached)
    asked = SIDE_ACCELERATION / fast**2
    steering = CRAWL_STEERING * float(np.clip(asked / max(crawl.curvature, 1e-6), 0.1, MOST_STEERING))
    turn = _turn(spec, fast, steering, reached)
    braked_from, stopping = _brake(spec, fast, reached)
    return Driven(
        weight=rest.weight, loads=loads, tilt=tilt, moving=moving, reached=reached,
        sideways=float(abs(way[1]) / max(abs(way[0]), 1e-9)), crawl=crawl, turn=turn, braked_from=braked_from,
        stopping=stopping, brake_limit=_brake_limit(spec, loads, rest.weight),
    )  # fmt: skip


class _Run:
    """A vehicle that starts rolling, in some worlds."""

    def __init__(self, spec: VehicleSpec, speed: float, *, worlds: int) -> None:
        builder = ModelBuilder()
        parts = add_vehicle(builder, spec, speed=speed)
        model = builder.finalize(worlds, "cpu", per_world=per_world())
        self.spec = spec
        self.vehicle = Vehicle(parts, model)
        self.simulation = Simulation(model, STEP, elements=[self.vehicle], solver=VEHICLE_SOLVER)
        self.masses = np.array([body.mass for body in builder.bodies])
        self.weight = GRAVITY * float(self.masses.sum())

    @property
    def loads(self) -> Array:
        """(W, wheels) [N]."""
        return np.array(self.vehicle.tires.load.numpy(), np.float64)

    def place(self) -> Array:
        """(2,) of the first world's chassis [m]."""
        return np.array(self.simulation.state.body_x.numpy()[0, self.vehicle.parts.chassis, :2], np.float64)

    def give(self, rows: Sequence[Sequence[float]] | Sequence[float]) -> None:
        """Steering, throttle and brakes, of all worlds or of each."""
        inputs = self.vehicle.input.numpy()
        inputs[:, :3] = rows
        self.vehicle.input.assign(inputs)

    def let(self, time: float, inputs: Callable[[], Any], every: float = 0.02) -> None:
        """Lets a driver drive who looks up from time to time."""
        for _ in range(round(time / every)):
            self.give(inputs())
            self.simulation.step(round(every / STEP))


def _at_speed(spec: VehicleSpec, speed: float, reached: float, worlds: int) -> _Run:
    """A vehicle that rolls straight on: from rest where its engine gets it there, as built where it does not."""
    if reached < SPARE * speed:
        run = _Run(spec, speed, worlds=worlds)
    else:
        run = _Run(spec, 0.0, worlds=worlds)
        run.let(SETTLING, lambda: (0.0, 0.0, 1.0))
        run.let(THROTTLE_TIME, lambda: np.column_stack([np.zeros(worlds), *_held(run, speed)]))
    run.let(COAST, lambda: np.column_stack([np.zeros(worlds), *_held(run, speed)]))
    return run


def _turn(spec: VehicleSpec, speed: float, steering: float, reached: float) -> Turn:
    """A turn to either side; the throttle holds the speed."""
    steerings = np.array([steering, -steering, 1.0, -1.0])[: 4 if speed <= CRAWL else 2]
    run = _at_speed(spec, speed, reached, len(steerings))
    run.let(TURN, lambda: np.column_stack([steerings, *_held(run, speed)]))
    seen: list[tuple[Array, ...]] = []
    for _ in range(round(LOOKED_AT / LOOKS)):
        run.let(LOOKS, lambda: np.column_stack([steerings, *_held(run, speed)]))
        motion = [np.array(each.numpy(), np.float64) for each in (run.vehicle.velocity_b, run.vehicle.omega_b)]
        seen.append((motion[0][:, 0], motion[1][:, 2], run.loads, *_wheels(run)))
    velocity, rate, loads, ahead, heading = (np.mean(each, axis=0) for each in zip(*seen, strict=True))
    curvature, friction = rate / velocity, float(run.vehicle.tires.ground_friction.numpy()[0])
    bicycle, wheels = (
        [bicycle_curvature(spec, loads[k], ahead[k], heading[k], share * velocity[k], friction) for k in range(2)]
        for share in (1.0, 0.0)
    )
    return Turn(
        float(velocity[:2].mean()), float(0.5 * (curvature[0] - curvature[1])),
        0.5 * (bicycle[0] - bicycle[1]), 0.5 * (wheels[0] - wheels[1]),
        float(0.5 * (curvature[0] + curvature[1])), (float(curvature[-2]), float(-curvature[-1])),
    )  # fmt: skip


def _held(run: _Run, speed: float) -> tuple[Array, Array]:
    """Throttle and brakes (W,) that hold a speed."""
    lacks = speed - np.asarray(run.vehicle.velocity_b.numpy(), np.float64)[:, 0]
    return np.clip(0.5 * lacks, 0.0, 1.0), np.zeros_like(lacks)


def _wheels(run: _Run) -> tuple[Array, Array]:
    """Places of the wheels ahead of the centre of mass (W, wheels) [m], and headings (W, wheels) [rad]."""
    places = np.asarray(run.simulation.state.body_x.numpy(), np.float64)
    rotations = np.asarray(run.simulation.state.body_rot.numpy(), np.float64)
    spindles = [side.spindle for side in run.vehicle.parts.sides]
    yaw = np.asarray(run.vehicle.angles.numpy(), np.float64)[:, 2]
    center = np.einsum("b,wbi->wi", run.masses, places) / run.masses.sum()
    ahead, heading = [], []
    for world, turned in enumerate(yaw):
        cos, sin = np.cos(turned), np.sin(turned)
        level = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        ahead.append(((places[world, spindles] - center[world]) @ level.T)[:, 0])
        axes = np.array([matrix_of(rotations[world, spindle])[:, 1] for spindle in spindles]) @ level.T
        heading.append(steer_angles(axes))
    return np.array(ahead), np.array(heading)


def bicycle_curvature(
    spec: VehicleSpec, loads: Array, ahead: Array, heading: Array, speed: float, friction: float
) -> float:
    """Curvature of a bicycle with an axle at every wheel [1/m]; `speed` 0: at a crawl, where no force is needed.

    Unknown are the angle b at which the centre of mass moves, positive to the left, and the curvature k. A wheel with
    its heading h slips by h - b - x k; its force is C times that, and acts its trail behind its centre. `friction` is
    the road's.
    """
    stiffness, trail = np.zeros_like(loads), np.zeros_like(loads)
    for wheel, load in enumerate(loads):
        if load > 1.0:
            tire = spec.axles[wheel // 2].tire
            probe = tire_forces(tire, slip_angle=PROBE, load=load, speed=max(speed, CRAWL), friction=friction)
            stiffness[wheel] = abs(float(probe.fy)) / PROBE
            trail[wheel] = abs(float(probe.mz) / float(probe.fy))
    mass = float(loads.sum()) / GRAVITY
    lever = ahead - trail
    if (stiffness > 0.0).sum() < LEAST_WHEELS:
        return np.nan
    matrix = [
        [stiffness.sum(), stiffness @ ahead + mass * speed**2],
        [stiffness @ lever, stiffness @ (lever * ahead)],
    ]
    return float(np.linalg.solve(matrix, [stiffness @ heading, stiffness @ (lever * heading)])[1])


def _brake(spec: VehicleSpec, speed: float, reached: float) -> tuple[float, float]:
    """Speed at which full brakes begin [m/s], and the way to a stop [m]; infinite where it does not come to one."""
    run = _at_speed(spec, speed, reached, 1)
    begin, braked_from = run.place(), float(run.vehicle.velocity_b.numpy()[0, 0])
    for _ in range(100):
        run.let(0.1, lambda: (0.0, 0.0, 1.0))
        if abs(float(run.vehicle.velocity_b.numpy()[0, 0])) < 0.05:
            return braked_from, float(np.linalg.norm(run.place() - begin))
    return braked_from, np.inf


def _brake_limit(spec: VehicleSpec, loads: Array, weight: float) -> float:
    """Deceleration of brakes that give the lesser of their torque and of a blocked wheel's friction [m/s²]."""
    force = 0.0
    for wheel, load in enumerate(loads):
        axle = spec.axles[wheel // 2]
        if axle.brake is not None:
            force += min(axle.brake.max_torque / axle.tire.radius, SLIDING * load)
    return force / weight * GRAVITY
