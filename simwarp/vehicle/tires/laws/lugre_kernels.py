"""LuGre (Canudas de Wit, Tsiotras, Velenis, Basset & Gissinger 2003): friction with a state, at any speed.

Discs side by side across the width stand for the tire; each finds its own contact and carries an equal part of the
vertical stiffness and damping. On each a bristle has the deflections z_x, z_y under the velocity of sliding v (the
average lumped model, in two directions as by Velenis, Tsiotras, Canudas de Wit & Sorine 2005):

    dz_i/dt = v_i - (s0_i |v| / g(|v|) + c |omega| r / L) z_i
    g(|v|)  = m (F_c + (F_s - F_c) exp(-sqrt(|v| / v_s))),    m = road friction / reference friction
    F_i     = -(s0_i z_i + s1_i dz_i/dt + m s2_i v_i) F_z

c |omega| r / L is the rate at which bristles leave a patch of length L = 2 sqrt(r d) that rolls: it makes the force
grow with the slip, as other models prescribe it. In steady sliding |F| = (g + m s2 |v|) F_z along -v; at rest the
bristle holds: nothing is blended. The equation is linear for the v of one step and is solved exactly. Its damping
s1 F_z is reduced to s1 F_z / (1 + h s1 F_z / m) with m as in common.py.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.vehicle.tires.common_kernels import advance_bristle, friction_scale, resistance_share, vertical_load
from simwarp.vehicle.tires.ground_kernels import TerrainTables, friction_at
from simwarp.vehicle.tires.parameter_vector_kernels import Common, Lugre
from simwarp.vehicle.tires.patch_kernels import Envelopes, Patch, Wheel, contact_point, find_patch

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class DiscSum:
    """The forces of all discs on a wheel, world axes, about its centre; and the deepest contact, with all the load."""

    patch: Patch
    force: wp.vec3
    torque: wp.vec3


@wp.func
def sliding_friction(v: float, scale: float, p: wp.array[float]) -> float:
    """g: friction of steady sliding."""
    kinetic = p[Lugre.KINETIC_FRICTION]
    stribeck = wp.exp(-wp.sqrt(v / p[Lugre.STRIBECK_SPEED]))
    return scale * (kinetic + (p[Lugre.STATIC_FRICTION] - kinetic) * stribeck)


@wp.func
def disc_force(patch: Patch, p: wp.array[float], z: wp.array[float], disc: int, dt: float) -> wp.vec2:
    """Advances the bristle of a disc and returns its force along x and y [N]."""
    v = wp.length(patch.slide)
    scale = friction_scale(patch, p)
    g = sliding_friction(v, scale, p)
    length = 2.0 * wp.sqrt(p[Common.RADIUS] * patch.deflection)
    carried = p[Lugre.CARRY_OFF] * wp.abs(patch.spin) * patch.effective_radius / length
    force = wp.vec2()
    for i in range(2):
        s0 = p[Lugre.BRISTLE_STIFFNESS + i]
        s1 = p[Lugre.BRISTLE_DAMPING + i]
        mass = p[Common.PATCH_MASS_X + i]
        s1 = s1 / (1.0 + dt * s1 * patch.load / mass)
        rate = s0 * v / g + carried
        end = advance_bristle(z[2 * disc + i], patch.slide[i], rate, dt)
        z[2 * disc + i] = end
        f = s0 * end + s1 * (patch.slide[i] - rate * end) + scale * p[Lugre.VISCOSITY + i] * patch.slide[i]
        force[i] = -f * patch.load
    return force


@wp.func
def lugre_force(
    world: int, index: int, wheel: Wheel, method: int, p: wp.array[float], z: wp.array[float],
    ground_friction: wp.array[float], terrain: TerrainTables, envelopes: Envelopes, assets: Assets, dt: float,
) -> DiscSum:  # fmt: skip
    """Forces of all discs."""
    total = DiscSum()
    count = int(p[Lugre.DISC_COUNT])
    load = float(0.0)
    for disc in range(count):
        aside = (float(disc) - 0.5 * float(count - 1)) * p[Lugre.DISC_SPACING] * wheel.axis
        moved = wheel
        moved.x = wheel.x + wp.vec3d(wp.float64(aside[0]), wp.float64(aside[1]), wp.float64(aside[2]))
        moved.v = wheel.v + wp.cross(wheel.omega_w, aside)
        patch = find_patch(world, index, moved, method, p, terrain, envelopes, assets)
        if patch.touching == 1:
            patch.load = vertical_load(patch, p) / float(count)
        if patch.load > 0.0:
            friction = friction_at(world, contact_point(moved, patch), ground_friction, terrain)
            patch.friction = wp.clamp(friction, p[Common.FRICTION_LOWER], p[Common.FRICTION_UPPER])
            f = disc_force(patch, p, z, disc, dt)
            force = f[0] * patch.forward + f[1] * patch.left + patch.load * patch.normal
            resistance = p[Common.ROLLING_RESISTANCE] * patch.load * resistance_share(patch)
            total.force += force
            total.torque += wp.cross(aside + patch.arm, force) + resistance * patch.left
            load += patch.load
            if patch.deflection > total.patch.deflection:
                patch.arm = patch.arm + aside
                total.patch = patch
        else:
            z[2 * disc] = 0.0
            z[2 * disc + 1] = 0.0
    total.patch.load = load
    return total
