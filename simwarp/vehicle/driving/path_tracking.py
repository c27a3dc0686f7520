"""Drivers that close a loop: along a path at a speed, and towards inputs that a person or a policy asks for."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
import warp as wp

from simwarp.core.arrays import writable, writable_from
from simwarp.core.constraints import Ge, Le, MinLen, NotNegative, Positive
from simwarp.core.object_repr import plural
from simwarp.model.rules import instance_of
from simwarp.simulation.attachments import ForceElement, StepContext
from simwarp.simulation.world_masks import mask_of_worlds
from simwarp.vehicle.driving.paths import Path, path_tables
from simwarp.vehicle.driving.specs_of_worlds import per_world, specs_of_worlds
from simwarp.vehicle.path_tracking_kernels import (
    Gains,
    PathTrackerState,
    PathTrackerTables,
    SteeringLaw,
    approach_target,
    follow_path,
    restart_trackers,
)
from simwarp.vehicle.spec.parts import Spec, refuse
from simwarp.vehicle.spec.vehicle_spec import DifferentialDrive, SpecError, VehicleSpec
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle


@dataclasses.dataclass(frozen=True, kw_only=True)
class PIDGains(Spec):
    """Of a controller: output per error, per its integral [1/s more] and per its rate [s more]."""

    proportional: float
    integral: float = 0.0
    derivative: float = 0.0

    def kernel_gains(self) -> Gains:
        """For kernels."""
        gains = Gains()
        gains.proportional, gains.integral, gains.derivative = self.proportional, self.integral, self.derivative
        return gains


@dataclasses.dataclass(frozen=True, kw_only=True)
class LookAhead(Spec):
    """Steers by a PID on the distance of a point ahead of the vehicle from the path."""

    distance: float = 5.0
    """Of that point from the vehicle's frame of reference, straight ahead [m]."""
    gains: PIDGains = PIDGains(proportional=0.5)
    """Steering input per metre."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stanley(Spec):
    """Steers the front axle: along the path's direction, and towards it by atan(gain · distance / speed)."""

    axle: float = 0.0
    """Of the front axle from the vehicle's frame of reference, forwards [m]."""
    gains: PIDGains = PIDGains(proportional=1.0)
    """Approach per distance [1/s]; the integral [1/s²]. The derivative must be 0."""
    dead_zone: float = 0.0
    """Distances that are not steered against [m]."""
    soft_speed: Positive = 1.0
    """Added to the speed, so that the wheels stay calm at standstill [m/s]."""
    full_angle: Positive = 0.5
    """Of the road wheels at full input [rad]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Unicycle(Spec):
    """Steers by yaw rate, for vehicles that turn on the spot: that of the path's curve, and that of the way back, which
    leads towards the path by atan(distance / approach). `unicycle_for` makes one for a vehicle.

    Where the path leads back, the vehicle turns on the spot first.
    """

    full_yaw_rate: Positive
    """At full input, with the usual slip of the wheels [rad/s]."""
    approach: Positive = 1.0
    """Length over which it comes back to the path [m]."""
    center: float = 0.0
    """Of the axis about which it turns from the vehicle's frame of reference, forwards [m]."""
    gains: PIDGains = PIDGains(proportional=0.1, integral=1.0)
    """Steering input per error of the yaw rate [s/rad]; the integral [1/rad] finds what the ground's slip takes."""
    soft_speed: Positive = 0.1
    """Added to the speed, so that it turns at standstill, too [m/s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PathTrackingSpec(Spec):
    """Configuration of a path tracker: paths, target speed and controllers.

    Too slow: throttle; too fast while the throttle is open by more than `throttle_threshold`: throttle 1 less what the
    controller asks for, as in Project Chrono, so that it closes only with a large error or an integral; else brakes.

    Raises:
        SpecError: there is no path, a number is negative or not finite, or the gains do not fit Stanley's law.
    """

    paths: Annotated[tuple[Annotated[Path, instance_of(Path, "make one by circle or read_path")], ...], MinLen(1)]
    """One for all worlds, or several to choose from (`PathTracker.path`)."""
    speed: NotNegative
    """[m/s]."""
    steering: LookAhead | Stanley | Unicycle = LookAhead()
    speed_gains: PIDGains = PIDGains(proportional=0.4)
    """Pedal per speed error [s/m]."""
    throttle_threshold: float = 0.2
    start: NotNegative = 0.0
    """Until this time the vehicle stands on its brakes [s]."""
    ramp: NotNegative = 0.0
    """The speed to hold rises from zero for this long [s]."""
    first_throttle: Annotated[float, Ge(0.0), Le(1.0)] = 0.0
    """At the first step without any error, by the integral of the gains: what holds the speed at which it begins."""

    def check(self) -> None:
        """Checks that Stanley's law has no rate, and that an integral holds the first throttle.

        Raises:
            SpecError: its gains have a derivative, or the pedals have no integral.
        """
        if self.first_throttle > 0.0 and not self.speed_gains.integral > 0.0:
            raise SpecError(
                f"first_throttle: must be 0 without an integral of speed_gains, got {self.first_throttle!r}"
            )
        if isinstance(self.steering, Stanley) and self.steering.gains.derivative != 0.0:
            raise SpecError(f"derivative: must be 0 for Stanley's law, got {self.steering.gains.derivative!r}")


def wheelbase(spec: VehicleSpec) -> float:
    """Distance of the first and the last axle [m]."""
    return abs(spec.axles[0].location[0] - spec.axles[-1].location[0])


def look_ahead_for(spec: VehicleSpec, seconds: float = 0.0, speed: float = 0.0) -> LookAhead:
    """Look-ahead steering for a vehicle of any size: 5 m and 0.5 per metre for a wheelbase of 3.3 m.

    The point is farther ahead at speed, `seconds` of driving at least, and the gain smaller by as much.
    """
    size = wheelbase(spec) / 3.3
    distance = max(5.0 * size, seconds * speed)
    return LookAhead(distance=distance, gains=PIDGains(proportional=2.5 / distance))


def full_speed(spec: VehicleSpec) -> float:
    """Of a vehicle with differential drive at full throttle [m/s].

    Raises:
        SpecError: it has another driveline.
    """
    line = spec.driveline
    if not isinstance(line, DifferentialDrive):
        raise refuse("driveline", "'differential-drive'", None if line is None else line.template)
    return line.max_speed * line.gear_ratio * spec.axles[0].tire.radius


def full_yaw_rate(spec: VehicleSpec) -> float:
    """Of a vehicle with differential drive at full steering on the spot, with the usual slip of its wheels [rad/s].

    Wheels that slide with one friction all ways turn a vehicle of track b and wheelbase l as if its track were
    b (1 + l²/b²): the moment of what they push ahead is that of what they scrub sideways.

    Raises:
        SpecError: it has another driveline.
    """
    track = 2.0 * abs(spec.axles[0].suspension.spindle.com[1] + spec.axles[0].wheel.offset)
    return 2.0 * full_speed(spec) / (track * (1.0 + (wheelbase(spec) / track) ** 2))


def unicycle_for(spec: VehicleSpec) -> Unicycle:
    """Steering by yaw rate for a vehicle with differential drive: back to the path within two wheelbases.

    Raises:
        SpecError: it has another driveline.
    """
    places = [axle.location[0] for axle in spec.axles]
    center, approach = 0.5 * (min(places) + max(places)), max(2.0 * wheelbase(spec), 4.0 * spec.axles[0].tire.radius)
    return Unicycle(full_yaw_rate=full_yaw_rate(spec), approach=approach, center=center)


class PathTracker(ForceElement):
    """Drives every world along a path: a `ForceElement` that comes before its vehicle.

    Args:
        vehicle: whose `input` it writes.
        spec: paths, speed and gains of all worlds, or one for each, along whose first path it begins.

    Raises:
        SpecError: there are neither one nor as many specs as worlds.

    Attributes:
        path: (W,) which of the paths, those of all specs in their order; write it before the first step or at a reset.
        target_speed: (W,) [m/s]; write it at any time.
        distance: (W,) of the steered point from the path [m], positive to the left of it.
        arc: (W,) its place along the path [m].
    """

    def __init__(self, vehicle: AnyVehicle, spec: PathTrackingSpec | Sequence[PathTrackingSpec]) -> None:
        worlds, device = vehicle.model.world_count, vehicle.model.device
        self.vehicle = vehicle
        self.specs = specs = specs_of_worlds(spec, PathTrackingSpec, worlds)
        paths = [path for each in specs for path in each.paths]
        first = np.cumsum([0] + [len(each.paths) for each in specs])[:-1]
        self.path = writable_from(per_world(first.tolist(), worlds).astype(np.int32), wp.int32, device)
        self.target_speed = writable_from(per_world([each.speed for each in specs], worlds), wp.float32, device)
        self._tables = path_tables(paths, device)
        tables = [_tracker(vehicle, each) for each in specs]
        self._trackers: wp.array = wp.array(tables, dtype=PathTrackerTables, device=device)
        self._state = PathTrackerState()
        self._state.segment = wp.full(worlds, -1, dtype=int, device=device)
        names = ("steering_error", "steering_sum", "speed_error", "speed_sum", "throttle", "distance", "arc")
        for name in names:
            setattr(self._state, name, wp.zeros(worlds, dtype=float, device=device))
        sums = [each.first_throttle / (each.speed_gains.integral or 1.0) for each in specs]
        self._state.speed_sum.assign(np.broadcast_to(per_world(sums, worlds), worlds).astype(np.float32))
        self._state.started = wp.zeros(worlds, dtype=int, device=device)
        self._memory = {name: getattr(self._state, name) for name in ("segment", "started", *names)}

    def _readable_title(self) -> str:
        return f" of vehicle '{self.vehicle.parts.spec.name}', along {plural(len(self._tables.closed), 'path')}"

    @property
    def distance(self) -> wp.array:
        """(W,) float32, distance of the steered point from the path [m], positive to the left of it."""
        return self._state.distance

    @property
    def arc(self) -> wp.array:
        """(W,) float32, place of the steered point along the path, from its start [m]."""
        return self._state.arc

    def restart(self, world_mask: Any = None) -> None:
        """Looks for the nearest place on the whole path at the next step, and begins anew to add up errors.

        `place_vehicle` does so; call it after the vehicle was put elsewhere by other means.

        Args:
            world_mask: (W,) bool; all worlds when None.
        """
        model = self.vehicle.model
        mask = wp.ones(model.world_count, dtype=bool, device=model.device)
        if world_mask is not None:
            mask = mask_of_worlds("restart", world_mask, model)
        wp.launch(restart_trackers, model.world_count, inputs=[mask], outputs=[self._state], device=model.device)

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """Place on the path, integrals and last errors of the controllers."""
        return self._memory

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """Path and speed."""
        return {"path": self.path, "target_speed": self.target_speed}

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch that writes the inputs."""
        return [
            simulation.shares.record(
                follow_path,
                inputs=[dt, self._trackers, self._tables, self.path, self.target_speed, simulation.state.arrays],
                outputs=[self._state, self.vehicle.input],
            )
        ]  # fmt: skip


def _tracker(vehicle: AnyVehicle, spec: PathTrackingSpec) -> PathTrackerTables:
    table = PathTrackerTables()
    steering = spec.steering
    table.chassis = vehicle.parts.chassis
    table.reference = wp.vec3(*vehicle.parts.reference)
    table.steering = steering.gains.kernel_gains()
    if isinstance(steering, Stanley):
        table.law = int(SteeringLaw.STANLEY)
        table.ahead = steering.axle
        table.dead_zone, table.soft_speed = steering.dead_zone, steering.soft_speed
        table.full_angle = steering.full_angle
    elif isinstance(steering, Unicycle):
        table.law = int(SteeringLaw.UNICYCLE)
        table.ahead, table.approach = steering.center, steering.approach
        table.full_yaw_rate, table.soft_speed = steering.full_yaw_rate, steering.soft_speed
    else:
        table.law = int(SteeringLaw.LOOK_AHEAD)
        table.ahead = steering.distance
    table.speed = spec.speed_gains.kernel_gains()
    table.throttle_threshold = spec.throttle_threshold
    table.start, table.ramp = spec.start, spec.ramp
    return table


class InteractiveDriver(ForceElement):
    """Moves a vehicle's inputs towards a target, as a hand or a foot does: a `ForceElement` before its vehicle.

    Each input follows with a lag of first order, gain · (target - input), and no faster than its rate.

    Args:
        vehicle: whose `input` it writes.
        gain: of steering, throttle, braking and clutch [1/s]; one number for all, None for no lag.
        rate: the most that each changes per second; one number for all, None for no limit.

    Attributes:
        target: (W, 4) steering -1..1 (positive to the left), throttle, braking and clutch 0..1. Write it at any time;
            a reset brings zeros back.
    """

    def __init__(
        self,
        vehicle: AnyVehicle,
        *,
        gain: float | Sequence[float] | None = 4.0,
        rate: float | Sequence[float] | None = None,
    ) -> None:
        self.vehicle = vehicle
        self.target = writable((vehicle.model.world_count, 4), wp.float32, vehicle.model.device)
        self._gain, self._rate = _four("gain", gain), _four("rate", rate)

    def _readable_title(self) -> str:
        return f" of vehicle '{self.vehicle.parts.spec.name}', towards target"

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """The target; the inputs themselves are remembered by the vehicle."""
        return {"target": self.target}

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch that writes the inputs."""
        return [
            simulation.shares.record(
                approach_target,
                inputs=[dt, self._gain, self._rate, self.target], outputs=[self.vehicle.input],
            )
        ]  # fmt: skip


def _four(name: str, value: float | Sequence[float] | None) -> wp.vec4:
    """One number per input; -1 stands for none."""
    numbers = [-1.0] * 4 if value is None else np.broadcast_to(np.asarray(value, dtype=float), (4,)).tolist()
    if value is not None and not all(math.isfinite(number) and number >= 0.0 for number in numbers):
        raise SpecError(f"{name}: must be one number or four, none negative, got {value!r}")
    return wp.vec4(*numbers)
