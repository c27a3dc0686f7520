"""Fiala's brush (Fiala 1954; as in Adams/Tire): slip stiffness C_s, cornering stiffness C_a, two frictions.

With k the slip ratio and a the slip angle, friction falls with the slip: U = U_static - (U_static - U_sliding) S,
S = min(1, |(k, tan a)|), scaled by the road's friction over the reference; Q = U F_z.

    F_x = C_s k                                up to |k| = Q / (2 C_s)
        = sgn k (Q - Q² / (4 |k| C_s))         beyond
    F_y = -Q (1 - H³) sgn a,  H = 1 - C_a |tan a| / (3 Q),  M_z = Q w (1 - H) H³ sgn a   while H > 0
        = -Q sgn a,                                         M_z = 0                      beyond

The two forces know of each other only through S: together they may exceed Q. The bounds follow the friction of the
road, too: where they kept that of the reference, the force would jump on other roads.
"""

import warp as wp

from simwarp.vehicle.tires.common_kernels import (
    ADHESION,
    friction_scale,
    lagged,
    limited_load,
    relaxation_lengths,
    resistance_share,
    slip_share,
    standstill_force,
)
from simwarp.vehicle.tires.parameter_vector_kernels import Common, Fiala
from simwarp.vehicle.tires.patch_kernels import SLOWEST, Patch, TireForce, slip_ratio

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.func
def fiala_slip_force(k: float, tan_a: float, load: float, scale: float, p: wp.array[float]) -> wp.vec3:
    """(F_x, F_y, M_z) of the slip [N, N, N·m]."""
    c_s = p[Fiala.SLIP_STIFFNESS]
    static = p[Fiala.FRICTION_STATIC]
    slip = wp.min(wp.sqrt(k * k + tan_a * tan_a), 1.0)
    q = scale * (static - (static - p[Fiala.FRICTION_SLIDING]) * slip) * load
    force = wp.vec3()
    if q <= 0.0:
        return force
    force[0] = c_s * k
    if wp.abs(k) > 0.5 * q / c_s:
        force[0] = wp.sign(k) * (q - q * q / (4.0 * wp.abs(k) * c_s))
    h = wp.max(1.0 - p[Fiala.CORNERING_STIFFNESS] * wp.abs(tan_a) / (3.0 * q), 0.0)
    force[1] = -q * (1.0 - h * h * h) * wp.sign(tan_a)
    force[2] = q * p[Common.WIDTH] * (1.0 - h) * h * h * h * wp.sign(tan_a)
    return force


@wp.func
def fiala_force(patch: Patch, p: wp.array[float], z: wp.array[float], dt: float) -> TireForce:
    """Force and torque of a Fiala tire."""
    load = limited_load(patch, p)
    share = slip_share(patch, p)
    held = standstill_force(patch, load, p, z, dt)
    tan_a = patch.v[1] / wp.max(wp.abs(patch.v[0]), SLOWEST)
    s = wp.vec2(slip_ratio(patch), tan_a)
    lengths = relaxation_lengths(p, z)
    if lengths[0] > 0.0:
        q = friction_scale(patch, p) * p[Fiala.FRICTION_STATIC] * load
        limit = ADHESION * q * wp.vec2(1.0 / p[Fiala.SLIP_STIFFNESS], 1.0 / p[Fiala.CORNERING_STIFFNESS])
        s = lagged(s, wp.max(wp.abs(patch.v[0]), SLOWEST), lengths, limit, z, dt)
    slipping = fiala_slip_force(s[0], s[1], load, friction_scale(patch, p), p)
    result = TireForce()
    result.force = wp.vec3(
        (1.0 - share) * held[0] + share * slipping[0], (1.0 - share) * held[1] + share * slipping[1], patch.load
    )
    result.torque = wp.vec3(
        0.0,
        p[Common.ROLLING_RESISTANCE] * patch.load * resistance_share(patch),
        share * wp.sign(patch.v[0]) * slipping[2],
    )
    return result
