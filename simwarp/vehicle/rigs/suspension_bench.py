"""The worlds of a bench: linkages of an axle closed at all states of a motion and their neighbours, measured.

Rates over the travel are differences between neighbours; loads follow by virtual work from springs, anti-roll bar and
weights.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of, rotate
from simwarp.vehicle.rigs.rig_rows import Reasons, RowStatus, slopes
from simwarp.vehicle.rigs.spring_rates import stop_depth, without_stops
from simwarp.vehicle.rigs.standing_loads import GRAVITY, StandingLoads, driven_axles
from simwarp.vehicle.rigs.suspension_curves import SuspensionCurve, SuspensionMotion
from simwarp.vehicle.spec.parts import Array, Vec3
from simwarp.vehicle.spec.vehicle_spec import ForceLine, MacPhersonStrut, PinnedAxle, VehicleSpec
from simwarp.vehicle.suspensions.corner import spring_force
from simwarp.vehicle.suspensions.kinematics import HeldAxle, hold_axle
from simwarp.vehicle.suspensions.kingpins import kingpin_axis
from simwarp.vehicle.suspensions.wheel_axes import camber_angles, contact_points, steer_angles, toe_angles

NEAR: Final = 1.0e-3
"""Travel to either side of a state between which its rates are measured [m]."""
Flags = npt.NDArray[np.bool_]

BASE, UP, DOWN, LEFT, RIGHT = range(5)
"""States beside each other: itself, both wheels up and down, the left one up with the right one down and vice versa."""
SHIFTS: Final = np.array([[0.0, 0.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]]) * NEAR


@dataclasses.dataclass(frozen=True)
class BenchMaker:
    """Benches of an axle."""

    spec: VehicleSpec
    axle: int
    radius: float
    loads: StandingLoads
    device: str

    def __call__(self, motion: SuspensionMotion, travels: Array) -> SuspensionBench:
        """A bench that goes through (n,) travels from the state as built [m]; at the middle one when steering."""
        return SuspensionBench(self, motion, travels)


class SuspensionBench:
    """The worlds of one motion: n states and their neighbours.

    Attributes:
        held: the linkages, closed.
        states: n.
    """

    def __init__(self, of: BenchMaker, motion: SuspensionMotion, travels: Array) -> None:
        self.part, self.motion, self.radius = of.spec.all_axles[of.axle], motion, of.radius
        self.axle, self.loads, self.states = of.axle, of.loads, len(travels)
        self.middle = len(travels) // 2
        self.reference = float(travels[self.middle])
        right = travels if motion is SuspensionMotion.PARALLEL else 2.0 * self.reference - travels
        heights, self.steering = np.stack([travels, right], axis=1), np.zeros(self.states)
        if motion is SuspensionMotion.STEERING:
            heights, self.steering = np.full((self.states, 2), self.reference), np.linspace(-1.0, 1.0, self.states)
        self.asked = heights - self.reference
        self.pinned = isinstance(self.part.suspension, PinnedAxle)
        self.front = bool(of.loads.axle_x[of.axle] > of.loads.axle_x.mean())
        self.driven = of.axle in driven_axles(of.spec)
        around = (heights[:, None] + SHIFTS).reshape(-1, 2)
        self.held: HeldAxle = hold_axle(
            of.spec, of.axle, around[:, 0], around[:, 1], np.repeat(self.steering, len(SHIFTS)), device=of.device
        )
        self.reached: Flags = self.held.reached.reshape(self.states, len(SHIFTS))
        if self.pinned:  # both wheels up is no state of it
            self.reached[:, UP] = self.reached[:, DOWN] = True
        self._x = np.asarray(self.held.simulation.state.body_x.numpy(), np.float64)
        self._q = np.asarray(self.held.simulation.state.body_rot.numpy(), np.float64)
        bodies = self.held.simulation.model.builder.bodies
        self._rest = [body.pose for body in bodies]
        self._weight = GRAVITY * np.array([body.mass for body in bodies])
        self.signs = np.array([side.side for side in self.held.bench.sides])

    def place(self, body: int, point: Array) -> Array:
        """(n, 5, 3) places of a point that moves with a body; given as built."""
        rest = self._rest[body]
        inverse = rest.rotation * np.array([-1.0, -1.0, -1.0, 1.0])
        return self._x[:, body].reshape(self.states, -1, 3) + self.turned(body, rotate(inverse, point - rest.position))

    def turned(self, body: int, vector: Array) -> Array:
        """(n, 5, 3) a vector in a body's axes, in those of the world."""
        found = np.array([matrix_of(q) @ vector for q in self._q[:, body]])
        return found.reshape(self.states, -1, 3)

    def point(self, side: int, point: Vec3) -> Array:
        """A point of the description as built [m]."""
        return np.asarray(self.part.location) + np.asarray(point) * (1.0, self.signs[side], 1.0)

    def curve(self) -> SuspensionCurve:
        """Everything that is measured of the motion."""
        sides = self.held.bench.sides
        centers = np.stack([self._x[:, side.spindle].reshape(self.states, -1, 3) for side in sides], axis=2)
        axes = np.stack([self._wheel_axis(k) for k in (0, 1)], axis=2)
        contacts = np.stack([self._contact(k, centers[:, BASE, k], axes[:, BASE, k]) for k in (0, 1)], axis=2)
        base = contacts[:, BASE]
        angles = [self._kingpin(k, base[:, k], axes[:, BASE, k]) for k in (0, 1)]
        caster, inclination, scrub, trail = (np.stack([a[m] for a in angles], axis=1) for m in range(4))
        dive, squat = self._anti(contacts, centers)
        ratios, work, bare, into = self._springs()
        spring_load, load = _loads_of(work), _loads_of(work + self._weights())
        usual = base[self.middle]
        measured: dict[str, Array] = {
            "travel": (centers[:, BASE] - self.held.rest[0])[..., 2] - self.reference,
            "steer": steer_angles(axes[:, BASE]), "toe": toe_angles(axes[:, BASE], self.signs),
            "camber": camber_angles(axes[:, BASE], self.signs),
            "track_change": (base[:, 0, 1] - base[:, 1, 1]) - (usual[0, 1] - usual[1, 1]),
            "wheelbase_change": base[..., 0] - usual[:, 0], "caster": caster, "kingpin_inclination": inclination,
            "scrub_radius": scrub, "trail": trail, "roll_centre": self._roll_centre(contacts), "anti_dive": dive,
            "anti_squat": squat, "motion_ratio": ratios, "spring_load": spring_load, "wheel_load": load,
            "into_stop": into,
        }  # fmt: skip
        status = np.where(self.reached.all(axis=1), RowStatus.DONE, RowStatus.DIVERGED).astype(np.int8)
        done = status == RowStatus.DONE
        measured |= self._rates(measured, _loads_of(bare), float(usual[0, 1] - usual[1, 1]), done)
        for values in measured.values():
            values[~done] = np.nan
        measured["travel"][~done] = self.asked[~done]
        return SuspensionCurve(
            motion=self.motion, steering=self.steering, status=status, reason=self._reasons(), front=self.front,
            driven=self.driven, **measured,
        )  # fmt: skip

    def _reasons(self) -> Reasons:
        """(n,) why a state or one of its neighbours is not reached."""
        texts = self.held.reason.reshape(self.states, len(SHIFTS))
        lost = ~self.reached
        return np.array(
            [row[mask][0] if mask.any() else "" for row, mask in zip(texts, lost, strict=True)], dtype=object
        )

    def _wheel_axis(self, side: int) -> Array:
        """(n, 5, 3) axis of a wheel, to the left."""
        return self.turned(self.held.bench.sides[side].spindle, np.array([0.0, 1.0, 0.0]))

    def _contact(self, side: int, center: Array, axis: Array) -> Array:
        """(n, 5, 3) the contact point of each state, which in its neighbours moves with the wheel's carrier: as that
        of a wheel whose brake is locked.
        """
        carrier = self.held.bench.sides[side].carrier
        places = self._x[:, carrier].reshape(self.states, -1, 3)
        turns = np.array([matrix_of(q) for q in self._q[:, carrier]]).reshape(self.states, -1, 3, 3)
        local = np.einsum("nji,nj->ni", turns[:, BASE], contact_points(center, axis, self.radius) - places[:, BASE])
        return places + np.einsum("nkij,nj->nki", turns, local)

    def _kingpin(self, side: int, contact: Array, axis: Array) -> tuple[Array, Array, Array, Array]:
        """Caster, inclination, scrub radius and trail of one wheel, (n,) each."""
        carrier, sign = self.held.bench.sides[side].carrier, self.signs[side]
        back = self._rest[carrier].rotation * np.array([-1.0, -1.0, -1.0, 1.0])
        start, direction = kingpin_axis(
            self.part.suspension,
            lambda point: np.tile(self.point(side, point), (self.states, 1)),
            lambda point: self.place(carrier, self.point(side, point))[:, BASE],
            lambda vector: self.turned(carrier, rotate(back, np.asarray(vector) * (1.0, sign, 1.0)))[:, BASE],
            self.states,
        )
        pierced = start + direction * ((contact[:, 2:] - start[:, 2:]) / direction[:, 2:])
        outwards = sign * axis * (1.0, 1.0, 0.0)
        outwards = outwards / np.linalg.norm(outwards, axis=1, keepdims=True)
        forward = np.cross(sign * outwards, (0.0, 0.0, 1.0))
        away = contact - pierced
        return (
            np.arctan2(-direction[:, 0], direction[:, 2]), np.arctan2(-sign * direction[:, 1], direction[:, 2]),
            np.einsum("ni,ni->n", away, outwards), -np.einsum("ni,ni->n", away, forward),
        )  # fmt: skip

    def _roll_centre(self, contacts: Array) -> Array:
        """(n, 2) y and height above the ground of the point where the normals of both contact points' paths meet."""
        change = contacts[:, LEFT] - contacts[:, RIGHT]
        slope = change[..., 1] / change[..., 2]
        y, z = contacts[:, BASE, :, 1], contacts[:, BASE, :, 2]
        # on the normal of a path: height = z - slope (y' - y)
        across = slope[:, 0] - slope[:, 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            place = (slope[:, 0] * y[:, 0] - slope[:, 1] * y[:, 1] + z[:, 0] - z[:, 1]) / across
        height = z[:, 0] - slope[:, 0] * (place - y[:, 0])
        return np.stack([place, height - z.mean(axis=1)], axis=1)

    def _anti(self, contacts: Array, centers: Array) -> tuple[Array, Array]:
        """(n, 2) shares in braking and driving of the load transfer that links bear."""
        first, second = (LEFT, RIGHT) if self.pinned else (UP, DOWN)
        locked, free = contacts[:, first] - contacts[:, second], centers[:, first] - centers[:, second]
        lever = self.loads.wheelbase / self.loads.com_height
        front = 1.0 if self.front else -1.0
        dive = front * self.loads.brake_share[self.axle] * lever * locked[..., 0] / locked[..., 2]
        squat = front * lever * free[..., 0] / free[..., 2]
        return dive, squat

    def _springs(self) -> tuple[Array, Array, Array, Array]:
        """Motion ratios (n, 2, lines); (n, 2) the work of springs and bar per travel of both wheels alike, and per
        opposite travel [N]; the same without stops; (n, 2) how far a line is in its bump stop (positive) or its rebound
        stop (negative), the deepest of each wheel [m].
        """
        lines: tuple[ForceLine, ...] = getattr(self.part.suspension, "springs", ())
        work, bare, into = (np.zeros((self.states, 2)) for _ in range(3))
        ratios = np.zeros((self.states, 2, len(lines)))
        for column, side in enumerate(self.held.bench.sides):
            body = side.carrier if isinstance(self.part.suspension, MacPhersonStrut) else side.bar
            for number, line in enumerate(lines):
                end = self.place(body, self.point(column, line.arm_point))
                length = np.linalg.norm(end - self.point(column, line.chassis_point), axis=2)
                change = _changes(length)
                work -= spring_force(line, length[:, BASE])[:, None] * change
                bare -= spring_force(without_stops(line), length[:, BASE])[:, None] * change
                ratios[:, column, number] = -change[:, 0]
                depth = stop_depth(line, length[:, BASE])
                into[:, column] = np.where(np.abs(depth) > np.abs(into[:, column]), depth, into[:, column])
        bar = self.held.bench.bar
        if bar is not None and self.part.antiroll_bar is not None:
            model = self.held.simulation.model
            twist = self.held.simulation.state.joint_x.numpy()[:, model.joint_dof_start[bar]]
            twist = twist.astype(np.float64).reshape(self.states, -1)
            turning = (self.part.antiroll_bar.stiffness * twist[:, BASE])[:, None] * _changes(twist)
            work, bare = work + turning, bare + turning
        return ratios, work, bare, into

    def _weights(self) -> Array:
        """(n, 2) work against the weight of all parts, likewise [N]."""
        heights = np.asarray(self._x[..., 2] @ self._weight).reshape(self.states, -1)
        return _changes(heights)

    def _rates(self, measured: Mapping[str, Array], bare: Array, track: float, done: Flags) -> dict[str, Array]:
        """Wheel rate and roll stiffness, and those of the loads (n, 2) without stops: slopes along the motion, between
        states that are done.
        """
        rate, free = (np.full((self.states, 2), np.nan) for _ in range(2))
        stiffness, soft = (np.full(self.states, np.nan) for _ in range(2))
        if self.motion is not SuspensionMotion.STEERING:
            load, travel = measured["spring_load"], measured["travel"]
            for column in (0, 1):
                rate[:, column] = slopes(load[:, column], travel[:, column], done)
                free[:, column] = slopes(bare[:, column], travel[:, column], done)
        if self.motion is SuspensionMotion.OPPOSITE:
            angle = np.arctan2(travel[:, 0] - travel[:, 1], track)
            stiffness = slopes(0.5 * track * (load[:, 0] - load[:, 1]), angle, done)
            soft = slopes(0.5 * track * (bare[:, 0] - bare[:, 1]), angle, done)
        return {
            "wheel_rate": rate, "free_wheel_rate": free, "roll_stiffness": stiffness, "free_roll_stiffness": soft,
        }  # fmt: skip


def _loads_of(work: Array) -> Array:
    """(n, 2) vertical forces on the left and the right wheel of (n, 2) work per travel alike and opposite [N]."""
    return 0.5 * np.stack([work[:, 0] + work[:, 1], work[:, 0] - work[:, 1]], axis=1)


def _changes(values: Array) -> Array:
    """(n, 2) rates of (n, 5) over the travel of both wheels alike, and over the opposite one."""
    return np.stack([values[:, UP] - values[:, DOWN], values[:, LEFT] - values[:, RIGHT]], axis=1) / (2.0 * NEAR)
