"""Pacejka 2002 and MF-Tyre 5.2 (Pacejka, Tyre and Vehicle Dynamics, 2nd edition 2006, section 4.3.2).

With d = (F_z - F_z0) / F_z0, F_z0 = FNOMIN LFZO, slip ratio k, slip angle a, camber g, p. the factors of pressure:

    F_x0 = D sin(C atan(B x - E (B x - atan(B x)))) + S_V,  x = k + S_H,  D = |mu_x| F_z,  B = K / (C D + 0.1)
    mu_x = (PDX1 + PDX2 d)(1 - PDX3 g²) LMUX,  K_x = F_z (PKX1 + PKX2 d) exp(PKX3 d) LKX,
    E_x = (PEX1 + PEX2 d + PEX3 d²)(1 - PEX4 sgn x) <= 1,  S_Hx = PHX1 + PHX2 d,  S_Vx = F_z (PVX1 + PVX2 d)
    F_y0 alike:  mu_y = (PDY1 + PDY2 d)(1 + PDY3 g²) LMUY,
    K_y = PKY1 FNOMIN sin(2 atan(F_z / (PKY2 F_z0)))(1 - PKY3 |g|) LFZO LKY,
    E_y = (PEY1 + PEY2 d)(1 - (PEY3 + PEY4 g) sgn y) <= 1,  S_Hy = PHY1 + PHY2 d + PHY3 g,
    S_Vy = F_z (PVY1 + PVY2 d + (PVY3 + PVY4 d) g)
    M_z = -t F_y + M_zr,  t = D_t cos(C_t atan(...(a + S_Ht))) cos a,  M_zr = D_r cos(atan(B_r (a + S_Hf))) cos a

The two differ in two places. (1 + PDY3 g²) is that of PAC2002 as Chrono has it; in MF-Tyre 5.2 it is (1 - PDY3 g²), as
in equation 4.E23. Rolling resistance takes its speed over sqrt(g R) in the one, over LONGVL in the other (4.E70). All
scaling factors stand where equations 4.E9 to 4.E78 have them. Slips, camber and load are held within the ranges of the
file; below FZMIN forces are those of FZMIN, times F_z / FZMIN. Relaxation lengths, where the file asks for them
(appendix 3; as in Adams/Tire):

    sigma_x = R F_z / F_z0 (PTX1 + PTX2 d) exp(-PTX3 d) LSGKP
    sigma_y = R PTY1 sin(2 atan(F_z / (PTY2 F_z0))) (1 - PKY3 |g LGAY|) LFZO LSGAL

The road scales mu. Combined slip (USE_MODE 4) by the ellipse of
friction in the direction of the slip, or by Pacejka's cosine weights G_xa, G_yk with S_Vyk, equivalent slips in the
trail, and the moment arm s of F_x. Here y and z are SAE axes: F_y and M_z change their sign in the frame of contact.
Slips are taken with |v_x| + 0.1 m/s, the effective radius is Rill's estimate.
"""

import warp as wp

from simwarp.vehicle.tires.common_kernels import (
    ADHESION,
    friction_scale,
    has_lagged_slips,
    lagged,
    limited_camber,
    limited_load,
    relaxation_lengths,
    resistance_share,
    slip_share,
    standstill_force,
)
from simwarp.vehicle.tires.laws.magic_kernels import bent, magic_cosine, magic_sine
from simwarp.vehicle.tires.parameter_vector_kernels import Common, Pac02
from simwarp.vehicle.tires.patch_kernels import Patch, TireForce

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

SPEED_OFFSET = wp.constant(0.1)  # [m/s]
SHORTEST = wp.constant(1.0e-3)  # relaxation length, which falls to nothing with the load [m]


@wp.struct
class Slip:
    """Inputs of the force laws; SAE signs."""

    k: float  # slip ratio
    a: float  # slip angle [rad]
    g: float  # camber [rad]
    fz: float  # [N]
    fz0: float
    d: float  # (fz - fz0) / fz0
    scale: float  # friction of the road over the reference


@wp.struct
class Pure:
    """A force of one slip alone, with what its combination needs."""

    force: float
    k: float  # slope
    mu: float
    s_h: float
    s_v: float
    b: float
    c: float


@wp.func
def pure_longitudinal(s: Slip, p: wp.array[float]) -> Pure:
    """F_x0."""
    f = Pure()
    g = s.g * p[Pac02.LGAX]
    f.s_h = (p[Pac02.PHX1] + p[Pac02.PHX2] * s.d) * p[Pac02.LHX]
    f.s_v = s.fz * (p[Pac02.PVX1] + p[Pac02.PVX2] * s.d) * p[Pac02.LVX] * p[Pac02.LMUX]
    x = s.k + f.s_h
    e = (p[Pac02.PEX1] + (p[Pac02.PEX2] + p[Pac02.PEX3] * s.d) * s.d) * p[Pac02.LEX]
    e *= 1.0 - p[Pac02.PEX4] * wp.sign(x)
    f.mu = (p[Pac02.PDX1] + p[Pac02.PDX2] * s.d) * (1.0 - p[Pac02.PDX3] * g * g)
    f.mu = wp.abs(s.scale * f.mu * p[Pac02.LMUX] * p[Pac02.AT_PRESSURE_MUX])
    f.k = s.fz * (p[Pac02.PKX1] + p[Pac02.PKX2] * s.d) * wp.exp(p[Pac02.PKX3] * s.d)
    f.k *= p[Pac02.LKX] * p[Pac02.AT_PRESSURE_KX]
    f.c = p[Pac02.PCX1] * p[Pac02.LCX]
    f.b = f.k / (f.c * f.mu * s.fz + 0.1)
    bx = wp.clamp(f.b * x, -p[Pac02.ARGUMENT_LIMIT], p[Pac02.ARGUMENT_LIMIT])
    f.force = f.mu * s.fz * magic_sine(bx, f.c, wp.min(e, 1.0)) + f.s_v
    return f


@wp.func
def pure_lateral(s: Slip, p: wp.array[float]) -> Pure:
    """F_y0."""
    f = Pure()
    g = s.g * p[Pac02.LGAY]
    f.k = p[Pac02.PKY1] * p[Pac02.FNOMIN] * p[Pac02.LFZO] * p[Pac02.AT_PRESSURE_KY]
    f.k *= wp.sin(2.0 * wp.atan(s.fz / (p[Pac02.PKY2] * s.fz0 * p[Pac02.AT_PRESSURE_PKY2])))
    f.k *= (1.0 - p[Pac02.PKY3] * wp.abs(g)) * p[Pac02.LKY]
    f.s_h = (p[Pac02.PHY1] + p[Pac02.PHY2] * s.d) * p[Pac02.LHY] + p[Pac02.PHY3] * g * p[Pac02.LKYG]
    f.s_v = (p[Pac02.PVY1] + p[Pac02.PVY2] * s.d) * p[Pac02.LVY]
    f.s_v += (p[Pac02.PVY3] + p[Pac02.PVY4] * s.d) * g * p[Pac02.LKYG]
    f.s_v *= s.fz * p[Pac02.LMUY]
    y = s.a + f.s_h
    e = (p[Pac02.PEY1] + p[Pac02.PEY2] * s.d) * p[Pac02.LEY]
    e *= 1.0 - (p[Pac02.PEY3] + p[Pac02.PEY4] * g) * wp.sign(y)
    f.mu = (p[Pac02.PDY1] + p[Pac02.PDY2] * s.d) * (1.0 + p[Pac02.MUY_CAMBER] * p[Pac02.PDY3] * g * g)
    f.mu = wp.abs(s.scale * f.mu * p[Pac02.LMUY] * p[Pac02.AT_PRESSURE_MUY])
    f.c = p[Pac02.PCY1] * p[Pac02.LCY]
    f.b = f.k / (f.c * f.mu * s.fz + 0.1)
    by = wp.clamp(f.b * y, -p[Pac02.ARGUMENT_LIMIT], p[Pac02.ARGUMENT_LIMIT])
    f.force = f.mu * s.fz * magic_sine(by, f.c, wp.min(e, 1.0)) + f.s_v
    return f


@wp.func
def ellipse_force(s: Slip, x: Pure, y: Pure) -> wp.vec2:
    """(F_x, F_y) by the ellipse of friction in the direction of the slip."""
    along = wp.abs(s.k + x.s_h + x.s_v / x.k)
    across = wp.abs(wp.sin(s.a + y.s_h + y.s_v / y.k))
    size = wp.max(wp.sqrt(along * along + across * across), 1.0e-9)
    along /= size
    across /= size
    used_x = wp.abs(x.force - x.s_v) / s.fz
    used_y = wp.abs(y.force - y.s_v) / s.fz
    share_x = along / wp.max(wp.length(wp.vec2(along, used_x * across / y.mu)), 1.0e-9)
    share_y = across / wp.max(wp.length(wp.vec2(across, used_y * along / x.mu)), 1.0e-9)
    return wp.vec2(x.force * share_x, y.force * share_y)


@wp.func
def lateral_shift(s: Slip, y: Pure, p: wp.array[float]) -> float:
    """S_Vyk: lateral force that the longitudinal slip brings about [N]."""
    d = y.mu * s.fz * (p[Pac02.RVY1] + p[Pac02.RVY2] * s.d + p[Pac02.RVY3] * s.g)
    d *= wp.cos(wp.atan(p[Pac02.RVY4] * s.a))
    return d * wp.sin(p[Pac02.RVY5] * wp.atan(p[Pac02.RVY6] * s.k)) * p[Pac02.LVYKA]


@wp.func
def weighted_force(s: Slip, x: Pure, y: Pure, p: wp.array[float]) -> wp.vec2:
    """(F_x, F_y) by Pacejka's cosine weights."""
    e_x = wp.min(p[Pac02.REX1] + p[Pac02.REX2] * s.d, 1.0)
    b_x = wp.abs(p[Pac02.RBX1] * wp.cos(wp.atan(p[Pac02.RBX2] * s.k)) * p[Pac02.LXAL])
    shift_x = p[Pac02.RHX1]
    g_x = magic_cosine(b_x * (s.a + shift_x), p[Pac02.RCX1], e_x) / magic_cosine(b_x * shift_x, p[Pac02.RCX1], e_x)
    e_y = wp.min(p[Pac02.REY1] + p[Pac02.REY2] * s.d, 1.0)
    b_y = p[Pac02.RBY1] * wp.cos(wp.atan(p[Pac02.RBY2] * (s.a - p[Pac02.RBY3]))) * p[Pac02.LYKA]
    shift_y = p[Pac02.RHY1] + p[Pac02.RHY2] * s.d
    g_y = magic_cosine(b_y * (s.k + shift_y), p[Pac02.RCY1], e_y) / magic_cosine(b_y * shift_y, p[Pac02.RCY1], e_y)
    return wp.vec2(x.force * g_x, y.force * g_y + lateral_shift(s, y, p))


@wp.func
def equivalent_angle(angle: float, s: Slip, x: Pure, y: Pure, combined: bool) -> float:
    """A slip angle, with the longitudinal slip in it where slips are combined [rad]."""
    if not combined:
        return angle
    t = wp.tan(angle)
    ratio = x.k / y.k * s.k
    return wp.atan(wp.sqrt(t * t + ratio * ratio)) * wp.sign(angle)


@wp.func
def aligning_torque(s: Slip, x: Pure, y: Pure, force: wp.vec2, weighted: bool, p: wp.array[float]) -> float:
    """M_z [N·m]."""
    g = s.g * p[Pac02.LGAZ]
    radius = p[Common.RADIUS]
    shift = p[Pac02.QHZ1] + p[Pac02.QHZ2] * s.d + (p[Pac02.QHZ3] + p[Pac02.QHZ4] * s.d) * g
    a_t = equivalent_angle(s.a + shift, s, x, y, weighted)
    a_r = equivalent_angle(s.a + y.s_h + y.s_v / y.k, s, x, y, weighted)
    grip = p[Pac02.LKY] / p[Pac02.LMUY]
    b = p[Pac02.QBZ1] + (p[Pac02.QBZ2] + p[Pac02.QBZ3] * s.d) * s.d
    b = wp.abs(b * (1.0 + p[Pac02.QBZ4] * g + p[Pac02.QBZ5] * wp.abs(g)) * grip)
    c = p[Pac02.QCZ1]
    e = p[Pac02.QEZ1] + (p[Pac02.QEZ2] + p[Pac02.QEZ3] * s.d) * s.d
    e *= 1.0 + (p[Pac02.QEZ4] + p[Pac02.QEZ5] * g) * wp.atan(b * c * (s.a + shift)) * 0.63661977
    trail = s.fz * (p[Pac02.QDZ1] + p[Pac02.QDZ2] * s.d) * (1.0 + (p[Pac02.QDZ3] + p[Pac02.QDZ4] * g) * g)
    trail *= radius / s.fz0 * p[Pac02.LTR] * p[Pac02.AT_PRESSURE_TRAIL]
    trail *= wp.cos(c * wp.atan(bent(b * a_t, wp.min(e, 1.0)))) * wp.cos(s.a)
    residual = (p[Pac02.QDZ6] + p[Pac02.QDZ7] * s.d) * p[Pac02.LRES]
    residual += (p[Pac02.QDZ8] + p[Pac02.QDZ9] * s.d) * p[Pac02.AT_PRESSURE_RESIDUAL] * g
    residual *= s.fz * radius * p[Pac02.LMUY]
    b_r = p[Pac02.QBZ9] * grip + p[Pac02.QBZ10] * y.b * y.c
    residual *= wp.cos(wp.atan(b_r * a_r)) * wp.cos(s.a)
    if not weighted:
        return -trail * force[1] + residual
    arm = p[Pac02.SSZ1] + p[Pac02.SSZ2] * force[1] / s.fz0 + (p[Pac02.SSZ3] + p[Pac02.SSZ4] * s.d) * s.g
    arm *= radius * p[Pac02.LS]
    return -trail * (force[1] - lateral_shift(s, y, p)) + residual + arm * force[0]


@wp.func
def pac02_slip_force(s: Slip, p: wp.array[float]) -> wp.vec3:
    """(F_x, F_y, M_z) in SAE axes [N, N, N·m]."""
    mode = int(p[Pac02.MODE])
    if mode == 0:
        return wp.vec3()
    used = s
    if mode == 1:
        used.a = 0.0
    if mode == 2:
        used.k = 0.0
    x = pure_longitudinal(used, p)
    y = pure_lateral(used, p)
    force = wp.vec2(x.force, y.force)
    weighted = mode == 4 and p[Pac02.ELLIPSE] == 0.0
    if weighted:
        force = weighted_force(used, x, y, p)
    elif mode == 4:
        force = ellipse_force(used, x, y)
    if mode == 1:
        return wp.vec3(force[0], 0.0, 0.0)
    m_z = aligning_torque(used, x, y, force, weighted, p)
    if mode == 2:
        return wp.vec3(0.0, force[1], m_z)
    return wp.vec3(force[0], force[1], m_z)


@wp.func
def tipping_torque(f_y: float, s: Slip, p: wp.array[float]) -> float:
    """M_x [N·m]."""
    share = s.fz / s.fz0
    side = f_y / s.fz0
    m = p[Pac02.QSX3] * side + p[Pac02.QSX1] * p[Pac02.LVMX]
    m += (
        p[Pac02.QSX4]
        * wp.cos(p[Pac02.QSX5] * wp.atan(share * share))
        * wp.sin(p[Pac02.QSX7] * s.g + p[Pac02.QSX8] * wp.atan(p[Pac02.QSX9] * side))
    )
    m += p[Pac02.QSX10] * wp.atan(p[Pac02.QSX11] * share) * s.g
    m -= p[Pac02.QSX2] * p[Pac02.AT_PRESSURE_MX] * s.g
    return p[Common.RADIUS] * s.fz * m * p[Pac02.LMX]


@wp.func
def resistance_torque(f_x: float, speed: float, s: Slip, p: wp.array[float]) -> float:
    """|M_y| of rolling resistance [N·m]."""
    v = wp.abs(speed) / p[Pac02.REFERENCE_SPEED]
    share = s.fz / p[Pac02.FNOMIN]
    m = p[Pac02.QSY1] + p[Pac02.QSY2] * f_x / p[Pac02.FNOMIN] + p[Pac02.QSY3] * v
    m += p[Pac02.QSY4] * v * v * v * v + (p[Pac02.QSY5] + p[Pac02.QSY6] * share) * s.g * s.g
    m *= wp.pow(share, p[Pac02.QSY7]) * p[Pac02.AT_PRESSURE_MY] * p[Pac02.LMY]
    return s.fz * p[Common.RADIUS] * m


@wp.func
def pac02_lengths(s: Slip, p: wp.array[float], z: wp.array[float]) -> wp.vec2:
    """Relaxation lengths along x and y [m]: those that are given, or of the load."""
    lengths = relaxation_lengths(p, z)
    if lengths[0] == 0.0 and p[Pac02.TRANSIENT] == 1.0 and has_lagged_slips(z):
        radius = p[Common.RADIUS]
        x = s.fz / s.fz0 * (p[Pac02.PTX1] + p[Pac02.PTX2] * s.d) * wp.exp(-p[Pac02.PTX3] * s.d)
        y = p[Pac02.PTY1] * wp.sin(2.0 * wp.atan(s.fz / (p[Pac02.PTY2] * s.fz0)))
        y *= (1.0 - p[Pac02.PKY3] * wp.abs(s.g * p[Pac02.LGAY])) * p[Pac02.LFZO]
        lengths = wp.vec2(
            wp.max(radius * x * p[Pac02.LSGKP], SHORTEST), wp.max(radius * y * p[Pac02.LSGAL], SHORTEST)
        )  # fmt: skip
    return lengths


@wp.func
def pac02_force(patch: Patch, mirror: float, p: wp.array[float], z: wp.array[float], dt: float) -> TireForce:
    """Force and torque of a Pacejka 2002 tire; `mirror` is -1 for one measured on the other side."""
    s = Slip()
    load = limited_load(patch, p)
    s.fz = wp.max(load, p[Pac02.FZMIN])
    s.fz0 = p[Pac02.FNOMIN] * p[Pac02.LFZO]
    s.d = (s.fz - s.fz0) / s.fz0
    s.scale = friction_scale(patch, p)
    speed = wp.abs(patch.v[0]) + SPEED_OFFSET
    s.k = wp.clamp(-patch.slide[0] / speed, p[Pac02.KPUMIN], p[Pac02.KPUMAX])
    s.a = wp.clamp(-mirror * wp.atan2(patch.v[1], speed), p[Pac02.ALPMIN], p[Pac02.ALPMAX])
    s.g = wp.clamp(mirror * limited_camber(patch, p), p[Pac02.CAMMIN], p[Pac02.CAMMAX])
    lengths = pac02_lengths(s, p, z)
    if lengths[0] > 0.0:
        x = pure_longitudinal(s, p)
        y = pure_lateral(s, p)
        limit = ADHESION * s.fz * wp.vec2(wp.abs(x.mu / x.k), wp.abs(y.mu / y.k))
        slip = lagged(wp.vec2(s.k, s.a), speed, lengths, limit, z, dt)
        s.k = slip[0]
        s.a = slip[1]
    slipping = load / s.fz * pac02_slip_force(s, p)
    s.fz = load
    share = slip_share(patch, p)
    held = standstill_force(patch, load, p, z, dt)
    f_x = (1.0 - share) * held[0] + share * slipping[0]
    f_y = (1.0 - share) * mirror * held[1] - share * slipping[1]
    result = TireForce()
    result.force = wp.vec3(f_x, mirror * f_y, patch.load)
    result.torque = wp.vec3(
        mirror * tipping_torque(-f_y, s, p),
        resistance_torque(f_x, patch.v[0], s, p) * resistance_share(patch),
        -share * mirror * wp.sign(patch.v[0]) * slipping[2],
    )
    return result
