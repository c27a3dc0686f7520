"""One step of a reduced vehicle in float64 NumPy, from its description: an independent account of the same mechanics.

The ground's forces on the wheels are given. Wheels are placed by interpolation in the description's own tables, slopes
are differences of places; chassis, travels, wheels' spins and the shafts' speeds follow from one dense system each.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from simwarp.vehicle.spec.tabulated_suspension import TabulatedSuspension, WheelTable
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec

NEAR = 1.0e-7


@dataclasses.dataclass
class Motion:
    """A vehicle in axes of its chassis: velocities [m/s, rad/s], travels [m], rates [m/s], spins [rad/s], input."""

    v: np.ndarray
    omega: np.ndarray
    travel: np.ndarray
    rate: np.ndarray
    spin: np.ndarray
    steering: float = 0.0
    braking: float = 0.0


def interpolated(values: Any, rows: Any, columns: Any, row: float, column: float) -> float:
    """Bilinear, going on beyond the ends."""
    grid = np.array(values)
    if len(columns) == 1:
        return float(line(rows, grid[:, 0], row))
    return float(line(rows, [line(columns, each, column) for each in grid], row))


def line(x: Any, y: Any, at: float) -> float:
    """Piecewise linear, going on beyond the ends."""
    k = int(np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2))
    return y[k] + (y[k + 1] - y[k]) * (at - x[k]) / (x[k + 1] - x[k])


class Reference:
    """A reduced vehicle.

    Args:
        spec: its description.
        mass, inertia: of the chassis in the model.
        reference: (3,) origin of its frame from the chassis' centre of mass [m].
    """

    def __init__(self, spec: VehicleSpec, mass: float, inertia: np.ndarray, reference: np.ndarray) -> None:
        self.spec, self.mass, self.inertia, self.reference = spec, mass, inertia, np.asarray(reference, float)

    def table(self, wheel: int) -> tuple[TabulatedSuspension, WheelTable]:
        """Suspension and table of a wheel."""
        suspension = self.spec.axles[wheel // 2].suspension
        assert isinstance(suspension, TabulatedSuspension)
        return suspension, suspension.left if wheel % 2 == 0 else suspension.right

    def place(self, wheel: int, travel: float, steering: float) -> tuple[np.ndarray, np.ndarray]:
        """Centre from the chassis' centre of mass, and axis."""
        s, t = self.table(wheel)
        x, y, a, c = (
            interpolated(getattr(t, name), s.travel, s.steering, travel, steering)
            for name in ("ahead", "aside", "axis_x", "axis_z")
        )
        height = t.height + (0.0 if s.fixed else travel)
        return self.reference + np.array([x, y, height]), np.array([a, np.sqrt(1.0 - a * a - c * c), c])

    def slopes(self, wheel: int, travel: float, steering: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Way of the centre, turn across the axis, and turn of the caliper about it, per travel."""
        s, t = self.table(wheel)
        if s.fixed:
            return np.zeros(3), np.zeros(3), 0.0
        (r1, a1), (r0, a0) = (self.place(wheel, travel + d, steering) for d in (NEAR, -NEAR))
        _, axis = self.place(wheel, travel, steering)
        return (
            (r1 - r0) / (2.0 * NEAR), np.cross(axis, (a1 - a0) / (2.0 * NEAR)),
            interpolated(t.windup, s.travel, s.steering, travel, steering),
        )  # fmt: skip

    def wheel_motion(self, wheel: int, m: Motion) -> tuple[np.ndarray, np.ndarray]:
        """Velocity of a wheel's centre and its angular velocity, axes of the chassis."""
        r, axis = self.place(wheel, m.travel[wheel], m.steering)
        slope, lean, _ = self.slopes(wheel, m.travel[wheel], m.steering)
        around = m.omega + lean * m.rate[wheel]
        return (
            m.v + np.cross(m.omega, r) + slope * m.rate[wheel],
            around + axis * (m.spin[wheel] - around @ axis),
        )  # fmt: skip

    def loads(self, m: Motion) -> tuple[np.ndarray, np.ndarray]:
        """(4,) loads that hold springs, dampers and bars [N], and the dampers' slopes over the rates [N·s/m]."""
        found, slopes = np.zeros(4), np.zeros(4)
        for wheel in range(4):
            s, t = self.table(wheel)
            if s.fixed:
                continue
            z, u = m.travel[wheel], m.rate[wheel]
            spring = interpolated(t.spring_load, s.travel, s.steering, z, m.steering)
            held = float(np.clip(z, s.travel[0], s.travel[-1]))
            damper = interpolated(t.damper_load, s.travel, s.rate, held, u)
            k = int(np.clip(np.searchsorted(s.rate, u, side="right") - 1, 0, len(s.rate) - 2))
            ends = [interpolated(t.damper_load, s.travel, s.rate, held, s.rate[j]) for j in (k, k + 1)]
            slopes[wheel] = (ends[1] - ends[0]) / (s.rate[k + 1] - s.rate[k])
            found[wheel] = spring + damper
        for axle in range(2):
            s, left = self.table(2 * axle)
            if s.bar_stiffness == 0.0:
                continue
            pair = [left, s.right]
            twist = [line(s.travel, t.bar_twist, m.travel[2 * axle + k]) for k, t in enumerate(pair)]
            rise = [
                (line(s.travel, t.bar_twist, m.travel[2 * axle + k] + NEAR) - twist[k]) / NEAR
                for k, t in enumerate(pair)
            ]
            speed = rise[0] * m.rate[2 * axle] - rise[1] * m.rate[2 * axle + 1]
            torque = s.bar_stiffness * (twist[0] - twist[1]) + s.bar_damping * speed
            found[2 * axle] += torque * rise[0]
            found[2 * axle + 1] -= torque * rise[1]
        return found, slopes

    def moving(self, wheel: int) -> tuple[float, np.ndarray, np.ndarray]:
        """Mass, momentum and moment about the chassis' centre of mass per rate of a travel, tire included."""
        s, t = self.table(wheel)
        tire = self.spec.axles[wheel // 2].tire
        if s.fixed:
            return 1.0, np.zeros(3), np.zeros(3)
        # central differences over the neighbouring places of the table, as the description's masses are measured there
        step = s.travel[1] - s.travel[0]
        (r1, _), (r0, _) = (self.place(wheel, s.standing + d, 0.0) for d in (step, -step))
        slope = (r1 - r0) / (2.0 * step)
        r, _ = self.place(wheel, s.standing, 0.0)
        p = np.array(t.momentum) + tire.mass * slope
        origin = np.array(t.moment) + np.cross(r - self.reference, tire.mass * slope)
        return t.mass + tire.mass * slope @ slope, p, origin + np.cross(self.reference, p)

    def spin_inertia(self) -> np.ndarray:
        """(4,) of the wheels."""
        return np.array([self.table(k)[1].spin_inertia + self.spec.axles[k // 2].tire.inertia[1] for k in range(4)])

    def accelerations(
        self, m: Motion, force: np.ndarray, torque: np.ndarray, dt: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of a vehicle without engine and driveline, brakes open: chassis (6,) without gravity, travels and spins (4,).

        Args:
            m: motion.
            force, torque: (4, 3) of the ground on the wheels, about their centres, axes of the chassis.
            dt: step over which the dampers are implicit [s].
        """
        matrix, right = np.zeros((10, 10)), np.zeros(10)
        matrix[:3, :3], matrix[3:6, 3:6] = self.mass * np.eye(3), self.inertia
        body = self.spec.chassis
        drag = 0.5 * body.air_density * body.drag_coefficient * body.drag_area
        right[:3] = -drag * np.linalg.norm(m.v) * m.v
        spins, loads = np.zeros(4), self.loads(m)
        momentum = np.zeros(3)
        for k in range(4):
            r, axis = self.place(k, m.travel[k], m.steering)
            slope, lean, _ = self.slopes(k, m.travel[k], m.steering)
            inertia = self.spin_inertia()[k]
            spins[k] = axis @ torque[k] / inertia
            momentum += inertia * m.spin[k] * axis
            right[:3] += force[k]
            right[3:6] += np.cross(r, force[k]) + torque[k] - inertia * spins[k] * axis
            mass, p, h = self.moving(k)
            fixed = self.table(k)[0].fixed
            matrix[6 + k, :3], matrix[6 + k, 3:6] = p, h
            matrix[:3, 6 + k], matrix[3:6, 6 + k] = p, h
            matrix[6 + k, 6 + k] = mass + (0.0 if fixed else dt * max(loads[1][k], 0.0))
            right[6 + k] = 0.0 if fixed else slope @ force[k] + lean @ torque[k] - loads[0][k]
        right[3:6] -= np.cross(m.omega, momentum) + np.cross(m.omega, self.inertia @ m.omega)
        found = np.linalg.solve(matrix, right)
        return found[:6], found[6:], spins
