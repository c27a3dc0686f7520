"""Pose and motion of a sensor in float64: positions are kilometres, differences of velocities micrometres/s."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import world_row

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class MountArrays:
    """A sensor's place on its body; leading dimension 1 or W."""

    body: int  # -1: the world
    position: wp.array[wp.vec3d]  # from the centre of mass, body axes [m]
    rotation: wp.array[wp.quatd]  # sensor axes to body axes


@wp.func
def mount_rotation(world: int, mount: MountArrays, state: StateArrays) -> wp.quatd:
    """Sensor axes to world axes."""
    q = mount.rotation[world_row(world, mount.rotation.shape[0])]
    if mount.body >= 0:
        return state.body_rot[world, mount.body] * q
    return q


@wp.func
def mount_position(world: int, mount: MountArrays, state: StateArrays) -> wp.vec3d:
    """Origin of the sensor, world [m]."""
    p = mount.position[world_row(world, mount.position.shape[0])]
    if mount.body >= 0:
        return state.body_x[world, mount.body] + wp.quat_rotate(state.body_rot[world, mount.body], p)
    return p


@wp.func
def body_velocity(world: int, body: int, state: StateArrays) -> wp.vec3d:
    """Velocity of the centre of mass with what float32 kept back of it, world axes [m/s]; 0 of the world."""
    if body < 0:
        return wp.vec3d()
    v = state.body_v[world, body]
    low = state.body_v_low[world, body]
    return wp.vec3d(
        wp.float64(v[0]) + wp.float64(low[0]),
        wp.float64(v[1]) + wp.float64(low[1]),
        wp.float64(v[2]) + wp.float64(low[2]),
    )


@wp.func
def body_rate(world: int, body: int, state: StateArrays) -> wp.vec3d:
    """Angular velocity with what float32 kept back of it, world axes [rad/s]; 0 of the world."""
    if body < 0:
        return wp.vec3d()
    v = state.body_omega[world, body]
    low = state.body_omega_low[world, body]
    return wp.vec3d(
        wp.float64(v[0]) + wp.float64(low[0]),
        wp.float64(v[1]) + wp.float64(low[1]),
        wp.float64(v[2]) + wp.float64(low[2]),
    )


@wp.func
def mount_velocity(world: int, mount: MountArrays, state: StateArrays) -> wp.vec3d:
    """Velocity of the sensor's origin, world axes [m/s]."""
    if mount.body < 0:
        return wp.vec3d()
    p = mount.position[world_row(world, mount.position.shape[0])]
    arm = wp.quat_rotate(state.body_rot[world, mount.body], p)
    return body_velocity(world, mount.body, state) + wp.cross(body_rate(world, mount.body, state), arm)
