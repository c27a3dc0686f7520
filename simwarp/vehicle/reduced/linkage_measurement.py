"""What the tables of a reduced vehicle hold, measured on the closed linkage of an axle.

Every place of a table is a world, with a neighbour a millimetre of travel above and one below: rates over the travel
are differences between these.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from simwarp.core.rotation import matrix_of, rotate
from simwarp.vehicle.spec.parts import Array, RigidPart, SpecError, Vec3
from simwarp.vehicle.spec.tabulated_suspension import WheelTable
from simwarp.vehicle.spec.vehicle_spec import ForceLine, MacPhersonStrut, RigidSuspension, VehicleSpec
from simwarp.vehicle.suspensions.corner import extended, spring_force, table
from simwarp.vehicle.suspensions.kinematics import HeldAxle, hold_axle

NEAR: Final = 1.0e-3
"""Travel to either side between which rates are measured [m]."""
DIGITS: Final = 7
"""Of the numbers in tables: those of single precision."""


class LinkageMeasurement:
    """An axle at all places of its tables.

    Args:
        spec: the full vehicle.
        axle: index, from the front.
        travels: (n,) of both wheels' centres upwards, from as built [m].
        steering: (k,) from -1 to 1.
        device: that closes the linkages.

    Attributes:
        reached: (n,) whether the linkage closes at all steerings of a travel.
    """

    def __init__(self, spec: VehicleSpec, axle: int, travels: Array, steering: Array, device: str) -> None:
        self.part, self.fixed = spec.axles[axle], isinstance(spec.axles[axle].suspension, RigidSuspension)
        self.shape = (len(travels), len(steering), 1 if self.fixed else 3)
        shifts = np.zeros(1) if self.fixed else np.array([0.0, NEAR, -NEAR])
        heights = np.broadcast_to(travels[:, None, None] + shifts, self.shape).ravel()
        inputs = np.broadcast_to(steering[:, None], self.shape).ravel()
        self.held: HeldAxle = hold_axle(spec, axle, heights, heights, inputs, device=device)
        self.reached = self.held.reached.reshape(self.shape).all(axis=(1, 2))
        self._x = np.asarray(self.held.simulation.state.body_x.numpy(), np.float64)
        rotations = np.asarray(self.held.simulation.state.body_rot.numpy(), np.float64)
        self._turn = np.array([[matrix_of(q) for q in row] for row in rotations])
        self.bodies = self.held.simulation.model.builder.bodies

    def centers(self, side: int) -> Array:
        """(n, k, 3, 3) of a wheel."""
        return self._of(self._x[:, self.held.bench.sides[side].spindle])

    def axes(self, side: int) -> Array:
        """(n, k, 3, 3) of a wheel, to the left."""
        return self._of(self._turn[:, self.held.bench.sides[side].spindle, :, 1])

    def _of(self, values: Array) -> Array:
        return np.asarray(values.reshape(*self.shape, *values.shape[1:]))

    def slope(self, values: Array) -> Array:
        """Rate over the travel of (n, k, 3, ...) values."""
        if self.fixed:
            return np.zeros_like(values[:, :, 0])
        return np.asarray((values[:, :, 1] - values[:, :, 2]) / (2.0 * NEAR))

    def turning(self, body: int) -> Array:
        """(n, k, 3) turn of a body per travel [rad/m]."""
        turn = self._of(self._turn[:, body])
        if self.fixed:
            return np.zeros((*self.shape[:2], 3))
        change = turn[:, :, 1] @ turn[:, :, 2].swapaxes(-1, -2)
        skew = 0.5 * (change - change.swapaxes(-1, -2))
        return np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1) / (2.0 * NEAR)

    def place(self, body: int, point: Array) -> Array:
        """(n, k, 3, 3) places of a point that moves with a body; given as built [m]."""
        rest = self.bodies[body].pose
        local = rotate(rest.rotation * np.array([-1.0, -1.0, -1.0, 1.0]), point - rest.position)
        return self._of(self._x[:, body] + self._turn[:, body] @ local)

    def lines(self, side: int) -> list[tuple[ForceLine, Array, Array]]:
        """Springs and dampers of a side with their lengths (n, k) [m] and the rates of these over the travel."""
        springs: tuple[ForceLine, ...] = getattr(self.part.suspension, "springs", ())
        wheel = self.held.bench.sides[side]
        body = wheel.carrier if isinstance(self.part.suspension, MacPhersonStrut) else wheel.bar
        found = []
        for line in springs:
            end = self.place(body, self._built(side, line.arm_point))
            length = np.linalg.norm(end - self._built(side, line.chassis_point), axis=-1)
            found.append((line, length[:, :, 0], self.slope(length)))
        return found

    def _built(self, side: int, point: Vec3) -> Array:
        mirror = (1.0, self.held.bench.sides[side].side, 1.0)
        return np.asarray(self.part.location) + np.asarray(point) * mirror

    def bar_twist(self, side: int, standing: int) -> Array:
        """(n,) twist of the anti-roll bar by the travel of one wheel, from the standing state on [rad].

        Both wheels of the bench travel alike, so that the bar does not twist there: the turn of this side's arm counts.
        """
        bench = self.held.bench
        if bench.bar is None:
            return np.zeros(self.shape[0])
        joint = self.held.simulation.model.builder.joints[bench.bar]
        arm = joint.parent if side == 0 else joint.child
        turn = self._of(self._turn[:, arm])[:, self.shape[1] // 2, 0]
        relative = turn @ turn[standing].T
        return np.asarray(-np.arctan2(relative[:, 0, 2], relative[:, 0, 0]))

    def masses(self, side: int, row: int) -> dict[str, Any]:
        """Inertia of a wheel with its links at one travel, straight ahead, without its tire."""
        wheel, tire, column = self.held.bench.sides[side], self.part.tire, self.shape[1] // 2
        spin = float(self.bodies[wheel.spindle].inertia[1, 1]) - tire.inertia[1]
        if self.fixed:
            return {"mass": 1.0, "momentum": (0.0,) * 3, "moment": (0.0,) * 3, "spin_inertia": spin}
        names = (f"{wheel.name}.", "antiroll_bar." + ("left" if side == 0 else "right"))
        axis = self.axes(side)[row, column, 0]
        mass, momentum, moment = 0.0, np.zeros(3), np.zeros(3)
        for index, body in enumerate(self.bodies):
            if not body.name.startswith(names):
                continue
            places = self._of(self._x[:, index])[row, column]
            rate = (places[1] - places[2]) / (2.0 * NEAR)
            around = self.turning(wheel.carrier if index == wheel.spindle else index)[row, column]
            kilograms, inertia = body.mass, self._inertia(index, row)
            if index == wheel.spindle:
                around = around - (around @ axis) * axis
                kilograms, inertia = kilograms - tire.mass, inertia - self._tire_inertia(index, row)
            mass += kilograms * rate @ rate + around @ inertia @ around
            momentum += kilograms * rate
            moment += np.cross(places[0], kilograms * rate) + inertia @ around
        return {
            "mass": rounded(mass), "momentum": tuple(map(rounded, momentum)), "moment": tuple(map(rounded, moment)),
            "spin_inertia": spin,
        }  # fmt: skip

    def _inertia(self, body: int, row: int) -> Array:
        turn = self._of(self._turn[:, body])[row, self.shape[1] // 2, 0]
        return np.asarray(turn @ self.bodies[body].inertia @ turn.T)

    def _tire_inertia(self, body: int, row: int) -> Array:
        turn = self._of(self._turn[:, body])[row, self.shape[1] // 2, 0]
        return np.asarray(turn @ np.diag(self.part.tire.inertia) @ turn.T)

    def rigid_parts(self, row: int) -> list[RigidPart]:
        """All bodies of the bench at one travel, straight ahead; without tires, and what turns with the wheels."""
        column, found = self.shape[1] // 2, []
        spindles = {side.spindle: number for number, side in enumerate(self.held.bench.sides)}
        for index, body in enumerate(self.bodies):
            inertia, mass = self._inertia(index, row), body.mass
            if index in spindles:
                axis = self.axes(spindles[index])[row, column, 0]
                inertia = inertia - self._tire_inertia(index, row)
                # what turns with the wheel is none of the chassis'; a trace keeps it the inertia of a body
                inertia = inertia - (1.0 - THIN) * (axis @ inertia @ axis) * np.outer(axis, axis)
                mass -= self.part.tire.mass
            x = self._of(self._x[:, index])[row, column, 0]
            found.append(rigid_part(mass, x, inertia))
        return found

    def wheel_table(self, side: int, standing: int, rates: Array) -> WheelTable:
        """Everything of one wheel; `standing`: row at which masses are measured.

        Raises:
            SpecError: a place is not reached.
        """
        if not self.reached.all():
            raise SpecError("travel: must be reached by the linkage at all steerings")
        wheel = self.held.bench.sides[side]
        center, axis = self.centers(side)[:, :, 0], self.axes(side)[:, :, 0]
        windup = np.einsum("nki,nki->nk", self.turning(wheel.carrier), axis)
        load, damping = np.zeros(self.shape[:2]), np.zeros((self.shape[0], len(rates)))
        for line, length, change in self.lines(side):
            load -= spring_force(line, length) * change
            middle = self.shape[1] // 2
            ratio = change[:, middle : middle + 1]
            damping += damper_force(line, length[:, middle : middle + 1], ratio * rates) * ratio
        return WheelTable(
            height=float(self.held.rest[0, side, 2]), ahead=grid(center[..., 0]), aside=grid(center[..., 1]),
            axis_x=grid(axis[..., 0]), axis_z=grid(axis[..., 2]), windup=grid(windup), spring_load=grid(load),
            damper_load=grid(damping), bar_twist=grid(self.bar_twist(side, standing)[None])[0],
            **self.masses(side, standing),
        )  # fmt: skip


THIN: Final = 1.0e-3
"""Share of a wheel's inertia about its axis that stays with the chassis: that of a body is never zero."""


def rigid_part(mass: float, com: Array, inertia: Array) -> RigidPart:
    """A part of the chassis."""
    x, y, z = (float(value) for value in com)
    a, b, c = (float(value) for value in np.diag(inertia))
    return RigidPart(
        mass=mass, com=(x, y, z), inertia=(a, b, c),
        products=(float(inertia[0, 1]), float(inertia[0, 2]), float(inertia[1, 2])),
    )  # fmt: skip


def damper_force(line: ForceLine, length: Array, rate: Array) -> Array:
    """Force of a damper against the rates of its length [N]."""
    if line.damper_map is not None:
        lengths, rates, forces = (np.array(values) for values in line.damper_map)
        length, rate = np.broadcast_arrays(length, rate)
        rows = np.stack([np.interp(length, lengths, row) for row in forces])
        below = np.clip(np.searchsorted(rates, rate) - 1, 0, len(rates) - 2)
        share = np.clip((rate - rates[below]) / (rates[below + 1] - rates[below]), 0.0, 1.0)
        low, high = (np.take_along_axis(rows, index[None], 0)[0] for index in (below, below + 1))
        return np.asarray(low + share * (high - low))
    if line.damper_curve is not None:
        x, y = (np.array(values) for values in table(line.damper_curve))
        return extended(rate, x, y)
    return np.asarray(line.damping * rate)


def rounded(value: float) -> float:
    """A number with the digits that a table keeps."""
    return float(f"{value:.{DIGITS}g}")


def grid(values: Array) -> tuple[tuple[float, ...], ...]:
    """Rows of numbers with the digits of single precision."""
    return tuple(tuple(rounded(value) for value in row) for row in values.tolist())
