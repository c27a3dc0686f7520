"""Kinematics of an axle on its bench: angles, axes and levers of its wheels over travel and steering, and what its
springs make of them. Every point of a sweep is a world; so are the neighbours between which rates are measured.

Wheels are those of the axle, columns left and right. Travel is that of the wheels' centres upwards from the state in
which the vehicle stands on level ground, or from the state as built. Angles follow the usual signs of a bench: toe is
positive inwards, camber where the top leans outwards, caster where the steering axis leans back, its inclination where
it leans inwards.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import Names, Readable, Row, plural
from simwarp.core.rotation import matrix_of, rotate
from simwarp.vehicle.rigs.kingpins import kingpin_axis
from simwarp.vehicle.rigs.rig_rows import Progress, RigRows, RowStatus, Statuses, joined_rows
from simwarp.vehicle.rigs.standing_loads import GRAVITY, StandingLoads, standing_loads
from simwarp.vehicle.spec.parts import Array, SpecError, Vec3
from simwarp.vehicle.spec.vehicle_spec import (
    Axle,
    ForceLine,
    MacPhersonStrut,
    PinnedAxle,
    RigidSuspension,
    VehicleSpec,
)
from simwarp.vehicle.suspensions.corner import extended, spring_table
from simwarp.vehicle.suspensions.kinematics import HeldAxle, hold_axle

NEAR: Final = 1.0e-3
"""Travel to either side of a state between which its rates are measured [m]."""
TRAVEL: Final = 0.17
"""Usual travel, as a share of the tire's radius."""
SEARCH: Final = 0.35
"""Travel in which the standing state is looked for, as a share of the tire's radius."""
SEARCH_POINTS: Final = 29
Flags = npt.NDArray[np.bool_]


class SuspensionReference(enum.Enum):
    """State from which travel counts, and of which parameters are told."""

    STANDING = "standing"
    """The vehicle stands on level ground; as BUILT for an axle without springs of its own."""
    BUILT = "built"
    """As the description of the vehicle has it."""


class SuspensionMotion(enum.Enum):
    """What a bench does with an axle."""

    PARALLEL = "parallel"
    """Both wheels travel alike."""
    OPPOSITE = "opposite"
    """The right wheel goes down as the left one goes up."""
    STEERING = "steering"
    """The steering goes from lock to lock in the state of reference."""


@dataclasses.dataclass(frozen=True, repr=False)
class SuspensionCurve(Readable):
    """An axle over one motion of the bench; n states, columns left and right. NaN where a state is not DONE.

    Attributes:
        motion: of the bench.
        travel: (n, 2) of the wheels' centres upwards from the state of reference [m].
        steering: (n,) ratio of the steering's travel, -1 to 1, positive to the left.
        steer: (n, 2) heading of the wheels, positive to the left [rad].
        toe: (n, 2) positive inwards [rad].
        camber: (n, 2) positive where the top leans outwards [rad].
        track_change: (n,) of the distance of the contact points across, from the state of reference [m].
        wheelbase_change: (n, 2) of the contact points forwards, likewise [m].
        caster: (n, 2) of the steering axis, positive where its top leans back [rad].
        kingpin_inclination: (n, 2) positive where its top leans inwards [rad].
        scrub_radius: (n, 2) from the steering axis out to the contact point, on the ground [m].
        trail: (n, 2) from the contact point forwards to the steering axis, on the ground [m].
        roll_centre: (n, 2) of both contact points' normals in front view: y to the left, height above the ground [m].
        anti_dive: (n, 2) share of the load transfer in braking that the linkage bears: anti-dive of a front axle,
            anti-lift of a rear one.
        anti_squat: (n, 2) the same in driving, all of the force on this axle.
        motion_ratio: (n, 2, lines) ratio of the springs' and dampers' compression to the travel, in parallel travel.
        spring_load: (n, 2) vertical force on a wheel that holds springs and anti-roll bar there [N].
        wheel_load: (n, 2) the same with the weight of wheel and links [N].
        wheel_rate: (n, 2) rise of the springs' load over the travel in this motion [N/m]; NaN when steering.
        roll_stiffness: (n,) of springs and anti-roll bar about the roll angle of the axle [N·m/rad]; NaN but in the
            opposite motion.
        status: (n,) `RowStatus`.
    """

    motion: SuspensionMotion
    travel: Array
    steering: Array
    steer: Array
    toe: Array
    camber: Array
    track_change: Array
    wheelbase_change: Array
    caster: Array
    kingpin_inclination: Array
    scrub_radius: Array
    trail: Array
    roll_centre: Array
    anti_dive: Array
    anti_squat: Array
    motion_ratio: Array
    spring_load: Array
    wheel_load: Array
    wheel_rate: Array
    roll_stiffness: Array
    status: Statuses

    def _readable_title(self) -> str:
        return f": {self.motion.value}, {plural(len(self.status), 'state')}"

    def rows(self) -> RigRows:
        """States as rows; angles in degrees, lengths of the linkage in mm."""
        columns: dict[str, npt.NDArray[Any]] = {
            "motion": np.full(len(self.status), self.motion.value), "steering": self.steering,
        }  # fmt: skip
        for column, side in enumerate("LR"):
            columns |= {
                f"travel_{side}_mm": 1e3 * self.travel[:, column],
                f"steer_{side}_deg": np.rad2deg(self.steer[:, column]),
                f"toe_{side}_deg": np.rad2deg(self.toe[:, column]),
                f"camber_{side}_deg": np.rad2deg(self.camber[:, column]),
                f"caster_{side}_deg": np.rad2deg(self.caster[:, column]),
                f"kingpin_inclination_{side}_deg": np.rad2deg(self.kingpin_inclination[:, column]),
                f"scrub_radius_{side}_mm": 1e3 * self.scrub_radius[:, column],
                f"trail_{side}_mm": 1e3 * self.trail[:, column],
                f"wheelbase_change_{side}_mm": 1e3 * self.wheelbase_change[:, column],
                f"anti_dive_{side}_percent": 1e2 * self.anti_dive[:, column],
                f"anti_squat_{side}_percent": 1e2 * self.anti_squat[:, column],
                f"spring_load_{side}_N": self.spring_load[:, column],
                f"wheel_load_{side}_N": self.wheel_load[:, column],
                f"wheel_rate_{side}_N_per_mm": 1e-3 * self.wheel_rate[:, column],
            }
            for line in range(self.motion_ratio.shape[2]):
                columns[f"motion_ratio{line}_{side}"] = self.motion_ratio[:, column, line]
        columns |= {
            "track_change_mm": 1e3 * self.track_change, "roll_centre_y_mm": 1e3 * self.roll_centre[:, 0],
            "roll_centre_height_mm": 1e3 * self.roll_centre[:, 1],
            "roll_stiffness_Nm_per_deg": self.roll_stiffness * math.pi / 180.0,
        }  # fmt: skip
        return RigRows(columns, self.status)


@dataclasses.dataclass(frozen=True, repr=False)
class SuspensionRun(Readable):
    """What a bench measured of an axle.

    Attributes:
        axle: its index, from the front.
        curves: by motion; an axle that is not steered has none of the steering, a pinned one none in parallel.
        loads: masses and wheel loads of the vehicle.
        reference_travel: of the wheels' centres from the state as built to that of reference [m].
        interrupted: True where a motion is missing because the run was interrupted.
    """

    axle: int
    curves: Mapping[SuspensionMotion, SuspensionCurve]
    loads: StandingLoads
    reference_travel: float
    interrupted: bool = False

    def _readable_title(self) -> str:
        return f" of axle {self.axle}"

    def _readable_rows(self) -> Mapping[str, Row]:
        return {"motions": Names(len(self.curves), (motion.value for motion in self.curves))}

    def rows(self) -> RigRows:
        """States of all motions as rows."""
        return joined_rows([curve.rows() for curve in self.curves.values()])

    def parameters(self) -> dict[str, float]:
        """Values of the left wheel in the state of reference, and their changes with the travel; units in the keys."""
        return _parameters(self)


def run_suspension_rig(
    spec: VehicleSpec, axle: int = 0, *, travel: float | None = None, points: int = 41,
    reference: SuspensionReference = SuspensionReference.STANDING, loaded_radius: float | None = None,
    device: str = "cpu", progress: Progress | None = None,
) -> SuspensionRun:  # fmt: skip
    """Kinematics of an axle in parallel and opposite travel and over the steering, each motion a batch of worlds.

    An interruption leaves the motions that are done.

    Args:
        spec: the vehicle.
        axle: index, from the front.
        travel: largest travel up and down [m]; None: 17 % of the tire's radius.
        points: of a motion, an odd number: the middle one is the state of reference.
        reference: state from which travel counts.
        loaded_radius: of the tires, from the wheels' centres down to the ground [m]; None: the one under the standing
            vehicle.
        device: that closes the linkages.
        progress: is called with the share that is done.

    Raises:
        SpecError: no such axle, or one without springs; an empty range.
    """
    part = checked_axle(spec, axle)
    reach = TRAVEL * part.tire.radius if travel is None else travel
    if not (math.isfinite(reach) and reach > 0.0):
        raise SpecError(f"travel: must be > 0 m, got {reach:g}: the range would be empty")
    if points < 3 or points % 2 == 0:
        raise SpecError(f"points: must be an odd number from 3 on, got {points}: the middle one is the reference")
    state = reference_state(spec, axle, reference, loaded_radius=loaded_radius, device=device)
    motions = [SuspensionMotion.OPPOSITE]
    if not isinstance(part.suspension, PinnedAxle):
        motions.insert(0, SuspensionMotion.PARALLEL)
    if part.steering is not None:
        motions.append(SuspensionMotion.STEERING)
    bench_of = _BenchMaker(spec, axle, state.loaded_radius, state.loads, device)
    curves: dict[SuspensionMotion, SuspensionCurve] = {}
    interrupted = False
    try:
        for number, motion in enumerate(motions):
            bench = bench_of(motion, state.travel + np.linspace(-reach, reach, points))
            curves[motion] = bench.curve()
            if progress is not None:
                progress((number + 1) / len(motions))
    except KeyboardInterrupt:
        if not curves:
            raise
        interrupted = True
    return SuspensionRun(axle, curves, state.loads, state.travel, interrupted)


@dataclasses.dataclass(frozen=True)
class ReferenceState:
    """A state from which travel counts.

    Attributes:
        travel: of the wheels' centres from the state as built [m].
        loaded_radius: of the axle's tires [m].
        loads: of the standing vehicle.
    """

    travel: float
    loaded_radius: float
    loads: StandingLoads


def reference_state(
    spec: VehicleSpec, axle: int, reference: SuspensionReference, *, loaded_radius: float | None = None,
    device: str = "cpu",
) -> ReferenceState:  # fmt: skip
    """The state of reference of an axle that travels.

    Args:
        spec: the vehicle.
        axle: index, from the front.
        reference: which state is meant.
        loaded_radius: of its tires [m]; None: the one under the standing vehicle.
        device: that closes the linkages.

    Raises:
        SpecError: no such axle, or one without springs.
    """
    part = checked_axle(spec, axle)
    if isinstance(part.suspension, RigidSuspension):
        raise SpecError(
            f"axle {axle}: must have a suspension that travels, got '{part.suspension.template}'; take another axle"
        )
    loads = standing_loads(spec, device=device)
    radius = float(loads.loaded_radius[axle]) if loaded_radius is None else loaded_radius
    standing = reference is SuspensionReference.STANDING and bool(getattr(part.suspension, "springs", ()))
    travel = _standing_travel(_BenchMaker(spec, axle, radius, loads, device)) if standing else 0.0
    return ReferenceState(travel, radius, loads)


def _standing_travel(bench_of: _BenchMaker) -> float:
    """Travel from the state as built at which the wheels bear the standing vehicle [m].

    Raises:
        SpecError: the springs bear it nowhere near.
    """
    loads, axle = bench_of.loads, bench_of.axle
    reach, middle = SEARCH * bench_of.spec.axles[axle].tire.radius, 0.0
    for _ in range(2):  # in a wide range, and between two of its points
        curve = bench_of(SuspensionMotion.PARALLEL, middle + np.linspace(-reach, reach, SEARCH_POINTS)).curve()
        travel = middle + np.linspace(-reach, reach, SEARCH_POINTS)
        missing = curve.wheel_load.mean(axis=1) - loads.wheel_load[axle]
        done = np.flatnonzero(np.isfinite(missing))
        across = [k for k in done[:-1] if np.isfinite(missing[k + 1]) and missing[k] <= 0.0 < missing[k + 1]]
        if not across:
            raise SpecError(
                f"axle {axle}: its springs must bear {loads.wheel_load[axle]:.4g} N per wheel within {reach:.3g} m of "
                "the state as built, and do not; count travel from the state as built"
            )
        low = across[0]
        middle = float(travel[low] - missing[low] * (travel[low + 1] - travel[low]) / (missing[low + 1] - missing[low]))
        reach = float(travel[1] - travel[0])
    return middle


def checked_axle(spec: VehicleSpec, axle: int) -> Axle:
    """The axle of an index.

    Raises:
        SpecError: there is none.
    """
    if not 0 <= axle < len(spec.axles):
        raise SpecError(f"axle: must be from 0 (front) to {len(spec.axles) - 1} of '{spec.name}', got {axle}")
    return spec.axles[axle]


BASE, UP, DOWN, LEFT, RIGHT = range(5)
"""States beside each other: itself, both wheels up and down, the left one up with the right one down and vice versa."""
SHIFTS: Final = np.array([[0.0, 0.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]]) * NEAR


@dataclasses.dataclass(frozen=True)
class _BenchMaker:
    """Benches of an axle."""

    spec: VehicleSpec
    axle: int
    radius: float
    loads: StandingLoads
    device: str

    def __call__(self, motion: SuspensionMotion, travels: Array) -> _Bench:
        """A bench that goes through (n,) travels from the state as built [m]; at the middle one when steering."""
        return _Bench(self, motion, travels)


class _Bench:
    """The worlds of one motion: n states and their neighbours.

    Attributes:
        held: the linkages, closed.
        states: n.
    """

    def __init__(self, of: _BenchMaker, motion: SuspensionMotion, travels: Array) -> None:
        self.part, self.motion, self.radius = of.spec.axles[of.axle], motion, of.radius
        self.axle, self.loads, self.states = of.axle, of.loads, len(travels)
        self.middle = len(travels) // 2
        self.reference = float(travels[self.middle])
        right = travels if motion is SuspensionMotion.PARALLEL else 2.0 * self.reference - travels
        heights, self.steering = np.stack([travels, right], axis=1), np.zeros(self.states)
        if motion is SuspensionMotion.STEERING:
            heights, self.steering = np.full((self.states, 2), self.reference), np.linspace(-1.0, 1.0, self.states)
        self.pinned = isinstance(self.part.suspension, PinnedAxle)
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
        steer = np.arctan2(-axes[:, BASE, :, 0], axes[:, BASE, :, 1])
        angles = [self._kingpin(k, base[:, k], axes[:, BASE, k]) for k in (0, 1)]
        caster, inclination, scrub, trail = (np.stack([a[m] for a in angles], axis=1) for m in range(4))
        dive, squat = self._anti(contacts, centers)
        ratios, work = self._springs()
        spring_load, load = _loads_of(work), _loads_of(work + self._weights())
        usual = base[self.middle]
        measured: dict[str, Array] = {
            "travel": (centers[:, BASE] - self.held.rest[0])[..., 2] - self.reference, "steer": steer,
            "toe": -self.signs * steer,
            "camber": -self.signs * np.arcsin(axes[:, BASE, :, 2]),
            "track_change": (base[:, 0, 1] - base[:, 1, 1]) - (usual[0, 1] - usual[1, 1]),
            "wheelbase_change": base[..., 0] - usual[:, 0], "caster": caster, "kingpin_inclination": inclination,
            "scrub_radius": scrub, "trail": trail, "roll_centre": self._roll_centre(contacts), "anti_dive": dive,
            "anti_squat": squat, "motion_ratio": ratios, "spring_load": spring_load, "wheel_load": load,
        }  # fmt: skip
        measured |= self._rates(measured, float(usual[0, 1] - usual[1, 1]))
        status = np.where(self.reached.all(axis=1), RowStatus.DONE, RowStatus.DIVERGED).astype(np.int8)
        for values in measured.values():
            values[status != RowStatus.DONE] = np.nan
        return SuspensionCurve(motion=self.motion, steering=self.steering, status=status, **measured)

    def _wheel_axis(self, side: int) -> Array:
        """(n, 5, 3) axis of a wheel, to the left."""
        return self.turned(self.held.bench.sides[side].spindle, np.array([0.0, 1.0, 0.0]))

    def _below(self, center: Array, axis: Array) -> Array:
        """(n, 3) points where wheels with such centres and axes touch the ground."""
        up = np.array([0.0, 0.0, 1.0]) - axis[:, 2:] * axis
        return center - self.radius * up / np.linalg.norm(up, axis=1, keepdims=True)

    def _contact(self, side: int, center: Array, axis: Array) -> Array:
        """(n, 5, 3) the contact point of each state, which in its neighbours moves with the wheel's carrier: as that
        of a wheel whose brake is locked.
        """
        carrier = self.held.bench.sides[side].carrier
        places = self._x[:, carrier].reshape(self.states, -1, 3)
        turns = np.array([matrix_of(q) for q in self._q[:, carrier]]).reshape(self.states, -1, 3, 3)
        local = np.einsum("nji,nj->ni", turns[:, BASE], self._below(center, axis) - places[:, BASE])
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
        front = 1.0 if self.loads.axle_x[self.axle] > self.loads.axle_x.mean() else -1.0
        dive = front * self.loads.brake_share[self.axle] * lever * locked[..., 0] / locked[..., 2]
        squat = front * lever * free[..., 0] / free[..., 2]
        return dive, squat

    def _springs(self) -> tuple[Array, Array]:
        """Motion ratios (n, 2, lines), and (n, 2) the work of springs and bar per travel of both wheels alike, and per
        opposite travel [N].
        """
        lines: tuple[ForceLine, ...] = getattr(self.part.suspension, "springs", ())
        work = np.zeros((self.states, 2))
        ratios = np.zeros((self.states, 2, len(lines)))
        for column, side in enumerate(self.held.bench.sides):
            body = side.carrier if isinstance(self.part.suspension, MacPhersonStrut) else side.bar
            for number, line in enumerate(lines):
                end = self.place(body, self.point(column, line.arm_point))
                length = np.linalg.norm(end - self.point(column, line.chassis_point), axis=2)
                built = float(np.linalg.norm(np.subtract(line.chassis_point, line.arm_point)))
                push = pushing_force(line, length[:, BASE], built)
                change = _changes(length)
                work -= push[:, None] * change
                ratios[:, column, number] = -change[:, 0]
        bar = self.held.bench.bar
        if bar is not None and self.part.antiroll_bar is not None:
            model = self.held.simulation.model
            twist = self.held.simulation.state.joint_x.numpy()[:, model.joint_dof_start[bar]]
            twist = twist.astype(np.float64).reshape(self.states, -1)
            work += (self.part.antiroll_bar.stiffness * twist[:, BASE])[:, None] * _changes(twist)
        return ratios, work

    def _weights(self) -> Array:
        """(n, 2) work against the weight of all parts, likewise [N]."""
        heights = np.asarray(self._x[..., 2] @ self._weight).reshape(self.states, -1)
        return _changes(heights)

    def _rates(self, measured: Mapping[str, Array], track: float) -> dict[str, Array]:
        """Wheel rate and roll stiffness: slopes along the motion."""
        rate, stiffness = np.full((self.states, 2), np.nan), np.full(self.states, np.nan)
        if self.motion is not SuspensionMotion.STEERING:
            load, travel = measured["spring_load"], measured["travel"]
            for column in (0, 1):
                rate[:, column] = np.gradient(load[:, column], travel[:, column], edge_order=2)
        if self.motion is SuspensionMotion.OPPOSITE:
            angle = np.arctan2(travel[:, 0] - travel[:, 1], track)
            stiffness = np.gradient(0.5 * track * (load[:, 0] - load[:, 1]), angle, edge_order=2)
        return {"wheel_rate": rate, "roll_stiffness": stiffness}


def _loads_of(work: Array) -> Array:
    """(n, 2) vertical forces on the left and the right wheel of (n, 2) work per travel alike and opposite [N]."""
    return 0.5 * np.stack([work[:, 0] + work[:, 1], work[:, 0] - work[:, 1]], axis=1)


def _changes(values: Array) -> Array:
    """(n, 2) rates of (n, 5) over the travel of both wheels alike, and over the opposite one."""
    return np.stack([values[:, UP] - values[:, DOWN], values[:, LEFT] - values[:, RIGHT]], axis=1) / (2.0 * NEAR)


def pushing_force(line: ForceLine, length: Array, built: float) -> Array:
    """(...,) force with which a spring at rest pushes its ends apart [N], at lengths (...,) [m].

    Args:
        line: the spring, with its bump stops.
        length: at which it is.
        built: its length as built [m].
    """
    rest = built if line.rest_length is None else line.rest_length
    table = spring_table(line, rest)
    if table is None:
        return np.asarray(line.preload - line.stiffness * (length - rest))
    return np.asarray(line.preload - extended(length - rest, np.array(table[0]), np.array(table[1])))


def _parameters(run: SuspensionRun) -> dict[str, float]:
    found: dict[str, float] = {
        "reference_travel_mm": 1e3 * run.reference_travel, "wheel_load_N": float(run.loads.wheel_load[run.axle]),
    }  # fmt: skip
    curve = next(iter(run.curves.values()))
    middle = len(curve.status) // 2
    degrees = {
        "toe_deg": curve.toe, "camber_deg": curve.camber, "caster_deg": curve.caster,
        "kingpin_inclination_deg": curve.kingpin_inclination,
    }  # fmt: skip
    found |= {name: math.degrees(values[middle, 0]) for name, values in degrees.items()}
    found |= {
        "scrub_radius_mm": 1e3 * float(curve.scrub_radius[middle, 0]), "trail_mm": 1e3 * float(curve.trail[middle, 0]),
        "roll_centre_height_mm": 1e3 * float(curve.roll_centre[middle, 1]),
        "anti_dive_percent": 1e2 * float(curve.anti_dive[middle, 0]),
        "anti_squat_percent": 1e2 * float(curve.anti_squat[middle, 0]),
    }  # fmt: skip
    found |= {f"motion_ratio{k}": float(v) for k, v in enumerate(curve.motion_ratio[middle, 0])}
    parallel, opposite = (run.curves.get(m) for m in (SuspensionMotion.PARALLEL, SuspensionMotion.OPPOSITE))
    if parallel is not None:
        travel = parallel.travel[:, 0]
        found |= {
            "toe_gain_deg_per_m": math.degrees(np.gradient(parallel.toe[:, 0], travel)[middle]),
            "camber_gain_deg_per_m": math.degrees(np.gradient(parallel.camber[:, 0], travel)[middle]),
            "track_gain_mm_per_m": 1e3 * float(np.gradient(parallel.track_change, travel)[middle]),
            "wheel_rate_N_per_mm": 1e-3 * float(parallel.wheel_rate[middle, 0]),
        }
    if opposite is not None:
        track = float(run.loads.track[run.axle])
        roll = np.arctan2(np.subtract(*opposite.travel.T), track)
        found |= {
            "roll_stiffness_Nm_per_deg": float(opposite.roll_stiffness[middle]) * math.pi / 180.0,
            "roll_steer_deg_per_deg": float(np.gradient(opposite.steer.mean(axis=1), roll)[middle]),
            "roll_camber_deg_per_deg": float(np.gradient(opposite.camber[:, 0], roll)[middle]),
        }
    return found
