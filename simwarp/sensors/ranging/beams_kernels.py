"""Beams of a scanning sensor: which columns fire in a sub-step, where the sensor is then, and where its rays go."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.vector_math import matrix_to_float, to_float, turned
from simwarp.sensors.clock_kernels import BEGIN, SampleEvents
from simwarp.sensors.motion.mount_motion_kernels import (
    MountArrays,
    body_rate,
    body_velocity,
    mount_position,
    mount_rotation,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

UPRIGHT = wp.constant(0.999999)  # |sin(elevation)| from which "left" is y


@wp.struct
class Scan:
    """A mount and the beams on it, shared by all worlds."""

    mount: MountArrays
    span: float  # the collection window [s]; 0: the sensor stands still while its columns fire
    near: float  # surfaces nearer than this are not seen [m]
    far: float
    direction: wp.array2d[wp.vec3]  # (rows, columns) unit, sensor axes


@wp.struct
class SensorMotion:
    """Pose and motion of a sensor at some time, world axes."""

    x: wp.vec3d
    rot: wp.quatd
    v: wp.vec3d
    omega: wp.vec3d


@wp.func
def sensor_motion(world: int, mount: MountArrays, state: StateArrays) -> SensorMotion:
    """At the end of the sub-step."""
    motion = SensorMotion()
    motion.x = mount_position(world, mount, state)
    motion.rot = mount_rotation(world, mount, state)
    if mount.body >= 0:
        motion.omega = body_rate(world, mount.body, state)
        arm = motion.x - state.body_x[world, mount.body]
        motion.v = body_velocity(world, mount.body, state) + wp.cross(motion.omega, arm)
    return motion


@wp.func
def column_at(fraction: float, columns: int) -> int:
    """The first column whose time, column / columns, is not before a fraction of the window."""
    # less than the spacing, more than the rounding of float32
    return int(wp.ceil(fraction * float(columns) - 1.0e-3))


@wp.func
def is_swept(world: int, scan: Scan, tick: SampleEvents) -> bool:
    """True if the sensor moves while columns of one sub-step fire."""
    return scan.span > 0.0 and tick.mode[world] != BEGIN


@wp.func
def sweep_back(column: int, columns: int, world: int, scan: Scan, motion: SensorMotion, tick: SampleEvents):
    """Place and axes when a column fires, to first order back from the end of the sub-step."""
    early = (tick.fraction_to[world] - float(column) / float(columns)) * scan.span
    rot = turned(motion.rot, -early * to_float(motion.omega))
    return motion.x - wp.float64(early) * motion.v, matrix_to_float(wp.quat_to_matrix(rot))


@wp.func
def left_vector(direction: wp.vec3) -> wp.vec3:
    """The horizontal unit vector to the left of a direction, sensor axes."""
    if wp.abs(direction[2]) > UPRIGHT:
        return wp.vec3(0.0, 1.0, 0.0)
    return wp.normalize(wp.vec3(-direction[1], direction[0], 0.0))


@wp.func
def offset_direction(direction: wp.vec3, left: wp.vec3, tangent: wp.vec2) -> wp.vec3:
    """The direction that leaves a beam's axis to the left and upwards by angles of these tangents."""
    return wp.normalize(direction + tangent[0] * left + tangent[1] * wp.cross(direction, left))


@wp.func
def perturbed_direction(direction: wp.vec3, azimuth: float, elevation: float) -> wp.vec3:
    """A direction read with errors of its angles [rad]."""
    up = wp.cross(direction, left_vector(direction))
    d = wp.cos(elevation) * direction + wp.sin(elevation) * up
    c = wp.cos(azimuth)
    s = wp.sin(azimuth)
    return wp.vec3(c * d[0] - s * d[1], s * d[0] + c * d[1], d[2])
