"""TMsimple (Hirschberg, Rill & Weinfurter 2007): one formula of three values per axis.

Values over the load q = F_z / F_nominal and their combination in the direction of the slip as in TMeasy, with the
slopes d, maxima F_m and sliding forces F_s:

    F(s) = F_m sin(B (1 - exp(-s / A))),   B = pi - asin(F_s / F_m),   A = F_m B / d

which starts with slope d, reaches F_m and ends at F_s. Road friction scales the force. No aligning torque.
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
from simwarp.vehicle.tires.laws.tmeasy_kernels import adhesion_slip, quadratic, slip_velocity_ratio, transport_speed
from simwarp.vehicle.tires.parameter_vector_kernels import Common, Tmsimple
from simwarp.vehicle.tires.patch_kernels import Patch, TireForce

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

PI = wp.constant(3.14159265)


@wp.func
def tmsimple_slip_force(s: wp.vec2, q: float, p: wp.array[float]) -> wp.vec2:
    """Force of the slip at the reference friction [N]."""
    size = wp.length(s)
    if size < 1.0e-9 or q <= 0.0:
        return wp.vec2()
    c = s / size
    slope = wp.length(wp.vec2(quadratic(p, Tmsimple.SLOPE_X, q) * c[0], quadratic(p, Tmsimple.SLOPE_Y, q) * c[1]))
    f_m = wp.length(wp.vec2(quadratic(p, Tmsimple.MAX_X, q) * c[0], quadratic(p, Tmsimple.MAX_Y, q) * c[1]))
    f_s = wp.length(wp.vec2(quadratic(p, Tmsimple.SLIDE_X, q) * c[0], quadratic(p, Tmsimple.SLIDE_Y, q) * c[1]))
    b = PI - wp.asin(wp.min(f_s / f_m, 1.0))
    a = f_m * b / slope
    return c * (f_m * wp.sin(b * (1.0 - wp.exp(-size / a))))


@wp.func
def tmsimple_force(patch: Patch, p: wp.array[float], z: wp.array[float], dt: float) -> TireForce:
    """Force and torque of a TMsimple tire."""
    load = limited_load(patch, p)
    share = slip_share(patch, p)
    held = standstill_force(patch, load, p, z, dt)
    q = load / p[Tmsimple.NOMINAL_LOAD]
    s = slip_velocity_ratio(patch)
    lengths = relaxation_lengths(p, z)
    if lengths[0] > 0.0:
        limit = ADHESION * adhesion_slip(
            p, Tmsimple.MAX_X, Tmsimple.MAX_Y, Tmsimple.SLOPE_X, Tmsimple.SLOPE_Y, q
        )  # fmt: skip
        s = lagged(s, transport_speed(patch), lengths, limit, z, dt)
    slipping = tmsimple_slip_force(s, q, p)
    force = (1.0 - share) * held + share * friction_scale(patch, p) * slipping
    result = TireForce()
    result.force = wp.vec3(force[0], force[1], patch.load)
    result.torque = wp.vec3(
        overturning_torque(patch, p), -p[Common.ROLLING_RESISTANCE] * patch.load * wp.tanh(patch.spin), 0.0
    )
    return result
