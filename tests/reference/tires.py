"""Tires once more: slow, float64, one wheel, written from the equations in the docstrings of kernels/tires.

Values come from a row of parameters by their names; nothing else is shared with the kernels.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy import arctan, cos, exp, hypot, sign, sin, sqrt, tan

from simwarp.vehicle.tires.parameter_vector_kernels import (
    Common,
    Fiala,
    Lugre,
    Pac02,
    Pac89,
    TireContact,
    TireModel,
    Tmeasy,
    Tmsimple,
)
from tests.reference.tire_relaxation import fine_ode, lagged, lengths_of, pac02_lengths, pac89_limit

UP = np.array([0.0, 0.0, 1.0])
Ground = Callable[[float, float], tuple[float, np.ndarray]]
"""(x, y) -> height, upward unit normal."""


def plane(normal, height=0.0) -> Ground:
    """A plane with a normal, `height` above the origin."""
    n = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    return lambda x, y: (height - (n[0] * x + n[1] * y) / n[2], n)


def unit(v):
    return v / np.linalg.norm(v)


@dataclasses.dataclass
class Wheel:
    """Motion of a wheel's centre; the spin is that about its axis."""

    x: np.ndarray
    axis: np.ndarray
    v: np.ndarray
    omega: np.ndarray

    @property
    def spin(self):
        return float(self.omega @ self.axis)


@dataclasses.dataclass
class Contact:
    """Where it touches, in its frame of contact."""

    deflection: float
    arm: np.ndarray
    axes: np.ndarray
    camber: float
    v: np.ndarray
    spin: float
    effective: float
    load: float = 0.0
    friction: float = 0.0

    @property
    def slide(self):
        return np.array([self.v[0] - self.spin * self.effective, self.v[1]])


def ground_point(wheel, ground, offset):
    """Ground below centre + offset, relative to the centre, and its normal."""
    place = wheel.x + offset
    height, normal = ground(place[0], place[1])
    return offset + (height - place[2]) * UP, normal


def segment_deflection(area, r):
    """Bisection for the deflection of the disc whose segment has an area."""
    low, high = 0.0, np.pi
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if 0.5 * r * r * (middle - sin(middle)) < area else (low, middle)
    return r * (1.0 - cos(0.5 * low))


def contact_of(wheel: Wheel, method: TireContact, row, ground: Ground) -> Contact | None:
    """The contact, or None."""
    r = row[Common.RADIUS]
    if np.sum(np.cross(wheel.axis, UP) ** 2) < 1e-3:
        return None
    across = unit(np.cross(wheel.axis, UP))
    low = r * np.cross(wheel.axis, across)
    point, normal = ground_point(wheel, ground, low)
    if point[2] >= 0.0:
        return None
    n = unit(normal - (normal @ wheel.axis) * wheel.axis)
    if method == TireContact.SINGLE_POINT:
        deflection = r + point @ n
        point, normal = ground_point(wheel, ground, (point @ n) * n)
    elif method == TireContact.FOUR_POINT:
        forward = unit(np.cross(wheel.axis, n))
        left = np.cross(n, forward)
        below = (point @ n) * n
        shifts = (0.1 * r * forward, -0.1 * r * forward, 0.3 * row[Common.WIDTH] * left)
        before, behind, beside, beyond = (
            ground_point(wheel, ground, below + s)[0] for s in (*shifts, -0.3 * row[Common.WIDTH] * left)
        )
        point = (before + behind + beside + beyond) / 4.0
        normal = unit(np.cross(before - behind, beside - beyond))
        deflection = r + point @ n
    else:
        step = r / 50.0
        area = 0.0
        for x in -r + step * np.arange(101):
            chord = low * sqrt(max(1.0 - (x / r) ** 2, 0.0))
            area += step * max(ground_point(wheel, ground, chord + x * across)[0][2] - chord[2], 0.0)
        deflection = segment_deflection(area, r) if area > 0.0 else 0.0
        normal = ground_point(wheel, ground, -(r - deflection) * n)[1]
        point = -(r - deflection) * n
    if deflection <= 0.0:
        return None
    forward = unit(np.cross(wheel.axis, normal))
    axes = np.stack([forward, np.cross(normal, forward), normal], axis=1)
    local = axes.T @ wheel.axis
    effective = r - row[Common.RADIUS_SHARE] * deflection
    return Contact(
        deflection, point, axes, float(np.arctan2(local[2], local[1])), axes.T @ wheel.v, wheel.spin, effective
    )  # fmt: skip


def clamped_camber(c, row):
    return float(np.clip(c.camber, -row[Common.CAMBER_LIMIT], row[Common.CAMBER_LIMIT]))


def vertical_load(c: Contact, row) -> float:
    """Spring, bump and damper."""
    d = c.deflection
    if row[Common.CURVE_POINTS] > 0:
        start, count = int(row[Common.CURVE_START]), int(row[Common.CURVE_POINTS])
        x, y = row[start : start + 2 * count].reshape(-1, 2).T
        i = int(np.clip(np.searchsorted(x, d) - 1, 0, count - 2))
        force = y[i] + (y[i + 1] - y[i]) / (x[i + 1] - x[i]) * (d - x[i])
    else:
        force = row[Common.STIFFNESS] * d + row[Common.STIFFNESS_SQUARE] * d * d
        force += row[Common.STIFFNESS_CAMBER] * clamped_camber(c, row) ** 2 * d
    force += row[Common.BOTTOM_STIFFNESS] * max(d - row[Common.BOTTOM_DEFLECTION], 0.0)
    return max(force - row[Common.DAMPING] * c.v[2], 0.0)


def sine_step(x, a, b):
    s = np.clip((x - a) / (b - a), 0.0, 1.0)
    return s - sin(2 * np.pi * s) / (2 * np.pi)


def standstill(c: Contact, load, row, z, dt):
    """Dahl's bristles, within the circle of friction; advances z."""
    coulomb = c.friction / row[Common.REFERENCE_FRICTION] * load
    force = np.zeros(2)
    for i in range(2):
        mass = row[Common.PATCH_MASS_X + i]
        s0 = min(row[Common.BRISTLE_STIFFNESS], mass / dt**2)
        s1 = min(row[Common.BRISTLE_DAMPING], mass / dt)
        v = c.slide[i]
        rate = s0 * abs(v) / coulomb
        z[i] = fine_ode(rate, v, z[i], dt)
        force[i] = -(s0 * z[i] + s1 * (v - rate * z[i]))
    return force * min(1.0, coulomb / max(np.linalg.norm(force), 1e-12))


# ---- TMeasy and TMsimple ---------------------------------------------------------------------------------------------


def through(row, entry, q):
    """Parabola through (0, 0), (1, a), (2, b)."""
    a, b = row[entry], row[entry + 1]
    return float(np.polyval(np.polyfit([0.0, 1.0, 2.0], [0.0, a, b], 2), q))


def along(row, entry, q):
    """Line through (1, a), (2, b)."""
    return row[entry] * (2.0 - q) + row[entry + 1] * (q - 1.0)


def tmeasy_curve(s, slope, s_m, f_m, s_s, f_s):
    """Force over the slip."""
    d = max(slope, 2 * f_m / s_m)
    if s >= s_s:
        return f_s
    if s < s_m:
        t = s / s_m
        return d * s_m * t / (1 + t * (t + d * s_m / f_m - 2))
    a = (f_m / s_m) ** 2 / (d * s_m)
    knee = s_m + (f_m - f_s) / (a * (s_s - s_m))
    if knee >= s_s:
        t = (s - s_m) / (s_s - s_m)
        return f_m + (f_s - f_m) * t * t * (3 - 2 * t)
    if s <= knee:
        return f_m - a * (s - s_m) ** 2
    return f_s + a * (knee - s_m) / (s_s - knee) * (s_s - s) ** 2


def trail_of(s, n_0, s_0, s_e):
    """Trail over the patch's length: a line mixed with a cubic, then a parabola back to zero."""
    s, s_e = abs(s), max(s_e, s_0)
    w = s_0 / s_e
    if s >= s_e:
        return 0.0
    if s <= s_0:
        t = s / s_0
        return n_0 * ((1 - w) * (1 - t) + w * (1 - 3 * t**2 + 2 * t**3))
    return -n_0 * (1 - w) * (s - s_0) / s_0 * ((s_e - s) / (s_e - s_0)) ** 2


def slips(c, row, z, dt, limit):
    v = c.effective * abs(c.spin) + 0.01
    s = lagged(-c.slide / v, v, lengths_of(row), limit, z, dt)
    size = float(np.linalg.norm(s))
    return s, size, s / size if size > 0 else np.zeros(2)


def tmeasy(c: Contact, row, z, dt, mirror):
    load = min(c.load, row[Common.LOAD_LIMIT])
    q = load / row[Tmeasy.NOMINAL_LOAD]
    m = c.friction / row[Common.REFERENCE_FRICTION]
    pairs = ((Tmeasy.MAX_X, Tmeasy.SLOPE_X), (Tmeasy.MAX_Y, Tmeasy.SLOPE_Y))
    s, size, e = slips(c, row, z, dt, [3 * m * through(row, a, q) / through(row, b, q) for a, b in pairs])

    def both(x, y, law):
        return hypot(law(row, x, q) * e[0], law(row, y, q) * e[1])

    force = np.zeros(2)
    if size > 0:
        force = e * tmeasy_curve(
            size,
            both(Tmeasy.SLOPE_X, Tmeasy.SLOPE_Y, through),
            m * both(Tmeasy.MAX_SLIP_X, Tmeasy.MAX_SLIP_Y, along),
            m * both(Tmeasy.MAX_X, Tmeasy.MAX_Y, through),
            m * both(Tmeasy.SLIDE_SLIP_X, Tmeasy.SLIDE_SLIP_Y, along),
            m * both(Tmeasy.SLIDE_X, Tmeasy.SLIDE_Y, through),
        )
    share = sine_step(abs(c.v[0]), row[Common.BLEND_BEGIN], row[Common.BLEND_END])
    force = (1 - share) * standstill(c, load, row, z, dt) + share * force
    entries = (Tmeasy.TRAIL, Tmeasy.TRAIL_ZERO_SLIP, Tmeasy.TRAIL_END_SLIP)
    trail = trail_of(s[1], *(along(row, entry, q) for entry in entries))
    m_z = -share * sign(c.v[0]) * force[1] * trail * 2 * sqrt(row[Common.RADIUS] * c.deflection)
    m_y = -row[Common.ROLLING_RESISTANCE] * c.load * np.tanh(c.spin)
    return [*force, c.load], [overturning(c, row), m_y, m_z]


def overturning(c, row):
    slope = row[Common.STIFFNESS] + 2 * row[Common.STIFFNESS_SQUARE] * c.deflection
    return -(row[Common.WIDTH] ** 2) / 12 * slope * clamped_camber(c, row)


def tmsimple(c: Contact, row, z, dt, mirror):
    load = min(c.load, row[Common.LOAD_LIMIT])
    q = load / row[Tmsimple.NOMINAL_LOAD]
    pairs = ((Tmsimple.MAX_X, Tmsimple.SLOPE_X), (Tmsimple.MAX_Y, Tmsimple.SLOPE_Y))
    _, size, e = slips(c, row, z, dt, [3 * through(row, a, q) / through(row, b, q) for a, b in pairs])

    def both(x, y):
        return hypot(through(row, x, q) * e[0], through(row, y, q) * e[1])

    force = np.zeros(2)
    if size > 0:
        f_m = both(Tmsimple.MAX_X, Tmsimple.MAX_Y)
        b = np.pi - np.arcsin(both(Tmsimple.SLIDE_X, Tmsimple.SLIDE_Y) / f_m)
        a = f_m * b / both(Tmsimple.SLOPE_X, Tmsimple.SLOPE_Y)
        force = e * f_m * sin(b * (1 - exp(-size / a))) * c.friction / row[Common.REFERENCE_FRICTION]
    share = sine_step(abs(c.v[0]), row[Common.BLEND_BEGIN], row[Common.BLEND_END])
    force = (1 - share) * standstill(c, load, row, z, dt) + share * force
    m_y = -row[Common.ROLLING_RESISTANCE] * c.load * np.tanh(c.spin)
    return [*force, c.load], [overturning(c, row), m_y, 0.0]


# ---- Fiala, Pacejka 89 -----------------------------------------------------------------------------------------------


def resistance(c):
    return -sign(c.spin) * sine_step(abs(c.v[0]), 0.125, 0.5)


def ratio_and_tangent(c):
    v = max(abs(c.v[0]), 0.1)
    return -c.slide[0] / v, c.v[1] / v


def fiala(c: Contact, row, z, dt, mirror):
    load = min(c.load, row[Common.LOAD_LIMIT])
    q = 3 * row[Fiala.FRICTION_STATIC] * load * c.friction / row[Common.REFERENCE_FRICTION]
    limit = [q / row[Fiala.SLIP_STIFFNESS], q / row[Fiala.CORNERING_STIFFNESS]]
    k, t = lagged(ratio_and_tangent(c), max(abs(c.v[0]), 0.1), lengths_of(row), limit, z, dt)
    slip = min(1.0, hypot(k, t))
    u = row[Fiala.FRICTION_STATIC] * (1 - slip) + row[Fiala.FRICTION_SLIDING] * slip
    q = u * load * c.friction / row[Common.REFERENCE_FRICTION]
    c_s, c_a = row[Fiala.SLIP_STIFFNESS], row[Fiala.CORNERING_STIFFNESS]
    f_x = c_s * k if abs(k) <= q / (2 * c_s) else sign(k) * (q - q**2 / (4 * abs(k) * c_s))
    f_y, m_z = -q * sign(t), 0.0
    if abs(t) < 3 * q / c_a:
        h = 1 - c_a * abs(t) / (3 * q)
        f_y, m_z = -q * (1 - h**3) * sign(t), q * row[Common.WIDTH] * (1 - h) * h**3 * sign(t)
    share = sine_step(abs(c.v[0]), row[Common.BLEND_BEGIN], row[Common.BLEND_END])
    force = (1 - share) * standstill(c, load, row, z, dt) + share * np.array([f_x, f_y])
    m_y = row[Common.ROLLING_RESISTANCE] * c.load * resistance(c)
    return [*force, c.load], [0.0, m_y, share * sign(c.v[0]) * m_z]


def magic(x, b, c, d, e):
    return d * sin(c * arctan(b * x - e * (b * x - arctan(b * x))))


def pac89_pure(k, alpha, g, fz, m, row):
    """(F_x, F_y, M_z): N, N·m in SAE axes; slip in %, angles in degrees, load in kN, m scales the friction."""
    a = row[Pac89.A : Pac89.A + 14]
    b = row[Pac89.B : Pac89.B + 11]
    c = row[Pac89.C : Pac89.C + 18]
    d = b[1] * fz**2 + b[2] * fz
    bcd = (b[3] * fz**2 + b[4] * fz) * exp(-b[5] * fz)
    f_x = m * magic(k + b[9] * fz + b[10], bcd / (b[0] * d), b[0], d, b[6] * fz**2 + b[7] * fz + b[8])
    d = a[1] * fz**2 + a[2] * fz
    bcd = a[3] * sin(2 * arctan(fz / a[4])) * (1 - a[5] * abs(g))
    x = np.clip(alpha + a[8] * g + a[9] * fz + a[10], -89.5, 89.5)
    f_y = m * magic(x, bcd / (a[0] * d), a[0], d, a[6] * fz + a[7]) + a[11] * fz * g + a[12] * fz + a[13]
    d = c[1] * fz**2 + c[2] * fz
    bcd = (c[3] * fz**2 + c[4] * fz) * (1 - c[6] * abs(g)) * exp(-c[5] * fz)
    e = (c[7] * fz**2 + c[8] * fz + c[9]) * (1 - c[10] * abs(g))
    x = np.clip(alpha + c[11] * g + c[12] * fz + c[13], -89.5, 89.5)
    m_z = m * magic(x, bcd / (c[0] * d), c[0], d, e)
    return f_x, f_y, m_z + (c[14] * fz**2 + c[15] * fz) * g + c[16] * fz + c[17]


def pac89(c: Contact, row, z, dt, mirror):
    load = min(c.load, row[Common.LOAD_LIMIT])
    k, t = ratio_and_tangent(c)
    m = c.friction / row[Common.REFERENCE_FRICTION]
    limit = pac89_limit(row, load / 1000, np.degrees(clamped_camber(c, row)), m)
    k, a = lagged((np.clip(k, -1, 1), arctan(t)), max(abs(c.v[0]), 0.1), lengths_of(row), limit, z, dt)
    f_x, f_y, m_z = pac89_pure(
        100 * k, mirror * np.degrees(a), mirror * np.degrees(clamped_camber(c, row)),
        load / 1000, m, row,
    )  # fmt: skip
    share = sine_step(abs(c.v[0]), row[Common.BLEND_BEGIN], row[Common.BLEND_END])
    force = (1 - share) * standstill(c, load, row, z, dt) + share * np.array([f_x, -mirror * f_y])
    aside = force[1] / row[Pac89.LATERAL_STIFFNESS]
    m_y = row[Common.ROLLING_RESISTANCE] * c.load * (row[Common.RADIUS] - c.deflection) * resistance(c)
    m_z = -share * sign(c.v[0]) * mirror * m_z
    return [*force, c.load], [c.load * aside, m_y, m_z - force[0] * aside]


# ---- Pacejka 2002 ----------------------------------------------------------------------------------------------------


class Coefficients:
    """Row entries of Pacejka 2002 as attributes."""

    def __init__(self, row):
        self.row = row

    def __getattr__(self, name):
        return float(self.row[Pac02[name]])


def pac02_pure(p: Any, k, a, g, fz, m):
    """Pure slip of both axes: dictionaries with force, slope, friction, shifts, B, C."""
    fz0 = p.FNOMIN * p.LFZO
    d = (fz - fz0) / fz0
    limit = p.ARGUMENT_LIMIT

    def bent(b, c, e, x):
        bx = np.clip(b * x, -limit, limit)
        return sin(c * arctan(bx - min(e, 1.0) * (bx - arctan(bx))))

    x: dict[str, float] = {}
    x["h"] = (p.PHX1 + p.PHX2 * d) * p.LHX
    x["v"] = fz * (p.PVX1 + p.PVX2 * d) * p.LVX * p.LMUX
    x["mu"] = abs(m * (p.PDX1 + p.PDX2 * d) * (1 - p.PDX3 * (g * p.LGAX) ** 2) * p.LMUX * p.AT_PRESSURE_MUX)
    x["k"] = fz * (p.PKX1 + p.PKX2 * d) * exp(p.PKX3 * d) * p.LKX * p.AT_PRESSURE_KX
    x["c"] = p.PCX1 * p.LCX
    x["b"] = x["k"] / (x["c"] * x["mu"] * fz + 0.1)
    e = (p.PEX1 + p.PEX2 * d + p.PEX3 * d**2) * (1 - p.PEX4 * sign(k + x["h"])) * p.LEX
    x["f"] = x["mu"] * fz * bent(x["b"], x["c"], e, k + x["h"]) + x["v"]

    y: dict[str, float] = {}
    gy = g * p.LGAY
    y["h"] = (p.PHY1 + p.PHY2 * d) * p.LHY + p.PHY3 * gy * p.LKYG
    y["v"] = fz * ((p.PVY1 + p.PVY2 * d) * p.LVY + (p.PVY3 + p.PVY4 * d) * gy * p.LKYG) * p.LMUY
    y["mu"] = abs(m * (p.PDY1 + p.PDY2 * d) * (1 + p.MUY_CAMBER * p.PDY3 * gy**2) * p.LMUY * p.AT_PRESSURE_MUY)
    y["k"] = p.PKY1 * p.FNOMIN * sin(2 * arctan(fz / (p.PKY2 * fz0 * p.AT_PRESSURE_PKY2)))
    y["k"] *= (1 - p.PKY3 * abs(gy)) * p.LFZO * p.LKY * p.AT_PRESSURE_KY
    y["c"] = p.PCY1 * p.LCY
    y["b"] = y["k"] / (y["c"] * y["mu"] * fz + 0.1)
    e = (p.PEY1 + p.PEY2 * d) * (1 - (p.PEY3 + p.PEY4 * gy) * sign(a + y["h"])) * p.LEY
    y["f"] = y["mu"] * fz * bent(y["b"], y["c"], e, a + y["h"]) + y["v"]
    return x, y, d, fz0


def pac02_slip(p: Any, k, a, g, fz, m, radius):
    """(F_x, F_y, M_z) in SAE axes."""
    mode = int(p.MODE)
    if mode == 0:
        return 0.0, 0.0, 0.0
    k, a = (0.0 if mode == 2 else k), (0.0 if mode == 1 else a)
    x, y, d, fz0 = pac02_pure(p, k, a, g, fz, m)
    f_x, f_y = x["f"], y["f"]
    weights = mode == 4 and p.ELLIPSE == 0
    shift = 0.0
    if mode == 4 and not weights:
        tan_b = abs(sin(a + y["h"] + y["v"] / y["k"])) / abs(k + x["h"] + x["v"] / x["k"])
        used_x, used_y = abs(x["f"] - x["v"]) / fz, abs(y["f"] - y["v"]) / fz
        f_x *= 1 / hypot(1 / used_x, tan_b / y["mu"]) / used_x
        f_y *= tan_b / hypot(1 / x["mu"], tan_b / used_y) / used_y
    if weights:

        def weight(b, c, e, x, s):
            e = min(e, 1.0)

            def g_of(t):
                return cos(c * arctan(b * t - e * (b * t - arctan(b * t))))

            return g_of(x + s) / g_of(s)

        b = abs(p.RBX1 * cos(arctan(p.RBX2 * k)) * p.LXAL)
        f_x *= weight(b, p.RCX1, p.REX1 + p.REX2 * d, a, p.RHX1)
        b = p.RBY1 * cos(arctan(p.RBY2 * (a - p.RBY3))) * p.LYKA
        shift = y["mu"] * fz * (p.RVY1 + p.RVY2 * d + p.RVY3 * g) * cos(arctan(p.RVY4 * a))
        shift *= sin(p.RVY5 * arctan(p.RVY6 * k)) * p.LVYKA
        f_y = f_y * weight(b, p.RCY1, p.REY1 + p.REY2 * d, k, p.RHY1 + p.RHY2 * d) + shift

    gz = g * p.LGAZ
    a_t = a + p.QHZ1 + p.QHZ2 * d + (p.QHZ3 + p.QHZ4 * d) * gz
    a_r = a + y["h"] + y["v"] / y["k"]
    grip = p.LKY / p.LMUY
    b = abs((p.QBZ1 + p.QBZ2 * d + p.QBZ3 * d**2) * (1 + p.QBZ4 * gz + p.QBZ5 * abs(gz)) * grip)
    e = (p.QEZ1 + p.QEZ2 * d + p.QEZ3 * d**2) * (
        1 + (p.QEZ4 + p.QEZ5 * gz) * 2 / np.pi * arctan(b * p.QCZ1 * a_t)
    )  # fmt: skip
    if weights:
        a_t = arctan(hypot(tan(a_t), x["k"] / y["k"] * k)) * sign(a_t)
        a_r = arctan(hypot(tan(a_r), x["k"] / y["k"] * k)) * sign(a_r)
    bx = b * a_t
    trail = fz * (p.QDZ1 + p.QDZ2 * d) * (1 + p.QDZ3 * gz + p.QDZ4 * gz**2) * radius / fz0 * p.LTR
    trail *= p.AT_PRESSURE_TRAIL * cos(p.QCZ1 * arctan(bx - min(e, 1.0) * (bx - arctan(bx)))) * cos(a)
    residual = (p.QDZ6 + p.QDZ7 * d) * p.LRES + (p.QDZ8 + p.QDZ9 * d) * p.AT_PRESSURE_RESIDUAL * gz
    residual *= fz * radius * p.LMUY * cos(a)
    residual *= cos(arctan((p.QBZ9 * grip + p.QBZ10 * y["b"] * y["c"]) * a_r))
    m_z = -trail * (f_y - shift) + residual
    if weights:
        m_z += (p.SSZ1 + p.SSZ2 * f_y / fz0 + (p.SSZ3 + p.SSZ4 * d) * g) * radius * p.LS * f_x
    return (0.0 if mode == 2 else f_x), (0.0 if mode == 1 else f_y), (0.0 if mode == 1 else m_z)


def pac02(c: Contact, row, z, dt, mirror):
    p: Any = Coefficients(row)
    fz = min(c.load, row[Common.LOAD_LIMIT])
    least = max(fz, p.FZMIN)
    m = c.friction / row[Common.REFERENCE_FRICTION]
    v = abs(c.v[0]) + 0.1
    g = np.clip(mirror * clamped_camber(c, row), p.CAMMIN, p.CAMMAX)
    slip = np.clip([-c.slide[0] / v, -mirror * arctan(c.v[1] / v)], [p.KPUMIN, p.ALPMIN], [p.KPUMAX, p.ALPMAX])
    x, y, _, _ = pac02_pure(p, slip[0], slip[1], g, least, m)
    limit = [3 * least * x["mu"] / abs(x["k"]), 3 * least * y["mu"] / abs(y["k"])]
    k, a = lagged(slip, v, pac02_lengths(p, row, least, g), limit, z, dt)
    r = row[Common.RADIUS]
    s_x, s_y, m_z = np.array(pac02_slip(p, k, a, g, least, m, r)) * fz / least
    share = sine_step(abs(c.v[0]), row[Common.BLEND_BEGIN], row[Common.BLEND_END])
    held = standstill(c, fz, row, z, dt)
    f_x = (1 - share) * held[0] + share * s_x
    f_y = (1 - share) * held[1] - share * mirror * s_y
    # torques of a mirrored tire are found in its mirror image, in SAE axes
    side = -mirror * f_y / (p.FNOMIN * p.LFZO)
    q = fz / (p.FNOMIN * p.LFZO)
    m_x = p.QSX1 * p.LVMX + p.QSX3 * side - p.QSX2 * p.AT_PRESSURE_MX * g + p.QSX10 * arctan(p.QSX11 * q) * g
    m_x += p.QSX4 * cos(p.QSX5 * arctan(q**2)) * sin(p.QSX7 * g + p.QSX8 * arctan(p.QSX9 * side))
    u = abs(c.v[0]) / p.REFERENCE_SPEED
    w = fz / p.FNOMIN
    m_y = p.QSY1 + p.QSY2 * f_x / p.FNOMIN + p.QSY3 * u + p.QSY4 * u**4 + (p.QSY5 + p.QSY6 * w) * g**2
    m_y *= w**p.QSY7 * p.AT_PRESSURE_MY * p.LMY * fz * r * resistance(c)
    return [f_x, f_y, c.load], [mirror * r * fz * m_x * p.LMX, m_y, -share * mirror * sign(c.v[0]) * m_z]


# ---- LuGre and the whole wheel ---------------------------------------------------------------------------------------


def lugre_friction(v, m, row):
    """Friction of steady sliding, without viscosity."""
    kinetic, static = row[Lugre.KINETIC_FRICTION], row[Lugre.STATIC_FRICTION]
    return m * (kinetic + (static - kinetic) * exp(-sqrt(v / row[Lugre.STRIBECK_SPEED])))


def lugre_disc(c: Contact, row, z, dt):
    """Force of one disc along x and y; advances z."""
    v = float(np.linalg.norm(c.slide))
    m = c.friction / row[Common.REFERENCE_FRICTION]
    g = lugre_friction(v, m, row)
    length = 2 * sqrt(row[Common.RADIUS] * c.deflection)
    force = np.zeros(2)
    for i in range(2):
        s0, s1, s2 = (row[e + i] for e in (Lugre.BRISTLE_STIFFNESS, Lugre.BRISTLE_DAMPING, Lugre.VISCOSITY))
        s1 = s1 / (1 + dt * s1 * c.load / row[Common.PATCH_MASS_X + i])
        rate = s0 * v / g + row[Lugre.CARRY_OFF] * abs(c.spin) * c.effective / length
        z[i] = fine_ode(rate, c.slide[i], z[i], dt)
        force[i] = -c.load * (s0 * z[i] + s1 * (c.slide[i] - rate * z[i]) + m * s2 * c.slide[i])
    return force


MODELS = {
    TireModel.TMEASY: tmeasy,
    TireModel.TMSIMPLE: tmsimple,
    TireModel.FIALA: fiala,
    TireModel.PAC89: pac89,
    TireModel.PAC02: pac02,
}


@dataclasses.dataclass
class Result:
    """Force on the wheel and torque about its centre, world axes; local: in the frame of contact."""

    load: float
    force: np.ndarray
    torque: np.ndarray
    contact: Contact | None = None
    local: np.ndarray | None = None


def touched(wheel, method, row, ground, friction, parts=1):
    """The contact with its load and friction, or None."""
    c = contact_of(wheel, method, row, ground)
    if c is None:
        return None
    c.load = vertical_load(c, row) / parts
    c.friction = float(np.clip(friction, row[Common.FRICTION_LOWER], row[Common.FRICTION_UPPER]))
    return c if c.load > 0.0 else None


def tire(model, wheel: Wheel, method, row, ground: Ground, friction, z, dt, mirror=1.0) -> Result:
    """What a tire does to its wheel; advances z."""
    if model == TireModel.LUGRE:
        return lugre(wheel, method, row, ground, friction, z, dt)
    c = touched(wheel, method, row, ground, friction)
    if c is None:
        z[:] = 0.0
        return Result(0.0, np.zeros(3), np.zeros(3))
    force, torque = (np.array(v) for v in MODELS[model](c, row, z, dt, mirror))
    world = c.axes @ force
    return Result(c.load, world, c.axes @ torque + np.cross(c.arm, world), c, force)


def lugre(wheel: Wheel, method, row, ground: Ground, friction, z, dt) -> Result:
    count = int(row[Lugre.DISC_COUNT])
    total = Result(0.0, np.zeros(3), np.zeros(3))
    for disc in range(count):
        aside = (disc - (count - 1) / 2) * row[Lugre.DISC_SPACING] * wheel.axis
        moved = dataclasses.replace(wheel, x=wheel.x + aside, v=wheel.v + np.cross(wheel.omega, aside))
        c = touched(moved, method, row, ground, friction, count)
        if c is None:
            z[2 * disc : 2 * disc + 2] = 0.0
            continue
        force = c.axes @ np.array([*lugre_disc(c, row, z[2 * disc : 2 * disc + 2], dt), c.load])
        total.load += c.load
        total.force += force
        m_y = row[Common.ROLLING_RESISTANCE] * c.load * resistance(c)
        total.torque += np.cross(aside + c.arm, force) + m_y * c.axes[:, 1]
    return total
