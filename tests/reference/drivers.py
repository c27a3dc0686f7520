"""Drivers one world at a time, slowly, in float64: what `simwarp.vehicle.path_tracking_kernels` must do."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from simwarp.vehicle.driving.path_tracking import PathTrackingSpec, PIDGains, Stanley, Unicycle
from simwarp.vehicle.driving.paths import Path


class Place(NamedTuple):
    """The point of a path that is nearest to a place."""

    segment: int
    distance: float
    arc: float
    curvature: float
    tangent: np.ndarray


def distances(path: Path, x: np.ndarray) -> np.ndarray:
    """Of a place from every segment, ends included."""
    a, along = path.points[:-1], np.diff(path.points, axis=0)
    part = np.clip(((x - a) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    return np.linalg.norm(x - a - part[:, None] * along, axis=1)


def nearest(path: Path, hint: int, x: np.ndarray) -> Place:
    """As a driver that was at segment `hint` sees it; -1: it looks at all of them."""
    far = distances(path, x)
    count = len(far)
    best = hint
    if hint < 0:
        best = int(np.argmin(far))
    else:
        for direction in (1, -1):
            while True:
                following = best + direction
                if path.closed:
                    following %= count
                if not 0 <= following < count or far[following] >= far[best]:
                    break
                best = following
    return place_on(path, best, x)


def place_on(path: Path, segment: int, x: np.ndarray) -> Place:
    """Where a place is along a segment and beside it."""
    a, b = path.points[segment], path.points[segment + 1]
    part = float((x - a) @ (b - a) / ((b - a) @ (b - a)))
    inner = min(1.0, max(0.0, part))
    last = len(path.points) - 2
    beyond = not path.closed and ((segment == 0 and part < 0.0) or (segment == last and part > 1.0))
    if not beyond:
        part = inner
    offset = x - a - part * (b - a)
    side = math.copysign(1.0, (b - a)[0] * offset[1] - (b - a)[1] * offset[0])
    tangents, curvatures = path.tangents(), path.curvature()
    tangent = (1.0 - inner) * tangents[segment] + inner * tangents[segment + 1]
    return Place(
        segment,
        side * float(np.linalg.norm(offset)),
        float(path.arc[segment] + part * (path.arc[segment + 1] - path.arc[segment])),
        float((1.0 - inner) * curvatures[segment] + inner * curvatures[segment + 1]),
        tangent / np.linalg.norm(tangent),
    )


@dataclasses.dataclass
class PID:
    """A controller whose integral rests while its output is at an end."""

    gains: PIDGains
    last: float | None = None
    total: float = 0.0

    def output(self, error: float, dt: float, ahead: float = 0.0) -> float:
        """Not clamped, with what is given ahead of the error."""
        before = error if self.last is None else self.last
        self.last = error
        total = self.total + 0.5 * dt * (error + before)
        gains = self.gains
        found = gains.proportional * error + gains.integral * total + gains.derivative * (error - before) / dt + ahead
        if abs(found) < 1.0:
            self.total = total
        return found


class TrackingReference:
    """One driver of one vehicle."""

    def __init__(self, spec: PathTrackingSpec, path: Path, speed: float) -> None:
        self.spec, self.path, self.target = spec, path, speed
        self.segment = -1
        self.steering, self.speed = PID(spec.steering.gains), PID(spec.speed_gains)
        self.throttle = 0.0

    def step(
        self, dt: float, time: float, x: np.ndarray, rotation: np.ndarray, speed: float, yaw_rate: float
    ) -> np.ndarray:  # fmt: skip
        """(3,) steering, throttle and braking.

        Args:
            dt, time: step and time of the simulation [s].
            x: (3,) the vehicle's frame of reference [m].
            rotation: (3, 3) its axes.
            speed: forwards [m/s].
            yaw_rate: of its own axes [rad/s].
        """
        spec = self.spec
        law = spec.steering
        ahead = getattr(law, {Stanley: "axle", Unicycle: "center"}.get(type(law), "distance"))
        place = nearest(self.path, self.segment, (x + ahead * rotation[:, 0])[:2])
        self.segment = place.segment
        if time < spec.start:
            return np.array([0.0, 0.0, 1.0])
        elapsed = time - spec.start
        target = self.target * (min(1.0, elapsed / spec.ramp) if spec.ramp > 0.0 else 1.0)
        if isinstance(law, Stanley):
            steering = self._stanley(law, place, rotation[:2, 0], speed, dt)
        elif isinstance(law, Unicycle):
            turn, wanted = self._turn(law, place, rotation[:2, 0], speed)
            steering = self.steering.output(wanted - yaw_rate, dt, wanted / law.full_yaw_rate)
            target *= max(math.cos(turn), 0.0)
        else:
            steering = self.steering.output(-place.distance, dt)
        return np.array([min(1.0, max(-1.0, steering)), *self._pedals(target - speed, dt)])

    def _turn(self, law: Unicycle, place: Place, forward: np.ndarray, speed: float) -> tuple[float, float]:
        """Angle to the direction of approach [rad], and the yaw rate to follow the path [rad/s]."""
        heading = math.atan2(
            forward[0] * place.tangent[1] - forward[1] * place.tangent[0], float(forward @ place.tangent)
        )
        turn = math.remainder(heading - math.atan(place.distance / law.approach), math.tau)
        v = max(speed, 0.0)
        curve = v * math.cos(heading) * place.curvature / max(1.0 - place.curvature * place.distance, 0.1)
        return turn, curve + (v + law.soft_speed) * 8.0 / law.approach * math.sin(0.5 * turn)

    def _stanley(self, law: Stanley, place: Place, forward: np.ndarray, speed: float, dt: float) -> float:
        heading = math.atan2(
            forward[0] * place.tangent[1] - forward[1] * place.tangent[0], float(forward @ place.tangent)
        )
        error = -place.distance
        before = error if self.steering.last is None else self.steering.last
        self.steering.last = error
        total = self.steering.total + 0.5 * dt * (error + before)
        pulled = math.copysign(max(abs(error) - law.dead_zone, 0.0), error)
        pull = law.gains.proportional * pulled + law.gains.integral * total
        found = (heading + math.atan2(pull, law.soft_speed + max(speed, 0.0))) / law.full_angle
        if abs(found) < 1.0:
            self.steering.total = total
        return found

    def _pedals(self, error: float, dt: float) -> tuple[float, float]:
        output = min(1.0, max(-1.0, self.speed.output(error, dt)))
        braking = 0.0
        if output > 0.0:
            self.throttle = output
        elif self.throttle > self.spec.throttle_threshold:
            self.throttle = 1.0 + output
        else:
            self.throttle, braking = 0.0, -output
        return self.throttle, braking


def approach(value: np.ndarray, target: np.ndarray, gain: np.ndarray, rate: np.ndarray, dt: float) -> np.ndarray:
    """(4,) inputs one step later; a gain or rate that is not finite does not act."""
    goal = np.clip(target, [-1.0, 0.0, 0.0, 0.0], 1.0)
    change = (goal - value) * np.where(np.isfinite(gain), 1.0 - np.exp(-np.minimum(gain, 1e9) * dt), 1.0)
    return value + np.clip(change, -rate * dt, rate * dt)
