"""TMeasy (Rill, Road Vehicle Dynamics, 2nd edition 2020, chapter 3): force over slip from a handful of points.

Slips with the transport speed v_t = r_eff |omega| + 0.01 m/s: s_x = -v_sx / v_t, s_y = -v_sy / v_t, s = |(s_x, s_y)|.
All characteristic values depend on the load q = F_z / F_nominal: forces and slopes as the parabola through the origin
and the values at q = 1 and 2, slips linearly. In the direction of the slip (cos, sin) = (s_x, s_y) / s the values of
both axes are combined: f_m = |(f_mx cos, f_my sin)| and so on. The curve over s with slope d at 0, peak (s_m, f_m),
sliding from (s_s, f_s) on:

    s < s_m:  f = d s / (1 + t (t + d s_m / f_m - 2)),  t = s / s_m,  d >= 2 f_m / s_m
    up to s*: f = f_m - a (s - s_m)²,  a = (f_m / s_m)² / (d s_m),  s* = s_m + (f_m - f_s) / (a (s_s - s_m))
    up to s_s: f = f_s + a (s* - s_m) / (s_s - s*) (s_s - s)²; if s* > s_s a cubic replaces both
    beyond:   f = f_s

Road friction scales f_m, f_s, s_m and s_s; the slope stays. Aligning torque -F_y n(s_y) L with the length of the patch
L = 2 sqrt(r d) and a trail n that falls from n_0, changes its sign and ends at zero.
"""

import warp as wp

from simwarp.vehicle.tires.common_kernels import (
    ADHESION,
    friction_scale,
    lagged,
    limited_load,
    overturning_torque,
    relaxation_lengths,
    slip_share,
    standstill_force,
)
from simwarp.vehicle.tires.parameter_vector_kernels import Common, Tmeasy
from simwarp.vehicle.tires.patch_kernels import Patch, TireForce

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

LEAST_TRANSPORT = wp.constant(0.01)  # [m/s]


@wp.func
def quadratic(p: wp.array[float], entry: int, q: float) -> float:
    """The parabola through the origin and the two values of an entry."""
    a = p[entry]
    b = p[entry + 1]
    return q * (2.0 * a - 0.5 * b + (0.5 * b - a) * q)


@wp.func
def linear(p: wp.array[float], entry: int, q: float) -> float:
    """The line through the two values of an entry."""
    return p[entry] + (p[entry + 1] - p[entry]) * (q - 1.0)


@wp.func
def adhesion_slip(p: wp.array[float], max_x: int, max_y: int, slope_x: int, slope_y: int, q: float) -> wp.vec2:
    """Largest force over initial slope, along x and y."""
    return wp.vec2(
        quadratic(p, max_x, q) / quadratic(p, slope_x, q), quadratic(p, max_y, q) / quadratic(p, slope_y, q)
    )  # fmt: skip


@wp.func
def slip_curve(s: float, slope: float, s_m: float, f_m: float, s_s: float, f_s: float) -> float:
    """Force over slip [N]."""
    d = wp.max(2.0 * f_m / s_m, slope)
    force = float(f_s)
    if s < s_m:
        t = s / s_m
        force = d * s / (1.0 + t * (t + d * s_m / f_m - 2.0))
    elif s < s_s:
        a = (f_m / s_m) * (f_m / s_m) / (d * s_m)
        knee = s_m + (f_m - f_s) / (a * (s_s - s_m))
        if knee >= s_s:
            t = (s - s_m) / (s_s - s_m)
            force = f_m - (f_m - f_s) * t * t * (3.0 - 2.0 * t)
        elif s <= knee:
            force = f_m - a * (s - s_m) * (s - s_m)
        else:
            b = a * (knee - s_m) / (s_s - knee)
            force = f_s + b * (s_s - s) * (s_s - s)
    return force


@wp.func
def pneumatic_trail(s_y: float, n_0: float, s_0: float, s_e: float) -> float:
    """Trail over the length of the patch."""
    s = wp.abs(s_y)
    end = wp.max(s_e, s_0)
    w = s_0 / end
    trail = float(0.0)
    if s <= s_0:
        t = s / s_0
        trail = n_0 * ((1.0 - w) * (1.0 - t) + w * (1.0 - (3.0 - 2.0 * t) * t * t))
    elif s < end:
        t = (end - s) / (end - s_0)
        trail = -n_0 * (1.0 - w) * (s - s_0) / s_0 * t * t
    return trail


@wp.func
def transport_speed(patch: Patch) -> float:
    """v_t [m/s]."""
    return patch.effective_radius * wp.abs(patch.spin) + LEAST_TRANSPORT


@wp.func
def slip_velocity_ratio(patch: Patch) -> wp.vec2:
    """The slips (s_x, s_y)."""
    return -patch.slide / transport_speed(patch)


@wp.func
def tmeasy_slip_force(s: wp.vec2, q: float, scale: float, p: wp.array[float]) -> wp.vec2:
    """Force of the slip [N]."""
    size = wp.length(s)
    if size < 1.0e-9 or q <= 0.0:
        return wp.vec2()
    c = s / size
    slope = wp.length(wp.vec2(quadratic(p, Tmeasy.SLOPE_X, q) * c[0], quadratic(p, Tmeasy.SLOPE_Y, q) * c[1]))
    f_m = wp.length(wp.vec2(quadratic(p, Tmeasy.MAX_X, q) * c[0], quadratic(p, Tmeasy.MAX_Y, q) * c[1]))
    f_s = wp.length(wp.vec2(quadratic(p, Tmeasy.SLIDE_X, q) * c[0], quadratic(p, Tmeasy.SLIDE_Y, q) * c[1]))
    s_m = wp.length(wp.vec2(linear(p, Tmeasy.MAX_SLIP_X, q) * c[0], linear(p, Tmeasy.MAX_SLIP_Y, q) * c[1]))
    s_s = wp.length(wp.vec2(linear(p, Tmeasy.SLIDE_SLIP_X, q) * c[0], linear(p, Tmeasy.SLIDE_SLIP_Y, q) * c[1]))
    return c * slip_curve(size, slope, scale * s_m, scale * f_m, scale * s_s, scale * f_s)


@wp.func
def tmeasy_force(patch: Patch, p: wp.array[float], z: wp.array[float], dt: float) -> TireForce:
    """Force and torque of a TMeasy tire."""
    load = limited_load(patch, p)
    q = load / p[Tmeasy.NOMINAL_LOAD]
    scale = friction_scale(patch, p)
    s = slip_velocity_ratio(patch)
    lengths = relaxation_lengths(p, z)
    if lengths[0] > 0.0:
        limit = ADHESION * scale * adhesion_slip(p, Tmeasy.MAX_X, Tmeasy.MAX_Y, Tmeasy.SLOPE_X, Tmeasy.SLOPE_Y, q)
        s = lagged(s, transport_speed(patch), lengths, limit, z, dt)
    share = slip_share(patch, p)
    held = standstill_force(patch, load, p, z, dt)
    force = (1.0 - share) * held + share * tmeasy_slip_force(s, q, scale, p)
    n_0 = linear(p, Tmeasy.TRAIL, q)
    s_0 = linear(p, Tmeasy.TRAIL_ZERO_SLIP, q)
    trail = pneumatic_trail(s[1], n_0, s_0, linear(p, Tmeasy.TRAIL_END_SLIP, q))
    length = 2.0 * wp.sqrt(p[Common.RADIUS] * patch.deflection)
    result = TireForce()
    result.force = wp.vec3(force[0], force[1], patch.load)
    # in reverse the trail lies on the other side
    result.torque = wp.vec3(
        overturning_torque(patch, p),
        -p[Common.ROLLING_RESISTANCE] * patch.load * wp.tanh(patch.spin),
        -share * wp.sign(patch.v[0]) * force[1] * length * trail,
    )
    return result
