"""Trailers in NumPy: angles and radii of trains that roll without slip, the tractrix, the linear single-track model.

Turns without slip: every axle moves along its own heading, so that the turn's centre lies on the lines of all axles.
Axles of a bogie cannot all do so. With tires of equal cornering stiffness their side forces cancel in moment about the
hitch for one axle at the distance L (1 + s²) behind it, s² the mean square of the axles' distances from their middle
over L² (Winkler, "Simplified analysis of the steady-state turning of complex vehicles", Vehicle System Dynamics 29,
1998).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def equivalent_wheelbase(distances: npt.ArrayLike) -> float:
    """Of axles at distances behind a hitch [m]: that of the one axle on which they roll alike."""
    away = np.asarray(distances, float)
    return float((away @ away) / away.sum())


def trailer_radius(towing_radius: float, hitch_behind: float, wheelbase: float) -> float:
    """Radius on which a trailer's axle rolls [m], of an axle in front that rolls on a radius and has the hitch behind
    it (negative: ahead of it).
    """
    return math.sqrt(towing_radius**2 + hitch_behind**2 - wheelbase**2)


def articulation(towing_radius: float, hitch_behind: float, wheelbase: float) -> float:
    """Angle between both units in that turn [rad]."""
    hitch_radius = math.hypot(towing_radius, hitch_behind)
    return math.asin(wheelbase / hitch_radius) + math.atan(hitch_behind / towing_radius)


def tractrix(times: Array, path: Array, heading: float, wheelbase: float) -> Array:
    """(n,) headings of a trailer whose hitch goes along a path (n, 2) from a heading on, by the rule that its axle
    does not slip: heading' = (hitch's velocity across the trailer) / wheelbase. Runge-Kutta of the fourth order.
    """
    found = [heading]
    for k in range(len(times) - 1):
        step = times[k + 1] - times[k]
        x, y = (path[k + 1] - path[k]) / step

        def rate(angle: float, x: float = x, y: float = y) -> float:
            return float(-x * math.sin(angle) + y * math.cos(angle)) / wheelbase

        a = rate(found[-1])
        b = rate(found[-1] + 0.5 * step * a)
        c = rate(found[-1] + 0.5 * step * b)
        d = rate(found[-1] + step * c)
        found.append(found[-1] + step / 6.0 * (a + 2.0 * b + 2.0 * c + d))
    return np.array(found)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SingleTrack:
    """A car with a trailer on the level, both flat; lengths from the centre of mass of each [m].

    Cornering stiffnesses are those of whole axles [N/rad]; trails are how far behind its axle's middle a side force
    acts [m].
    """

    mass: float
    inertia: float
    front: float
    """From the centre of mass forwards to the front axle."""
    rear: float
    """From the centre of mass backwards to the rear axle."""
    hitch: float
    """From the centre of mass backwards."""
    trailer_mass: float
    trailer_inertia: float
    trailer_com: float
    """From the hitch backwards."""
    trailer_axle: float
    """From the hitch backwards."""
    stiffness: tuple[float, float, float]
    """Front, rear, trailer."""
    trail: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def matrix(self, speed: float) -> Array:
        """(4, 4) of d/dt (side speed, yaw rate, articulation rate, articulation) at a speed [m/s].

        By virtual work in the coordinates y, yaw and articulation, the trailer's heading being their sum.
        """
        ways = np.array([
            [1.0, self.front - self.trail[0], 0.0], [1.0, -self.rear - self.trail[1], 0.0],
            [1.0, -self.hitch - self.trailer_axle - self.trail[2], -self.trailer_axle - self.trail[2]],
        ])  # fmt: skip
        # where a wheel drifts: at its middle
        drifts = np.array([
            [1.0, self.front, 0.0], [1.0, -self.rear, 0.0], [1.0, -self.hitch - self.trailer_axle, -self.trailer_axle]
        ])  # fmt: skip
        center = np.array([1.0, -self.hitch - self.trailer_com, -self.trailer_com])
        turned = np.array([0.0, 1.0, 1.0])
        masses = np.diag([self.mass, self.inertia, 0.0])
        masses += self.trailer_mass * np.outer(center, center) + self.trailer_inertia * np.outer(turned, turned)
        stiff = np.diag(self.stiffness)
        rates = -ways.T @ stiff @ drifts / speed
        # the whole accelerates by speed · yaw rate where it turns
        rates[:, 1] -= speed * np.array([self.mass, 0.0, 0.0]) + speed * self.trailer_mass * center
        # the trailer's axle drifts by the articulation too
        angles = ways.T @ stiff @ np.array([0.0, 0.0, 1.0])
        found = np.zeros((4, 4))
        found[:3, :3] = np.linalg.solve(masses, rates)
        found[:3, 3] = np.linalg.solve(masses, angles)
        found[3, 2] = 1.0
        return found

    def swaying(self, speed: float) -> complex:
        """The eigenvalue of the sway at a speed [1/s]: the least damped of those that swing."""
        values = np.linalg.eigvals(self.matrix(speed))
        swinging = values[values.imag > 1e-6]
        return complex(swinging[np.argmax(swinging.real)])

    def critical_speed(self, low: float = 5.0, high: float = 80.0) -> float:
        """At which the sway is no longer damped [m/s]; bisection."""
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.swaying(middle).real < 0.0 else (low, middle)
        return 0.5 * (low + high)
