"""Pacejka 89 (Bakker, Pacejka & Lidner 1989; as in Adams/Tire): magic formula of each force, without combined slip.

F_z in kN, slip angle a and camber g in degrees, slip k in %; Y = D sin(C atan(B X - E (B X - atan(B X)))) + S_v with
X = slip + S_h:

    F_x: C = b0, D = b1 F_z² + b2 F_z, BCD = (b3 F_z² + b4 F_z) exp(-b5 F_z), E = b6 F_z² + b7 F_z + b8,
         S_h = b9 F_z + b10
    F_y: C = a0, D = a1 F_z² + a2 F_z, BCD = a3 sin(2 atan(F_z / a4)) (1 - a5 |g|), E = a6 F_z + a7,
         S_h = a8 g + a9 F_z + a10, S_v = a11 F_z g + a12 F_z + a13
    M_z: C = c0, D = c1 F_z² + c2 F_z, BCD = (c3 F_z² + c4 F_z) (1 - c6 |g|) exp(-c5 F_z),
         E = (c7 F_z² + c8 F_z + c9) (1 - c10 |g|), S_h = c11 g + c12 F_z + c13,
         S_v = (c14 F_z² + c15 F_z) g + c16 F_z + c17

F_y and M_z are in SAE axes and change their sign. Road friction scales D. The carcass gives way to F_y by F_y / k_lat:
the load and F_x then act beside the middle plane and twist it.
"""

import warp as wp

from simwarp.vehicle.tires.common_kernels import (
    ADHESION,
    friction_scale,
    lagged,
    limited_camber,
    limited_load,
    relaxation_lengths,
    resistance_share,
    slip_share,
    standstill_force,
)
from simwarp.vehicle.tires.laws.magic_kernels import magic_sine
from simwarp.vehicle.tires.parameter_vector_kernels import Common, Pac89
from simwarp.vehicle.tires.patch_kernels import SLOWEST, Patch, TireForce, slip_angle, slip_ratio

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

DEGREES = wp.constant(57.2957795)
LARGEST_ANGLE = wp.constant(89.5)


@wp.func
def pac89_longitudinal(k: float, fz: float, scale: float, p: wp.array[float]) -> float:
    """F_x [N] of slip in %, load in kN."""
    b = int(Pac89.B)
    d = (p[b + 1] * fz + p[b + 2]) * fz
    bcd = (p[b + 3] * fz + p[b + 4]) * fz * wp.exp(-p[b + 5] * fz)
    e = (p[b + 6] * fz + p[b + 7]) * fz + p[b + 8]
    x = k + p[b + 9] * fz + p[b + 10]
    return scale * d * magic_sine(bcd / (p[b] * d) * x, p[b], e)


@wp.func
def pac89_lateral(alpha: float, camber: float, fz: float, scale: float, p: wp.array[float]) -> float:
    """F_y [N] in SAE axes; angles in degrees."""
    a = int(Pac89.A)
    d = (p[a + 1] * fz + p[a + 2]) * fz
    bcd = p[a + 3] * wp.sin(2.0 * wp.atan(fz / p[a + 4])) * (1.0 - p[a + 5] * wp.abs(camber))
    x = wp.clamp(alpha + p[a + 8] * camber + p[a + 9] * fz + p[a + 10], -LARGEST_ANGLE, LARGEST_ANGLE)
    shift = p[a + 11] * fz * camber + p[a + 12] * fz + p[a + 13]
    return scale * d * magic_sine(bcd / (p[a] * d) * x, p[a], p[a + 6] * fz + p[a + 7]) + shift


@wp.func
def pac89_aligning(alpha: float, camber: float, fz: float, scale: float, p: wp.array[float]) -> float:
    """M_z [N·m] in SAE axes; angles in degrees."""
    c = int(Pac89.C)
    d = (p[c + 1] * fz + p[c + 2]) * fz
    lean = wp.abs(camber)
    bcd = (p[c + 3] * fz + p[c + 4]) * fz * (1.0 - p[c + 6] * lean) * wp.exp(-p[c + 5] * fz)
    e = ((p[c + 7] * fz + p[c + 8]) * fz + p[c + 9]) * (1.0 - p[c + 10] * lean)
    x = wp.clamp(alpha + p[c + 11] * camber + p[c + 12] * fz + p[c + 13], -LARGEST_ANGLE, LARGEST_ANGLE)
    shift = (p[c + 14] * fz + p[c + 15]) * fz * camber + p[c + 16] * fz + p[c + 17]
    if p[c] * d == 0.0:
        return shift
    return scale * d * magic_sine(bcd / (p[c] * d) * x, p[c], e) + shift


@wp.func
def pac89_adhesion_slip(camber: float, fz: float, p: wp.array[float]) -> wp.vec2:
    """Slip ratio and slip angle [rad] at which all of the contact slides, at the reference friction."""
    a = int(Pac89.A)
    b = int(Pac89.B)
    d_x = (p[b + 1] * fz + p[b + 2]) * fz
    slope_x = (p[b + 3] * fz + p[b + 4]) * fz * wp.exp(-p[b + 5] * fz)
    d_y = (p[a + 1] * fz + p[a + 2]) * fz
    slope_y = p[a + 3] * wp.sin(2.0 * wp.atan(fz / p[a + 4])) * (1.0 - p[a + 5] * wp.abs(camber))
    return ADHESION * wp.vec2(0.01 * wp.abs(d_x / slope_x), wp.abs(d_y / slope_y) / DEGREES)


@wp.func
def pac89_force(patch: Patch, mirror: float, p: wp.array[float], z: wp.array[float], dt: float) -> TireForce:
    """Force and torque of a Pacejka 89 tire; `mirror` is -1 for one measured on the other side."""
    load = limited_load(patch, p)
    share = slip_share(patch, p)
    held = standstill_force(patch, load, p, z, dt)
    scale = friction_scale(patch, p)
    fz = 1.0e-3 * load
    slip = wp.vec2(wp.clamp(slip_ratio(patch), -1.0, 1.0), slip_angle(patch))
    camber = mirror * DEGREES * limited_camber(patch, p)
    lengths = relaxation_lengths(p, z)
    if lengths[0] > 0.0:
        limit = scale * pac89_adhesion_slip(camber, fz, p)
        slip = lagged(slip, wp.max(wp.abs(patch.v[0]), SLOWEST), lengths, limit, z, dt)
    k = 100.0 * slip[0]
    alpha = mirror * DEGREES * slip[1]
    f_x = pac89_longitudinal(k, fz, scale, p)
    f_y = -mirror * pac89_lateral(alpha, camber, fz, scale, p)
    m_z = -mirror * pac89_aligning(alpha, camber, fz, scale, p)
    force = (1.0 - share) * held + share * wp.vec2(f_x, f_y)
    aside = force[1] / p[Pac89.LATERAL_STIFFNESS]
    radius = p[Common.RADIUS] - patch.deflection
    result = TireForce()
    result.force = wp.vec3(force[0], force[1], patch.load)
    result.torque = wp.vec3(
        patch.load * aside,
        p[Common.ROLLING_RESISTANCE] * patch.load * radius * resistance_share(patch),
        share * wp.sign(patch.v[0]) * m_z - force[0] * aside,
    )
    return result
