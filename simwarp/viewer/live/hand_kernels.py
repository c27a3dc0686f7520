"""A hand that pulls at one body of one world, before each sub-step, and lets go after it."""

import warp as wp

from simwarp.kernels.core.fields import ControlArrays, StateArrays
from simwarp.kernels.core.vector_math import to_float
from simwarp.kernels.core.world_range import WorldRange

wp.set_module_options({"enable_backward": False})


@wp.struct
class Grip:
    """Arrays of one element each: what is held, where, and how hard."""

    world: wp.array[int]  # -1: nothing is held
    body: wp.array[int]
    grab: wp.array[wp.vec3d]  # from the centre of mass, body axes [m]
    pointer: wp.array[wp.vec3d]  # world axes [m]
    law: wp.array[wp.vec3]  # stiffness [N/m], damping [N s/m], largest force [N]
    force: wp.array[wp.vec3]  # what other elements had written [N]
    torque: wp.array[wp.vec3]


@wp.kernel
def pull(worlds: WorldRange, grip: Grip, state: StateArrays, control: ControlArrays):
    """Adds the spring and the damper between the grabbed point and the pointer."""
    world = worlds.first + wp.tid()
    if world != grip.world[0]:
        return
    body = grip.body[0]
    arm = wp.quat_rotate(state.body_rot[world, body], grip.grab[0])
    away = to_float(grip.pointer[0] - state.body_x[world, body] - arm)
    lever = to_float(arm)
    speed = state.body_v[world, body] + wp.cross(state.body_omega[world, body], lever)
    law = grip.law[0]
    force = law[0] * away - law[1] * speed
    size = wp.length(force)
    if size > law[2]:
        force = force * (law[2] / size)
    grip.force[0] = control.element_force[world, body]
    grip.torque[0] = control.element_torque[world, body]
    control.element_force[world, body] = grip.force[0] + force
    control.element_torque[world, body] = grip.torque[0] + wp.cross(lever, force)


@wp.kernel
def let_go(worlds: WorldRange, grip: Grip, control: ControlArrays):
    """Brings back what other elements had written."""
    world = worlds.first + wp.tid()
    if world != grip.world[0]:
        return
    control.element_force[world, grip.body[0]] = grip.force[0]
    control.element_torque[world, grip.body[0]] = grip.torque[0]
