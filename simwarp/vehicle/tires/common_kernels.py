"""Shared by all models (p: parameter vector): vertical force, standstill bristle, blending, rolling resistance.

A law of slip has no answer at standstill, where slip is 0/0. Below `BLEND_BEGIN` a bristle takes its place (Dahl 1968,
with damping): deflection z, stiffness s0, damping s1, Coulomb force Fc,

    dz/dt = v - s0 |v| / Fc z,   F = -(s0 z + s1 dz/dt),   |F| <= Fc,

with v the velocity of sliding. A held wheel stays: at v = 0 the bristle keeps its force. Between `BLEND_BEGIN` and
`BLEND_END` it gives way to the law of slip.

The equation is linear for the v of one step and is solved exactly over it, so that no step needs to be divided. Forces
act over the whole step, however: a bristle under a mass m stays stable only for h² s0 < 4 m and h s1 < 2 m. Both are
therefore held below m / h² and m / h, which changes nothing where steps are short enough (m: `PATCH_MASS_X`,
`PATCH_MASS_Y`).

Where a tire has relaxation lengths, the slips s' of its contact follow those of the wheel s (Pacejka, Tyre and Vehicle
Dynamics, 2nd edition, equations 7.7 and 7.9 with u = sigma s'):

    sigma ds'/dt = -v_s - V s' = (s - s') V

V is the speed that s is a share of in the law, v_s the velocity of sliding. So sigma s' is the deflection of a spring
which the rolling contact leaves behind: as F(s') has the sign of s', it stores and takes energy and never gives more
back. The equation is linear for the s of one step and is solved exactly: at any step, forwards and backwards, s' stays
between its start and s. A contact that slides as a whole holds no larger deflection than that of adhesion: where the
slip falls, |s'| <= max(|s|, 3 F_max / C), with C the initial slope of F (3: of the brush model, Pacejka 3.17). At rest
the bristle holds alone.
"""

import warp as wp

from simwarp.kernels.core.piecewise_linear import segment_of
from simwarp.vehicle.tires.parameter_vector_kernels import BRISTLE_X, BRISTLE_Y, LAGGED_X, Common
from simwarp.vehicle.tires.patch_kernels import Patch

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

TWO_PI = wp.constant(6.2831853)
RESISTANCE_BEGIN = wp.constant(0.125)  # [m/s]: rolling resistance grows from nothing to its full value between them
RESISTANCE_END = wp.constant(0.5)
LARGEST_LAGGED = wp.constant(2.0)  # slips beyond it slide as much, and would take long to fade
ADHESION = wp.constant(3.0)  # slip at which all of a brush slides, over F_max / C


@wp.func
def sine_step(x: float, begin: float, end: float) -> float:
    """0 up to `begin`, 1 from `end` on, twice differentiable."""
    s = wp.clamp((x - begin) / (end - begin), 0.0, 1.0)
    return s - wp.sin(TWO_PI * s) / TWO_PI


@wp.func
def slip_share(patch: Patch, p: wp.array[float]) -> float:
    """Share of the law of slip; the rest is the bristle's."""
    return sine_step(wp.abs(patch.v[0]), p[Common.BLEND_BEGIN], p[Common.BLEND_END])


@wp.func
def curve_force(p: wp.array[float], deflection: float) -> wp.vec2:
    """Vertical force [N] of a tire's table, and its slope [N/m]; the end segments continue."""
    start = int(p[Common.CURVE_START])
    at = start + 2 * segment_of(p, start, int(p[Common.CURVE_POINTS]), 2, deflection)
    slope = (p[at + 3] - p[at + 1]) / (p[at + 2] - p[at])
    return wp.vec2(p[at + 1] + slope * (deflection - p[at]), slope)


@wp.func
def stiffness_force(p: wp.array[float], deflection: float, camber: float) -> float:
    """Vertical force of the deflection [N]."""
    force = float(0.0)
    if p[Common.CURVE_POINTS] > 1.0:
        force = curve_force(p, deflection)[0]
    else:
        k = p[Common.STIFFNESS] + p[Common.STIFFNESS_CAMBER] * camber * camber
        force = (k + p[Common.STIFFNESS_SQUARE] * deflection) * deflection
    return force + p[Common.BOTTOM_STIFFNESS] * wp.max(deflection - p[Common.BOTTOM_DEFLECTION], 0.0)


@wp.func
def vertical_load(patch: Patch, p: wp.array[float]) -> float:
    """Normal force of spring and damper; the ground does not pull [N]."""
    camber = wp.clamp(patch.camber, -p[Common.CAMBER_LIMIT], p[Common.CAMBER_LIMIT])
    force = stiffness_force(p, patch.deflection, camber) - p[Common.DAMPING] * patch.v[2]
    return wp.max(force, 0.0)


@wp.func
def friction_scale(patch: Patch, p: wp.array[float]) -> float:
    """Friction of the road over that of the measurement."""
    return patch.friction / p[Common.REFERENCE_FRICTION]


@wp.func
def advance_bristle(z: float, v: float, rate: float, dt: float) -> float:
    """Solution of dz/dt = v - rate z after dt, for constant v and rate >= 0."""
    x = rate * dt
    # (1 - exp(-x)) / x, by its series where the difference would lose digits
    mean = 1.0 - 0.5 * x * (1.0 - x / 3.0)
    decay = wp.exp(-x)
    if x > 1.0e-2:
        mean = (1.0 - decay) / x
    return z * decay + v * dt * mean


@wp.func
def bristle_force(
    z: wp.array[float], slot: int, v: float, mass: float, coulomb: float, p: wp.array[float], dt: float
) -> float:  # fmt: skip
    """Advances one bristle and returns its force, not yet limited."""
    s0 = p[Common.BRISTLE_STIFFNESS]
    s1 = p[Common.BRISTLE_DAMPING]
    s0 = wp.min(s0, mass / (dt * dt))
    s1 = wp.min(s1, mass / dt)
    rate = s0 * wp.abs(v) / wp.max(coulomb, 1.0e-6)
    end = advance_bristle(z[slot], v, rate, dt)
    z[slot] = end
    return -(s0 * end + s1 * (v - rate * end))


@wp.func
def standstill_force(patch: Patch, load: float, p: wp.array[float], z: wp.array[float], dt: float) -> wp.vec2:
    """Force of the bristles along x and y, within the circle of friction [N]."""
    coulomb = friction_scale(patch, p) * load
    force = wp.vec2(
        bristle_force(z, BRISTLE_X, patch.slide[0], p[Common.PATCH_MASS_X], coulomb, p, dt),
        bristle_force(z, BRISTLE_Y, patch.slide[1], p[Common.PATCH_MASS_Y], coulomb, p, dt),
    )
    size = wp.length(force)
    if size > coulomb:
        force *= coulomb / size
    return force


@wp.func
def has_lagged_slips(z: wp.array[float]) -> bool:
    """True if the state row has room for slips that follow."""
    return z.shape[0] > LAGGED_X + 1


@wp.func
def relaxation_lengths(p: wp.array[float], z: wp.array[float]) -> wp.vec2:
    """Along x and y [m]; 0: at once, so too where they were written after the state row was made without room."""
    if not has_lagged_slips(z):
        return wp.vec2()
    return wp.vec2(p[Common.RELAXATION_X], p[Common.RELAXATION_Y])


@wp.func
def lagged(slip: wp.vec2, speed: float, lengths: wp.vec2, limit: wp.vec2, z: wp.array[float], dt: float) -> wp.vec2:
    """The slips of the contact.

    Args:
        slip: of the wheel.
        speed: that it is a share of [m/s].
        lengths: of relaxation [m].
        limit: slips at which all of the contact slides.
        z: state, advanced.
        dt: step [s].
    """
    result = wp.vec2()
    for i in range(2):
        s = slip[i] + (z[LAGGED_X + i] - slip[i]) * wp.exp(-dt * speed / lengths[i])
        most = wp.max(wp.abs(slip[i]), limit[i])
        result[i] = wp.clamp(s, -most, most)
    # beyond, the contact slides the way that the wheel does
    if wp.length(result) > LARGEST_LAGGED:
        result = slip * (LARGEST_LAGGED / wp.max(wp.length(slip), LARGEST_LAGGED))
    z[LAGGED_X] = result[0]
    z[LAGGED_X + 1] = result[1]
    return result


@wp.func
def limited_load(patch: Patch, p: wp.array[float]) -> float:
    """The load that horizontal forces grow with [N]."""
    return wp.min(patch.load, p[Common.LOAD_LIMIT])


@wp.func
def limited_camber(patch: Patch, p: wp.array[float]) -> float:
    """Camber within the range of the measurement [rad]."""
    return wp.clamp(patch.camber, -p[Common.CAMBER_LIMIT], p[Common.CAMBER_LIMIT])


@wp.func
def overturning_torque(patch: Patch, p: wp.array[float]) -> float:
    """Torque about x of a patch whose deflection varies across its width with the camber [N·m]."""
    slope = p[Common.STIFFNESS] + 2.0 * p[Common.STIFFNESS_SQUARE] * patch.deflection
    width = p[Common.WIDTH]
    return -width * width * slope / 12.0 * limited_camber(patch, p)


@wp.func
def resistance_share(patch: Patch) -> float:
    """Share of the rolling resistance that acts, with its sign: none at standstill."""
    return -wp.sign(patch.spin) * sine_step(wp.abs(patch.v[0]), RESISTANCE_BEGIN, RESISTANCE_END)
